/* SPDX-License-Identifier: MIT
 *
 * passing.h - angular dependence of light transmitted by a thick part, for entry or exit: transmitted light exits more along the normal
 * than at grazing angles, unlike reflected light. By radiative transfer in a slab (slab.c).
 */
#ifndef PELL_PASSING_H
#define PELL_PASSING_H

#include <pellucid/profile.h>

#define PELL_PASSING_THICK 10.0 /* optical thickness */

/* Angular dependence for a slab of that thickness: proportional to 1 + slope (1 - m), m the cosine inside the boundary, by least squares
 * over the directions that refraction allows; `mean` over diffuse light. 0 and 1 without scattering. */
struct pell_half_space_angle pell_passing_angle(const struct pell_medium *medium, int channel);

#endif
