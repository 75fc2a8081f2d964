/* SPDX-License-Identifier: MIT
 *
 * light_sampling.h - the lights of a scene as they are, to be sampled one by one: nothing resolved, nothing filtered, no shadows.
 *
 * What a light gives, in the measure of its kind:
 *     point, spot    intensity    W/sr x 1e6, so that intensity x sr / mm^2 is W/m^2
 *     directional    irradiance   W/m^2 of a plane that faces it
 *     rect, disc     radiance     W/(m^2 sr), of the front only
 *     environment    radiance     W/(m^2 sr); all environments of a scene are one light, the sum
 * Projected images, cones and ranges are in these numbers already. Lights hide nothing, each other neither, as in the irradiance stage.
 *
 * Threads    a set is constant after create.
 */
#ifndef PELL_LIGHT_SAMPLING_H
#define PELL_LIGHT_SAMPLING_H

#include "math/vec.h"

#include <pellucid/scene.h>

struct pell_light_sampler;

/* The scene must live as long as the set. A scene without lights makes an empty set. */
PELL_NODISCARD enum pell_result pell_light_sampler_create(struct pell_context *ctx, const struct pell_scene *scene,
                                                          struct pell_light_sampler **out);
void pell_light_sampler_destroy(struct pell_light_sampler **light_sampler);
size_t pell_light_sampler_count(const struct pell_light_sampler *light_sampler);

/* A place on a light, chosen without regard to who looks. */
struct pell_light_sample {
    int source;
    bool away;               /* infinitely far: `toward` counts, `at` does not */
    bool delta;              /* point, spot, directional: no ray finds it by chance */
    struct pell_vec3 at;     /* mm */
    struct pell_vec3 normal; /* rect, disc: unit, to where it shines */
    struct pell_vec3 toward; /* away: unit, from the scene to the light */
    double pdf;              /* with the choice of the light: 1 for delta lights' place; rect, disc: per mm^2; environment: per sr */
};

/* `u`: three numbers in [0, 1), of more than 24 bits; `near`: where light is wanted; lights are chosen by what they would give there, none
 * is left out. False: no light. */
bool pell_light_sampler_sample(const struct pell_light_sampler *light_sampler, struct pell_vec3 near, const double u[3],
                               struct pell_light_sample *out);

/* sample->pdf as pell_light_sampler_sample(near) would give it. */
double pell_light_sampler_pdf(const struct pell_light_sampler *light_sampler, struct pell_vec3 near,
                              const struct pell_light_sample *sample);

/* What a sample sends to `target`, the first surface that its light meets (for range and projected image), in the measure of
 * its kind. 0 behind rects and discs. */
void pell_light_sampler_power_at(const struct pell_light_sampler *light_sampler, const struct pell_light_sample *sample,
                                 struct pell_vec3 target, float power[3]);

/* What a ray sees of a light. */
struct pell_light_hit {
    struct pell_light_sample sample; /* the place; pdf: with which pell_light_sampler_sample(near) finds it */
    double distance;                 /* mm; INFINITY: the environment */
    float radiance[3];
};

/* What the ray from `x` along the unit direction `w` sees where nothing is in the way up to `reach` mm (INFINITY: to the environment):
 * the rects and discs whose fronts it meets, nearest first, then the environment; each by its number `k` from 0. All of them count, for
 * lights hide nothing: ask k = 0, 1, ... until false. */
bool pell_light_sampler_hit(const struct pell_light_sampler *light_sampler, struct pell_vec3 near, struct pell_vec3 x, struct pell_vec3 w,
                            double reach, int k, struct pell_light_hit *hit);

/* A ray of light. */
struct pell_light_ray {
    struct pell_light_sample sample; /* where it sets out */
    struct pell_vec3 origin, direction;
    double weight[3]; /* what the light sends along it over its density, W x 1e6 (mm^2 W/m^2) */
    double pdf;       /* per sr (point, spot), per mm^2 (directional), per mm^2 sr (others), with the choice of the light */
};

/* A ray of light into the sphere about `centre`, for paths that begin at lights. `u`: five numbers. The mean over rays of weight is the
 * flux into the sphere, or more where a ray may miss it. False: no ray this time, which counts as one of weight 0. The origin of rays from
 * afar is outside of the scene. What comes with the first surface on the way is not in the weight yet: multiply by
 * pell_light_sampler_range. */
bool pell_light_sampler_emit(const struct pell_light_sampler *light_sampler, struct pell_vec3 centre, double radius, const double u[5],
                             struct pell_light_ray *out);
/* What a light's range leaves of its light at `distance` mm, [0, 1]; 1 for lights without. */
double pell_light_sampler_range(const struct pell_light_sampler *light_sampler, int source, double distance);

#endif
