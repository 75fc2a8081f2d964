/* SPDX-License-Identifier: MIT
 * bloom.c - see bloom.h. */
#include "render/post/bloom.h"

#include "base/base.h"
#include "shared/bloom.h"

#define SMALL_SIGMA 2.0 /* pixels of the smaller size: below it the shape of its pixels would show */
#define BAND 16         /* rows per task */

struct task {
    const struct pell_bloom_params *p;
    const struct pell_blur *blur;
    const float *in;
    float *out;
    const float *low[2]; /* both Gaussians */
    const struct pell_blur *blurs;
};

/* Variance of the distribution to points f pixels apart, and of interpolation between them, px^2. */
static double resampling_variance(int f)
{
    double tent = 0.0;

    for (int i = 0; f > 1 && i < f; i++) {
        const double d = i + 0.5;
        tent += 2.0 * d * d * (1.0 - d / f) / f;
    }
    return 2.0 * tent;
}

/* The variance of a Gaussian sampled at whole pixels equals that of the Gaussian, except for tiny ones, which are corrected. */
static void plan(struct pell_blur *b, double sigma, int width, int height)
{
    const int smaller = width < height ? width : height;
    double left, sum = 0.0;

    b->factor = 1;
    while (2 * b->factor * SMALL_SIGMA <= sigma && 2 * b->factor <= smaller && b->factor < PELL_BLUR_MOST)
        b->factor *= 2;
    for (int i = 0; i < 2 * b->factor; i++) /* linear interpolation's weight of a point so far away; they sum to one */
        b->grid_weight[i] =
            b->factor > 1 ? (1.0f - fabsf((float) i + 0.5f - (float) b->factor) / (float) b->factor) / (float) b->factor : 1.0f;
    b->first = b->factor > 1 ? -b->factor / 2 : 0;
    b->last = b->factor > 1 ? b->factor + b->factor / 2 : 1;
    left = fmax(sigma * sigma - resampling_variance(b->factor), 0.0) / ((double) b->factor * b->factor);
    b->width = (width + b->factor - 1) / b->factor;
    b->height = (height + b->factor - 1) / b->factor;
    b->radius = (int) fmin(ceil(4.0 * sqrt(left)), PELL_BLUR_RADIUS);
    for (int i = 0; i <= b->radius; i++) {
        b->tap[i] = left > 0.0 ? (float) exp(-0.5 * i * i / left) : 1.0f;
        sum += (i == 0 ? 1.0 : 2.0) * (double) b->tap[i];
    }
    for (int i = 0; i <= b->radius; i++)
        b->tap[i] = (float) ((double) b->tap[i] / sum);
}

/* Downsamples to the points of the wide grid, in place: first along columns, then along rows. */
static void shrink(void *arg, int band, int worker)
{
    const struct task *t = arg;
    const struct pell_blur *b = t->blur;
    const struct pell_bloom_params *p = t->p;
    const int f = b->factor, from = b->first, to = b->last;
    const int end = (band + 1) * BAND < b->height ? (band + 1) * BAND : b->height;
    (void) worker;

    for (int y = band * BAND; y < end; y++) {
        float *restrict out = t->out + y * p->stride;
        for (int x = 0; x < p->width; x++)
            out[x] = 0.0f;
        for (int k = from; k < to; k++) {
            const float *restrict in = t->in + pell_mirror(y * f + k, p->height) * p->stride;
            const float w = b->grid_weight[k - from];
            for (int x = 0; x < p->width; x++)
                out[x] += w * in[x];
        }
        for (int x = 0; f > 1 && x < b->width; x++) {
            const bool inside = x * f + from >= 0 && x * f + to <= p->width;
            float sum = 0.0f;
            for (int k = from; k < to; k++)
                sum += b->grid_weight[k - from] * out[inside ? x * f + k : pell_mirror(x * f + k, p->width)];
            out[x] = sum; /* it writes behind what it has read, except at x = 0 */
        }
    }
}

static float at_edge(const struct pell_blur *b, const float *in, int x)
{
    float sum = b->tap[0] * in[x];
    for (int i = 1; i <= b->radius; i++)
        sum += b->tap[i] * (in[pell_mirror(x - i, b->width)] + in[pell_mirror(x + i, b->width)]);
    return sum;
}

