/* SPDX-License-Identifier: MIT
 *
 * environment_kernel.h - the sums over an environment's picture, built once per SIMD level (environment_kernel.c). Private to
 * environment.c.
 */
#ifndef PELL_ENVIRONMENT_KERNEL_H
#define PELL_ENVIRONMENT_KERNEL_H

#include "base/simd.h"
#include "lights/lights.h"

#include <string.h>

#define PELL_ENV_BINS 256
#define PELL_ENV_WIDE 8  /* columns that are summed side by side, */
#define PELL_ENV_ROWS 16 /* and kernels */

/* Normals that elements are added to side by side: neighbours go to the same bins, where each waits for the one before. */
#define PELL_ENV_TOGETHER 4

/* A block of the picture: its mean direction, and its flux. */
struct pell_env_element {
    float x, y, z, unused;
    float rgb[4]; /* and 0: four lanes */
};

/* A row of the picture: its colours and the azimuth of its columns, and the solid angle of its texels. */
struct pell_env_row {
    const float *plane[3], *sin_column, *cos_column;
    float solid;
};

/* A lobe about a direction, to be summed along a row of the picture. */
struct pell_env_lobe {
    float azimuth[2]; /* its sine and cosine */
    float a, b;       /* the cosine of the angle between is a + b cos(difference of azimuth) */
    float a2;         /* alpha^2 */
};

struct pell_env_kernels {
    /* Adds the elements to bins over the cosine to each of so many normals, at most PELL_ENV_TOGETHER. Bins hold red, green, blue and a
     * lane that stays 0. */
    void (*deposit)(const struct pell_env_element *elements, size_t count, const struct pell_vec3 *normals, int nodes,
                    float (*bins)[PELL_ENV_BINS][4]);
    /* What `rows` kernels make of the bins, R, G and B of each; that of bin b and row r is at [b * rows + r], and
     * behind the last there is room for PELL_ENV_ROWS. */
    void (*add_bins)(const float *kernels, int rows, const float (*bins)[4], float *node);
    /* Adds columns [from, to) of a row, weighted: red, green, blue, weight. */
    void (*add_row)(const struct pell_env_row *row, int from, int to, const struct pell_env_lobe *lobe, float sums[4][PELL_ENV_WIDE]);
};

PELL_SIMD_TABLES(struct pell_env_kernels, pell_env_kernels);

/* Adds light at a cosine to the two bins that it is between. */
static inline void pell_env_deposit(float (*bins)[4], float mu, const float rgb[4], float sign)
{
    const float x = mu < 1.0f ? mu * (PELL_ENV_BINS - 1) : PELL_ENV_BINS - 1;
    const int i0 = (int) x, i = i0 < PELL_ENV_BINS - 2 ? i0 : PELL_ENV_BINS - 2;
    const float f = sign * (x - (float) i), g = sign - f;
    float *at = bins[i], both[8];

    /* beside each other before any is stored, so that they are added at a time */
    for (int c = 0; c < 4; c++)
        both[c] = at[c] + g * rgb[c];
    for (int c = 0; c < 4; c++)
        both[4 + c] = at[4 + c] + f * rgb[c];
    memcpy(at, both, sizeof(both));
}

#endif
