/* SPDX-License-Identifier: MIT
 * kernel.h - the taps of the stage "highlights"; kernel.c is compiled once per SIMD level. */
#ifndef PELL_RENDER_HIGHLIGHTS_KERNEL_H
#define PELL_RENDER_HIGHLIGHTS_KERNEL_H

#include "base/simd.h"

#include <stddef.h>
#include <stdint.h>

enum {
    PELL_HIGHLIGHTS_BLOCK = 64, /* pixels of a row per block */
    PELL_HIGHLIGHTS_SUMS = 6,   /* highlights and irradiance, for R, G and B */
    PELL_HIGHLIGHTS_TAPS = 7    /* of a row */
};

/* A tap: the pixel at an offset in memory, for pixels from `first` to `end`. */
struct pell_highlights_tap {
    ptrdiff_t offset;
    float weight, next; /* next: its weight among the nine nearest pixels; 0: not one of them */
    int first, end;
};

struct pell_highlights_block {
    const uint16_t *material;
    const float *depth, *normal[3];                                          /* at the block's first pixel, */
    const float *light[PELL_HIGHLIGHTS_SUMS], *hidden[PELL_HIGHLIGHTS_SUMS]; /* likewise: the light, and what shadows removed */
    float slope;              /* depth difference, in pixel widths, beyond which surfaces are different */
    float depth_mm, fixed_mm; /* a pixel at depth d is d depth_mm + fixed_mm wide */
    float rays;               /* per pixel and light */
    /* sums with and without shadows: over all taps, and over the nine nearest pixels */
    _Alignas(64) float seen[PELL_HIGHLIGHTS_SUMS][PELL_HIGHLIGHTS_BLOCK], all[PELL_HIGHLIGHTS_SUMS][PELL_HIGHLIGHTS_BLOCK];
    float next[PELL_HIGHLIGHTS_SUMS][PELL_HIGHLIGHTS_BLOCK], next_all[PELL_HIGHLIGHTS_SUMS][PELL_HIGHLIGHTS_BLOCK];
};

struct pell_highlights_kernels {
    /* Adds the taps of a row, at most PELL_HIGHLIGHTS_TAPS, to the pixels. */
    void (*add)(struct pell_highlights_block *block, const struct pell_highlights_tap *taps, int count);
    /* Writes light + hidden, times the visible fraction; `light` where nothing is hidden around a pixel, or where it emits. */
    void (*end)(const struct pell_highlights_block *block, float *const out[PELL_HIGHLIGHTS_SUMS], int count);
};

PELL_SIMD_TABLES(struct pell_highlights_kernels, pell_highlights_kernels);

#endif
