/* SPDX-License-Identifier: MIT
 *
 * gather.c - planes to pixels.
 */
#include "methods/convolution/state.h"

#include "base/pool.h"
#include "math/vec.h"

#include <string.h>

static float clamp(float x, float low, float high)
{
    return x < low ? low : x > high ? high : x;
}

void convolution_find_seen(struct convolution_state *st)
{
    struct conv_job *j = &st->job;
    const struct pell_rect *rect = &j->extent.rect;
    const struct conv_front *f = &st->sources.front;

    for (int i = 0; i < CONV_IMAGES; i++)
        j->seen[i] = !st->knobs.visible && i < j->layout.planes + j->between;
    for (int y = rect->y0; y < rect->y1 && st->knobs.visible; y++)
        for (int x = rect->x0; x < rect->x1; x++)
            if (f->group[y * f->stride + x] == j->group + 1) {
                const int plane = (int) f->place[y * f->stride + x];
                j->seen[plane] = true;
                if (j->layout.planes > 1)
                    j->seen[plane + 1] = true;
                if (j->between)
                    j->seen[j->layout.planes + plane] = true;
            }
}

/* Between the four pixels of an image around a point. */
static inline float between_pixels(const float *p, ptrdiff_t right, ptrdiff_t down, float fx, float fy)
{
    const float top = p[0] + fx * (p[right] - p[0]), bottom = p[down] + fx * (p[down + right] - p[down]);
    return top + fy * (bottom - top);
}

static inline bool is_in(const struct pell_rect *rect, int x, int y)
{
    return x >= rect->x0 && x < rect->x1 && y >= rect->y0 && y < rect->y1;
}

static float gather_pixel(const struct convolution_state *st, int x, int y)
{
    const struct conv_job *j = &st->job;
    const float place = st->sources.front.place[y * st->sources.front.stride + x];
    const int plane = (int) place, several = j->layout.planes > 1;
    const float t = place - (float) plane, *first = conv_image(st, plane), *second = first + (several ? st->image_size : 0);
    const float *between = j->between ? conv_image(st, j->layout.planes + plane) : NULL;
    float sum;

    if (st->step == 1) {
        const ptrdiff_t i = (y - j->y0) * j->stride + x - j->x0;
        if (!is_in(&j->reached, x - j->x0, y - j->y0))
            return 0.0f;
        sum = first[i] + t * (second[i] - first[i]);
        return between ? sum + sqrtf(2.0f * t * (1.0f - t)) * between[i] : sum;
    } else {
        const int last_x = j->layout.width - 1, last_y = j->layout.height - 1;
        const float u = clamp(((float) (x - j->x0) + 0.5f) / (float) st->step - 0.5f, 0.0f, (float) last_x);
        const float v = clamp(((float) (y - j->y0) + 0.5f) / (float) st->step - 0.5f, 0.0f, (float) last_y);
        const int px = (int) u, py = (int) v;
        const ptrdiff_t i = py * j->stride + px, right = px < last_x, down = py < last_y ? j->stride : 0;
        const float fx = u - (float) px, fy = v - (float) py;
        if (!is_in(&j->reached, px, py) && !is_in(&j->reached, px + 1, py) && !is_in(&j->reached, px, py + 1) &&
            !is_in(&j->reached, px + 1, py + 1))
            return 0.0f;
        sum = (1.0f - t) * between_pixels(first + i, right, down, fx, fy) + t * between_pixels(second + i, right, down, fx, fy);
        return between ? sum + sqrtf(2.0f * t * (1.0f - t)) * between_pixels(between + i, right, down, fx, fy) : sum;
    }
}

static void gather_row(void *arg, int index, int worker)
{
    struct convolution_state *st = arg;
    const struct conv_job *j = &st->job;
    const struct conv_front *f = &st->sources.front;
    const struct conv_radial *r = &j->radial[j->channel];
    const int y = j->extent.rect.y0 + index;
    float *out = j->out->light[j->channel] + y * j->in->stride;

    (void) worker;
    for (int x = j->extent.rect.x0; x < j->extent.rect.x1; x++) {
        const ptrdiff_t i = y * f->stride + x;
        float m;
        if (f->group[i] != j->group + 1)
            continue;
        m = gather_pixel(st, x, y) * f->leaves[j->channel][i];
        if (j->even) {
            st->even[i] = m;
            continue;
        }
        if (j->divide) { /* a mean of what is there, whatever rounding says of light that is far dimmer than elsewhere */
            m = st->even[i] > 0.0f ? m / st->even[i] : j->in->irradiance[j->channel][y * j->in->stride + x];
            m = r->total * (m < j->extent.brightest[j->channel] ? m : j->extent.brightest[j->channel]);
        }
        out[x] = m > 0.0f ? m : 0.0f;
    }
}

void convolution_gather(struct convolution_state *st)
{
    pell_pool_run(st->pool, st->job.extent.rect.y1 - st->job.extent.rect.y0, gather_row, st);
}
