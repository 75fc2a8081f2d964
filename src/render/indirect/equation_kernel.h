/* SPDX-License-Identifier: MIT
 *
 * equation_kernel.h - matrix entries of one row of the boundary integral equation of diffusion.c, and the product of a row with a vector;
 * compiled once per SIMD level.
 */
#ifndef INDIRECT_EQUATION_KERNEL_H
#define INDIRECT_EQUATION_KERNEL_H

#include "base/simd.h"

#include <stdint.h>

enum { EQUATION_BLOCK = 64 };

/* Surface elements through which light enters and leaves: the collocation points, followed by the clusters. */
struct equation_patches {
    float *x, *y, *z, *nx, *ny, *nz;
    float *area;
    float *wx, *wy, *wz; /* mean direction of light after it enters, not unit */
};

/* The collocation point of a row. */
struct equation_receiver {
    float x, y, z, nx, ny, nz;
    float min_distance2; /* least squared distance used for other elements, mm^2, */
    float spread;        /* and its least ratio to their area */
};

/* Parameters of a channel, see diffusion.c. `curvature_factor`: per element, s of a plane over s of the curved surface. */
struct equation_kernel_params {
    float kappa, inverse_s;
    const float *curvature_factor;
    const float *source_depth[2]; /* mm from elements along their light's direction: two depths that represent the sources, */
    float weight[2];              /* and the fraction of the light at each; */
    float min_distance2[2];       /* least squared distance of these sources, mm^2 */
};

/* Geometry of a block of elements, shared by all channels, then integrals of one channel. */
struct equation_block {
    float distance2[EQUATION_BLOCK]; /* squared distance, mm^2, */
    float r2[EQUATION_BLOCK];        /* and the same, clamped from below */
    float r[EQUATION_BLOCK], inverse_r[EQUATION_BLOCK];
    float facing[EQUATION_BLOCK];           /* cosine between the normals */
    float offset_normal[EQUATION_BLOCK];    /* offset to the element along its normal, mm, */
    float offset_direction[EQUATION_BLOCK]; /* offset along its light's mean direction, */
    float direction2[EQUATION_BLOCK];       /* and the squared length of that direction */
    float double_layer0[EQUATION_BLOCK];    /* integral of dG/dn without absorption (double layer, kappa = 0) */
    float source[EQUATION_BLOCK];           /* area/(4 pi) */
    float single_layer[EQUATION_BLOCK];     /* integral of G (single layer), */
    float from_sources[EQUATION_BLOCK];     /* and of G from the sources below the element */
};

struct equation_kernels {
    void (*measure)(const struct equation_patches *patches, uint32_t first, uint32_t count, const struct equation_receiver *receiver,
                    struct equation_block *out);
    /* Writes the factors of phi to `matrix`. */
    void (*fill)(const struct equation_kernel_params *params, uint32_t first, uint32_t count, struct equation_block *b, float *matrix);
    double (*product)(const float *matrix, const double *values, uint32_t count);
};

PELL_SIMD_TABLES(struct equation_kernels, equation_kernels);

#endif
