/* SPDX-License-Identifier: MIT
 *
 * kernels.h - the inner loops of the texture-space method: blurs of planes of texels.
 *
 * A plane pointer points at texel (0, 0); each row has TS_MARGIN texels of length 0 on its left and right. Blocks begin at multiples of
 * TS_BLOCK texels. A texel outside of charts has length 0 and finite values in all planes.
 */
#ifndef PELL_TEXTURE_SPACE_KERNELS_H
#define PELL_TEXTURE_SPACE_KERNELS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

enum { TS_BLOCK = 16, TS_MARGIN = 16, TS_PLANES = 7, TS_FAR = 255 };
/* Planes of a chain with transmission: R, G, B of a light and alpha; behind them R, G, B of light that is only blurred (TS_PLANES). */
enum { TS_ALPHA = 3, TS_LOCAL = 4 };

/* Bounds of a block of texels in a row, over those in charts. */
struct ts_cell {
    float least[2], most[2]; /* mm per texel along x, and perpendicular to it */
    float skew;              /* the line perpendicular to x moves this many texels back along x per texel along y */
    int near;                /* texels, along the longer axis, from the block to the inside of a chart; TS_FAR: none is in a chart */
};

/* A tap near a texel: its offset in mm along x and perpendicular to it, and its weight. */
struct ts_tap {
    float x, y, weight[3];
};

struct ts_work {
    int width, height, blocks;
    ptrdiff_t stride;
    const float *key;
    const float *length[2];
    const float *tilt[2];
    bool tilts;
    const struct ts_cell *cells;
    const float *from[TS_PLANES]; /* input of the blur */
    float *to[TS_PLANES];
    int planes;          /* 3, 4 or TS_PLANES; with the paper's taps 6 */
    bool seven;          /* the paper's taps; the last two planes are the stretch */
    const uint8_t *need; /* per block of a row: last stage that needs it; NULL: all are needed */
    uint8_t stage;       /* blocks not needed at this stage are left out */
    int near;            /* blocks farther from charts are left out */
    float before, after; /* mm^2: variance of the chain before and after this blur */
    float read_variance; /* texels^2 that reading the map adds */
    float *sum[3];       /* second pass: adds the weighted result; NULL: does not */
    float weight[3];
};

struct ts_kernels {
    /* Blurs blocks [from, to) of row y along x, or along y. */
    void (*across)(const struct ts_work *w, int y, int from, int to);
    void (*down)(const struct ts_work *w, int y, int from, int to);
    /* Adds `count` taps around each texel of blocks [from, to) of row y to the sum, normalised by the weight of the taps on the chart.
     * Offsets are along x and y; a step along y also moves `skew` texels along x. */
    void (*scatter)(const struct ts_work *w, const float *skew, const struct ts_tap *taps, int count, int y, int from, int to);
    /* Reach of taps in texels of this length. Longer texels are reached less far. */
    float (*reach)(const struct ts_work *w, float length);
};

#endif
