/* SPDX-License-Identifier: MIT
 *
 * read_map.c - the final lookup: each pixel reads the map of its solid at its surface point.
 */
#include "methods/texture_space/state.h"

#include <stdatomic.h>
#include <string.h>

/* If none of the four texels around is valid: the mean of the nearest valid ones, of the same chart or else of any. */
static void look_around(const struct ts_atlas *a, const float *map, const struct ts_bilinear *p, float rgb[3])
{
    const int px = (int) (p->at % a->stride), py = (int) (p->at / a->stride);

    for (int any = 0; any < 2; any++)
        for (int reach = 1; reach <= 4; reach++) {
            float sum[3] = { 0 }, n = 0.0f;
            for (int y = py - reach + 1; y <= py + reach; y++)
                for (int x = px - reach + 1; x <= px + reach; x++) {
                    const float *t = map + 4 * (y * a->stride + x);
                    if (x < 0 || y < 0 || x >= a->width || y >= a->height || !(any ? t[3] > 0.0f : t[3] == p->key))
                        continue;
                    for (int c = 0; c < 3; c++)
                        sum[c] += t[c];
                    n += 1.0f;
                }
            if (n > 0.0f) {
                for (int c = 0; c < 3; c++)
                    rgb[c] = sum[c] / n;
                return;
            }
        }
    rgb[0] = rgb[1] = rgb[2] = 0.0f;
}

static void read_map(const struct ts_solid *solid, uint32_t triangle, float u, float v, float rgb[3])
{
    const struct ts_atlas *a = solid->atlas;
    const struct ts_bilinear p = ts_atlas_locate(a, triangle, u, v);
    const float w[4] = { (1.0f - p.fx) * (1.0f - p.fy), p.fx * (1.0f - p.fy), (1.0f - p.fx) * p.fy, p.fx * p.fy };
    const float *t;
    float sum = 0.0f;

    rgb[0] = rgb[1] = rgb[2] = 0.0f;
    if (p.at < 0)
        return;
    t = solid->map + 4 * (ptrdiff_t) p.at;
    for (int i = 0; i < 4; i++) {
        const float *at = t + 4 * (i % 2 + i / 2 * a->stride);
        if (at[3] != p.key)
            continue;
        sum += w[i];
        for (int c = 0; c < 3; c++)
            rgb[c] += w[i] * at[c];
    }
    if (!(sum > 1e-6f)) {
        look_around(a, solid->map, &p, rgb);
        return;
    }
    for (int c = 0; c < 3; c++)
        rgb[c] /= sum;
}

void ts_unblurred(const struct ts_state *st, const struct ts_solid *solid, double weight[3])
{
    bool done = st->knobs.first != TS_FIRST_UNBLURRED;

    weight[0] = weight[1] = weight[2] = 0.0;
    for (int i = 0; i < solid->profile->count && !done; i++) {
        const double *w = solid->profile->weight[i];
        done = w[0] > 0.0 || w[1] > 0.0 || w[2] > 0.0;
        memcpy(weight, w, 3 * sizeof(*weight));
    }
}

struct gathering {
    struct ts_state *st;
    const struct pell_frame *in;
    const struct pell_frame_light *out;
    _Atomic int64_t pixels;
};

static void gather_rows(void *arg, int band, int worker)
{
    struct gathering *p = arg;
    struct ts_state *st = p->st;
    const struct pell_frame *in = p->in;
    int64_t pixels = 0;

    (void) worker;
    for (int y = in->rect.y0 + band * TS_ROWS; y < in->rect.y0 + (band + 1) * TS_ROWS && y < in->rect.y1; y++)
        for (int x = in->rect.x0; x < in->rect.x1; x++) {
            const ptrdiff_t at = y * in->shape.stride + x;
            const uint32_t mesh = in->material[at] ? in->mesh[at] : PELL_NO_HIT;
            const int32_t index = mesh < st->solids->num_meshes ? st->solids->of_mesh[mesh] : -1;
            const struct ts_solid *solid = index >= 0 ? &st->solid[index] : NULL;
            float rgb[3] = { 0 };
            if (!in->material[at])
                continue;
            pixels++;
            if (solid && solid->atlas) {
                read_map(solid, solid->atlas->first[mesh] + in->triangle[at], in->barycentric[0][at], in->barycentric[1][at], rgb);
                if (st->knobs.first == TS_FIRST_UNBLURRED) {
                    double weight[3];
                    ts_unblurred(st, solid, weight);
                    for (int c = 0; c < 3; c++)
                        rgb[c] += (float) weight[c] * in->irradiance[c][at];
                }
            }
            for (int c = 0; c < 3; c++)
                p->out->light[c][at] = rgb[c];
        }
    atomic_fetch_add_explicit(&p->pixels, pixels, memory_order_relaxed);
}

int64_t ts_read_map(struct ts_state *st, const struct pell_frame *in, const struct pell_frame_light *out)
{
    struct gathering gathering = { .st = st, .in = in, .out = out };

    ts_rows(st, in->rect.y1 - in->rect.y0, gather_rows, &gathering);
    return atomic_load(&gathering.pixels);
}
