/* SPDX-License-Identifier: MIT
 *
 * kernels.c - the march of layered; compiled once per level of base/simd.h. The mathematics is in kernels.h and README.md.
 *
 * Vectors are the compiler's generic ones, as wide as the machine's registers; a lane is a pixel. All levels give the same bits: a pixel's
 * operations and their order do not depend on the width. Loops over layers leave out those that no lane is in, whose share is 0.
 */
#include "methods/layered/layered.h"

#include "base/simd.h"
#include "math/lanes.h"
#include "math/vec.h"

#include <math.h>
#include <string.h>

#define LANES LAYERED_LANES
#define MOST PELL_LAYERS_MOST
#define USUAL 4 /* layers of the usual march, at most */
/* Numbers that are read one by one after they were written together: from memory, not picked out of a register each. */
#define KEEP(array) __asm__("" : "+m"(array))

INLINE vi load_int(const int32_t *p)
{
    vi v;
    memcpy(&v, p, sizeof(v));
    return v;
}

/* Generic vectors are not interleaved by one instruction. */
#if defined(__AVX512F__)
#define low2(a, b) ((vf) _mm512_unpacklo_ps((__m512) (a), (__m512) (b)))
#define high2(a, b) ((vf) _mm512_unpackhi_ps((__m512) (a), (__m512) (b)))
#define low4(a, b) ((vf) _mm512_unpacklo_pd((__m512d) (a), (__m512d) (b)))
#define high4(a, b) ((vf) _mm512_unpackhi_pd((__m512d) (a), (__m512d) (b)))
#elif defined(__AVX2__)
#define low2(a, b) ((vf) _mm256_unpacklo_ps((__m256) (a), (__m256) (b)))
#define high2(a, b) ((vf) _mm256_unpackhi_ps((__m256) (a), (__m256) (b)))
#define low4(a, b) ((vf) _mm256_unpacklo_pd((__m256d) (a), (__m256d) (b)))
#define high4(a, b) ((vf) _mm256_unpackhi_pd((__m256d) (a), (__m256d) (b)))
#elif defined(__SSE2__)
#define low2(a, b) ((vf) _mm_unpacklo_ps((__m128) (a), (__m128) (b)))
#define high2(a, b) ((vf) _mm_unpackhi_ps((__m128) (a), (__m128) (b)))
#define low4(a, b) ((vf) _mm_unpacklo_pd((__m128d) (a), (__m128d) (b)))
#define high4(a, b) ((vf) _mm_unpackhi_pd((__m128d) (a), (__m128d) (b)))
#else
INLINE vf low2(vf a, vf b)
{
    return (vf){ a[0], b[0], a[1], b[1] };
}

INLINE vf high2(vf a, vf b)
{
    return (vf){ a[2], b[2], a[3], b[3] };
}

INLINE vf low4(vf a, vf b)
{
    return (vf){ a[0], a[1], b[0], b[1] };
}

INLINE vf high4(vf a, vf b)
{
    return (vf){ a[2], a[3], b[2], b[3] };
}
#endif

/* 1/sqrt(x) of a positive number within 2e-7 of itself, at less than half the time of a root and a division: a first guess by the number's
 * bits and one step with constants that even its error out (L. Moroz et al. 2018, "Fast Calculation of Inverse Square Root with the Use of
 * Magic Constant"), then a step of third order. */
INLINE vf inverse_root(vf x)
{
    vf y = (vf) (0x5f1ffff9 - ((vi) x >> 1)), t;

    y *= 0.703952253f * (2.38924456f - x * y * y);
    t = x * y * y;
    return y * (1.875f - t * (1.25f - 0.375f * t));
}

INLINE vf between(vf x, float low, float high)
{
    return lesser(greater(x, all(low)), all(high)); /* no number becomes `low` */
}

/* Whole numbers not above, of numbers within 2^30. */
INLINE vf floor_of(vf x)
{
    const vf cut = __builtin_convertvector(__builtin_convertvector(x, vi), vf);
    return cut + (vf) ((cut > x) & (vi) all(-1.0f));
}

#define LN2 0.693147181f
#define THICK 1.0f /* halvings: from here on a series of three terms is not enough */

/* 2^-x, x >= 0, within 3e-6 of itself; no more than 1 below 0, no more than 1e-37 beyond 126 and where x is no number. */
INLINE vf halving(vf x)
{
    const vf y = greater(lesser(x, all(126.0f)), all(0.0f));
    const vi k = __builtin_convertvector(y + 0.5f, vi);
    const vf r = __builtin_convertvector(k, vf) - y;
    const vf p = 0.99999926f + r * (0.69312181f + r * (0.24024745f + r * (0.05591786f + r * 0.0095701019f)));
    return (vf) ((vi) p - (k << 23));
}

/* Two neighbours' numbers, 16 bytes, of lanes k, k + 4, k + 8, ... one behind the other. */
INLINE vf four_apart(const uint16_t *texels, const int32_t *at, int k)
{
#if defined(__AVX512F__)
    __m512i v = _mm512_castsi128_si512(_mm_loadu_si128((const __m128i *) (const void *) (texels + 4 * (ptrdiff_t) at[k])));
    v = _mm512_inserti32x4(v, _mm_loadu_si128((const __m128i *) (const void *) (texels + 4 * (ptrdiff_t) at[k + 4])), 1);
    v = _mm512_inserti32x4(v, _mm_loadu_si128((const __m128i *) (const void *) (texels + 4 * (ptrdiff_t) at[k + 8])), 2);
    return (vf) _mm512_inserti32x4(v, _mm_loadu_si128((const __m128i *) (const void *) (texels + 4 * (ptrdiff_t) at[k + 12])), 3);
#elif defined(__AVX2__)
    const __m128i low = _mm_loadu_si128((const __m128i *) (const void *) (texels + 4 * (ptrdiff_t) at[k]));
    const __m128i high = _mm_loadu_si128((const __m128i *) (const void *) (texels + 4 * (ptrdiff_t) at[k + 4]));
    return (vf) _mm256_inserti128_si256(_mm256_castsi128_si256(low), high, 1);
#else
    vf v;
    memcpy(&v, texels + 4 * (ptrdiff_t) at[k], sizeof(v));
    return v;
#endif
}

/* Numbers 0 to 3 of two neighbours, one behind the other, become four pairs of neighbours. */
INLINE vf paired(vf v)
{
#if defined(__AVX512BW__)
    return (vf) _mm512_shuffle_epi8((__m512i) v,
                                    _mm512_broadcast_i32x4(_mm_setr_epi8(0, 1, 8, 9, 2, 3, 10, 11, 4, 5, 12, 13, 6, 7, 14, 15)));
#elif defined(__AVX2__)
    return (vf) _mm256_shuffle_epi8((__m256i) v,
                                    _mm256_broadcastsi128_si256(_mm_setr_epi8(0, 1, 8, 9, 2, 3, 10, 11, 4, 5, 12, 13, 6, 7, 14, 15)));
#elif defined(__SSE2__)
    return (vf) _mm_unpacklo_epi16((__m128i) v, _mm_unpackhi_epi64((__m128i) v, (__m128i) v));
#else
    const vi a = (vi) v;
    return (vf) (vi){ (a[0] & 0xffff) | (int32_t) ((uint32_t) a[2] << 16), (int32_t) ((uint32_t) a[0] >> 16) | (a[2] & ~0xffff),
                      (a[1] & 0xffff) | (int32_t) ((uint32_t) a[3] << 16), (int32_t) ((uint32_t) a[1] >> 16) | (a[3] & ~0xffff) };
#endif
}

