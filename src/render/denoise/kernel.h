/* SPDX-License-Identifier: MIT
 * kernel.h - the inner loops over a tile; only cpu.c includes it. kernel.c is compiled once per SIMD level. */
#ifndef PELL_DENOISE_KERNEL_H
#define PELL_DENOISE_KERNEL_H

#include "base/simd.h"

#define TILE 32
#define WINDOW 8                       /* pixels to either side that are read */
#define PATCH 3                        /* pixels to either side that are compared */
#define RING 2                         /* pixels to either side that outliers depend on */
#define BORDER (WINDOW + PATCH + RING) /* of a tile */
#define WIDE (TILE + 2 * BORDER)       /* a tile and its border */
#define CLOSE 0.7f                     /* k of the paper: standard deviations of a difference of patches */

/* Features of a pixel, each divided by the difference that halves a weight; depth, as its logarithm, may differ by more where it is
 * steep. */
enum { NORMAL, ALBEDO = 3, DEPTH = 6, FEATURES };

struct pell_denoise_tile {
    float light[3][WIDE][WIDE], variance[3][WIDE][WIDE]; /* scattered light of the translucent part of a pixel, as if it filled the pixel */
    float translucent[WIDE][WIDE];                       /* translucent fraction of the pixel */
    float feature[FEATURES][WIDE][WIDE];
    float steep[WIDE][WIDE];     /* change of DEPTH from a pixel to the next */
    float valid[WIDE][WIDE];     /* 1 where the pixel is in the image and its fraction is not 0, so that it has noise, else 0 */
    float total[WIDE][WIDE];     /* W, for the second pass */
    float excess[3][WIDE][WIDE]; /* excess over the light expected from the neighbourhood */
    float gained[3][TILE][TILE]; /* excess light received from others and given to them, of the whole pixel */
    float moved[3][TILE][TILE], sum[TILE][TILE];
};

struct pell_denoise_kernels {
    /* For the tile's own pixels: sum = W. */
    void (*weigh)(struct pell_denoise_tile *tile);
    /* moved = p' - p, of the whole pixel. */
    void (*move)(struct pell_denoise_tile *tile);
};

PELL_SIMD_TABLES(struct pell_denoise_kernels, pell_denoise_kernels);

#endif
