/* SPDX-License-Identifier: MIT
 * rows16.h - rows of values that 16 points read at their own addresses, four values of each row at a time, transposed into 16 lanes per
 * value. For kernel files only. */
#ifndef PELL_ROWS16_H
#define PELL_ROWS16_H

#include "math/lanes.h"

#define ROWS 16

/* Four values of the rows first + j, first + j + 4, ... side by side, as many as fit a vector. */
INLINE vf quads(const float *const row[ROWS], int first, int j, int k)
{
    const float *const *r = row + first + j;
#if defined(__AVX512F__)
    const __m256 low = _mm256_insertf128_ps(_mm256_castps128_ps256(_mm_loadu_ps(r[0] + k)), _mm_loadu_ps(r[4] + k), 1);
    const __m256 high = _mm256_insertf128_ps(_mm256_castps128_ps256(_mm_loadu_ps(r[8] + k)), _mm_loadu_ps(r[12] + k), 1);
    return (vf) _mm512_insertf64x4(_mm512_castps_pd(_mm512_castps256_ps512(low)), _mm256_castps_pd(high), 1);
#elif defined(__AVX__)
    return (vf) _mm256_insertf128_ps(_mm256_castps128_ps256(_mm_loadu_ps(r[0] + k)), _mm_loadu_ps(r[4] + k), 1);
#else
    return load(r[0] + k);
#endif
}

/* Broadcasts a value per lane to the layout of quads(): wide[j] repeats that of lane 4 g + j in all four lanes of group g. */
INLINE void widen(vf lanes, vf wide[4])
{
#if defined(__SSE2__)
    wide[0] = MACHINE(shuffle)((machine) lanes, (machine) lanes, 0x00);
    wide[1] = MACHINE(shuffle)((machine) lanes, (machine) lanes, 0x55);
    wide[2] = MACHINE(shuffle)((machine) lanes, (machine) lanes, 0xaa);
    wide[3] = MACHINE(shuffle)((machine) lanes, (machine) lanes, 0xff);
#else
    for (int j = 0; j < 4; j++)
        wide[j] = splat(lanes[j]);
#endif
}

/* out[k][i]: value k, below `size`, a multiple of 4, of row[0][i], row[1][i] and row[2][i] by their weights. */
INLINE void rows_blend(const float *const row[3][ROWS], const float weight[3][ROWS], int size, float (*out)[ROWS])
{
    for (int first = 0; first < ROWS; first += WIDTH) {
        vf w[3][4];
        for (int r = 0; r < 3; r++)
            widen(load(weight[r] + first), w[r]);
        for (int k = 0; k < size; k += 4) {
            vf from[4], to[4];
            for (int j = 0; j < 4; j++)
                from[j] =
                    w[0][j] * quads(row[0], first, j, k) + w[1][j] * quads(row[1], first, j, k) + w[2][j] * quads(row[2], first, j, k);
            transpose4(from, to);
            for (int j = 0; j < 4; j++)
                store(out[k + j] + first, to[j]);
        }
    }
}

/* The same of rows that hold whole vectors: each is read as such, and transposed after the three are combined. */
INLINE void rows_blend_wide(const float *const row[3][ROWS], const float weight[3][ROWS], int size, float (*out)[ROWS])
{
    enum { MOST = 32 }; /* values per row, at most */
    _Alignas(64) float mixed[ROWS][MOST];
    const float *mix[ROWS];

    for (int i = 0; i < ROWS; i++) {
        mix[i] = mixed[i];
        for (int k = 0; k < size; k += WIDTH)
            store(mixed[i] + k,
                  weight[0][i] * load(row[0][i] + k) + weight[1][i] * load(row[1][i] + k) + weight[2][i] * load(row[2][i] + k));
    }
    for (int first = 0; first < ROWS; first += WIDTH)
        for (int k = 0; k < size; k += 4) {
            vf from[4], to[4];
            for (int j = 0; j < 4; j++)
                from[j] = quads(mix, first, j, k);
            transpose4(from, to);
            for (int j = 0; j < 4; j++)
                store(out[k + j] + first, to[j]);
        }
}

/* out[k][i]: between value k of row[i] and of the row `size` values after it, at t[i]. */
INLINE void rows_between(const float *const row[ROWS], const float t[ROWS], int size, float (*out)[ROWS])
{
    for (int first = 0; first < ROWS; first += WIDTH) {
        vf w[4];
        widen(load(t + first), w);
        for (int k = 0; k < size; k += 4) {
            vf from[4], to[4];
            for (int j = 0; j < 4; j++) {
                const vf here = quads(row, first, j, k), next = quads(row, first, j, k + size);
                from[j] = here + w[j] * (next - here);
            }
            transpose4(from, to);
            for (int j = 0; j < 4; j++)
                store(out[k + j] + first, to[j]);
        }
    }
}

#endif
