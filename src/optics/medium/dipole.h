/* SPDX-License-Identifier: MIT
 *
 * dipole.h - shared by the dipole, the multipole and pairs of poles: one pole, and the boundary it is mirrored at.
 *
 * Units      mm, 1/mm.
 * Threads    pure and safe.
 */
#ifndef PELL_OPTICS_DIPOLE_H
#define PELL_OPTICS_DIPOLE_H

#include <pellucid/medium.h>

#include <math.h>

/* A pole at depth z, z (1 + s d) exp(-s d)/d^3 with d^2 = r^2 + z^2 (Jensen et al. 2001, eq. (4)), 1/mm^2; negative for z < 0. Its
 * integral over the plane is 2 pi exp(-s |z|) sign(z). */
static inline double pell_pole_value(double z, double sigma_tr, double r)
{
    const double d = sqrt(r * r + z * z);
    return z * (1.0 + sigma_tr * d) * exp(-sigma_tr * d) / (d * d * d);
}

/* Integral of the pole inside r, over 2 pi: exp(-s z) - (z/d) exp(-s d), z > 0, without cancellation at small r. */
static inline double pell_pole_inside(double z, double sigma_tr, double r)
{
    const double d = sqrt(r * r + z * z), step = r * r / (d + z); /* d - z */
    return exp(-sigma_tr * z) * (step / d - z / d * expm1(-sigma_tr * step));
}

/* A = (1 + Fdr)/(1 - Fdr) of a boundary: by `model` if it is smooth; a rough one is always exact. */
static inline double pell_boundary_A(double eta, enum pell_fresnel_model model, double roughness)
{
    const double fdr = roughness > 0.0 ? pell_fresnel_diffuse_rough(eta, roughness) : pell_fresnel_diffuse(eta, model);
    return (1.0 + fdr) / (1.0 - fdr);
}

#endif
