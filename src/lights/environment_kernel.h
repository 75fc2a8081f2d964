/* SPDX-License-Identifier: MIT
 *
 * environment_kernel.h - the sums over an environment's image, built once per SIMD level (environment_kernel.c). Private to
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

/* Normals processed together: neighbouring ones update the same bins, and interleaving hides the store-to-load latency. */
#define PELL_ENV_TOGETHER 4

/* A block of the image: its mean direction, and its flux. */
struct pell_env_element {
    float x, y, z, unused;
    float rgb[4]; /* padded with 0 to four lanes */
};

/* A row of the image: its colours, the azimuth of its columns, and the solid angle of its texels. */
struct pell_env_row {
    const float *plane[3], *sin_column, *cos_column;
    float solid_angle;
};

/* A lobe around a direction, to be integrated along a row of the image. */
struct pell_env_lobe {
    float azimuth[2]; /* its sine and cosine */
    float a, b;       /* the cosine of the angle to the lobe's axis is a + b cos(difference of azimuth) */
    float a2;         /* alpha^2 */
};

struct pell_env_kernels {
    /* Adds the elements to histograms over the cosine to each normal, at most PELL_ENV_TOGETHER normals. Bins hold red, green, blue and an
     * unused lane of 0. */
    void (*deposit)(const struct pell_env_element *elements, size_t count, const struct pell_vec3 *normals, int nodes,
                    float (*bins)[PELL_ENV_BINS][4]);
    /* Applies `rows` kernels to the bins: R, G and B of each. The value of bin b and row r is at [b * rows + r], followed by padding of
     * PELL_ENV_ROWS. */
    void (*add_bins)(const float *kernels, int rows, const float (*bins)[4], float *node);
    /* Adds columns [from, to) of a row, weighted: red, green, blue, weight. */
    void (*add_row)(const struct pell_env_row *row, int from, int to, const struct pell_env_lobe *lobe, float sums[4][PELL_ENV_WIDE]);
};

PELL_SIMD_TABLES(struct pell_env_kernels, pell_env_kernels);

/* Adds light at a cosine to the two nearest bins. */
static inline void pell_env_deposit(float (*bins)[4], float mu, const float rgb[4], float sign)
{
    const float x = mu < 1.0f ? mu * (PELL_ENV_BINS - 1) : PELL_ENV_BINS - 1;
    const int i0 = (int) x, i = i0 < PELL_ENV_BINS - 2 ? i0 : PELL_ENV_BINS - 2;
    const float f = sign * (x - (float) i), g = sign - f;
    float *at = bins[i], both[8];

    /* computed before any store, so that the additions are vectorised */
    for (int c = 0; c < 4; c++)
        both[c] = at[c] + g * rgb[c];
    for (int c = 0; c < 4; c++)
        both[4 + c] = at[4 + c] + f * rgb[c];
    memcpy(at, both, sizeof(both));
}

#endif
