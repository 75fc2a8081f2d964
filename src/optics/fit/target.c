/* SPDX-License-Identifier: MIT
 *
 * target.c - the nodes and values that a fit works on, and error (10) of d'Eon, Luebke, Enderton 2007 by the same integrals.
 *
 * The integrals are trapezoidal sums in x = log r, whose error for these integrands falls as exp(-pi^2/(2 step)): a Gaussian of r is
 * analytic and bounded in |Im x| < pi/4, a pole in |Im x| < pi/2. Below the first node everything is taken as constant, and the sum to
 * log r = -inf is the geometric series that the first node's weight holds. Where the integrals end at r_max, the last nodes have Gregory's
 * weights. */
#include "optics/fit/fit.h"

#include "math/vec.h"

#include <math.h>
#include <string.h>

#define STEP 0.125      /* of log r */
#define STEP_ERROR 0.08 /* step when only the error is computed */
#define STEP_ENDS 0.04  /* where the integrals end at r_max: Gregory's weights err by its sixth power */
#define INSIDE 1e-3     /* fraction of the light inside the radius where nodes and variances begin to matter */
#define CENTRE 0.05     /* a profile that is unbounded at r = 0 is weighted by r^2/(r^2 + q^2), q the radius with this fraction inside */

/* Places nodes from a to b in the unit, with their weights; `taper` is q or 0. */
static void place_nodes(struct pell_fit_target *t, double a, double b, double step, bool ends, double taper)
{
    static const double gregory[5] = { 95.0 / 288.0, 317.0 / 240.0, 23.0 / 30.0, 793.0 / 720.0, 157.0 / 160.0 };
    const double range = log(b / a);

    t->nodes = (int) fmin(fmax(ceil(range / step) + 1.0, 16.0), FIT_NODES);
    step = range / (t->nodes - 1);
    for (int i = 0; i < t->nodes; i++) {
        const double r = a * exp(step * i);
        double weight = step;
        if (i == 0)
            weight /= -expm1(-2.0 * step);
        if (ends && t->nodes - 1 - i < 5)
            weight *= gregory[t->nodes - 1 - i];
        if (taper > 0.0)
            weight *= r * r / (r * r + taper * taper);
        t->r2[i] = r * r;
        t->root[i] = r * sqrt(weight);
    }
    t->closed = !ends && !(taper > 0.0);
}

/* From R at the nodes to rhs and norm. */
static bool normalise(struct pell_fit_target *t, int c)
{
    double sum = 0.0;

    for (int i = 0; i < t->nodes; i++) {
        t->rhs[c][i] *= t->root[i];
        sum += t->rhs[c][i] * t->rhs[c][i];
    }
    t->norm[c] = sqrt(sum);
    if (!(t->norm[c] > 0.0) || !isfinite(t->norm[c]))
        return false;
    for (int i = 0; i < t->nodes; i++)
        t->rhs[c][i] /= t->norm[c];
    return true;
}

/* --- Dipoles ------------------------------------------------------------------------------------------------------------------- */

/* Beyond this radius a dipole adds less than 1e-13 to any integral: exponential tail, or r^-4 without absorption. */
static double outer_radius(const struct pell_dipole *d)
{
    const double far = 2e3 * d->zv;
    return d->sigma_tr * far > 24.0 ? fmin(far, 24.0 / d->sigma_tr + 2.0 * d->zv) : far;
}

/* Keeps 40 bits. The same medium in another unit differs in the last bits, and a long search would amplify that: rounded, it is the same
 * problem, with the same variances up to the unit. */
static double rounded(double x)
{
    int exponent;
    const double mantissa = frexp(x, &exponent);
    return ldexp(nearbyint(ldexp(mantissa, 40)), exponent - 40);
}

void pell_fit_target_dipoles(const struct pell_dipole *dipoles, int channels, const struct pell_fit_params *params,
                             struct pell_fit_target *t)
{
    struct pell_dipole scaled[3];
    double inner = INFINITY, outer = 0.0;

