/* SPDX-License-Identifier: MIT
 *
 * kernels.h - the inner loops of the convolution method: planes in one column of frequencies are mixed in place.
 */
#ifndef PELL_CONVOLUTION_KERNELS_H
#define PELL_CONVOLUTION_KERNELS_H

#include <stddef.h>

enum { CONV_PLANES = 16, CONV_IMAGES = 3 * CONV_PLANES - 1 };

/* The spectrum of a kernel, real and even, in blocks of 16 columns: frequency (16 b + lane, y) at [b * block + 16 y + lane], y <= half of
 * the height. A spectrum that ends earlier, in `blocks` and `rows`, is 0 from there. */
struct conv_spectrum {
    const float *data;
    ptrdiff_t block;
    int blocks, rows;
};

/* What a plane sends to another: itself in units of the other's pixels. NULL spectrum: nothing. */
struct conv_pair {
    int from, to; /* from < to; both ways */
    const struct conv_spectrum *spectrum;
    float factor;
};

struct conv_mix {
    int height;                                    /* frequencies in a column */
    int planes, between, behind;                   /* images: planes, those between planes, then light from behind on planes */
    const struct conv_spectrum *own[CONV_PLANES];  /* of planes */
    const struct conv_spectrum *next[CONV_PLANES]; /* of plane i to i + 1, or NULL */
    float next_factor[CONV_PLANES];
    const struct conv_spectrum *behind_own[CONV_PLANES]; /* of light from behind on its own plane, or NULL */
    const struct conv_pair *pairs;
    int num_pairs;
    float *column[CONV_IMAGES]; /* elements of struct pell_fft; NULL: an image without light whose result is not asked for */
};

struct conv_kernels {
    void (*mix)(const struct conv_mix *m, int block);
};

#endif
