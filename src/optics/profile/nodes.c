/* SPDX-License-Identifier: MIT
 *
 * nodes.c - monotone cubics between nodes (Hyman 1983's limits on the slopes; Fritsch and Carlson 1980), a constant towards 0, and
 * the far field of diffusion beyond the last node, q (1 + s r) exp(-s r)/r^3 with 2 pi q exp(-s r)/r outside r. */
#define _XOPEN_SOURCE 700 /* j0, j1 */

#include "optics/profile/nodes.h"

#include "math/vec.h"
#include "optics/profile/lanes.h"
#include "optics/profile/shape.h"

/* --- Making ---------------------------------------------------------------------------------------------------------------------- */

/* Derivative at x[at] of the polynomial through `count` points. */
static double polynomial_slope(const double *x, const double *y, int count, int at)
{
    double slope = 0.0;
    for (int j = 0; j < count; j++) {
        double basis = 0.0;
        if (j == at) {
            for (int k = 0; k < count; k++)
                basis += k != at ? 1.0 / (x[at] - x[k]) : 0.0;
        } else {
            basis = 1.0 / (x[j] - x[at]);
            for (int k = 0; k < count; k++)
                basis *= k != at && k != j ? (x[at] - x[k]) / (x[j] - x[k]) : 1.0;
        }
        slope += y[j] * basis;
    }
    return slope;
}

static double parabola_slope(const double *r, const double *value, size_t count, size_t i)
{
    const size_t points = count < 3 ? count : 3, from = i == 0 ? 0 : i + 1 == count ? count - points : i - 1;
    return polynomial_slope(r + from, value + from, (int) points, (int) (i - from));
}

static double log_slope(const struct pell_profile *p, int i)
{
    const int count = p->count < 5 ? p->count : 5;
    int from = i - 2;
    double x[5], y[5];

    from = from < 0 ? 0 : from > p->count - count ? p->count - count : from;
    for (int k = 0; k < count; k++) {
        if (!(p->r[from + k] > 0.0 && p->value[from + k] > 0.0))
            return parabola_slope(p->r, p->value, (size_t) p->count, (size_t) i);
        x[k] = log(p->r[from + k] / p->r[i]);
        y[k] = log(p->value[from + k] / p->value[i]);
    }
    return polynomial_slope(x, y, count, i - from) * p->value[i] / p->r[i];
}

/* Limits a slope so that the cubic stays between its neighbours' values on both sides: 0 at extrema, within three times either secant. */
static double limited(const double *r, const double *value, size_t count, size_t i, double slope)
{
    const double before = i > 0 ? (value[i] - value[i - 1]) / (r[i] - r[i - 1]) : (value[1] - value[0]) / (r[1] - r[0]);
    const double after = i + 1 < count ? (value[i + 1] - value[i]) / (r[i + 1] - r[i]) : before;
    const double most = 3.0 * fmin(fabs(before), fabs(after));

    if (before > 0.0 && after > 0.0)
        return fmin(fmax(slope, 0.0), most);
    if (before < 0.0 && after < 0.0)
        return fmax(fmin(slope, 0.0), -most);
    return 0.0;
}

double pell_nodes_slope(const double *r, const double *value, size_t count, size_t i)
{
    return limited(r, value, count, i, parabola_slope(r, value, count, i));
}

double pell_nodes_cubic_flux(double r0, double h, double v0, double v1, double m0, double m1, double x)
{
    const double t = x / h, rise = v1 - v0, c2 = 3.0 * rise - 2.0 * m0 - m1, c3 = m0 + m1 - 2.0 * rise;
    const double zeroth = v0 + t * (m0 / 2.0 + t * (c2 / 3.0 + t * c3 / 4.0));
    const double first = v0 / 2.0 + t * (m0 / 3.0 + t * (c2 / 4.0 + t * c3 / 5.0));
    return 2.0 * PELL_PI * x * (r0 * zeroth + x * first);
}

