/* SPDX-License-Identifier: MIT
 *
 * pellucid/specular.h - rough surfaces: specular lobes, their albedo, and the light that remains for the medium below.
 *
 *     GGX      f = rho_s D G F / (4 (n.l)(n.v)), alpha = roughness^2, height-correlated Smith G   (Walter et al. 2007; Heitz 2014, eq. 99)
 *     Kelemen  f = rho_s D F / (h.h), h = l + v not normalised, D = exp(-tan^2 a/m^2) / (pi m^2 cos^4 a), m = roughness
 *              (Kelemen and Szirmay-Kalos 2001; D is Beckmann's with Int D cos = 1: public copies of it leave out the pi)
 *     Phong    f = rho_s (n + 2)/(2 pi) cos^n(l, r) F, r = v mirrored; n = (2/alpha^2 - 2)/4
 *              (Phong 1975; Lafortune and Willems 1994: the factor makes the albedo 1 at normal incidence for F = 1)
 *     Blinn    f = rho_s (n + 2)(n + 4)/(8 pi (2^(-n/2) + n)) cos^n(n, h) F, h = l + v normalised; n = 2/alpha^2 - 2
 *              (Blinn 1977; the factor is exact: 1/Int cos^n(t/2) cos t dw, so that the albedo is 1 there, too)
 *     rho_dt(mu, m) = 1 - rho_s albedo(mu, m)    albedo: Int f n.l dl for rho_s = 1
 *
 * F is Schlick's of h.v with F0 = ((eta - 1)/(eta + 1))^2 of a dielectric, or a metal's. All light that a lobe does not reflect enters the
 * medium: energy that a single-scattering microfacet model loses counts as transmitted, so energy is conserved.
 *
 * The two Phong lobes serve to reproduce images of papers that used them. cos^n of the half angle falls off like Beckmann's
 * exp(-tan^2/alpha^2) (Walter et al. 2007), alpha = roughness^2 as for GGX; the angle from the mirror direction is twice the half angle,
 * hence the quarter, and the same roughness gives the same width of highlight. n runs from 0 at roughness 1, a constant 1/pi where l.r > 0
 * or n.h > 0, to 2.5e6 (Blinn) or 6.2e5 (Phong) at the smallest roughness. Both are reciprocal and never reflect more than arrives, but
 * they are not microfacet models: at grazing angles narrow lobes reflect mu F (Phong) and mu^2 F (Blinn) instead of F. A highlight that
 * brightens at the rim needs GGX or Kelemen.
 *
 * Units      directions are unit vectors that point away from the surface; mu = n.w in [0, 1]; roughness in [0, 1].
 * Ownership  numbers and arrays are the caller's; what is returned by pointer is constant data.
 * Errors     none: arguments out of range are clamped.
 * Threads    all functions are pure and safe; nothing is allocated.
 */
#ifndef PELLUCID_SPECULAR_H
#define PELLUCID_SPECULAR_H

#include <pellucid/common.h>

#ifdef __cplusplus
extern "C" {
#endif

/* Values are stable. */
enum pell_specular_model { PELL_SPECULAR_GGX, PELL_SPECULAR_KELEMEN, PELL_SPECULAR_PHONG, PELL_SPECULAR_BLINN_PHONG };

#define PELL_SPECULAR_MODELS 4
#define PELL_ALBEDO_MU 64        /* entries over mu: entry i is mu = (i / 63)^2, denser at grazing angles */
#define PELL_ALBEDO_ROUGHNESS 32 /* entries over roughness in [PELL_ROUGHNESS_MIN, 1] */
#define PELL_ROUGHNESS_MIN 0.03f /* smaller values are clamped to it */

/* "ggx", "kelemen", "phong", "blinn-phong"; static. Other values count as PELL_SPECULAR_GGX, here and below. */
PELL_API const char *pell_specular_name(enum pell_specular_model model);

/* The lobe f for rho_s = 1, with F from f0, 1/sr; 0 where l or v is not above the surface. */
PELL_API double pell_specular_value(enum pell_specular_model model, double roughness, double f0, const double n[3], const double l[3],
                                    const double v[3]);

/* The albedo of a lobe over mu and roughness, for every F0 at once: Schlick's F is linear in F0, so albedo = F0 scale + bias. A value
 * of fixed size (17 KiB) without pointers; it depends on the model alone. `albedo` holds the directional albedo, `mean` its
 * cosine-weighted average 2 Int albedo mu dmu. */
struct pell_specular_table {
    float albedo[PELL_ALBEDO_MU][PELL_ALBEDO_ROUGHNESS][2]; /* scale, bias */
    float mean[PELL_ALBEDO_ROUGHNESS][2];
};

/* Integrates a table; tens of milliseconds. */
PELL_API void pell_specular_table_make(enum pell_specular_model model, struct pell_specular_table *out);

/* Albedo in [0, 1] by bilinear look-up, within 0.005 of the integral; rho_dt = 1 - rho_s albedo. */
PELL_API float pell_specular_albedo(const struct pell_specular_table *table, float f0, float mu, float roughness);
/* Mean albedo over a cosine-weighted hemisphere. */
PELL_API float pell_specular_mean(const struct pell_specular_table *table, float f0, float roughness);

#ifdef __cplusplus
}
#endif
#endif
