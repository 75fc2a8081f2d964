/* SPDX-License-Identifier: MIT
 *
 * pellucid/medium.h - describes a homogeneous medium and the reflectance of its boundary.
 *
 * Units      mm, 1/mm; eta = n_inside / n_outside. Channel 0, 1, 2 = R, G, B.
 * Ownership  numbers and arrays are the caller's; what is returned by pointer is constant data.
 * Errors     none: pell_medium_valid reports values out of range; arguments of the other functions are not checked.
 * Threads    all functions are pure and safe.
 */
#ifndef PELLUCID_MEDIUM_H
#define PELLUCID_MEDIUM_H

#include <pellucid/common.h>

#ifdef __cplusplus
extern "C" {
#endif

#define PELL_SIGMA_MAX 1e6    /* largest coefficient: a mean free path of a nanometre */
#define PELL_SIGMA_T_MIN 1e-6 /* smallest sigma_a + sigma_s_reduced: a mean free path of a kilometre */
#define PELL_G_MAX 0.9999     /* largest |g| */
#define PELL_ETA_MIN 0.25
#define PELL_ETA_MAX 4.0

/* A homogeneous medium behind a smooth boundary. */
struct pell_medium {
    double sigma_a[3];         /* absorption, [0, PELL_SIGMA_MAX] */
    double sigma_s_reduced[3]; /* sigma_s (1 - g), [0, PELL_SIGMA_MAX]; sigma_a + sigma_s_reduced >= PELL_SIGMA_T_MIN */
    double g[3];               /* mean cosine, |g| <= PELL_G_MAX; for single scattering; 0 if only sigma_s_reduced is known */
    double eta;                /* [PELL_ETA_MIN, PELL_ETA_MAX] */
};

/* The first field out of range as "sigma_a[2]" with its value and range for a message, or NULL if the medium is valid. */
struct pell_medium_fault {
    const char *field;
    double value, min, max;
};
PELL_API bool pell_medium_valid(const struct pell_medium *medium, struct pell_medium_fault *fault);

/* Mean free path 1/(sigma_a + sigma_s_reduced) and diffuse mean free path 1/sigma_tr of a channel, mm; infinite where the divisor is 0. */
PELL_API double pell_mean_free_path(const struct pell_medium *medium, int channel);
PELL_API double pell_diffuse_mean_free_path(const struct pell_medium *medium, int channel);

/* --- Fresnel ----------------------------------------------------------------------------------------------------------------- */

/* Unpolarised reflectance of a smooth dielectric; cos_i in [0, 1] on the side of the incident ray, eta = n_transmitted/n_incident. */
PELL_API double pell_fresnel(double eta, double cos_i);

/* Computation of the average diffuse reflectance: exact, the default everywhere, or by the polynomials of the literature, for eta in [1/3,
 * 3] (clamped to it, as the polynomials exceed 1 from 3.8 on). */
enum pell_fresnel_model { PELL_FRESNEL_EXACT, PELL_FRESNEL_POLY3, PELL_FRESNEL_POLY4 };

/* Fdr: reflectance averaged over a diffuse (cosine) hemisphere, with the literature's convention: eta = n_inside/n_outside > 1 is
 * light incident on the boundary from INSIDE, Fdr(n) = 2 Int_0^1 pell_fresnel(1/n, mu) mu dmu. Light from outside on the same
 * boundary: pell_fresnel_diffuse(1/n). */
PELL_API double pell_fresnel_diffuse(double eta, enum pell_fresnel_model model);

/* The same for a rough boundary: reflectance averaged over a diffuse hemisphere, eta and its convention as in pell_fresnel_diffuse (eta >
 * 1: light from INSIDE), roughness in [0, 1] clamped; GGX facets, alpha = roughness^2. A = (1 + rho_d)/(1 - rho_d) as for a smooth boundary
 * (Donner and Jensen 2005, section 5). From outside it is 2 Int albedo(mu) mu dmu of the lobe with Fresnel's F (not Schlick's), so that
 * light that is not reflected enters, as in rho_dt; from inside it follows by reciprocity, (1 - rho_d(n)) n^2 = 1 - rho_d(1/n), which holds
 * for any boundary without absorption. roughness 0 is pell_fresnel_diffuse(eta, PELL_FRESNEL_EXACT) to the last digit; else within 4e-5, in
 * some microseconds. NaN if eta is not in [PELL_ETA_MIN, PELL_ETA_MAX]. */
PELL_API double pell_fresnel_diffuse_rough(double eta, double roughness);

/* 2 Int_0^1 (1 - pell_fresnel(eta, mu)) mu dmu = 1 - Fdr(1/eta), the mean transmittance for diffuse light from outside. Dividing the
 * exit transmittance by it conserves the energy of light that has already left: L = (1 - F) M / (pi pell_fresnel_exit_norm(eta)). */
PELL_API double pell_fresnel_exit_norm(double eta);

#ifdef __cplusplus
}
#endif
#endif
