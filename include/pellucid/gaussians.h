/* SPDX-License-Identifier: MIT
 *
 * pellucid/gaussians.h - sums of Gaussians, and fits of profiles by them.
 *
 * Units      variances mm^2, values 1/mm^2.
 * Ownership  numbers and arrays are the caller's; what is returned by pointer is constant data.
 * Errors     enum pell_result; nothing is logged, because only the caller knows the names.
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
    int count;                            /* 1..PELL_GAUSSIANS_MAX; 0: none */
    double variance[PELL_GAUSSIANS_MAX];  /* mm^2 */
    double weight[PELL_GAUSSIANS_MAX][3]; /* Sum over i = the channel's total reflectance */
};

PELL_API double pell_gaussians_eval(const struct pell_gaussians *g, int channel, double r_mm); /* 1/mm^2 */
PELL_API double pell_gaussians_total(const struct pell_gaussians *g, int channel);

#define PELL_GAUSSIANS_VARIANCE_MIN 1e-18 /* mm^2 */
#define PELL_GAUSSIANS_VARIANCE_MAX 1e18

/* One channel as a profile, in closed form: values, transform, cdf. PELL_ERR_INVALID (and *out zero) for a channel,
 * count or variance out of range, a weight outside [0, 1], or a total over 1 by more than PELL_PROFILE_TOTAL_SLACK. */
PELL_API PELL_NODISCARD enum pell_result pell_profile_from_gaussians(const struct pell_gaussians *g, int channel, struct pell_profile *out);

/* Report of a fit: error (10) of d'Eon et al. 2007, sqrt(Int r (R - G)^2 dr) / sqrt(Int r R^2 dr), as a fraction. */
struct pell_fit_report {
    double error[3];
    int evaluations;
};

struct pell_fit_params {
    int count;        /* 1..PELL_GAUSSIANS_MAX */
    bool free_energy; /* false: weights of a channel sum to the profile's total exactly; true: to the total that fits best, at most 1 */
    double r_max_mm;  /* > 0: upper limit of the error's integrals; 0: infinity */
};

/* One channel's best sum of Gaussians for a dipole; writes weight[i][0], all of them >= 0. Nothing is allocated; a fit needs about
 * 150 KiB of stack. An albedo of 0 gives count 0. `report` may be NULL. PELL_ERR_INVALID for a count, r_max_mm or dipole out of range. */
PELL_API PELL_NODISCARD enum pell_result pell_fit_dipole(const struct pell_dipole *dipole, const struct pell_fit_params *params,
                                                         struct pell_gaussians *out, struct pell_fit_report *report);

/* One channel's best sum of Gaussians for any profile; writes weight[i][0], all of them >= 0. For separate variances of three
 * channels call it three times. For a profile that is unbounded at r = 0 (normalized diffusion: as 1/r) error (10) is undefined, because
 * the integral of r R^2 diverges: its integrals are weighted by r^2/(r^2 + q^2), where q is the radius that contains 1/20 of the light
 * (with shared variances: the smallest of the channels' radii). The light inside q is conserved, but its shape is not resolved. */
PELL_API PELL_NODISCARD enum pell_result pell_fit_profile(const struct pell_profile *profile, const struct pell_fit_params *params,
                                                          struct pell_gaussians *out, struct pell_fit_report *report);

/* Three profiles (R, G, B) with shared variances, so that one blur serves all: minimises the sum over channels of the squared error
 * (10). Weights are >= 0; a channel without light has weights 0 (count 0 if all three have none). Swapping profiles swaps the weights, with
 * identical bits. */
PELL_API PELL_NODISCARD enum pell_result pell_fit_profiles(const struct pell_profile profiles[3], const struct pell_fit_params *params,
                                                           struct pell_gaussians *out, struct pell_fit_report *report);

/* The same for the three dipoles of a medium (exact Fresnel). */
PELL_API PELL_NODISCARD enum pell_result pell_fit_medium(const struct pell_medium *medium, const struct pell_fit_params *params,
                                                         struct pell_gaussians *out, struct pell_fit_report *report);

/* Error (10) of one channel against any profile, as a fraction, by the integrals of the fits (see pell_fit_profile); r_max_mm as in
 * struct pell_fit_params. NAN for a profile without light (or with less than 1e-290, whose values are subnormal) and for
 * arguments out of range. */
PELL_API double pell_gaussians_error(const struct pell_gaussians *g, int channel, const struct pell_profile *profile, double r_max_mm);

/* --- Closed forms (d'Eon et al. 2007, appendix A) ------------------------------------------------------------------------------ */

/* Weights at the variances of appendix A, {0.2304, 0.7225, 2.6569, 13.6} z^2/(1 + sigma_tr z). Values are stable. */
enum pell_appendix_a {
    PELL_APPENDIX_A_PRINTED = 0, /* the paper's C1..C4 (its parentheses restored): error up to 7.6 %, energy kept to 4 % */
    PELL_APPENDIX_A_BEST,        /* least squares, in closed form: 0.4 to 3.1 % */
    PELL_APPENDIX_A_BEST_ENERGY, /* least squares with the pole's total kept exactly */
};

