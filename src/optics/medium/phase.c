/* SPDX-License-Identifier: MIT
 *
 * phase.c - see pellucid/phase.h. L. G. Henyey, J. L. Greenstein, "Diffuse radiation in the Galaxy", 1941; P. Blasi, B. Le Saec, C.
 * Schlick, "A Rendering Algorithm for Discrete Volume Density Objects", 1993; C. F. Bohren, D. R. Huffman, "Absorption and Scattering of
 * Light by Small Particles", 5.
 *
 * With the forward cosine m = -cos_theta and D = (1 - g)(1 - xi) + (1 + g) xi the inverses of the cumulative distributions are
 *
 *     Henyey-Greenstein  1 - m = 2 (1 - g)^2 (1 - xi)(1 + g xi) / D^2      1 + m = 2 (1 + g)^2 xi (1 - g (1 - xi)) / D^2
 *     Schlick            1 - m = 2 (1 - k)(1 - xi) / D                     1 + m = 2 (1 + k) xi / D
 *
 * which are the textbook forms with the division by g carried out: g = 0 is no special case, and angles close to 0 keep their precision for
 * g close to 1. */
#include <pellucid/phase.h>

#include "math/vec.h"
#include "optics/medium/range.h"

#include <math.h>

bool pell_phase_valid(const struct pell_phase *p, struct pell_medium_fault *fault)
{
    if (fault)
        *fault = (struct pell_medium_fault) { 0 };
    if (!pell_in_range("kind", (double) (int) p->kind, 0.0, PELL_PHASE_KINDS - 1, fault))
        return false;
    if (p->kind != PELL_PHASE_RAYLEIGH && !pell_in_range("g[0]", p->g[0], -PELL_G_MAX, PELL_G_MAX, fault))
        return false;
    return p->kind != PELL_PHASE_TWO_LOBE ||
           (pell_in_range("g[1]", p->g[1], -PELL_G_MAX, PELL_G_MAX, fault) && pell_in_range("weight", p->weight, 0.0, 1.0, fault));
}

static double clamp(double x, double min, double max)
{
    return fmin(fmax(x, min), max);
}

/* (1 - g)^2 + 2 g (1 + c), evaluated without cancellation. */
static double henyey_base(double g, double c)
{
    return g >= 0.0 ? (1.0 - g) * (1.0 - g) + 2.0 * g * (1.0 + c) : (1.0 + g) * (1.0 + g) - 2.0 * g * (1.0 - c);
}

static double henyey_value(double g, double c)
{
    const double b = henyey_base(g, c);
    return (1.0 - g) * (1.0 + g) / (4.0 * PELL_PI * b * sqrt(b));
}

static double henyey_cdf(double g, double c)
{
    const double q = sqrt(henyey_base(g, c));
    return fmin(1.0, (1.0 - g) * (1.0 - c) / (q * (1.0 + g + q))); /* rounding may exceed 1 */
}

static double schlick_base(double k, double c)
{
    return k >= 0.0 ? (1.0 - k) + k * (1.0 + c) : (1.0 + k) - k * (1.0 - c);
}

double pell_phase_value(const struct pell_phase *p, double cos_theta)
{
    const double c = clamp(cos_theta, -1.0, 1.0);
    switch (p->kind) {
    case PELL_PHASE_SCHLICK: {
        const double b = schlick_base(p->g[0], c);
        return (1.0 - p->g[0]) * (1.0 + p->g[0]) / (4.0 * PELL_PI * b * b);
    }
    case PELL_PHASE_RAYLEIGH: return 3.0 / (16.0 * PELL_PI) * (1.0 + c * c);
    case PELL_PHASE_TWO_LOBE: return p->weight * henyey_value(p->g[0], c) + (1.0 - p->weight) * henyey_value(p->g[1], c);
    default: return henyey_value(p->g[0], c);
    }
}

double pell_phase_cdf(const struct pell_phase *p, double cos_theta)
{
    const double c = clamp(cos_theta, -1.0, 1.0);
    switch (p->kind) {
    case PELL_PHASE_SCHLICK: return fmin(1.0, 0.5 * (1.0 - p->g[0]) * (1.0 - c) / schlick_base(p->g[0], c));
    case PELL_PHASE_RAYLEIGH: /* 3/8 Int_c^1 (1 + x^2) dx */ return 0.125 * (1.0 - c) * (4.0 + c * (1.0 + c));
    case PELL_PHASE_TWO_LOBE: return p->weight * henyey_cdf(p->g[0], c) + (1.0 - p->weight) * henyey_cdf(p->g[1], c);
    default: return henyey_cdf(p->g[0], c);
    }
}

