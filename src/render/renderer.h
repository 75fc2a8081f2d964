/* SPDX-License-Identifier: MIT
 *
 * renderer.h - what a method may ask of the renderer that runs it.
 */
#ifndef PELL_RENDERER_H
#define PELL_RENDERER_H

#include "base/pool.h"
#include "transport/solids.h"
#include "render/irradiance/stage.h"

#include <pellucid/method.h>
#include <pellucid/render.h>

struct pell_context *pell_renderer_context(struct pell_renderer *r);
struct pell_pool *pell_renderer_pool(struct pell_renderer *r);
const struct pell_scene *pell_renderer_scene(const struct pell_renderer *r); /* NULL: none */
bool pell_renderer_scatters(const struct pell_renderer *r);                 /* a method is set */

/* --- For methods whose plan has PELL_NEED_SCENE: from `create` of their engine on, while the pass lives ----------------------------- */

const struct pell_rays *pell_renderer_rays(const struct pell_renderer *r);
/* The scene's bodies over the frame's materials. pell_bodies_destroy when done. */
PELL_NODISCARD enum pell_result pell_renderer_bodies(const struct pell_renderer *r, struct pell_bodies **out);
/* Numbers of the multisample in a frame: as many sets of light samples. */
int pell_renderer_samples(const struct pell_renderer *r);
/* Which of them is being made. */
int pell_renderer_sample(const struct pell_renderer *r);
/* Whether it is the frame's first that the method is run for: those with nothing translucent in view are passed over. */
bool pell_renderer_begins(const struct pell_renderer *r);
/* The eye of that sample. It is not always in the camera's place: with depth of field it is in a point of the lens. */
const struct pell_view *pell_renderer_eye(const struct pell_renderer *r);
/* Another number, never 0, for other lights, or others of their samples. */
uint64_t pell_renderer_lights(const struct pell_renderer *r);
/* Of the frame that is being made. */
const struct pell_settings *pell_renderer_settings(const struct pell_renderer *r);
/* NULL: none. */
const struct pell_checkpoint *pell_renderer_checkpoint(const struct pell_renderer *r);
uint32_t pell_renderer_seed(const struct pell_renderer *r);
/* Whether this shape is of the frame that the renderer is about to make, so that all of these hold. */
bool pell_renderer_lends_scene(const struct pell_renderer *r, const struct pell_frame *shape);
/* The running method's pass; NULL before the first frame. */
const struct pell_pass *pell_renderer_pass(const struct pell_renderer *r);
/* What light number `light` of the scene sees (visibility/light_grid.h), during the frame; NULL: it has none, ask the rays. */
const struct pell_fan *pell_renderer_fan(const struct pell_renderer *r, size_t light);
/* Light that enters at 16 points of the scene: see pell_irradiance_points, `first` and `samples` its numbers of the multisample. `mix` as
 * in struct pell_plan. Safe from many threads. */
void pell_renderer_light(const struct pell_renderer *r, const struct pell_points *points, float mix, float spacing, uint32_t first,
                         int samples, struct pell_points_light *out);
/* The same of some lights alone: bit min(i, 63) of each light i of the scene, at least one. Their sums are all light. `ambient`: visibility
 * of the environment's smooth rest at the 16 points, where the caller knows it better; NULL: found by rays. */
void pell_renderer_light_of(const struct pell_renderer *r, uint64_t lights, const float *ambient, const struct pell_points *points,
                            float mix, float spacing, uint32_t first, int samples, struct pell_points_light *out);

/* Traces the last frame's rays from the eye once more and does nothing with them (see pell_surface_trace_bare); 0 before the first
 * frame. */
double pell_renderer_trace_bare(struct pell_renderer *r);
/* See pell_rays_record: of the renderer's scene. */
void pell_renderer_record_rays(struct pell_renderer *r, struct pell_ray_record *record);

#endif
