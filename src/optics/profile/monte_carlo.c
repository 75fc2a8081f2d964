/* SPDX-License-Identifier: MIT
 *
 * monte_carlo.c - the profile of a half-space under a beam at normal incidence by Monte Carlo: single scattering by an integral
 * (photon/single.c), multiple scattering from a table of simulated photons (photon/table.h), the far field by diffusion with the decay of
 * transport. */
#include <pellucid/inversion.h>

#include "math/vec.h"
#include "optics/photon/table.h"
#include "optics/profile/nodes.h"
#include "optics/profile/shape.h"

#define PER_DECADE 20
#define FIRST 1e-4 /* the first radius, in reduced mean free paths: 2e-4 of the light at most falls within */
#define DARK 45.0  /* kappa r beyond which R is 0 */

/* y(x) of the table: cubics with central slopes; below the first radius its power of r, between those of R ~ 1/r and R constant. */
static double between(const double y[PELL_TABLE_R], double x)
{
    const double h = pell_table_x(1) - pell_table_x(0), t = (x - pell_table_x(0)) / h;
    if (t <= 0.0)
        return y[0] + fmin(fmax((y[1] - y[0]) / h, 1.0), 2.0) * (x - pell_table_x(0));
    const int i = t < PELL_TABLE_R - 1 ? (int) t : PELL_TABLE_R - 2;
    const double s = t - i, low = i > 0 ? 0.5 * (y[i + 1] - y[i - 1]) : y[1] - y[0],
                 high = i + 2 < PELL_TABLE_R ? 0.5 * (y[i + 2] - y[i]) : y[i + 1] - y[i];
    const double s2 = s * s, s3 = s2 * s;
    return (2.0 * s3 - 3.0 * s2 + 1.0) * y[i] + (s3 - 2.0 * s2 + s) * low + (3.0 * s2 - 2.0 * s3) * y[i + 1] + (s3 - s2) * high;
}

/* Multiple scattering beyond the table, from that at its nearest end: all light is that of the end's g, scaled as the exact total of a
 * half-space changes with the index, and what is scattered once is taken off. The shape changes as the dipole's does: light that is
 * reflected inside more often leaves farther away. */
struct beyond {
    struct pell_dipole there, edge;
    double factor; /* of multiple scattering at all radii */
};

static bool reach_beyond(const struct pell_medium *medium, int channel, double albedo, double albedo_clamped, double g_clamped,
                         const struct pell_single *single, double *multiple, struct beyond *b)
{
    const double a = medium->sigma_a[channel], s = medium->sigma_s_reduced[channel], reduced = s / (a + s), g = medium->g[channel];
    const double eta = medium->eta, edge = fmin(fmax(eta, pell_photon_table_data.eta[0]), pell_photon_table_data.eta[PELL_TABLE_ETA - 1]);
    const double at_edge = *multiple, twice = albedo_clamped * albedo_clamped, once = albedo_clamped * pell_single_total(g_clamped, edge);
    double ratio;

    if ((eta == edge && g == g_clamped) || at_edge <= 0.0)
        return false;
    b->there = pell_dipole_make(1.0 - reduced, reduced, eta, PELL_FRESNEL_EXACT);
    b->edge = pell_dipole_make(1.0 - reduced, reduced, edge, PELL_FRESNEL_EXACT);
    ratio = pell_half_space_total(reduced, 1.0 - reduced, eta) / pell_half_space_total(reduced, 1.0 - reduced, edge);
    *multiple = reduced < 0.02 ? at_edge * ratio /* where the difference of totals would be their rounding error */
                               : fmin(fmax((twice * at_edge + once) * ratio - albedo * single->total, 0.0), 1.0) / twice;
    b->factor = *multiple / at_edge * pell_dipole_total(&b->edge) / pell_dipole_total(&b->there);
    return true;
}

static enum pell_result make(const struct pell_medium *medium, int channel, const struct pell_profile_params *params,
                             struct pell_profile *out)
{
    const double sigma_t_reduced = medium->sigma_a[channel] + medium->sigma_s_reduced[channel], g = medium->g[channel];
    const double albedo_reduced = medium->sigma_s_reduced[channel] / sigma_t_reduced, eta = medium->eta;
    const double g_clamped = fmin(fmax(g, pell_photon_table_data.g[0]), pell_photon_table_data.g[PELL_TABLE_G - 1]);
    /* Single scattering with the medium's own g, the rest with g clamped to the table's range. */
    const double albedo = pell_albedo_of_reduced(albedo_reduced, g), extinction_ratio = 1.0 / (1.0 - albedo * g);
    const double albedo_clamped = pell_albedo_of_reduced(albedo_reduced, g_clamped);
    const double kappa = pell_transport_kappa(albedo_clamped, g_clamped) / (1.0 - albedo_clamped * g_clamped);
    const double end = fmin(DARK / fmax(kappa, 1e-300), PELL_TABLE_R_MIN * pow(10.0, (PELL_TABLE_R - 1.0) / PELL_TABLE_PER_DECADE));
    struct pell_single single;
    struct beyond beyond;
    bool is_beyond;
    double y[PELL_TABLE_R], multiple, total;
    int count = 0;

    if (params->A > 0.0 || params->roughness > 0.0 || params->fresnel != PELL_FRESNEL_EXACT)
        return PELL_ERR_UNSUPPORTED; /* the table was simulated with a smooth boundary */
    if (albedo == 0.0)
        return PELL_OK;
    pell_multiple(albedo_reduced, g_clamped, eta, y, &multiple);
    pell_single_make(g, eta, &single);
    is_beyond = reach_beyond(medium, channel, albedo, albedo_clamped, g_clamped, &single, &multiple, &beyond);
    total = albedo_clamped * albedo_clamped * multiple;
    if (!params->without_single)
        total = fmin(1.0, total + albedo * single.total);

    for (; count < PELL_PROFILE_NODES; count++) {
        const double x = log(FIRST) + log(10.0) / PER_DECADE * count, r = exp(x), area = 2.0 * PELL_PI * r * r;
        double value = albedo_clamped * albedo_clamped * exp(between(y, x) - kappa * r) / area;
        if (r > end * (1.0 + 1e-9))
            break;
        if (is_beyond && value > 0.0)
            value *= beyond.factor * pell_dipole_rd(&beyond.there, r) / pell_dipole_rd(&beyond.edge, r);
        if (!params->without_single)
            value += albedo * extinction_ratio * extinction_ratio * pell_single_rd(&single, r * extinction_ratio);
        out->r[count] = r / sigma_t_reduced;
        out->value[count] = value * sigma_t_reduced * sigma_t_reduced;
    }
    pell_profile_nodes_make(out, count, PELL_NODES_LOG, kappa * sigma_t_reduced);
    pell_profile_nodes_scale(out, total / out->total);
    out->total = total;
    return PELL_OK;
}

const struct pell_profile_source pell_profile_source_monte_carlo = {
    { "monte-carlo", "Photon Monte Carlo",
      "a table of photons: tools/photon_table.c; after L. Wang, S. L. Jacques, L. Zheng, \"MCML - Monte Carlo modeling of light transport "
      "in multi-layered tissues\", Computer Methods and Programs in Biomedicine 47, 1995",
      "A smooth half-space under light at right angles; beyond g in [-0.3, 0.91] the total is that of the nearer end; beyond eta in "
      "[1, 2.1] it is exact, and multiple scattering has the shape of the nearer end as the dipole changes it." },
    make,
};
