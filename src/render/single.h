/* SPDX-License-Identifier: MIT
 * single.h - parameters of a medium for the stage "irradiance" to add single scattering separately (shared/single.h). The profile then
 * contains multiple scattering only. */
#ifndef PELL_SINGLE_H
#define PELL_SINGLE_H

struct pell_separate_single {
    float inverse_eta2; /* 1/eta^2 */
    float albedo[3];    /* single-scattering albedo; 0: the material has no separate single scattering */
    float g[3];
};

#endif
