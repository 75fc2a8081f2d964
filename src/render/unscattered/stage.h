/* SPDX-License-Identifier: MIT
 *
 * stage.h - stage "unscattered": light that passes thin parts of translucent media, or weak media, without being scattered. It follows one
 * path through each pixel,
 *
 *     L = Prod T exp(-sigma_t d) L'       T: transmittance of each boundary, d: length in each medium, sigma_t: not reduced
 *
 * refracted at each boundary by interpolated normals, and reflected inside where refraction is impossible. L' is the background: area
 * lights, environments, and light reflected by surfaces there, which are taken to be diffuse. Rough boundaries spread the path into a lobe
 * (lobe.h), which is used to see area lights, and to see point lights by its density; the direction of the path, and whether it exits, is
 * sampled from the middle of the lobe (facets.h). L is radiance over the square of the index of refraction: for paths that begin and end
 * outside indices cancel.
 *
 * Area lights and environments are filtered by the footprint of pixels; where adjacent paths exit far from each other, by chance or because
 * facets were sampled, pixels share their values (incoherent.c).
 *
 * The transmittance of a slab (pellucid/layers.h) and forward-scattered light (optics/medium/forward.h) include none of this light.
 *
 * Left out: reflection at boundaries that also transmit, opaque objects inside solids, media without coefficients, layers and textured
 * colours, and caustics: shadows have the mean of the light that passes.
 */
#ifndef PELL_UNSCATTERED_H
#define PELL_UNSCATTERED_H

#include "render/indirect/stage.h"

/* The media that transmit unscattered light. */
struct pell_unscattered;

/* *out is NULL where no material's parts are thin enough. PELL_ERR_NOMEM. */
PELL_NODISCARD enum pell_result pell_unscattered_create(struct pell_context *ctx, const struct pell_scene *scene,
                                                        const struct pell_rays *rays, const uint16_t *frame_index,
                                                        const struct pell_frame_material *materials, struct pell_unscattered **out);
void pell_unscattered_destroy(struct pell_unscattered **unscattered);

struct pell_unscattered_params {
    const struct pell_scene *scene;
    const struct pell_rays *rays;
    const struct pell_lights *lights;
    const struct pell_specular_tables *tables;
    const struct pell_view *view;
    const struct pell_surface *surface; /* with mesh ids */
    struct pell_indirect_lights behind; /* light that enters surfaces in the background */
    const float (*total)[3];            /* per scene material: total reflectance of its profile */
    bool smooth;                        /* smooth boundaries */
    int bounces;                        /* largest number of surfaces that a path may hit outside */
    uint32_t sample;
    float *light[3]; /* W/(m^2 sr), written at the translucent pixels of the surface */
};

/* Returns the number of rays. Allocates nothing; the result does not depend on the number of threads, to the bit. */
int64_t pell_unscattered_render(struct pell_pool *pool, const struct pell_unscattered *unscattered,
                                const struct pell_unscattered_params *params);

/* The same toward a light, along a straight line: where a thin part casts a shadow. */
struct pell_unscattered_shadow {
    const struct pell_unscattered *media;
    const struct pell_scene *scene;
    const struct pell_rays *rays;
    const struct pell_specular_tables *tables;
    bool smooth;  /* smooth boundaries */
    bool ambient; /* the rays go to all sides, and less accuracy suffices */
};

/* What a device needs of a scene material for that. `media` may be NULL. */
struct pell_unscattered_material {
    bool is_traced;
    float sigma_t[3];       /* 1/mm */
    float roughness, rho_s; /* of its boundary, without maps */
};
struct pell_unscattered_material pell_unscattered_material(const struct pell_unscattered *media, const struct pell_scene *scene,
                                                           size_t material);

/* Transmittance of what is on 16 occluded rays that begin outside, Prod T exp(-sigma_t d); 0 where `mask` is 0. The rays' tnear are 0.
 * Returns the number of rays that were traced for it. Any thread. */
int64_t pell_unscattered_shadow(const struct pell_unscattered_shadow *shadow, const int32_t mask[16], const struct pell_ray16 *rays,
                                float through[3][16]);

#endif
