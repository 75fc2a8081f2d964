/* SPDX-License-Identifier: MIT */
#include "render/bandwidth.h"

#include "base/base.h"
#include "render/plane_buffers.h"

#include <math.h>
#include <string.h>

/* Limits of the bytes read, which are otherwise four planes of the image. */
#define BYTES_MOST ((size_t) 32 << 20)
#define BYTES_LEAST ((size_t) 1 << 20)
#define BANDS 64

struct task {
    const char *from;
    char *to;
    size_t band;
};

static void copy_band(void *arg, int index, int worker)
{
    const struct task *t = arg;
    (void) worker;
    memcpy(t->to + (size_t) index * t->band, t->from + (size_t) index * t->band, t->band);
}

void pell_bandwidth_finish(struct pell_context *ctx, struct pell_bandwidth *b)
{
    pell_free(ctx, b->block);
    *b = (struct pell_bandwidth) { .wanted = b->wanted };
}

enum pell_result pell_bandwidth_plan(struct pell_context *ctx, struct pell_bandwidth *b, int width, int height)
{
    size_t bytes = 4 * sizeof(float) * (size_t) pell_plane_stride(width) * (size_t) height;

    bytes = bytes < BYTES_LEAST ? BYTES_LEAST : bytes > BYTES_MOST ? BYTES_MOST : bytes;
    bytes = bytes / BANDS / 64 * 64 * BANDS;
    if (b->bytes == bytes)
        return PELL_OK;
    pell_bandwidth_finish(ctx, b);
    b->block = pell_alloc(ctx, 2 * bytes);
    if (!b->block)
        return PELL_ERR_NOMEM;
    memset(b->block, 0, 2 * bytes); /* pages that were never written all map to one zero page */
    b->bytes = bytes;
    return PELL_OK;
}

void pell_bandwidth_measure(struct pell_pool *pool, struct pell_bandwidth *b, struct pell_stage_time *stages, size_t num_stages)
{
    struct task to = { b->block, b->block + b->bytes, b->bytes / BANDS }, fro = { to.to, b->block, to.band };
    double sorted[PELL_BANDWIDTH_RUNS], start, rate;
    int known;

    pell_pool_run(pool, BANDS, copy_band, &to);
    start = pell_seconds();
    pell_pool_run(pool, BANDS, copy_band, &fro);
    b->seconds[b->runs++ % PELL_BANDWIDTH_RUNS] = pell_seconds() - start;
    known = b->runs < PELL_BANDWIDTH_RUNS ? (int) b->runs : PELL_BANDWIDTH_RUNS;
    for (int i = 0; i < known; i++) {
        int at = i;
        for (; at > 0 && sorted[at - 1] > b->seconds[i]; at--)
            sorted[at] = sorted[at - 1];
        sorted[at] = b->seconds[i];
    }
    rate = 2.0 * (double) b->bytes / fmax(sorted[known / 2], 1e-9);
    for (size_t i = 0; i < num_stages; i++)
        stages[i].bandwidth_ms = 1e3 * (double) stages[i].bytes / rate;
}