/* Flux from node i to x after it. */
static double flux_from_node(const struct pell_profile *p, int i, double x)
{
    const double h = p->r[i + 1] - p->r[i];
    return pell_nodes_cubic_flux(p->r[i], h, p->value[i], p->value[i + 1], h * p->slope[i], h * p->slope[i + 1], x);
}

double pell_profile_nodes_flux(const struct pell_profile *p, int i, double r0, double r1)
{
    return flux_from_node(p, i, r1 - p->r[i]) - flux_from_node(p, i, r0 - p->r[i]);
}

static double tail_outside(const struct pell_profile *p, double r)
{
    return p->parameter[NODES_TAIL] > 0.0 ? 2.0 * PELL_PI * p->parameter[NODES_TAIL] * exp(-p->parameter[NODES_SIGMA] * r) / r : 0.0;
}

/* q from a last value v at r: by logarithms, as exp(s r) may overflow if v is tiny. */
static double tail_factor(double v, double r, double s)
{
    const double l = v > 0.0 ? log(v) + 3.0 * log(r) + s * r - log1p(s * r) : -INFINITY;
    return l < 600.0 ? exp(l) : 0.0;
}

void pell_profile_nodes_make(struct pell_profile *p, int count, enum pell_nodes_slopes slopes, double tail_sigma_tr)
{
    const double last = p->r[count - 1];

    p->kind = PELL_PROFILE_KIND_NODES;
    p->count = count;
    for (int i = 0; i < count; i++) {
        const size_t n = (size_t) count, at = (size_t) i;
        const double raw = slopes == PELL_NODES_GIVEN ? p->slope[i]
                           : slopes == PELL_NODES_LOG ? log_slope(p, i)
                                                      : parabola_slope(p->r, p->value, n, at);
        p->slope[i] = limited(p->r, p->value, n, at, raw);
    }
    p->inside[0] = PELL_PI * p->r[0] * p->r[0] * p->value[0];
    for (int i = 0; i + 1 < count; i++)
        p->inside[i + 1] = p->inside[i] + fmax(0.0, flux_from_node(p, i, p->r[i + 1] - p->r[i]));
    for (int i = count; i < PELL_PROFILE_NODES; i++) /* sentinels for searches */
        p->r[i] = INFINITY;
    p->parameter[NODES_TAIL] = tail_sigma_tr >= 0.0 ? tail_factor(p->value[count - 1], last, tail_sigma_tr) : 0.0;
    p->parameter[NODES_SIGMA] = tail_sigma_tr >= 0.0 ? tail_sigma_tr : 0.0;
    p->total = p->inside[count - 1] + tail_outside(p, last);
}

void pell_profile_nodes_scale(struct pell_profile *p, double factor)
{
    p->total *= factor;
    p->parameter[NODES_TAIL] *= factor;
    for (int i = 0; i < p->count; i++) {
        p->value[i] *= factor;
        p->slope[i] *= factor;
        p->inside[i] *= factor;
    }
}

/* --- Flux ------------------------------------------------------------------------------------------------------------------------ */

static double inside(const struct pell_profile *p, double r)
{
    const double last = p->r[p->count - 1];
    if (r <= p->r[0])
        return PELL_PI * r * r * p->value[0];
    if (r >= last)
        return p->inside[p->count - 1] + tail_outside(p, last) - tail_outside(p, r);
    const int i = (int) lanes_find(p, r);
    return fmin(p->inside[i + 1], p->inside[i] + fmax(0.0, flux_from_node(p, i, r - p->r[i])));
}

static double outside(const struct pell_profile *p, double r)
{
    const double last = p->r[p->count - 1];
    if (r >= last)
        return tail_outside(p, r);
    return p->inside[p->count - 1] - inside(p, r) + tail_outside(p, last);
}

