/* SPDX-License-Identifier: MIT
 *
 * incoherent.c - pixels whose paths exit far from those of adjacent pixels: bumps and edges send each path elsewhere, and a light that few
 * of them hit would show as specks. Their values are samples of one distribution, and each gets the mean of those around it.
 */
#include "render/unscattered/internal.h"

#include <math.h>

enum { LINES_PER_TASK = 16 };
#define MAX_SLOPE 6.0f /* depth difference between adjacent pixels, in pixel widths, beyond which another part begins */

/* Rows or columns of an image: `count` of them, `spacing` apart in memory, each of `length` values `step` apart. */
struct scanlines {
    const struct pell_unscattered_params *p;
    ptrdiff_t start, spacing, step;
    int count, length;
    float sign; /* sign of the results */
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

/* Filters a line with the weights 1, 2, 3, 2, 1 over incoherent pixels of the same part. */
static void blur_line(float *line, const float *depth, float depth_mm, float fixed_mm, ptrdiff_t step, int count, float sign)
{
    float before[2] = { 0.0f, 0.0f };

    for (int i = 0; i < count; i++) {
        const float here = line[i * step], d = depth[i * step], max_step = MAX_SLOPE * (d * depth_mm + fixed_mm);
        if (here < 0.0f) {
            struct mean m = { 0.0f, 0.0f };
            add(&m, here, 3.0f, true);
            if (i > 1)
                add(&m, before[0], 1.0f, fabsf(depth[(i - 2) * step] - d) < 2.0f * max_step);
            if (i > 0)
                add(&m, before[1], 2.0f, fabsf(depth[(i - 1) * step] - d) < max_step);
            if (i + 1 < count)
                add(&m, line[(i + 1) * step], 2.0f, fabsf(depth[(i + 1) * step] - d) < max_step);
            if (i + 2 < count)
                add(&m, line[(i + 2) * step], 1.0f, fabsf(depth[(i + 2) * step] - d) < 2.0f * max_step);
            line[i * step] = sign * m.sum / m.weight;
        }
        before[0] = before[1];
        before[1] = here;
    }
}

static void blur_lines(void *arg, int index, int worker)
{
    const struct scanlines *s = arg;
    const struct pell_view *view = s->p->view;
    const float mm_per_px = 1.0f / view->focal_px;

    (void) worker;
    for (int i = index * LINES_PER_TASK; i < s->count && i < (index + 1) * LINES_PER_TASK; i++)
        for (int c = 0; c < 3; c++)
            blur_line(s->p->light[c] + s->start + i * s->spacing, s->p->surface->depth + s->start + i * s->spacing,
                      view->orthographic ? 0.0f : mm_per_px, view->orthographic ? mm_per_px : 0.0f, s->step, s->length, s->sign);
}

/* Filters rows, which stay marked as incoherent, then columns. */
void unscattered_blur_incoherent(struct pell_pool *pool, const struct pell_unscattered_params *p)
{
    const struct pell_rect rect = p->surface->translucent;
    const ptrdiff_t stride = p->surface->stride;
    const int wide = rect.x1 - rect.x0, high = rect.y1 - rect.y0;
    const ptrdiff_t start = rect.y0 * stride + rect.x0;
    struct scanlines rows = { p, start, stride, 1, high, wide, -1.0f }, columns = { p, start, 1, stride, wide, high, 1.0f };

    pell_pool_run(pool, (high + LINES_PER_TASK - 1) / LINES_PER_TASK, blur_lines, &rows);
    pell_pool_run(pool, (wide + LINES_PER_TASK - 1) / LINES_PER_TASK, blur_lines, &columns);
}
