/* SPDX-License-Identifier: MIT
 *
 * opposed.h - light transport between faces of a solid at an angle to each other, from the point of entry to the point of exit.
 *
 * A profile assumes a half-space: between x and y with equal normals it falls with the chord d as (1 + s) exp(-s)/d^3, s = kappa d.
 * Between other faces the pair of sources that represents light entering at y (one below the plane there, its image above) is seen from
 * another side. With both planes moved outwards by the extrapolation distance, and far from them, the flux through the plane at x is
 *
 *     F = a b (3 + 3 s + s^2)/(1 + s) + n_x.n_y,      a = -n_y.(x - y)/d,  b = n_x.(x - y)/d
 *
 * times that of a half-space. The image of both in the plane at x doubles it, which is exact at an edge of right angles and the first term
 * of a slab's sum, and too large where light is lost through the sides. The remaining factor was fitted to exact diffusion in slabs,
 * cylinders and spheres of 0.1 to 8 diffusion lengths (ADR 35), by the mean curvature H:
 *
 *     C = (2 + 0.6 exp(-s))/(1 + (H d)^1.5 (exp(-s)/2 + 1/(1 + (s/4.8)^2)))
 *
 * The amount of light is calibrated by radiative transfer in a slab. Faces of equal orientation keep the profile; between 0 and 90 degrees
 * both are blended. Across a concavity the chord passes through air. The flux is (pi/(pi + t))^2 cos^2(t/2) of the profile over the chord,
 * t the angle between the normals, which is the flux around an edge of the angle pi + t (conformal map of a plane wedge).
 */
#ifndef PELL_OPPOSED_H
#define PELL_OPPOSED_H

#include "math/scalar.h"

#include <pellucid/profile.h>

#include <math.h>

#define PELL_OPPOSED_SEEN 0.45f    /* cosine above which faces are mutually visible, */
#define PELL_OPPOSED_HIDDEN -0.15f /* and below which they are not */
/* Smaller solids are treated as having this radius, in `beyond` + `depth`: diffusion does not apply to them. */
#define PELL_OPPOSED_MIN_RADIUS 2.0f

struct pell_opposed {
    float kappa[3];  /* 1/mm: decay rate of light with depth, by radiative transfer */
    float beyond[3]; /* mm: extrapolation distance from the surface, where the fluence is taken to be 0 */
    float depth[3];  /* mm: depth of the source that represents light which enters */
    float amount[3]; /* power of that source. 0: the profile is used unchanged */
};

/* False, and all 0, if it can't be computed for the medium. */
bool pell_opposed_make(const struct pell_medium *medium, struct pell_opposed *out);

/* pell_curvature_gain for profiles that pell_opposed_apply modifies: exact diffusion in a sphere or around a cavity, over the total of the
 * modified profile there. `gain` is the value of pell_curvature_gain. */
double pell_opposed_gain(const struct pell_opposed *o, int channel, const struct pell_profile *profile, double curvature, double gain);
/* Transmittance of a sphere under uniform light by pell_opposed_split, over the light that enters; 0 if `curvature` is not positive. */
double pell_opposed_across(const struct pell_opposed *o, int channel, double curvature);

/* Transmittance of a slab d mm thick by pell_opposed_split, over the light that enters. */
double pell_opposed_slab(const struct pell_opposed *o, int channel, double d);

/* Two points and v = x - y from entry to exit, mm. */
struct pell_opposed_pair {
    float distance2, from, to, facing; /* v.v, n_y.v, n_x.v, n_x.n_y */
    float curvature;                   /* mean, 1/mm */
    /* dot products t.v, t.n_x and t.t; t: tangential part of the refracted direction in which light enters. 0: normal incidence */
    float t_v, t_nx, t_t;
    /* mm^2: area over which it enters; 0: a point. The source counts as no closer to x than half the width of the area, or than its depth:
     * where a mean free path is as long as a part is thick, sources of some samples coincide with others */
    float area;
};

/* (1 + s) exp(-s)/(4 pi d^3) at a squared distance. */
static inline float pell_opposed_gradient(float kappa, float d2)
{
    const float d = sqrtf(d2 > 1e-20f ? d2 : 1e-20f), s = kappa * d;

    return (1.0f + s) * expf(-s) / (12.5663706f * d * d * d);
}

