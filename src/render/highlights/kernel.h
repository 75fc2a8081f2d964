/* SPDX-License-Identifier: MIT
 * kernel.h - the taps of the stage "highlights": kernel.c is compiled once per SIMD level. */
#ifndef PELL_RENDER_HIGHLIGHTS_KERNEL_H
#define PELL_RENDER_HIGHLIGHTS_KERNEL_H

#include "base/simd.h"

#include <stddef.h>
#include <stdint.h>

enum {
    PELL_HIGHLIGHTS_BLOCK = 64, /* pixels of a row at a time */
    PELL_HIGHLIGHTS_SUMS = 6,   /* what is mirrored and what enters, of R, G and B */
    PELL_HIGHLIGHTS_TAPS = 7    /* of a row */
};

/* The pixel at an offset in memory from each from `first` to `end`. */
struct pell_highlights_tap {
    ptrdiff_t offset;
    float weight, next; /* next: its weight among the nine pixels next to them; 0: it is none of them */
    int first, end;
};

struct pell_highlights_block {
    const uint16_t *material;
    const float *depth, *normal[3];                                          /* of the block's first pixel, */
    const float *light[PELL_HIGHLIGHTS_SUMS], *hidden[PELL_HIGHLIGHTS_SUMS]; /* as the rest: what is there, and what shadows took of it */
    float slope;              /* depths further apart than this are of other surfaces, widths of a pixel */
    float depth_mm, fixed_mm; /* a pixel at depth d is d depth_mm + fixed_mm wide */
    float rays;               /* of a pixel, for each light */
    _Alignas(64) float seen[PELL_HIGHLIGHTS_SUMS][PELL_HIGHLIGHTS_BLOCK], all[PELL_HIGHLIGHTS_SUMS][PELL_HIGHLIGHTS_BLOCK]; /* over taps, */
    float next[PELL_HIGHLIGHTS_SUMS][PELL_HIGHLIGHTS_BLOCK], next_all[PELL_HIGHLIGHTS_SUMS][PELL_HIGHLIGHTS_BLOCK]; /* the nine next */
};

struct pell_highlights_kernels {
    /* Adds the taps of a row, at most PELL_HIGHLIGHTS_TAPS, to the pixels. */
    void (*add)(struct pell_highlights_block *block, const struct pell_highlights_tap *taps, int count);
    /* light + hidden, times the share that is seen; `light` where nothing is hidden around a pixel, or where it emits. */
    void (*end)(const struct pell_highlights_block *block, float *const out[PELL_HIGHLIGHTS_SUMS], int count);
};

PELL_SIMD_TABLES(struct pell_highlights_kernels, pell_highlights_kernels);

#endif
