/* SPDX-License-Identifier: MIT
 *
 * slab.c - reflectance and transmittance of a slab with a boundary on each side, by radiative transfer and not by diffusion.
 *
 * Adding-doubling (van de Hulst 1980, "Multiple Light Scattering"): R and T are matrices over directions, whose entry ij is the flux
 * exiting along mu_i per flux entering along mu_j. Two equal layers combine to
 *
 *     T' = T (1 - R R)^-1 T        R' = R + T R (1 - R R)^-1 T
 *
 * The thinnest layer scatters once, in closed form; higher orders are added as a geometric series, so that a medium without absorption
 * loses nothing. Unscattered light is known in closed form, and is subtracted last. Boundaries reflect each direction by Fresnel's F
 * (Prahl, van Gemert and Welch 1993). Layers of different media are added from top to bottom, and the resulting half to its mirror image.
 */
#include "math/quadrature.h"
#include "math/vec.h"
#include "optics/medium/dipole.h"
#include "optics/medium/passing.h"
#include "optics/profile/shape.h"

#include <pellucid/layers.h>

#include <float.h>
#include <math.h>
#include <string.h>

#define THINNEST 0x1p-9 /* optical thickness of the first entry */

enum {
    GAUSS = 8,         /* nodes on each side of the critical angle */
    NODES = 2 * GAUSS, /* and the normal direction is one more */
    NORMAL = NODES,
    DIRECTIONS = NODES + 1,
    EARLIER = 8, /* doublings before the first entry */
    PER_OCTAVE = 2,
};

struct directions {
    double mu[DIRECTIONS], weight[DIRECTIONS], fresnel[DIRECTIONS];
};

typedef double matrix[DIRECTIONS][DIRECTIONS];

struct layer {
    double thickness; /* optical thickness */
    matrix R, T;      /* T without unscattered light */
};

static void place_directions(double eta, struct directions *d)
{
    const double critical = eta > 1.0 ? sqrt((eta - 1.0) * (eta + 1.0)) / eta : 0.5; /* without one, any other split is fine */
    double x[GAUSS], w[GAUSS];
    int n = 0;

    pell_gauss_legendre(GAUSS, x, w);
    for (int part = 0; part < 2; part++) {
        const double from = part == 0 ? 0.0 : critical, length = part == 0 ? critical : 1.0 - critical;
        for (int i = 0; i < GAUSS; i++, n++) {
            d->mu[n] = from + length * x[i];
            d->weight[n] = length * w[i];
        }
    }
    d->mu[NORMAL] = 1.0; /* light enters along the normal, where no light is scattered to exactly */
    d->weight[NORMAL] = 0.0;
    for (int i = 0; i < DIRECTIONS; i++)
        d->fresnel[i] = pell_fresnel(1.0 / eta, d->mu[i]);
}

static void scatter_once(const struct directions *d, double albedo, struct layer *l)
{
    const double t = l->thickness;

    for (int j = 0; j < DIRECTIONS; j++) {
        const double in = d->mu[j], scattered = albedo * -expm1(-t / in);
        double escaped = 0.0, again;
        for (int i = 0; i < DIRECTIONS; i++) {
            const double out = d->mu[i], k = 0.5 * albedo * d->weight[i] * out, difference = 1.0 / in - 1.0 / out;
            l->R[i][j] = k / (in + out) * -expm1(-t * (1.0 / in + 1.0 / out));
            l->T[i][j] = k / (in * out) * exp(-t / in) * (fabs(difference * t) > 1e-8 ? expm1(difference * t) / difference : t);
            escaped += l->R[i][j] + l->T[i][j];
        }
        again = scattered > escaped && scattered > 0.0 ? 1.0 - escaped / scattered : 0.0;
        for (int i = 0; i < DIRECTIONS; i++) {
            l->R[i][j] /= 1.0 - albedo * again;
            l->T[i][j] /= 1.0 - albedo * again;
        }
    }
}

static void multiply(const matrix a, const matrix b, matrix out)
{
    memset(out, 0, sizeof(matrix));
    for (int i = 0; i < DIRECTIONS; i++)
        for (int k = 0; k < DIRECTIONS; k++)
            for (int j = 0; j < DIRECTIONS; j++)
                out[i][j] += a[i][k] * b[k][j];
}

