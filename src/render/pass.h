/* SPDX-License-Identifier: MIT
 *
 * pass.h - the pass of a renderer, whose materials and knobs were checked before, and the planes that it is handed.
 */
#ifndef PELL_PASS_H
#define PELL_PASS_H

#include "render/engine.h"

/* As pell_pass_create, with `services`, which is copied. The engine implements the method; knobs and materials are in range. */
PELL_NODISCARD enum pell_result pell_pass_make(const struct pell_engine_interface *engine, const struct pell_services *services,
                                               const struct pell_method *method, const void *knobs, const struct pell_frame_shape *shape,
                                               struct pell_pass **out);

/* Records a pass into a list: see struct pell_method_engine. */
void pell_pass_record_in(struct pell_pass *pass, struct pell_gpu_commands *commands, float depth, float strength);
/* The buffers that it reads and leaves its result in there, of a renderer's pass; false: there are none. */
bool pell_pass_planes(const struct pell_pass *pass, struct pell_gpu_buffer *planes[PELL_GPU_PLANES]);

/* Before each pell_pass_record_in of such a pass: see struct pell_method_engine. `count`: of the times of what the host did, at most as
 * many as there is room for in `times`. */
PELL_NODISCARD enum pell_result pell_pass_prepare(struct pell_pass *pass, const struct pell_frame *in,
                                                  struct pell_pass_time times[PELL_STAGES_MOST], size_t *count);

/* PELL_ERR_DEVICE, with a message that says which engines have the method, where this one has not. */
PELL_NODISCARD enum pell_result pell_engine_check(struct pell_context *ctx, const struct pell_engine_interface *engine,
                                                  const struct pell_method *method);

/* The pointers of one row of the table of planes in a frame and its output: the first p->components of `pointers`. */
void pell_plane_pointers(const struct pell_plane_info *p, const struct pell_frame *in, const struct pell_frame_light *out,
                         const void *pointers[3]);

#endif
