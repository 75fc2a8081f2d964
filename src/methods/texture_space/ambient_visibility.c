/* SPDX-License-Identifier: MIT
 *
 * ambient_visibility.c - visibility of the environment at texels. Each texel traces one part of a pattern of directions, a square of 2 x 2
 * or 4 x 4 texels the whole pattern, and a filter with equal weights for all parts combines them: interleaved sampling (Keller and Heidrich
 * 2001).
 */
#include "methods/texture_space/texture_space.h"

#include "base/hash.h"
#include "lights/lights.h"

#include <float.h>
#include <stdatomic.h>
#include <string.h>

enum { ROWS = 16, MAX_SIDE = 4 };
#define FINE 131072  /* texels of a map with squares of 4 x 4 */
#define COARSE 32768 /* texels of a map without interleaving */

struct ambient {
    const struct ts_ambient_params *p;
    float *from, *to; /* source and target of the filter */
    int side, samples;
    bool down;
    _Atomic int64_t rays;
};

int ts_ambient_side(const struct ts_atlas *a)
{
    return a->inner >= FINE ? 4 : a->inner >= COARSE ? 2 : 1;
}

uint32_t ts_ambient_part(int side, int x, int y)
{
    /* Assigns distant parts of the pattern to neighbours: bit-reversed order. */
    const uint32_t u = (uint32_t) (x % side), v = (uint32_t) (y % side), w = u ^ v;

    return side == 4 ? (w & 1) << 3 | (v & 1) << 2 | (w >> 1) << 1 | v >> 1 : side == 2 ? w << 1 | v : 0;
}

struct packet {
    _Alignas(64) int valid[16];
    struct pell_ray16 rays;
    struct pell_vec3 from[16], normal[16], t[16], b[16];
    uint32_t hash[2][16], first[16];
    ptrdiff_t at[16];
    int count;
};

static int trace_packet(const struct ambient *s, struct packet *k)
{
    const float fraction = 1.0f / (float) s->samples;
    const int count = k->count;

    for (int i = 0; i < 16; i++)
        k->valid[i] = i < count ? -1 : 0;
    for (int n = 0; n < s->samples && count > 0; n++) {
        for (int i = 0; i < count; i++) {
            const uint32_t index = k->first[i] + (uint32_t) n;
            struct pell_vec3 d;
            float x, y;
            pell_disc_point(pell_unit_float(pell_sobol0(index) ^ k->hash[0][i]), pell_unit_float(pell_sobol1(index) ^ k->hash[1][i]), &x,
                            &y);
            d = vec3_mad(vec3_mad(vec3_mul(k->normal[i], sqrtf(fmaxf(1.0f - x * x - y * y, 0.0f))), x, k->t[i]), y, k->b[i]);
            k->rays.ox[i] = k->from[i].x;
            k->rays.oy[i] = k->from[i].y;
            k->rays.oz[i] = k->from[i].z;
            k->rays.dx[i] = d.x;
            k->rays.dy[i] = d.y;
            k->rays.dz[i] = d.z;
            k->rays.tnear[i] = 0.0f;
            k->rays.tfar[i] = FLT_MAX;
            k->rays.mask[i] = PELL_RAY_ALL;
        }
        pell_rays_occluded16(s->p->services->rays, k->valid, false, &k->rays);
        for (int i = 0; i < count; i++)
            s->p->seen[k->at[i]] += k->rays.tfar[i] < 0.0f ? 0.0f : fraction;
    }
    k->count = 0;
    return count * s->samples;
}

/* Whether a block, or one within reach of the filter, is needed. */
static bool is_needed(const struct ambient *s, int y, int x)
{
    const struct ts_atlas *a = s->p->atlas;
    const int b = x / TS_BLOCK;

    if (!s->p->need)
        return true;
    for (int j = y - s->side + 1; j < y + s->side; j++)
        for (int i = b - 1; i <= b + 1; i++)
            if (j >= 0 && i >= 0 && j < a->height && i < a->blocks && s->p->need[(ptrdiff_t) j * a->blocks + i])
                return true;
    return false;
}

