/* SPDX-License-Identifier: MIT
 *
 * plane_buffers.h - sets of float planes in one allocation, rows 64-byte aligned.
 */
#ifndef PELL_PLANES_H
#define PELL_PLANES_H

#include "base/base.h"

/* Floats from row to row: width rounded up to 16. */
static inline ptrdiff_t pell_plane_stride(int width)
{
    return ((ptrdiff_t) width + 15) / 16 * 16;
}

/* Allocates `count` planes of stride x height floats in one zeroed block, which planes[0] owns (pell_free), and sets planes[i]. Each starts
 * three cache lines further on than the size asks for: planes that begin at one place of a page would share the same few cache sets. */
static inline PELL_NODISCARD enum pell_result pell_planes_allocate(struct pell_context *ctx, int width, int height, float **const *planes,
                                                                   size_t count)
{
    const size_t size = (size_t) pell_plane_stride(width) * (size_t) height + 48;
    float *block = pell_calloc(ctx, size * count, sizeof(float));

    for (size_t i = 0; i < count; i++)
        *planes[i] = block ? block + i * size : NULL;
    return block ? PELL_OK : PELL_ERR_NOMEM;
}

#endif
