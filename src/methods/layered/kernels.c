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

/* e^-x, x >= 0, within 3e-6 of itself; 0 beyond 87 and where x is no number; 1 below 0. */
INLINE vf falling(vf x)
{
    const vf y = between(-x, -87.0f, 0.0f), t = y * 1.44269504f - 0.5f;
    const vi k = __builtin_convertvector(t, vi); /* nearest, for t <= 0 is cut upward */
    const vf kf = __builtin_convertvector(k, vf), r = (y - kf * 0.693359375f) + kf * 2.12194440e-4f;
    const vf p = 1.0f + r * (1.0f + r * (0.5f + r * (1.66666667e-1f + r * (4.16666667e-2f + r * 8.33333333e-3f))));
    return (vf) (((vi) p + (k << 23)) & (y > -86.9f));
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

/* Of all lanes in order: pairs of numbers, those of the left texel first. */
INLINE void fetch(const uint16_t *texels, const int32_t *at, vi out[4])
{
    const vf p = four_apart(texels, at, 0), q = four_apart(texels, at, 1), r = four_apart(texels, at, 2), s = four_apart(texels, at, 3);
    const vf a = low2(p, q), b = high2(p, q), c = low2(r, s), d = high2(r, s);

    out[0] = (vi) low4(a, c);
    out[1] = (vi) high4(a, c);
    out[2] = (vi) low4(b, d);
    out[3] = (vi) high4(b, d);
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

/* The numbers of a pack at (u, v), filtered: two fetches of two neighbours each per lane. */
INLINE void look_up(const struct layered_pack *pack, const struct layered_place *place, int lane, vf u, vf v, vf out[4])
{
    const struct pell_texture *t = pack->map->texture;
    const vf w = load(place->width + lane), h = load(place->height + lane);
    const vi stride = load_int(place->stride + lane);
    const vf tu = folded(u, t->wrap_u), tv = folded(v, t->wrap_v);
    _Alignas(64) int32_t at[WIDTH];
    vf x = tu * w - 0.5f, y = tv * h - 0.5f, x0, y0, fx, fy;
    vi index, above[4], below[4];

    if (t->nearest) {
        x = lesser(floor_of(tu * w), w - 1.0f);
        y = lesser(floor_of(tv * h), h - 1.0f);
    }
    x0 = floor_of(x);
    y0 = floor_of(y);
    fx = x - x0;
    fy = y - y0;
    index = load_int(place->offset + lane) + __builtin_convertvector(y0 + 1.0f, vi) * stride + __builtin_convertvector(x0 + 1.0f, vi);
    memcpy(at, &index, sizeof(at));
    fetch(pack->texels, at, above);
    index += stride;
    memcpy(at, &index, sizeof(at));
    fetch(pack->texels, at, below);
    for (int i = 0; i < pack->count; i++) {
        const int pair = i >> 1, shift = 16 * (i & 1);
#define NUMBER(row, k) __builtin_convertvector((row)[(k) + pair] >> shift & 0xffff, vf)
        const vf a = NUMBER(above, 0), b = NUMBER(above, 2), c = NUMBER(below, 0), d = NUMBER(below, 2);
#undef NUMBER
        const vf left = a + fy * (c - a), right = b + fy * (d - b);
        out[i] = left + fx * (right - left);
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

INLINE void spread(const struct layered_medium *m, const struct layered_pack *pack, const vf q[4], vf *depth)
{
    for (int i = 0; i < pack->count; i++)
        depth[pack->layer[i]] = q[i] * (m->layer[pack->layer[i]].depth * (1.0f / 65535.0f));
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
            s->through[c] += part * m->layer[j].sigma_t[c];
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
        look_up(&m->pack[i], place, lane, u, v, q);
        spread(m, &m->pack[i], q, bottom);
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
            tau[c] += part * m->layer[j].sigma_t[c];
    }
    if (m->bottomless)
        return;
    rest = greater(reach - above, all(0.0f)) * per;
    if (work->rest)
        for (int c = 0; c < 3; c++)
            tau[c] += rest * select(two, all(m->rest[c]), all(last->sigma_t[c]));
    if (any(two)) {
        rest = (vf) ((vi) (greater(bottom_below - greater(s->bottom[m->count - 1], s->depth), all(0.0f)) * per_below) & two);
        for (int c = 0; c < 3; c++)
            tau[c] += rest * m->rest[c];
    }
}

/* Light of the step: each layer's part of it, from the start down (far: from the end), of depth z: e^-tau sinh(z/2)/(z/2). */
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
                start[c] -= path->rise * s->before[s->list[i]] * m->layer[s->list[i]].sigma_t[c];
    for (int i = 0; i < s->listed; i++) {
        const int j = s->list[i];
        const struct layered_layer *layer = &m->layer[j];
        const vf part = s->part[j];
        vf phase = phase_value(&layer->phase[0], cosine);
        for (int c = 0; c < 3; c++) {
            const vf z = rate * part * layer->sigma_t[c], y = 0.5f * z, up = passed[c] + y;
            const vf tau = start[c] + select(s->far, rate * s->through[c] - up, up);
            vf value;
            if (c > 0 && !layer->one_phase)
                phase = phase_value(&layer->phase[c], cosine);
            if (!work->exponential) {
                value = falling(start[c] + y);
            } else {
                const vf y2 = y * y, size = magnitude(y);
                value = falling(tau) * (1.0f + y2 * (1.0f / 6.0f + y2 * (1.0f / 120.0f)));
                if (any(size > 0.7f))
                    value = select(size > 0.7f, (falling(tau - size) - falling(tau + size)) / (2.0f * size), value);
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
        sum[c] += meets * path->beam * colour[c] * base[c] * facing * falling(s->tau[c] + light[c] - back + rate * s->through[c]);
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
        look_up(&m->pack[i], place, lane, u, v, q);
        spread(m, &m->pack[i], q, s->bottom);
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

INLINE void march_lanes(const struct layered_work *work, const struct layered_medium *m, struct layered_packet *p,
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

static void layered_march(const struct layered_work *work, const struct layered_medium *m, struct layered_packet *p,
                          const struct layered_lamp *lamps, int count)
{
    for (int lane = 0; lane < p->count; lane += WIDTH)
        march_lanes(work, m, p, lamps, count, lane);
}

/* --- The start ------------------------------------------------------------------------------------------------------------------ */

static void mean3(const float (*corner)[3][LANES], const float *u, const float *v, float (*out)[LANES])
{
    for (int k = 0; k < 3; k++)
        for (int i = 0; i < LANES; i++)
            out[k][i] = (1.0f - u[i] - v[i]) * corner[0][k][i] + u[i] * corner[1][k][i] + v[i] * corner[2][k][i];
}

static void unit3(float (*a)[LANES])
{
    for (int i = 0; i < LANES; i++) {
        const float square = a[0][i] * a[0][i] + a[1][i] * a[1][i] + a[2][i] * a[2][i];
        const float length = 1.0f / sqrtf(square > 1e-30f ? square : 1e-30f);
        for (int k = 0; k < 3; k++)
            a[k][i] *= length;
    }
}

/* Where the maps are looked up: the gradients of u and v over the triangle, whatever way they run. */
static void start_places(const struct layered_medium *m, struct layered_packet *p)
{
    float e1[3][LANES], e2[3][LANES], n[3][LANES], a[3][LANES], b[3][LANES], area[LANES];

    for (int k = 0; k < 3; k++)
        for (int i = 0; i < LANES; i++) {
            e1[k][i] = p->corner[1][k][i] - p->corner[0][k][i];
            e2[k][i] = p->corner[2][k][i] - p->corner[0][k][i];
        }
#define CROSS(out, x, y)                                                                                                                   \
    for (int k = 0; k < 3; k++)                                                                                                            \
        for (int i = 0; i < LANES; i++)                                                                                                    \
    out[k][i] = x[(k + 1) % 3][i] * y[(k + 2) % 3][i] - x[(k + 2) % 3][i] * y[(k + 1) % 3][i]
    CROSS(n, e1, e2);
    for (int i = 0; i < LANES; i++) {
        const float square = n[0][i] * n[0][i] + n[1][i] * n[1][i] + n[2][i] * n[2][i];
        area[i] = square > 1e-30f ? 1.0f / square : 0.0f;
    }
    CROSS(a, e2, n);
    CROSS(b, n, e1);
#undef CROSS
    for (int k = 0; k < m->packs; k++) {
        const struct layered_pack *pack = &m->pack[k];
        const float(*uv)[2][LANES] = (const float(*)[2][LANES])(p->uv + (ptrdiff_t) k * 6 * LANES);
        struct layered_place *o = &p->place[k];
        for (int i = 0; i < LANES; i++) {
            const float w = 1.0f - p->u[i] - p->v[i];
            float gu2 = 0.0f, gv2 = 0.0f, texels;
            int level = 0;
            o->u[0][i] = w * uv[0][0][i] + p->u[i] * uv[1][0][i] + p->v[i] * uv[2][0][i];
            o->v[0][i] = w * uv[0][1][i] + p->u[i] * uv[1][1][i] + p->v[i] * uv[2][1][i];
            o->du[0][i] = o->dv[0][i] = 0.0f;
            for (int d = 0; d < 3; d++) {
                o->gu[d][i] = ((uv[1][0][i] - uv[0][0][i]) * a[d][i] + (uv[2][0][i] - uv[0][0][i]) * b[d][i]) * area[i];
                o->gv[d][i] = ((uv[1][1][i] - uv[0][1][i]) * a[d][i] + (uv[2][1][i] - uv[0][1][i]) * b[d][i]) * area[i];
                o->du[0][i] += o->gu[d][i] * p->w[d][i];
                o->dv[0][i] += o->gv[d][i] * p->w[d][i];
                gu2 += o->gu[d][i] * o->gu[d][i];
                gv2 += o->gv[d][i] * o->gv[d][i];
            }
            o->u[1][i] = o->u[0][i];
            o->v[1][i] = o->v[0][i];
            o->du[1][i] = o->du[0][i];
            o->dv[1][i] = o->dv[0][i];
            texels = sqrtf(gu2 * gv2) * (float) pack->level[0].width * (float) pack->level[0].height * p->spacing[i] * p->spacing[i];
            while (level + 1 < pack->levels && texels > 2.0f) { /* nearest level: over 2 texels are nearer to 4 than to 1 */
                texels *= 0.25f;
                level++;
            }
            o->offset[i] = pack->level[level].offset;
            o->stride[i] = pack->level[level].stride;
            o->width[i] = (float) pack->level[level].width;
            o->height[i] = (float) pack->level[level].height;
        }
    }
}

static void layered_start(const struct layered_work *work, const struct layered_medium *m, struct layered_packet *p)
{
    const float eta = work->refracts ? m->eta : 1.0f;

    mean3((const float(*)[3][LANES]) p->corner, p->u, p->v, p->p);
    mean3((const float(*)[3][LANES]) p->normal, p->u, p->v, p->n);
    for (int k = 0; k < 3; k++)
        for (int i = 0; i < LANES; i++) {
            p->s[k][i] = (1.0f - p->u[i] - p->v[i]) * p->plane[0][k][i] + p->u[i] * p->plane[1][k][i] + p->v[i] * p->plane[2][k][i];
            p->facet[k][i] = (p->corner[1][(k + 1) % 3][i] - p->corner[0][(k + 1) % 3][i]) *
                                 (p->corner[2][(k + 2) % 3][i] - p->corner[0][(k + 2) % 3][i]) -
                             (p->corner[1][(k + 2) % 3][i] - p->corner[0][(k + 2) % 3][i]) *
                                 (p->corner[2][(k + 1) % 3][i] - p->corner[0][(k + 1) % 3][i]);
        }
    unit3(p->n);
    unit3(p->s);
    unit3(p->facet);
    for (int i = 0; i < LANES; i++) {
        const float nn = p->n[0][i] * p->n[0][i] + p->n[1][i] * p->n[1][i] + p->n[2][i] * p->n[2][i];
        float co = p->n[0][i] * p->eye[0][i] + p->n[1][i] * p->eye[1][i] + p->n[2][i] * p->eye[2][i], ci, f = 0.0f, down = 0.0f;
        p->h[i] = (1.0f - p->u[i] - p->v[i]) * p->plane[0][3][i] + p->u[i] * p->plane[1][3][i] + p->v[i] * p->plane[2][3][i];
        if (!(nn > 0.5f) || !(co > 1e-3f)) { /* a normal that looks away from where its triangle is seen */
            const float facing = p->facet[0][i] * p->eye[0][i] + p->facet[1][i] * p->eye[1][i] + p->facet[2][i] * p->eye[2][i];
            const float side = facing < 0.0f ? -1.0f : 1.0f;
            for (int k = 0; k < 3; k++)
                p->n[k][i] = side * p->facet[k][i];
            co = side * facing;
        }
        co = co > 1e-3f ? co < 1.0f ? co : 1.0f : 1e-3f;
        ci = sqrtf(1.0f - (1.0f - co * co) / (eta * eta));
        if (eta != 1.0f) {
            const float rs = (co - eta * ci) / (co + eta * ci), rp = (eta * co - ci) / (eta * co + ci);
            f = 0.5f * (rs * rs + rp * rp);
        }
        p->gain[i] = (1.0f - f) / (eta * eta);
        for (int k = 0; k < 3; k++) {
            p->w[k][i] = (co / eta - ci) * p->n[k][i] - p->eye[k][i] / eta;
            down -= p->s[k][i] * p->w[k][i];
        }
        if (!(down > -1e3f)) { /* no plane */
            for (int k = 0; k < 3; k++)
                p->s[k][i] = p->n[k][i];
            p->h[i] = 0.0f;
            down = ci;
        }
        p->rate[i] = down > LAYERED_GRAZING ? down : LAYERED_GRAZING;
        p->length[i] = m->deepest / p->rate[i];
        p->exit[i] = LAYERED_FAR;
        p->exit_rate[i] = 1.0f;
        p->ends_deep[i] = -1;
        for (int k = 0; k < 3; k++) {
            p->exit_normal[k][i] = p->w[k][i];
            p->color[k][i] = p->light[k][i] = 0.0f;
        }
    }
    p->thin = p->shows_bottom = false;
    start_places(m, p);
}

extern const struct layered_kernels PELL_SIMD(layered_kernels);
const struct layered_kernels PELL_SIMD(layered_kernels) = { .start = layered_start, .march = layered_march };