/* (1 - m)^-1 b replaces b; m is destroyed. Column sums of m are below one, so that the diagonal is a good pivot. */
static void solve(matrix m, matrix b)
{
    for (int i = 0; i < DIRECTIONS; i++)
        for (int j = 0; j < DIRECTIONS; j++)
            m[i][j] = (i == j) - m[i][j];
    for (int k = 0; k < DIRECTIONS; k++)
        for (int i = k + 1; i < DIRECTIONS; i++) {
            const double f = m[i][k] / m[k][k];
            for (int j = k + 1; j < DIRECTIONS; j++)
                m[i][j] -= f * m[k][j];
            for (int j = 0; j < DIRECTIONS; j++)
                b[i][j] -= f * b[k][j];
        }
    for (int i = DIRECTIONS - 1; i >= 0; i--)
        for (int j = 0; j < DIRECTIONS; j++) {
            for (int k = i + 1; k < DIRECTIONS; k++)
                b[i][j] -= m[i][k] * b[k][j];
            b[i][j] /= m[i][i];
        }
}

static void add_straight(const struct directions *d, double thickness, double sign, matrix T)
{
    for (int i = 0; i < DIRECTIONS; i++)
        T[i][i] += sign * exp(-thickness / d->mu[i]);
}

/* `R` is the reflectance, from above, of the layers below, and may be `R_above`; `down` arrives there, and reflected light is added to
 * `R_above`. */
static void between_layers(const matrix R_below, const matrix R, const matrix down_through, const matrix up_through, matrix down,
                           matrix R_above)
{
    matrix m, back;

    multiply(R_below, R, m);
    memcpy(down, down_through, sizeof(matrix));
    solve(m, down);
    multiply(R, down, back);
    multiply(up_through, back, m);
    for (int i = 0; i < DIRECTIONS; i++)
        for (int j = 0; j < DIRECTIONS; j++)
            R_above[i][j] += m[i][j];
}

static void double_layer(const struct directions *d, struct layer *l)
{
    matrix all, down;

    memcpy(all, l->T, sizeof(all));
    add_straight(d, l->thickness, 1.0, all);
    between_layers(l->R, l->R, all, all, down, l->R);
    multiply(all, down, l->T);
    l->thickness *= 2.0;
    add_straight(d, l->thickness, -1.0, l->T);
}

/* Layers of several media, for light from above and from below. T without unscattered light. */
struct half {
    double thickness; /* optical */
    matrix R, T, R_below, T_below;
};

/* Adds a layer below all others. */
static void add_below(const struct directions *d, const struct layer *l, struct half *h)
{
    matrix through, down, up, R;

    memcpy(through, l->T, sizeof(through));
    memcpy(R, l->R, sizeof(R));
    add_straight(d, l->thickness, 1.0, through);
    add_straight(d, h->thickness, 1.0, h->T);
    add_straight(d, h->thickness, 1.0, h->T_below);
    between_layers(h->R_below, l->R, h->T, h->T_below, down, h->R);
    between_layers(l->R, h->R_below, through, through, up, R);
    multiply(through, down, h->T);
    memcpy(down, h->T_below, sizeof(down));
    multiply(down, up, h->T_below);
    memcpy(h->R_below, R, sizeof(R));
    h->thickness += l->thickness;
    add_straight(d, h->thickness, -1.0, h->T);
    add_straight(d, h->thickness, -1.0, h->T_below);
}

/* Swaps the layers from above and from below. */
static void mirror(const struct directions *d, const struct half *h, struct layer *out)
{
    matrix through, back, down;

    memcpy(through, h->T, sizeof(through));
    memcpy(back, h->T_below, sizeof(back));
    memcpy(out->R, h->R, sizeof(out->R));
    add_straight(d, h->thickness, 1.0, through);
    add_straight(d, h->thickness, 1.0, back);
    between_layers(h->R_below, h->R_below, through, back, down, out->R);
    multiply(back, down, out->T);
    out->thickness = 2.0 * h->thickness;
    add_straight(d, out->thickness, -1.0, out->T);
}

