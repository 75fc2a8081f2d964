/* SPDX-License-Identifier: MIT
 *
 * gather.c - inverse transforms of the planes' rows, and interpolation from planes to pixels.
 */
#include "methods/convolution/state.h"

#include "base/pool.h"
#include "math/vec.h"

#include <string.h>

/* Images that a row needs: those of planes, then those between planes. */
static void find_needed(const struct convolution_state *st, unsigned seen, bool which[CONV_IMAGES])
{
    const struct conv_job *j = &st->job;
    const int n = j->layout.planes;

    for (int i = 0; i < n + j->between; i++)
        which[i] = i < n ? (seen | seen << 1) >> i & 1 : seen >> (i - n) & 1;
}

/* Rows of smaller images that row y of pixels needs, interpolated to full resolution on their plane; the first float of each is at pixel
 * rect.x0. */
static void expand_rows(const struct convolution_state *st, int y, const bool *which, float *spare, const float *rows[CONV_IMAGES])
{
    const struct conv_job *j = &st->job;
    const int last = j->layout.height - 1, first = j->extent.rect.x0 - j->x0, width = j->layout.width;
    const size_t size = ((size_t) width * (size_t) st->format.step + 31) / 16 * 16;
    const float v = ((float) (y - j->y0) + 0.5f) / (float) st->format.step - 0.5f, at = v < 0.0f           ? 0.0f
                                                                                        : v > (float) last ? (float) last
                                                                                                           : v;
    const int py = (int) at;

    for (int i = 0; i < j->layout.planes + j->between; i++) {
        const float *row = conv_image(st, i) + (ptrdiff_t) py * j->stride;
        if (!which[i])
            continue;
        st->kernels->expand(row, row + (py < last ? j->stride : 0), at - (float) py, width, st->format.step, spare, spare + width + 48);
        rows[i] = spare + width + 48 + first;
        spare += (size_t) width + 48 + size;
    }
}

/* Pixels [x0, x1) of row y that light reaches, counted from rect.x0. */
static void find_reached(const struct convolution_state *st, int y, int *x0, int *x1)
{
    const struct conv_job *j = &st->job;
    const struct pell_rect *rect = &j->extent.rect;
    const int half = st->format.step / 2, row = y - j->y0 - half; /* centre of the pixel relative to rows of the images */
    const int margin = st->format.step > 1, at = row >= 0 ? row / st->format.step : 0;
    int low, high;

    *x0 = *x1 = 0;
    if (at < j->reached.y0 - margin || at >= j->reached.y1)
        return;
    low = (j->reached.x0 - margin) * st->format.step + half - rect->x0 + j->x0;
    high = j->reached.x1 * st->format.step + half - rect->x0 + j->x0;
    *x0 = j->reached.x0 - margin <= 0 || low < 0 ? 0 : low;
    high = high < rect->x1 - rect->x0 ? high : rect->x1 - rect->x0;
    *x1 = high > *x0 ? high : *x0; /* the reached range may be outside of all pixels */
}

/* Clamps the mean to the range of its inputs: rounding errors are relative to the brightest light, which may be far away. */
static void divide_row(const struct convolution_state *st, int y, const float *sum, float *out)
{
    const struct conv_job *j = &st->job;
    const struct conv_radial *r = &j->radial[j->channel];

    for (int x = j->extent.rect.x0; x < j->extent.rect.x1; x++) {
        const ptrdiff_t at = y * st->sources.front.stride + x, to = y * j->in->shape.stride + x;
        const float uniform = st->uniform[at];
        float m;
        if (st->sources.front.group[at] != j->group + 1)
            continue;
        m = uniform > 0.0f ? sum[x - j->extent.rect.x0] / uniform : j->in->irradiance[j->channel][to];
        m = m < j->extent.brightest[j->channel] ? m : j->extent.brightest[j->channel];
        out[x - j->extent.rect.x0] = r->total * (m > j->extent.darkest[j->channel] ? m : j->extent.darkest[j->channel]);
    }
}

