/* SPDX-License-Identifier: MIT
 *
 * thickness.h - transmission through thin parts by thickness: tables that methods pass to the stage "irradiance", and the slab model that
 * they share with texture-space.
 */
#ifndef PELL_METHODS_THICKNESS_H
#define PELL_METHODS_THICKNESS_H

#include <pellucid/frame.h>
#include <pellucid/profile.h>

/* The slabs of a material's channels; false if it has none, because a profile of given Gaussians does not determine one. */
bool pell_slabs_make(const struct pell_frame_material *m, struct pell_slab slab[3]);

/* The medium of a slab of d mm, or the mean of its layers, for the lateral spread of light. */
void pell_slab_medium(const struct pell_frame_material *m, double d, struct pell_medium *out);

/* The first material of the frame that scatters like material i, so that data made for it serves both. Objects that share a material have
 * separate materials in a frame. */
size_t pell_first_alike(const struct pell_frame_shape *shape, size_t i);

/* Fraction of the light that enters at a point and leaves at a distance of d >= 0 mm through the medium, integrated over the plane
 * there. */
typedef double pell_thickness_fn(const void *of, int channel, double d);

/* Light of a channel's profile beyond the radius d: Int R(sqrt(r^2 + d^2)) over the plane at the depth d. */
double pell_thickness_beyond(const void *material, int channel, double d);

/* Fills `t`: `through` between faces that are not opposed and, with `with_slab`, the slab's total between those that are, relative to the
 * profile's total if the material is `white`, and its lateral spread. `scale` stretches all distances, >= 0; 0: nothing is transmitted. */
void pell_thickness_table_make(const struct pell_frame_material *m, pell_thickness_fn *through, const void *of, bool with_slab,
                               double scale, struct pell_thickness_table *t);

#endif
