/* SPDX-License-Identifier: MIT
 * cpu.c - see stage.h. Blocks of a row without hidden light within reach are skipped. */
#include "render/highlights/stage.h"

#include "shared/highlights.h"

#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>

enum {
    BAND = 8, /* rows per task */
    REACH = PELL_HIGHLIGHTS_REACH
};

_Static_assert(2 * REACH + 1 == PELL_HIGHLIGHTS_TAPS, "a row's taps");

struct job {
    const struct pell_highlights_params *p;
    const struct pell_highlights_kernels *kernels;
    void (*run)(struct job *job, int y, int x0, int x1); /* the current pass, for a block of a row */
    _Atomic int64_t pixels;
};

/* Flag of the block of a row that contains pixel x. */
static uint8_t *has_hidden(const struct job *job, int y, int x)
{
    return job->p->has_hidden + (size_t) y * pell_highlights_blocks(job->p->stride) + (size_t) (x / PELL_HIGHLIGHTS_BLOCK);
}

/* The end of the block of a row that contains x. */
static int block_end(const struct job *job, int x)
{
    const int end = (x / PELL_HIGHLIGHTS_BLOCK + 1) * PELL_HIGHLIGHTS_BLOCK;

    return end < job->p->rect.x1 ? end : job->p->rect.x1;
}

static void find_hidden(struct job *job, int y, int x0, int x1)
{
    const struct pell_highlights_params *p = job->p;
    const ptrdiff_t at = y * p->stride + x0;
    float any = 0.0f;

    for (int c = 0; c < PELL_HIGHLIGHTS_SUMS; c++)
        for (int i = 0; i < x1 - x0; i++)
            any += p->hidden[c][at + i] > 0.0f ? 1.0f : 0.0f;
    *has_hidden(job, y, x0) = any > 0.0f;
}

/* Whether there is hidden light within reach of the block at x. */
static bool any_hidden(const struct job *job, int y, int x)
{
    const struct pell_rect *r = &job->p->rect;
    const int x0 = x - REACH > r->x0 ? x - REACH : r->x0, x1 = block_end(job, x) - 1 + REACH;
    bool any = false;

    for (int v = y - REACH > r->y0 ? y - REACH : r->y0; v <= y + REACH && v < r->y1; v++)
        any |= *has_hidden(job, v, x0) | *has_hidden(job, v, x) | *has_hidden(job, v, x1 < r->x1 ? x1 : r->x1 - 1);
    return any;
}

static void filter(struct job *job, int y, int x0, int x1)
{
    const struct pell_highlights_params *p = job->p;
    const struct pell_rect *r = &p->rect;
    const ptrdiff_t at = y * p->stride + x0;
    struct pell_highlights_block b = { .material = p->material + at,
                                       .depth = p->depth + at,
                                       .depth_mm = p->depth_mm,
                                       .fixed_mm = p->fixed_mm,
                                       .slope = PELL_HIGHLIGHTS_SLOPE,
                                       .rays = (float) p->rays };
    float *scratch[PELL_HIGHLIGHTS_SUMS];

    if (!any_hidden(job, y, x0))
        return;
    for (int c = 0; c < 3; c++)
        b.normal[c] = p->normal[c] + at;
    for (int c = 0; c < PELL_HIGHLIGHTS_SUMS; c++) {
        b.light[c] = p->light[c] + at;
        b.hidden[c] = p->hidden[c] + at;
        scratch[c] = p->scratch[c] + at;
    }
    for (int v = -REACH; v <= REACH; v++) {
        struct pell_highlights_tap taps[PELL_HIGHLIGHTS_TAPS];
        for (int u = -REACH; u <= REACH; u++)
            taps[u + REACH] = (struct pell_highlights_tap) {
                .offset = v * p->stride + u,
                .weight = (float) ((REACH + 1 - abs(u)) * (REACH + 1 - abs(v))),
                .next = abs(u) < 2 && abs(v) < 2 ? (float) ((2 - abs(u)) * (2 - abs(v))) : 0.0f,
                .first = x0 + u < r->x0 ? r->x0 - u - x0 : 0,
                .end = (x1 + u < r->x1 ? x1 : r->x1 - u) - x0,
            };
        if (y + v >= r->y0 && y + v < r->y1)
            job->kernels->add(&b, taps, PELL_HIGHLIGHTS_TAPS);
    }
    job->kernels->end(&b, scratch, x1 - x0);
    atomic_fetch_add_explicit(&job->pixels, x1 - x0, memory_order_relaxed);
}

/* Copies the results back, once no pixel reads its neighbours any more. */
static void copy(struct job *job, int y, int x0, int x1)
{
    const struct pell_highlights_params *p = job->p;
    const ptrdiff_t at = y * p->stride + x0;

    if (any_hidden(job, y, x0))
        for (int c = 0; c < PELL_HIGHLIGHTS_SUMS; c++)
            memcpy(p->light[c] + at, p->scratch[c] + at, (size_t) (x1 - x0) * sizeof(float));
}

static void run_rows(void *arg, int index, int worker)
{
    struct job *job = arg;
    const int y0 = job->p->rect.y0 + index * BAND, y1 = y0 + BAND < job->p->rect.y1 ? y0 + BAND : job->p->rect.y1;

    (void) worker;
    for (int y = y0; y < y1; y++)
        for (int x0 = job->p->rect.x0, x1; x0 < job->p->rect.x1; x0 = x1) {
            x1 = block_end(job, x0);
            job->run(job, y, x0, x1);
        }
}

int64_t pell_highlights_render(struct pell_pool *pool, const struct pell_highlights_params *p)
{
    static void (*const passes[])(struct job *, int, int, int) = { find_hidden, filter, copy };
    struct job job = { .p = p, .kernels = pell_highlights_kernels_tables[pell_simd_best()] };

    if (p->rect.x0 >= p->rect.x1 || p->rect.y0 >= p->rect.y1)
        return 0;
    for (size_t i = 0; i < sizeof(passes) / sizeof(*passes); i++) {
        job.run = passes[i];
        pell_pool_run(pool, (p->rect.y1 - p->rect.y0 + BAND - 1) / BAND, run_rows, &job);
    }
    return atomic_load(&job.pixels);
}