static void blur_rows(void *arg, int band, int worker)
{
    const struct task *t = arg;
    const struct pell_blur *b = t->blur;
    const int n = b->width, r = b->radius, end = (band + 1) * BAND < b->height ? (band + 1) * BAND : b->height;
    const int left = r < n ? r : n, right = n - r > left ? n - r : left;
    (void) worker;

    for (int y = band * BAND; y < end; y++) {
        const float *restrict in = t->in + y * t->p->stride;
        float *restrict out = t->out + y * t->p->stride;
        for (int x = left; x < right; x++)
            out[x] = b->tap[0] * in[x];
        for (int i = 1; i <= r; i++) {
            const float w = b->tap[i];
            for (int x = left; x < right; x++)
                out[x] += w * (in[x - i] + in[x + i]);
        }
        for (int x = 0; x < left; x++)
            out[x] = at_edge(b, in, x);
        for (int x = right; x < n; x++)
            out[x] = at_edge(b, in, x);
    }
}

static void blur_columns(void *arg, int band, int worker)
{
    const struct task *t = arg;
    const struct pell_blur *b = t->blur;
    const int end = (band + 1) * BAND < b->height ? (band + 1) * BAND : b->height;
    (void) worker;

    for (int y = band * BAND; y < end; y++) {
        const float *middle = t->in + y * t->p->stride;
        float *restrict out = t->out + y * t->p->stride;
        for (int x = 0; x < b->width; x++)
            out[x] = b->tap[0] * middle[x];
        for (int i = 1; i <= b->radius; i++) {
            const float *up = t->in + pell_mirror(y - i, b->height) * t->p->stride,
                        *down = t->in + pell_mirror(y + i, b->height) * t->p->stride;
            const float w = b->tap[i];
            for (int x = 0; x < b->width; x++)
                out[x] += w * (up[x] + down[x]);
        }
    }
}

/* Adds `weight` times a row interpolated from the points of the wide grid. */
static void add(const struct pell_blur *b, const float *low, const struct pell_bloom_params *p, int y, float weight, float *restrict out)
{
    const int f = b->factor, cell = pell_grid_cell(y, f);
    const float wy = pell_grid_fraction(y, f, cell);
    const float *up = low + pell_mirror(cell, b->height) * p->stride, *down = low + pell_mirror(cell + 1, b->height) * p->stride;
    float left, right = up[0] + wy * (down[0] - up[0]);

    for (int x = 0; f == 1 && x < p->width; x++)
        out[x] += weight * low[y * p->stride + x];
    for (int j = -1; f > 1 && j < b->width; j++) {
        const int x = j * f + f / 2, begin = x < 0 ? -x : 0, end = p->width - x < f ? p->width - x : f, next = j + 1 < b->width ? j + 1 : j;
        left = right;
        right = up[next] + wy * (down[next] - up[next]);
        for (int i = begin; i < end; i++)
            out[x + i] += weight * (left + ((float) i + 0.5f) / (float) f * (right - left));
    }
}

/* Adds a fraction of both Gaussians to the attenuated image. */
static void mix(void *arg, int band, int worker)
{
    const struct task *t = arg;
    const struct pell_bloom_params *p = t->p;
    const int end = (band + 1) * BAND < p->height ? (band + 1) * BAND : p->height;
    const float rest = 1.0f - p->fraction, half = 0.5f * p->fraction;
    (void) worker;

    for (int y = band * BAND; y < end; y++) {
        float *restrict out = t->out + y * p->stride;
        for (int x = 0; x < p->width; x++)
            out[x] *= rest;
        for (int k = 0; k < 2; k++)
            add(&t->blurs[k], t->low[k], p, y, half, out);
    }
}

void pell_bloom_plan(const struct pell_bloom_params *params, struct pell_blur blurs[2])
{
    plan(&blurs[0], (double) params->sigma, params->width, params->height);
    plan(&blurs[1], 0.25 * (double) params->sigma, params->width, params->height);
}

void pell_bloom_render(struct pell_pool *pool, const struct pell_bloom_params *params, float *const *planes, size_t count,
                       float *const scratch[PELL_BLOOM_PLANES])
{
    struct pell_blur blurs[2];

    pell_bloom_plan(params, blurs);
    for (size_t c = 0; c < count; c++) {
        struct task t = { .p = params, .blurs = blurs, .low = { scratch[0], scratch[1] } };
        for (int k = 0; k < 2; k++) {
            const int bands = (blurs[k].height + BAND - 1) / BAND;
            t.blur = &blurs[k];
            t.in = planes[c];
            t.out = scratch[k];
            pell_pool_run(pool, bands, shrink, &t);
            t.in = scratch[k];
            t.out = scratch[2];
            pell_pool_run(pool, bands, blur_rows, &t);
            t.in = scratch[2];
            t.out = scratch[k];
            pell_pool_run(pool, bands, blur_columns, &t);
        }
        t.out = planes[c];
        pell_pool_run(pool, (params->height + BAND - 1) / BAND, mix, &t);
    }
}
