/* SPDX-License-Identifier: MIT
 * media.h - stages that depend on the media of a scene's materials. */
#ifndef PELL_RENDER_MEDIA_H
#define PELL_RENDER_MEDIA_H

#include "render/curvature/stage.h"
#include "render/engine.h"
#include "render/indirect/stage.h"

/* Curvature of materials whose colour is set by coefficients alone; sums of Gaussians and profiles from files have none. */
PELL_NODISCARD enum pell_result pell_media_curvature(struct pell_context *ctx, struct pell_pool *pool, const struct pell_scene *scene,
                                                     const struct pell_rays *rays, const struct pell_scene_materials *materials,
                                                     struct pell_curvature **out);

/* Light transport through the solids of a frame: all solids for a method that integrates over the whole solid, else those whose
 * materials it gave a thickness table. *out is NULL where there are none, else *cached. The samples in *cached stay valid while the
 * surfaces do; *cached is created if NULL, and destroyed by the caller. */
PELL_NODISCARD enum pell_result pell_media_solids(struct pell_context *ctx, struct pell_pool *pool, const struct pell_engine_frame *frame,
                                                  const struct pell_indirect_params *params, const struct pell_indirect_lights *lights,
                                                  struct pell_indirect **cached, struct pell_indirect **out);

#endif
