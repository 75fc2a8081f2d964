/* SPDX-License-Identifier: MIT
 *
 * thickness.h - light that is transmitted through thin parts, by thickness: tables that methods hand to the stage "irradiance", and the
 * slab that they and texture-space share.
 */
#ifndef PELL_METHODS_THICKNESS_H
#define PELL_METHODS_THICKNESS_H

#include <pellucid/frame.h>
#include <pellucid/profile.h>

/* The slabs of a material's channels; false where it has none, as a profile of given Gaussians does not determine one. */
bool pell_slabs_make(const struct pell_frame_material *m, struct pell_slab slab[3]);

/* The medium of a slab of d mm, or the mean of its layers: for how light spreads in it. */
void pell_slab_medium(const struct pell_frame_material *m, double d, struct pell_medium *out);

/* The first material of the frame in which light does the same as in material i: what was made for it serves both. Objects of one material
 * are materials of their own in a frame. */
size_t pell_first_alike(const struct pell_frame_shape *shape, size_t i);

/* A share of the light that enters at a point that leaves at a distance d >= 0 mm through the medium, per unit of irradiance and
 * integrated over the plane there. */
typedef double pell_thickness_fn(const void *of, int channel, double d);

/* What the profile of a channel has beyond the radius d: Int R(sqrt(r^2 + d^2)) over the plane at the depth d. */
double pell_thickness_beyond(const void *material, int channel, double d);

/* Fills `t`: `through` between faces that do not oppose and, with `with_slab`, the slab's total between those that do, over that of the
 * profile where the material is `white`, and how far it spreads. `scale` stretches all distances, >= 0; 0: nothing is transmitted. */
void pell_thickness_table_make(const struct pell_frame_material *m, pell_thickness_fn *through, const void *of, bool with_slab,
                               double scale, struct pell_thickness_table *t);

#endif