/* Adds the lower boundary: `down` arrives at it and `up` at the upper one, for light that starts below the upper one. */
static void add_lower(const struct directions *d, const struct layer *l, matrix up, matrix down)
{
    matrix m;

    memcpy(down, l->T, sizeof(matrix));
    add_straight(d, l->thickness, 1.0, down);
    for (int i = 0; i < DIRECTIONS; i++)
        for (int j = 0; j < DIRECTIONS; j++)
            m[i][j] = down[i][j] * d->fresnel[j]; /* from below, a layer transmits as from above */
    for (int i = 0; i < DIRECTIONS; i++)
        for (int j = 0; j < DIRECTIONS; j++)
            up[i][j] = l->R[i][j] * d->fresnel[j];
    solve(up, down);
    multiply(m, down, up);
    for (int i = 0; i < DIRECTIONS; i++)
        for (int j = 0; j < DIRECTIONS; j++)
            up[i][j] += l->R[i][j];
}

/* Fraction of the light that entered along the normal that crosses unscattered; *again: the fraction that the second boundary reflects. */
static double straight(double thickness, double boundary, double *again)
{
    const double e = exp(-thickness), crossed = (1.0 - boundary) * e / (1.0 - boundary * boundary * e * e);

    *again = crossed * boundary * e;
    return crossed;
}

/* For light along the normal that has entered. */
static void between_boundaries(const struct directions *d, const struct layer *l, double *reflected, double *transmitted)
{
    matrix up, down, m, entering = { { 0.0 } };
    double again;

    add_lower(d, l, up, down);
    for (int i = 0; i < DIRECTIONS; i++) {
        entering[i][NORMAL] = i == NORMAL;
        for (int j = 0; j < DIRECTIONS; j++)
            m[i][j] = d->fresnel[i] * up[i][j];
    }
    solve(m, entering);
    *transmitted = -straight(l->thickness, d->fresnel[NORMAL], &again);
    *reflected = -again;
    for (int i = 0; i < DIRECTIONS; i++)
        for (int j = 0; j < DIRECTIONS; j++) {
            *reflected += (1.0 - d->fresnel[i]) * up[i][j] * entering[j][NORMAL];
            *transmitted += (1.0 - d->fresnel[i]) * down[i][j] * entering[j][NORMAL];
        }
}

bool pell_slab_make(const struct pell_medium *medium, int channel, struct pell_slab *out)
{
    struct directions d;
    struct layer l;
    double albedo;

    *out = (struct pell_slab) { 0.0 };
    for (int i = 0; i < PELL_SLAB_STEPS; i++)
        out->reflected[i] = out->transmitted[i] = log(DBL_MIN);
    if (!pell_medium_valid(medium, NULL) || channel < 0 || channel > 2)
        return false;
    out->sigma_t_reduced = medium->sigma_a[channel] + medium->sigma_s_reduced[channel];
    out->sigma_t = medium->sigma_a[channel] + medium->sigma_s_reduced[channel] / (1.0 - medium->g[channel]);
    out->boundary = pell_fresnel(1.0 / medium->eta, 1.0);
    albedo = medium->sigma_s_reduced[channel] / out->sigma_t_reduced;
    place_directions(medium->eta, &d);
    for (int part = 0; part < PER_OCTAVE && albedo > 0.0; part++) {
        l.thickness = THINNEST * exp2((double) part / PER_OCTAVE - EARLIER);
        scatter_once(&d, albedo, &l);
        for (int i = 0; i < EARLIER; i++)
            double_layer(&d, &l);
        for (int i = part; i < PELL_SLAB_STEPS; i += PER_OCTAVE) {
            double reflected, transmitted;
            between_boundaries(&d, &l, &reflected, &transmitted);
            out->reflected[i] = log(fmax(reflected, DBL_MIN));
            out->transmitted[i] = log(fmax(transmitted, DBL_MIN));
            if (i + PER_OCTAVE < PELL_SLAB_STEPS)
                double_layer(&d, &l);
        }
    }
    return true;
}

static void make_layer(const struct directions *d, double albedo, double thickness, struct layer *l)
{
    int doublings = 0;

    while (ldexp(thickness, -doublings) > ldexp(THINNEST, -EARLIER))
        doublings++;
    l->thickness = ldexp(thickness, -doublings);
    scatter_once(d, albedo, l);
    while (doublings-- > 0)
        double_layer(d, l);
}

static double reduced(const struct pell_medium_layer *l, int channel)
{
    return l->sigma_a[channel] + l->sigma_s_reduced[channel];
}

