/* SPDX-License-Identifier: MIT
 * read_gpu.h - pixels of an image on a Vulkan device that read the maps of solids there: planes, maps, passes. Private to the method. */
#ifndef METHODS_TEXTURE_SPACE_READ_GPU_H
#define METHODS_TEXTURE_SPACE_READ_GPU_H

#include "methods/texture_space/state.h"

#include "vulkan/gpu.h"

/* Creates st->pixels unless it exists; destroys it. */
PELL_NODISCARD enum pell_result ts_pixels_open(struct ts_state *st, const struct pell_frame_shape *shape);
void ts_pixels_close(struct ts_state *st);
/* Of struct pell_method_engine. */
bool ts_pixels_planes(const void *state, struct pell_gpu_buffer *planes[PELL_GPU_PLANES]);
PELL_NODISCARD enum pell_result ts_pixels_prepare(void *state, const struct pell_frame *in);
void ts_pixels_read(void *state, struct pell_gpu_commands *commands, float depth, float strength);

#endif
