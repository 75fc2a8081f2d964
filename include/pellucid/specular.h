/* SPDX-License-Identifier: MIT
 *
 * pellucid/specular.h - rough surfaces: specular lobes, what they reflect of all light, and what they leave for the medium below.
 *
 *     GGX      f = rho_s D G F / (4 (n.l)(n.v)), alpha = roughness^2, height-correlated Smith G   (Walter et al. 2007; Heitz 2014, eq. 99)
 *     Kelemen  f = rho_s D F / (h.h), h = l + v not normalised, D = exp(-tan^2 a/m^2) / (pi m^2 cos^4 a), m = roughness
 *              (Kelemen and Szirmay-Kalos 2001; D is Beckmann's with Int D cos = 1: public copies of it leave out the pi)
 *     rho_dt(mu, m) = 1 - rho_s albedo(mu, m)    albedo: Int f n.l dl for rho_s = 1
 *
 * F is Schlick's with F0 = ((eta - 1)/(eta + 1))^2 of a dielectric, or a metal's. All that a lobe does not reflect enters: what single
 * scattering between facets loses counts as entering light, so that nothing is lost or made.
 *
 * Units      directions are unit vectors that point away from the surface; mu = n.w in [0, 1]; roughness in [0, 1].
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
enum pell_specular_model { PELL_SPECULAR_GGX, PELL_SPECULAR_KELEMEN };

#define PELL_SPECULAR_MODELS 2
#define PELL_ALBEDO_MU 64        /* entries over mu: entry i is mu = (i / 63)^2, fine where light grazes */
#define PELL_ALBEDO_ROUGHNESS 32 /* entries over roughness in [PELL_ROUGHNESS_MIN, 1] */
#define PELL_ROUGHNESS_MIN 0.03f /* narrower lobes are drawn this wide */

/* f for rho_s = 1 and F from f0, 1/sr; 0 where l or v is not above the surface. */
PELL_API double pell_specular_value(enum pell_specular_model model, double roughness, double f0, const double n[3], const double l[3],
                                    const double v[3]);

/* The albedo of a lobe over mu and roughness, for every F0 at once: Schlick's F is linear in F0, so albedo = F0 scale + bias. A value
 * of fixed size (17 KiB) without pointers; it depends on the model alone. `albedo` holds what a renderer looks up, `mean` its
 * cosine-weighted average 2 Int albedo mu dmu. */
struct pell_specular_table {
    float albedo[PELL_ALBEDO_MU][PELL_ALBEDO_ROUGHNESS][2]; /* scale, bias */
    float mean[PELL_ALBEDO_ROUGHNESS][2];
};

/* Integrates a table; tens of milliseconds. */
PELL_API void pell_specular_table_make(enum pell_specular_model model, struct pell_specular_table *out);

/* Albedo in [0, 1] by bilinear look-up, within 0.005 of the integral; rho_dt = 1 - rho_s albedo. */
PELL_API float pell_specular_albedo(const struct pell_specular_table *table, float f0, float mu, float roughness);
/* Its mean over a diffuse hemisphere. */
PELL_API float pell_specular_mean(const struct pell_specular_table *table, float f0, float roughness);

#ifdef __cplusplus
}
#endif
#endif
