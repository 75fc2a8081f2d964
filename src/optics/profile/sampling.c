/* SPDX-License-Identifier: MIT
 *
 * sampling.c - importance sampling: the dipole's radius in closed form except for one root, Mertens et al. 2003, "Efficient Rendering of
 * Local Subsurface Scattering", section 4, and inverse distributions over the albedo. */
#include <pellucid/sampling.h>

#include "math/vec.h"

#include <math.h>
#include <string.h>

static double unit(double xi)
{
    return xi > 0.0 ? (xi < 1.0 ? xi : 1.0 - 0x1p-53) : 0.0;
}

/* --- Dipole ---------------------------------------------------------------------------------------------------------------------- */

double pell_pole_sample(double z_mm, double sigma_tr, double xi)
{
    const double x = sigma_tr * z_mm, target = -log1p(-unit(xi));
    double y = target;

    /* With y = log u: x expm1(y) + y = target, increasing and convex, so that Newton's method from the right converges monotonically. */
    if (x > 0.0) {
        y = fmin(y, log1p(target / x));
        for (int i = 0; i < 60; i++) {
            const double e = expm1(y), step = (x * e + y - target) / (x * (e + 1.0) + 1.0);
            if (!(step > 4e-16 * y))
                break;
            y -= step;
        }
    }
    const double more = expm1(y); /* u - 1 */
    return z_mm * sqrt(more * (more + 2.0));
}

double pell_dipole_real_share(const struct pell_dipole *d)
{
    return 1.0 / (1.0 + exp(-d->sigma_tr * (d->zv - d->zr)));
}

double pell_dipole_sample(const struct pell_dipole *d, double xi_pole, double xi_radius)
{
    if (!(d->zr > 0.0))
        return 0.0;
    return pell_pole_sample(unit(xi_pole) < pell_dipole_real_share(d) ? d->zr : d->zv, d->sigma_tr, xi_radius);
}

double pell_dipole_sample_one(const struct pell_dipole *d, double xi)
{
    const double real = pell_dipole_real_share(d), u = unit(xi);
    if (!(d->zr > 0.0))
        return 0.0;
    return u < real ? pell_pole_sample(d->zr, d->sigma_tr, u / real) : pell_pole_sample(d->zv, d->sigma_tr, (u - real) / (1.0 - real));
}

double pell_dipole_pdf(const struct pell_dipole *d, double r_mm)
{
    const double r = fmin(fabs(r_mm), 1e150), s = d->sigma_tr;
    const double dr = sqrt(r * r + d->zr * d->zr), dv = sqrt(r * r + d->zv * d->zv);
    if (!(d->albedo_reduced > 0.0) || !(r_mm == r_mm))
        return 0.0;
    /* Both over exp(-s zr), as the total of a strong absorber underflows; d - z without cancellation. */
    const double real = d->zr * (1.0 + s * dr) * exp(-s * r * r / (dr + d->zr)) / (dr * dr * dr);
    const double virtual = d->zv * (1.0 + s * dv) * exp(-s * (d->zv - d->zr + r * r / (dv + d->zv))) / (dv * dv * dv);
    return (real + virtual) / (2.0 * PELL_PI * (1.0 + exp(-s * (d->zv - d->zr))));
}

/* --- Tables ---------------------------------------------------------------------------------------------------------------------- */

#define COLUMN_STEP (2.0 * PELL_SAMPLING_REACH / (PELL_SAMPLING_QUANTILES - 1))
#define DARKEST 1e-9 /* the albedo used in place of 0, at which a profile has no light to distribute */

enum pell_result pell_sampling_table_make(enum pell_profile_model model, double eta, double g, const struct pell_profile_params *params,
                                          struct pell_sampling_table *out)
{
    if (!out)
        return PELL_ERR_INVALID;

    struct pell_profile p;

    memset(out, 0, sizeof(*out));
    for (int i = 0; i < PELL_SAMPLING_ALBEDOS; i++) {
        const double f = (double) i / (PELL_SAMPLING_ALBEDOS - 1), absorbed = fmin(f * f * f * f, 1.0 - DARKEST);
        const struct pell_medium m = { { absorbed, 1.0, 1.0 }, { 1.0 - absorbed, 1.0, 1.0 }, { g, 0.0, 0.0 }, eta };
        const enum pell_result res = pell_profile_make(model, &m, 0, params, &p);
        if (res != PELL_OK) {
            memset(out, 0, sizeof(*out));
            return res;
        }
        for (int j = 0; j < PELL_SAMPLING_QUANTILES; j++) {
            const double t = COLUMN_STEP * j - PELL_SAMPLING_REACH, xi = 1.0 / (1.0 + exp(-t)), rest = 1.0 / (1.0 + exp(t));
            const double r = pell_profile_sample(&p, xi);
            out->log_r[i][j] = log(r);
            out->slope[i][j] = xi * rest / (2.0 * PELL_PI * r * r * pell_profile_pdf(&p, r)); /* dlog r/dt = dxi/dt / (dxi/dlog r) */
        }
        /* Monotone: slopes within three times the adjacent secants, which then also holds for mixtures of rows. */
        for (int j = 0; j < PELL_SAMPLING_QUANTILES; j++) {
            const int before = j > 0 ? j - 1 : j, after = j + 1 < PELL_SAMPLING_QUANTILES ? j : j - 1;
            const double left = (out->log_r[i][before + 1] - out->log_r[i][before]) / COLUMN_STEP;
            const double right = (out->log_r[i][after + 1] - out->log_r[i][after]) / COLUMN_STEP;
            const double most = 3.0 * fmin(left, right), slope = out->slope[i][j];
            out->slope[i][j] = slope >= 0.0 && slope <= most ? slope : most;
        }
    }
    return PELL_OK;
}

