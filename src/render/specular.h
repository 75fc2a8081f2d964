/* SPDX-License-Identifier: MIT
 *
 * specular.h - specular lobes and what they leave for the light below: one home for both (spec "Rough boundaries").
 *
 *     Kelemen - Szirmay-Kalos 2001:  f = rho_s D F / (h . h), h = l + v not normalised,
 *                                    D = exp(-tan^2 a / m^2) / (pi m^2 cos^4 a) (Beckmann, Int D cos = 1), F Schlick, F0 from eta
 *     GGX (Walter et al. 2007):      f = rho_s D G F / (4 (n.l) (n.v)), alpha = roughness^2, height-correlated Smith G
 *     rho_dt(mu, m) = 1 - rho_s albedo_f(mu, m), albedo_f the hemispherical albedo of f for rho_s = 1
 */
#ifndef PELL_SPECULAR_H
#define PELL_SPECULAR_H

#include "base/base.h"
#include "math/vec.h"

#include <pellucid/scene.h>

/* Value of the lobe for rho_s = 1 without F: n, l, v unit, n.l > 0, n.v > 0. Multiply by F and by n.l. */
float pell_specular_shape(enum pell_specular_model model, float roughness, struct pell_vec3 n, struct pell_vec3 l, struct pell_vec3 v);
/* Schlick's F for cos = h . v, f0 of a dielectric: ((eta - 1)/(eta + 1))^2. */
static inline float pell_schlick(float f0, float cos_h)
{
    const float c = cos_h < 1.0f ? 1.0f - cos_h : 0.0f, c2 = c * c;
    return f0 + (1.0f - f0) * c2 * c2 * c;
}

/* albedo_f over (mu, roughness) for each material's (model, eta), integrated at start-up; materials of one (model, eta) share. */
struct pell_specular_tables;
PELL_NODISCARD enum pell_result pell_specular_tables_create(struct pell_context *ctx, const struct pell_scene *scene,
                                                            struct pell_specular_tables **out);
void pell_specular_tables_destroy(struct pell_specular_tables **tables);

/* albedo_f(mu, roughness) in [0, 1], mu = n.w in [0, 1]; bilinear. */
float pell_specular_albedo(const struct pell_specular_tables *tables, size_t material, float mu, float roughness);
/* The same for another reflectance at normal incidence than the material's dielectric one: metals. */
float pell_specular_albedo_f0(const struct pell_specular_tables *tables, size_t material, float f0, float mu, float roughness);
/* Cosine-weighted hemispherical mean 2 Int albedo_f mu dmu at a roughness. */
float pell_specular_mean(const struct pell_specular_tables *tables, size_t material, float roughness);
/* Fresnel's F_t of a smooth boundary for the material's eta, from a table; and its cosine-weighted mean 1 - Fdr_ext. */
float pell_boundary_transmittance(const struct pell_specular_tables *tables, size_t material, float mu);
float pell_boundary_mean(const struct pell_specular_tables *tables, size_t material);

#endif
