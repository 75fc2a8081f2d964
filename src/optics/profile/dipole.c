/* SPDX-License-Identifier: MIT
 *
 * dipole.c - the classical dipole as a profile. */
#include "optics/medium/dipole.h"
#include "math/vec.h"
#include "optics/profile/shape.h"

static enum pell_result make(const struct pell_medium *medium, int channel, const struct pell_profile_params *params,
                             struct pell_profile *out)
{
    struct pell_dipole d = pell_dipole_make(medium->sigma_a[channel], medium->sigma_s_reduced[channel], medium->eta, params->fresnel);

    if (params->without_single || (params->roughness > 0.0 && params->fresnel != PELL_FRESNEL_EXACT))
        return PELL_ERR_UNSUPPORTED;
    if (params->A > 0.0 || params->roughness > 0.0)
        d.A = params->A > 0.0 ? params->A : pell_boundary_A(medium->eta, params->fresnel, params->roughness);
    d.zv = d.zr * (1.0 + 4.0 * d.A / 3.0);
    pell_profile_pair_make(out, d.sigma_tr, d.zr, d.zv, d.albedo_reduced / (4.0 * PELL_PI), 0.0);
    return PELL_OK;
}

const struct pell_profile_source pell_profile_source_dipole = {
    .row = {
        .name = "dipole",
        .title = "Dipole",
        .cite = "H. W. Jensen, S. R. Marschner, M. Levoy, P. Hanrahan, \"A Practical Model for Subsurface Light Transport\", SIGGRAPH 2001",
        .limits = "13 to 17 % too bright at low albedos; too little light near the point of entry, too much one mean free path away.",
    },
    .make = make,
};
