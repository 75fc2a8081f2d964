/* SPDX-License-Identifier: MIT
 * small.c - see small.h. */
#include "optics/medium/small.h"

#include "math/scalar.h"

#include <math.h>

#define MIN_OPTICAL 0.05 /* mean free paths: results for smaller solids, where exponentials cancel, are scaled in proportion */

/* (1 + x) exp(-x). */
static double fallen(double x)
{
    return (1.0 + x) * exp(-x);
}

double pell_small_ball(const struct pell_medium *medium, int channel, double diameter)
{
    const double sigma_t = medium->sigma_a[channel] + medium->sigma_s_reduced[channel], albedo = medium->sigma_s_reduced[channel] / sigma_t;
    const double eta = fmax(medium->eta, 1.0), optical = sigma_t * diameter, x = fmax(optical, MIN_OPTICAL),
                 critical = sqrt(1.0 - 1.0 / (eta * eta));
    const double reflected = pell_fresnel_diffuse(eta, PELL_FRESNEL_EXACT);
    const double crosses = 2.0 / (x * x) * (1.0 - fallen(x)), hits = 1.5 * (1.0 - crosses) / x;
    const double exits = hits * (1.0 - reflected) / (1.0 - reflected * crosses);
    const double collides = 1.0 - 2.0 * eta * eta / (x * x) * (fallen(critical * x) - fallen(x));

    return fmin(optical / MIN_OPTICAL, 1.0) * collides * albedo * exits / (1.0 - albedo * (1.0 - exits));
}

double pell_small_weight(const struct pell_medium *medium, int channel, double diameter)
{
    const double optical = (medium->sigma_a[channel] + medium->sigma_s_reduced[channel]) * diameter;

    return 1.0 - (double) smooth_ramp(PELL_SMALL_LOW, PELL_SMALL_HIGH, (float) fmin(optical, 1e3));
}
