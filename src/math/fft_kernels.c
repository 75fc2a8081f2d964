/* SPDX-License-Identifier: MIT
 *
 * fft_kernels.c - the inner loops of fft.h; compiled once per level of base/simd.h. All levels give the same bits: lanes never interact.
 */
#include "math/fft_kernels.h"

#include "base/simd.h"
#include "math/lanes.h"

#include <string.h>

enum { LANES = 16, ELEMENT = 32 };

/* A vector of complex numbers. */
struct cx {
    vf re, im;
};

INLINE struct cx get(const float *p, int swap)
{
    return (struct cx) { load(p + swap), load(p + (LANES - swap)) };
}

INLINE void put(float *p, int swap, struct cx a)
{
    store(p + swap, a.re);
    store(p + (LANES - swap), a.im);
}

INLINE struct cx add(struct cx a, struct cx b)
{
    return (struct cx) { a.re + b.re, a.im + b.im };
}

INLINE struct cx sub(struct cx a, struct cx b)
{
    return (struct cx) { a.re - b.re, a.im - b.im };
}

INLINE struct cx scaled(struct cx a, float s)
{
    return (struct cx) { a.re * s, a.im * s };
}

/* a + i b and a - i b */
INLINE struct cx add_i(struct cx a, struct cx b)
{
    return (struct cx) { a.re - b.im, a.im + b.re };
}

INLINE struct cx sub_i(struct cx a, struct cx b)
{
    return (struct cx) { a.re + b.im, a.im - b.re };
}

INLINE struct cx rotate(struct cx a, const float *w)
{
    const float c = w[0], s = w[1];
    return (struct cx) { a.re * c - a.im * s, a.re * s + a.im * c };
}

/* --- Small transforms, in place ------------------------------------------------------------------------------------------------------ */

INLINE void dft2(struct cx *x)
{
    const struct cx a = x[0], b = x[1];
    x[0] = add(a, b);
    x[1] = sub(a, b);
}

INLINE void dft3(struct cx *x)
{
    const struct cx t = add(x[1], x[2]), d = scaled(sub(x[1], x[2]), 0.866025403784f), a = sub(x[0], scaled(t, 0.5f));
    x[0] = add(x[0], t);
    x[1] = sub_i(a, d);
    x[2] = add_i(a, d);
}

INLINE void dft4(struct cx *x)
{
    const struct cx a = add(x[0], x[2]), b = sub(x[0], x[2]), c = add(x[1], x[3]), d = sub(x[1], x[3]);
    x[0] = add(a, c);
    x[1] = sub_i(b, d);
    x[2] = sub(a, c);
    x[3] = add_i(b, d);
}

INLINE void dft5(struct cx *x)
{
    const float c1 = 0.309016994375f, c2 = -0.809016994375f, s1 = 0.951056516295f, s2 = 0.587785252292f;
    const struct cx t1 = add(x[1], x[4]), t2 = add(x[2], x[3]), t3 = sub(x[1], x[4]), t4 = sub(x[2], x[3]);
    const struct cx m1 = add(x[0], add(scaled(t1, c1), scaled(t2, c2))), m2 = add(x[0], add(scaled(t1, c2), scaled(t2, c1)));
    const struct cx n1 = add(scaled(t3, s1), scaled(t4, s2)), n2 = sub(scaled(t3, s2), scaled(t4, s1));
    x[0] = add(x[0], add(t1, t2));
    x[1] = sub_i(m1, n1);
    x[2] = sub_i(m2, n2);
    x[3] = add_i(m2, n2);
    x[4] = add_i(m1, n1);
}

INLINE void dft8(struct cx *x)
{
    const float h = 0.707106781187f;
    struct cx e[4] = { x[0], x[2], x[4], x[6] }, o[4] = { x[1], x[3], x[5], x[7] }, t;
    dft4(e);
    dft4(o);
    x[0] = add(e[0], o[0]);
    x[4] = sub(e[0], o[0]);
    t = (struct cx) { (o[1].re + o[1].im) * h, (o[1].im - o[1].re) * h };
    x[1] = add(e[1], t);
    x[5] = sub(e[1], t);
    x[2] = sub_i(e[2], o[2]);
    x[6] = add_i(e[2], o[2]);
    t = (struct cx) { (o[3].im - o[3].re) * h, -(o[3].re + o[3].im) * h };
    x[3] = add(e[3], t);
    x[7] = sub(e[3], t);
}

/* --- Stages -------------------------------------------------------------------------------------------------------------------------- */

