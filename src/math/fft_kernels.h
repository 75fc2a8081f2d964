/* SPDX-License-Identifier: MIT
 *
 * fft_kernels.h - the inner loops of fft.h.
 */
#ifndef PELL_FFT_KERNELS_H
#define PELL_FFT_KERNELS_H

#include <stddef.h>

enum { PELL_FFT_RADICES = 9 };

struct pell_fft_kernels {
    /* One stage of Stockham's transform of n = r m s elements: for p < m, q < s
     *     y[q + s (r p + k)] = w^(p k) Sum_j x[q + s (p + m j)] exp(-2 pi i j k/r),  w = exp(-2 pi i/(r m)).
     * `w`: w^p .. w^(p (r - 1)), complex, of each p in turn. `swap`: 0, or 16, which swaps real and imaginary parts. [r], NULL: none. */
    void (*stage[PELL_FFT_RADICES])(int m, int s, const float *w, const float *x, float *y, int swap);
    /* The same for any r, by the plain sum; `roots`: exp(-2 pi i j/r), j < r. */
    void (*any)(int r, int m, int s, const float *w, const float *roots, const float *x, float *y, int swap);
    void (*transpose)(const float *in, ptrdiff_t in_stride, float *out, ptrdiff_t out_stride);
    /* Separates the spectra of two real rows from that of a + i b: 16 lanes of z[k] and z[n - k], into tiles [k][16] to be transposed. */
    void (*part)(const float *z, int n, int k0, int count, float *tiles);
    /* The inverse: tiles of k0 .. into z[k] and z[n - k]. */
    void (*join)(const float *tiles, int n, int k0, int count, float *z);
};

#endif
