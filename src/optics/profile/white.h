/* SPDX-License-Identifier: MIT
 * white.h - profiles that return all light, of materials whose colour is part of the light that enters. */
#ifndef PELL_PROFILE_WHITE_H
#define PELL_PROFILE_WHITE_H

#include <pellucid/profile.h>

/* What R is multiplied by: 1, or, if `white`, what makes its total 1. 0 for a white profile without light. */
static inline double pell_profile_scale(const struct pell_profile *p, bool white)
{
    const double total = pell_profile_total(p);

    return !white ? 1.0 : total > 0.0 ? 1.0 / total : 0.0;
}

#endif
