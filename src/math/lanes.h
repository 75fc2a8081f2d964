/* SPDX-License-Identifier: MIT
 *
 * lanes.h - vectors as wide as the machine's registers, for kernel files, which are compiled once per level of base/simd.h. Included by
 * nothing else: the names are short, and what they are depends on the level.
 *
 * Vectors are the compiler's generic ones. They have no square root, no test of a mask, and no minimum that becomes one instruction (a
 * tap of a blur takes a fifth less time with it): those are the machine's own, and their portable twins give the same bits.
 */
#ifndef PELL_LANES_H
#define PELL_LANES_H

#include <math.h>
#include <stdbool.h>
#include <stdint.h>
#include <string.h>
#if defined(__SSE2__)
#include <immintrin.h>
#endif

#if defined(__AVX512F__)
#define WIDTH 16
#elif defined(__AVX__)
#define WIDTH 8
#else
#define WIDTH 4
#endif
#define INLINE static inline __attribute__((always_inline))

typedef float vf __attribute__((vector_size(4 * WIDTH)));
typedef int32_t vi __attribute__((vector_size(4 * WIDTH)));

INLINE vf load(const float *p)
{
    vf v;
    memcpy(&v, p, sizeof(v));
    return v;
}

INLINE void store(float *p, vf v)
{
    memcpy(p, &v, sizeof(v));
}

INLINE vf all(float x)
{
    return (vf) { 0 } + x;
}

INLINE vf select(vi mask, vf a, vf b)
{
    return (vf) (((vi) a & mask) | ((vi) b & ~mask));
}

INLINE vf magnitude(vf a)
{
    return (vf) ((vi) a & 0x7fffffff);
}

/* root(v); lesser(a, b) and greater(a, b), which give b where one is no number; any(mask): whether a lane of it is set;
 * members(mask): bit l is that of lane l. */
#if defined(__AVX512F__)
#define root(v) ((vf) _mm512_sqrt_ps((__m512) (v)))
#define lesser(a, b) ((vf) _mm512_min_ps((__m512) (a), (__m512) (b)))
#define greater(a, b) ((vf) _mm512_max_ps((__m512) (a), (__m512) (b)))
#define any(mask) (_mm512_test_epi32_mask((__m512i) (mask), (__m512i) (mask)) != 0)
#define members(mask) ((uint32_t) _mm512_test_epi32_mask((__m512i) (mask), (__m512i) (mask)))
#elif defined(__AVX__)
#define root(v) ((vf) _mm256_sqrt_ps((__m256) (v)))
#define lesser(a, b) ((vf) _mm256_min_ps((__m256) (a), (__m256) (b)))
#define greater(a, b) ((vf) _mm256_max_ps((__m256) (a), (__m256) (b)))
#define any(mask) (!_mm256_testz_si256((__m256i) (mask), (__m256i) (mask)))
#define members(mask) ((uint32_t) _mm256_movemask_ps((__m256) (mask)))
#elif defined(__SSE2__)
#define root(v) ((vf) _mm_sqrt_ps((__m128) (v)))
#define lesser(a, b) ((vf) _mm_min_ps((__m128) (a), (__m128) (b)))
#define greater(a, b) ((vf) _mm_max_ps((__m128) (a), (__m128) (b)))
#define any(mask) (_mm_movemask_ps((__m128) (mask)) != 0)
#define members(mask) ((uint32_t) _mm_movemask_ps((__m128) (mask)))
#else
INLINE vf root(vf v)
{
    for (int l = 0; l < WIDTH; l++)
        v[l] = sqrtf(v[l]);
    return v;
}

INLINE vf lesser(vf a, vf b)
{
    return select(a < b, a, b);
}

INLINE vf greater(vf a, vf b)
{
    return select(a > b, a, b);
}

INLINE bool any(vi mask)
{
    int some = 0;
    for (int l = 0; l < WIDTH; l++)
        some |= mask[l];
    return some != 0;
}

INLINE uint32_t members(vi mask)
{
    uint32_t set = 0;
    for (int l = 0; l < WIDTH; l++)
        set |= (uint32_t) (mask[l] & 1) << l;
    return set;
}
#endif

#endif
