/* SPDX-License-Identifier: MIT
 * environment.h - positions of directions in the tables and images of an environment (lights/lights.h). */
#ifndef PELL_SHARED_ENVIRONMENT_H
#define PELL_SHARED_ENVIRONMENT_H

#include "shared/sampling.h"
#ifndef __STDC_VERSION__
#include "shared/elementary.glsl"
#endif

#define PELL_ENV_NODES 129   /* a side of the octahedral table over the normal */
#define PELL_ENV_ROUGHNESS 8 /* roughness levels of the table */

/* Coordinates of a unit normal in the octahedral table, from 0 to PELL_ENV_NODES - 1: poles at +-y; the lower half is folded over the
 * diagonals, so that the border is continuous. */
PELL_SHARED PELL_STRUCT(pell_point2) pell_octahedral_coord(float x, float y, float z)
{
    const float sum = fabsf(x) + fabsf(y) + fabsf(z), inv = sum > 0.0f ? 1.0f / sum : 0.0f;
    const float x0 = x * inv, z0 = z * inv, fold_x = 1.0f - fabsf(z0), fold_z = 1.0f - fabsf(x0);
    PELL_STRUCT(pell_point2) p;

    p.x = y < 0.0f ? pell_float_bits(x0) < 0 ? -fold_x : fold_x : x0;
    p.y = y < 0.0f ? pell_float_bits(z0) < 0 ? -fold_z : fold_z : z0;
    p.x = (p.x * 0.5f + 0.5f) * PELL_TO_FLOAT(PELL_ENV_NODES - 1);
    p.y = (p.y * 0.5f + 0.5f) * PELL_TO_FLOAT(PELL_ENV_NODES - 1);
    return p;
}

/* Position of a unit direction in a latitude-longitude image: x = 1/2 at -z, increasing toward +x; y = 0 at +y. */
PELL_SHARED PELL_STRUCT(pell_point2) pell_panorama_uv(float x, float y, float z)
{
    PELL_STRUCT(pell_point2) p;

    p.x = 0.5f + atan2f(x, -z) * (0.5f / PELL_PI_F);
    p.y = acosf(y < 1.0f ? y > -1.0f ? y : -1.0f : 1.0f) * (1.0f / PELL_PI_F);
    return p;
}

#endif
