/* SPDX-License-Identifier: MIT
 *
 * stage.h - stage "composite": from radiant exitance to radiance at the camera, added up over the multisamples.
 *
 *     L_o = T(w_o) / (pi n) albedo^(1-m) (M + through) + specular
 *
 * T is rho_dt of the specular lobe, or Fresnel's F_t of a smooth boundary. n is its mean over the hemisphere (exit = balanced), so that the
 * boundary transmits all of the profile's flux, or 1 (exit = published).
 */
#ifndef PELL_COMPOSITE_H
#define PELL_COMPOSITE_H

#include "render/irradiance/stage.h"

/* Accumulated planes; all but color, alpha and meter may be NULL. `weight` of each sample is 1 / number of samples. */
struct pell_accumulator {
    float *color[3], *alpha;
    float *multiple[3], *single[3], *transmission[3], *specular[3], *irradiance[3], *normal[3], *albedo[3];
    float *depth;       /* depth of the first sample with a hit */
    float *variance[3]; /* variance of the mean over the samples, for the scattered light in `multiple`; 0 without noise */
    float *translucent; /* fraction of the samples on a translucent material, with any method */
    double *meter;      /* per row: sum of the luminance of arriving irradiance, without albedo, and its number of pixels */
};

struct pell_composite_params {
    const struct pell_scene *scene;
    const struct pell_view *view;
    const struct pell_surface *surface;
    const struct pell_specular_tables *tables;
    const struct pell_lighting *lighting;
    const float *const *exitance; /* M of translucent pixels, or their finished radiance where `radiance`; NULL: no scattering */
    bool radiance;
    bool excludes_surface_reflection; /* with `radiance`: it contains only light that entered, and the specular lobe is added */
    const float *const *single, *const *reflected; /* parts not included in `exitance` (struct pell_frame_light); NULL: none */
    const float *const *unscattered;               /* unscattered radiance; NULL: none */
    const float *const *standard_error;            /* standard error of `exitance`, in its unit; NULL: none */
    const struct pell_angle *angle;                /* per scene material; NULL: no factors */
    const float (*total)[3];                       /* per scene material: total reflectance of its profile, for pixels without scattering */
    float mix;                                     /* mix exponent of the plan; negative: each material's own */
    float diffuse;                                 /* diffuse fraction of the light (pell_lights_diffuse) */
    bool smooth, published;
    struct pell_rect rect; /* bounds of the pixels that any sample may cover; the accumulator is only written there */
    float weight;
    bool first; /* overwrite the accumulator instead of adding to it */
};

/* Scratch for the composite's materials, so that a frame allocates nothing. */
struct pell_compositor;
PELL_NODISCARD enum pell_result pell_compositor_create(struct pell_context *ctx, size_t num_materials, struct pell_compositor **out);
void pell_compositor_destroy(struct pell_compositor **compositor);

/* Writes the accumulator inside `rect`. Allocates nothing. */
void pell_composite_render(struct pell_pool *pool, struct pell_compositor *c, const struct pell_composite_params *params,
                           const struct pell_accumulator *out);

/* Shades covered pixels without scattering: the plane that a method with PELL_NEED_SHADED blurs. `exitance` must be NULL. */
void pell_composite_shaded(struct pell_pool *pool, struct pell_compositor *c, const struct pell_composite_params *params,
                           float *const shaded[3]);

#endif
