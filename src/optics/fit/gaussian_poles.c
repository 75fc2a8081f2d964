/* SPDX-License-Identifier: MIT
 *
 * gaussian_poles.c - sums of Gaussians for the poles of diffusion theory in closed form: d'Eon, Luebke, Enderton 2007, appendix A, and
 * the exact positive mixture.
 *
 * A pole at depth 1 whose sigma_tr is x has the Hankel transform exp(-sqrt(x^2 + k^2))/2, the Laplace transform in k^2/2 of
 *     w(v) = exp(-x^2 v/2 - 1/(2 v))/(2 v sqrt(2 pi v)),
 * so that R(r) = Int w(v) G(v, r) dv: the time v at which a Brownian motion of drift x first reaches 1 has the density exp(x) 2 w(v) (the
 * inverse Gaussian distribution), of known sums. All lengths here are in units of the depth. */
#include <pellucid/gaussians.h>

#include "math/special.h"
#include "math/vec.h"

#include <math.h>
#include <string.h>

/* Depths and coefficients whose squares and products stay doubles. NaN fails. */
static bool pole_valid(double z, double sigma_tr)
{
    return fabs(z) >= 1e-100 && fabs(z) <= 1e100 && sigma_tr >= 0.0 && sigma_tr <= 1e100;
}

/* --- Appendix A ---------------------------------------------------------------------------------------------------------------- */

static const double appendix_variance[4] = { 0.2304, 0.7225, 2.6569, 13.6 }; /* variances over z^2/(1 + x) */

/* The printed weights, of sum about 1; (1 - exp(-a x))/x is exact at 0. */
static void weights_printed(double x, double u[4])
{
    const double e1 = x > 0.0 ? -expm1(-0.7452 * x) / x : 0.7452;
    const double e2 = x > 0.0 ? -expm1(-0.716 * x) / x : 0.716;
    const double e3 = x > 0.0 ? -expm1(-1.0961 * x) / x : 1.0961;
    const double e4 = x > 0.0 ? -expm1(-1.433 * x) / x : 1.433;

    u[0] = -0.3454 + 1.2422 * e1;
    u[1] = 5.34071 * (e2 * (0.9029 * x - 0.7401) + 0.90295 * exp(-0.7165 * x));
    u[2] = 10.2416 * (e3 * (0.2420 * x + 0.1804) - 0.00244 * exp(-1.0961 * x) * (0.2041 * x + 0.1752));
    u[3] = 23.185 * (e4 * (0.0505 - 0.0395 * x) + 0.04425 * exp(-1.433 * x) * (0.09187 * x + 0.06034));
    for (int i = 0; i < 4; i++)
        u[i] /= 2.0 * PELL_PI;
}

/* Solves M u = rhs for M_ij = 1/(v_i + v_j) of the variances, which is positive definite, by Cholesky's factors. */
static void solve(double u[4])
{
    double l[4][4];

    for (int i = 0; i < 4; i++)
        for (int j = 0; j <= i; j++) {
            double s = 1.0 / (appendix_variance[i] + appendix_variance[j]);
            for (int k = 0; k < j; k++)
                s -= l[i][k] * l[j][k];
            l[i][j] = i == j ? sqrt(s) : s / l[j][j];
        }
    for (int i = 0; i < 4; i++) {
        for (int k = 0; k < i; k++)
            u[i] -= l[i][k] * u[k];
        u[i] /= l[i][i];
    }
    for (int i = 3; i >= 0; i--) {
        for (int k = i + 1; k < 4; k++)
            u[i] -= l[k][i] * u[k];
        u[i] /= l[i][i];
    }
}

/* Least squares at these variances. The products Int r G_i P dr are by Parseval 1/(8 pi^2) Int_x^inf q exp(-v (q^2 - x^2)/2 - q) dq,
 *     = exp(-x)/(8 pi^2 v) [ 1 - sqrt(pi/(2 v)) erfcx((v x + 1)/sqrt(2 v)) ]. */
