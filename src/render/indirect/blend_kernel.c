/* SPDX-License-Identifier: MIT
 * blend_kernel.c - see blend_kernel.h. */
#include "render/indirect/blend_kernel.h"

#include "render/rows16.h"

#ifndef PELL_SIMD_NAME
#define PELL_SIMD_NAME base
#endif

static void blend(const struct indirect_rows *rows, int size, float (*out)[16])
{
    if (size < 16)
        rows_blend(rows->row, rows->weight, size, out);
    else
        rows_blend_wide(rows->row, rows->weight, size, out);
}

extern const struct indirect_blend_kernels PELL_SIMD(indirect_blend_kernels);
const struct indirect_blend_kernels PELL_SIMD(indirect_blend_kernels) = { blend };
