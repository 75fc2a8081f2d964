/* SPDX-License-Identifier: MIT
 *
 * irradiance.h - stage "irradiance": light that enters at each pixel, light from behind, and the specular reflection, over all lights.
 *
 *     E(x) = albedo^m Sum over lights of L_i T(n . w_i) max(n . w_i, 0) V        T: rho_dt, or Fresnel's F_t of a smooth boundary
 *     through(x) = albedo^m Sum over lights of table(d) E(A)                     A: where the light enters the solid, see below
 *
 * Shadow rays are exact. The mix exponent m is the material's or the plan's; albedo is the base colour where colour comes from the
 * texture, else 1. Opaque materials: m = 1 and albedo the base colour x (1 - metallic).
 */
#ifndef PELL_IRRADIANCE_H
#define PELL_IRRADIANCE_H

#include "render/specular.h"
#include "render/surface/surface.h"

#include <pellucid/render.h>

/* What does not change from frame to frame: area-light samples, the environment resolved into lights and a smooth rest, tables. */
struct pell_lights;

PELL_NODISCARD enum pell_result pell_lights_create(struct pell_context *ctx, const struct pell_scene *scene,
                                                   const struct pell_settings *settings, struct pell_pool *pool, struct pell_lights **out);
void pell_lights_destroy(struct pell_lights **lights);

/* Radiance of the environment in a direction, for backgrounds; false where the scene has none. */
bool pell_lights_background(const struct pell_lights *lights, struct pell_vec3 direction, float rgb[3]);

struct pell_lighting {
    float *irradiance[3]; /* W/m^2, entered, with albedo^m */
    float *through[3];    /* W/m^2, radiant exitance of light from behind; 0 where nothing comes through */
    float *specular[3];   /* W/(m^2 sr), with what the surface itself emits */
    int64_t shadow_rays;
};

struct pell_irradiance_params {
    const struct pell_rays *rays;
    const struct pell_scene *scene;
    const struct pell_view *view;
    const struct pell_surface *surface;
    const struct pell_specular_tables *tables;                /* of pell_specular_tables_create */
    const struct pell_thickness_table *const *thickness;      /* per scene material, entries may be NULL; NULL: no light from behind */
    float mix;                                                /* plan's; negative: each material's own */
    bool smooth;                                              /* boundary: Fresnel's F_t in place of rho_dt */
    uint32_t sample;                                          /* number of the multisample: varies the sample patterns */
    uint32_t seed;
};

/* Allocates nothing; the same bits for any number of threads. */
PELL_NODISCARD enum pell_result pell_irradiance_render(struct pell_pool *pool, struct pell_lights *lights,
                                                       const struct pell_irradiance_params *params, struct pell_lighting *out);

#endif
