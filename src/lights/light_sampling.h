/* SPDX-License-Identifier: MIT
 *
 * light_sampling.h - the lamps of a scene as they are, to be sampled one by one: nothing resolved, nothing filtered, no shadows.
 *
 * What a lamp gives, in the measure of its kind:
 *     point, spot    intensity    W/sr x 1e6, so that intensity x sr / mm^2 is W/m^2
 *     directional    irradiance   W/m^2 of a plane that faces it
 *     rect, disc     radiance     W/(m^2 sr), of the front only
 *     environment    radiance     W/(m^2 sr); all environments of a scene are one lamp, the sum
 * Projected images, cones and ranges are in these numbers already. Lamps hide nothing, each other neither, as in the irradiance stage.
 *
 * Threads    a set is constant after create.
 */
#ifndef PELL_EMITTERS_H
#define PELL_EMITTERS_H

#include "math/vec.h"

#include <pellucid/scene.h>

struct pell_emitters;

/* The scene must live as long as the set. A scene without lamps makes an empty set. */
PELL_NODISCARD enum pell_result pell_emitters_create(struct pell_context *ctx, const struct pell_scene *scene, struct pell_emitters **out);
void pell_emitters_destroy(struct pell_emitters **emitters);
size_t pell_emitters_count(const struct pell_emitters *emitters);

/* A place on a lamp, chosen without regard to who looks. */
struct pell_emitter_sample {
    int lamp;
    bool away;               /* infinitely far: `toward` counts, `at` does not */
    bool delta;              /* point, spot, directional: no ray finds it by chance */
    struct pell_vec3 at;     /* mm */
    struct pell_vec3 normal; /* rect, disc: unit, to where it shines */
    struct pell_vec3 toward; /* away: unit, from the scene to the lamp */
    double pdf;              /* with the choice of the lamp: 1 for delta lamps' place; rect, disc: per mm^2; environment: per sr */
};

/* `u`: three numbers in [0, 1), of more than 24 bits; `near`: where light is wanted; lamps are chosen by what they would give there, none
 * is left out. False: no light. */
bool pell_emitters_sample(const struct pell_emitters *emitters, struct pell_vec3 near, const double u[3], struct pell_emitter_sample *out);

/* sample->pdf as pell_emitters_sample(near) would give it. */
double pell_emitters_pdf(const struct pell_emitters *emitters, struct pell_vec3 near, const struct pell_emitter_sample *sample);

/* What a sample sends to `target`, the first surface that its light meets (ranges and slides ask how far and where), in the measure of
 * its kind. 0 behind rects and discs. */
void pell_emitters_power_at(const struct pell_emitters *emitters, const struct pell_emitter_sample *sample, struct pell_vec3 target,
                            float power[3]);

/* What the ray from `x` along the unit direction `w` sees where nothing is in the way up to `reach` mm (INFINITY: to the environment):
 * the rects and discs whose fronts it meets, nearest first, then the environment; each by its number `k` from 0. All of them count, for
 * lamps hide nothing: ask k = 0, 1, ... until false. *pdf: density with which pell_emitters_sample(near) finds that place, in the sample's
 * measure; *distance mm, INFINITY for the environment. */
bool pell_emitters_hit(const struct pell_emitters *emitters, struct pell_vec3 near, struct pell_vec3 x, struct pell_vec3 w, double reach,
                       int k, struct pell_emitter_sample *sample, double *distance, float radiance[3], double *pdf);

/* A ray of light into the sphere about `centre`, for paths that begin at lamps. `u`: five numbers. `weight`: what the lamp sends along the
 * ray over the density of the ray, W x 1e6 (mm^2 W/m^2): the mean over rays of weight is the flux into the sphere, or more where a ray may
 * miss it. *pdf: that density; per sr (point, spot), per mm^2 (directional), per mm^2 sr (others), with the choice of the lamp. False: no
 * ray this time, which counts as one of weight 0. The origin of rays from afar is outside of the scene. What comes with the first surface
 * on the way is not in the weight yet: multiply by pell_emitters_range. */
bool pell_emitters_emit(const struct pell_emitters *emitters, struct pell_vec3 centre, double radius, const double u[5],
                        struct pell_emitter_sample *sample, struct pell_vec3 *origin, struct pell_vec3 *direction, double weight[3],
                        double *pdf);
/* The density with which pell_emitters_emit gives the ray along the unit `direction` from the place of `sample` (away: towards `target`),
 * 0 where it doesn't. */
double pell_emitters_emit_pdf(const struct pell_emitters *emitters, struct pell_vec3 centre, double radius,
                              const struct pell_emitter_sample *sample, struct pell_vec3 direction, struct pell_vec3 target);
/* What a lamp's range leaves of its light at `distance` mm, [0, 1]; 1 for lamps without. */
double pell_emitters_range(const struct pell_emitters *emitters, int lamp, double distance);

#endif
