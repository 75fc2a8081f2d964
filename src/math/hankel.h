/* SPDX-License-Identifier: MIT
 *
 * hankel.h - discrete Hankel transform of order 0 between logarithmic grids, from frequencies to radii.
 *
 * Threads    safe; allocates nothing.
 */
#ifndef PELL_HANKEL_H
#define PELL_HANKEL_H

#include <stddef.h>

#define PELL_HANKEL_MAX 512 /* frequencies */
#define PELL_HANKEL_OVERSAMPLE_MAX 4
#define PELL_HANKEL_FINE_MAX (PELL_HANKEL_MAX * PELL_HANKEL_OVERSAMPLE_MAX)

/* Grids s_i = s_0 exp(-i step), i < count, and r_j = r_0 exp(j step/oversample), j < count oversample. */
struct pell_hankel {
    int count, oversample;
    double step;
    double re[PELL_HANKEL_MAX / 2 + 1], im[PELL_HANKEL_MAX / 2 + 1];         /* the kernel's spectrum times the shift of the grids */
    double cosine[PELL_HANKEL_FINE_MAX / 2], sine[PELL_HANKEL_FINE_MAX / 2]; /* of 2 pi k/(count oversample) */
};

/* count a power of 2 in 8..PELL_HANKEL_MAX, oversample 1, 2 or 4, step > 0; s0_r0 = s_0 r_0 > 0. */
void pell_hankel_init(struct pell_hankel *plan, int count, int oversample, double step, double s0_r0);

/* out[j] = r_j Int_0^inf F(s) J0(s r_j) s ds from f[i] = s_i F(s_i), which must vanish at both ends: exact for functions band-limited in
 * log s, so the error falls as exp(-pi^2/(2 step)) for F analytic where |arg s| < pi/2; plus exp(-count step) from the period. Needs 32 KiB
 * of stack. */
void pell_hankel_apply(const struct pell_hankel *plan, const double *f, double *out);

#endif
