/* SPDX-License-Identifier: MIT
 *
 * emitters.h - the lamps of a scene as they are, to be sampled one by one: nothing resolved, nothing filtered, no shadows.
 *
 * What a lamp gives, in the measure of its kind (struct pell_emission):
 *     point, spot    intensity    W/sr x 1e6, so that intensity x sr / mm^2 is W/m^2
 *     directional    irradiance   W/m^2 of a plane that faces it
 *     rect, disc     radiance     W/(m^2 sr), of the front only
 *     environment    radiance     W/(m^2 sr)
 * Projected images, cones and ranges are in these numbers already.
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

/* `u`: three numbers in [0, 1). `near`: where light is wanted; lamps are chosen by what they would give there. False: no light. */
bool pell_emitters_sample(const struct pell_emitters *emitters, struct pell_vec3 near, const double u[3], struct pell_emitter_sample *out);

/* What a sample sends along the unit direction `from_lamp`, in the measure of its kind. */
void pell_emitters_power(const struct pell_emitters *emitters, const struct pell_emitter_sample *sample, struct pell_vec3 from_lamp,
                         float power[3]);

/* What the ray from `x` along the unit direction `w` sees where nothing is in the way up to `reach` mm (INFINITY: to the environment):
 * the nearest rect or disc whose front it meets, else the environment. False: nothing. *pdf: density with which
 * pell_emitters_sample(near) finds that place, in the sample's measure. */
bool pell_emitters_hit(const struct pell_emitters *emitters, struct pell_vec3 near, struct pell_vec3 x, struct pell_vec3 w, double reach,
                       struct pell_emitter_sample *sample, double *distance, float radiance[3], double *pdf);

/* A ray of light into the sphere about `centre`, for paths that begin at lamps. `u`: five numbers. `weight`: what the lamp sends along the
 * ray over the density of the ray, W x 1e6 (mm^2 W/m^2): the mean over rays of weight is the flux into the sphere, or more where a ray may
 * miss it. *pdf: that density; per sr (point, spot), per mm^2 (directional), per mm^2 sr (others), with the choice of the lamp. */
bool pell_emitters_emit(const struct pell_emitters *emitters, struct pell_vec3 centre, double radius, const double u[5],
                        struct pell_emitter_sample *sample, struct pell_vec3 *origin, struct pell_vec3 *direction, double weight[3],
                        double *pdf);

#endif
