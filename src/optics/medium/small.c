/* SPDX-License-Identifier: MIT
 * small.c - see small.h. */
#include "optics/medium/small.h"

#include "math/scalar.h"

#include <math.h>

#define LEAST 0.05 /* mean free paths: below, differences of exponentials cancel, and results are extrapolated in proportion */

/* (1 + x) exp(-x). */
static double fallen(double x)
{
    return (1.0 + x) * exp(-x);
}

double pell_small_ball(const struct pell_medium *medium, int channel, double diameter)
{
    const double sigma_t = medium->sigma_a[channel] + medium->sigma_s_reduced[channel], albedo = medium->sigma_s_reduced[channel] / sigma_t;
    const double eta = fmax(medium->eta, 1.0), optical = sigma_t * diameter, x = fmax(optical, LEAST),
                 critical = sqrt(1.0 - 1.0 / (eta * eta));
    const double kept = pell_fresnel_diffuse(eta, PELL_FRESNEL_EXACT);
    const double crosses = 2.0 / (x * x) * (1.0 - fallen(x)), meets = 1.5 * (1.0 - crosses) / x;
    const double leaves = meets * (1.0 - kept) / (1.0 - kept * crosses);
    const double collides = 1.0 - 2.0 * eta * eta / (x * x) * (fallen(critical * x) - fallen(x));

    return fmin(optical / LEAST, 1.0) * collides * albedo * leaves / (1.0 - albedo * (1.0 - leaves));
}

double pell_small_share(const struct pell_medium *medium, int channel, double diameter)
{
    const double optical = (medium->sigma_a[channel] + medium->sigma_s_reduced[channel]) * diameter;

    return 1.0 - (double) smooth_ramp(PELL_SMALL_LOW, PELL_SMALL_HIGH, (float) fmin(optical, 1e3));
}