/* Rows on both sides of an albedo, and the weight of the second. */
static int rows_of(double albedo, double *fraction)
{
    const double a = albedo > 0.0 ? fmin(albedo, 1.0) : 0.0;
    const double at = sqrt(sqrt(1.0 - a)) * (PELL_SAMPLING_ALBEDOS - 1);
    const int row = (int) fmin(at, PELL_SAMPLING_ALBEDOS - 2);
    *fraction = at - row;
    return row;
}

/* Column j of the mixed rows. */
static void column(const struct pell_sampling_table *t, int row, double fraction, int j, double *log_r, double *slope)
{
    *log_r = t->log_r[row][j] + fraction * (t->log_r[row + 1][j] - t->log_r[row][j]);
    *slope = t->slope[row][j] + fraction * (t->slope[row + 1][j] - t->slope[row][j]);
}

/* The cubic between columns j and j + 1 at f in [0, 1]; `slope` by f. */
static double cubic(double y0, double y1, double m0, double m1, double f, double *slope)
{
    const double rise = y1 - y0, c2 = 3.0 * rise - 2.0 * m0 - m1, c3 = m0 + m1 - 2.0 * rise;
    *slope = m0 + f * (2.0 * c2 + f * 3.0 * c3);
    return y0 + f * (m0 + f * (c2 + f * c3));
}

#define RADIUS_LOG_MAX 300.0

double pell_sampling_table_sample(const struct pell_sampling_table *t, double albedo, double xi)
{
    double fraction, y0, y1, m0, m1, slope;
    const double u = unit(xi), logit = u > 0.0 ? log(u) - log1p(-u) : -INFINITY;
    const double at = (logit + PELL_SAMPLING_REACH) / COLUMN_STEP;
    const int row = rows_of(albedo, &fraction);

    if (u == 0.0)
        return 0.0;
    if (at <= 0.0) {
        column(t, row, fraction, 0, &y0, &m0);
        return exp(y0 + m0 * COLUMN_STEP * at);
    }
    if (at >= PELL_SAMPLING_QUANTILES - 1) {
        column(t, row, fraction, PELL_SAMPLING_QUANTILES - 1, &y0, &m0);
        return exp(fmin(y0 + m0 * COLUMN_STEP * (at - (PELL_SAMPLING_QUANTILES - 1)), RADIUS_LOG_MAX));
    }
    const int j = (int) fmin(at, PELL_SAMPLING_QUANTILES - 2);
    column(t, row, fraction, j, &y0, &m0);
    column(t, row, fraction, j + 1, &y1, &m1);
    return exp(cubic(y0, y1, m0 * COLUMN_STEP, m1 * COLUMN_STEP, at - j, &slope));
}

double pell_sampling_table_pdf(const struct pell_sampling_table *t, double albedo, double r)
{
    double fraction, y0, y1, m0, m1, logit, slope;
    const int row = rows_of(albedo, &fraction);
    int low = 0;

    if (!(r > 0.0 && r < 1e130))
        return 0.0;
    const double y = log(r);
    for (int half = PELL_SAMPLING_QUANTILES / 2; half > 0; half /= 2) {
        column(t, row, fraction, low + half, &y0, &m0);
        low = y0 <= y ? low + half : low;
    }
    column(t, row, fraction, low, &y0, &m0);
    const double from = COLUMN_STEP * low - PELL_SAMPLING_REACH;
    if (y <= y0 || low == PELL_SAMPLING_QUANTILES - 1) {
        logit = from + (y - y0) / m0;
        slope = m0;
    } else {
        double a = 0.0, b = 1.0, f;
        column(t, row, fraction, low + 1, &y1, &m1);
        f = (y - y0) / (y1 - y0);
        for (int i = 0; i < 60; i++) {
            const double miss = cubic(y0, y1, m0 * COLUMN_STEP, m1 * COLUMN_STEP, f, &slope) - y;
            double next = f - miss / slope;
            *(miss > 0.0 ? &b : &a) = f;
            next = next > a && next < b ? next : 0.5 * (a + b);
            if (fabs(next - f) < 1e-14)
                break;
            f = next;
        }
        logit = from + COLUMN_STEP * f;
        slope /= COLUMN_STEP;
    }
    /* xi (1 - xi) dlogit/dlog r over the area 2 pi r dr; r^2 in the exponent, as it may be too small to divide by. */
    const double tail = 1.0 + exp(-fabs(logit));
    return exp(-fabs(logit) - 2.0 * y) / (tail * tail * slope * 2.0 * PELL_PI);
}
