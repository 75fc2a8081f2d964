/* SPDX-License-Identifier: MIT
 *
 * burley.c - normalised diffusion, Christensen and Burley 2015, "Approximate Reflectance Profiles for Efficient Subsurface
 * Scattering": R(r) = total (exp(-r/d) + exp(-r/(3 d)))/(8 pi d r), a quarter of the light in the narrow exponential and three quarters in
 * the wide one. Its transform is that of exp(-x/d)/x, 2 pi / sqrt(1/d^2 + s^2). */
#include "math/vec.h"
#include "optics/profile/lanes.h"
#include "optics/profile/shape.h"

static double inside(const struct pell_profile *p, double r)
{
    const double x = r * p->parameter[BURLEY_INVERSE];
    return p->total * (-0.25 * expm1(-x) - 0.75 * expm1(-x / 3.0));
}

static double outside(const struct pell_profile *p, double r)
{
    const double x = r * p->parameter[BURLEY_INVERSE];
    return p->total * (0.25 * exp(-x) + 0.75 * exp(-x / 3.0));
}

static double transform(const struct pell_profile *p, double s)
{
    const double x = s / p->parameter[BURLEY_INVERSE];
    return p->total * (0.25 / hypot(1.0, x) + 0.75 / hypot(1.0, 3.0 * x));
}

static double scale(const struct pell_profile *p)
{
    return 1.0 / p->parameter[BURLEY_INVERSE];
}

const struct pell_profile_shape pell_profile_burley = { inside, outside, transform, scale };

void pell_profile_burley_make(struct pell_profile *out, double total, double d)
{
    out->kind = PELL_PROFILE_KIND_BURLEY;
    out->total = total;
    out->parameter[BURLEY_INVERSE] = 1.0 / d;
    out->parameter[BURLEY_SCALE] = total / (8.0 * PELL_PI * d);
    out->parameter[BURLEY_NEAR] = 1e-6 * d;
}
