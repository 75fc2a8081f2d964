/* SPDX-License-Identifier: MIT
 *
 * march.h - functions shared by the two marches of layered: depth lookups, phase functions, powers of one half. Included by kernel files
 * only.
 *
 * Vectors are the compiler's generic ones, as wide as the machine's registers; a lane is a pixel. All SIMD levels give the same bits: the
 * operations on a pixel and their order do not depend on the width.
 */
#ifndef PELL_LAYERED_MARCH_H
#define PELL_LAYERED_MARCH_H

#include "methods/layered/layered.h"

#include "base/simd.h"
#include "math/lanes.h"

#include <math.h>
#include <string.h>

#define LANES LAYERED_LANES
#define MOST PELL_LAYERS_MOST
/* Forces an array into memory: it is written as a vector and read by scalar loads, which are cheaper than extracting lanes. */
#define IN_MEMORY(array) __asm__("" : "+m"(array))

INLINE vi load_int(const int32_t *p)
{
    vi v;
    memcpy(&v, p, sizeof(v));
    return v;
}

/* 1/sqrt(x) of a positive number with a relative error below 2e-7, in less than half the time of a square root and a division: an initial
 * guess from the bits, one step with constants that equalise its error (L. Moroz et al. 2018, "Fast Calculation of Inverse Square Root with
 * the Use of Magic Constant"), then one step of third order. */
INLINE vf inverse_root(vf x)
{
    vf y = (vf) (0x5f1ffff9 - ((vi) x >> 1)), t;

    y *= 0.703952253f * (2.38924456f - x * y * y);
    t = x * y * y;
    return y * (1.875f - t * (1.25f - 0.375f * t));
}

INLINE vf clamped(vf x, float low, float high)
{
    return vmin(vmax(x, splat(low)), splat(high)); /* NaN becomes `low` */
}

/* Floor of numbers within 2^30. */
INLINE vf floor_v(vf x)
{
    const vf cut = __builtin_convertvector(__builtin_convertvector(x, vi), vf);
    return cut + (vf) ((cut > x) & (vi) splat(-1.0f));
}

#define LN2 0.693147181f
#define THICK 1.0f /* in halvings: above this three terms of the series are not enough */

#define ROUND 12582912.0f /* 1.5 * 2^23: adding it rounds to an integer, which the low bits of the sum then hold */

/* 2^-x for x >= 0, relative error below 3e-6; 1 for x < 0, which can follow from a path's slope; 1e-38 for x > 126 and for NaN. */
INLINE vf exp2_neg(vf x)
{
    const vf y = vmax(vmin(x, splat(126.0f)), splat(0.0f)), k = y + ROUND, r = (k - ROUND) - y;
    const vf p = 0.99999926f + r * (0.69312181f + r * (0.24024745f + r * (0.05591786f + r * 0.0095701019f)));
    return (vf) ((vi) p - ((vi) k << 23));
}

/* Mean transmittance over an interval with the optical depth `tau` at its middle and tau +- y at its ends, base 2: 2^-tau sinh(y ln 2)/(y
 * ln 2). Evaluated as a series unless some lane is `thick`. */
INLINE vf mean_transmittance(vf tau, vf y, bool thick)
{
    const vf y2 = y * y, size = vabs(y);
    vf value = exp2_neg(tau) * (1.0f + y2 * (LN2 * LN2 / 6.0f + y2 * (LN2 * LN2 * LN2 * LN2 / 120.0f)));

    if (thick)
        value = select(size > THICK, (exp2_neg(tau - size) - exp2_neg(tau + size)) / (2.0f * LN2 * size), value);
    return value;
}

/* Sums of products of pairs of 16-bit numbers. */
INLINE vf madd_pairs(vf pairs, vi weights)
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

