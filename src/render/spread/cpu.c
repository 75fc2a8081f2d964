/* SPDX-License-Identifier: MIT
 * cpu.c - see stage.h. */
#include "render/spread/stage.h"

#include "math/vec.h"
#include "shared/spread.h"
#include "shared/table.h"

#include <math.h>
#include <stdatomic.h>
#include <string.h>

enum {
    BAND = 8, /* rows that a thread takes at a time */
    LEVELS = PELL_SPREAD_LEVELS
};

#define NARROWEST 0.7f /* px: standard deviation of the narrowest Gaussian where pixels are finest */
#define REACH2 11.0f   /* variances: pell_spread_weight */
#define LEAST 2e-3f    /* of light that arrives behind: what less of it gets through is left as it is */
#define SPACING 0.75f  /* standard deviations between taps, at most */

struct job {
    const struct pell_spread_params *p;
    const struct pell_spread_kernels *kernels;
    void (*row)(const struct job *job, int y, struct pell_rect rect);
    struct pell_rect rect; /* that rows are of */
    struct pell_spread_plan plan;
    int level;                      /* counted from 1 */
    float inverse;                  /* 1/reach^2 of the blur, 1/mm^2 */
    int taps, spacing;              /* of it: to each side, px */
    bool down;                      /* it runs down columns, from `half` to `sum`; else along rows, from `sum` to `half` */
    _Atomic int32_t x0, y0, x1, y1; /* where light went straight */
    _Atomic int32_t finest;         /* bits of the least mm of a pixel there */
    _Atomic int32_t widest;         /* bits of the largest variance */
};

static void lower(_Atomic int32_t *least, int32_t value)
{
    int32_t old = atomic_load_explicit(least, memory_order_relaxed);

    while (value < old && !atomic_compare_exchange_weak_explicit(least, &old, value, memory_order_relaxed, memory_order_relaxed)) {}
}

static void lift(_Atomic int32_t *most, int32_t value)
{
    int32_t old = atomic_load_explicit(most, memory_order_relaxed);

    while (value > old && !atomic_compare_exchange_weak_explicit(most, &old, value, memory_order_relaxed, memory_order_relaxed)) {}
}

/* Of what of a pixel's light went straight, by channel, and its share; false where none did. */
static inline bool variance_at(const struct pell_spread_params *p, ptrdiff_t at, float variance[3], float *straight)
{
    const struct pell_thickness_table *t = p->way[at] > 0.0f && p->key[at] && p->material[at] ? p->thickness[p->material[at] - 1] : NULL;
    float place;
    int i;

    *straight = 0.0f;
    if (!t)
        return false;
    *straight = pell_spread_straight(p->way[at]);
    place = pell_thickness_place(p->way[at], t->max_mm, PELL_THICKNESS_STEPS);
    i = pell_table_cell(place, PELL_THICKNESS_STEPS);
    if (fmaxf(fmaxf(t->slab[i][0], t->slab[i][1]), t->slab[i][2]) < LEAST)
        return false;
    for (int c = 0; c < 3; c++)
        variance[c] = pell_lerp(t->spread[i][c], t->spread[i + 1][c], fminf(place - (float) i, 1.0f));
    return true;
}

static void scan_row(const struct job *job, int y, struct pell_rect rect)
{
    const struct pell_spread_params *p = job->p;
    struct job *found = (struct job *) job;
    float finest = INFINITY, widest = 0.0f;
    int first = INT32_MAX, last = -1;

    for (int x = rect.x0; x < rect.x1; x++) {
        const ptrdiff_t at = y * p->stride + x;
        float v[3], straight;
        if (!variance_at(p, at, v, &straight))
            continue;
        finest = fminf(finest, p->depth[at] * p->depth_mm + p->fixed_mm);
        widest = fmaxf(widest, fmaxf(fmaxf(v[0], v[1]), v[2]));
        first = x < first ? x : first;
        last = x;
    }
    if (last < 0)
        return;
    lower(&found->x0, first);
    lift(&found->x1, last + 1);
    lower(&found->y0, y);
    lift(&found->y1, y + 1);
    lower(&found->finest, pell_float_bits(finest));
    lift(&found->widest, pell_float_bits(widest));
}

/* Share of light of a variance that a level takes; level 0 is what is not blurred. */
static inline float share_of(const struct job *job, int level, float variance)
{
    const float *v = job->plan.variance;

    return pell_spread_share(variance, level > 0 ? v[level - 1] : -1.0f, v[level], level < LEVELS ? v[level + 1] : 0.0f);
}

