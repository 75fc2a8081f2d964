/* SPDX-License-Identifier: MIT
 *
 * chunks.h - rows of pixels by the vector: their ends, which pixels are of a group, numbers of a table for each.
 */
#ifndef PELL_CONVOLUTION_CHUNKS_H
#define PELL_CONVOLUTION_CHUNKS_H

#include "math/lanes.h"

#include <stddef.h>
#include <stdint.h>
#include <string.h>

typedef uint16_t vh __attribute__((vector_size(2 * WIDTH)));

#define INTS(v) __builtin_convertvector(v, vi) /* towards 0 */
#define FLOATS(v) __builtin_convertvector(v, vf)

INLINE vf within(vf x, float low, float high)
{
    return lesser(greater(x, all(low)), all(high));
}

INLINE vi choose(vi mask, vi a, vi b)
{
    return (a & mask) | (b & ~mask);
}

INLINE vf lanes_from(float first)
{
    vf v;
    for (int l = 0; l < WIDTH; l++)
        v[l] = (float) l;
    return v + first;
}

/* The first n floats, others 0. */
INLINE vf load_some(const float *p, int n)
{
    vf v = { 0 };

    if (n >= WIDTH)
        return load(p);
    memcpy(&v, p, (size_t) n * sizeof(float));
    return v;
}

INLINE void store_some(float *p, vf v, int n)
{
    if (n >= WIDTH)
        store(p, v);
    else
        memcpy(p, &v, (size_t) n * sizeof(float));
}

INLINE vi groups_of(const uint16_t *group, int n)
{
    vh v = { 0 };

    if (n >= WIDTH)
        memcpy(&v, group, sizeof(v));
    else
        memcpy(&v, group, (size_t) n * sizeof(*group));
    return __builtin_convertvector(v, vi);
}

/* Which of the first n are `own`. */
INLINE vi which(const uint16_t *group, uint16_t own, int n)
{
    return (groups_of(group, n) == (vi) { 0 } + own) & (lanes_from(0.0f) < all((float) n));
}

/* table[at] of each lane: by loads, which beat gathers on many machines and never lose much; and so do loads of the numbers beat taking a
 * vector apart: IN_MEMORY keeps compilers from that. */
#if defined(__GNUC__)
#define IN_MEMORY(array) __asm__("" : "+m"(array))
#else
#define IN_MEMORY(array) ((void) (array))
#endif
INLINE vf pick(const float *table, vi at)
{
    _Alignas(64) int32_t i[WIDTH];
    vf v;

    memcpy(i, &at, sizeof(at));
    IN_MEMORY(i);
    for (int l = 0; l < WIDTH; l++)
        v[l] = table[i[l]];
    return v;
}

/* Four floats at table + 4 at of each lane. */
INLINE void pick4(const float *table, vi at, vf out[4])
{
    _Alignas(64) int32_t i[WIDTH];

    memcpy(i, &at, sizeof(at));
    IN_MEMORY(i);
#if defined(__SSE2__)
    vf rows[4];
    for (int k = 0; k < 4; k++) { /* lanes k, 4 + k, 8 + k .. */
#if defined(__AVX512F__)
        const __m256 low = _mm256_insertf128_ps(_mm256_castps128_ps256(_mm_loadu_ps(table + 4 * (ptrdiff_t) i[k])),
                                                _mm_loadu_ps(table + 4 * (ptrdiff_t) i[4 + k]), 1);
        const __m256 high = _mm256_insertf128_ps(_mm256_castps128_ps256(_mm_loadu_ps(table + 4 * (ptrdiff_t) i[8 + k])),
                                                 _mm_loadu_ps(table + 4 * (ptrdiff_t) i[12 + k]), 1);
        rows[k] = (vf) _mm512_insertf32x8(_mm512_castps256_ps512(low), high, 1);
#elif defined(__AVX__)
        rows[k] = (vf) _mm256_insertf128_ps(_mm256_castps128_ps256(_mm_loadu_ps(table + 4 * (ptrdiff_t) i[k])),
                                            _mm_loadu_ps(table + 4 * (ptrdiff_t) i[4 + k]), 1);
#else
        rows[k] = (vf) _mm_loadu_ps(table + 4 * (ptrdiff_t) i[k]);
#endif
    }
    turn4(rows, out);
#else
    for (int l = 0; l < WIDTH; l++)
        for (int k = 0; k < 4; k++)
            out[k][l] = table[4 * (ptrdiff_t) i[l] + k];
#endif
}

INLINE vf mix_of(vf low, vf high, vf part)
{
    return low + part * (high - low);
}

#endif
