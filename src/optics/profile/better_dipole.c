/* SPDX-License-Identifier: MIT
 *
 * better_dipole.c - d'Eon 2012, "A Better Dipole": Grosjean's diffusion coefficient, exitance from fluence and flux, and an
 * extrapolation distance by two moments of the boundary's reflectance.
 *
 *     D = (2 sigma_a + sigma_s')/(3 sigma_t'^2)     sigma_tr = sqrt(sigma_a/D)       zr = 1/sigma_t'    zv = zr + 4 A D
 *     c1 = 2 Int F mu dmu     c2 = 3 Int F mu^2 dmu     A = (1 + c2)/(1 - c1)     C_phi = (1 - c1)/4     C_E = (1 - c2)/2
 *     R = alpha'^2/(4 pi) (C_phi/D (exp(-s dr)/dr - exp(-s dv)/dv) + C_E (pole of zr + pole of zv)),  s = sigma_tr
 *
 * F is the reflectance from inside. A rough boundary replaces c1 by its own, and scales c2 in proportion. Without absorption the total is 1
 * for any c1 and c2. It has no single scattering: alpha' is squared.
 *
 * Single scattering is added as in single.c, with the medium's own sigma_s, sigma_t and phase function. Its total at an albedo of 1 is the
 * fraction of light that does not collide again: R is weighted by one minus that. So the total without absorption is still 1, for any g; at
 * g = 0 totals are within 4 % of the Monte Carlo results, where the plain sum would be up to 18 % too large. */
#include "math/quadrature.h"
#include "math/vec.h"
#include "optics/photon/table.h"
#include "optics/profile/lanes.h"
#include "optics/profile/nodes.h"
#include "optics/profile/shape.h"

#include <pellucid/inversion.h>

#include <math.h>

#define FIRST 1e-6 /* radius of the first node, in the shorter of the mean free paths */
#define NODES 400

struct moment {
    double eta, critical;
};

/* mu = critical + (1 - critical) t^2: F behaves like a square root at the critical angle. */
static double second_moment(double t, const void *arg)
{
    const struct moment *m = arg;
    const double mu = m->critical + (1.0 - m->critical) * t * t;
    return 3.0 * mu * mu * pell_fresnel(1.0 / m->eta, mu) * 2.0 * (1.0 - m->critical) * t;
}

enum pell_result pell_profile_boundary_make(double eta, const struct pell_profile_params *params, struct pell_profile_boundary *out)
{
    const struct moment m = { eta, eta > 1.0 ? sqrt((eta - 1.0) * (eta + 1.0)) / eta : 0.0 };

    if (params->A > 0.0 || (params->roughness > 0.0 && params->fresnel != PELL_FRESNEL_EXACT))
        return PELL_ERR_UNSUPPORTED;
    out->c1 = pell_fresnel_diffuse(eta, params->fresnel);
    out->c2 = 0.0;
    if (eta != 1.0)
        out->c2 = m.critical * m.critical * m.critical + pell_integrate(second_moment, &m, 0.0, 1.0, 1e-15, 1e-13, NULL);
    if (params->roughness > 0.0 && out->c1 > 0.0) {
        const double c1 = pell_fresnel_diffuse_rough(eta, params->roughness);
        out->c2 *= c1 / out->c1;
        out->c1 = c1;
    }
    return PELL_OK;
}

/* out: multiple and single scattering. */
static void add_single(const struct pell_medium *medium, int channel, const struct pell_profile *multiple, const struct pell_single *single,
                       struct pell_profile *out)
{
    const double sigma_a = medium->sigma_a[channel], sigma_s = medium->sigma_s_reduced[channel] / (1.0 - medium->g[channel]);
    const double sigma_t = sigma_a + sigma_s, sigma_t_reduced = sigma_a + medium->sigma_s_reduced[channel],
                 decay = multiple->parameter[PAIR_SIGMA];
    const double first = FIRST / fmax(sigma_t_reduced, sigma_t),
                 last = fmin(300.0 / sigma_t_reduced, 45.0 / fmax(fmin(decay, sigma_t), 1e-3 * sigma_t_reduced));

    for (int i = 0; i < NODES; i++) {
        const double r = first * exp(log(last / first) * i / (NODES - 1));
        out->r[i] = r;
        out->value[i] = pell_profile_eval(multiple, r) + sigma_s * sigma_t * pell_single_rd(single, r * sigma_t);
    }
    pell_profile_nodes_make(out, NODES, PELL_NODES_LOG, decay);
    pell_profile_nodes_scale(out, fmin(1.0, multiple->total + sigma_s / sigma_t * single->total) / out->total);
    out->total = fmin(1.0, multiple->total + sigma_s / sigma_t * single->total);
}

static enum pell_result make(const struct pell_medium *medium, int channel, const struct pell_profile_params *params,
                             struct pell_profile *out)
{
    const double sigma_a = medium->sigma_a[channel], sigma_s = medium->sigma_s_reduced[channel], sigma_t = sigma_a + sigma_s;
    const double albedo = sigma_s / sigma_t, D = (1.0 + sigma_a / sigma_t) / (3.0 * sigma_t);
    struct pell_profile_boundary boundary;
    const enum pell_result res = pell_profile_boundary_make(medium->eta, params, &boundary);

    if (res != PELL_OK)
        return PELL_ERR_UNSUPPORTED;
    const double A = (1.0 + boundary.c2) / (1.0 - boundary.c1);
    double scale = albedo * albedo / (4.0 * PELL_PI);
    struct pell_profile multiple = { 0 };
    struct pell_single single;

    pell_single_make(medium->g[channel], medium->eta, &single);
    scale *= 1.0 - single.total;
    pell_profile_pair_make(&multiple, sqrt(sigma_a / D), 1.0 / sigma_t, 1.0 / sigma_t + 4.0 * A * D, scale * 0.5 * (1.0 - boundary.c2),
                           scale * 0.25 * (1.0 - boundary.c1) / D);
    if (params->without_single || !(albedo > 0.0))
        *out = multiple;
    else
        add_single(medium, channel, &multiple, &single, out);
    return PELL_OK;
}

const struct pell_profile_source pell_profile_source_better_dipole = {
    .row = {
        .name = "better-dipole",
        .title = "Better dipole",
        .cite = "E. d'Eon, \"A Better Dipole\", 2012",
        .limits = "Too little light scattered more than once near the point of entry; light at right angles only.",
    },
    .make = make,
};