/* pell_opposed_split for the `wanted` channels; 0 for others. */
static inline float pell_opposed_split_of(const struct pell_opposed *o, const struct pell_opposed_pair *p, const bool wanted[3],
                                          float through[3])
{
    const float versine = 1.0f - p->facing, clamped = versine < 0.0f ? 0.0f : versine > 1.0f ? 1.0f : versine;
    const float weight = clamped * clamped * (3.0f - 2.0f * clamped), t = sqrtf(clamped), over = p->to - p->from;
    const float convex = p->curvature > 0.0f ? p->curvature : 0.0f;
    float inside, air = 0.0f;

    through[0] = through[1] = through[2] = 0.0f;
    if (!(weight > 1e-3f))
        return 1.0f;
    /* 1: the chord is inside the solid, 0: in air */
    inside = 0.5f + 2.5f * over / sqrtf(p->distance2 > 1e-20f ? p->distance2 : 1e-20f);
    inside = inside < 0.0f ? 0.0f : inside > 1.0f ? 1.0f : inside;
    inside *= inside * (3.0f - 2.0f * inside);
    if (inside < 1.0f) {
        const float round = 1.0f + acosf(versine < 2.0f ? 1.0f - versine : -1.0f) / 3.14159265f;
        air = (versine < 2.0f ? 1.0f - 0.5f * versine : 0.0f) / (round * round);
    }
    for (int c = 0; c < 3 && inside > 0.0f; c++) {
        if (!wanted[c])
            continue;
        const float e = o->beyond[c], z = o->depth[c] + e, k = o->kappa[c], max_curvature = 1.0f / (PELL_OPPOSED_MIN_RADIUS * z);
        const float curvature = convex < max_curvature ? convex : max_curvature, out = 1.0f + curvature * e;
        const float shift = o->depth[c], exit = p->to - shift * p->t_nx, far = exit - p->from;
        const float from = p->from - e * versine, to = exit + e * versine;
        const float d2 = p->distance2 + shift * (shift * p->t_t - 2.0f * p->t_v) + 2.0f * e * (far + e * versine);
        const float point2 = d2 + z * (z + 2.0f * from), least2 = 0.25f * (p->area < z * z ? p->area : z * z);
        const float near2 = point2 > least2 ? point2 : least2, far2 = d2 + z * (z - 2.0f * from);
        const float flux = (to + z * p->facing) * pell_opposed_gradient(k, near2) - (to - z * p->facing) * pell_opposed_gradient(k, far2);
        const float d = sqrtf(d2 > 0.0f ? d2 : 0.0f), s = k * d, q = s * (1.0f / 4.8f), fallen = expf(-s), arc = curvature / out * d;
        const float C = (2.0f + 0.6f * fallen) / (1.0f + arc * sqrtf(arc) * (0.5f * fallen + 1.0f / (1.0f + q * q)));
        if (flux > 0.0f)
            through[c] = weight * inside * o->amount[c] * (1.0f + (out * out - 1.0f) * t) * (1.0f + (C - 1.0f) * t) * flux;
    }
    return 1.0f - weight + weight * (1.0f - inside) * air;
}

/* Transport between the two points through the solid, 1/mm^2, in addition to a profile; returns the remaining weight of the profile over
 * the distance. */
static inline float pell_opposed_split(const struct pell_opposed *o, const struct pell_opposed_pair *p, float through[3])
{
    static const bool all[3] = { true, true, true };

    return pell_opposed_split_of(o, p, all, through);
}

/* Weight of pell_opposed_split for a method that spreads light between all faces that it sees, whatever their angle: faces up to about 90
 * degrees apart are mostly visible together, and transport between them would count twice. */
static inline float pell_opposed_unseen(float facing)
{
    return smooth_ramp(PELL_OPPOSED_SEEN, PELL_OPPOSED_HIDDEN, facing);
}

/* R: the profile over the distance, 1/mm^2; replaced by what remains of it, for all light. through: transport through the solid, times
 * `scale`, 1/mm^2, for the light that goes into the depth. */
static inline void pell_opposed_apply(const struct pell_opposed *o, const struct pell_opposed_pair *p, const float scale[3], float R[3],
                                      float through[3])
{
    const float remaining = pell_opposed_split(o, p, through);

    for (int c = 0; c < 3; c++) {
        R[c] *= o->amount[c] > 0.0f ? remaining : 1.0f;
        through[c] = o->amount[c] > 0.0f ? scale[c] * through[c] : 0.0f;
    }
}

#endif
