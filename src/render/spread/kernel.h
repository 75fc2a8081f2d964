/* SPDX-License-Identifier: MIT
 * kernel.h - the taps of the stage "spread"; kernel.c is compiled once per SIMD level. */
#ifndef PELL_RENDER_SPREAD_KERNEL_H
#define PELL_RENDER_SPREAD_KERNEL_H

#include "base/simd.h"

#include <stddef.h>
#include <stdint.h>

enum { PELL_SPREAD_BLOCK = 64 }; /* pixels of a row per block */

struct pell_spread_block {
    const uint16_t *key;
    const float *depth, *from[3];             /* at the block's first pixel */
    float inverse;                            /* 1/reach^2, 1/mm^2 */
    _Alignas(64) float mm[PELL_SPREAD_BLOCK]; /* width of a pixel */
    _Alignas(64) float light[3][PELL_SPREAD_BLOCK], weight[PELL_SPREAD_BLOCK];
};

struct pell_spread_kernels {
    /* Adds a tap to the pixels from `first` to `end`: the pixels at `offset` in memory, `distance` pixels away in the image. */
    void (*add)(struct pell_spread_block *block, ptrdiff_t offset, float distance, int first, int end);
};

PELL_SIMD_TABLES(struct pell_spread_kernels, pell_spread_kernels);

#endif
