/* SPDX-License-Identifier: MIT
 *
 * kernels.h - the inner loops of the texture-space method: blurs of planes of texels.
 *
 * A plane pointer points at texel (0, 0); left and right of each row are TS_MARGIN texels whose length is 0. Blocks begin at multiples of
 * TS_BLOCK texels. Where a texel is of no chart its length is 0 and its planes hold finite values.
 */
#ifndef PELL_TEXTURE_SPACE_KERNELS_H
#define PELL_TEXTURE_SPACE_KERNELS_H

#include <stddef.h>
#include <stdint.h>
#include <stdbool.h>

enum { TS_BLOCK = 16, TS_MARGIN = 16, TS_PLANES = 6 };

/* What is known of a block of texels in a row: lengths of those of charts. */
struct ts_cell {
    float least[2], most[2]; /* mm per texel along x, and at right angles to that */
    float lean;              /* the line at right angles to x goes this many texels back along x as y grows by one */
};

struct ts_work {
    int width, height, blocks;
    ptrdiff_t stride;
    const float *key;
    const float *length[2];
    const struct ts_cell *cells;
    const float *from[TS_PLANES]; /* what is blurred */
    float *to[TS_PLANES];
    int planes;                   /* 3 or 4; with the paper's taps two more, the stretch */
    float before, after;          /* mm^2 of the chain before and after this blur */
    float grid;                   /* texels^2 that reading the map adds by itself */
    float *sum[3];                /* of the second pass: add the result, weighted; NULL: don't */
    float weight[3];
};

struct ts_kernels {
    /* Blur blocks [from, to) of row y along x, or along y. */
    void (*across)(const struct ts_work *w, int y, int from, int to);
    void (*down)(const struct ts_work *w, int y, int from, int to);
};

#endif