    t->channels = channels;
    t->free_energy = params->free_energy;
    memset(t->max_total, 0, sizeof(t->max_total));
    for (int c = 0; c < channels; c++)
        inner = fmin(inner, dipoles[c].zr);
    t->unit = inner;
    for (int c = 0; c < channels; c++) {
        scaled[c] = dipoles[c];
        scaled[c].albedo_reduced = 1.0;
        scaled[c].zr = rounded(dipoles[c].zr / inner);
        scaled[c].zv = rounded(dipoles[c].zv / inner);
        scaled[c].sigma_tr = rounded(dipoles[c].sigma_tr * inner);
        outer = fmax(outer, outer_radius(&scaled[c]));
    }
    const double end = rounded(params->r_max_mm / inner);
    const bool ends = end > 0.0 && end < outer;
    if (ends)
        outer = end;
    t->low = log(0.01);
    t->high = 2.0 * log(outer) - 1.0;
    place_nodes(t, fmin(3e-3, 1e-3 * outer), outer, ends ? STEP_ENDS : STEP, ends, 0.0);
    if (t->high < t->low + 2.0)
        t->high = t->low + 2.0;
    for (int c = 0; c < channels; c++) {
        for (int i = 0; i < t->nodes; i++)
            t->rhs[c][i] = pell_dipole_rd(&scaled[c], sqrt(t->r2[i]));
        t->total[c] = pell_dipole_total(&scaled[c]);
        (void) normalise(t, c); /* a dipole is positive and finite */
    }
}

/* --- Profiles ------------------------------------------------------------------------------------------------------------------ */

/* Where r R has fallen to 1e-8 of its greatest value. */
static double outer_of_profile(const struct pell_profile *p, double r)
{
    double greatest = 0.0;

    for (int i = 0; i < 200; i++, r *= 1.3) {
        const double value = r * pell_profile_eval(p, r);
        greatest = fmax(greatest, value);
        if (!(value > 1e-8 * greatest))
            break;
    }
    return r;
}

bool pell_fit_target_profiles(const struct pell_profile *const *profiles, int channels, const struct pell_fit_params *params, double step,
                              struct pell_fit_target *t)
{
    double unit = INFINITY, inner = INFINITY, centre = INFINITY, outer = 0.0;
    bool unbounded = false;

    t->channels = channels;
    t->free_energy = params->free_energy;
    memset(t->max_total, 0, sizeof(t->max_total));
    for (int c = 0; c < channels; c++) {
        const double median = pell_profile_sample(profiles[c], 0.5), q = pell_profile_sample(profiles[c], INSIDE);
        if (!(median > 0.0) || !(q > 0.0) || !isfinite(median))
            return false;
        unit = fmin(unit, median);
        inner = fmin(inner, q);
        centre = fmin(centre, pell_profile_sample(profiles[c], CENTRE));
        outer = fmax(outer, outer_of_profile(profiles[c], median));
        unbounded = unbounded || pell_profile_eval(profiles[c], q / 8.0) > 2.0 * pell_profile_eval(profiles[c], q);
    }
    const bool ends = params->r_max_mm > 0.0 && params->r_max_mm < outer;
    if (ends)
        outer = params->r_max_mm;
    if (!isfinite(outer) || !(outer / unit < 1e100) || !(outer / unit > 1e-100) || !(inner / unit > 1e-100))
        return false;
    t->unit = unit;
    outer /= unit;
    inner /= unit;
    centre /= unit;
    if (unbounded)
        inner = 0.2 * centre;
    t->low = 2.0 * log(fmin(inner, outer));
    t->high = fmax(2.0 * log(outer) - 1.0, t->low + 2.0);
    place_nodes(t, fmin(0.05 * inner, 1e-3 * outer), outer, ends ? STEP_ENDS : step > 0.0 ? step : STEP, ends, unbounded ? centre : 0.0);
    for (int c = 0; c < channels; c++) {
        double r[FIT_NODES];
        for (int i = 0; i < t->nodes; i++)
            r[i] = sqrt(t->r2[i]) * unit;
        pell_profile_eval_many(profiles[c], r, t->rhs[c], (size_t) t->nodes);
        for (int i = 0; i < t->nodes; i++)
            t->rhs[c][i] *= unit * unit;
        t->total[c] = pell_profile_total(profiles[c]);
        if (!normalise(t, c))
            return false;
    }
    return true;
}

double pell_gaussians_error(const struct pell_gaussians *g, int channel, const struct pell_profile *profile, double r_max_mm)
{
    const struct pell_fit_params params = { .r_max_mm = r_max_mm };
    struct pell_fit_target t;
    double sum = 0.0;

    if (channel < 0 || channel > 2 || g->count < 0 || g->count > PELL_GAUSSIANS_MAX || !(r_max_mm >= 0.0) ||
        !(pell_profile_total(profile) > 0.0) || !pell_fit_target_profiles(&profile, 1, &params, STEP_ERROR, &t))
        return NAN;
    for (int i = 0; i < t.nodes; i++) {
        const double value = pell_gaussians_eval(g, channel, sqrt(t.r2[i]) * t.unit) * t.unit * t.unit;
        const double off = t.rhs[0][i] - t.root[i] * value / t.norm[0];
        sum += off * off;
    }
    return sqrt(sum);
}
