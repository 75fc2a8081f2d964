/* SPDX-License-Identifier: MIT
 *
 * thickness.h - light that is transmitted through thin parts, by thickness: tables that methods hand to the stage "irradiance", and the
 * slab that they and texture-space share.
 */
#ifndef PELL_METHODS_THICKNESS_H
#define PELL_METHODS_THICKNESS_H

#include <pellucid/frame.h>
#include <pellucid/layers.h>

/* Whether a slab of the material can be computed: a profile of given Gaussians says nothing of one. */
bool pell_has_slab(const struct pell_frame_material *m);
/* Total of a slab's T(r; d) of a channel, [0, 1], d > 0 mm. Of a material that has one. */
double pell_slab_transmittance(const struct pell_frame_material *m, int channel, double d);

/* A share of the light that enters at a point that leaves at a distance d >= 0 mm through the medium, per unit of irradiance and
 * integrated over the plane there. Falls with d. */
typedef double pell_thickness_fn(const void *of, int channel, double d);

/* Fills `t`: `through` between faces that do not oppose and, with `with_slab`, the slab's total between those that do, over that of the
 * profile where the material is `white`. `scale` stretches all distances, >= 0; 0: nothing is transmitted. */
void pell_thickness_table_make(const struct pell_frame_material *m, pell_thickness_fn *through, const void *of, bool with_slab,
                               double scale, struct pell_thickness_table *t);

#endif
