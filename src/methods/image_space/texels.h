/* SPDX-License-Identifier: MIT
 *
 * texels.h - gathers of floats and texels per lane, for kernel files of the image-space method only.
 *
 * Vectors are the compiler's generic ones, as wide as the machine's registers; a lane is a pixel. All SIMD levels give the same bits: the
 * operations on a pixel and their order do not depend on the width.
 */
#ifndef PELL_IMAGE_SPACE_TEXELS_H
#define PELL_IMAGE_SPACE_TEXELS_H

#include "methods/image_space/image_space.h"

#include "base/simd.h"
#include "math/lanes.h"

#include <math.h>
#include <string.h>

/* Gathers one float per lane. */
#if defined(__AVX512F__)
#define gather(p, at) ((vf) _mm512_i32gather_ps((__m512i) (at), (p), 4))
#elif defined(__AVX2__)
#define gather(p, at) ((vf) _mm256_i32gather_ps((p), (__m256i) (at), 4))
#else
INLINE vf gather(const float *p, vi at)
{
    vf v;
    for (int l = 0; l < WIDTH; l++)
        v[l] = p[at[l]];
    return v;
}
#endif

/* Gathers eight contiguous floats per lane: whole rows are loaded and transposed, in half the time of eight gathers. `at` should have been
 * stored to memory well before: IN_MEMORY keeps compilers from extracting lanes by shuffles, whose throughput is the bottleneck here. */
#define IN_MEMORY(at) __asm__("" : "+m"(at))
#if defined(__AVX512F__)
INLINE void gather8(const float *p, const vi *at, vf out[8])
{
    const int32_t *const index = (const int32_t *) at;
    vf rows[8], transposed[8];

    for (int k = 0; k < 8; k++) { /* rows 0..3 with 4..7, 8..11 with 12..15 */
        const int32_t *i = index + (k & 3) + (k & 4) * 2;
        rows[k] = (vf) _mm512_insertf64x4(_mm512_castps_pd(_mm512_castps256_ps512(_mm256_loadu_ps(p + i[0]))),
                                          _mm256_castps_pd(_mm256_loadu_ps(p + i[4])), 1);
    }
    transpose4(rows, transposed);
    transpose4(rows + 4, transposed + 4);
    for (int k = 0; k < 4; k++) {
        out[k] = (vf) _mm512_shuffle_f32x4((__m512) transposed[k], (__m512) transposed[4 + k], 0x88);
        out[4 + k] = (vf) _mm512_shuffle_f32x4((__m512) transposed[k], (__m512) transposed[4 + k], 0xdd);
    }
}
#elif defined(__AVX__)
INLINE void gather8(const float *p, const vi *at, vf out[8])
{
    const int32_t *const index = (const int32_t *) at;

    for (int half = 0; half < 8; half += 4) {
        vf rows[4];
        for (int k = 0; k < 4; k++)
            rows[k] = (vf) _mm256_insertf128_ps(_mm256_castps128_ps256(_mm_loadu_ps(p + index[k] + half)),
                                                _mm_loadu_ps(p + index[k + 4] + half), 1);
        transpose4(rows, out + half);
    }
}
#else
INLINE void gather8(const float *p, const vi *at, vf out[8])
{
    for (int k = 0; k < 8; k++)
        out[k] = gather(p + k, *at);
}
#endif

/* Rounds to the nearest integer, halves up, for numbers within IS_FAR_PX. */
INLINE vi nearest(vf x)
{
    const vf up = x + 0.5f;
    const vi cut = __builtin_convertvector(up, vi);
    return cut + (__builtin_convertvector(cut, vf) > up);
}

INLINE vf within(vf x, float most)
{
    return vmax(vmin(x, splat(most)), splat(-most)); /* NaN does not become `most` */
}

/* Members of struct is_kernels: in measure.c and rebuild.c. */
void PELL_SIMD(is_load)(const struct is_work *w, int y);
void PELL_SIMD(is_measure)(const struct is_work *w, int y);
void PELL_SIMD(is_rebuild)(const struct is_work *w, int y);

#endif
