/* SPDX-License-Identifier: MIT
 *
 * equation_kernel.h - entries of a row of the equation in solid.c, and a row's product with a vector; built once per SIMD level.
 */
#ifndef INDIRECT_EQUATION_KERNEL_H
#define INDIRECT_EQUATION_KERNEL_H

#include "base/simd.h"

#include <stdint.h>

enum { EQUATION_BLOCK = 64 };

/* What light leaves from or enters through: places, and behind them clusters. */
struct equation_patches {
    float *x, *y, *z, *nx, *ny, *nz;
    float *area;
    float *wx, *wy, *wz; /* mean direction in which light that enters goes on, not unit */
};

/* What a row is of. */
struct equation_from {
    float x, y, z, nx, ny, nz;
    float least2; /* squared distance that others are away at least, */
    float spread; /* and of their area */
};

/* A channel's law, see solid.c. `bend`: of patches, s of a plane over that of the curved surface. */
struct equation_law {
    float kappa, inverse_s;
    const float *bend;
    const float *deep[2]; /* mm from patches along their ways: two places at which that light is taken to start, */
    float share[2];       /* and how much of it each is; */
    float least2[2];      /* squared distance that they count as away at least */
};

/* Patches of a row: first the same for all channels, then of one. */
struct equation_block {
    float apart2[EQUATION_BLOCK]; /* squared distance, */
    float r2[EQUATION_BLOCK];     /* and as it counts */
    float r[EQUATION_BLOCK], inverse_r[EQUATION_BLOCK];
    float facing[EQUATION_BLOCK]; /* cosine of the normals */
    float along[EQUATION_BLOCK];  /* the way to the patch along its normal, */
    float toward[EQUATION_BLOCK]; /* and along that of its light, */
    float way2[EQUATION_BLOCK];   /* whose square that is */
    float even[EQUATION_BLOCK];   /* the integral of dG/dn where nothing is absorbed */
    float source[EQUATION_BLOCK]; /* area/4 pi */
    float pull[EQUATION_BLOCK];   /* the integral of G, */
    float below[EQUATION_BLOCK];  /* and of G from the light's sources */
};

struct equation_kernels {
    void (*measure)(const struct equation_patches *patches, uint32_t first, uint32_t count, const struct equation_from *from,
                    struct equation_block *out);
    /* left: phi's factors */
    void (*entries)(const struct equation_law *law, uint32_t first, uint32_t count, struct equation_block *b, float *left);
    double (*product)(const float *left, const double *values, uint32_t count);
};

PELL_SIMD_TABLES(struct equation_kernels, equation_kernels);

#endif
