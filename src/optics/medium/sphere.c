/* SPDX-License-Identifier: MIT
 *
 * sphere.c - ratio of the reflectance of a curved surface to that of a plane one, by diffusion in a sphere or around a spherical cavity.
 *
 * A source at depth z0 = 1/sigma_t' is distributed uniformly below the sphere of radius a; fluence is 0 at the distance zb = 2 A D above it
 * (Jensen et al. 2001). With u = r phi the diffusion equation is u'' = sigma_tr^2 u, so that in a sphere, R = a + zb, and around a cavity,
 * the fractions
 *
 *     ball     sinh(sigma_tr (a - z0))/sinh(sigma_tr R) (a cosh(sigma_tr zb) + sinh(sigma_tr zb)/sigma_tr)/(a - z0)
 *     hollow   exp(-sigma_tr (z0 + zb)) (a cosh(sigma_tr zb) - sinh(sigma_tr zb)/sigma_tr)/(a + z0)
 *
 * of the light exit; for a half-space exp(-sigma_tr (z0 + zb)) cosh(sigma_tr zb). On a sphere the area within a chord r is pi r^2, as on a
 * plane, but no chord is longer than 2 a: a profile over chord lengths integrates to its fraction inside 2 a. */
#include "optics/medium/dipole.h"

#include <pellucid/profile.h>

#define MIN_RADIUS 2.0 /* least radius, in z0 + zb: diffusion does not apply to smaller spheres */

double pell_curvature_gain(const struct pell_medium *medium, int channel, const struct pell_profile *profile, double curvature)
{
    const double sigma_t = medium->sigma_a[channel] + medium->sigma_s_reduced[channel], z0 = 1.0 / sigma_t;
    const double sigma_tr = sqrt(3.0 * medium->sigma_a[channel] * sigma_t);
    const double zb = 2.0 / 3.0 * z0 * pell_boundary_A(medium->eta, PELL_FRESNEL_EXACT, 0.0);
    const double reach = zb * sigma_tr > 1e-6 ? tanh(zb * sigma_tr) / sigma_tr : zb;
    double a, gain, inside;

    if (!(sigma_t > 0.0) || !isfinite(curvature) || curvature == 0.0)
        return 1.0;
    if (curvature > 0.0) {
        const double full = sigma_tr * ((a = fmax(1.0 / curvature, MIN_RADIUS * (z0 + zb))) + zb), part = sigma_tr * (a - z0);
        /* sinh(part)/sinh(full) over exp(part - full) */
        const double decay = full > 1e-6 ? expm1(-2.0 * part) / expm1(-2.0 * full) : (a - z0) / (a + zb);
        gain = decay * (a + reach) / (a - z0);
    } else {
        a = fmax(-1.0 / curvature, MIN_RADIUS * (z0 + zb));
        gain = (a - reach) / (a + z0);
    }
    inside = pell_profile_cdf(profile, 2.0 * a);
    return inside > 0.0 ? gain / inside : 1.0;
}