bool pell_slab_make_layers(const struct pell_stack *stack, int channel, struct pell_slab *out)
{
    struct directions d;
    struct half above = { .thickness = 0.0 };
    double top = 0.0, optical = 0.0; /* of the layer being split; the sum of sigma_t over those above it */
    int next = 0;

    *out = (struct pell_slab) { 0.0 };
    for (int i = 0; i < PELL_SLAB_STEPS; i++)
        out->reflected[i] = out->transmitted[i] = log(DBL_MIN);
    if (!pell_stack_valid(stack, NULL) || channel < 0 || channel > 2)
        return false;
    out->layered = true;
    for (int i = 0; i < stack->count; i++)
        out->sigma_t_reduced = fmax(out->sigma_t_reduced, reduced(&stack->layer[i], channel));
    place_directions(stack->layer[0].eta, &d);
    out->boundary = d.fresnel[NORMAL];
    for (int i = 0; i < PELL_SLAB_STEPS; i++) {
        const double half = 0.5 * THINNEST * exp2((double) i / PER_OCTAVE) / out->sigma_t_reduced;
        struct half all;
        struct layer l;
        double reflected, transmitted, again, ignored;
        for (;; next++) {
            const struct pell_medium_layer *m = &stack->layer[next];
            const double sigma_t = reduced(m, channel), from = fmin(half - top, next + 1 < stack->count ? m->thickness : (double) INFINITY);
            const double full = m->sigma_a[channel] + m->sigma_s_reduced[channel] / (1.0 - m->g[channel]);
            make_layer(&d, m->sigma_s_reduced[channel] / sigma_t, sigma_t * from, &l);
            if (next + 1 == stack->count || top + m->thickness >= half) {
                all = above;
                add_below(&d, &l, &all);
                out->optical[i] = 2.0 * (optical + full * (half - top));
                break;
            }
            add_below(&d, &l, &above);
            top += m->thickness;
            optical += full * m->thickness;
        }
        mirror(&d, &all, &l);
        between_boundaries(&d, &l, &reflected, &transmitted);
        transmitted += straight(l.thickness, out->boundary, &again) - straight(out->optical[i], out->boundary, &ignored);
        out->reflected[i] = log(fmax(reflected + again - ignored, DBL_MIN));
        out->transmitted[i] = log(fmax(transmitted, DBL_MIN));
    }
    return true;
}

/* By reciprocity it is the same for light that enters and light that exits. */
struct pell_half_space_angle pell_passing_angle(const struct pell_medium *medium, int channel)
{
    struct pell_half_space_angle out = { 0.0, 1.0 };
    const double sigma_t = medium->sigma_a[channel] + medium->sigma_s_reduced[channel];
    const double albedo = sigma_t > 0.0 ? medium->sigma_s_reduced[channel] / sigma_t : 0.0;
    struct directions d;
    struct layer l;
    matrix up, down, m, entering = { { 0.0 } };
    double passed[DIRECTIONS] = { 0.0 }, product = 0.0, square = 0.0, all = 0.0, off = 0.0, sum = 0.0, slope;

    if (!(albedo > 0.0) || !pell_medium_valid(medium, NULL))
        return out;
    place_directions(medium->eta, &d);
    make_layer(&d, albedo, PELL_PASSING_THICK, &l);
    add_lower(&d, &l, up, down);
    for (int i = 0; i < DIRECTIONS; i++) {
        entering[i][i] = 1.0;
        for (int j = 0; j < DIRECTIONS; j++)
            m[i][j] = d.fresnel[i] * up[i][j];
    }
    solve(m, entering);
    multiply(down, entering, m);
    for (int j = 0; j < DIRECTIONS; j++)
        for (int i = 0; i < DIRECTIONS; i++)
            passed[j] += (1.0 - d.fresnel[i]) * (m[i][j] - (i == j ? exp(-l.thickness / d.mu[i]) : 0.0));
    for (int j = 0; j < NODES && passed[NORMAL] > 0.0; j++) {
        const double x = 1.0 - d.mu[j], weight = (1.0 - d.fresnel[j]) * d.weight[j] * d.mu[j];
        product += weight * x * passed[j];
        square += weight * x * x;
        sum += weight * passed[j];
        all += weight;
        off += weight * x;
    }
    slope = all * square - off * off > 0.0 ? (all * product - off * sum) / (all * square - off * off) : 0.0;
    if (all > 0.0 && sum - slope * off > 0.0) {
        out.slope = slope * all / (sum - slope * off);
        out.mean = 1.0 + out.slope * off / all;
    }
    return out;
}

