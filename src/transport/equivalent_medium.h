/* SPDX-License-Identifier: MIT
 *
 * equivalent_medium.h - the equivalent homogeneous medium of a profile without coefficients: a sum of Gaussians, a table.
 */
#ifndef PELL_EQUIVALENT_MEDIUM_H
#define PELL_EQUIVALENT_MEDIUM_H

#include <pellucid/scene.h>

/* Whether the material has a profile but neither coefficients nor layers (medium_layers.h). */
bool pell_has_profile_only(const struct pell_material *m);

/* For a material with only a profile: per channel the isotropic medium, with the material's index of refraction, whose half-space reflects
 * the same light at normal incidence (the profile's total; with a colour texture, the base colour times the mean of its texture) with the
 * same mean distance, from tabulated photon simulations (pell_medium_from_color_and_radius, PELL_SCATTER_RADIUS_MEAN). Albedos are clamped
 * to 0.999. PELL_ERR_INVALID with *fault if there is no such medium; *out is then zero. */
PELL_NODISCARD enum pell_result pell_equivalent_medium(const struct pell_material *m, struct pell_medium *out,
                                                       struct pell_medium_fault *fault);

#endif