static void weights_best(double x, bool energy, double u[4])
{
    for (int i = 0; i < 4; i++) {
        const double v = appendix_variance[i] / (1.0 + x);
        u[i] = (1.0 - sqrt(0.5 * PELL_PI / v) * pell_erfcx((v * x + 1.0) / sqrt(2.0 * v))) / appendix_variance[i];
    }
    solve(u);
    if (energy) {
        double one[4] = { 1.0, 1.0, 1.0, 1.0 };
        solve(one);
        const double step = (1.0 - (u[0] + u[1] + u[2] + u[3])) / (one[0] + one[1] + one[2] + one[3]);
        for (int i = 0; i < 4; i++)
            u[i] += step * one[i];
    }
}

enum pell_result pell_pole_appendix_a(double z_mm, double sigma_tr, enum pell_appendix_a constants, double variance_mm2[4],
                                      double weight[4])
{
    if (!variance_mm2 || !weight)
        return PELL_ERR_INVALID;

    const double x = sigma_tr * fabs(z_mm);

    for (int i = 0; i < 4; i++)
        variance_mm2[i] = weight[i] = 0.0;
    if (!pole_valid(z_mm, sigma_tr) || (int) constants < 0 || constants > PELL_APPENDIX_A_BEST_ENERGY || !(x <= 1e6))
        return PELL_ERR_INVALID;
    if (constants == PELL_APPENDIX_A_PRINTED)
        weights_printed(x, weight);
    else
        weights_best(x, constants == PELL_APPENDIX_A_BEST_ENERGY, weight);
    for (int i = 0; i < 4; i++) {
        variance_mm2[i] = appendix_variance[i] * z_mm * z_mm / (1.0 + x);
        weight[i] *= copysign(0.5, z_mm) * exp(-x);
    }
    return PELL_OK;
}

enum pell_result pell_dipole_appendix_a(const struct pell_dipole *dipole, enum pell_appendix_a constants, struct pell_gaussians *out)
{
    if (!dipole || !out)
        return PELL_ERR_INVALID;

    const double z[2] = { dipole->zr, dipole->zv };
    double variance[2][4], weight[2][4];
    int next[2] = { 0, 0 };

    memset(out, 0, sizeof(*out));
    if (!(dipole->albedo_reduced >= 0.0 && dipole->albedo_reduced <= 1.0))
        return PELL_ERR_INVALID;
    for (int p = 0; p < 2; p++)
        if (!(z[p] > 0.0) || pell_pole_appendix_a(z[p], dipole->sigma_tr, constants, variance[p], weight[p]) != PELL_OK)
            return PELL_ERR_INVALID;
    while (out->count < 8) {
        const int p = next[1] >= 4 || (next[0] < 4 && variance[0][next[0]] <= variance[1][next[1]]) ? 0 : 1;
        out->variance[out->count] = variance[p][next[p]];
        out->weight[out->count++][0] = dipole->albedo_reduced * weight[p][next[p]++];
    }
    return PELL_OK;
}

/* --- The exact mixture --------------------------------------------------------------------------------------------------------- */

/* End points of a trapezoidal sum in log v with that step. Its error is about exp(-pi^2/step), as everything is analytic for |Im log v| <
 * pi/2; the truncation error is about exp(-(x v - 1)^2/(2 v)) and, without absorption, v^-1. The constants that balance the three were
 * measured for x from 0 to 100 and 2 to 64 nodes. */
static void integration_range(double x, double step, double *low, double *high)
{
    const double level = PELL_PI * PELL_PI / step, far = fmax(0.5, 0.88 * level - 2.3);
    const double below = fmax(0.7, 0.8 * (level - 4.6 - 3.0 * log1p(x))), above = 0.65 * below;

    *low = -log(x + below + sqrt(below * (below + 2.0 * x)));
    *high = x > 0.0 ? fmin(far, log(x + above + sqrt(above * (above + 2.0 * x))) - 2.0 * log(x)) : far;
}

enum pell_result pell_pole_gaussians(double z_mm, double sigma_tr, double *variance, double *weight, size_t count)
{
    if ((!variance || !weight) && count)
        return PELL_ERR_INVALID;

