/* SPDX-License-Identifier: MIT
 *
 * passing.h - how much light gets through a thick part by the angle at which it enters, or leaves: what has come from the depth leaves more
 * at right angles than at a grazing angle, unlike what is returned. By transport in a slab (slab.c).
 */
#ifndef PELL_PASSING_H
#define PELL_PASSING_H

#include <pellucid/profile.h>

#define PELL_PASSING_THICK 10.0 /* optical thickness */

/* Of light through a slab of that thickness: in proportion to 1 + slope (1 - m), m the cosine behind the boundary, by least squares over
 * the directions that refraction allows; `mean` over light that is diffuse. 0 and 1 where nothing is scattered. */
struct pell_half_space_angle pell_passing_angle(const struct pell_medium *medium, int channel);

#endif
