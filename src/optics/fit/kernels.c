/* SPDX-License-Identifier: MIT
 *
 * kernels.c - loops over the nodes of a fit, written to be vectorised. */
#include "optics/fit/kernels.h"

#include "base/simd.h"
#include "math/vec.h"
#include "optics/profile/lanes.h"

static double dot(const double *a, const double *b, int n)
{
    double s[8] = { 0.0 };
    int i = 0;
    for (; i + 8 <= n; i += 8)
        for (int k = 0; k < 8; k++)
            s[k] += a[i + k] * b[i + k];
    for (; i < n; i++)
        s[0] += a[i] * b[i];
    return ((s[0] + s[4]) + (s[2] + s[6])) + ((s[1] + s[5]) + (s[3] + s[7]));
}

static void subtract(double c, const double *a, double *restrict to, int n)
{
    for (int i = 0; i < n; i++)
        to[i] -= c * a[i];
}

static void gaussian(const double *r2, const double *root, double v, double *restrict value, double *restrict slope, int n)
{
    const double scale = 1.0 / (2.0 * PELL_PI * v), half = 0.5 / v;
    for (int i = 0; i < n; i++) {
        const double e = half * r2[i], g = e < 80.0 ? scale * root[i] * lanes_exp(e) : 0.0;
        value[i] = g;
        slope[i] = g * (e - 1.0);
    }
}

extern const struct pell_fit_kernels PELL_SIMD(pell_fit_kernels);

const struct pell_fit_kernels PELL_SIMD(pell_fit_kernels) = { dot, subtract, gaussian };