/* Four Gaussians for the pole z (1 + s d) exp(-s d)/(4 pi d^3), d^2 = r^2 + z^2, s = sigma_tr: half a dipole of alpha' = 1, total
 * exp(-s |z|)/2. z_mm != 0; a negative depth negates the weights. Some weights are negative. */
PELL_API PELL_NODISCARD enum pell_result pell_pole_appendix_a(double z_mm, double sigma_tr, enum pell_appendix_a constants,
                                                              double variance_mm2[4], double weight[4]);

/* Eight Gaussians for a dipole, in order of rising variance; writes weight[i][0]. Closed form, no iteration. */
PELL_API PELL_NODISCARD enum pell_result pell_dipole_appendix_a(const struct pell_dipole *dipole, enum pell_appendix_a constants,
                                                                struct pell_gaussians *out);

/* --- Sets of any size ---------------------------------------------------------------------------------------------------------- */

/* A set is two arrays: variances >= 0 in mm^2 and weights of any sign. R(r) = Sum weight[i] exp(-r^2/(2 variance[i]))/(2 pi variance[i]),
 * its total Sum weight[i], its second moment Int r^2 R 2 pi r dr = 2 Sum weight[i] variance[i]. Inputs must be finite. Outputs may not
 * overlap inputs. */
PELL_API double pell_gaussian_set_eval(const double *variance, const double *weight, size_t count, double r_mm); /* 1/mm^2; v > 0 */
PELL_API double pell_gaussian_set_total(const double *weight, size_t count);
PELL_API double pell_gaussian_set_moment(const double *variance, const double *weight, size_t count); /* mm^2 */

/* Int_0^inf r A(r) B(r) dr = Sum_ij a_i b_j/(4 pi^2 (u_i + v_j)), 1/mm^2; variances > 0. */
PELL_API double pell_gaussian_set_inner(const double *variance_a, const double *weight_a, size_t count_a, const double *variance_b,
                                        const double *weight_b, size_t count_b);

/* Error (10) of set B against set A in closed form; below about 1e-7 it is rounding error. NAN if A is 0. */
PELL_API double pell_gaussian_set_error(const double *variance_a, const double *weight_a, size_t count_a, const double *variance_b,
                                        const double *weight_b, size_t count_b);

/* Convolution A * B: count_a count_b Gaussians, variances added, weights multiplied; the arrays `variance`, `weight` hold that many. */
PELL_API void pell_gaussian_set_convolve(const double *variance_a, const double *weight_a, size_t count_a, const double *variance_b,
                                         const double *weight_b, size_t count_b, double *variance, double *weight);

/* `targets` >= 1 rising variances for pell_gaussian_set_reduce: geometric from the smallest to the largest variance of nonzero weight
 * (one target: the mean). PELL_ERR_INVALID if no variance is above 0, or a value is not finite. */
PELL_API PELL_NODISCARD enum pell_result pell_gaussian_set_targets(const double *variance, const double *weight, size_t count,
                                                                   double *target, size_t targets);

/* Reduces a set to the rising variances `target`: each Gaussian's weight is split between its two neighbours by distance, so
 * that energy and second moment are kept exactly; out[i] is the weight of target[i]. Weights beyond the first or last target go entirely to
 * that one: energy is kept, the moment is not. d'Eon et al. 2007, section 4. O(count log targets). */
PELL_API void pell_gaussian_set_reduce(const double *variance, const double *weight, size_t count, const double *target, size_t targets,
                                       double *out);

/* A pole (see pell_pole_appendix_a) is exactly a mixture of Gaussians of positive weight,
 *     Int_0^inf w(v) G(v, r) dv,   w(v) = z exp(-s^2 v/2 - z^2/(2 v))/(2 v sqrt(2 pi v)),
 * here discretised into `count` >= 1 Gaussians of rising variance without an optimiser: a trapezoidal sum in log v, whose step balances the
 * truncation error against the error between nodes. The total exp(-s |z|)/2 is kept exactly; error (10) falls faster than exp(-2
 * sqrt(count)).
 * z_mm != 0; a negative depth negates the weights. PELL_ERR_INVALID out of range. */
PELL_API PELL_NODISCARD enum pell_result pell_pole_gaussians(double z_mm, double sigma_tr, double *variance, double *weight, size_t count);

/* The same mixture on `count` given rising variances >= 0: w(v) dv is split as in pell_gaussian_set_reduce, by closed forms, so
 * energy is exact for any variances, and the weights have the sign of z. */
PELL_API PELL_NODISCARD enum pell_result pell_pole_gaussians_at(double z_mm, double sigma_tr, const double *variance, double *weight,
                                                                size_t count);

#ifdef __cplusplus
}
#endif
#endif