/* Lagrange's cubic through four entries. */
static double between(const double *table, double x)
{
    const int i = (int) fmin(fmax(floor(x) - 1.0, 0.0), PELL_SLAB_STEPS - 4);
    const double t = x - i, *v = table + i;

    return v[0] * (t - 1.0) * (t - 2.0) * (t - 3.0) / -6.0 + v[1] * t * (t - 2.0) * (t - 3.0) / 2.0 +
           v[2] * t * (t - 1.0) * (t - 3.0) / -2.0 + v[3] * t * (t - 1.0) * (t - 2.0) / 6.0;
}

struct pell_slab_light pell_slab_at(const struct pell_slab *s, double d)
{
    const int last = PELL_SLAB_STEPS - 1;
    const double thickest = THINNEST * exp2((double) last / PER_OCTAVE), far = fmin(fmax(d, 0.0), DBL_MAX); /* NaN: 0 */
    const double thickness = s->sigma_t_reduced * far;
    struct pell_slab_light out;
    double again, again_reduced;

    if (thickness < THINNEST) { /* single scattering, proportional to the thickness */
        out.reflected = exp(s->reflected[0]) * thickness / THINNEST;
        out.transmitted = exp(s->transmitted[0]) * thickness / THINNEST;
    } else if (thickness < thickest) {
        const double x = PER_OCTAVE * log2(thickness / THINNEST);
        out.reflected = exp(between(s->reflected, x));
        out.transmitted = exp(between(s->transmitted, x));
    } else { /* nothing is transmitted except with almost no absorption: there T falls as 1/d */
        out.reflected = exp(s->reflected[last]);
        out.transmitted = exp(s->transmitted[last]) * thickest / thickness;
    }
    if (s->layered) {
        const double x = PER_OCTAVE * log2(fmax(thickness, THINNEST) / THINNEST);
        const int i = (int) fmin(x, last - 1);
        const double from = THINNEST * exp2((double) i / PER_OCTAVE), f = (thickness / from - 1.0) / (exp2(1.0 / PER_OCTAVE) - 1.0);
        const double optical =
            thickness < THINNEST ? s->optical[0] * thickness / THINNEST : s->optical[i] + f * (s->optical[i + 1] - s->optical[i]);
        out.straight = straight(optical, s->boundary, &again);
        return out;
    }
    out.straight = straight(s->sigma_t * far, s->boundary, &again);
    out.transmitted += straight(thickness, s->boundary, &again_reduced) - out.straight;
    out.reflected += again_reduced - again;
    return out;
}

/* x coth x and x tanh x. */
static double x_coth(double x)
{
    return x > 1e-4 ? x / tanh(x) : 1.0 + x * x / 3.0;
}

static double x_tanh(double x)
{
    return x * tanh(x);
}

/* A wave of frequency k decays with kappa = sqrt(sigma_tr^2 + k^2); for a source at z0 = 1/sigma_t' between extrapolated boundaries z_b
 * outside of the slab, sinh(kappa (z0 + z_b)) cosh(kappa z_b)/sinh(kappa (d + 2 z_b)) exits on the far side. The variance along an axis is
 * -d/d(k^2) of twice its logarithm at k = 0. */
double pell_slab_spread(const struct pell_medium *m, int channel, double d)
{
    const double sigma_t = m->sigma_a[channel] + m->sigma_s_reduced[channel], D = 1.0 / (3.0 * sigma_t);
    const double kappa = sqrt(m->sigma_a[channel] / D), zb = 2.0 * pell_boundary_A(m->eta, PELL_FRESNEL_EXACT, 0.0) * D;
    const double length = fmax(d, 0.0) + 2.0 * zb, source = fmin(1.0 / sigma_t, fmax(d, 0.0)) + zb;

    if (kappa * length < 1e-3)
        return fmax((length * length - source * source) / 3.0 - zb * zb, 0.0);
    return fmax((x_coth(kappa * length) - x_coth(kappa * source) - x_tanh(kappa * zb)) / (kappa * kappa), 0.0);
}
