/* SPDX-License-Identifier: MIT
 *
 * kernels.h - the inner loops of a fit, built for each level of base/simd.h; all give the same bits. */
#ifndef PELL_OPTICS_FIT_KERNELS_H
#define PELL_OPTICS_FIT_KERNELS_H

struct pell_fit_kernels {
    /* a . b */
    double (*dot)(const double *a, const double *b, int n);
    /* to -= c a */
    void (*subtract)(double c, const double *a, double *restrict to, int n);
    /* Gaussian of variance v at r2 = r^2 times root, and its derivative after log v. */
    void (*gaussian)(const double *r2, const double *root, double v, double *restrict value, double *restrict slope, int n);
};

#endif
