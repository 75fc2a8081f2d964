/* SPDX-License-Identifier: MIT
 *
 * single.h - what the stage "irradiance" needs of a medium to add light that is scattered once by itself (shared/single.h). The profile
 * then holds what is scattered more often.
 */
#ifndef PELL_SINGLE_H
#define PELL_SINGLE_H

struct pell_single_apart {
    float inverse_eta2; /* 1/eta^2 */
    float albedo[3];    /* of a collision; 0: the material has no part of it */
    float g[3];
};

#endif
