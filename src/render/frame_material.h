/* SPDX-License-Identifier: MIT
 *
 * frame_material.h - checks and profiles of a frame's materials, whether a renderer's or a caller's.
 */
#ifndef PELL_FRAME_MATERIAL_H
#define PELL_FRAME_MATERIAL_H

#include "base/base.h"

#include <pellucid/frame.h>

/* Returns PELL_ERR_INVALID, with a message about `name`, for Gaussians out of range, or for a medium out of range if it defines the
 * scattering. */
PELL_NODISCARD enum pell_result pell_frame_material_check(struct pell_context *ctx, const char *name, const struct pell_frame_material *m);

/* Makes the profiles of three channels, of its Gaussians, or else of its medium by `model`. Ignores `m->profile`. */
PELL_NODISCARD enum pell_result pell_frame_material_profile(struct pell_context *ctx, const char *name, const struct pell_frame_material *m,
                                                            enum pell_profile_model model, struct pell_profile *out);

#endif
