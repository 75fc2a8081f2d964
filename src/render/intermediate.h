/* SPDX-License-Identifier: MIT
 *
 * intermediate.h - intermediate images for the observer of a renderer. Only to be called if pell_services_observed returns true.
 */
#ifndef PELL_INTERMEDIATE_H
#define PELL_INTERMEDIATE_H

#include "render/services.h"

/* Shows image->components planes of the frame's size, image->stride values from row to row (0: as the frame). They are defined where the
 * frame's material is not 0: 0 is shown elsewhere, and where a value is not finite. Fills in size, stride and planes of `image`. */
PELL_NODISCARD enum pell_result pell_show_pixels(const struct pell_services *s, const struct pell_frame *in, const void *const planes[],
                                                 enum pell_plane_format format, struct pell_intermediate *image);

/* Shows any other image; its values are finite. */
static inline enum pell_result pell_show(const struct pell_services *s, const struct pell_intermediate *image)
{
    return s->observer->show(s->observer->user, image);
}

#endif