/* Whether the block of a row that holds pixel x has light in `sum` (0) or `half` (1). */
static inline uint8_t *lit(const struct job *job, int plane, int y, int x)
{
    return job->p->lit[plane] + (size_t) y * pell_spread_blocks(job->p->stride) + (size_t) (x / PELL_SPREAD_BLOCK);
}

/* Adds the level's share to `sum`. */
static void add_row(const struct job *job, int y, struct pell_rect rect)
{
    const struct pell_spread_params *p = job->p;

    for (int x = rect.x0; x < rect.x1; x++) {
        const ptrdiff_t at = y * p->stride + x;
        float v[3], straight;
        if (!variance_at(p, at, v, &straight))
            continue;
        *lit(job, 0, y, x) = 1;
        for (int c = 0; c < 3; c++)
            p->sum[c][at] += straight * p->transmitted[c][at] * share_of(job, job->level, v[c]);
    }
}

static void clear_row(const struct job *job, int y, struct pell_rect rect)
{
    for (int c = 0; c < 3; c++)
        memset(job->p->sum[c] + y * job->p->stride + rect.x0, 0, (size_t) (rect.x1 - rect.x0) * sizeof(float));
    for (int plane = 0; plane < 2; plane++)
        memset(lit(job, plane, y, 0), 0, pell_spread_blocks(job->p->stride));
}

static void end_row(const struct job *job, int y, struct pell_rect rect)
{
    const struct pell_spread_params *p = job->p;

    for (int x = rect.x0; x < rect.x1; x++) {
        const ptrdiff_t at = y * p->stride + x;
        float v[3], straight;
        const bool any = variance_at(p, at, v, &straight);
        for (int c = 0; c < 3 && p->key[at]; c++)
            p->transmitted[c][at] =
                p->transmitted[c][at] * (any ? 1.0f - straight + straight * share_of(job, 0, v[c]) : 1.0f) + p->sum[c][at];
    }
}

/* Whether there is light in reach of the pixels from x0 to x1 of a row. */
static bool any_lit(const struct job *job, int y, int x0, int x1, struct pell_rect rect)
{
    const int reach = job->taps * job->spacing, least = (x0 - reach > rect.x0 ? x0 - reach : rect.x0) / PELL_SPREAD_BLOCK,
              most = ((x1 + reach < rect.x1 ? x1 + reach : rect.x1) - 1) / PELL_SPREAD_BLOCK;
    bool any = false;

    for (int k = -job->taps; k <= job->taps && job->down && !any; k++) {
        const int tap = y + k * job->spacing;
        any = tap >= rect.y0 && tap < rect.y1 && *lit(job, 1, tap, x0);
    }
    for (int b = least; b <= most && !job->down && !any; b++)
        any = *lit(job, 0, y, b * PELL_SPREAD_BLOCK);
    return any;
}

/* Of the pixels from x0 to x1 of a row. */
static void blur_block(const struct job *job, int y, int x0, int x1, struct pell_rect rect)
{
    const struct pell_spread_params *p = job->p;
    float *const *from = job->down ? p->half : p->sum, *const *to = job->down ? p->sum : p->half;
    const ptrdiff_t at = y * p->stride + x0;
    struct pell_spread_block b = { .key = p->key + at, .depth = p->depth + at, .inverse = job->inverse };

    for (int c = 0; c < 3; c++)
        b.from[c] = from[c] + at;
    for (int i = 0; i < x1 - x0; i++)
        b.mm[i] = b.depth[i] * p->depth_mm + p->fixed_mm;
    for (int k = -job->taps; k <= job->taps; k++) {
        const int apart = k * job->spacing;
        if (job->down && y + apart >= rect.y0 && y + apart < rect.y1)
            job->kernels->add(&b, apart * p->stride, (float) apart, 0, x1 - x0);
        else if (!job->down)
            job->kernels->add(&b, apart, (float) apart, x0 + apart < rect.x0 ? rect.x0 - x0 - apart : 0,
                              (x1 + apart < rect.x1 ? x1 : rect.x1 - apart) - x0);
    }
    for (int c = 0; c < 3; c++)
        for (int i = 0; i < x1 - x0; i++)
            to[c][at + i] = b.weight[i] > 0.0f ? b.light[c][i] / b.weight[i] : 0.0f;
}

