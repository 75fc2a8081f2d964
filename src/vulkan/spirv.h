/* SPDX-License-Identifier: MIT
 *
 * spirv.h - whether a compute shader in SPIR-V may stand in for a built-in one: what scripts/make_shader.py finds when the library is
 * built, found in a file that may be damaged.
 *
 * Its header and the frame of its instructions are looked at, and all that it declares to the outside: capabilities, memory model, entry,
 * workgroup, buffers with their access, push constants, memory that invocations share. What it does inside is left to the validator.
 */
#ifndef PELL_SPIRV_H
#define PELL_SPIRV_H

#include "vulkan/gpu.h"

enum { PELL_SPIRV_MOST = 4 << 20 }; /* bytes of a module */

/* PELL_OK, and *why is NULL where it may, else a constant that says what is wrong; PELL_ERR_NOMEM. `words` lie aligned. */
PELL_NODISCARD enum pell_result pell_spirv_check(struct pell_context *ctx, const uint32_t *words, size_t size,
                                                 const struct pell_shader *like, const char **why);

#endif
