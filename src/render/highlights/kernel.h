/* SPDX-License-Identifier: MIT
 * kernel.h - the taps of the stage "highlights": kernel.c is compiled once per SIMD level. */
#ifndef PELL_RENDER_HIGHLIGHTS_KERNEL_H
#define PELL_RENDER_HIGHLIGHTS_KERNEL_H

#include "base/simd.h"

#include <stddef.h>
#include <stdint.h>

enum { PELL_HIGHLIGHTS_BLOCK = 64 }; /* pixels of a row at a time */

struct pell_highlights_block {
    const uint16_t *material;
    const float *depth, *normal[3], *specular[3], *hidden[3]; /* of the block's first pixel */
    float slope;                                              /* depths further apart than this are of other surfaces, widths of a
                                                                  * pixel */
    float depth_mm, fixed_mm;                                 /* a pixel at depth d is d depth_mm + fixed_mm wide */
    _Alignas(64) float seen[3][PELL_HIGHLIGHTS_BLOCK], all[3][PELL_HIGHLIGHTS_BLOCK]; /* sums over taps */
};

struct pell_highlights_kernels {
    /* Adds a tap of a weight to the pixels from `first` to `end`: that at `offset` of theirs in memory. */
    void (*add)(struct pell_highlights_block *block, ptrdiff_t offset, float weight, int first, int end);
    /* specular + hidden, times seen / all; `specular` where nothing is hidden around a pixel, or where it emits. */
    void (*end)(const struct pell_highlights_block *block, float *const out[3], int count);
};

PELL_SIMD_TABLES(struct pell_highlights_kernels, pell_highlights_kernels);

#endif
