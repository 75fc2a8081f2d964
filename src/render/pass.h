/* SPDX-License-Identifier: MIT
 *
 * pass.h - passes of a renderer, which has already checked materials and knobs, and their planes.
 */
#ifndef PELL_PASS_H
#define PELL_PASS_H

#include "render/engine.h"

/* Like pell_pass_create, with `services`, which is copied. The engine must implement the method; knobs and materials must be in range. */
PELL_NODISCARD enum pell_result pell_pass_make(const struct pell_engine_interface *engine, const struct pell_services *services,
                                               const struct pell_method *method, const void *knobs, const struct pell_frame_shape *shape,
                                               struct pell_pass **out);

/* Records a pass into a list: see struct pell_method_engine. */
void pell_pass_record_in(struct pell_pass *pass, struct pell_gpu_commands *commands, float depth, float strength);
/* Device buffers that a renderer's pass reads and writes its result to; false: it has none. */
bool pell_pass_planes(const struct pell_pass *pass, struct pell_gpu_buffer *planes[PELL_GPU_PLANES]);

/* Called before each pell_pass_record_in of such a pass: see struct pell_method_engine. `count`: on input the capacity of `times`, on
 * output the number of timings of the host's work. */
PELL_NODISCARD enum pell_result pell_pass_prepare(struct pell_pass *pass, const struct pell_frame *in,
                                                  struct pell_pass_time times[PELL_STAGES_MOST], size_t *count);

/* Returns PELL_ERR_DEVICE, with a message that names the engines of the method, if this engine does not implement it. */
PELL_NODISCARD enum pell_result pell_engine_check(struct pell_context *ctx, const struct pell_engine_interface *engine,
                                                  const struct pell_method *method);

/* Logs that a method does not run on the engine of this name; returns PELL_ERR_DEVICE. */
enum pell_result pell_engine_missing(struct pell_context *ctx, const char *engine, const struct pell_method *method);

/* The unit of a plane's values in a pass that computes `quantity`: p->unit, which for PELL_PLANE_LIGHT names both. */
const char *pell_plane_unit(const struct pell_plane_info *p, enum pell_quantity quantity);

/* Sets the first p->components of `pointers` to a plane of the frame or of its output, by its row in the table of planes. */
void pell_plane_pointers(const struct pell_plane_info *p, const struct pell_frame *in, const struct pell_frame_light *out,
                         const void *pointers[3]);

#endif
