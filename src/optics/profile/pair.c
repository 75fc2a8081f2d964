/* SPDX-License-Identifier: MIT
 *
 * pair.c - profiles of one real and one virtual source: flux inside and outside a radius, and the Hankel transform, in closed
 * form. With d = sqrt(r^2 + z^2), kappa = sqrt(sigma_tr^2 + s^2), and Int over the plane:
 *
 *     z (1 + sigma d) exp(-sigma d)/d^3    outside r: 2 pi (z/d) exp(-sigma d)        transform: 2 pi exp(-kappa z)
 *     exp(-sigma d)/d                      outside r: 2 pi exp(-sigma d)/sigma        transform: 2 pi exp(-kappa z)/kappa
 *
 * The second diverges without absorption; only differences of two are used, and they are finite. */
#include "math/vec.h"
#include "optics/medium/dipole.h"
#include "optics/profile/lanes.h"
#include "optics/profile/shape.h"

double pell_profile_absorbed(double s, double x)
{
    return s > 0.0 ? -expm1(-s * x) / s : x;
}

static double inside(const struct pell_profile *p, double r)
{
    const double s = p->parameter[PAIR_SIGMA], zr = p->parameter[PAIR_ZR], zv = p->parameter[PAIR_ZV];
    const double a = p->parameter[PAIR_A], b = p->parameter[PAIR_B];
    const double flux = pell_pole_inside(zr, s, r) + pell_pole_inside(zv, s, r);
    double fluence = 0.0;
    if (b > 0.0) {
        const double dr = sqrt(r * r + zr * zr), dv = sqrt(r * r + zv * zv);
        if (r < zr) {
            fluence =
                exp(-s * zr) * pell_profile_absorbed(s, r * r / (dr + zr)) - exp(-s * zv) * pell_profile_absorbed(s, r * r / (dv + zv));
        } else {
            fluence = exp(-s * zr) * pell_profile_absorbed(s, zv - zr) -
                      exp(-s * dr) * pell_profile_absorbed(s, (zv - zr) * (zv + zr) / (dv + dr));
        }
    }
    return 2.0 * PELL_PI * (a * flux + b * fluence);
}

static double outside(const struct pell_profile *p, double r)
{
    const double s = p->parameter[PAIR_SIGMA], zr = p->parameter[PAIR_ZR], zv = p->parameter[PAIR_ZV];
    const double dr = sqrt(r * r + zr * zr), dv = sqrt(r * r + zv * zv), difference = (zv - zr) * (zv + zr) / (dv + dr);
    return 2.0 * PELL_PI *
           (p->parameter[PAIR_A] * (zr / dr * exp(-s * dr) + zv / dv * exp(-s * dv)) +
            p->parameter[PAIR_B] * exp(-s * dr) * pell_profile_absorbed(s, difference));
}

static double transform(const struct pell_profile *p, double s)
{
    const double kappa = hypot(p->parameter[PAIR_SIGMA], s), zr = p->parameter[PAIR_ZR], zv = p->parameter[PAIR_ZV];
    return 2.0 * PELL_PI *
           (p->parameter[PAIR_A] * (exp(-kappa * zr) + exp(-kappa * zv)) +
            p->parameter[PAIR_B] * exp(-kappa * zr) * pell_profile_absorbed(kappa, zv - zr));
}

static double scale(const struct pell_profile *p)
{
    return p->parameter[PAIR_ZR];
}

const struct pell_profile_shape pell_profile_pair = { inside, outside, transform, scale };

void pell_profile_pair_make(struct pell_profile *out, double sigma_tr, double zr, double zv, double a, double b)
{
    out->kind = PELL_PROFILE_KIND_POLES;
    out->parameter[PAIR_SIGMA] = sigma_tr;
    out->parameter[PAIR_ZR] = zr;
    out->parameter[PAIR_ZV] = zv;
    out->parameter[PAIR_A] = a;
    out->parameter[PAIR_B] = b;
    out->total = fmin(1.0, transform(out, 0.0)); /* rounding may lift a lossless medium above 1 */
}
