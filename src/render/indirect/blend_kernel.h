/* SPDX-License-Identifier: MIT
 *
 * blend_kernel.h - private to the folder: interpolation of 16 points from three knots each; blend_kernel.c is compiled once per SIMD level.
 *
 */
#ifndef RENDER_INDIRECT_BLEND_KERNEL_H
#define RENDER_INDIRECT_BLEND_KERNEL_H

#include "base/simd.h"

/* Three rows of values per point, and their weights. */
struct indirect_rows {
    const float *row[3][16];
    _Alignas(64) float weight[3][16];
};

struct indirect_blend_kernels {
    /* out[k]: value k of each point; `size`, a multiple of 4: number of values. */
    void (*blend)(const struct indirect_rows *rows, int size, float (*out)[16]);
};

PELL_SIMD_TABLES(struct indirect_blend_kernels, indirect_blend_kernels);

#endif
