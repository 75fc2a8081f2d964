/* SPDX-License-Identifier: MIT
 *
 * texels.h - how kernel files of the image-space method fetch: floats and texels at places of each lane. For kernel files alone.
 *
 * Vectors are the compiler's generic ones, as wide as the machine's registers; a lane is a pixel. All levels give the same bits: a pixel's
 * operations and their order do not depend on the width.
 */
#ifndef PELL_IMAGE_SPACE_TEXELS_H
#define PELL_IMAGE_SPACE_TEXELS_H

#include "methods/image_space/image_space.h"

#include "base/simd.h"
#include "math/lanes.h"

#include <math.h>
#include <string.h>

/* One float of each lane's place. */
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

/* Eight neighbouring floats of each lane's place: rows are loaded whole and turned, in half the time of eight gathers. `at` is best where
 * it has been in memory for a while: IN_MEMORY keeps compilers from taking vectors apart by shuffles, which are what is short here. */
#define IN_MEMORY(at) __asm__("" : "+m"(at))
#if defined(__AVX512F__)
INLINE void gather8(const float *p, const vi *at, vf out[8])
{
    const int32_t *const index = (const int32_t *) at;
    vf rows[8], turned[8];

    for (int k = 0; k < 8; k++) { /* rows 0..3 beside 4..7, 8..11 beside 12..15 */
        const int32_t *i = index + (k & 3) + (k & 4) * 2;
        rows[k] = (vf) _mm512_insertf64x4(_mm512_castps_pd(_mm512_castps256_ps512(_mm256_loadu_ps(p + i[0]))),
                                          _mm256_castps_pd(_mm256_loadu_ps(p + i[4])), 1);
    }
    turn4(rows, turned);
    turn4(rows + 4, turned + 4);
    for (int k = 0; k < 4; k++) {
        out[k] = (vf) _mm512_shuffle_f32x4((__m512) turned[k], (__m512) turned[4 + k], 0x88);
        out[4 + k] = (vf) _mm512_shuffle_f32x4((__m512) turned[k], (__m512) turned[4 + k], 0xdd);
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
        turn4(rows, out + half);
    }
}
#else
INLINE void gather8(const float *p, const vi *at, vf out[8])
{
    for (int k = 0; k < 8; k++)
        out[k] = gather(p + k, *at);
}
#endif

/* The nearest whole number, halves up, of numbers within IS_FAR_PX. */
INLINE vi nearest(vf x)
{
    const vf up = x + 0.5f;
    const vi cut = __builtin_convertvector(up, vi);
    return cut + (__builtin_convertvector(cut, vf) > up);
}

INLINE vf within(vf x, float most)
{
    return greater(lesser(x, all(most)), all(-most)); /* no number becomes `most` */
}

/* Of struct is_kernels: in measure.c and rebuild.c. */
void PELL_SIMD(is_load)(const struct is_work *w, int y);
void PELL_SIMD(is_measure)(const struct is_work *w, int y);
void PELL_SIMD(is_rebuild)(const struct is_work *w, int y);

#endif
