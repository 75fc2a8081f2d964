/* SPDX-License-Identifier: MIT
 *
 * rasterize.c - the planes of an atlas, and which texels each triangle covers.
 */
#include "methods/texture_space/atlas/internal.h"

#include <string.h>

#define MAX_SKEW 8.0f
#define MIN_LENGTH 1e-9f /* mm per texel */
#define MAX_LENGTH 1e9f

enum pell_result ts_atlas_make_planes(struct ts_atlas_build *b)
{
    struct ts_atlas *a = b->a;
    float **const planes[] = { &a->key, &a->bary[0], &a->bary[1], &a->length[0], &a->length[1], &a->skew, &a->tilt[0], &a->tilt[1] };
    float *block;

    if (a->key)
        pell_free(b->ctx, a->key - TS_MARGIN);
    a->key = NULL;
    pell_free(b->ctx, a->source);
    a->blocks = (a->width + TS_BLOCK - 1) / TS_BLOCK;
    a->width = a->blocks * TS_BLOCK;
    a->stride = a->width + 2 * TS_MARGIN + 16;
    a->size = (size_t) a->stride * (size_t) a->height + 2 * TS_MARGIN;
    block = pell_calloc(b->ctx, a->size * PELL_COUNT(planes), sizeof(float));
    a->source = pell_alloc_array(b->ctx, a->size, sizeof(*a->source));
    for (size_t i = 0; block && i < PELL_COUNT(planes); i++)
        *planes[i] = block + i * a->size + TS_MARGIN;
    if (!block || !a->source)
        return PELL_ERR_NOMEM;
    memset(a->source, 0xff, a->size * sizeof(*a->source));
    return PELL_OK;
}

struct ts_metric ts_atlas_metric_along(const struct ts_atlas *a, uint32_t t, const double u[2], const double v[2])
{
    struct pell_vec3 p[3], e[2], dir[2];
    struct ts_metric m;
    float square;

    corner_points(a, t, p);
    e[0] = vec3_sub(p[1], p[0]);
    e[1] = vec3_sub(p[2], p[0]);
    for (int i = 0; i < 2; i++)
        dir[i] = vec3_mad(vec3_mul(e[0], (float) u[i]), (float) v[i], e[1]);
    square = vec3_dot(dir[0], dir[0]);
    m.skew = square > 0.0f ? vec3_dot(dir[0], dir[1]) / square : 0.0f;
    if (!(fabsf(m.skew) < MAX_SKEW))
        m.skew = 0.0f;
    m.length[0] = fminf(fmaxf(vec3_length(dir[0]), MIN_LENGTH), MAX_LENGTH);
    m.length[1] = fminf(fmaxf(vec3_length(vec3_mad(dir[1], -m.skew, dir[0])), MIN_LENGTH), MAX_LENGTH);
    return m;
}

struct ts_metric ts_atlas_metric_of(const struct ts_atlas *a, uint32_t t, const struct ts_flat *f)
{
    return ts_atlas_metric_along(a, t, &f->u[1], &f->v[1]);
}

void ts_atlas_set_metric(struct ts_atlas *a, ptrdiff_t at, const struct ts_metric *m)
{
    a->length[0][at] = m->length[0];
    a->length[1][at] = m->length[1];
    a->skew[at] = m->skew;
}

static void set_texel(struct ts_atlas *a, ptrdiff_t at, uint32_t t, double u, double v, const struct ts_metric *m)
{
    a->key[at] = (float) a->chart[t];
    a->source[at] = t;
    a->bary[0][at] = (float) u;
    a->bary[1][at] = (float) v;
    ts_atlas_set_metric(a, at, m);
}

void ts_atlas_rasterize(struct ts_atlas_build *b)
{
    struct ts_atlas *a = b->a;

    b->claimed = b->twice = 0;
    for (uint32_t t = 0; t < a->num_triangles && !pell_cancelled_at(b->ctx, t); t++) {
        const float *c = a->corners[t];
        struct ts_flat f;
        struct ts_metric m;
        int y0, y1;
        if (!a->chart[t] || !flatten(c, &f))
            continue;
        m = ts_atlas_metric_of(a, t, &f);
        y0 = (int) floorf(fminf(c[1], fminf(c[3], c[5])) - 0.5f);
        y1 = (int) ceilf(fmaxf(c[1], fmaxf(c[3], c[5])) - 0.5f);
        for (int y = y0 > 0 ? y0 : 0; y <= y1 && y < a->height; y++) {
            int x0 = 0, x1 = a->width - 1;
            row_of(&f, y + 0.5, &x0, &x1);
            for (int x = x0; x <= x1; x++) {
                const double px = x + 0.5, py = y + 0.5;
                const double u = f.u[0] + f.u[1] * px + f.u[2] * py, v = f.v[0] + f.v[1] * px + f.v[2] * py, w = 1.0 - u - v;
                const ptrdiff_t at = y * a->stride + x;
                const double least = fmin(w, fmin(u, v));
                if (least < -1e-9)
                    continue;
                if (a->source[at] != NONE) {
                    /* Well inside both triangles: they overlap. The first one has stored how far inside the texel is. */
                    const double other = fmin(1.0 - (double) a->bary[0][at] - (double) a->bary[1][at],
                                              fmin((double) a->bary[0][at], (double) a->bary[1][at]));
                    b->twice += least > 1e-3 && other > 1e-3;
                    continue;
                }
                b->claimed++;
                set_texel(a, at, t, fmin(fmax(u, 0.0), 1.0), fmin(fmax(v, 0.0), 1.0), &m);
            }
        }
    }
}

void ts_atlas_rescue(struct ts_atlas_build *b)
{
    struct ts_atlas *a = b->a;

    for (uint32_t t = 0; t < a->num_triangles && !pell_cancelled_at(b->ctx, t); t++) {
        const float *c = a->corners[t];
        const float x = (c[0] + c[2] + c[4]) / 3.0f, y = (c[1] + c[3] + c[5]) / 3.0f;
        struct ts_bilinear location;
        ptrdiff_t at;
        struct ts_flat f;
        struct ts_metric m = { .length = { (float) a->mm_per_texel, (float) a->mm_per_texel } };
        if (!a->chart[t] || !(x > 0.0f && y > 0.0f && x < (float) a->width && y < (float) a->height))
            continue;
        location = ts_atlas_locate(a, t, 1.0f / 3.0f, 1.0f / 3.0f);
        if (ts_read(a, &location, NULL, 0, NULL))
            continue;
        at = (ptrdiff_t) y * a->stride + (ptrdiff_t) x;
        if (a->source[at] != NONE)
            continue;
        if (flatten(c, &f))
            m = ts_atlas_metric_of(a, t, &f);
        set_texel(a, at, t, 1.0 / 3.0, 1.0 / 3.0, &m);
        b->claimed++;
    }
}
