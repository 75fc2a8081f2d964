/* SPDX-License-Identifier: MIT
 *
 * half_space.c - how much light a half-space with a boundary gives back, by transport and not by diffusion.
 *
 * Without a boundary, Chandrasekhar 1960, "Radiative Transfer", III: light that falls along mu' with unit irradiance leaves as
 * S(mu, mu') = alpha/(4 pi) H(mu) H(mu')/(mu + mu'), where 1/H(mu) = sqrt(1 - alpha) + alpha/2 Int_0^1 mu' H(mu')/(mu + mu') dmu'.
 * The boundary sends the share F(mu) of the light u(mu) that reaches it back in, so that
 *
 *     u(mu) = S(mu, 1) + 2 pi Int_0^1 S(mu, mu') mu' F(mu') u(mu') dmu'        total = 2 pi Int_0^1 mu (1 - F) u dmu
 *
 * Both are solved at Gauss-Legendre nodes, split at the critical angle. H uses the same nodes as u, which makes a medium without absorption
 * return 1 whatever the number of nodes. */
#include "math/quadrature.h"
#include "math/vec.h"
#include "optics/profile/shape.h"

#include <math.h>
#include <stdbool.h>

enum { GAUSS = 12, MOST = 2 * GAUSS };

/* x^2 draws nodes towards the lower end, where H and F have roots. */
static int place(double eta, double mu[MOST], double weight[MOST])
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

/* Gaussian elimination with pivots; the answer replaces b. */
static void solve(double m[MOST][MOST], double *b, int n)
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

double pell_half_space_total(double albedo, double absorbed, double eta)
{
    double mu[MOST], weight[MOST], h[MOST], u[MOST], m[MOST][MOST], total = 0.0;
    const int n = place(eta, mu, weight);
    const double root = sqrt(absorbed);

    for (int i = 0; i < n; i++)
        h[i] = (1.0 + 2.0 * mu[i]) / (1.0 + 2.0 * mu[i] * root); /* Hapke's approximation */
    for (int round = 0; round < 200; round++) {
        double next[MOST], change = 0.0;
        for (int i = 0; i < n; i++) {
            next[i] = 0.5 * (h[i] + 1.0 / inverse_h(mu[i], albedo, root, mu, weight, h, n));
            change = fmax(change, fabs(next[i] / h[i] - 1.0));
        }
        for (int i = 0; i < n; i++)
            h[i] = next[i];
        if (change < 1e-14)
            break;
    }
    const double down = 1.0 / inverse_h(1.0, albedo, root, mu, weight, h, n), k = 0.25 * albedo / PELL_PI;
    for (int i = 0; i < n; i++) {
        u[i] = k * h[i] * down / (mu[i] + 1.0);
        for (int j = 0; j < n; j++)
            m[i][j] = (i == j) - k * h[i] * h[j] / (mu[i] + mu[j]) * 2.0 * PELL_PI * mu[j] * weight[j] * pell_fresnel(1.0 / eta, mu[j]);
    }
    solve(m, u, n);
    for (int i = 0; i < n; i++)
        total += 2.0 * PELL_PI * weight[i] * mu[i] * (1.0 - pell_fresnel(1.0 / eta, mu[i])) * u[i];
    return fmin(1.0, fmax(0.0, total));
}

double pell_half_space_albedo(double albedo, double eta)
{
    if (!(albedo >= 0.0 && albedo <= 1.0 && eta >= PELL_ETA_MIN && eta <= PELL_ETA_MAX))
        return NAN;
    return pell_half_space_total(albedo, 1.0 - albedo, eta);
}
