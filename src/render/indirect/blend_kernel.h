/* SPDX-License-Identifier: MIT
 *
 * blend_kernel.h - private to the folder: what 16 points read at three knots each, built once per SIMD level (blend_kernel.c).
 */
#ifndef RENDER_INDIRECT_BLEND_KERNEL_H
#define RENDER_INDIRECT_BLEND_KERNEL_H

#include "base/simd.h"

/* Of each point three rows of numbers, and their weights. */
struct indirect_rows {
    const float *row[3][16];
    _Alignas(64) float weight[3][16];
};

struct indirect_blend_kernels {
    /* out[k]: number k of each point; `size`, a multiple of 4: how many. */
    void (*blend)(const struct indirect_rows *rows, int size, float (*out)[16]);
};

PELL_SIMD_TABLES(struct indirect_blend_kernels, indirect_blend_kernels);

#endif
