/* SPDX-License-Identifier: MIT
 *
 * kernels.h - long loops: R(r) of each kind for many radii, and the terms of photon beams; kernels.c is compiled once per level of
 * base/simd.h. */
#ifndef PELL_PROFILE_KERNELS_H
#define PELL_PROFILE_KERNELS_H

#include <pellucid/profile.h>

typedef void (*pell_profile_kernel)(const struct pell_profile *p, const double *r, double *restrict R, size_t count);

/* Photon beam diffusion, see photon_beam.c. */
#define PELL_BEAM_DEPTHS 160
struct pell_beam {
    double sigma_tr, reach, a, b;    /* of the pair of sources; reach = 4 A D */
    double sigma_s, sigma_t, g, eta; /* of single scattering, in 1/mean free path */
    double depth[PELL_BEAM_DEPTHS];  /* decreasing */
    double weight[PELL_BEAM_DEPTHS]; /* depth times exp(-depth) */
};

/* Terms of an integral over the logarithm of depth at one radius, for the first `count` depths. */
typedef void (*pell_beam_kernel)(const struct pell_beam *beam, double r, double *restrict term, int count);

struct pell_profile_kernels {
    pell_profile_kernel of_kind[PELL_PROFILE_KINDS]; /* by enum pell_profile_kind; r and R may be the same array */
    pell_beam_kernel beam_multiple;                  /* r in reduced mean free paths */
    pell_beam_kernel beam_single;                    /* r in mean free paths 1/sigma_t; without the factor of medium and phase function */
};

const struct pell_profile_kernels *pell_profile_kernels_best(void);

#endif
