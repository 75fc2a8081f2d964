/* SPDX-License-Identifier: MIT
 * white.h - profiles with a total of 1, for materials whose colour is applied to the light that enters. */
#ifndef PELL_PROFILE_WHITE_H
#define PELL_PROFILE_WHITE_H

#include <pellucid/profile.h>

/* Factor of R: 1, or, if `white`, the inverse of its total. 0 for a white profile without light. */
static inline double pell_profile_scale(const struct pell_profile *p, bool white)
{
    const double total = pell_profile_total(p);

    return !white ? 1.0 : total > 0.0 ? 1.0 / total : 0.0;
}

#endif
