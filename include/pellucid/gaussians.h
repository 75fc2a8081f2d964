/* SPDX-License-Identifier: MIT
 *
 * pellucid/gaussians.h - sums of Gaussians, and how profiles are fitted by them.
 *
 * Units      variances mm^2, values 1/mm^2.
 * Errors     enum pell_result; nothing is logged here: the caller knows the names.
 * Threads    all functions are pure and safe; nothing is allocated.
 */
#ifndef PELLUCID_GAUSSIANS_H
#define PELLUCID_GAUSSIANS_H

#include <pellucid/profile.h>

#ifdef __cplusplus
extern "C" {
#endif

#define PELL_GAUSSIANS_MAX 10

/* R_c(r) = Sum_i weight[i][c] exp(-r^2/(2 variance[i])) / (2 pi variance[i]); variances shared by the channels and rising. */
struct pell_gaussians {
    int count; /* 1..PELL_GAUSSIANS_MAX; 0: none */
    double variance[PELL_GAUSSIANS_MAX];  /* mm^2 */
    double weight[PELL_GAUSSIANS_MAX][3]; /* Sum over i = the channel's total reflectance */
};

PELL_API double pell_gaussians_eval(const struct pell_gaussians *g, int channel, double r_mm); /* 1/mm^2 */
PELL_API double pell_gaussians_total(const struct pell_gaussians *g, int channel);

/* What a fit reports: error (10) of d'Eon et al. 2007, sqrt(Int r (R - G)^2 dr) / sqrt(Int r R^2 dr), as a fraction. */
struct pell_fit_report {
    double error[3];
    int evaluations;
};

struct pell_fit_params {
    int count;        /* 1..PELL_GAUSSIANS_MAX */
    bool free_energy; /* false: weights of a channel sum to the profile's total exactly */
};

/* One channel's best sum of Gaussians for a dipole; writes weight[i][0], all of them >= 0. Nothing is allocated; a fit needs about
 * 150 KiB of stack and milliseconds. An albedo of 0 gives count 0. `report` may be NULL. PELL_ERR_INVALID for a count or dipole out
 * of range. */
PELL_API PELL_NODISCARD enum pell_result pell_fit_dipole(const struct pell_dipole *dipole, const struct pell_fit_params *params,
                                                         struct pell_gaussians *out, struct pell_fit_report *report);

/* One channel's best sum of Gaussians for any profile; writes weight[i][0], all of them >= 0. */
PELL_API PELL_NODISCARD enum pell_result pell_fit_profile(const struct pell_profile *profile, const struct pell_fit_params *params,
                                                          struct pell_gaussians *out, struct pell_fit_report *report);

/* Three profiles (R, G, B) with shared variances. */
PELL_API PELL_NODISCARD enum pell_result pell_fit_profiles(const struct pell_profile profiles[3], const struct pell_fit_params *params,
                                                           struct pell_gaussians *out, struct pell_fit_report *report);

/* The three channels of a medium with shared variances, each channel's total kept (unless free_energy), so that one blur serves all:
 * minimises the sum over channels of the squared error (10). Weights are >= 0; a channel that scatters nothing has weights 0 (count 0
 * if all three do). `report` may be NULL. */
PELL_API PELL_NODISCARD enum pell_result pell_fit_medium(const struct pell_medium *medium, const struct pell_fit_params *params,
                                                         struct pell_gaussians *out, struct pell_fit_report *report);

#ifdef __cplusplus
}
#endif
#endif
