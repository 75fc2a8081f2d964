/* SPDX-License-Identifier: MIT
 *
 * equivalent_medium.h - the homogeneous medium that stands in for a profile without coefficients: a sum of Gaussians, a table.
 */
#ifndef PELL_EQUIVALENT_MEDIUM_H
#define PELL_EQUIVALENT_MEDIUM_H

#include <pellucid/scene.h>

/* Whether the material has a profile and nothing that it is made of: neither coefficients nor layers (medium_layers.h). */
bool pell_has_profile_only(const struct pell_material *m);

/* Of a material with a profile only: per channel the isotropic medium, with the material's index of refraction, whose half-space returns
 * the same light at right angles (the profile's total; where colour comes from textures, the base colour times the mean of its texture) and
 * spreads it by the same mean distance, by the table of photons (pell_medium_from_color_and_radius, PELL_SCATTER_RADIUS_MEAN). Colours
 * count as at most 0.999. PELL_ERR_INVALID with *fault where no medium does; *out is then zero. */
PELL_NODISCARD enum pell_result pell_equivalent_medium(const struct pell_material *m, struct pell_medium *out,
                                                       struct pell_medium_fault *fault);

#endif
