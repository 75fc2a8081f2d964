/* SPDX-License-Identifier: MIT
 *
 * stray.c - ways that come out as by chance, far from those of the pixels beside them: bumps and edges send each somewhere else, and a
 * light that few of them meet shows as specks. What such pixels have are samples of one thing, and each is given the mean of those around
 * it.
 */
#include "render/unscattered/internal.h"

#include <math.h>

enum { LINES = 16 };
#define STEEP 6.0f /* pixels of depth to a pixel aside: beyond, another part begins */

/* Lines of a picture: `count` of them, `apart` in memory, each of `length` values `step` apart. */
struct lines {
    const struct pell_unscattered_params *p;
    ptrdiff_t start, apart, step;
    int count, length;
    float sign; /* of what is written */
};

struct mean {
    float sum, weight;
};

static inline void add(struct mean *m, float value, float weight, bool same)
{
    if (value < 0.0f && same) {
        m->sum -= weight * value;
        m->weight += weight;
    }
}

/* Weights 1, 2, 3, 2, 1 along a line, over what is stray and of one part. */
static void blur_line(float *line, const float *depth, float depth_mm, float fixed_mm, ptrdiff_t step, int count, float sign)
{
    float before[2] = { 0.0f, 0.0f };

    for (int i = 0; i < count; i++) {
        const float here = line[i * step], d = depth[i * step], most = STEEP * (d * depth_mm + fixed_mm);
        if (here < 0.0f) {
            struct mean m = { 0.0f, 0.0f };
            add(&m, here, 3.0f, true);
            if (i > 1)
                add(&m, before[0], 1.0f, fabsf(depth[(i - 2) * step] - d) < 2.0f * most);
            if (i > 0)
                add(&m, before[1], 2.0f, fabsf(depth[(i - 1) * step] - d) < most);
            if (i + 1 < count)
                add(&m, line[(i + 1) * step], 2.0f, fabsf(depth[(i + 1) * step] - d) < most);
            if (i + 2 < count)
                add(&m, line[(i + 2) * step], 1.0f, fabsf(depth[(i + 2) * step] - d) < 2.0f * most);
            line[i * step] = sign * m.sum / m.weight;
        }
        before[0] = before[1];
        before[1] = here;
    }
}

static void blur_lines(void *arg, int index, int worker)
{
    const struct lines *s = arg;
    const struct pell_view *view = s->p->view;
    const float per = 1.0f / view->focal_px;

    (void) worker;
    for (int i = index * LINES; i < s->count && i < (index + 1) * LINES; i++)
        for (int c = 0; c < 3; c++)
            blur_line(s->p->light[c] + s->start + i * s->apart, s->p->surface->depth + s->start + i * s->apart,
                      view->orthographic ? 0.0f : per, view->orthographic ? per : 0.0f, s->step, s->length, s->sign);
}

/* Rows, which stay marked, then columns. */
void unscattered_share_stray(struct pell_pool *pool, const struct pell_unscattered_params *p)
{
    const struct pell_rect rect = p->surface->translucent;
    const ptrdiff_t stride = p->surface->stride;
    const int wide = rect.x1 - rect.x0, high = rect.y1 - rect.y0;
    const ptrdiff_t start = rect.y0 * stride + rect.x0;
    struct lines rows = { p, start, stride, 1, high, wide, -1.0f }, columns = { p, start, 1, stride, wide, high, 1.0f };

    pell_pool_run(pool, (high + LINES - 1) / LINES, blur_lines, &rows);
    pell_pool_run(pool, (wide + LINES - 1) / LINES, blur_lines, &columns);
}
