/* SPDX-License-Identifier: MIT
 *
 * dipole.c - the dipole diffusion profile, Jensen, Marschner, Levoy, Hanrahan 2001, "A Practical Model for Subsurface Light
 * Transport", eq. (4), with its total and its cumulative distribution in closed form. */
#include <pellucid/profile.h>

#include "math/vec.h"
#include "optics/medium/dipole.h"

#include <math.h>

struct pell_dipole pell_dipole_make(double sigma_a, double sigma_s_reduced, double eta, enum pell_fresnel_model model)
{
    struct pell_dipole d = { 0 };

    d.A = pell_boundary_A(eta, model, 0.0);
    d.sigma_t_reduced = sigma_a + sigma_s_reduced;
    if (!(d.sigma_t_reduced > 0.0))
        return d; /* no scattering: a profile of 0 */
    d.albedo_reduced = sigma_s_reduced / d.sigma_t_reduced;
    d.sigma_tr = sqrt(3.0 * sigma_a * d.sigma_t_reduced);
    d.zr = 1.0 / d.sigma_t_reduced;
    d.zv = d.zr * (1.0 + 4.0 * d.A / 3.0);
    return d;
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
    return d->albedo_reduced / (4.0 * PELL_PI) * (pell_pole_value(d->zr, d->sigma_tr, r) + pell_pole_value(d->zv, d->sigma_tr, r));
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
    const double inside = pell_pole_inside(d->zr, d->sigma_tr, r) + pell_pole_inside(d->zv, d->sigma_tr, r);
    return fmin(1.0, inside / (exp(-d->sigma_tr * d->zr) + exp(-d->sigma_tr * d->zv)));
}
