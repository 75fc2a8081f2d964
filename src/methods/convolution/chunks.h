/* SPDX-License-Identifier: MIT
 *
 * chunks.h - vector access to rows of pixels: partial vectors at their ends, masks of pixels in a group, table lookups per lane.
 */
#ifndef PELL_CONVOLUTION_CHUNKS_H
#define PELL_CONVOLUTION_CHUNKS_H

#include "math/lanes.h"

#include <stddef.h>
#include <stdint.h>
#include <string.h>

typedef uint16_t vh __attribute__((vector_size(2 * WIDTH)));

#define INTS(v) __builtin_convertvector(v, vi) /* truncates */
#define FLOATS(v) __builtin_convertvector(v, vf)

INLINE vf within(vf x, float low, float high)
{
    return vmin(vmax(x, splat(low)), splat(high));
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

/* The first n floats; the others are 0. */
INLINE vf load_first(const float *p, int n)
{
    vf v = { 0 };

    if (n >= WIDTH)
        return load(p);
    memcpy(&v, p, (size_t) n * sizeof(float));
    return v;
}

INLINE void store_first(float *p, vf v, int n)
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

/* Mask of the first n pixels that are in group `own`. */
INLINE vi which(const uint16_t *group, uint16_t own, int n)
{
    return (groups_of(group, n) == (vi) { 0 } + own) & (lanes_from(0.0f) < splat((float) n));
}

/* table[at] for each lane, by scalar loads, which are faster than gather instructions on many machines and never much slower. The indices
 * are loaded from memory as well, which beats extracting them from a vector: IN_MEMORY forces compilers to do so. */
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

/* Four floats at table + 4 at for each lane. */
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
    transpose4(rows, out);
#else
    for (int l = 0; l < WIDTH; l++)
        for (int k = 0; k < 4; k++)
            out[k][l] = table[4 * (ptrdiff_t) i[l] + k];
#endif
}

INLINE vf mix_of(vf low, vf high, vf t)
{
    return low + t * (high - low);
}

#endif
