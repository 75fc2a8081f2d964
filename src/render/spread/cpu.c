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
    BAND = 8, /* rows per task */
    LEVELS = PELL_SPREAD_LEVELS
};

#define MIN_SIGMA 0.7f        /* px: standard deviation of the narrowest Gaussian where pixels are finest */
#define REACH2 11.0f          /* squared reach of pell_spread_weight over its variance */
#define MIN_TRANSMITTED 2e-3f /* of the light that arrives at the far side: a smaller transmitted fraction is not spread */
#define MAX_SPACING 0.75f     /* largest distance between taps, in standard deviations */

struct job {
    const struct pell_spread_params *p;
    const struct pell_spread_kernels *kernels;
    void (*row)(const struct job *job, int y, struct pell_rect rect);
    struct pell_rect rect; /* bounds of the rows */
    struct pell_spread_plan plan;
    int level;                      /* counted from 1 */
    float inverse;                  /* 1/reach^2 of the blur, 1/mm^2 */
    int taps, spacing;              /* taps to each side, and their spacing, px */
    bool down;                      /* the pass is vertical, from `half` to `sum`; else horizontal, from `sum` to `half` */
    _Atomic int32_t x0, y0, x1, y1; /* bounds of straight transmission */
    _Atomic int32_t finest;         /* bits of the least width of a pixel there, mm */
    _Atomic int32_t widest;         /* bits of the largest variance */
};

static void atomic_minimum(_Atomic int32_t *least, int32_t value)
{
    int32_t old = atomic_load_explicit(least, memory_order_relaxed);

    while (value < old && !atomic_compare_exchange_weak_explicit(least, &old, value, memory_order_relaxed, memory_order_relaxed)) {}
}

static void atomic_maximum(_Atomic int32_t *most, int32_t value)
{
    int32_t old = atomic_load_explicit(most, memory_order_relaxed);

    while (value > old && !atomic_compare_exchange_weak_explicit(most, &old, value, memory_order_relaxed, memory_order_relaxed)) {}
}

/* Variance of a pixel's straight transmission, by channel, and its fraction of all transmitted light. Returns false if there is none. */
static inline bool variance_at(const struct pell_spread_params *p, ptrdiff_t at, float variance[3], float *straight)
{
    const struct pell_thickness_table *t = p->path[at] > 0.0f && p->key[at] && p->material[at] ? p->thickness[p->material[at] - 1] : NULL;
    float coord;
    int i;

    *straight = 0.0f;
    if (!t)
        return false;
    *straight = pell_spread_straight(p->path[at]);
    coord = pell_thickness_coord(p->path[at], t->max_mm, PELL_THICKNESS_STEPS);
    i = pell_table_cell(coord, PELL_THICKNESS_STEPS);
    if (fmaxf(fmaxf(t->slab[i][0], t->slab[i][1]), t->slab[i][2]) < MIN_TRANSMITTED)
        return false;
    for (int c = 0; c < 3; c++)
        variance[c] = pell_lerp(t->spread[i][c], t->spread[i + 1][c], fminf(coord - (float) i, 1.0f));
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
    atomic_minimum(&found->x0, first);
    atomic_maximum(&found->x1, last + 1);
    atomic_minimum(&found->y0, y);
    atomic_maximum(&found->y1, y + 1);
    atomic_minimum(&found->finest, pell_float_bits(finest));
    atomic_maximum(&found->widest, pell_float_bits(widest));
}

/* Fraction of light of a variance that a level takes; level 0 is not blurred. */
static inline float level_fraction(const struct job *job, int level, float variance)
{
    const float *v = job->plan.variance;

    return pell_spread_gaussian_fraction(variance, level > 0 ? v[level - 1] : -1.0f, v[level], level < LEVELS ? v[level + 1] : 0.0f);
}

/* Flag of the block of a row that contains pixel x: whether it has light in `sum` (0) or `half` (1). */
static inline uint8_t *has_light(const struct job *job, int plane, int y, int x)
{
    return job->p->lit[plane] + (size_t) y * pell_spread_blocks(job->p->stride) + (size_t) (x / PELL_SPREAD_BLOCK);
}

