/* SPDX-License-Identifier: MIT
 *
 * better_dipole.c - d'Eon 2012, "A Better Dipole": Grosjean's diffusion coefficient, exitance from fluence and flux, and an
 * extrapolation distance by two moments of the boundary's reflectance.
 *
 *     D = (2 sigma_a + sigma_s')/(3 sigma_t'^2)     sigma_tr = sqrt(sigma_a/D)       zr = 1/sigma_t'    zv = zr + 4 A D
 *     c1 = 2 Int F mu dmu     c2 = 3 Int F mu^2 dmu     A = (1 + c2)/(1 - c1)     C_phi = (1 - c1)/4     C_E = (1 - c2)/2
 *     R = alpha'^2/(4 pi) (C_phi/D (exp(-s dr)/dr - exp(-s dv)/dv) + C_E (pole of zr + pole of zv)),  s = sigma_tr
 *
 * F is met from inside. A rough boundary changes c1 to what it reflects, and c2 in proportion. Without absorption the total is 1 for any c1
 * and c2. Light scattered once is not in it: alpha' stands squared. */
#include "math/quadrature.h"
#include "math/vec.h"
#include "optics/profile/shape.h"

#include <math.h>

struct moment {
    double eta, critical;
};

/* mu = critical + (1 - critical) t^2: F has a root's slope at the critical angle. */
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

static enum pell_result make(const struct pell_medium *medium, int channel, const struct pell_profile_params *params,
                             struct pell_profile *out)
{
    const double sigma_a = medium->sigma_a[channel], sigma_s = medium->sigma_s_reduced[channel], sigma_t = sigma_a + sigma_s;
    const double albedo = sigma_s / sigma_t, D = (1.0 + sigma_a / sigma_t) / (3.0 * sigma_t);
    struct pell_profile_boundary boundary;
    const enum pell_result res = pell_profile_boundary_make(medium->eta, params, &boundary);

    if (res != PELL_OK || params->without_single)
        return PELL_ERR_UNSUPPORTED;
    const double A = (1.0 + boundary.c2) / (1.0 - boundary.c1), scale = albedo * albedo / (4.0 * PELL_PI);
    pell_profile_pair_make(out, sqrt(sigma_a / D), 1.0 / sigma_t, 1.0 / sigma_t + 4.0 * A * D, scale * 0.5 * (1.0 - boundary.c2),
                           scale * 0.25 * (1.0 - boundary.c1) / D);
    return PELL_OK;
}

const struct pell_profile_source pell_profile_source_better_dipole = {
    .row = {
        .name = "better-dipole",
        .title = "Better dipole",
        .cite = "E. d'Eon, \"A Better Dipole\", 2012",
        .limits = "Multiple scattering only; too little of it near the point of entry.",
    },
    .make = make,
};
