/* SPDX-License-Identifier: MIT
 *
 * blocks.h - shared by the kernel files of the screen-space method: a block of 16 pixels in a row, the mask of pixels that a step blurs,
 * and the stages of its processing. Included by kernel files only, which are compiled once per level of base/simd.h.
 *
 * Vectors are the compiler's generic ones, as wide as the machine's registers. All SIMD levels give the same bits: the operations on a
 * pixel and their order do not depend on the width.
 */
#ifndef PELL_SCREEN_SPACE_BLOCKS_H
#define PELL_SCREEN_SPACE_BLOCKS_H

#include "methods/screen_space/formulas.h"
#include "methods/screen_space/kernels.h"

#include "base/simd.h"
#include "math/lanes.h"

#include <math.h>
#include <string.h>

INLINE int fewer(int a, int b)
{
    return a < b ? a : b;
}

INLINE struct screen_cell *cell_at(const struct screen_work *w, int block, int y)
{
    return &w->cells[(size_t) y * (size_t) w->blocks + (size_t) block];
}

/* Index of a pixel's angle: interleaved gradient noise (Jimenez 2014), rotated by `by` from sample to sample. */
INLINE int pell_ss_turn(int x, int y, int by)
{
    const float along = 0.06711056f * (float) x + 0.00583715f * (float) y, folded = 52.9829189f * (along - floorf(along));

    return ((int) ((folded - floorf(folded)) * SCREEN_TURNS) + by) & (SCREEN_TURNS - 1);
}

/* Position of a tap of such a line within its interval, [0, 1]. */
INLINE float pell_ss_jitter(int turn)
{
    return ((float) ((turn * 37 + 11) & (SCREEN_TURNS - 1)) + 0.5f) * (1.0f / SCREEN_TURNS);
}

/* Vectors for reductions of a block's lanes, by halves. */
typedef float v8 __attribute__((vector_size(32)));
typedef float v4 __attribute__((vector_size(16)));
typedef int32_t i8 __attribute__((vector_size(32)));
typedef int32_t i4 __attribute__((vector_size(16)));

INLINE float max_of(const float *v)
{
    v8 a, b;
    v4 c, d;
    i8 more;
    i4 more4;

    memcpy(&a, v, sizeof(a));
    memcpy(&b, v + 8, sizeof(b));
    more = a > b;
    a = (v8) (((i8) a & more) | ((i8) b & ~more));
    memcpy(&c, &a, sizeof(c));
    memcpy(&d, (const char *) &a + sizeof(c), sizeof(d));
    more4 = c > d;
    c = (v4) (((i4) c & more4) | ((i4) d & ~more4));
    c[0] = c[0] > c[2] ? c[0] : c[2];
    c[1] = c[1] > c[3] ? c[1] : c[3];
    return c[0] > c[1] ? c[0] : c[1];
}

INLINE float sum_of(const float *v)
{
    v8 a, b;
    v4 c, d;

    memcpy(&a, v, sizeof(a));
    memcpy(&b, v + 8, sizeof(b));
    a += b;
    memcpy(&c, &a, sizeof(c));
    memcpy(&d, (const char *) &a + sizeof(c), sizeof(d));
    c += d;
    return (c[0] + c[2]) + (c[1] + c[3]);
}

/* Rows are too short and planes too many for hardware prefetchers: each block prefetches what the one below it will read and write. */
PELL_FETCHING_INLINE void fetch3_to_write(float *const plane[3], size_t at)
{
    for (int i = 0; i < 3; i++)
        pell_fetch_to_write(plane[i] + at);
}

/* --- One step ------------------------------------------------------------------------------------------------------------------ */

/* Inputs of a block's taps. */
struct block {
    bool uniform;                                                   /* all lanes have the same variances */
    bool wide;                                                      /* and they are far above a pixel's area */
    bool bare;                                                      /* and nothing was blurred before */
    float after, before;                                            /* if uniform: mm^2 after and before the step */
    _Alignas(64) float afters[SCREEN_BLOCK], befores[SCREEN_BLOCK]; /* otherwise */
    int num_active;                                                 /* number of lanes that are blurred */
    int count, stride;                                              /* taps per side, and the distance between them in pixels */
    float skew;                                                     /* of the line of taps along y, see struct screen_cell */
};

/* Variance of the chain after `step`, mm^2. */
INLINE float variance_of(const struct screen_work *w, int step, int material)
{
    return w->variance[(size_t) step * (w->num_materials + 1) + (size_t) material];
}

