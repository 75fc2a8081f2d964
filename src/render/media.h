/* SPDX-License-Identifier: MIT
 * media.h - stages that need to know what medium each of a scene's materials is. */
#ifndef PELL_RENDER_MEDIA_H
#define PELL_RENDER_MEDIA_H

#include "render/curvature/stage.h"
#include "render/engine.h"
#include "render/indirect/stage.h"

/* Of materials that are scaled by their coefficients alone; sums of Gaussians and profiles from files have none. */
PELL_NODISCARD enum pell_result pell_media_curvature(struct pell_context *ctx, struct pell_pool *pool, const struct pell_scene *scene,
                                                     const struct pell_rays *rays, const struct pell_scene_materials *materials,
                                                     struct pell_curvature **out);

/* Light that goes through the solids of a frame: of all, for a method that asks the whole solid, else of those whose materials it gave a
 * table of thickness. *out is NULL where there is none, else *kept, whose samples stay from call to call while the surfaces stay: made
 * where it is NULL, the caller's to destroy. */
PELL_NODISCARD enum pell_result pell_media_through(struct pell_context *ctx, struct pell_pool *pool, const struct pell_engine_frame *frame,
                                                   const struct pell_indirect_params *params, const struct pell_indirect_lights *lights,
                                                   struct pell_indirect **kept, struct pell_indirect **out);

#endif
