/* SPDX-License-Identifier: MIT
 *
 * as_paper.h - renderer settings common to the methods' papers.
 */
#ifndef PELL_METHODS_AS_PAPER_H
#define PELL_METHODS_AS_PAPER_H

#include <pellucid/profile.h>
#include <pellucid/render.h>

/* Direct light only, and the flat-surface dipole for subsurface scattering. */
static inline void pell_paper_light(struct pell_settings *s)
{
    s->bounces = 0;
    s->angles = s->curvature = s->single_scattering = s->opposed = s->unscattered = false;
    s->profile = 1 + PELL_PROFILE_DIPOLE;
}

/* The outgoing radiance is F_t M / pi, not normalised. */
static inline void pell_paper_exit(struct pell_settings *s)
{
    pell_paper_light(s);
    s->exit = PELL_EXIT_NORMALIZATION_PUBLISHED;
}

#endif