/* Variance before the current step where a material's pixels have this scale; returns whether the step blurs them. */
INLINE bool applied(const struct screen_work *w, int material, float scale, float *before)
{
    float last = 0.0f;

    for (int step = 0; step < w->step; step++) {
        const float v = variance_of(w, step, material);
        last = (v - last) * scale > w->skip ? v : last;
    }
    *before = last;
    return (variance_of(w, w->step, material) - last) * scale > w->skip;
}

/* The lanes that the step blurs, and their variances. False: none. */
INLINE bool choose(const struct screen_work *w, size_t index, const struct screen_cell *cell, struct block *b)
{
    const float *scale = &w->scale[index], *key = &w->key[index];
    bool low, high;
    float before;

    b->uniform = false;
    b->num_active = 0;
    if (cell->material != SCREEN_MIXED) {
        /* Fast path: each step so far blurs the whole block, as in most blocks. */
        if (cell->pixels > 0 && w->min_added[(size_t) w->step * (w->num_materials + 1) + cell->material] * cell->scale[0] > w->skip) {
            b->uniform = true;
            b->before = w->step > 0 ? variance_of(w, w->step - 1, cell->material) : 0.0f;
            b->after = variance_of(w, w->step, cell->material);
            b->num_active = cell->pixels;
            return true;
        }
        /* Each decision is monotonic in the scale: if the extremes agree in all of them, so do the lanes in between. */
        low = applied(w, cell->material, cell->scale[0], &before);
        high = applied(w, cell->material, cell->scale[1], &b->before);
        if (low == high && before == b->before) {
            b->uniform = true;
            b->after = high ? variance_of(w, w->step, cell->material) : 0.0f;
            b->num_active = high ? cell->pixels : 0;
            return high;
        }
    }
    for (int l = 0; l < SCREEN_BLOCK; l++) {
        const bool on = applied(w, (int) key[l], scale[l], &before);
        b->num_active += on;
        b->afters[l] = on ? variance_of(w, w->step, (int) key[l]) : 0.0f;
        b->befores[l] = on ? before : 0.0f;
    }
    return b->num_active > 0;
}

/* --- Stages -------------------------------------------------------------------------------------------------------------------- */

/* A block in the stages of a pass: inputs of its taps, their sums, the result. */
struct job {
    const struct screen_cell *cell;
    int x, low, high; /* the block's first pixel; taps on either side that are inside */
    struct block b;
    _Alignas(64) float kernel_scale[SCREEN_BLOCK], fraction[SCREEN_BLOCK]; /* see struct centre; fraction of a tap's weight in the result */
    _Alignas(64) float weight[SCREEN_BLOCK], light[3][SCREEN_BLOCK];       /* sums over taps */
};

/* Sum a block's taps into job->weight and job->light. `row`: input, at pixel 0. The first three are for perspective images of one
 * material: along x, down columns, down a skewed line. The last one handles all other cases. */
void PELL_SIMD(screen_gather_along_x)(const struct screen_work *w, int y, const float *const row[3], struct job *job);
void PELL_SIMD(screen_gather_along_y)(const struct screen_work *w, int y, const float *const row[3], struct job *job);
void PELL_SIMD(screen_gather_skewed)(const struct screen_work *w, int y, const float *const row[3], struct job *job);
void PELL_SIMD(screen_gather_any)(const struct screen_work *w, int y, int axis, const float *const row[3], struct job *job);
/* The paper's taps: the result, and which lanes were blurred, 1 or 0. Returns their number. Reads only x and cell of the job. */
int PELL_SIMD(screen_gather_listing)(const struct screen_work *w, int y, int axis, const struct job *job, const float *const row[3],
                                     float (*restrict result)[SCREEN_BLOCK], float *restrict on);

/* Members `term_across` and `term_down` of struct screen_kernels. */
int PELL_SIMD(screen_term_across)(const struct screen_work *w, int y, const float *const from[3], float *const to[3]);
int PELL_SIMD(screen_term_down)(const struct screen_work *w, int y, const float *const from[3]);

/* Members `load` and `measure` of struct screen_kernels. */
void PELL_SIMD(screen_load_row)(const struct screen_work *w, int y, struct screen_seen *seen);
void PELL_SIMD(screen_measure_row)(const struct screen_work *w, int y);

#endif