    const double x = sigma_tr * fabs(z_mm), total = 0.5 * exp(-x), sign = copysign(1.0, z_mm);
    double narrow = 1e-4, wide = 64.0, low, high, sum = 0.0;

    if (!pole_valid(z_mm, sigma_tr) || !(x <= 1e6) || count < 1)
        return PELL_ERR_INVALID;
    if (count == 1) {
        variance[0] = z_mm * z_mm / (1.0 + x); /* the variance v0 of appendix A: right at r = 0 */
        weight[0] = sign * total;
        return PELL_OK;
    }
    for (int i = 0; i < 60; i++) { /* the range shrinks as the step grows */
        const double step = sqrt(narrow * wide);
        integration_range(x, step, &low, &high);
        if (high - low < step * (double) (count - 1))
            wide = step;
        else
            narrow = step;
    }
    const double step = sqrt(narrow * wide);
    integration_range(x, step, &low, &high);
    for (size_t i = 0; i < count; i++) {
        const double v = exp(low + step * (double) i), off = x * v - 1.0;
        variance[i] = v * z_mm * z_mm;
        weight[i] = step * exp(-0.5 * off * off / v) / sqrt(2.0 * PELL_PI * v); /* over exp(-x)/2 */
        sum += weight[i];
    }
    if (sum < 1.0) /* the remainder beyond the last node is added to the last */
        weight[count - 1] += 1.0 - sum;
    for (size_t i = 0; i < count; i++)
        weight[i] *= sign * total / fmax(sum, 1.0);
    return PELL_OK;
}

/* Int_0^v w and Int_0^v u w(u) du over exp(-x)/2. */
static void sums(double x, double v, double *mass, double *moment)
{
    if (!(v > 0.0)) {
        *mass = *moment = 0.0;
        return;
    }
    const double root = sqrt(2.0 * v), off = (x * v - 1.0) / root;
    const double direct = 0.5 * erfc(-off), mirror = 0.5 * exp(-off * off) * pell_erfcx((x * v + 1.0) / root);
    *mass = direct + mirror;
    if (x * sqrt(v) > 1e-5) /* else both terms are the same, and the limit x -> 0 is right to 1e-10 */
        *moment = fmax(0.0, direct - mirror) / x;
    else
        *moment = exp(x) * (sqrt(2.0 * v / PELL_PI) * exp(-0.5 / v) - erfc(1.0 / root));
}

enum pell_result pell_pole_gaussians_at(double z_mm, double sigma_tr, const double *variance, double *weight, size_t count)
{
    if ((!variance || !weight) && count)
        return PELL_ERR_INVALID;

    const double x = sigma_tr * fabs(z_mm), z2 = z_mm * z_mm, total = copysign(0.5, z_mm) * exp(-x);
    double mass, moment;

    if (!pole_valid(z_mm, sigma_tr) || !(x <= 1e6) || count < 1)
        return PELL_ERR_INVALID;
    for (size_t i = 0; i < count; i++)
        if (!(variance[i] >= 0.0) || !isfinite(variance[i]) || (i > 0 && !(variance[i] > variance[i - 1])))
            return PELL_ERR_INVALID;
    sums(x, variance[0] / z2, &mass, &moment);
    weight[0] = mass;
    for (size_t i = 0; i + 1 < count; i++) {
        const double low = variance[i] / z2, high = variance[i + 1] / z2;
        double mass_next, moment_next;
        sums(x, high, &mass_next, &moment_next);
        const double m = fmax(0.0, mass_next - mass);
        const double upper = fmin(m, fmax(0.0, ((moment_next - moment) - low * m) / (high - low)));
        weight[i] += m - upper;
        weight[i + 1] = upper;
        mass = fmax(mass, mass_next);
        moment = moment_next;
    }
    weight[count - 1] += fmax(0.0, 1.0 - mass);
    for (size_t i = 0; i < count; i++)
        weight[i] *= total;
    return PELL_OK;
}
