/* SPDX-License-Identifier: MIT
 * fft.c - plans and rows; see fft.h. The inner loops are in fft_kernels.c. */
#include "math/fft.h"

#include "base/simd.h"
#include "math/fft_kernels.h"
#include "math/vec.h"

#include <math.h>
#include <stdint.h>
#include <string.h>

PELL_SIMD_TABLES(struct pell_fft_kernels, pell_fft_kernels);

int pell_fft_good(int n, int multiple)
{
    for (int m = (n + multiple - 1) / multiple * multiple;; m += multiple) {
        int rest = m;
        for (int p = 2; p <= 5; p++)
            while (rest % p == 0 && rest > 1)
                rest /= p;
        if (rest <= 1 && m > 0)
            return m;
    }
}

/* Factors n, starting with the radices that are most efficient. Returns their number; 0 for 1. */
static int factor(int n, int *radix)
{
    static const int fast[] = { 8, 4, 5, 3, 2 };
    int count = 0, twos = 0;

    for (int k = n; k % 2 == 0; k /= 2)
        twos++;
    for (size_t i = 0; i < sizeof(fast) / sizeof(fast[0]); i++)
        while (n % fast[i] == 0 && !(fast[i] == 8 && twos == 4)) { /* 16 = 4 x 4, not 8 x 2 */
            radix[count++] = fast[i];
            n /= fast[i];
            twos -= fast[i] == 8 ? 3 : fast[i] == 4 ? 2 : fast[i] == 2;
        }
    for (int p = 7; n > 1; p += 2) {
        if (p > n / p)
            p = n;
        while (n % p == 0) {
            radix[count++] = p;
            n /= p;
        }
    }
    return count;
}

size_t pell_fft_table(int n)
{
    int radix[PELL_FFT_STAGES];
    const int count = factor(n, radix);
    size_t size = 16;

    for (int i = 0, left = n; i < count; left /= radix[i++]) {
        size += 2 * (size_t) (left / radix[i]) * (size_t) (radix[i] - 1);
        size += radix[i] > 5 && radix[i] != 8 ? 2 * (size_t) radix[i] : 0;
    }
    return size;
}

static void root_of_unity(double k, double n, float *out)
{
    const double angle = -2.0 * PELL_PI * k / n;
    out[0] = (float) cos(angle);
    out[1] = (float) sin(angle);
}

static bool is_fast(int radix)
{
    return radix <= 5 || radix == 8;
}

void pell_fft_init(struct pell_fft *plan, int n, float *table)
{
    int left = n;

    *plan = (struct pell_fft) { .n = n, .twiddle = table, .kernels = pell_fft_kernels_tables[pell_simd_best()] };
    plan->num_stages = factor(n, plan->radix);
    for (int i = 0; i < plan->num_stages; i++) {
        const int r = plan->radix[i], m = left / r;
        for (int j = 0; j < r && !is_fast(r); j++, table += 2)
            root_of_unity(j, r, table);
        for (int p = 0; p < m; p++)
            for (int k = 1; k < r; k++, table += 2)
                root_of_unity((double) ((int64_t) p * k % left), left, table);
        left = m;
    }
}

float *pell_fft_run(const struct pell_fft *plan, bool inverse, float *a, float *b)
{
    const int swap = inverse ? PELL_FFT_LANES : 0;
    const float *w = plan->twiddle;
    int left = plan->n, s = 1;

    for (int i = 0; i < plan->num_stages; i++) {
        const int r = plan->radix[i], m = left / r;
        float *const from = a;
        if (is_fast(r)) {
            plan->kernels->stage[r](m, s, w, a, b, swap);
        } else {
            plan->kernels->any(r, m, s, w + 2 * r, w, a, b, swap);
            w += 2 * r;
        }
        w += 2 * (ptrdiff_t) m * (r - 1);
        a = b;
        b = from;
        left = m;
        s *= r;
    }
    return a;
}

size_t pell_fft_buffer(int n)
{
    return ((size_t) n + 2 * PELL_FFT_LANES) * PELL_FFT_ELEMENT;
}

void pell_fft_transpose(const struct pell_fft *plan, const float *in, ptrdiff_t in_stride, float *out, ptrdiff_t out_stride)
{
    plan->kernels->transpose(in, in_stride, out, out_stride);
}

/* --- Rows ---------------------------------------------------------------------------------------------------------------------------- */