#define STAGE(R)                                                                                                                           \
    static void stage##R(int m, int s, const float *w, const float *x, float *y, int swap)                                                 \
    {                                                                                                                                      \
        for (int p = 0; p < m; p++, w += 2 * ((R) -1)) {                                                                                   \
            const float *from = x + (ptrdiff_t) ELEMENT * s * p;                                                                           \
            float *to = y + (ptrdiff_t) ELEMENT * s * (R) *p;                                                                              \
            const ptrdiff_t far = (ptrdiff_t) ELEMENT * s * m, near = (ptrdiff_t) ELEMENT * s;                                             \
            for (int q = 0; q < s; q++, from += ELEMENT, to += ELEMENT)                                                                    \
                for (int l = 0; l < LANES; l += WIDTH) {                                                                                   \
                    struct cx v[R];                                                                                                        \
                    _Pragma("GCC unroll 8") for (int j = 0; j < (R); j++) v[j] = get(from + j * far + l, swap);                            \
                    dft##R(v);                                                                                                             \
                    put(to + l, swap, v[0]);                                                                                               \
                    _Pragma("GCC unroll 8") for (int k = 1; k < (R); k++)                                                                  \
                        put(to + k * near + l, swap, m > 1 ? rotate(v[k], w + 2 * (k - 1)) : v[k]);                                        \
                }                                                                                                                          \
        }                                                                                                                                  \
    }

STAGE(2)
STAGE(3)
STAGE(4)
STAGE(5)
STAGE(8)

static void any_stage(int r, int m, int s, const float *w, const float *roots, const float *x, float *y, int swap)
{
    for (int p = 0; p < m; p++, w += 2 * (r - 1))
        for (int q = 0; q < s; q++)
            for (int k = 0; k < r; k++)
                for (int l = 0; l < LANES; l += WIDTH) {
                    struct cx sum = get(x + (ptrdiff_t) ELEMENT * (q + (ptrdiff_t) s * p) + l, swap);
                    for (int j = 1; j < r; j++)
                        sum = add(sum, rotate(get(x + (ptrdiff_t) ELEMENT * (q + (ptrdiff_t) s * (p + (ptrdiff_t) m * j)) + l, swap),
                                              roots + 2 * ((long long) j * k % r)));
                    put(y + (ptrdiff_t) ELEMENT * (q + (ptrdiff_t) s * ((ptrdiff_t) r * p + k)) + l, swap,
                        k > 0 ? rotate(sum, w + 2 * (k - 1)) : sum);
                }
}

/* --- Rows ---------------------------------------------------------------------------------------------------------------------------- */

