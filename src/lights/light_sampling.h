/* SPDX-License-Identifier: MIT
 *
 * light_sampling.h - sampling of a scene's lights one by one: nothing is resolved or prefiltered, and there are no shadows.
 *
 * Emission by kind of light:
 *     point, spot    intensity    W/sr x 1e6, so that intensity x sr / mm^2 is W/m^2
 *     directional    irradiance   W/m^2 of a plane that faces it
 *     rect, disc     radiance     W/(m^2 sr), on the front only
 *     environment    radiance     W/(m^2 sr); all environments of a scene are one light, the sum
 * Projected images, cones and ranges are included. Lights do not occlude anything, including each other, as in the irradiance stage.
 *
 * Threads    a sampler is constant after create.
 */
#ifndef PELL_LIGHT_SAMPLING_H
#define PELL_LIGHT_SAMPLING_H

#include "math/vec.h"

#include <pellucid/scene.h>

struct pell_light_sampler;

/* The scene must outlive the sampler. A scene without lights makes an empty one. */
PELL_NODISCARD enum pell_result pell_light_sampler_create(struct pell_context *ctx, const struct pell_scene *scene,
                                                          struct pell_light_sampler **out);
void pell_light_sampler_destroy(struct pell_light_sampler **light_sampler);
size_t pell_light_sampler_count(const struct pell_light_sampler *light_sampler);

/* A point sampled on a light, independent of the receiver's visibility. */
struct pell_light_sample {
    int source;
    bool distant;            /* infinitely far: `toward` is valid, `at` is not */
    bool delta;              /* point, spot, directional: no random ray hits it */
    struct pell_vec3 at;     /* mm */
    struct pell_vec3 normal; /* rect, disc: unit, on the emitting side */
    struct pell_vec3 toward; /* distant: unit, from the scene to the light */
    double pdf;              /* including the choice of the light: 1 for the position of delta lights; rect, disc: per mm^2; environment:
                              * per sr */
};

/* `u`: three numbers in [0, 1), with more than 24 bits; `near`: the receiver; lights are chosen by their estimated contribution there, and
 * none has probability 0. False: no light. */
bool pell_light_sampler_sample(const struct pell_light_sampler *light_sampler, struct pell_vec3 near, const double u[3],
                               struct pell_light_sample *out);

/* The value of sample->pdf by pell_light_sampler_sample(near). */
double pell_light_sampler_pdf(const struct pell_light_sampler *light_sampler, struct pell_vec3 near,
                              const struct pell_light_sample *sample);

/* Emission of a sample toward `target`, the first surface that its light hits (for range and projected image), in the unit of its kind. 0
 * behind rects and discs. */
void pell_light_sampler_power_at(const struct pell_light_sampler *light_sampler, const struct pell_light_sample *sample,
                                 struct pell_vec3 target, float power[3]);

/* Intersection of a ray with a light. */
struct pell_light_hit {
    struct pell_light_sample sample; /* the hit point; pdf: its density by pell_light_sampler_sample(near) */
    double distance;                 /* mm; INFINITY: the environment */
    float radiance[3];
};

/* Lights hit by the ray from `x` along the unit direction `w` up to `reach` mm (INFINITY: including the environment): the rects and discs
 * whose fronts it hits, nearest first, then the environment; indexed by `k` from 0. All of them contribute, because lights do not occlude:
 * call with k = 0, 1, ... until false. */
bool pell_light_sampler_hit(const struct pell_light_sampler *light_sampler, struct pell_vec3 near, struct pell_vec3 x, struct pell_vec3 w,
                            double reach, int k, struct pell_light_hit *hit);

/* A ray emitted by a light. */
struct pell_light_ray {
    struct pell_light_sample sample; /* its origin */
    struct pell_vec3 origin, direction;
    double weight[3]; /* emission over density, W x 1e6 (mm^2 W/m^2) */
    double pdf;       /* per sr (point, spot), per mm^2 (directional), per mm^2 sr (others), including the choice of the light */
};

/* Samples an emitted ray into the sphere around `centre`, for light paths. `u`: five numbers. The mean of weight over rays is the flux into
 * the sphere, or more if rays may miss it. False: no ray, which counts as one with weight 0. Rays of distant lights start outside of the
 * scene. The weight excludes range attenuation, which depends on the first surface: multiply by pell_light_sampler_range. */
bool pell_light_sampler_emit(const struct pell_light_sampler *light_sampler, struct pell_vec3 centre, double radius, const double u[5],
                             struct pell_light_ray *out);
/* Attenuation by a light's range at `distance` mm, [0, 1]; 1 for lights without a range. */
double pell_light_sampler_range(const struct pell_light_sampler *light_sampler, int source, double distance);

#endif