/* Adds the level's fraction of light to `sum`. */
static void add_row(const struct job *job, int y, struct pell_rect rect)
{
    const struct pell_spread_params *p = job->p;

    for (int x = rect.x0; x < rect.x1; x++) {
        const ptrdiff_t at = y * p->stride + x;
        float v[3], straight;
        if (!variance_at(p, at, v, &straight))
            continue;
        *has_light(job, 0, y, x) = 1;
        for (int c = 0; c < 3; c++)
            p->sum[c][at] += straight * p->transmitted[c][at] * level_fraction(job, job->level, v[c]);
    }
}

static void clear_row(const struct job *job, int y, struct pell_rect rect)
{
    for (int c = 0; c < 3; c++)
        memset(job->p->sum[c] + y * job->p->stride + rect.x0, 0, (size_t) (rect.x1 - rect.x0) * sizeof(float));
    for (int plane = 0; plane < 2; plane++)
        memset(has_light(job, plane, y, 0), 0, pell_spread_blocks(job->p->stride));
}

static void finish_row(const struct job *job, int y, struct pell_rect rect)
{
    const struct pell_spread_params *p = job->p;

    for (int x = rect.x0; x < rect.x1; x++) {
        const ptrdiff_t at = y * p->stride + x;
        float v[3], straight;
        const bool any = variance_at(p, at, v, &straight);
        for (int c = 0; c < 3 && p->key[at]; c++)
            p->transmitted[c][at] =
                p->transmitted[c][at] * (any ? 1.0f - straight + straight * level_fraction(job, 0, v[c]) : 1.0f) + p->sum[c][at];
    }
}

/* Whether any block within reach of the pixels from x0 to x1 of a row has light. */
static bool any_light(const struct job *job, int y, int x0, int x1, struct pell_rect rect)
{
    const int reach = job->taps * job->spacing, least = (x0 - reach > rect.x0 ? x0 - reach : rect.x0) / PELL_SPREAD_BLOCK,
              most = ((x1 + reach < rect.x1 ? x1 + reach : rect.x1) - 1) / PELL_SPREAD_BLOCK;
    bool any = false;

    for (int k = -job->taps; k <= job->taps && job->down && !any; k++) {
        const int tap = y + k * job->spacing;
        any = tap >= rect.y0 && tap < rect.y1 && *has_light(job, 1, tap, x0);
    }
    for (int b = least; b <= most && !job->down && !any; b++)
        any = *has_light(job, 0, y, b * PELL_SPREAD_BLOCK);
    return any;
}

/* Blurs the pixels from x0 to x1 of a row. */
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
        const int distance = k * job->spacing;
        if (job->down && y + distance >= rect.y0 && y + distance < rect.y1)
            job->kernels->add(&b, distance * p->stride, (float) distance, 0, x1 - x0);
        else if (!job->down)
            job->kernels->add(&b, distance, (float) distance, x0 + distance < rect.x0 ? rect.x0 - x0 - distance : 0,
                              (x1 + distance < rect.x1 ? x1 : rect.x1 - distance) - x0);
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
        any = any_light(job, y, x0, x1, rect);
        if (any)
            blur_block(job, y, x0, x1, rect);
        for (int c = 0; c < 3 && !any && !job->down; c++) /* `sum` is 0 there already */
            memset(job->p->half[c] + y * job->p->stride + x0, 0, (size_t) (x1 - x0) * sizeof(float));
        *has_light(job, !job->down, y, x0) = any;
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

/* The rectangle extended by `reach` pixels, inside `within`. */
static struct pell_rect extended(struct pell_rect r, int reach, struct pell_rect within)
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
        plan->variance[i] = MIN_SIGMA * MIN_SIGMA * finest * finest * (float) (1 << 2 * (i - 1));
        plan->levels += i == plan->levels + 1 && plan->variance[i - 1] < found->widest;
    }
    for (int i = 1; i <= plan->levels; i++) {
        const float variance = plan->variance[i] - plan->variance[i - 1], px = sqrtf(variance) / finest;
        const int spacing = MAX_SPACING * px > 1.0f ? (int) (MAX_SPACING * px) : 1;
        reach += (int) fminf(ceilf(sqrtf(REACH2 * variance) / finest), 65536.0f);
        plan->blur[i].inverse = 1.0f / (REACH2 * variance);
        plan->blur[i].spacing = spacing;
        plan->blur[i].taps = (int) (sqrtf(REACH2) * px) / spacing;
    }
    plan->around = extended(found->straight, 2 * reach, *within); /* pixels that light reaches, and those that weight it */
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
    run(pool, &job, finish_row);
    return (int64_t) (around.x1 - around.x0) * (around.y1 - around.y0);
}
