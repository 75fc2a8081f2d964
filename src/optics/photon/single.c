/* SPDX-License-Identifier: MIT
 *
 * single.c - single scattering, in closed form up to one integral; and the decay of the far field. */
#include "optics/photon/table.h"

#include <pellucid/profile.h>

#include "math/quadrature.h"
#include "math/vec.h"

/* Henyey-Greenstein phase function, 1/sr, for scattering into a direction that rises with cosine mu: its scattering angle has cosine
 * -mu. */
static double phase_up(double g, double mu)
{
    const double d = 1.0 + g * g + 2.0 * g * mu;
    return (1.0 - g * g) / (4.0 * PELL_PI * d * sqrt(d));
}

/* A photon that collides at depth z and exits at r rises with mu = z/sqrt(z^2 + r^2). With mu = sin t
 *
 *     R(tau) = 1/tau Int sin t p(-sin t) (1 - F(sin t)) exp(-tau (1 + sin t)/cos t) dt     in units of sigma_t^2
 *     total  = Int 2 pi p(-mu) mu/(1 + mu) (1 - F(mu)) dmu
 *
 * over t from total reflection to pi/2: t = t0 + (pi/2 - t0) s^2, as the transmittance starts as a square root, in panels that shrink
 * towards the end, where a backscattering phase function has its peak. */
void pell_single_make(double g, double eta, struct pell_single *out)
{
    enum { PANELS = 4, PER_PANEL = PELL_SINGLE_ANGLES / PANELS };
    static const double edges[PANELS + 1] = { 0.0, 0.4, 0.75, 0.93, 1.0 };
    const double t0 = eta > 1.0 ? acos(1.0 / eta) : 0.0, width = 0.5 * PELL_PI - t0;
    double x[PER_PANEL], weight[PER_PANEL];
    int n = 0;

    pell_gauss_legendre(PER_PANEL, x, weight);
    out->total = 0.0;
    for (int panel = 0; panel < PANELS; panel++) {
        const double from = edges[panel], length = edges[panel + 1] - from;
        for (int i = 0; i < PER_PANEL; i++, n++) {
            const double s = from + length * x[i], t = t0 + width * s * s, mu = sin(t), c = cos(t);
            const double w = length * weight[i] * 2.0 * width * s * mu * phase_up(g, mu) * (1.0 - pell_fresnel(1.0 / eta, mu));
            out->weight[n] = w;
            out->rate[n] = (1.0 + mu) / c;
            out->total += 2.0 * PELL_PI * w * c / (1.0 + mu);
        }
    }
}

double pell_single_rd(const struct pell_single *s, double tau)
{
    double sum = 0.0;
    for (int i = 0; i < PELL_SINGLE_ANGLES; i++)
        sum += s->weight[i] * exp(-tau * s->rate[i]);
    return sum / tau;
}

double pell_single_total(double g, double eta)
{
    struct pell_single s;
    pell_single_make(g, eta, &s);
    return s.total;
}

double pell_single_scattering_albedo_at(double g, double eta, double inside)
{
    enum { MUS = 48, TURNS = 48 };
    const double critical = eta > 1.0 ? sqrt((eta - 1.0) * (eta + 1.0)) / eta : 0.0, across = sqrt(fmax(0.0, 1.0 - inside * inside));
    double x[MUS], weight[MUS], total = 0.0;

    if (!(fabs(g) <= PELL_G_MAX && eta >= PELL_ETA_MIN && eta <= PELL_ETA_MAX && inside > 0.0 && inside <= 1.0))
        return NAN;
    pell_gauss_legendre(MUS, x, weight);
    for (int i = 0; i < MUS; i++) {
        const double mu = critical + (1.0 - critical) * x[i] * x[i], side = sqrt(1.0 - mu * mu) * across;
        double phase = 0.0;
        for (int k = 0; k < TURNS; k++)
            phase += phase_up(g, inside * mu + side * cos(2.0 * PELL_PI * (k + 0.5) / TURNS)) / TURNS;
        total +=
            weight[i] * 2.0 * (1.0 - critical) * x[i] * 2.0 * PELL_PI * phase * mu / (inside + mu) * (1.0 - pell_fresnel(1.0 / eta, mu));
    }
    return total;
}

/* Whether kappa is below the smallest root: all pivots of the fraction, taken from its far end, are positive (Sturm). */
static bool below_root(double albedo, double g, double kappa)
{
    enum { ORDER = 160 };
    double power[ORDER + 1], pivot = 2.0 * ORDER + 1.0;
    const double k2 = kappa * kappa;
    power[0] = 1.0;
    for (int l = 1; l <= ORDER; l++)
        power[l] = power[l - 1] * g;
    for (int l = ORDER - 1; l >= 0; l--) {
        pivot = (2.0 * l + 1.0) * (1.0 - albedo * power[l]) - k2 * (l + 1.0) * (l + 1.0) / pivot;
        if (!(pivot > 0.0))
            return false;
    }
    return true;
}

double pell_transport_kappa(double albedo, double g)
{
    double low = 0.0, high = 1.0;
    if (albedo >= 1.0)
        return 0.0;
    if (below_root(albedo, g, 1.0))
        return 1.0;
    for (int i = 0; i < 44; i++) {
        const double middle = 0.5 * (low + high);
        if (below_root(albedo, g, middle))
            low = middle;
        else
            high = middle;
    }
    return low;
}
