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

/* Allocates `count` planes of stride x height floats in one zeroed block, which planes[0] owns (pell_free), and sets planes[i]. Each
 * starts three cache lines further on than its size requires: planes that begin at the same offset in a page would share the same few
 * cache sets. */
static inline PELL_NODISCARD enum pell_result pell_planes_allocate(struct pell_context *ctx, int width, int height, float **const *planes,
                                                                   size_t count)
{
    const size_t size = (size_t) pell_plane_stride(width) * (size_t) height + 48;
    float *block = pell_calloc(ctx, size * count, sizeof(float));

    for (size_t i = 0; i < count; i++)
        *planes[i] = block ? block + i * size : NULL;
    return block ? PELL_OK : PELL_ERR_NOMEM;
}

/* Planes to be allocated in one block: those of a list that are not there yet. */
struct pell_planes_wanted {
    float **planes[96];
    size_t count;
};

/* Does nothing if they exist or are already requested. */
static inline void pell_planes_want(struct pell_planes_wanted *w, float **planes, int count)
{
    for (size_t i = 0; i < w->count; i++)
        if (w->planes[i] == planes)
            return;
    for (int c = 0; c < count && !planes[0]; c++)
        w->planes[w->count + (size_t) c] = &planes[c];
    w->count += planes[0] ? 0 : (size_t) count;
}

#endif
