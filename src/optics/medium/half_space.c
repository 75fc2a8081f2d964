/* SPDX-License-Identifier: MIT
 *
 * half_space.c - the albedo of a half-space with a boundary, by radiative transfer and not by diffusion.
 *
 * Without a boundary, Chandrasekhar 1960, "Radiative Transfer", III: light incident along mu' with unit irradiance exits as
 * S(mu, mu') = alpha/(4 pi) H(mu) H(mu')/(mu + mu'), where 1/H(mu) = sqrt(1 - alpha) + alpha/2 Int_0^1 mu' H(mu')/(mu + mu') dmu'.
 * The boundary reflects the fraction F(mu) of the light u(mu) that reaches it, so that
 *
 *     u(mu) = S(mu, 1) + 2 pi Int_0^1 S(mu, mu') mu' F(mu') u(mu') dmu'        total = 2 pi Int_0^1 mu (1 - F) u dmu
 *
 * For light that enters along another cosine mu_0, S(mu, mu_0) replaces S(mu, 1).
 *
 * Both are solved at Gauss-Legendre nodes, split at the critical angle. H uses the same nodes as u, which makes a medium without absorption
 * return 1 whatever the number of nodes. */
#include "math/quadrature.h"
#include "math/vec.h"
#include "optics/profile/shape.h"

#include <math.h>
#include <stdbool.h>

enum { GAUSS = 12, MAX_NODES = 2 * GAUSS, ANGLES = 8 };

/* x^2 concentrates nodes at the lower end, where H and F behave like square roots. */
static int place_nodes(double eta, double mu[MAX_NODES], double weight[MAX_NODES])
{
    const double critical = eta > 1.0 ? sqrt((eta - 1.0) * (eta + 1.0)) / eta : 0.0;
    double x[GAUSS], w[GAUSS];
    int n = 0;

    pell_gauss_legendre(GAUSS, x, w);
    for (int part = critical > 0.0 ? 0 : 1; part < 2; part++) {
        const double from = part == 0 ? 0.0 : critical, length = part == 0 ? critical : 1.0 - critical;
        for (int i = 0; i < GAUSS; i++, n++) {
            mu[n] = from + length * x[i] * x[i];
            weight[n] = 2.0 * length * x[i] * w[i];
        }
    }
    return n;
}

static double inverse_h(double at, double alpha, double root, const double *mu, const double *weight, const double *h, int n)
{
    double sum = 0.0;
    for (int i = 0; i < n; i++)
        sum += weight[i] * mu[i] * h[i] / (mu[i] + at);
    return root + 0.5 * alpha * sum;
}

/* Gaussian elimination with pivoting; the solution replaces b. */
static void solve(double m[MAX_NODES][MAX_NODES], double *b, int n)
{
    for (int k = 0; k < n; k++) {
        int best = k;
        for (int i = k + 1; i < n; i++)
            best = fabs(m[i][k]) > fabs(m[best][k]) ? i : best;
        for (int j = k; best != k && j < n; j++) {
            const double t = m[k][j];
            m[k][j] = m[best][j];
            m[best][j] = t;
        }
        const double t = b[k];
        b[k] = b[best];
        b[best] = t;
        for (int i = k + 1; i < n; i++) {
            const double f = m[i][k] / m[k][k];
            for (int j = k + 1; j < n; j++)
                m[i][j] -= f * m[k][j];
            b[i] -= f * b[k];
        }
    }
    for (int i = n - 1; i >= 0; i--) {
        for (int j = i + 1; j < n; j++)
            b[i] -= m[i][j] * b[j];
        b[i] /= m[i][i];
    }
}

/* Cosine inside the boundary for light incident along mu; 0 for total reflection. */
static double refracted(double eta, double mu)
{
    const double square = 1.0 - (1.0 - mu * mu) / (eta * eta);
    return square > 0.0 ? sqrt(square) : 0.0;
}

/* H at the nodes of one medium. */
struct half_space {
    double mu[MAX_NODES], weight[MAX_NODES], h[MAX_NODES], albedo, root, eta;
    int n;
};

static void make(double albedo, double absorbed, double eta, struct half_space *s)
{
    s->n = place_nodes(eta, s->mu, s->weight);
    s->albedo = albedo;
    s->root = sqrt(absorbed);
    s->eta = eta;
    for (int i = 0; i < s->n; i++)
        s->h[i] = (1.0 + 2.0 * s->mu[i]) / (1.0 + 2.0 * s->mu[i] * s->root); /* Hapke's approximation */
    for (int round = 0; round < 200; round++) {
        double next[MAX_NODES], change = 0.0;
        for (int i = 0; i < s->n; i++) {
            next[i] = 0.5 * (s->h[i] + 1.0 / inverse_h(s->mu[i], albedo, s->root, s->mu, s->weight, s->h, s->n));
            change = fmax(change, fabs(next[i] / s->h[i] - 1.0));
        }
        for (int i = 0; i < s->n; i++)
            s->h[i] = next[i];
        if (change < 1e-14)
            break;
    }
}

