/* SPDX-License-Identifier: MIT
 * angle.h - angular dependence of the light that a translucent medium returns, since profiles assume normal incidence: a factor base +
 * slope (1 - m), m the refracted cosine, for light that enters and for light that leaves (pell_half_space_angle_of in pellucid/profile.h).
 */
#ifndef PELL_ANGLE_H
#define PELL_ANGLE_H

#include "shared/leaving.h"

#include <math.h>

struct pell_angle {
    float inverse_eta2; /* 1/eta^2; 0: no refraction and no factor: all bases are 1, all slopes 0 */
    float enter_base[3], enter_slope[3];
    float enter_mean[3];               /* for diffuse light */
    float exit_base[3], exit_slope[3]; /* mean over diffuse light: 1 */
    float pass_base[3], pass_slope[3]; /* factor for transmitted light, over the factor above (optics/medium/passing.h), */
    float pass_per_mm[3];              /* 1/mm: inverse of the thickness from which it applies in full */
};

/* The refracted direction toward the camera: v, and n the normal, both unit. */
static inline void pell_angle_inside(float inverse_eta2, const float v[3], const float n[3], float inside[3])
{
    const float scale = inverse_eta2 > 0.0f ? sqrtf(inverse_eta2) : 1.0f, nv = v[0] * n[0] + v[1] * n[1] + v[2] * n[2];
    const float sin2 = (1.0f - nv * nv) * scale * scale, m = sqrtf(sin2 < 1.0f ? 1.0f - sin2 : 0.0f);

    for (int k = 0; k < 3; k++)
        inside[k] = scale * (v[k] - nv * n[k]) + m * n[k];
}

/* Mean refracted cosine of diffuse light, by its flux. */
static inline float pell_mean_refracted(float inverse_eta2)
{
    const float rest = 1.0f - inverse_eta2;

    return inverse_eta2 > 1e-3f && inverse_eta2 <= 1.0f ? 2.0f / 3.0f * (1.0f - rest * sqrtf(rest)) / inverse_eta2 : 1.0f;
}

#endif
