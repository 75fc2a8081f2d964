/* SPDX-License-Identifier: MIT
 *
 * kernels.h - the inner loops of the texture-space method: blurs of planes of texels.
 *
 * A plane pointer points at texel (0, 0); left and right of each row are TS_MARGIN texels whose length is 0. Blocks begin at multiples of
 * TS_BLOCK texels. Where a texel is of no chart its length is 0 and its planes hold finite values.
 */
#ifndef PELL_TEXTURE_SPACE_KERNELS_H
#define PELL_TEXTURE_SPACE_KERNELS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

enum { TS_BLOCK = 16, TS_MARGIN = 16, TS_PLANES = 6, TS_FAR = 255 };

/* What is known of a block of texels in a row: lengths of those of charts. */
struct ts_cell {
    float least[2], most[2]; /* mm per texel along x, and at right angles to that */
    float skew;              /* the line at right angles to x goes this many texels back along x as y grows by one */
    int near;                /* texels, along the longer axis, from the nearest of them to one inside a chart; none is of a chart: TS_FAR */
};

/* A place about a texel, mm along x and at right angles to that, and what its light counts. */
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
    const float *from[TS_PLANES]; /* what is blurred */
    float *to[TS_PLANES];
    int planes;          /* 3 or 4; with the paper's taps two more, the stretch */
    const uint8_t *need; /* per block of a row: the stage that it is needed up to; NULL: all are */
    uint8_t stage;       /* blocks that are not needed at this one are left out */
    int near;            /* blocks that are further from charts than this are left out */
    float before, after; /* mm^2 of the chain before and after this blur */
    float grid;          /* texels^2 that reading the map adds by itself */
    float *sum[3];       /* of the second pass: add the result, weighted; NULL: don't */
    float weight[3];
};

struct ts_kernels {
    /* Blur blocks [from, to) of row y along x, or along y. */
    void (*across)(const struct ts_work *w, int y, int from, int to);
    void (*down)(const struct ts_work *w, int y, int from, int to);
    /* Adds what `count` taps about each texel of blocks [from, to) of row y bring to the sum: as much as all of them weigh, however many
     * lie on the chart. Along x and y, whose step goes `skew` texels along x, too. */
    void (*scatter)(const struct ts_work *w, const float *skew, const struct ts_tap *taps, int count, int y, int from, int to);
    /* How many texels of this length taps reach. Longer ones are reached less far. */
    float (*reach)(const struct ts_work *w, float length);
};

#endif