static void blur_row(const struct job *job, int y, struct pell_rect rect)
{
    for (int x0 = rect.x0, x1; x0 < rect.x1; x0 = x1) {
        const int end = (x0 / PELL_SPREAD_BLOCK + 1) * PELL_SPREAD_BLOCK;
        bool any;
        x1 = end < rect.x1 ? end : rect.x1;
        any = any_lit(job, y, x0, x1, rect);
        if (any)
            blur_block(job, y, x0, x1, rect);
        for (int c = 0; c < 3 && !any && !job->down; c++) /* `sum` is 0 there already */
            memset(job->p->half[c] + y * job->p->stride + x0, 0, (size_t) (x1 - x0) * sizeof(float));
        *lit(job, !job->down, y, x0) = any;
    }
}

static void run_rows(void *arg, int index, int worker)
{
    const struct job *job = arg;
    const int y0 = job->rect.y0 + index * BAND, y1 = y0 + BAND < job->rect.y1 ? y0 + BAND : job->rect.y1;

    (void) worker;
    for (int y = y0; y < y1; y++)
        job->row(job, y, job->rect);
}

static void run(struct pell_pool *pool, struct job *job, void (*row)(const struct job *job, int y, struct pell_rect rect))
{
    job->row = row;
    pell_pool_run(pool, (job->rect.y1 - job->rect.y0 + BAND - 1) / BAND, run_rows, job);
}

/* The rectangle with what is `reach` pixels around it, where there are translucent pixels. */
static struct pell_rect widened(struct pell_rect r, int reach, struct pell_rect within)
{
    return (struct pell_rect) { .x0 = r.x0 - reach > within.x0 ? r.x0 - reach : within.x0,
                                .y0 = r.y0 - reach > within.y0 ? r.y0 - reach : within.y0,
                                .x1 = r.x1 + reach < within.x1 ? r.x1 + reach : within.x1,
                                .y1 = r.y1 + reach < within.y1 ? r.y1 + reach : within.y1 };
}

bool pell_spread_make_plan(const struct pell_spread_found *found, const struct pell_rect *within, struct pell_spread_plan *plan)
{
    const float finest = found->finest;
    int reach = 0;

    *plan = (struct pell_spread_plan) { .levels = 0 };
    if (found->straight.x0 >= found->straight.x1)
        return false;
    for (int i = 1; i <= LEVELS; i++) {
        plan->variance[i] = NARROWEST * NARROWEST * finest * finest * (float) (1 << 2 * (i - 1));
        plan->levels += i == plan->levels + 1 && plan->variance[i - 1] < found->widest;
    }
    for (int i = 1; i <= plan->levels; i++) {
        const float variance = plan->variance[i] - plan->variance[i - 1], px = sqrtf(variance) / finest;
        const int spacing = SPACING * px > 1.0f ? (int) (SPACING * px) : 1;
        reach += (int) fminf(ceilf(sqrtf(REACH2 * variance) / finest), 65536.0f);
        plan->blur[i].inverse = 1.0f / (REACH2 * variance);
        plan->blur[i].spacing = spacing;
        plan->blur[i].taps = (int) (sqrtf(REACH2) * px) / spacing;
    }
    plan->around = widened(found->straight, 2 * reach, *within); /* what light reaches, and what those pixels weigh it by */
    return plan->levels > 0;
}

int64_t pell_spread_render(struct pell_pool *pool, const struct pell_spread_params *p)
{
    struct job job = { .p = p,
                       .kernels = pell_spread_kernels_tables[pell_simd_best()],
                       .rect = p->rect,
                       .x0 = INT32_MAX,
                       .y0 = INT32_MAX,
                       .finest = INT32_MAX };
    struct pell_spread_found found;
    struct pell_rect around;

    if (p->rect.x0 >= p->rect.x1 || p->rect.y0 >= p->rect.y1)
        return 0;
    run(pool, &job, scan_row);
    found = (struct pell_spread_found) { { job.x0, job.y0, job.x1, job.y1 }, pell_bits_float(job.finest), pell_bits_float(job.widest) };
    if (!pell_spread_make_plan(&found, &p->rect, &job.plan))
        return 0;
    job.rect = around = job.plan.around;
    run(pool, &job, clear_row);
    for (job.level = job.plan.levels; job.level > 0; job.level--) {
        job.rect = found.straight;
        run(pool, &job, add_row);
        job.rect = around;
        job.inverse = job.plan.blur[job.level].inverse;
        job.spacing = job.plan.blur[job.level].spacing;
        job.taps = job.plan.blur[job.level].taps;
        job.down = false;
        run(pool, &job, blur_row);
        job.down = true;
        run(pool, &job, blur_row);
    }
    run(pool, &job, end_row);
    return (int64_t) (around.x1 - around.x0) * (around.y1 - around.y0);
}
