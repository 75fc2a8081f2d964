/* SPDX-License-Identifier: MIT
 *
 * factors.h - profiles as separable kernels of the screen-space method: R(sqrt(x^2 + y^2)) ~ Sum_k sign_k a_k(x) a_k(y) for each channel
 * (pellucid/kernel.h), with a_k as the integral from the middle, in a table. README.md has what is made of it.
 */
#ifndef PELL_SCREEN_SPACE_FACTORS_H
#define PELL_SCREEN_SPACE_FACTORS_H

#include <pellucid/frame.h>
#include <pellucid/kernel.h>

enum { SCREEN_FACTOR_STEPS = 512 };

/* A term of a material's kernel. The profile's total is 1. */
struct screen_factor {
    _Alignas(16) float integral[SCREEN_FACTOR_STEPS + 1][4]; /* of R, G, B over [0, x], at x = extent_mm (row/SCREEN_FACTOR_STEPS)^2 */
    float pass[3];                                           /* over all x */
    float sign[3];
};

struct screen_factors {
    int rank;
    float *extent_mm;             /* of each material, from 1; [0] is 0 */
    struct screen_factor *factor; /* [material * rank + term], none of material 0 */
};

struct pell_context;
struct screen_chain;

/* Tells of each kernel's error. `out` is zeroed; pell_ss_factors_finish also after a failure. */
PELL_NODISCARD enum pell_result pell_ss_factors_make(const struct screen_chain *chain, const struct pell_frame_shape *shape,
                                                     struct screen_factors *out);
void pell_ss_factors_finish(struct pell_context *ctx, struct screen_factors *f);

#endif
