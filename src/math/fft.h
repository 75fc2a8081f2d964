/* SPDX-License-Identifier: MIT
 *
 * fft.h - fast Fourier transforms of 16 neighbours at a time: each lane of a vector is one row, or one column, so that all arithmetic is
 * vertical. In single precision, forward with exp(-2 pi i jk/n); unnormalised.
 *
 *     element  16 real parts, 16 imaginary parts: PELL_FFT_ELEMENT floats
 *     data     n elements one after another
 *     half     spectrum of a real image along its rows: columns 0..n/2 in blocks of 16, block b at b * block floats, row y of it the
 *              element at y * PELL_FFT_ELEMENT, lanes are columns 16 b ..; lanes beyond n/2 are 0
 *
 * A transform of an image is rows, then pell_fft_run on the elements of each block (columns). All levels of base/simd.h give the same
 * bits. Any length works; those of pell_fft_good are fast.
 *
 * Threads    safe; allocates nothing.
 */
#ifndef PELL_FFT_H
#define PELL_FFT_H

#include <stdbool.h>
#include <stddef.h>

enum { PELL_FFT_LANES = 16, PELL_FFT_ELEMENT = 32, PELL_FFT_STAGES = 20 };
#define PELL_FFT_MOST (1 << 18)

struct pell_fft_kernels;

struct pell_fft {
    int n, num_stages;
    int radix[PELL_FFT_STAGES];
    const float *twiddle; /* of the stages in order */
    const struct pell_fft_kernels *kernels;
};

/* The smallest length that is no less than n, divisible by `multiple` (a power of 2), and otherwise a product of 2, 3 and 5. */
int pell_fft_good(int n, int multiple);

/* Size of the tables of a plan of this length, in floats. */
size_t pell_fft_table(int n);
/* n in [1, PELL_FFT_MOST]; the plan borrows `table`, pell_fft_table(n) floats. */
void pell_fft_init(struct pell_fft *plan, int n, float *table);

/* Transforms the data in `a` (n elements, 64-byte aligned, as is `b`) and returns which buffer holds the result: a or b. The other is
 * overwritten. */
float *pell_fft_run(const struct pell_fft *plan, bool inverse, float *a, float *b);

/* Floats of one buffer for the two functions below: n elements, and padding to end a block. */
size_t pell_fft_buffer(int n);

/* 16 rows of two real images, the second NULL for a single one: their first `width` <= n pixels, zeros beyond. Rows are `stride` floats
 * apart, readable and written up to the next multiple of 16 pixels; there are `rows` of them in [1, 16], the others are zeros. */
struct pell_fft_rows {
    float *image[2], *half[2]; /* half: position of the first row in block 0 */
    ptrdiff_t stride, block;
    int width, rows;
};

/* Transforms images to halves of their spectra, and back (scaled by n). */
void pell_fft_rows(const struct pell_fft *plan, const struct pell_fft_rows *r, float *buffer[2]);
void pell_fft_rows_back(const struct pell_fft *plan, const struct pell_fft_rows *r, float *buffer[2]);

/* 16 x 16 floats: out[j * out_stride + i] = in[i * in_stride + j]; rows of both 64-byte aligned. */
void pell_fft_transpose(const struct pell_fft *plan, const float *in, ptrdiff_t in_stride, float *out, ptrdiff_t out_stride);

#endif
