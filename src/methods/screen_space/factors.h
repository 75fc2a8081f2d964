/* SPDX-License-Identifier: MIT
 *
 * factors.h - profiles as separable kernels of the screen-space method: R(sqrt(x^2 + y^2)) ~ Sum_k sign_k a_k(x) a_k(y) for each channel
 * (pellucid/kernel.h), with a_k represented by its integral from the centre, in cubics. Details: README.md.
 */
#ifndef PELL_SCREEN_SPACE_FACTORS_H
#define PELL_SCREEN_SPACE_FACTORS_H

#include "methods/screen_space/formulas.h"

#include <pellucid/frame.h>
#include <pellucid/kernel.h>

/* A term of a material's kernel, for a profile normalised to 1. */
struct screen_factor {
    _Alignas(64) float cubic[3][4][SCREEN_FACTOR_PARTS]; /* of R, G, B: see pell_ss_factor_integral */
    float integral[3];                                   /* the integral over all x */
    float sign[3];
};

/* Integral over [0, extent_mm coord^2], `coord` in [0, 1]; piecewise cubic in `coord`. */
static inline float pell_ss_factor_integral(const struct screen_factor *f, int channel, float coord)
{
    const float p = coord * SCREEN_FACTOR_PARTS;
    const int k = p < SCREEN_FACTOR_PARTS - 1 ? (int) p : SCREEN_FACTOR_PARTS - 1;
    const float t = p - (float) k;
    const float(*a)[SCREEN_FACTOR_PARTS] = f->cubic[channel];

    return a[0][k] + t * (a[1][k] + t * (a[2][k] + t * a[3][k]));
}

struct screen_factors {
    int rank;
    float *extent_mm;             /* by material, from 1; [0] is 0 */
    struct screen_factor *factor; /* [material * rank + term]; none for material 0 */
};

struct pell_context;
struct screen_chain;

/* Reports each kernel's error. `out` is zeroed; call pell_ss_factors_finish even after a failure. */
PELL_NODISCARD enum pell_result pell_ss_factors_make(const struct screen_chain *chain, const struct pell_frame_shape *shape,
                                                     struct screen_factors *out);
void pell_ss_factors_finish(struct pell_context *ctx, struct screen_factors *f);

#endif