/* Sums of products of pairs of 16 bit numbers. */
INLINE vf weighed(vf pairs, vi weights)
{
#if defined(__AVX512BW__)
    return __builtin_convertvector((vi) _mm512_madd_epi16((__m512i) pairs, (__m512i) weights), vf);
#elif defined(__AVX2__)
    return __builtin_convertvector((vi) _mm256_madd_epi16((__m256i) pairs, (__m256i) weights), vf);
#elif defined(__SSE2__)
    return __builtin_convertvector((vi) _mm_madd_epi16((__m128i) pairs, (__m128i) weights), vf);
#else
    const vi a = (vi) pairs;
    return __builtin_convertvector((a << 16 >> 16) * (weights << 16 >> 16) + (a >> 16) * (weights >> 16), vf);
#endif
}

/* Of all lanes in order: pairs of neighbours, of each number of a texel. */
INLINE void in_order(const vf from[4], vf to[4])
{
    const vf a = low2(from[0], from[1]), b = high2(from[0], from[1]), c = low2(from[2], from[3]), d = high2(from[2], from[3]);

    to[0] = low4(a, c);
    to[1] = high4(a, c);
    to[2] = low4(b, d);
    to[3] = high4(b, d);
}

/* Of two rows; `above` and `below`: where they begin. */
INLINE void fetch(const uint16_t *above, const uint16_t *below, const int32_t *at, const int32_t *at_below, vf first[4], vf second[4])
{
    vf p[4], q[4];

    for (int k = 0; k < 4; k++) {
        p[k] = paired(four_apart(above, at, k));
        q[k] = paired(four_apart(below, at_below, k));
    }
    in_order(p, first);
    in_order(q, second);
}

