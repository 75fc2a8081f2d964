/* SPDX-License-Identifier: MIT
 *
 * stage.h - stage "irradiance": irradiance, transmitted light and specular reflection at each pixel, summed over all lights.
 *
 *     E(x) = albedo^m Sum over lights of L_i T(n . w_i) max(n . w_i, 0) V        T: rho_dt, or Fresnel's F_t of a smooth boundary
 *     through(x) = albedo^m Sum over lights of table(d) E(A)                     A: where the light enters the solid, see below
 *
 * Shadow rays are exact. The mix exponent m is the material's or the plan's; albedo is the base colour where colour comes from the
 * texture, else 1. Opaque materials: m = 1 and albedo the base colour x (1 - metallic).
 */
#ifndef PELL_IRRADIANCE_H
#define PELL_IRRADIANCE_H

#include "lights/lights.h"
#include "lights/specular_tables.h"
#include "render/surface/stage.h"

#include <pellucid/render.h>

struct pell_lighting {
    float *irradiance[3];  /* W/m^2, entered, with albedo^m */
    float *transmitted[3]; /* W/m^2, radiant exitance of transmitted light; 0 where there is none */
    float *specular[3];    /* W/(m^2 sr), with what the surface itself emits */
    int64_t shadow_rays;
};

struct pell_irradiance_params {
    const struct pell_rays *rays;
    const struct pell_scene *scene;
    const struct pell_view *view;
    const struct pell_surface *surface;
    const struct pell_specular_tables *tables;           /* of pell_specular_tables_create */
    const struct pell_thickness_table *const *thickness; /* per scene material, entries may be NULL; NULL: no transmission */
    float mix;                                           /* plan's; negative: each material's own */
    const float *ambient;                                /* of pell_irradiance_points: visibility of the environment's smooth rest at
                                                               * the points; NULL: found by rays */
    uint64_t lights;                                     /* bit min(i, 63) of each light i of the scene that counts; 0: all */
    bool smooth;                                         /* boundary: Fresnel's F_t in place of rho_dt */
    uint32_t sample;                                     /* number of the multisample: varies the sample patterns */
    uint32_t seed;
};

/* Allocates nothing; the same bits for any number of threads. */
PELL_NODISCARD enum pell_result pell_irradiance_render(struct pell_pool *pool, struct pell_lights *lights,
                                                       const struct pell_irradiance_params *params, struct pell_lighting *out);

/* --- points.c: light that enters anywhere --------------------------------------------------------------------------------------- */

/* 16 points of a scene's triangles. Lanes whose mesh is PELL_NO_HIT are none. */
struct pell_points {
    _Alignas(64) uint32_t mesh[16];
    uint32_t triangle[16];
    float u[16], v[16];  /* barycentric: p = (1 - u - v) p0 + u p1 + v p2 */
    uint32_t number[16]; /* names the patterns in which lights with extent are sampled: points of one number share them */
};

struct pell_points_light {
    _Alignas(64) int32_t there[16]; /* -1; 0: no point, or one where the material is cut out by its alpha */
    float position[3][16];          /* mm */
    float normal[3][16];            /* geometric, unit, outward by the order of the triangle's corners */
    float irradiance[3][16];        /* W/m^2, entered, with albedo^m; of the outer side */
    float strength[16];             /* of scattering, [0, 1]; 1 where no point is */
    int rays;                       /* traced for it */
};

/* What pell_irradiance_render gives at pixels, at any points: the same lights, tables and formulas, the mean over `samples` numbers of the
 * multisample from params->sample on. params->surface is any surface that was allocated, its view is not read; textures are filtered to
 * `spacing` mm, > 0. Allocates nothing; safe from many threads. */
void pell_irradiance_points(const struct pell_lights *lights, const struct pell_irradiance_params *params, const struct pell_points *points,
                            float spacing, int samples, struct pell_points_light *out);

/* --- cpu.c, for points.c ------------------------------------------------------------------------------------------------------------- */

/* The light of up to 16 points in space: params->surface has 4 x 4 pixels with a stride of 4 and is as pell_surface_look leaves it, with
 * material 0 where no point is; `place` mm. Fills out->irradiance where a point is; its other planes hold anything then. */
void pell_irradiance_at(const struct pell_lights *lights, const struct pell_irradiance_params *params, const float *const place[3],
                        const uint32_t number[PELL_LANES], struct pell_lighting *out);

#endif
