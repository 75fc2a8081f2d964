/* SPDX-License-Identifier: MIT
 *
 * intermediate.h - intermediate images for who observes a renderer. Asked for only where pell_services_observed says so.
 */
#ifndef PELL_INTERMEDIATE_H
#define PELL_INTERMEDIATE_H

#include "render/services.h"

/* Planes of the frame's size and of a format, image->components of them, image->stride values from row to row (0: as the frame), defined
 * where the frame's material is not 0: 0 is shown elsewhere, and where a value is not finite. Size, stride and planes of `image` are filled
 * in. */
PELL_NODISCARD enum pell_result pell_show_pixels(const struct pell_services *s, const struct pell_frame *in, const void *const planes[],
                                                 enum pell_plane_format format, struct pell_intermediate *image);

/* Any other image; its values are finite. */
static inline enum pell_result pell_show(const struct pell_services *s, const struct pell_intermediate *image)
{
    return s->observer->show(s->observer->user, image);
}

#endif