/* Interpolates row y of pixels from rows of images. */
static void gather_row(struct convolution_state *st, int y, const float *const rows[CONV_IMAGES], float *sum)
{
    const struct conv_job *j = &st->job;
    const struct pell_rect *rect = &j->extent.rect;
    const struct conv_front *f = &st->sources.front;
    const int width = rect->x1 - rect->x0;
    const ptrdiff_t at = y * f->stride + rect->x0;
    const struct conv_gather g = {
        f->group + at,
        f->coord + at,
        f->exit_weight[j->channel] + at,
        rows,
        j->layout.planes,
        (uint16_t) (j->group + 1),
        convolution_least(&j->extent, j->channel),
    };
    float *const light = j->out->light[j->channel] + y * j->in->shape.stride + rect->x0;
    float *const out = j->uniform ? st->uniform + at : j->divide || j->level >= 0 ? sum : light;
    int x0, x1;

    find_reached(st, y, &x0, &x1);
    for (int side = 0; side < 2; side++)
        for (int x = side ? x1 : 0; x < (side ? width : x0); x++)
            out[x] = g.group[x] == g.own ? 0.0f : out[x];
    st->kernels->gather(&g, x0, x1, out);
    if (j->edges[j->channel].fade > 0.0f) {
        struct conv_edges edges = j->edges[j->channel];
        edges.light = j->uniform ? NULL : edges.light;
        st->kernels->edges(&edges, y, rect->x0, rect->x1, out - rect->x0);
    }
    if (j->divide && !j->uniform)
        divide_row(st, y, sum, j->level >= 0 ? sum : light);
    if (j->level >= 0 && !j->uniform)
        convolution_blend_row(st, y, sum);
}

/* One band of full-resolution images, and its pixels. */
static void gather_band(void *arg, int band, int worker)
{
    struct convolution_state *st = arg;
    const struct conv_job *j = &st->job;
    const struct pell_rect *rect = &j->extent.rect;
    const int top = j->y0 + band * CONV_BAND, y0 = top > rect->y0 ? top : rect->y0;
    const int y1 = top + CONV_BAND < rect->y1 ? top + CONV_BAND : rect->y1, n = j->layout.planes;
    const size_t size = (size_t) CONV_BAND * (size_t) j->stride;
    float *images = convolution_band_images(st, worker);
    const float *rows[CONV_IMAGES] = { NULL };
    bool which[CONV_IMAGES];
    unsigned seen = st->knobs.visible ? 0 : (1u << n) - 1;

    for (int y = y0; y < y1; y++)
        seen |= st->rows[y - rect->y0].seen;
    find_needed(st, seen, which);
    convolution_transform_back(st, band, worker, which, images, size);
    for (int y = y0; y < y1; y++) {
        for (int i = 0; i < n + j->between; i++)
            rows[i] = which[i] ? images + (size_t) i * size + (y - top) * j->stride + rect->x0 - j->x0 : NULL;
        gather_row(st, y, rows, st->scratch[worker]);
    }
}

static void back_band(void *arg, int band, int worker)
{
    struct convolution_state *st = arg;

    convolution_transform_back(st, band, worker, st->job.seen, st->images + (ptrdiff_t) band * CONV_BAND * st->job.stride,
                               st->format.image_size);
}

static void expand_and_gather(void *arg, int index, int worker)
{
    struct convolution_state *st = arg;
    const struct pell_rect *rect = &st->job.extent.rect;
    const float *rows[CONV_IMAGES] = { NULL };
    float *sum = st->scratch[worker];
    bool which[CONV_IMAGES];

    find_needed(st, st->rows[index].seen, which);
    expand_rows(st, rect->y0 + index, which, sum + (rect->x1 - rect->x0) + 16, rows);
    gather_row(st, rect->y0 + index, rows, sum);
}

void convolution_gather(struct convolution_state *st)
{
    const struct conv_job *j = &st->job;

    if (st->format.step == 1) {
        pell_pool_run(st->pool, j->bands, gather_band, st);
    } else {
        pell_pool_run(st->pool, j->bands, back_band, st);
        pell_pool_run(st->pool, j->extent.rect.y1 - j->extent.rect.y0, expand_and_gather, st);
    }
}
