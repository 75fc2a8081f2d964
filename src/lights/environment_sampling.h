/* SPDX-License-Identifier: MIT
 *
 * environment_sampling.h - all environments of a scene as one light, importance sampled by luminance.
 */
#ifndef PELL_ENVIRONMENT_SAMPLING_H
#define PELL_ENVIRONMENT_SAMPLING_H

#include "math/vec.h"

#include <pellucid/scene.h>

struct pell_environment_sampler {
    struct pell_sampled_environment *list;
    size_t count;
    double irradiance; /* W/m^2: luminance of the mean irradiance over orientations; 0: nothing to sample */
};

/* `e` is zeroed. Call the finish function even after a failure. */
PELL_NODISCARD enum pell_result pell_environment_sampler_make(struct pell_context *ctx, const struct pell_scene *scene,
                                                              struct pell_environment_sampler *e);
void pell_environment_sampler_finish(struct pell_context *ctx, struct pell_environment_sampler *e);
/* Samples a unit direction of density > 0; choice, u, v in [0, 1), `choice` selects one of several environments. */
struct pell_vec3 pell_environment_sampler_sample(const struct pell_environment_sampler *e, double choice, double u, double v);
/* Density of that direction, per sr. */
double pell_environment_sampler_density(const struct pell_environment_sampler *e, struct pell_vec3 direction);
/* Radiance summed over environments, W/(m^2 sr). */
void pell_environment_sampler_radiance(const struct pell_environment_sampler *e, struct pell_vec3 direction, float rgb[3]);

#endif