INLINE vf dot3(const vf a[3], const vf b[3])
{
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

/* `rows`: float [3][LANES]. */
INLINE void load3(const void *rows, int lane, vf to[3])
{
    const float *from = rows;

    for (int k = 0; k < 3; k++)
        to[k] = load(from + k * LANES + lane);
}

/* --- Depths --------------------------------------------------------------------------------------------------------------------- */

/* Texture coordinates brought back to [0, 1]. */
INLINE vf folded(vf u, enum pell_wrap wrap)
{
    if (wrap == PELL_WRAP_CLAMP)
        return between(u, 0.0f, 1.0f);
    u = between(u, -1e6f, 1e6f);
    if (wrap == PELL_WRAP_MIRROR) {
        const vf v = u - 2.0f * floor_of(0.5f * u);
        return between(select(v > 1.0f, 2.0f - v, v), 0.0f, 1.0f);
    }
    return between(u - floor_of(u), 0.0f, 1.0f);
}

/* Depths of the first `count` layers of a pack at (u, v), filtered: two fetches of two neighbours each per lane. */
INLINE void look_up(const struct layered_medium *m, const struct layered_pack *pack, const struct layered_place *place, int lane, int count,
                    vf u, vf v, vf out[4])
{
    const struct pell_texture *t = pack->map->texture;
    const vf w = load(place->width + lane), h = load(place->height + lane);
    const vi stride = load_int(place->stride + lane);
    _Alignas(64) int32_t at[WIDTH], at_below[WIDTH];
    vf x, y, above[4], below[4], fy;
    vi index, column, row, right;

    if (any(~((u >= 0.0f) & (u <= 1.0f) & (v >= 0.0f) & (v <= 1.0f)))) {
        u = folded(u, t->wrap_u);
        v = folded(v, t->wrap_v);
    }
    x = u * w + 0.5f; /* of a border's texel: 0 */
    y = v * h + 0.5f;
    if (t->nearest) {
        x = lesser(floor_of(u * w), w - 1.0f) + 1.0f;
        y = lesser(floor_of(v * h), h - 1.0f) + 1.0f;
    }
    column = __builtin_convertvector(x, vi);
    row = __builtin_convertvector(y, vi);
    right = __builtin_convertvector((x - __builtin_convertvector(column, vf)) * 32767.0f + 0.5f, vi);
    fy = y - __builtin_convertvector(row, vf);
    index = load_int(place->offset + lane) + row * stride + column;
    memcpy(at, &index, sizeof(at));
    KEEP(at);
    if (place->row) { /* of all lanes */
        fetch(pack->texels, pack->texels + 4 * (ptrdiff_t) place->row, at, at, above, below);
    } else {
        index += stride;
        memcpy(at_below, &index, sizeof(at_below));
        KEEP(at_below);
        fetch(pack->texels, pack->texels, at, at_below, above, below);
    }
    right = (right << 16) + (32767 - right);
    for (int i = 0; i < count; i++) {
        const vf a = weighed(above[i], right), b = weighed(below[i], right);
        out[i] = (a + fy * (b - a)) * m->layer[pack->layer[i]].per_number + m->layer[pack->layer[i]].middle;
    }
}

/* Bottoms of all layers; where they cross, the upper one wins. */
INLINE void order_depths(const struct layered_medium *m, vf *depth)
{
    vf above = { 0 };

    for (int j = 0; j < m->count; j++) {
        if (m->layer[j].pack < 0)
            depth[j] = all(m->layer[j].depth);
        above = greater(depth[j], above);
        depth[j] = above;
    }
}

/* --- Phase functions ------------------------------------------------------------------------------------------------------------ */

INLINE vf lobe(const struct layered_phase *f, int k, vf c)
{
    const vf x = greater(f->a[k] + f->b[k] * c, all(1e-12f));
    return f->n[k] / (x * root(x));
}

INLINE vf phase_value(const struct layered_phase *f, vf c)
{
    vf x;

    switch (f->shape) {
    case LAYERED_EVEN: return all(f->n[0]);
    case LAYERED_SCHLICK: x = 1.0f + f->b[0] * c; return f->n[0] / (x * x);
    case LAYERED_RAYLEIGH: return f->n[0] * (1.0f + c * c);
    case LAYERED_TWO_LOBE: return lobe(f, 0, c) + lobe(f, 1, c);
    default: return lobe(f, 0, c);
    }
}

/* --- A step --------------------------------------------------------------------------------------------------------------------- */

/* What all lamps share at a place M. */
struct step {
    float t;
    vf x, per_x, step; /* mm from P, and 1 over it; length of the step */
    vf at[3];          /* M */
    vi far;
    vf depth, own[3];            /* below the own surface, and its normal */
    vf plane[3], down;           /* n_M; how far M is from the plane */
    vf bottom[MOST];             /* of layers at M */
    vf part[MOST], before[MOST]; /* mm of the step in a layer, and of its first half */
    int list[MOST], listed;      /* layers that some lane is in */
    vf tau[3], through[3];       /* of the eye's ray at the start of the step, and in it */
    vf alive, hidden;            /* 1 or 0: light is seen from here; the step ends below the deepest layer */
};

/* A lamp's path to M. */
struct path {
    vf km, cosine, per, rise; /* |KM|, cosine at K and one over it, d|KM|/dx */
    vf beam;                  /* irradiance is power times this */
    vf way[3];                /* unit, from M toward the light */
    vf bottom[MOST];          /* of layers at K */
};

struct ray {
    vf p[3], w[3], n[3], s[3], h, rate, length, exit, exit_rate, exit_normal[3];
    vf per_rate, per_exit_rate, per_length;
};

INLINE void find_layers(const struct layered_work *work, const struct layered_medium *m, const struct ray *ray, struct step *s)
{
    const vf ex = select(s->far, ray->exit_rate, ray->rate), per = select(s->far, ray->per_exit_rate, ray->per_rate);
    const vf low = greater(s->depth - 0.5f * s->step * ex, all(0.0f)), high = s->depth + 0.5f * s->step * ex;
    const vf first = select(s->far, s->depth, low), last = select(s->far, high, s->depth);
    vf above = { 0 }, covered = { 0 };

    s->listed = 0;
    for (int c = 0; c < 3; c++)
        s->through[c] = all(0.0f);
    for (int j = 0; j < m->count; j++) {
        const vf bottom = s->bottom[j];
        vf part, before;
        if (work->exponential) {
            part = greater(lesser(bottom, high) - greater(above, low), all(0.0f)) * per;
            before = greater(lesser(bottom, last) - greater(above, first), all(0.0f)) * per;
        } else {
            part = (vf) ((vi) s->step & (s->depth >= above) & (s->depth < bottom));
            before = 0.5f * part;
        }
        above = bottom;
        if (!any(part > 0.0f))
            continue;
        s->part[j] = part;
        s->before[j] = before;
        s->list[s->listed++] = j;
        covered += part;
        for (int c = 0; c < 3; c++)
            s->through[c] += part * m->layer[j].halves[c];
    }
    s->hidden = (vf) ((vi) all(1.0f) & (s->step - covered > 1e-3f * s->step));
}

/* By planes, (9) and (10). `enters`: K of the step before, from which the lamp is seen. */
INLINE void by_planes(const struct layered_work *work, const struct layered_medium *m, const struct layered_lamp *lamp, int lane,
                      const struct step *s, vf enters[3], struct path *path)
{
    vf to[3], k[3], cosine, c, d2 = all(1.0f);

    load3(lamp->to, lane, to);
    if (!lamp->away) {
        vf length;
        for (int i = 0; i < 3; i++)
            to[i] -= work->refracts ? enters[i] : s->at[i];
        length = 1.0f / root(greater(dot3(to, to), all(1e-12f)));
        for (int i = 0; i < 3; i++)
            to[i] *= length;
    }
    cosine = dot3(s->plane, to);
    path->beam = load(lamp->seen + lane);
    if (work->refracts) {
        const float eta = m->eta, per = 1.0f / eta;
        const vf co = between(cosine, 1e-4f, 1.0f), ci = root(1.0f - (1.0f - co * co) * (per * per));
        const vf rs = (co - eta * ci), ss = (co + eta * ci), rp = (eta * co - ci), sp = (eta * co + ci);
        const vf a = rs * sp, b = rp * ss, whole = ss * sp, whole2 = whole * whole;
        for (int i = 0; i < 3; i++)
            path->way[i] = (to[i] - cosine * s->plane[i]) * per + ci * s->plane[i];
        path->beam *= (vf) ((vi) ((whole2 - 0.5f * (a * a + b * b)) * co / (whole2 * ci)) & (cosine > 0.0f));
        c = ci;
    } else {
        for (int i = 0; i < 3; i++)
            path->way[i] = to[i];
        if (!work->absolute)
            path->beam = (vf) ((vi) path->beam & (cosine > 0.0f));
        c = magnitude(cosine);
    }
    path->cosine = greater(c, all(LAYERED_GRAZING));
    path->per = 1.0f / path->cosine;
    path->km = s->down * path->per;
    path->rise = path->km * s->per_x;
    for (int i = 0; i < 3; i++)
        k[i] = s->at[i] + path->km * path->way[i];
    if (!lamp->away) {
        vf away[3];
        load3(lamp->to, lane, away);
        for (int i = 0; i < 3; i++) {
            away[i] -= k[i];
            enters[i] = k[i];
        }
        d2 = greater(dot3(away, away), all(1e-6f));
        path->beam /= d2;
    } else {
        for (int i = 0; i < 3; i++)
            enters[i] = k[i];
    }
}

INLINE void depths_at(const struct layered_medium *m, const struct layered_packet *p, int lane, const struct ray *ray, const vf k[3],
                      vf *bottom)
{
    vf d[3];

    for (int i = 0; i < 3; i++)
        d[i] = k[i] - ray->p[i];
    for (int i = 0; i < m->packs; i++) {
        const struct layered_place *place = &p->place[i];
        vf g[3], u = load(place->u[0] + lane), v = load(place->v[0] + lane), q[4];
        load3(place->gu, lane, g);
        u += dot3(g, d);
        load3(place->gv, lane, g);
        v += dot3(g, d);
        look_up(m, &m->pack[i], place, lane, m->pack[i].count, u, v, q);
        for (int j = 0; j < m->pack[i].count; j++)
            bottom[m->pack[i].layer[j]] = q[j];
    }
    order_depths(m, bottom);
}

/* |KM| between nodes k and k + 1: a parabola by the slopes on both sides, for chords of what is round rise like roots; between the
 * two. */
INLINE vf bent(const struct layered_work *work, const struct layered_lamp *lamp, int lane, int k, float t)
{
    const float *at = work->node;
    const vf a = load(lamp->km[k] + lane), b = load(lamp->km[k + 1] + lane), slope = (b - a) * (1.0f / (at[k + 1] - at[k]));
    vf bend = { 0 };
    float sides = 0.0f;

    t = t > at[k] ? t < at[k + 1] ? t : at[k + 1] : at[k];
    if (k > 0) {
        const vf before = (a - load(lamp->km[k - 1] + lane)) * (1.0f / (at[k] - at[k - 1]));
        bend += (slope - before) * (1.0f / (at[k + 1] - at[k - 1]));
        sides += 1.0f;
    }
    if (k + 2 < LAYERED_NODES) {
        const vf after = (load(lamp->km[k + 2] + lane) - b) * (1.0f / (at[k + 2] - at[k + 1]));
        bend += (after - slope) * (1.0f / (at[k + 2] - at[k]));
        sides += 1.0f;
    }
    bend = a + slope * (t - at[k]) + bend * ((t - at[k]) * (t - at[k + 1]) / sides);
    return lesser(greater(bend, lesser(a, b)), greater(a, b));
}

/* Between the nodes about t. */
INLINE void by_nodes(const struct layered_work *work, const struct layered_medium *m, const struct layered_lamp *lamp, int lane,
                     const struct ray *ray, const struct step *s, struct path *path)
{
    vf unit;
    float f;
    int k = 0;

    while (k + 2 < LAYERED_NODES && s->t > work->node[k + 1])
        k++;
    f = (s->t - work->node[k]) / (work->node[k + 1] - work->node[k]);
    f = f > 0.0f ? f < 1.0f ? f : 1.0f : 0.0f;
#define BETWEEN(what) (load(lamp->what[k] + lane) + f * (load(lamp->what[k + 1] + lane) - load(lamp->what[k] + lane)))
    path->km = bent(work, lamp, lane, k, s->t);
    path->cosine = BETWEEN(cosine);
    path->per = 1.0f / path->cosine;
    path->beam = BETWEEN(beam);
    path->rise = (load(lamp->km[k + 1] + lane) - load(lamp->km[k] + lane)) * ray->per_length * (1.0f / (work->node[k + 1] - work->node[k]));
#undef BETWEEN
    path->rise = between(path->rise, -1.0f, 20.0f);
    for (int i = 0; i < 3; i++)
        path->way[i] = load(lamp->way[k][i] + lane) + f * (load(lamp->way[k + 1][i] + lane) - load(lamp->way[k][i] + lane));
    unit = 1.0f / root(greater(dot3(path->way, path->way), all(1e-12f)));
    for (int i = 0; i < 3; i++)
        path->way[i] *= unit;
    for (int j = 0; j < m->count; j++) {
        const vf here = load(lamp->depth + (k * m->count + j) * LANES + lane);
        const vf there = load(lamp->depth + ((k + 1) * m->count + j) * LANES + lane);
        path->bottom[j] = here + f * (there - here);
    }
}

INLINE void mix_paths(const struct layered_medium *m, vf planes, const struct path *a, struct path *path)
{
    /* By reciprocals: where the surface bends away the plane's path is the one that is far too long. Where no ray came to the surface the
     * plane alone says how long it is. */
    const vf both = path->km * a->km / greater(planes * path->km + (1.0f - planes) * a->km, all(1e-20f));

    path->km = select((path->km > 0.0f) & (planes < 1.0f), both, a->km);
    path->cosine += planes * (a->cosine - path->cosine);
    path->per = 1.0f / path->cosine;
    path->rise += planes * (a->rise - path->rise);
    path->beam += planes * (a->beam - path->beam);
    for (int i = 0; i < 3; i++)
        path->way[i] += planes * (a->way[i] - path->way[i]);
    for (int j = 0; j < m->count; j++)
        path->bottom[j] += planes * (a->bottom[j] - path->bottom[j]);
}

/* Optical depths of the path from K to M. */
INLINE void attenuation(const struct layered_work *work, const struct layered_medium *m, const struct step *s, const struct path *path,
                        bool both, vf tau[3])
{
    const struct layered_layer *last = &m->layer[m->count - 1];
    vf below = { 0 }, steep = { 0 }, share = all(0.5f), reach, above = { 0 }, per = path->per, per_below = { 0 };
    vf bottom_below = { 0 }, rest;
    vi two = { 0 };

    if (both) {
        const vf c1 = -dot3(s->own, path->way);
        steep = greater(c1, all(1e-3f));
        below = (path->km * path->cosine - s->depth) / (steep + path->cosine);
        below = lesser(greater(below, all(0.0f)), path->km);
        below = (vf) ((vi) below & (c1 > 0.0f));
        two = below > 0.0f;
        share = (vf) ((vi) share & ~two);
        per_below = 1.0f / steep;
        bottom_below = s->depth + below * steep;
    }
    reach = (path->km - below) * path->cosine;
    for (int c = 0; c < 3; c++)
        tau[c] = all(0.0f);
    for (int j = 0; j < m->count; j++) {
        const vf bottom = path->bottom[j] + share * (s->bottom[j] - path->bottom[j]);
        vf part = greater(lesser(reach, bottom) - above, all(0.0f)) * per;
        above = bottom;
        if (any(two)) {
            const vf start = j > 0 ? greater(s->bottom[j > 0 ? j - 1 : 0], s->depth) : s->depth;
            part += (vf) ((vi) (greater(lesser(s->bottom[j], bottom_below) - start, all(0.0f)) * per_below) & two);
        }
        for (int c = 0; c < 3; c++)
            tau[c] += part * m->layer[j].halves[c];
    }
    if (m->bottomless)
        return;
    rest = greater(reach - above, all(0.0f)) * per;
    if (work->rest)
        for (int c = 0; c < 3; c++)
            tau[c] += rest * select(two, all(m->rest[c]), all(last->halves[c]));
    if (any(two)) {
        rest = (vf) ((vi) (greater(bottom_below - greater(s->bottom[m->count - 1], s->depth), all(0.0f)) * per_below) & two);
        for (int c = 0; c < 3; c++)
            tau[c] += rest * m->rest[c];
    }
}

/* Mean light where it is halved `tau` times in the middle and y times from there to either end: 2^-tau sinh(y ln 2)/(y ln 2); by its
 * series, but where some lane is `thick`. */
INLINE vf mean_light(vf tau, vf y, bool thick)
{
    const vf y2 = y * y, size = magnitude(y);
    vf value = halving(tau) * (1.0f + y2 * (LN2 * LN2 / 6.0f + y2 * (LN2 * LN2 * LN2 * LN2 / 120.0f)));

    if (thick)
        value = select(size > THICK, (halving(tau - size) - halving(tau + size)) / (2.0f * LN2 * size), value);
    return value;
}

/* Light of the step: each layer's part of it, from the start down (far: from the end). */
INLINE void scatter(const struct layered_work *work, const struct layered_medium *m, const struct ray *ray, const struct step *s,
                    const struct path *path, const vf light[3], const vf colour[3], vf sum[3])
{
    const vf cosine = -dot3(path->way, ray->w);
    const vf rate = work->exponential ? 1.0f + path->rise : all(1.0f);
    vf start[3], passed[3], weight[3];

    for (int c = 0; c < 3; c++) {
        start[c] = s->tau[c] + light[c];
        weight[c] = path->beam * colour[c] * s->alive;
        passed[c] = all(0.0f);
    }
    if (work->exponential)
        for (int i = 0; i < s->listed; i++)
            for (int c = 0; c < 3; c++)
                start[c] -= path->rise * s->before[s->list[i]] * m->layer[s->list[i]].halves[c];
    for (int i = 0; i < s->listed; i++) {
        const int j = s->list[i];
        const struct layered_layer *layer = &m->layer[j];
        const vf part = s->part[j];
        vf phase = phase_value(&layer->phase[0], cosine);
        for (int c = 0; c < 3; c++) {
            const vf z = rate * part * layer->halves[c], y = 0.5f * z, up = passed[c] + y;
            const vf tau = start[c] + select(s->far, rate * s->through[c] - up, up);
            vf value;
            if (c > 0 && !layer->one_phase)
                phase = phase_value(&layer->phase[c], cosine);
            if (!work->exponential) {
                value = halving(start[c] + y);
            } else {
                value = mean_light(tau, y, any(magnitude(y) > THICK));
            }
            passed[c] += z;
            sum[c] += weight[c] * (phase * part) * (layer->sigma_s[c] * value);
        }
    }
}

/* The Lambert surface below the deepest layer, where this step meets it. */
INLINE void show_bottom(const struct layered_work *work, const struct step *s, const struct path *path, const vf light[3],
                        const vf colour[3], const vf base[3], vf meets, vf sum[3])
{
    const vf facing = greater(dot3(s->own, path->way), all(0.0f)), rate = work->exponential ? 1.0f + path->rise : all(1.0f);

    for (int c = 0; c < 3; c++) {
        const vf back = work->exponential ? path->rise * 0.5f * s->through[c] : all(0.0f);
        sum[c] += meets * path->beam * colour[c] * base[c] * facing * halving(s->tau[c] + light[c] - back + rate * s->through[c]);
    }
}

/* --- The march ------------------------------------------------------------------------------------------------------------------ */

INLINE void find_place(const struct layered_medium *m, const struct layered_packet *p, int lane, const struct ray *ray, struct step *s)
{
    vf blend[3], length, near = s->x * ray->rate;

    s->depth = near;
    s->far = (vi){ 0 };
    if (p->thin) {
        const vf beyond = (ray->exit - s->x) * ray->exit_rate;
        s->far = beyond < near;
        s->depth = greater(select(s->far, beyond, near), all(0.0f));
    }
    for (int k = 0; k < 3; k++) {
        s->at[k] = ray->p[k] + s->x * ray->w[k];
        blend[k] = (1.0f - s->t) * ray->n[k] + s->t * ray->s[k];
    }
    length = 1.0f / root(greater(dot3(blend, blend), all(1e-12f)));
    s->down = all(0.0f);
    for (int k = 0; k < 3; k++) {
        s->plane[k] = blend[k] * length;
        s->own[k] = select(s->far, ray->exit_normal[k], s->plane[k]);
        s->down += (s->t * ray->h * ray->n[k] - s->x * ray->w[k]) * s->plane[k];
    }
    s->down = magnitude(s->down);
    for (int i = 0; i < m->packs; i++) {
        const struct layered_place *place = &p->place[i];
        vf u = load(place->u[0] + lane) + s->x * load(place->du[0] + lane), v = load(place->v[0] + lane) + s->x * load(place->dv[0] + lane);
        vf q[4];
        if (p->thin) {
            u = select(s->far, load(place->u[1] + lane) + s->x * load(place->du[1] + lane), u);
            v = select(s->far, load(place->v[1] + lane) + s->x * load(place->dv[1] + lane), v);
        }
        look_up(m, &m->pack[i], place, lane, m->pack[i].count, u, v, q);
        for (int k = 0; k < m->pack[i].count; k++)
            s->bottom[m->pack[i].layer[k]] = q[k];
    }
    if (m->packs > 0)
        order_depths(m, s->bottom);
}

INLINE void light_step(const struct layered_work *work, const struct layered_medium *m, struct layered_packet *p, int lane,
                       const struct ray *ray, const struct step *s, const struct layered_lamp *lamp, vf enters[3], vf meets, float *trace,
                       vf sum[3])
{
    vf colour[3], light[3];
    struct path path;

    load3(lamp->power, lane, colour);
    if (lamp->any_planes) {
        by_planes(work, m, lamp, lane, s, enters, &path);
        if (trace)
            store(trace, path.km);
        if (m->packs > 0)
            depths_at(m, p, lane, ray, enters, path.bottom);
        else
            for (int j = 0; j < m->count; j++)
                path.bottom[j] = s->bottom[j];
    }
    if (lamp->any_nodes) {
        const struct path planes = path;
        by_nodes(work, m, lamp, lane, ray, s, &path);
        if (lamp->any_planes)
            mix_paths(m, load(lamp->planes + lane), &planes, &path);
    }
    attenuation(work, m, s, &path, lamp->any_nodes || p->thin, light);
    scatter(work, m, ray, s, &path, light, colour, sum);
    if (p->shows_bottom && any(meets > 0.0f)) {
        vf base[3];
        load3(p->color, lane, base);
        show_bottom(work, s, &path, light, colour, base, meets, sum);
    }
}

static __attribute__((noinline)) void march_lanes(const struct layered_work *work, const struct layered_medium *m, struct layered_packet *p,
                        const struct layered_lamp *lamps, int count, int lane)
{
    const int n = work->samples;
    vf sum[3] = { { 0 } }, enters[LAYERED_GROUP][3], gain = load(p->gain + lane);
    struct step s;
    struct ray ray;

    load3(p->p, lane, ray.p);
    load3(p->w, lane, ray.w);
    load3(p->n, lane, ray.n);
    load3(p->s, lane, ray.s);
    load3(p->exit_normal, lane, ray.exit_normal);
    ray.h = load(p->h + lane);
    ray.rate = load(p->rate + lane);
    ray.length = load(p->length + lane);
    ray.exit = load(p->exit + lane);
    ray.exit_rate = load(p->exit_rate + lane);
    ray.per_rate = 1.0f / ray.rate;
    ray.per_exit_rate = 1.0f / ray.exit_rate;
    ray.per_length = 1.0f / greater(ray.length, all(1e-20f));
    for (int l = 0; l < count; l++)
        for (int k = 0; k < 3; k++)
            enters[l][k] = ray.p[k];
    for (int c = 0; c < 3; c++)
        s.tau[c] = all(0.0f);
    s.alive = all(1.0f);
    s.step = ray.length * (1.0f / (float) n);
    if (m->packs == 0)
        order_depths(m, s.bottom);
    for (int i = 0; i < n && any(s.alive > 0.0f); i++) {
        vf meets = { 0 };
        s.t = ((float) i + 0.5f) / (float) n;
        s.x = ray.length * s.t;
        s.per_x = ray.per_length * (1.0f / s.t);
        find_place(m, p, lane, &ray, &s);
        find_layers(work, m, &ray, &s);
        if (p->shows_bottom) {
            const vi ends = i + 1 == n ? load_int(p->ends_deep + lane) : (vi){ 0 };
            meets = (vf) ((vi) s.alive & ((s.hidden > 0.0f) | ends));
        }
        for (int l = 0; l < count; l++)
            light_step(work, m, p, lane, &ray, &s, &lamps[l], enters[l], meets,
                       p->trace && l == 0 ? p->trace + (ptrdiff_t) i * LANES + lane : NULL, sum);
        for (int c = 0; c < 3; c++)
            s.tau[c] += s.through[c];
        if (work->exponential || p->shows_bottom)
            s.alive *= 1.0f - s.hidden;
    }
    for (int c = 0; c < 3; c++) {
        const vf light = sum[c] * gain, kept = load(p->light[c] + lane);
        store(p->light[c] + lane, kept + select((light >= 0.0f) & (light < 1e30f), light, all(0.0f)));
    }
}

/* --- The usual march ------------------------------------------------------------------------------------------------------------ */

/* What march_lanes does, for most packets of most pictures: light by planes alone, of thick bodies, refracted, integrated exactly, through
 * a few layers that one picture paints. Sums over layers are by the differences of neighbours:
 *
 *     Sum sigma_j |reach in j| = reach sigma_n + Sum (sigma_j - sigma_(j+1)) min(reach, bottom_j)
 *
 * `layers` is a constant wherever this is compiled. */
INLINE bool is_usual(const struct layered_work *work, const struct layered_medium *m, const struct layered_packet *p,
                     const struct layered_lamp *lamps, int count)
{
    bool usual = work->exponential && work->refracts && work->rest && !p->thin && !p->shows_bottom && m->count <= USUAL && m->packs <= 1;

    for (int l = 0; l < count; l++)
        usual = usual && !lamps[l].any_nodes;
    for (int i = 0; usual && m->packs > 0 && i < m->pack[0].count; i++)
        usual = m->pack[0].layer[i] == i;
    return usual;
}

/* A lamp as the march goes on: the way to it from where its light came in last. */
struct beam {
    vf to[3], square;  /* mm; away: unit */
    vf seen, light[3]; /* of an irradiance of 1 */
};

/* Where light comes in, and how it goes on from there. */
struct entry {
    vf km, per, strength, way[3];
};

INLINE void enter(const struct layered_lamp *lamp, int lane, float eta, const vf at[3], const vf plane[3], vf down, struct beam *beam,
                  struct entry *entry)
{
    const vf unit = lamp->away ? all(1.0f) : inverse_root(greater(beam->square, all(1e-12f)));
    const float per = 1.0f / eta;
    vf cosine, co, ci, ss, sp, both, turn, top;

    cosine = dot3(plane, beam->to) * unit;
    co = between(cosine, 1e-4f, 1.0f);
    ci = greater((1.0f - per * per) + (per * per) * (co * co), all(1e-12f));
    entry->per = inverse_root(ci);
    ci *= entry->per;
    ss = co + eta * ci;
    sp = eta * co + ci;
    both = ss * sp;
    entry->per = lesser(entry->per, all(1.0f / LAYERED_GRAZING));
    entry->km = down * entry->per;
    turn = ci - cosine * per;
    for (int k = 0; k < 3; k++)
        entry->way[k] = beam->to[k] * (unit * per) + turn * plane[k];
    if (!lamp->away) {
        vf place[3];
        load3(lamp->to, lane, place);
        for (int k = 0; k < 3; k++)
            beam->to[k] = place[k] - (at[k] + entry->km * entry->way[k]);
        beam->square = greater(dot3(beam->to, beam->to), all(1e-6f));
    }
    top = (2.0f * eta) * (co * co) * (ss * ss + sp * sp) * beam->seen; /* (1 - R) co/ci */
    entry->strength = (vf) ((vi) (top / (both * both * beam->square)) & (cosine > 0.0f));
}

INLINE void usual_lanes(const struct layered_work *work, const struct layered_medium *m, struct layered_packet *p,
                        const struct layered_lamp *lamps, int count, int lane, const int layers)
{
    const struct layered_pack *pack = m->packs > 0 ? &m->pack[0] : NULL;
    const struct layered_place *place = p->place;
    const int n = work->samples, painted = pack ? pack->count : 0, painted_above = painted < layers ? painted : layers - 1;
    const struct layered_layer *layer = m->layer, *last = &layer[layers - 1];
    const vf length = load(p->length + lane), rate = load(p->rate + lane), per_rate = 1.0f / rate;
    const vf per_length = 1.0f / greater(length, all(1e-20f)), rise = rate * length * (1.0f / (float) n);
    vf at[3], way[3], normal[3], turn[3], lag[3], gu[3], gv[3], u = { 0 }, v = { 0 }, du = { 0 }, dv = { 0 };
    vf tau[3] = { { 0 } }, alive = all(1.0f), h = load(p->h + lane), gain = load(p->gain + lane);
    vf bottom[USUAL], part[USUAL];
    struct beam beams[LAYERED_GROUP];

    load3(p->p, lane, at);
    load3(p->w, lane, way);
    load3(p->n, lane, normal);
    load3(p->s, lane, turn);
    for (int k = 0; k < 3; k++) {
        turn[k] -= normal[k];
        lag[k] = (h * normal[k]) * per_length - way[k]; /* from M to the plane's point, over x */
    }
    if (pack) {
        u = load(place->u[0] + lane);
        v = load(place->v[0] + lane);
        du = load(place->du[0] + lane);
        dv = load(place->dv[0] + lane);
    }
    load3(place->gu, lane, gu);
    load3(place->gv, lane, gv);
    for (int l = 0; l < count; l++) {
        struct beam *b = &beams[l];
        load3(lamps[l].to, lane, b->to);
        b->seen = load(lamps[l].seen + lane);
        b->square = all(1.0f);
        for (int k = 0; k < 3; k++) {
            b->to[k] -= (vf) ((vi) at[k] & (lamps[l].away ? 0 : -1));
            b->light[k] = all(0.0f);
        }
        if (!lamps[l].away)
            b->square = dot3(b->to, b->to);
    }
    for (int j = 0; j < layers; j++)
        bottom[j] = greater(all(layer[j].depth), j > 0 ? bottom[j > 0 ? j - 1 : 0] : all(0.0f));

    for (int i = 0; i < n; i++) {
        const float t = ((float) i + 0.5f) / (float) n;
        const vf x = length * t, low = rise * (float) i, middle = x * rate, high = rise * (float) (i + 1);
        vf plane[3], m_at[3], numbers[4], slope, unit, above = low, above_middle = low, through[3], half[3];
        unsigned listed = 0;

        for (int k = 0; k < 3; k++) {
            plane[k] = normal[k] + t * turn[k];
            m_at[k] = at[k] + x * way[k];
        }
        unit = inverse_root(greater(dot3(plane, plane), all(1e-12f)));
        slope = magnitude(dot3(lag, plane)) * unit;
        for (int k = 0; k < 3; k++)
            plane[k] *= unit;
        if (pack) {
            vf over = { 0 };
            look_up(m, pack, place, lane, painted, u + x * du, v + x * dv, numbers);
#pragma GCC unroll 4
            for (int j = 0; j < layers; j++) {
                bottom[j] = greater(j < painted ? numbers[j] : all(layer[j].depth), over);
                over = bottom[j];
            }
        }
        for (int c = 0; c < 3; c++)
            through[c] = half[c] = all(0.0f);
#pragma GCC unroll 4
        for (int j = 0; j < layers; j++) {
            const vf end = lesser(greater(bottom[j], low), high), end_middle = lesser(end, middle);
            part[j] = (end - above) * per_rate;
            if (any(part[j] > 0.0f)) {
                const vf before = (end_middle - above_middle) * per_rate;
                listed |= 1u << j;
                for (int c = 0; c < 3; c++) {
                    through[c] += part[j] * layer[j].halves[c];
                    half[c] += before * layer[j].halves[c];
                }
            }
            above = end;
            above_middle = end_middle;
        }
        for (int l = 0; l < count && listed; l++) {
            struct beam *b = &beams[l];
            const vf down = slope * x;
            vf reach, cosine, faster, start[3], other[USUAL] = { { 0 } }, over = { 0 };
            struct entry e;

            enter(&lamps[l], lane, m->eta, m_at, plane, down, b, &e);
            if (p->trace && l == 0)
                store(p->trace + (ptrdiff_t) i * LANES + lane, e.km);
            for (int c = 0; c < 3; c++)
                start[c] = down * last->halves[c];
            if (pack && layers > 1)
                look_up(m, pack, place, lane, painted_above, u + x * du + e.km * dot3(gu, e.way), v + x * dv + e.km * dot3(gv, e.way),
                        other);
#pragma GCC unroll 4
            for (int j = 0; j + 1 < layers; j++) {
                over = greater(pack && j < painted ? other[j] : all(layer[j].depth), over);
                reach = lesser(down, 0.5f * (over + bottom[j]));
                for (int c = 0; c < 3; c++)
                    start[c] += reach * (layer[j].halves[c] - layer[j + 1].halves[c]);
            }
            reach = slope * e.per;
            faster = 1.0f + reach;
            for (int c = 0; c < 3; c++)
                start[c] = tau[c] + start[c] * e.per - reach * half[c];
            e.strength *= alive;
            cosine = -dot3(e.way, way);
#pragma GCC unroll 4
            for (int j = 0; j < layers; j++) {
                if (listed & 1u << j) {
                    const vf depth = faster * part[j], share = e.strength * part[j];
                    const bool thick = any(depth * layer[j].most_halves > 2.0f * THICK);
                    vf phase = phase_value(&layer[j].phase[0], cosine);
                    for (int c = 0; c < 3; c++) {
                        const vf y = depth * (0.5f * layer[j].halves[c]);
                        if (c > 0 && !layer[j].one_phase)
                            phase = phase_value(&layer[j].phase[c], cosine);
                        b->light[c] += share * phase * (layer[j].sigma_s[c] * mean_light(start[c] + y, y, thick));
                        start[c] += 2.0f * y;
                    }
                }
            }
        }
        for (int c = 0; c < 3; c++)
            tau[c] += through[c];
        alive = (vf) ((vi) alive & ~(high - above > 1e-3f * rise));
        if (!any(alive > 0.0f))
            break;
    }
    for (int c = 0; c < 3; c++) {
        vf light = { 0 };
        for (int l = 0; l < count; l++)
            light += load(lamps[l].power[c] + lane) * beams[l].light[c];
        light *= gain;
        store(p->light[c] + lane, load(p->light[c] + lane) + select((light >= 0.0f) & (light < 1e30f), light, all(0.0f)));
    }
}

static void layered_march(const struct layered_work *work, const struct layered_medium *m, struct layered_packet *p,
                          const struct layered_lamp *lamps, int count)
{
    const int usual = is_usual(work, m, p, lamps, count) ? m->count : 0;

    for (int lane = 0; lane < p->count; lane += WIDTH)
        switch (usual) {
        case 1: usual_lanes(work, m, p, lamps, count, lane, 1); break;
        case 2: usual_lanes(work, m, p, lamps, count, lane, 2); break;
        case 3: usual_lanes(work, m, p, lamps, count, lane, 3); break;
        case 4: usual_lanes(work, m, p, lamps, count, lane, 4); break;
        default: march_lanes(work, m, p, lamps, count, lane); break;
        }
}

/* --- The start ------------------------------------------------------------------------------------------------------------------ */

INLINE void cross3(const vf a[3], const vf b[3], vf out[3])
{
    for (int k = 0; k < 3; k++)
        out[k] = a[(k + 1) % 3] * b[(k + 2) % 3] - a[(k + 2) % 3] * b[(k + 1) % 3];
}

INLINE void store3(void *rows, int lane, const vf from[3])
{
    float *to = rows;

    for (int k = 0; k < 3; k++)
        store(to + k * LANES + lane, from[k]);
}

INLINE void unit3(vf a[3])
{
    const vf length = 1.0f / root(greater(dot3(a, a), all(1e-30f)));

    for (int k = 0; k < 3; k++)
        a[k] *= length;
}

/* The mean of a triangle's corners, whose rows are `size` apart. */
INLINE void mean3(const void *rows, int size, int lane, vf u, vf v, vf out[3])
{
    const float *from = rows;
    const vf w = 1.0f - u - v;

    for (int k = 0; k < 3; k++) {
        const float *a = from + k * LANES + lane;
        out[k] = w * load(a) + u * load(a + size * LANES) + v * load(a + 2 * size * LANES);
    }
}

/* Where a pack is looked up: the gradients of u and v over the triangle, whatever way they run. */
INLINE void start_place(const struct layered_pack *pack, const float *uv, const struct layered_packet *p, int lane, const vf a[3],
                        const vf b[3], const vf way[3], struct layered_place *o)
{
    const vf u = load(p->u + lane), v = load(p->v + lane), w = 1.0f - u - v, spacing = load(p->spacing + lane);
    const vf size = all((float) pack->level[0].width * (float) pack->level[0].height);
    vf squares[2], texels;

    for (int d = 0; d < 2; d++) {
        const float *from = uv + d * LANES + lane;
        const vf c0 = load(from), c1 = load(from + 2 * LANES), c2 = load(from + 4 * LANES), here = w * c0 + u * c1 + v * c2;
        vf g[3], along;
        for (int k = 0; k < 3; k++)
            g[k] = (c1 - c0) * a[k] + (c2 - c0) * b[k];
        along = dot3(g, way);
        squares[d] = dot3(g, g);
        store3(d ? o->gv : o->gu, lane, g);
        for (int far = 0; far < 2; far++) {
            store((d ? o->v : o->u)[far] + lane, here);
            store((d ? o->dv : o->du)[far] + lane, along);
        }
    }
    texels = root(squares[0] * squares[1]) * size * (spacing * spacing);
    for (int i = 0; i < WIDTH; i++) {
        o->offset[lane + i] = pack->level[0].offset;
        o->stride[lane + i] = pack->level[0].stride;
        o->width[lane + i] = (float) pack->level[0].width;
        o->height[lane + i] = (float) pack->level[0].height;
    }
    if (!any(texels > 2.0f))
        return;
    for (int i = 0; i < WIDTH; i++) {
        float left = texels[i];
        int level = 0;
        while (level + 1 < pack->levels && left > 2.0f) { /* nearest level: over 2 texels are nearer to 4 than to 1 */
            left *= 0.25f;
            level++;
        }
        o->offset[lane + i] = pack->level[level].offset;
        o->stride[lane + i] = pack->level[level].stride;
        o->width[lane + i] = (float) pack->level[level].width;
        o->height[lane + i] = (float) pack->level[level].height;
    }
}

INLINE void start_lanes(const struct layered_work *work, const struct layered_medium *m, struct layered_packet *p, int lane)
{
    const float eta = work->refracts ? m->eta : 1.0f;
    const vf u = load(p->u + lane), v = load(p->v + lane);
    vf at[3], n[3], s[3], facet[3], eye[3], way[3], corner[3], e1[3], e2[3], a[3], b[3], square, h, co, ci, down, facing, f = { 0 };
    vi fine;

    mean3(p->corner, 3, lane, u, v, at);
    mean3(p->normal, 3, lane, u, v, n);
    mean3(p->plane, 4, lane, u, v, s);
    h = (1.0f - u - v) * load(p->plane[0][3] + lane) + u * load(p->plane[1][3] + lane) + v * load(p->plane[2][3] + lane);
    load3(p->corner[0], lane, corner);
    load3(p->corner[1], lane, e1);
    load3(p->corner[2], lane, e2);
    load3(p->eye, lane, eye);
    for (int k = 0; k < 3; k++) {
        e1[k] -= corner[k];
        e2[k] -= corner[k];
    }
    cross3(e1, e2, facet);
    square = dot3(facet, facet);
    square = (vf) ((vi) (1.0f / greater(square, all(1e-30f))) & (square > 1e-30f));
    cross3(e2, facet, a);
    cross3(facet, e1, b);
    for (int k = 0; k < 3; k++) {
        a[k] *= square;
        b[k] *= square;
    }
    unit3(n);
    unit3(s);
    unit3(facet);
    facing = dot3(facet, eye);
    co = dot3(n, eye);
    fine = (dot3(n, n) > 0.5f) & (co > 1e-3f); /* else a normal that looks away from where its triangle is seen */
    for (int k = 0; k < 3; k++)
        n[k] = select(fine, n[k], select(facing < 0.0f, -facet[k], facet[k]));
    co = between(select(fine, co, magnitude(facing)), 1e-3f, 1.0f);
    ci = root(1.0f - (1.0f - co * co) / (eta * eta));
    if (eta != 1.0f) {
        const vf rs = (co - eta * ci) / (co + eta * ci), rp = (eta * co - ci) / (eta * co + ci);
        f = 0.5f * (rs * rs + rp * rp);
    }
    for (int k = 0; k < 3; k++)
        way[k] = (co / eta - ci) * n[k] - eye[k] / eta;
    down = -dot3(s, way);
    fine = down > -1e3f; /* else no plane */
    for (int k = 0; k < 3; k++)
        s[k] = select(fine, s[k], n[k]);
    h = (vf) ((vi) h & fine);
    down = greater(select(fine, down, ci), all(LAYERED_GRAZING));
    store3(p->p, lane, at);
    store3(p->n, lane, n);
    store3(p->s, lane, s);
    store3(p->facet, lane, facet);
    store3(p->w, lane, way);
    store3(p->exit_normal, lane, way);
    store(p->h + lane, h);
    store(p->gain + lane, (1.0f - f) / (eta * eta));
    store(p->rate + lane, down);
    store(p->length + lane, m->deepest / down);
    store(p->exit + lane, all(LAYERED_FAR));
    store(p->exit_rate + lane, all(1.0f));
    for (int k = 0; k < 3; k++) {
        store(p->color[k] + lane, all(0.0f));
        store(p->light[k] + lane, all(0.0f));
    }
    for (int k = 0; k < m->packs; k++)
        start_place(&m->pack[k], p->uv + (ptrdiff_t) k * 6 * LANES, p, lane, a, b, way, &p->place[k]);
}

static void layered_start(const struct layered_work *work, const struct layered_medium *m, struct layered_packet *p)
{
    for (int lane = 0; lane < LANES; lane += WIDTH)
        start_lanes(work, m, p, lane);
    for (int k = 0; k < m->packs; k++) {
        struct layered_place *o = &p->place[k];
        o->row = o->stride[0];
        for (int i = 1; i < LANES; i++)
            o->row = o->stride[i] == o->row ? o->row : 0;
    }
    for (int i = 0; i < LANES; i++)
        p->ends_deep[i] = -1;
    p->thin = p->shows_bottom = false;
}

/* --- Rays ----------------------------------------------------------------------------------------------------------------------- */

/* How far off the surface rays start: the rounding of coordinates. */
INLINE vf rounding(const vf at[3])
{
    return LAYERED_ROUNDING * greater(greater(magnitude(at[0]), magnitude(at[1])), greater(magnitude(at[2]), all(1e-3f)));
}

INLINE void aim(struct pell_ray16 *r, int lane, const vf from[3], const vf way[3], vf near, vf far)
{
    store(r->ox + lane, from[0]);
    store(r->oy + lane, from[1]);
    store(r->oz + lane, from[2]);
    store(r->dx + lane, way[0]);
    store(r->dy + lane, way[1]);
    store(r->dz + lane, way[2]);
    store(r->tnear + lane, near);
    store(r->tfar + lane, far);
    store(r->time + lane, all(0.0f));
    for (int i = 0; i < WIDTH; i++) {
        r->mask[lane + i] = PELL_RAY_ALL;
        r->id[lane + i] = r->flags[lane + i] = 0;
    }
}

static void layered_leave(const struct layered_packet *p, float size, struct pell_ray16 *r, int32_t *valid)
{
    for (int lane = 0; lane < LANES; lane += WIDTH) {
        vf at[3], way[3], facet[3];
        load3(p->p, lane, at);
        load3(p->w, lane, way);
        load3(p->facet, lane, facet);
        aim(r, lane, at, way, rounding(at) / greater(magnitude(dot3(facet, way)), all(0.05f)),
            lesser(4.0f * load(p->length + lane), all(4.0f * size)));
    }
    for (int i = 0; i < LANES; i++)
        valid[i] = i < p->count ? -1 : 0;
}

static int layered_see(const struct layered_packet *p, int path, bool shadows, struct layered_lamp *lamp, struct pell_ray16 *r,
                       int32_t *valid)
{
    int planes = 0, nodes = 0, rays = 0;

    for (int lane = 0; lane < LANES; lane += WIDTH) {
        vf at[3], facet[3], to[3], normal[3], eye[3], far = all(INFINITY), front, facing, share, lit = { 0 }, off;
        vi asks;
        load3(p->p, lane, at);
        load3(p->facet, lane, facet);
        load3(p->n, lane, normal);
        load3(p->eye, lane, eye);
        load3(lamp->to, lane, to);
        if (!lamp->away) {
            vf distance, per;
            for (int k = 0; k < 3; k++)
                to[k] -= at[k];
            distance = greater(root(dot3(to, to)), all(1e-6f));
            per = 1.0f / distance;
            for (int k = 0; k < 3; k++)
                to[k] *= per;
            far = 0.9999f * distance;
        }
        front = select(dot3(facet, eye) < 0.0f, all(-1.0f), all(1.0f));
        facing = front * dot3(facet, to);
        share = all(path == LAYERED_RAYS ? 0.0f : 1.0f);
        if (path == LAYERED_PLANES_RAYS) {
            const vf x = between(dot3(normal, to) * (1.0f / LAYERED_HORIZON), 0.0f, 1.0f);
            share = (vf) ((vi) (x * x * (3.0f - 2.0f * x)) & (facing > 0.0f));
        }
        for (int c = 0; c < 3; c++)
            lit += load(lamp->power[c] + lane);
        store(lamp->planes + lane, share);
        store(lamp->seen + lane, all(1.0f));
        off = front * rounding(at);
        for (int k = 0; k < 3; k++)
            at[k] += off * facet[k];
        aim(r, lane, at, to, all(0.0f), far);
        asks = (lit > 0.0f) & (share > 0.0f) & (facing > 0.0f) & (shadows ? -1 : 0);
        for (int i = 0; i < WIDTH; i++) {
            const bool on = lane + i < p->count && lit[i] > 0.0f;
            planes |= on && share[i] > 0.0f;
            nodes |= on && share[i] < 1.0f;
            valid[lane + i] = on ? asks[i] : 0;
            rays += on && asks[i];
        }
    }
    lamp->any_planes = planes != 0;
    lamp->any_nodes = nodes != 0;
    return rays;
}

extern const struct layered_kernels PELL_SIMD(layered_kernels);
const struct layered_kernels
    PELL_SIMD(layered_kernels) = { .start = layered_start, .leave = layered_leave, .see = layered_see, .march = layered_march };