/* Fraction of the light that entered along the cosine `inside` that exits. */
static double returned(const struct half_space *s, double inside)
{
    const double down = 1.0 / inverse_h(inside, s->albedo, s->root, s->mu, s->weight, s->h, s->n), k = 0.25 * s->albedo / PELL_PI;
    double u[MAX_NODES], m[MAX_NODES][MAX_NODES], total = 0.0;

    for (int i = 0; i < s->n; i++) {
        u[i] = k * s->h[i] * down / (s->mu[i] + inside);
        for (int j = 0; j < s->n; j++)
            m[i][j] = (i == j) - k * s->h[i] * s->h[j] / (s->mu[i] + s->mu[j]) * 2.0 * PELL_PI * s->mu[j] * s->weight[j] *
                                     pell_fresnel(1.0 / s->eta, s->mu[j]);
    }
    solve(m, u, s->n);
    for (int i = 0; i < s->n; i++)
        total += 2.0 * PELL_PI * s->weight[i] * s->mu[i] * (1.0 - pell_fresnel(1.0 / s->eta, s->mu[i])) * u[i];
    return fmin(1.0, fmax(0.0, total));
}

double pell_half_space_total(double albedo, double absorbed, double eta)
{
    struct half_space s;

    make(albedo, absorbed, eta, &s);
    return returned(&s, 1.0);
}

double pell_half_space_albedo(double albedo, double eta)
{
    if (!(albedo >= 0.0 && albedo <= 1.0 && eta >= PELL_ETA_MIN && eta <= PELL_ETA_MAX))
        return NAN;
    return pell_half_space_total(albedo, 1.0 - albedo, eta);
}

double pell_half_space_albedo_at(double albedo, double eta, double mu)
{
    struct half_space s;

    if (!(albedo >= 0.0 && albedo <= 1.0 && eta >= PELL_ETA_MIN && eta <= PELL_ETA_MAX && mu > 0.0 && mu <= 1.0))
        return NAN;
    make(albedo, 1.0 - albedo, eta, &s);
    return returned(&s, refracted(eta, mu));
}

/* The medium whose total reflectance at normal incidence is `total`: solved for the logarithm of its absorption, in which the reflectance
 * decreases. False position, Illinois (Dowell and Jarratt 1971, "A Modified Regula Falsi Method"). */
static void make_for_total(double total, double eta, struct half_space *s)
{
    double log_absorbed[2] = { log(1e-12), 0.0 }, difference[2] = { 1.0 - total, -total };
    int last = -1;

    for (int i = 0; i < 60; i++) {
        const double middle = (log_absorbed[0] * difference[1] - log_absorbed[1] * difference[0]) / (difference[1] - difference[0]),
                     absorbed = exp(middle);
        double value;
        int end;
        make(1.0 - absorbed, absorbed, eta, s);
        value = returned(s, 1.0) - total;
        if (fabs(value) < 1e-6 * total)
            return;
        end = value < 0.0;
        log_absorbed[end] = middle;
        difference[end] = value;
        difference[!end] *= end == last ? 0.5 : 1.0;
        last = end;
    }
}

/* Nodes over the directions that enter, with the fraction of uniform light incident along each. */
struct angles {
    double inside[ANGLES], weight[ANGLES], entered, one_minus_cosine;
};

static void place_angles(double eta, struct angles *a)
{
    double mu[ANGLES], weight[ANGLES];

    pell_gauss_legendre(ANGLES, mu, weight);
    a->entered = a->one_minus_cosine = 0.0;
    for (int i = 0; i < ANGLES; i++) {
        a->inside[i] = refracted(eta, mu[i]);
        a->weight[i] = weight[i] * 2.0 * mu[i] * (1.0 - pell_fresnel(eta, mu[i]));
        a->entered += a->weight[i];
        a->one_minus_cosine += a->weight[i] * (1.0 - a->inside[i]);
    }
}

/* The least squares slope of values that are 0 at normal incidence. */
static double slope_of(const struct angles *a, const double excess[ANGLES])
{
    double product = 0.0, square = 0.0;

    for (int i = 0; i < ANGLES; i++) {
        const double x = 1.0 - a->inside[i];
        product += a->weight[i] * x * excess[i];
        square += a->weight[i] * x * x;
    }
    return square > 0.0 ? product / square : 0.0;
}

struct pell_half_space_angle pell_half_space_angle_of(double total, double eta)
{
    struct pell_half_space_angle a = { 0.0, 1.0 };
    struct angles at;
    double excess[ANGLES];
    struct half_space s;

    if (!(total > 0.0 && total < 1.0 && eta >= PELL_ETA_MIN && eta <= PELL_ETA_MAX))
        return a;
    make_for_total(total, eta, &s);
    place_angles(eta, &at);
    for (int i = 0; i < ANGLES; i++)
        excess[i] = returned(&s, at.inside[i]) / total - 1.0;
    a.slope = slope_of(&at, excess);
    a.mean = 1.0 + a.slope * at.one_minus_cosine / at.entered;
    return a;
}

struct pell_half_space_angle pell_half_space_angle_multiple(double total, double albedo, double eta, struct pell_half_space_angle angle)
{
    struct pell_half_space_angle a = { 0.0, 1.0 };
    struct angles at;
    double excess[ANGLES], once, rest;

    if (!(total > 0.0 && total < 1.0 && albedo > 0.0 && albedo <= 1.0 && eta >= PELL_ETA_MIN && eta <= PELL_ETA_MAX))
        return a;
    once = albedo * pell_single_scattering_albedo_at(0.0, eta, 1.0);
    rest = total - once;
    if (!(rest > 0.0))
        return a;
    place_angles(eta, &at);
    for (int i = 0; i < ANGLES; i++)
        excess[i] = albedo * pell_single_scattering_albedo_at(0.0, eta, at.inside[i]) - once;
    a.slope = (total * angle.slope - slope_of(&at, excess)) / rest;
    a.mean = 1.0 + a.slope * at.one_minus_cosine / at.entered;
    return a;
}
