/* SPDX-License-Identifier: MIT
 *
 * gloss.h - highlights of area lights by multiple importance sampling of points on the light and of directions of the lobe (balance
 * heuristic, Veach and Guibas 1995, "Optimally Combining Sampling Techniques for Monte Carlo Rendering"): few points of a light are inside
 * a narrow lobe, and directions of a wide lobe rarely hit a small light.
 */
#ifndef PELL_SHARED_GLOSS_H
#define PELL_SHARED_GLOSS_H

#include "shared/language.h"

/* Points per light sample at which a highlight is evaluated: rays cost more than lobes. */
#define PELL_GLOSS_POINTS 8

/* A half vector about +z. */
struct pell_half_vector {
    float x, y, z;
};

/* Samples the density D(h) cos(h) of GGX (Walter et al. 2007, equations 35 and 36) from a uniform point of the unit disc. It has the
 * longest tail of all lobes of specular.h, so it serves the others, too. */
PELL_SHARED PELL_STRUCT(pell_half_vector) pell_half_vector_at(float width2, float x, float y)
{
    const float r2 = x * x + y * y, rest = 1.0f - r2 > 1e-5f ? 1.0f - r2 : 1e-5f, sum = rest + width2 * r2;
    const float scale = sqrtf(width2 / sum);
    PELL_STRUCT(pell_half_vector) h;

    h.x = x * scale;
    h.y = y * scale;
    h.z = sqrtf(rest / sum);
    return h;
}

/* Density of the directions l reflected about such half vectors, 1/sr; arguments as for pell_lobe_ggx. */
PELL_SHARED float pell_half_vector_density(float width2, float sin2, float nh, float hh)
{
    const float d = sin2 + nh * nh * width2;
    return width2 * (0.5f / PELL_PI_F) * hh * nh / (d * d + 1e-30f);
}

/* Number of directions for a light with so many samples of its area. */
PELL_SHARED int32_t pell_gloss_directions(int32_t samples)
{
    return samples < 2 ? 4 : samples > 16 ? 32 : 2 * samples;
}

/* Points on the light per sr, over the number of directions: the MIS weight is odds / (odds + density) for points, density / (odds +
 * density) for directions. 0: only points, since the lobe is wide compared to the light. `solid_angle`: solid angle of the light, sr, which
 * need not be exact, but the same for both. */
PELL_SHARED float pell_gloss_odds(float solid_angle, float width2, float nv, int32_t points, int32_t directions)
{
    const float lobe = 4.0f * PELL_PI_F * width2 * (nv > 0.1f ? nv : 0.1f); /* 1 over the largest density, about */
    const float odds = PELL_TO_FLOAT(points) / (solid_angle * PELL_TO_FLOAT(directions));

    return solid_angle > 3.0f * lobe ? odds : 0.0f;
}

#endif