/* Fetches a texel and its right neighbour, 32 bytes, for each lane: their pairs of values in lane order. */
INLINE void fetch(const uint16_t *texels, const int32_t *at, vf left[4], vf right[4])
{
#define TEXEL(lane) ((const void *) (texels + 8 * (ptrdiff_t) at[lane]))
    vf p[4], q[4];

#if defined(__AVX512F__)
    vf first[4], second[4];
    for (int k = 0; k < 4; k++) {
        p[k] = (vf) _mm512_inserti64x4(_mm512_castsi256_si512(_mm256_loadu_si256(TEXEL(k))), _mm256_loadu_si256(TEXEL(k + 4)), 1);
        q[k] = (vf) _mm512_inserti64x4(_mm512_castsi256_si512(_mm256_loadu_si256(TEXEL(k + 8))), _mm256_loadu_si256(TEXEL(k + 12)), 1);
    }
    transpose4(p, first);
    transpose4(q, second);
    for (int k = 0; k < 4; k++) {
        left[k] = (vf) _mm512_shuffle_i32x4((__m512i) first[k], (__m512i) second[k], 0x88);
        right[k] = (vf) _mm512_shuffle_i32x4((__m512i) first[k], (__m512i) second[k], 0xdd);
    }
#elif defined(__AVX2__)
    vf first[4], second[4];
    for (int k = 0; k < 4; k++) {
        p[k] = (vf) _mm256_loadu_si256(TEXEL(k));
        q[k] = (vf) _mm256_loadu_si256(TEXEL(k + 4));
    }
    transpose4(p, first);
    transpose4(q, second);
    for (int k = 0; k < 4; k++) {
        left[k] = (vf) _mm256_permute2x128_si256((__m256i) first[k], (__m256i) second[k], 0x20);
        right[k] = (vf) _mm256_permute2x128_si256((__m256i) first[k], (__m256i) second[k], 0x31);
    }
#else
    for (int k = 0; k < 4; k++) {
        memcpy(&p[k], TEXEL(k), sizeof(p[k]));
        memcpy(&q[k], (const char *) TEXEL(k) + sizeof(p[k]), sizeof(q[k]));
    }
    transpose4(p, left);
    transpose4(q, right);
#endif
#undef TEXEL
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

/* --- Layer depths --------------------------------------------------------------------------------------------------------------- */

/* Applies the wrap mode: texture coordinates in [0, 1]. */
INLINE vf wrapped_uv(vf u, enum pell_wrap wrap)
{
    if (wrap == PELL_WRAP_CLAMP)
        return clamped(u, 0.0f, 1.0f);
    u = clamped(u, -1e6f, 1e6f);
    if (wrap == PELL_WRAP_MIRROR) {
        const vf v = u - 2.0f * floor_v(0.5f * u);
        return clamped(select(v > 1.0f, 2.0f - v, v), 0.0f, 1.0f);
    }
    return clamped(u - floor_v(u), 0.0f, 1.0f);
}

/* Bilinear lookup of the first `count` values of a pack at (u, v): one fetch of four neighbours per lane. The result is signed and scaled
 * by 32767. */
INLINE void look_up_values(const struct layered_pack *pack, const struct layered_lookup *lookup, int lane, int count, vf u, vf v, vf out[4])
{
    const struct pell_texture *t = pack->map->texture;
    const vf w = load(lookup->width + lane), h = load(lookup->height + lane);
    _Alignas(64) int32_t at[WIDTH];
    vf x, y, left[4], right[4], fraction;
    vi index, column, row, below;

    if (any(~((u >= 0.0f) & (u <= 1.0f) & (v >= 0.0f) & (v <= 1.0f)))) {
        u = wrapped_uv(u, t->wrap_u);
        v = wrapped_uv(v, t->wrap_v);
    }
    x = u * w + 0.5f; /* 0 is the centre of the border texel */
    y = v * h + 0.5f;
    if (t->nearest) {
        x = vmin(floor_v(u * w), w - 1.0f) + 1.0f;
        y = vmin(floor_v(v * h), h - 1.0f) + 1.0f;
    }
    column = __builtin_convertvector(x, vi);
    row = __builtin_convertvector(y, vi);
    below = __builtin_convertvector((y - __builtin_convertvector(row, vf)) * 32767.0f + 0.5f, vi);
    fraction = x - __builtin_convertvector(column, vf);
    index = load_int(lookup->offset + lane) + row * load_int(lookup->stride + lane) + column;
    memcpy(at, &index, sizeof(at));
    IN_MEMORY(at);
    fetch(pack->texels, at, left, right);
    below = (below << 16) + (32767 - below);
    for (int i = 0; i < count; i++) {
        const vf a = madd_pairs(left[i], below), b = madd_pairs(right[i], below);
        out[i] = a + fraction * (b - a);
    }
}

/* Depths of the first `count` layers of a pack. */
INLINE void look_up(const struct layered_medium *m, const struct layered_pack *pack, const struct layered_lookup *lookup, int lane,
                    int count, vf u, vf v, vf out[4])
{
    look_up_values(pack, lookup, lane, count, u, v, out);
    for (int i = 0; i < count; i++)
        out[i] = out[i] * m->layer[pack->layer[i]].depth_scale + m->layer[pack->layer[i]].middle;
}

/* Bottoms of all layers; where they cross, the upper one has precedence. */
INLINE void order_depths(const struct layered_medium *m, vf *depth)
{
    vf above = { 0 };

    for (int j = 0; j < m->count; j++) {
        if (m->layer[j].pack < 0)
            depth[j] = splat(m->layer[j].depth);
        above = vmax(depth[j], above);
        depth[j] = above;
    }
}

/* --- Phase functions ------------------------------------------------------------------------------------------------------------ */

INLINE vf lobe(const struct pell_phase_terms *f, int k, vf c)
{
    const vf x = vmax(f->a[k] + f->b[k] * c, splat(1e-12f));
    return PELL_PHASE_HENYEY_GREENSTEIN(f->n[k], x, vsqrt(x));
}

INLINE vf phase_value(const struct pell_phase_terms *f, vf c)
{
    switch (f->shape) {
    case PELL_PHASE_TERMS_ISOTROPIC: return splat(f->n[0]);
    case PELL_PHASE_TERMS_SCHLICK: return PELL_PHASE_SCHLICK_OF(f->n[0], 1.0f + f->b[0] * c);
    case PELL_PHASE_TERMS_RAYLEIGH: return PELL_PHASE_RAYLEIGH_OF(f->n[0], c);
    case PELL_PHASE_TERMS_TWO_LOBE: return lobe(f, 0, c) + lobe(f, 1, c);
    default: return lobe(f, 0, c);
    }
}

/* march.c: for any packet. */
void PELL_SIMD(layered_march_any)(const struct layered_work *work, const struct layered_medium *m, struct layered_packet *p,
                                  const struct layered_light *sources, int count);
/* march_fast.c: for the common case; returns false if the packet is not supported. */
bool PELL_SIMD(layered_march_fast)(const struct layered_work *work, const struct layered_medium *m, struct layered_packet *p,
                                   const struct layered_light *sources, int count);

#endif