/* 1/k - (1/k^2 - 1) atanh k; its series 2 Sum k^(2 n - 1) / ((2 n - 1)(2 n + 1)) where that cancels. */
static double schlick_mean(double k)
{
    double sum = 0.0, power = k;

    if (fabs(k) >= 0.1)
        return 1.0 / k - (1.0 / (k * k) - 1.0) * atanh(k);
    for (int n = 1; n <= 15; n += 2, power *= k * k)
        sum += 2.0 * power / (n * (n + 2.0));
    return sum;
}

double pell_phase_mean_cosine(const struct pell_phase *p)
{
    switch (p->kind) {
    case PELL_PHASE_SCHLICK: return schlick_mean(p->g[0]);
    case PELL_PHASE_RAYLEIGH: return 0.0;
    case PELL_PHASE_TWO_LOBE: return p->weight * p->g[0] + (1.0 - p->weight) * p->g[1];
    default: return p->g[0];
    }
}

/* 1 + cos_theta and 1 - cos_theta, so that the sine of a small angle is exact, too. */
struct sides {
    double plus, minus;
};

static struct sides henyey_sample(double g, double xi)
{
    const double d = (1.0 - g) * (1.0 - xi) + (1.0 + g) * xi, far = (1.0 - g) / d, near = (1.0 + g) / d;
    return (struct sides) { 2.0 * far * far * (1.0 - xi) * (1.0 + g * xi), 2.0 * near * near * xi * (1.0 - g * (1.0 - xi)) };
}

static struct sides sample(const struct pell_phase *p, double xi)
{
    switch (p->kind) {
    case PELL_PHASE_SCHLICK: {
        const double k = p->g[0], d = (1.0 - k) * (1.0 - xi) + (1.0 + k) * xi;
        return (struct sides) { 2.0 * (1.0 - k) * (1.0 - xi) / d, 2.0 * (1.0 + k) * xi / d };
    }
    case PELL_PHASE_RAYLEIGH: { /* m^3 + 3 m = 8 xi - 4 */
        const double m = clamp(2.0 * sinh(asinh(4.0 * xi - 2.0) / 3.0), -1.0, 1.0);
        return (struct sides) { 1.0 - m, 1.0 + m };
    }
    case PELL_PHASE_TWO_LOBE:
        if (xi < p->weight)
            return henyey_sample(p->g[0], xi / p->weight);
        return henyey_sample(p->g[1], p->weight < 1.0 ? clamp((xi - p->weight) / (1.0 - p->weight), 0.0, 1.0) : xi);
    default: return henyey_sample(p->g[0], xi);
    }
}

double pell_phase_sample_cosine(const struct pell_phase *p, double xi)
{
    const struct sides s = sample(p, clamp(xi, 0.0, 1.0));
    return s.plus < s.minus ? s.plus - 1.0 : 1.0 - s.minus;
}

double pell_phase_sample(const struct pell_phase *p, double xi1, double xi2, const double w_i[3], double w_o[3])
{
    const struct sides s = sample(p, clamp(xi1, 0.0, 1.0));
    const double c = s.plus < s.minus ? s.plus - 1.0 : 1.0 - s.minus, sine = sqrt(s.plus * s.minus);
    const double phi = 2.0 * PELL_PI * clamp(xi2, 0.0, 1.0), x = sine * cos(phi), y = sine * sin(phi);
    /* two vectors perpendicular to w_i, after Duff et al. 2017, "Building an Orthonormal Basis, Revisited" */
    const double sign = copysign(1.0, w_i[2]), a = -1.0 / (sign + w_i[2]), b = w_i[0] * w_i[1] * a;
    const double t[3] = { 1.0 + sign * w_i[0] * w_i[0] * a, sign * b, -sign * w_i[0] }, u[3] = { b, sign + w_i[1] * w_i[1] * a, -w_i[1] };

    for (int i = 0; i < 3; i++)
        w_o[i] = x * t[i] + y * u[i] + c * w_i[i];
    return pell_phase_value(p, c);
}

double pell_phase_schlick_k(double mean_cosine)
{
    const double target = fabs(mean_cosine);
    double low = target, high = fmin(1.5 * target, PELL_G_MAX); /* 2/3 k <= mean <= k */

    if (!(target < schlick_mean(PELL_G_MAX)))
        return isnan(mean_cosine) ? mean_cosine : copysign(PELL_G_MAX, mean_cosine);
    for (int i = 0; i < 60; i++) {
        const double k = 0.5 * (low + high);
        if (schlick_mean(k) < target)
            low = k;
        else
            high = k;
    }
    return copysign(0.5 * (low + high), mean_cosine);
}
