/* SPDX-License-Identifier: MIT
 *
 * hankel.c - the Hankel transform as a convolution in log s, after Siegman 1977, "Quasi fast Hankel transform", and Talman 1978,
 * "Numerical Fourier and Bessel transforms in logarithmic variables": with f = s F, r Int F J0 s ds = Int f(s) K(s r) dlog s,
 * K(t) = t J0(t), whose spectrum Int K(t) t^(i w) dlog t = 2^(i w) Gamma(1/2 + i w/2)/Gamma(1/2 - i w/2) is a pure phase. */
#include "math/hankel.h"

#include "math/vec.h"

#include <math.h>

/* arg Gamma(1/2 + i y): Stirling's series after eight steps of the recurrence. */
static double arg_gamma_half(double y)
{
    double sum = 0.0;
    for (int k = 0; k < 8; k++)
        sum += atan2(y, 0.5 + k);
    const double x = 8.5, norm = x * x + y * y, log_abs = 0.5 * log(norm), angle = atan2(y, x);
    /* (z - 1/2) log z - z + 1/(12 z) - 1/(360 z^3) + 1/(1260 z^5) - 1/(1680 z^7) */
    const double re = x / norm, im = -y / norm; /* 1/z */
    const double re2 = re * re - im * im, im2 = 2.0 * re * im;
    static const double c[4] = { 1.0 / 12.0, -1.0 / 360.0, 1.0 / 1260.0, -1.0 / 1680.0 };
    double a = re, b = im, series = 0.0;
    for (int k = 0; k < 4; k++) {
        series += c[k] * b;
        const double next = a * re2 - b * im2;
        b = a * im2 + b * re2;
        a = next;
    }
    return (x - 0.5) * angle + y * log_abs - y + series - sum;
}

void pell_hankel_init(struct pell_hankel *plan, int count, int oversample, double step, double s0_r0)
{
    const double base = 2.0 * PELL_PI / (count * step), shift = log(s0_r0);

    plan->count = count;
    plan->oversample = oversample;
    plan->step = step;
    for (int m = 0; m <= count / 2; m++) {
        const double w = m * base;
        /* (s0 r0)^(i w) times the spectrum at -w */
        const double phase = w * (shift - 0.69314718055994530942) - 2.0 * arg_gamma_half(0.5 * w);
        plan->re[m] = cos(phase);
        plan->im[m] = sin(phase);
    }
    for (int k = 0; k < count * oversample / 2; k++) {
        const double angle = 2.0 * PELL_PI * k / (count * oversample);
        plan->cosine[k] = cos(angle);
        plan->sine[k] = sin(angle);
    }
}

/* In place, n a power of 2 up to the plan's finest, sign of the exponent given; radix 2, decimation in time. */
static void fft(const struct pell_hankel *plan, double *restrict re, double *restrict im, int n, double sign)
{
    for (int i = 1, j = 0; i < n; i++) {
        int bit = n >> 1;
        for (; j & bit; bit >>= 1)
            j ^= bit;
        j ^= bit;
        if (i < j) {
            const double a = re[i], b = im[i];
            re[i] = re[j], im[i] = im[j];
            re[j] = a, im[j] = b;
        }
    }
    for (int half = 1; half < n; half *= 2) {
        const int stride = plan->count * plan->oversample / (2 * half);
        for (int k = 0; k < half; k++) {
            const double c = plan->cosine[k * stride], s = sign * plan->sine[k * stride];
            for (int i = k; i < n; i += 2 * half) {
                const double a = re[i + half] * c - im[i + half] * s, b = re[i + half] * s + im[i + half] * c;
                re[i + half] = re[i] - a, im[i + half] = im[i] - b;
                re[i] += a, im[i] += b;
            }
        }
    }
}

void pell_hankel_apply(const struct pell_hankel *plan, const double *f, double *out)
{
    double re[PELL_HANKEL_FINE_MAX], im[PELL_HANKEL_FINE_MAX];
    const int n = plan->count, fine = n * plan->oversample;

    for (int i = 0; i < n; i++) {
        re[i] = f[i];
        im[i] = 0.0;
    }
    fft(plan, re, im, n, -1.0);
    /* Only frequencies >= 0 are kept, doubled: the real part of the inverse is the result. */
    for (int m = 0; m <= n / 2; m++) {
        const double scale = (m == 0 || m == n / 2 ? 1.0 : 2.0) / n;
        const double a = re[m] * plan->re[m] - im[m] * plan->im[m], b = re[m] * plan->im[m] + im[m] * plan->re[m];
        re[m] = scale * a;
        im[m] = scale * b;
    }
    for (int m = n / 2 + 1; m < fine; m++)
        re[m] = im[m] = 0.0;
    if (fine == n)
        im[n / 2] = 0.0;
    fft(plan, re, im, fine, 1.0);
    for (int j = 0; j < fine; j++)
        out[j] = re[j];
}
