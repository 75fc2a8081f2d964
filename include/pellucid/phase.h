/* SPDX-License-Identifier: MIT
 *
 * pellucid/phase.h - evaluates and samples phase functions: the angular distribution of light after one scattering event.
 *
 * Convention  common to all phase functions: cos_theta is the cosine between the direction toward the light, w_i, and the direction toward
 *             the viewer, w_o, which both point AWAY from the point of scattering. Unscattered light has w_o = -w_i and cos_theta = -1;
 *             backscattered light has cos_theta = 1. Signs of g and k are the usual ones: above 0 is forward.
 *
 *     Henyey and Greenstein 1941   p = (1 - g^2) / (4 pi (1 + g^2 + 2 g cos_theta)^(3/2))
 *     Schlick (Blasi et al. 1993)  p = (1 - k^2) / (4 pi (1 + k cos_theta)^2)
 *     Rayleigh                     p = 3 (1 + cos_theta^2) / (16 pi)
 *     two lobes                    w HG(g[0]) + (1 - w) HG(g[1])
 *
 * Schlick's k is not the mean cosine (0.25 has 0.169, 0.4 has 0.276, 0.8 has 0.632): sigma_s' is
 * sigma_s (1 - pell_phase_mean_cosine).
 *
 * Units      values 1/sr; they integrate to 1 over the sphere. Directions are unit vectors.
 * Ownership  numbers and arrays are the caller's; what is returned by pointer is constant data.
 * Errors     none after pell_phase_valid; cosines and random numbers out of range are clamped.
 * Threads    all functions are pure and safe.
 */
#ifndef PELLUCID_PHASE_H
#define PELLUCID_PHASE_H

#include <pellucid/medium.h>

#ifdef __cplusplus
extern "C" {
#endif

/* Values are stable. */
enum pell_phase_kind { PELL_PHASE_HENYEY_GREENSTEIN = 0, PELL_PHASE_SCHLICK, PELL_PHASE_RAYLEIGH, PELL_PHASE_TWO_LOBE, PELL_PHASE_KINDS };

/* { 0 } is isotropic. */
struct pell_phase {
    enum pell_phase_kind kind;
    double g[2];   /* g[0]: g, or Schlick's k; g[1]: g of the second lobe; absolute values <= PELL_G_MAX; unused for Rayleigh */
    double weight; /* weight of the first of two lobes, [0, 1] */
};

/* Whether a phase function is in range; if not, *fault (may be NULL) holds the field and its range. */
PELL_API bool pell_phase_valid(const struct pell_phase *p, struct pell_medium_fault *fault);

/* p(cos_theta), 1/sr. It is also the density of pell_phase_sample, so samples have weight 1. */
PELL_API double pell_phase_value(const struct pell_phase *p, double cos_theta);
/* Cumulative distribution: the fraction of the light with a cosine above cos_theta; 0 at 1 (backward), 1 at -1 (forward). */
PELL_API double pell_phase_cdf(const struct pell_phase *p, double cos_theta);
/* Mean of -cos_theta: g of the literature. */
PELL_API double pell_phase_mean_cosine(const struct pell_phase *p);

/* Samples cos_theta by xi in [0, 1]: with one lobe the inverse of pell_phase_cdf. With two lobes xi also selects the lobe, so that only the
 * distribution of cos_theta is that of the sum. */
PELL_API double pell_phase_sample_cosine(const struct pell_phase *p, double xi);
/* Samples a direction toward the viewer for light from w_i, by two independent random numbers in [0, 1]; returns its density, 1/sr. */
PELL_API double pell_phase_sample(const struct pell_phase *p, double xi1, double xi2, const double w_i[3], double w_o[3]);

/* Schlick's k with a given mean cosine, |mean_cosine| < 1; |k| is clamped to PELL_G_MAX. */
PELL_API double pell_phase_schlick_k(double mean_cosine);

#ifdef __cplusplus
}
#endif
#endif
