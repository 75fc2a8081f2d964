/* SPDX-License-Identifier: MIT
 *
 * pellucid/sampling.h - importance sampling of profiles: exact for the dipole, by tables of inverse cdfs for any model.
 *
 * Densities are per unit area of the plane: a radius r and a uniform angle have the joint density p(r), and Int 2 pi r p dr = 1.
 * pell_profile_sample (profile.h) samples any single profile exactly, up to rounding, with one random number.
 *
 * Units      radii mm, densities 1/mm^2; tables in mean free paths.
 * Random numbers lie in [0, 1); others count as the nearest of these, NaN as 0.
 * Ownership  numbers and arrays are the caller's; what is returned by pointer is constant data.
 * Errors     enum pell_result when a table is created; nothing is logged, because only the caller knows the names.
 * Threads    all functions are pure and safe; nothing is allocated.
 */
#ifndef PELLUCID_SAMPLING_H
#define PELLUCID_SAMPLING_H

#include <pellucid/profile.h>

#ifdef __cplusplus
extern "C" {
#endif

/* --- Dipole (Mertens et al. 2003, section 4) ------------------------------------------------------------------------------------ */

/* The radius inside which a pole z (1 + s d) exp(-s d)/d^3, d^2 = r^2 + z^2, s = sigma_tr, has the fraction xi of its flux: r = z sqrt(u^2
 * - 1) with s z (u - 1) + log u + log(1 - xi) = 0. z_mm > 0, sigma_tr >= 0 (1/mm). Relative error below 1e-13. */
PELL_API double pell_pole_sample(double z_mm, double sigma_tr, double xi);

/* Probability of the real pole, exp(-s zr)/(exp(-s zr) + exp(-s zv)). */
PELL_API double pell_dipole_real_share(const struct pell_dipole *d);

/* A radius distributed as 2 pi r Rd(r)/total, by two independent random numbers: one chooses the pole, one the radius. 0 for a dipole
 * without a medium. */
PELL_API double pell_dipole_sample(const struct pell_dipole *d, double xi_pole, double xi_radius);

/* The same with one random number, rescaled to [0, 1) after the choice. (The paper does not rescale it, which changes the distribution by
 * up to 0.22.) */
PELL_API double pell_dipole_sample_one(const struct pell_dipole *d, double xi);

/* Density of both functions above, Rd(r)/total; finite for every albedo > 0, 0 for albedo 0. */
PELL_API double pell_dipole_pdf(const struct pell_dipole *d, double r_mm);

/* --- Tables over the albedo ------------------------------------------------------------------------------------------------------ */

#define PELL_SAMPLING_ALBEDOS 64
#define PELL_SAMPLING_QUANTILES 128

/* Inverse cdfs of one model's profile for all albedos alpha' in [0, 1] at a fixed eta and g, in mean free paths 1/sigma_t', for sampling
 * with textured albedos. A value of fixed size (129 KiB) without pointers; the fields may be uploaded to a GPU unchanged.
 *
 * Row i is for alpha' = 1 - (i/(PELL_SAMPLING_ALBEDOS - 1))^4. Column j is for xi/(1 - xi) = exp(t), t from -PELL_SAMPLING_REACH to
 * PELL_SAMPLING_REACH in equal steps, and holds log r and its derivative by t. Between columns log r is a monotone cubic, beyond them
 * linear (a power of xi or 1 - xi); between rows it is interpolated linearly in i. */
#define PELL_SAMPLING_REACH 14.0
struct pell_sampling_table {
    double log_r[PELL_SAMPLING_ALBEDOS][PELL_SAMPLING_QUANTILES];
    double slope[PELL_SAMPLING_ALBEDOS][PELL_SAMPLING_QUANTILES];
};

/* `params` may be NULL. PELL_ERR_INVALID for eta, g, model or params out of range, PELL_ERR_UNSUPPORTED as pell_profile_make. Takes
 * milliseconds (photon-beam: a tenth of a second). */
PELL_API PELL_NODISCARD enum pell_result pell_sampling_table_make(enum pell_profile_model model, double eta, double g,
                                                                  const struct pell_profile_params *params,
                                                                  struct pell_sampling_table *out);

/* Radius in mean free paths. `albedo` outside [0, 1] counts as the nearest, NaN as 0. */
PELL_API double pell_sampling_table_sample(const struct pell_sampling_table *t, double albedo, double xi);

/* Density, per square mean free path, of exactly the samples of the function above (not of the model), so that an estimator
 * that divides by it has no bias from the table. r >= 0 in mean free paths; 0 at r = 0. */
PELL_API double pell_sampling_table_pdf(const struct pell_sampling_table *t, double albedo, double r);

#ifdef __cplusplus
}
#endif
#endif
