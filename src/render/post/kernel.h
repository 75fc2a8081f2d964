/* SPDX-License-Identifier: MIT
 *
 * kernel.h - metering and tone mapping of a row of pixels; kernel.c is compiled once per SIMD level.
 */
#ifndef PELL_POST_KERNEL_H
#define PELL_POST_KERNEL_H

#include "base/simd.h"

#include <stdbool.h>
#include <stdint.h>

/* Statistics of a row: pixels that are more than half covered and not black. */
struct pell_post_measure {
    double sum_log; /* of their luminances */
    double count, maximum, invalid;
};

struct pell_post_tone {
    float exposure, min_alpha;     /* colours are divided by alphas above min_alpha */
    float curve, white_scale;      /* see PELL_TONE_SCALE */
    bool filmic;                   /* the filmic curve instead */
    bool composites;               /* colours are composited over `background` */
    float background[3], shown[3]; /* and its displayed colour where nothing else is visible */
};

struct pell_post_kernels {
    /* Replaces colours that are not finite by 0, and sets alphas that are 1 except for rounding to 1. */
    void (*measure)(int count, float *const color[3], float *alpha, struct pell_post_measure *out);
    void (*finish)(const struct pell_post_tone *tone, int count, float *const color[3], const float *alpha, float *const display[3]);
    /* Fills uncovered pixels. */
    void (*empty)(const struct pell_post_tone *tone, int count, float *const color[3], float *alpha, float *const display[3]);
    /* Means of pixels and their two neighbours, which have the weight `aside` each. `out` aliases none of the others. */
    void (*blend)(int count, float aside, const float *before, const float *here, const float *after, float *out);
};

PELL_SIMD_TABLES(struct pell_post_kernels, pell_post_kernels);

#endif
