/* SPDX-License-Identifier: MIT
 * compare_test.h - shared by the tests of the comparison: pairs of images in memory, and their comparison. */
#ifndef PELL_COMPARE_TEST_H
#define PELL_COMPARE_TEST_H

#include "pell_test.h"

#include <pellucid/compare.h>

enum { TEST, REFERENCE, HALF, PICTURES };

struct pair {
    struct pell_alloc_fault fault;
    struct kept_messages kept;
    struct pell_context *ctx;
    int width, height;
    float *plane[PICTURES][3], *mask;
    struct pell_compare_input in;
    struct pell_compare_params params;
    struct pell_comparison out;
};

static inline uint32_t hash(uint32_t a)
{
    a ^= a >> 16;
    a *= 0x7feb352du;
    a ^= a >> 15;
    a *= 0x846ca68bu;
    return a ^ a >> 16;
}

/* In [0, 1). */
static inline double noise(int x, int y, int c, int seed)
{
    return (double) (hash((uint32_t) x + 7919u * (uint32_t) y + 104729u * (uint32_t) c + 1299709u * (uint32_t) seed) >> 8) / 16777216.0;
}

/* Black images without halves and mask. */
static inline void pair_begin(struct pair *p, int width, int height)
{
    memset(p, 0, sizeof(*p));
    p->ctx = test_context(&p->fault, &p->kept);
    REQUIRE(p->ctx);
    p->width = width;
    p->height = height;
    for (int i = 0; i < PICTURES; i++)
        for (int c = 0; c < 3; c++)
            REQUIRE(p->plane[i][c] = calloc((size_t) width * (size_t) height, sizeof(float)));
    REQUIRE(p->mask = calloc((size_t) width * (size_t) height, sizeof(float)));
    p->in = (struct pell_compare_input) { .width = width, .height = height, .stride = width };
    for (int c = 0; c < 3; c++) {
        p->in.test[c] = p->plane[TEST][c];
        p->in.reference[c] = p->plane[REFERENCE][c];
    }
    pell_knobs_default(pell_compare_knobs(), &p->params);
    p->params.threads = 1;
}

static inline void pair_fill(struct pair *p, int picture, double r, double g, double b)
{
    const double rgb[3] = { r, g, b };
    for (int c = 0; c < 3; c++)
        for (int i = 0; i < p->width * p->height; i++)
            p->plane[picture][c][i] = (float) rgb[c];
}

static inline const struct pell_comparison *pair_compare(struct pair *p)
{
    pell_comparison_finish(p->ctx, &p->out);
    if (pell_compare(p->ctx, &p->in, &p->params, &p->out) != PELL_OK)
        fail_msg("%s: %s", p->kept.where, p->kept.what);
    return &p->out;
}

static inline void pair_end(struct pair *p)
{
    pell_comparison_finish(p->ctx, &p->out);
    pell_context_destroy(&p->ctx);
    assert_int_equal(p->fault.live, 0);
    for (int i = 0; i < PICTURES; i++)
        for (int c = 0; c < 3; c++)
            free(p->plane[i][c]);
    free(p->mask);
}

#endif
