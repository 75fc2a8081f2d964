/* SPDX-License-Identifier: MIT
 *
 * lanes.h - SIMD vectors of the native register width, for kernel files, which are compiled once per level of base/simd.h. Only kernel
 * files may include it: the names are short, and the types depend on the level.
 *
 * The types are the compiler's vector extensions. These have no square root, no mask test, and no minimum that compiles to one instruction
 * (a blur tap takes a fifth less time with it): intrinsics provide them, and the portable fallbacks give the same bits.
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

/* x in every lane. */
INLINE vf splat(float x)
{
    return (vf) { 0 } + x;
}

INLINE vf select(vi mask, vf a, vf b)
{
    return (vf) (((vi) a & mask) | ((vi) b & ~mask));
}

INLINE vf vabs(vf a)
{
    return (vf) ((vi) a & 0x7fffffff);
}

/* vsqrt(v): square root; vmin(a, b), vmax(a, b): minimum and maximum, b if one operand is NaN; any(mask): whether a lane is set;
 * movemask(mask): a bit mask with lane l at bit l. */
#if defined(__AVX512F__)
typedef __m512 machine;
#define MACHINE(op) (vf) _mm512_##op##_ps
#define any(mask) (_mm512_test_epi32_mask((__m512i) (mask), (__m512i) (mask)) != 0)
#define movemask(mask) ((uint32_t) _mm512_test_epi32_mask((__m512i) (mask), (__m512i) (mask)))
#elif defined(__AVX__)
typedef __m256 machine;
#define MACHINE(op) (vf) _mm256_##op##_ps
#define any(mask) (!_mm256_testz_si256((__m256i) (mask), (__m256i) (mask)))
#define movemask(mask) ((uint32_t) _mm256_movemask_ps((__m256) (mask)))
#elif defined(__SSE2__)
typedef __m128 machine;
#define MACHINE(op) (vf) _mm_##op##_ps
#define any(mask) (_mm_movemask_ps((__m128) (mask)) != 0)
#define movemask(mask) ((uint32_t) _mm_movemask_ps((__m128) (mask)))
#else
INLINE vf vsqrt(vf v)
{
    for (int l = 0; l < WIDTH; l++)
        v[l] = sqrtf(v[l]);
    return v;
}

INLINE vf vmin(vf a, vf b)
{
    return select(a < b, a, b);
}

INLINE vf vmax(vf a, vf b)
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

INLINE uint32_t movemask(vi mask)
{
    uint32_t set = 0;
    for (int l = 0; l < WIDTH; l++)
        set |= (uint32_t) (mask[l] & 1) << l;
    return set;
}
#endif
#if defined(__SSE2__)
#define vsqrt(v) (MACHINE(sqrt)((machine) (v)))
#define vmin(a, b) (MACHINE(min)((machine) (a), (machine) (b)))
#define vmax(a, b) (MACHINE(max)((machine) (a), (machine) (b)))
#endif

/* Transposes 4 x 4 floats; of longer vectors each group of four lanes separately. */
INLINE void transpose4(const vf from[4], vf to[4])
{
#if defined(__SSE2__)
    const vf a = MACHINE(unpacklo)((machine) from[0], (machine) from[1]), b = MACHINE(unpackhi)((machine) from[0], (machine) from[1]);
    const vf c = MACHINE(unpacklo)((machine) from[2], (machine) from[3]), d = MACHINE(unpackhi)((machine) from[2], (machine) from[3]);

    to[0] = MACHINE(shuffle)((machine) a, (machine) c, 0x44);
    to[1] = MACHINE(shuffle)((machine) a, (machine) c, 0xee);
    to[2] = MACHINE(shuffle)((machine) b, (machine) d, 0x44);
    to[3] = MACHINE(shuffle)((machine) b, (machine) d, 0xee);
#else
    for (int k = 0; k < 4; k++)
        to[k] = (vf) { from[0][k], from[1][k], from[2][k], from[3][k] };
#endif
}

/* Looks up table[k[l]] in each lane l; the table has 32 entries and is aligned to 64 bytes. */
INLINE vf lookup32(const float *table, vi k)
{
#if defined(__AVX512F__)
    return (vf) _mm512_permutex2var_ps((__m512) load(table), (__m512i) k, (__m512) load(table + 16));
#elif defined(__AVX2__)
    return (vf) _mm256_i32gather_ps(table, (__m256i) k, 4);
#else
    vf v;
    for (int l = 0; l < WIDTH; l++)
        v[l] = table[k[l]];
    return v;
#endif
}

#endif
