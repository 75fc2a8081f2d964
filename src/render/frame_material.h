/* SPDX-License-Identifier: MIT
 *
 * frame_material.h - what a renderer's materials and a caller's have in common: they are checked and get their profiles here.
 */
#ifndef PELL_FRAME_MATERIAL_H
#define PELL_FRAME_MATERIAL_H

#include "base/base.h"

#include <pellucid/frame.h>

/* PELL_ERR_INVALID, with a message under `name`, for Gaussians or (where they are what scatters) a medium out of range. */
PELL_NODISCARD enum pell_result pell_frame_material_check(struct pell_context *ctx, const char *name, const struct pell_frame_material *m);

/* Makes the profile of its Gaussians, or else of its medium by `model`, into `out`, of three channels. `m->profile` is not looked at. */
PELL_NODISCARD enum pell_result pell_frame_material_profile(struct pell_context *ctx, const char *name, const struct pell_frame_material *m,
                                                            enum pell_profile_model model, struct pell_profile *out);

#endif
