/* SPDX-License-Identifier: MIT
 *
 * dipole.c - the dipole diffusion profile, Jensen, Marschner, Levoy, Hanrahan 2001, "A Practical Model for Subsurface Light
 * Transport", eq. (4), with its total and its cumulative distribution in closed form. */
#include <pellucid/profile.h>

#include "math/vec.h"

#include <math.h>

struct pell_dipole pell_dipole_make(double sigma_a, double sigma_s_reduced, double eta, enum pell_fresnel_model model)
{
    struct pell_dipole d = { 0 };
    const double fdr = pell_fresnel_diffuse(eta, model);

    d.A = (1.0 + fdr) / (1.0 - fdr);
    d.sigma_t_reduced = sigma_a + sigma_s_reduced;
    if (!(d.sigma_t_reduced > 0.0))
        return d; /* nothing there: a profile of 0 */
    d.albedo_reduced = sigma_s_reduced / d.sigma_t_reduced;
    d.sigma_tr = sqrt(3.0 * sigma_a * d.sigma_t_reduced);
    d.zr = 1.0 / d.sigma_t_reduced;
    d.zv = d.zr * (1.0 + 4.0 * d.A / 3.0);
    return d;
}

static double pole(double z, double sigma_tr, double r)
{
    const double d = sqrt(r * r + z * z);
    return z * (1.0 + sigma_tr * d) * exp(-sigma_tr * d) / (d * d * d);
}

/* 1 - power of the pole outside r / its whole power, times exp(-sigma_tr z): exp(-s z) - (z/d) exp(-s d), written so that nothing
 * cancels at small r. */
static double pole_inside(double z, double sigma_tr, double r)
{
    const double d = sqrt(r * r + z * z), step = r * r / (d + z); /* d - z */
    return exp(-sigma_tr * z) * (step / d - z / d * expm1(-sigma_tr * step));
}

/* Squares stay finite. */
static double clamp_radius(double r)
{
    return fmin(fabs(r), 1e150);
}

double pell_dipole_rd(const struct pell_dipole *d, double r_mm)
{
    const double r = clamp_radius(r_mm);
    if (!(d->albedo_reduced > 0.0))
        return 0.0;
    return d->albedo_reduced / (4.0 * PELL_PI) * (pole(d->zr, d->sigma_tr, r) + pole(d->zv, d->sigma_tr, r));
}

double pell_dipole_total(const struct pell_dipole *d)
{
    return 0.5 * d->albedo_reduced * (exp(-d->sigma_tr * d->zr) + exp(-d->sigma_tr * d->zv));
}

double pell_dipole_cdf(const struct pell_dipole *d, double r_mm)
{
    const double r = clamp_radius(r_mm);
    if (!(d->zr > 0.0))
        return 1.0;
    const double inside = pole_inside(d->zr, d->sigma_tr, r) + pole_inside(d->zv, d->sigma_tr, r);
    return fmin(1.0, inside / (exp(-d->sigma_tr * d->zr) + exp(-d->sigma_tr * d->zv)));
}
