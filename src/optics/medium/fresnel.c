/* SPDX-License-Identifier: MIT
 *
 * fresnel.c - reflectance of a smooth dielectric boundary: Fresnel's equations (Born and Wolf, "Principles of Optics", 1.5.2), and
 * their average over a diffuse hemisphere (Duntley 1942; Walsh 1926), and the polynomials of the literature (Egan and Hilgeman
 * 1979) with the three digits of Jensen et al. 2001 and the four of Donner and Jensen 2005. */
#include <pellucid/medium.h>

#include "math/quadrature.h"

#include <math.h>

double pell_fresnel(double eta, double cos_i)
{
    const double c = fmin(fmax(cos_i, 0.0), 1.0);
    const double sin_t2 = (1.0 - c * c) / (eta * eta);
    if (sin_t2 >= 1.0)
        return 1.0; /* total internal reflection, and grazing light */
    const double ct = sqrt(1.0 - sin_t2);
    const double rs = (c - eta * ct) / (c + eta * ct), rp = (eta * c - ct) / (eta * c + ct);
    return 0.5 * (rs * rs + rp * rp);
}

static double weighted_reflectance(double mu, const void *eta)
{
    return 2.0 * mu * pell_fresnel(*(const double *) eta, mu);
}

/* Light from the optically thinner side, n > 1: 2 Int_0^1 F mu dmu. The closed form cancels near n = 1, where the integral is quick. */
static double outside(double n)
{
    if (n < 1.05)
        return n > 1.0 ? pell_integrate(weighted_reflectance, &n, 0.0, 1.0, 1e-15, 1e-13, NULL) : 0.0;
    const double n2 = n * n, n4 = n2 * n2, p = n2 + 1.0, m = n2 - 1.0;
    return 0.5 + (n - 1.0) * (3.0 * n + 1.0) / (6.0 * (n + 1.0) * (n + 1.0)) + n2 * m * m / (p * p * p) * log((n - 1.0) / (n + 1.0)) -
           2.0 * n2 * n * (n2 + 2.0 * n - 1.0) / (p * (n4 - 1.0)) + 8.0 * n4 * (n4 + 1.0) / (p * (n4 - 1.0) * (n4 - 1.0)) * log(n);
}

/* Beyond a ratio of 3 the polynomials leave the fitted range, and from 3.8 on they exceed 1: they are constant beyond 3. */
static double polynomial(double ratio, enum pell_fresnel_model model)
{
    const double eta = ratio > 3.0 ? 3.0 : ratio < 1.0 / 3.0 ? 1.0 / 3.0 : ratio; /* NaN is kept */

    if (eta < 1.0)
        return -0.4399 + 0.7099 / eta - 0.3319 / (eta * eta) + 0.0636 / (eta * eta * eta);
    if (model == PELL_FRESNEL_POLY3)
        return -1.440 / (eta * eta) + 0.710 / eta + 0.668 + 0.0636 * eta;
    return eta != 1.0 ? -1.4399 / (eta * eta) + 0.7099 / eta + 0.6681 + 0.0636 * eta : 0.0; /* equal indices reflect nothing */
}

double pell_fresnel_diffuse(double eta, enum pell_fresnel_model model)
{
    if (model == PELL_FRESNEL_EXACT) /* inside from outside by reciprocity: (1 - Fdr(n)) n^2 = 1 - Fdr(1/n) */
        return eta < 1.0 ? outside(1.0 / eta) : 1.0 - (1.0 - outside(eta)) / (eta * eta);
    return polynomial(eta, model);
}

double pell_fresnel_exit_norm(double eta)
{
    return 1.0 - pell_fresnel_diffuse(1.0 / eta, PELL_FRESNEL_EXACT);
}
