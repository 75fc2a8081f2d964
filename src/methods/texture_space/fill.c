/* SPDX-License-Identifier: MIT
 *
 * fill.c - fills the border texels of planes from the chart texels that they stand for.
 */
#include "methods/texture_space/state.h"

enum { SQUARES = 64 }; /* squares per task */

struct filling {
    const struct ts_atlas *atlas;
    float *const *planes;
    int count;
    int far;             /* borders farther from charts are left out */
    const uint8_t *need; /* per texel: last stage that needs it; NULL: all are needed */
    int stage;
};

/* Borders read only chart texels, because another thread may be filling other borders. */
static inline void fill_border(const struct ts_atlas *a, const struct ts_fill *b, float *const *planes, int count)
{
    const float x = (float) b->x * (1.0f / TS_WHOLE), y = (float) b->y * (1.0f / TS_WHOLE);
    const float both = x * y, right = x - both, up = y - both, least = 1.0f - x - up;

    for (int c = 0; c < count; c++) {
        const float *from = planes[c] + b->from, *above = from + a->stride;
        planes[c][b->at] = least * from[0] + right * from[1] + up * above[0] + both * above[1];
    }
}

static inline void fill_from_sources(const struct ts_atlas *a, const struct ts_fill *b, float *const *planes, int count)
{
    float sum[TS_PLANES] = { 0 };

    for (const struct ts_source *source = a->sources + b->from; source < a->sources + b->from + b->sources; source++)
        for (int c = 0; c < count; c++)
            sum[c] += source->weight * planes[c][source->at];
    for (int c = 0; c < count; c++)
        planes[c][b->at] = sum[c];
}

static inline void fill_square(const struct filling *p, size_t square, int count)
{
    const struct ts_atlas *a = p->atlas;
    float *planes[TS_PLANES];

    for (int c = 0; c < count; c++)
        planes[c] = p->planes[c];
    for (size_t i = a->first_border[square]; i < a->first_with_sources[square] && a->fills[i].far <= p->far; i++) {
        for (int c = 0; c < count; c++) {
            __builtin_prefetch(planes[c] + a->fills[i + TS_PREFETCH].from);
            __builtin_prefetch(planes[c] + a->fills[i + TS_PREFETCH].at, 1);
        }
        if (!p->need || p->need[a->fills[i].at] >= p->stage)
            fill_border(a, &a->fills[i], planes, count);
    }
    for (size_t i = a->first_with_sources[square]; i < a->first_border[square + 1] && a->fills[i].far <= p->far; i++)
        if (!p->need || p->need[a->fills[i].at] >= p->stage)
            fill_from_sources(a, &a->fills[i], planes, count);
}

static void fill_borders(void *arg, int chunk, int worker)
{
    const struct filling *p = arg;
    const struct ts_atlas *a = p->atlas;
    const size_t end = (size_t) (chunk + 1) * SQUARES < a->num_squares ? (size_t) (chunk + 1) * SQUARES : a->num_squares;

    (void) worker;
    for (size_t s = (size_t) chunk * SQUARES; s < end; s++)
        if (p->count == TS_PLANES)
            fill_square(p, s, TS_PLANES);
        else if (p->count == TS_ALPHA + 1)
            fill_square(p, s, TS_ALPHA + 1);
        else if (p->count == 3)
            fill_square(p, s, 3);
        else
            fill_square(p, s, p->count);
}

void ts_fill(const struct ts_state *st, const struct ts_atlas *a, float *const *planes, int count, int far, int stage)
{
    struct filling p = {
        .atlas = a,
        .planes = planes,
        .count = count,
        .far = far,
        .need = st->need.on ? st->need.stage : NULL,
        .stage = stage,
    };

    pell_pool_run(st->pool, (int) ((a->num_squares + SQUARES - 1) / SQUARES), fill_borders, &p);
}
