/* SPDX-License-Identifier: MIT
 *
 * spirv.h - checks whether a compute shader in SPIR-V may replace a built-in one: the checks of scripts/make_shader.py at build time, for a
 * file that may be damaged.
 *
 * Checks its header, the instruction lengths, and its external interface: capabilities, memory model, entry point, workgroup, buffers with
 * their access, push constants, shared memory. The code itself is left to the validator.
 */
#ifndef PELL_SPIRV_H
#define PELL_SPIRV_H

#include "vulkan/gpu.h"

enum { PELL_SPIRV_MAX = 4 << 20 }; /* bytes of a module */

/* PELL_OK; *why is NULL if it may, else a constant text of the reason; PELL_ERR_NOMEM. `words` must be aligned. */
PELL_NODISCARD enum pell_result pell_spirv_check(struct pell_context *ctx, const uint32_t *words, size_t size,
                                                 const struct pell_shader *builtin, const char **why);

#endif