static double scale(const struct pell_profile *p)
{
    int low = 0; /* a radius that encloses half of the light, whose flux is known */
    for (int half = PELL_PROFILE_NODES / 2; half > 0; half /= 2)
        if (low + half < p->count && p->inside[low + half] <= 0.5 * p->total)
            low += half;
    return p->r[low] > 0.0 ? p->r[low] : p->r[1];
}

/* --- Transform ------------------------------------------------------------------------------------------------------------------- */

static const double gauss_x[4] = { 0.1834346424956498, 0.5255324099163290, 0.7966664774136267, 0.9602898564975363 };
static const double gauss_w[4] = { 0.3626837833783620, 0.3137066458778873, 0.2223810344533745, 0.1012285362903763 };

static double eval(const struct pell_profile *p, double r)
{
    return r > p->r[p->count - 1] ? lanes_tail(p, r) : lanes_nodes(p, r);
}

/* Int r R J0(s r) dr over an interval without a node inside and at most half a period long, by eight points. */
static double piece(const struct pell_profile *p, double s, double a, double b)
{
    const double middle = 0.5 * (a + b), half = 0.5 * (b - a);
    double sum = 0.0;
    for (int k = 0; k < 4; k++) {
        const double r0 = middle - half * gauss_x[k], r1 = middle + half * gauss_x[k];
        sum += gauss_w[k] * (r0 * eval(p, r0) * j0(s * r0) + r1 * eval(p, r1) * j0(s * r1));
    }
    return half * sum;
}

/* dR/dr. */
static double eval_slope(const struct pell_profile *p, double r)
{
    const double last = p->r[p->count - 1], s = p->parameter[NODES_SIGMA];
    if (r > last)
        return -lanes_tail(p, r) * (3.0 / r + s * s * r / (1.0 + s * r));
    if (r <= p->r[0])
        return 0.0;
    const int i = (int) lanes_find(p, r);
    const double h = p->r[i + 1] - p->r[i], t = (r - p->r[i]) / h, rise = p->value[i + 1] - p->value[i];
    const double m0 = h * p->slope[i], m1 = h * p->slope[i + 1];
    return (m0 + t * (2.0 * (3.0 * rise - 2.0 * m0 - m1) + t * 3.0 * (m0 + m1 - 2.0 * rise))) / h;
}

#define PHASES 600.0 /* s r up to which oscillations are integrated one by one */

/* Oscillations are integrated up to s r = PHASES; the remainder by parts, (1/s)(-r R J1) + (1/s^2)(-r R' J0), with an error of (s r)^-3. */
static double transform(const struct pell_profile *p, double s)
{
    const double last = p->r[p->count - 1], sigma = p->parameter[NODES_SIGMA];
    const double first = s * p->r[0];
    double end = PHASES / s, at = p->r[0], sum;

    if (!(s > 1e-290)) /* 0, or too few digits for s r */
        return p->total;
    /* The disc of constant R inside the first node. */
    sum = first > 0.0 ? p->value[0] * p->r[0] * j1(first) / s : 0.0;
    if (p->parameter[NODES_TAIL] > 0.0)
        end = sigma > 0.0 ? fmin(end, last + 40.0 / sigma) : end;
    else
        end = fmin(end, last);
    end = fmin(end, LANES_RADIUS_MAX);
    while (at < end) {
        double next = fmin(end, at + PELL_PI / s);
        if (at < last)
            next = fmin(next, p->r[lanes_find(p, at) + 1]);
        else
            next = fmin(next, 1.25 * at);
        if (!(next > at))
            break;
        sum += piece(p, s, at, next);
        at = next;
    }
    if (at >= PHASES / s * (1.0 - 1e-12)) {
        const double x = s * at;
        sum -= (at * eval(p, at) * j1(x) + at * eval_slope(p, at) * j0(x) / s) / s;
    }
    return 2.0 * PELL_PI * sum;
}

const struct pell_profile_shape pell_profile_nodes = { inside, outside, transform, scale };