#if WIDTH == 16
static void transpose(const float *in, ptrdiff_t in_stride, float *out, ptrdiff_t out_stride)
{
    __m512 a[16], b[16];

    for (int i = 0; i < 16; i += 2) {
        const __m512 x = _mm512_loadu_ps(in + i * in_stride), y = _mm512_loadu_ps(in + (i + 1) * in_stride);
        a[i] = _mm512_unpacklo_ps(x, y);
        a[i + 1] = _mm512_unpackhi_ps(x, y);
    }
    /* b[4 g + j]: in each quarter v of the register column 4 v + j of rows 4 g .. 4 g + 3 */
    for (int g = 0; g < 4; g++)
        for (int k = 0; k < 2; k++) {
            const __m512d x = _mm512_castps_pd(a[4 * g + k]), y = _mm512_castps_pd(a[4 * g + 2 + k]);
            b[4 * g + 2 * k] = _mm512_castpd_ps(_mm512_unpacklo_pd(x, y));
            b[4 * g + 2 * k + 1] = _mm512_castpd_ps(_mm512_unpackhi_pd(x, y));
        }
    for (int j = 0; j < 4; j++) {
        const __m512 even01 = _mm512_shuffle_f32x4(b[j], b[4 + j], 0x88), odd01 = _mm512_shuffle_f32x4(b[j], b[4 + j], 0xdd);
        const __m512 even23 = _mm512_shuffle_f32x4(b[8 + j], b[12 + j], 0x88), odd23 = _mm512_shuffle_f32x4(b[8 + j], b[12 + j], 0xdd);
        _mm512_storeu_ps(out + j * out_stride, _mm512_shuffle_f32x4(even01, even23, 0x88));
        _mm512_storeu_ps(out + (4 + j) * out_stride, _mm512_shuffle_f32x4(odd01, odd23, 0x88));
        _mm512_storeu_ps(out + (8 + j) * out_stride, _mm512_shuffle_f32x4(even01, even23, 0xdd));
        _mm512_storeu_ps(out + (12 + j) * out_stride, _mm512_shuffle_f32x4(odd01, odd23, 0xdd));
    }
}
#elif WIDTH == 8
static void transpose(const float *in, ptrdiff_t in_stride, float *out, ptrdiff_t out_stride)
{
    for (int ty = 0; ty < 16; ty += 8)
        for (int tx = 0; tx < 16; tx += 8) {
            const float *from = in + ty * in_stride + tx;
            float *to = out + tx * out_stride + ty;
            __m256 a[8], b[8];
            for (int i = 0; i < 8; i += 2) {
                const __m256 x = _mm256_loadu_ps(from + i * in_stride), y = _mm256_loadu_ps(from + (i + 1) * in_stride);
                a[i] = _mm256_unpacklo_ps(x, y);
                a[i + 1] = _mm256_unpackhi_ps(x, y);
            }
            for (int g = 0; g < 2; g++)
                for (int k = 0; k < 2; k++) {
                    const __m256d x = _mm256_castps_pd(a[4 * g + k]), y = _mm256_castps_pd(a[4 * g + 2 + k]);
                    b[4 * g + 2 * k] = _mm256_castpd_ps(_mm256_unpacklo_pd(x, y));
                    b[4 * g + 2 * k + 1] = _mm256_castpd_ps(_mm256_unpackhi_pd(x, y));
                }
            for (int j = 0; j < 4; j++) {
                _mm256_storeu_ps(to + j * out_stride, _mm256_permute2f128_ps(b[j], b[4 + j], 0x20));
                _mm256_storeu_ps(to + (4 + j) * out_stride, _mm256_permute2f128_ps(b[j], b[4 + j], 0x31));
            }
        }
}
#else
static void transpose(const float *in, ptrdiff_t in_stride, float *out, ptrdiff_t out_stride)
{
    for (int ty = 0; ty < 16; ty += 4)
        for (int tx = 0; tx < 16; tx += 4) {
            float t[4][4];
            for (int i = 0; i < 4; i++)
                memcpy(t[i], in + (ty + i) * in_stride + tx, sizeof(t[i]));
            for (int j = 0; j < 4; j++)
                store(out + (tx + j) * out_stride + ty, (vf) { t[0][j], t[1][j], t[2][j], t[3][j] });
        }
}
#endif

/* Tiles: real and imaginary parts of a, then of b, [16 k][16 rows] each. */
static void part(const float *z, int n, int k0, int count, float *tiles)
{
    for (int k = 0; k < count; k++) {
        const float *here = z + (ptrdiff_t) ELEMENT * (k0 + k), *there = z + (ptrdiff_t) ELEMENT * ((n - k0 - k) % n);
        for (int l = 0; l < LANES; l += WIDTH) {
            const struct cx u = scaled(get(here + l, 0), 0.5f), v = scaled(get(there + l, 0), 0.5f);
            store(tiles + LANES * k + l, u.re + v.re);
            store(tiles + 256 + LANES * k + l, u.im - v.im);
            store(tiles + 512 + LANES * k + l, u.im + v.im);
            store(tiles + 768 + LANES * k + l, v.re - u.re);
        }
    }
}

static void join(const float *tiles, int n, int k0, int count, float *z)
{
    for (int k = 0; k < count; k++) {
        float *here = z + (ptrdiff_t) ELEMENT * (k0 + k), *there = z + (ptrdiff_t) ELEMENT * (n - k0 - k);
        for (int l = 0; l < LANES; l += WIDTH) {
            const struct cx a = { load(tiles + LANES * k + l), load(tiles + 256 + LANES * k + l) };
            const struct cx b = { load(tiles + 512 + LANES * k + l), load(tiles + 768 + LANES * k + l) };
            put(here + l, 0, add_i(a, b));
            if (k0 + k > 0 && 2 * (k0 + k) < n)
                put(there + l, 0, (struct cx) { a.re + b.im, b.re - a.im });
        }
    }
}

extern const struct pell_fft_kernels PELL_SIMD(pell_fft_kernels);
const struct pell_fft_kernels PELL_SIMD(pell_fft_kernels) = {
    .stage = { [2] = stage2, [3] = stage3, [4] = stage4, [5] = stage5, [8] = stage8 },
    .any = any_stage,
    .transpose = transpose,
    .part = part,
    .join = join,
};
