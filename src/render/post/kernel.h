/* SPDX-License-Identifier: MIT
 *
 * kernel.h - what post does to pixels that lie side by side in a row, built once per SIMD level (row.c); only post.c includes it.
 */
#ifndef PELL_POST_ROW_H
#define PELL_POST_ROW_H

#include "base/simd.h"

#include <stdbool.h>
#include <stdint.h>

/* Statistics of a row: pixels that are more than half covered and not black. */
struct pell_post_measure {
    double sum_log; /* of their luminances */
    double count, maximum, invalid;
};

struct pell_post_tone {
    float exposure, straight; /* colours are divided by alphas over this */
    float curve, white_scale;
    bool filmic;                   /* in their place */
    bool lay;                      /* colours are composited over `background` */
    float background[3], shown[3]; /* and its displayed colour where nothing else is visible */
};

struct pell_post_kernels {
    /* Replaces NaN, and rounds alphas that are 1 except for rounding. */
    void (*measure)(int count, float *const color[3], float *alpha, struct pell_post_measure *out);
    void (*finish)(const struct pell_post_tone *tone, int count, float *const color[3], const float *alpha, float *const display[3]);
    /* Uncovered pixels. */
    void (*empty)(const struct pell_post_tone *tone, int count, float *const color[3], float *alpha, float *const display[3]);
    /* Means of pixels and their two neighbours, which have the weight `aside` each. `out` aliases none of the others. */
    void (*blend)(int count, float aside, const float *before, const float *here, const float *after, float *out);
};

PELL_SIMD_TABLES(struct pell_post_kernels, pell_post_kernels);

#endif
