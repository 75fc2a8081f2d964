/* SPDX-License-Identifier: MIT
 * internal.h - declarations shared by the files of the stage. Private to the folder. */
#ifndef RENDER_UNSCATTERED_INTERNAL_H
#define RENDER_UNSCATTERED_INTERNAL_H

#include "render/unscattered/facets.h"
#include "render/unscattered/lobe.h"
#include "render/unscattered/stage.h"

#include "lights/lights.h"

#define UNSCATTERED_MAX_THICKNESS 8.0f /* optical thickness of the clearest channel beyond which no light is left */
#define UNSCATTERED_MAX_NESTING 4      /* nested solids */

struct unscattered_medium {
    bool is_traced;    /* it has coefficients, so light is traced through it */
    bool thin;         /* its parts are thin enough where they are visible */
    float eta;         /* relative to outside */
    float sigma_t[3];  /* 1/mm */
    float min_sigma_t; /* of the clearest channel */
};

struct pell_unscattered {
    struct pell_context *ctx;
    struct unscattered_medium *media; /* per scene material */
    float bundles[UNSCATTERED_BUNDLES][4][UNSCATTERED_BUNDLE];
};

/* A solid that contains the path. */
struct unscattered_solid {
    int object, material;
    int inner_surfaces; /* surfaces of the same object inside it that the path has entered */
};

struct unscattered_path {
    struct pell_vec3 position, direction; /* origin of the next ray, just beyond the last surface; unit */
    struct pell_vec3 normal;              /* geometric normal of the last surface, on this side */
    float weight[3];
    struct unscattered_lobe lobe;
    struct unscattered_solid medium_stack[UNSCATTERED_MAX_NESTING];
    int nesting;             /* solids in medium_stack; 0: outside */
    int bounces;             /* bounces left */
    float optical_thickness; /* so far, of the clearest channels */
    uint32_t bundle;
    struct unscattered_random random;
};

/* lights.c. Adds to `rgb` the radiance of lights seen along a path outside, up to `reach` mm, INFINITY where nothing is hit. Returns the
 * number of rays. */
int64_t unscattered_add_lights(const struct pell_unscattered *u, const struct pell_unscattered_params *p, const struct unscattered_path *w,
                               float reach, float rgb[3]);

/* A boundary to outside. */
struct unscattered_boundary {
    int material; /* index in the scene */
    float roughness, rho_s;
};

/* Without its maps. */
static inline struct unscattered_boundary unscattered_boundary_of(const struct pell_scene *scene, int material)
{
    const struct pell_surface_uniform uniform = pell_surface_uniform(&scene->materials[material]);

    return (struct unscattered_boundary) { material, uniform.roughness,
                                           (uniform.specular[0] + uniform.specular[1] + uniform.specular[2]) * (1.0f / 3.0f) };
}

/* boundary.c. Its transmittance at a cosine outside: that of scattered light. */
float unscattered_transmittance(const struct pell_specular_tables *tables, bool smooth, const struct unscattered_boundary *b,
                                float outside);

#define UNSCATTERED_INCOHERENT 1e-30f /* replaces 0, which has no sign */
/* incoherent.c. Pixels with incoherent paths are marked by negative values, and get the mean of those around them. */
void unscattered_blur_incoherent(struct pell_pool *pool, const struct pell_unscattered_params *p);

#endif
