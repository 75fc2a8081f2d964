/* SPDX-License-Identifier: MIT
 *
 * kernels.h - the loops of the stack solvers; kernels.c is compiled once per level of base/simd.h. Internal.
 *
 * A polynomial of the narrow Gaussian G(v) is an array: element j <= m is the weight of G(j v); then, for each octave p = 1, 2, ..., m/2
 * elements are the weights of G(j 2^p v), j = m/2 + 1 .. m. Element 0 is a delta.
 */
#ifndef PELL_LAYERS_KERNELS_H
#define PELL_LAYERS_KERNELS_H

#include "optics/layers/multipole.h"

/* Density over the variance of a mixture of Gaussians whose transform is
 *     albedo (exp(-a_0 kappa) + exp(-a_1 kappa) - mirror images + ...)/2, images with the period 2 L. */
struct pell_mixture {
    double albedo, sigma2; /* sigma_tr^2 */
    double a[2];           /* depths; a[0] < 0: its own term is left out (the caller adds it as a delta) */
    double L;              /* INFINITY: the two poles alone */
    double mode[5];        /* coefficients of exp(-(n pi/L)^2 v/2), n = 1..5 */
};

struct pell_layers_kernels {
    /* Transforms of a slab at n frequencies s > 0: f[0..3] as in enum pell_stack_part. */
    void (*response)(const struct pell_multipole_slab *slab, const double *s, int n, double *const f[4]);
    /* a := slab a on b, pointwise. */
    void (*add)(int n, double *const a[4], double *const b[4]);
    void (*mixture)(const struct pell_mixture *m, const double *variance, int n, double *restrict w);
    /* out = a b, all of `octaves` octaves; products beyond the last element are added to it. Sums and first moments are exact up to
     * that. */
    void (*multiply)(int m, int octaves, const double *a, const double *b, double *restrict out);
};

#endif