/* Loads 16 columns of up to 16 rows as lanes of 16 elements; absent rows are 0. */
static void load_tile(const struct pell_fft *plan, const float *from, ptrdiff_t stride, int rows, float *to)
{
    _Alignas(64) float tile[256];

    if (from && rows == PELL_FFT_LANES) {
        plan->kernels->transpose(from, stride, to, PELL_FFT_ELEMENT);
        return;
    }
    memset(tile, 0, sizeof(tile));
    for (int y = 0; from && y < rows; y++)
        memcpy(tile + PELL_FFT_LANES * y, from + y * stride, PELL_FFT_LANES * sizeof(float));
    plan->kernels->transpose(tile, PELL_FFT_LANES, to, PELL_FFT_ELEMENT);
}

void pell_fft_rows(const struct pell_fft *plan, const struct pell_fft_rows *r, float *buffer[2])
{
    const int n = plan->n, half = n / 2 + 1, rows = r->rows;
    const float *z;

    for (int x = 0; x < r->width; x += PELL_FFT_LANES)
        for (int i = 0; i < 2; i++)
            load_tile(plan, r->image[i] ? r->image[i] + x : NULL, r->stride, rows,
                      buffer[0] + (ptrdiff_t) x * PELL_FFT_ELEMENT + i * PELL_FFT_LANES);
    memset(buffer[0] + (ptrdiff_t) r->width * PELL_FFT_ELEMENT, 0, (size_t) (n - r->width) * PELL_FFT_ELEMENT * sizeof(float));
    z = pell_fft_run(plan, false, buffer[0], buffer[1]);
    for (int k = 0, at = 0; k < half; k += PELL_FFT_LANES, at++) {
        const int count = half - k < PELL_FFT_LANES ? half - k : PELL_FFT_LANES;
        _Alignas(64) float tiles[4][256], transposed[256];
        if (count < PELL_FFT_LANES)
            memset(tiles, 0, sizeof(tiles));
        plan->kernels->part(z, n, k, count, tiles[0]);
        for (int i = 0; i < 4; i++) {
            float *to = r->half[i / 2];
            if (!to)
                continue;
            to += at * r->block + (i % 2) * PELL_FFT_LANES;
            if (rows == PELL_FFT_LANES) {
                plan->kernels->transpose(tiles[i], PELL_FFT_LANES, to, PELL_FFT_ELEMENT);
                continue;
            }
            plan->kernels->transpose(tiles[i], PELL_FFT_LANES, transposed, PELL_FFT_LANES);
            for (int y = 0; y < rows; y++)
                memcpy(to + y * PELL_FFT_ELEMENT, transposed + y * PELL_FFT_LANES, PELL_FFT_LANES * sizeof(float));
        }
    }
}

void pell_fft_rows_back(const struct pell_fft *plan, const struct pell_fft_rows *r, float *buffer[2])
{
    const int n = plan->n, half = n / 2 + 1, rows = r->rows;
    const float *z;

    for (int k = 0, at = 0; k < half; k += PELL_FFT_LANES, at++) {
        const int count = half - k < PELL_FFT_LANES ? half - k : PELL_FFT_LANES;
        _Alignas(64) float tiles[4][256], tile[256];
        for (int i = 0; i < 4; i++) {
            const float *from = r->half[i / 2];
            if (!from) {
                memset(tiles[i], 0, sizeof(tiles[i]));
                continue;
            }
            from += at * r->block + (i % 2) * PELL_FFT_LANES;
            if (rows == PELL_FFT_LANES) {
                plan->kernels->transpose(from, PELL_FFT_ELEMENT, tiles[i], PELL_FFT_LANES);
                continue;
            }
            memset(tile, 0, sizeof(tile));
            for (int y = 0; y < rows; y++)
                memcpy(tile + PELL_FFT_LANES * y, from + y * PELL_FFT_ELEMENT, PELL_FFT_LANES * sizeof(float));
            plan->kernels->transpose(tile, PELL_FFT_LANES, tiles[i], PELL_FFT_LANES);
        }
        plan->kernels->join(tiles[0], n, k, count, buffer[0]);
    }
    z = pell_fft_run(plan, true, buffer[0], buffer[1]);
    for (int x = 0; x < r->width; x += PELL_FFT_LANES)
        for (int i = 0; i < 2; i++) {
            float *to = r->image[i];
            const float *from = z + (ptrdiff_t) x * PELL_FFT_ELEMENT + i * PELL_FFT_LANES;
            _Alignas(64) float transposed[256];
            if (!to)
                continue;
            if (rows == PELL_FFT_LANES) {
                plan->kernels->transpose(from, PELL_FFT_ELEMENT, to + x, r->stride);
                continue;
            }
            plan->kernels->transpose(from, PELL_FFT_ELEMENT, transposed, PELL_FFT_LANES);
            for (int y = 0; y < rows; y++)
                memcpy(to + y * r->stride + x, transposed + y * PELL_FFT_LANES, PELL_FFT_LANES * sizeof(float));
        }
}
