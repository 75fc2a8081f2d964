/* SPDX-License-Identifier: MIT
 *
 * stray.c - ways that come out as by chance, far from those of the pixels beside them: bumps and edges send each somewhere else, and a
 * light that few of them meet shows as specks. What such pixels have are samples of one thing, and each is given the mean of those around
 * it.
 */
#include "render/unscattered/internal.h"

#include <math.h>

enum { LINES = 16 };

struct shared {
    struct pell_rect rect;
    ptrdiff_t stride;
    float *const *light;
};

struct mean {
    float sum, weight;
};

static inline void add(struct mean *m, float value, float weight)
{
    if (signbit(value)) {
        m->sum -= weight * value;
        m->weight += weight;
    }
}

/* Weights 1, 2, 3, 2, 1 along a line, over what is stray. `sign`: of what is written. */
static void blur_line(float *line, ptrdiff_t step, int count, float sign)
{
    float before[2] = { 0.0f, 0.0f };

    for (int i = 0; i < count; i++) {
        const float here = line[i * step];
        if (signbit(here)) {
            struct mean m = { 0.0f, 0.0f };
            add(&m, before[0], 1.0f);
            add(&m, before[1], 2.0f);
            add(&m, here, 3.0f);
            add(&m, i + 1 < count ? line[(i + 1) * step] : 0.0f, 2.0f);
            add(&m, i + 2 < count ? line[(i + 2) * step] : 0.0f, 1.0f);
            line[i * step] = sign * m.sum / m.weight;
        }
        before[0] = before[1];
        before[1] = here;
    }
}

static void blur_rows(void *arg, int index, int worker)
{
    const struct shared *s = arg;
    const struct pell_rect r = s->rect;

    (void) worker;
    for (int y = r.y0 + index * LINES; y < r.y1 && y < r.y0 + (index + 1) * LINES; y++)
        for (int c = 0; c < 3; c++)
            blur_line(s->light[c] + y * s->stride + r.x0, 1, r.x1 - r.x0, -1.0f);
}

static void blur_columns(void *arg, int index, int worker)
{
    const struct shared *s = arg;
    const struct pell_rect r = s->rect;

    (void) worker;
    for (int x = r.x0 + index * LINES; x < r.x1 && x < r.x0 + (index + 1) * LINES; x++)
        for (int c = 0; c < 3; c++)
            blur_line(s->light[c] + r.y0 * s->stride + x, s->stride, r.y1 - r.y0, 1.0f);
}

void unscattered_share_stray(struct pell_pool *pool, struct pell_rect rect, ptrdiff_t stride, float *const light[3])
{
    struct shared s = { rect, stride, light };

    pell_pool_run(pool, (rect.y1 - rect.y0 + LINES - 1) / LINES, blur_rows, &s);
    pell_pool_run(pool, (rect.x1 - rect.x0 + LINES - 1) / LINES, blur_columns, &s);
}