static void trace_rows(void *arg, int band, int worker)
{
    struct ambient *s = arg;
    const struct ts_atlas *a = s->p->atlas;
    struct packet k;
    int64_t rays = 0;
    bool needed = true;

    (void) worker;
    memset(&k, 0, sizeof(k));
    for (int y = band * ROWS; y < (band + 1) * ROWS && y < a->height; y++)
        for (int r = a->first_run[y]; r < a->first_run[y + 1]; r++)
            for (int x = a->runs[r].from * TS_BLOCK; x < a->runs[r].to * TS_BLOCK; x++) {
                const ptrdiff_t at = y * a->stride + x;
                const int square = s->side * s->side, tile = square > 1 ? 4 * s->side : 1;
                /* Squares within a tile of 4 x 4 have different parts of a longer pattern, so that neighbours sample what one of them
                 * misses. */
                const uint32_t tile_index = (uint32_t) (y / tile * a->width + x / tile);
                const uint32_t part =
                    ts_ambient_part(s->side, x, y) + (uint32_t) square * (tile > 1 ? ts_ambient_part(4, x / s->side, y / s->side) : 0);
                const int i = k.count;
                float largest;
                s->p->seen[at] = 0.0f;
                if (x % TS_BLOCK == 0)
                    needed = is_needed(s, y, x);
                if (a->source[at] == UINT32_MAX || !needed)
                    continue;
                ts_point_of(a, a->source[at], a->bary[0][at], a->bary[1][at], &k.from[i], &k.normal[i], &largest);
                k.from[i] = vec3_mad(k.from[i], 3e-5f * largest, k.normal[i]);
                vec3_basis(k.normal[i], &k.t[i], &k.b[i]);
                k.hash[0][i] = pell_hash(tile_index ^ pell_hash(s->p->seed ^ 0x5851f42du));
                k.hash[1][i] = pell_hash(k.hash[0][i] ^ 0x14057b7eu);
                k.first[i] = part * (uint32_t) s->samples;
                k.at[i] = at;
                if (++k.count == 16)
                    rays += trace_packet(s, &k);
            }
    rays += trace_packet(s, &k);
    atomic_fetch_add_explicit(&s->rays, rays, memory_order_relaxed);
}

/* A tent filter twice as wide as the square, along rows or columns: all parts get the same total weight on either side. */
static void filter_rows(void *arg, int band, int worker)
{
    const struct ambient *s = arg;
    const struct ts_atlas *a = s->p->atlas;
    const ptrdiff_t pitch = s->down ? a->stride : 1;

    (void) worker;
    for (int y = band * ROWS; y < (band + 1) * ROWS && y < a->height; y++)
        for (int r = a->first_run[y]; r < a->first_run[y + 1]; r++)
            for (int x = a->runs[r].from * TS_BLOCK; x < a->runs[r].to * TS_BLOCK; x++) {
                const ptrdiff_t at = y * a->stride + x;
                const int here = s->down ? y : x, most = s->down ? a->height : a->width;
                float sum = 0.0f, total = 0.0f;
                s->to[at] = 0.0f;
                if (a->source[at] == UINT32_MAX)
                    continue;
                for (int j = 1 - s->side; j < s->side; j++) {
                    const ptrdiff_t tap = at + j * pitch;
                    const float weight = (float) (s->side - (j < 0 ? -j : j));
                    if (here + j < 0 || here + j >= most || a->key[tap] != a->key[at] || a->source[tap] == UINT32_MAX)
                        continue;
                    sum += weight * s->from[tap];
                    total += weight;
                }
                s->to[at] = sum / total; /* the centre texel always contributes */
            }
}

int64_t ts_ambient_trace(const struct ts_ambient_params *params)
{
    struct pell_pool *pool = params->services->pool;
    const int bands = (params->atlas->height + ROWS - 1) / ROWS, side = ts_ambient_side(params->atlas);
    const int wanted = params->services->settings->ambient_samples;
    /* A square of 4 x 4 has twice the directions of a pixel, because it covers more than one pixel. */
    struct ambient s = { .p = params, .side = side, .samples = side == 4 ? (wanted + 7) / 8 : (wanted + side * side - 1) / (side * side) };

    pell_pool_run(pool, bands, trace_rows, &s);
    for (int down = 0; side > 1 && down < 2; down++) {
        s.down = down;
        s.from = down ? params->spare : params->seen;
        s.to = down ? params->seen : params->spare;
        pell_pool_run(pool, bands, filter_rows, &s);
    }
    return atomic_load(&s.rays);
}
