/* SPDX-License-Identifier: MIT
 * kernel.c - see kernel.h; compiled once per SIMD level. */
#include "render/spread/kernel.h"

#include "shared/spread.h"

static void add(struct pell_spread_block *restrict b, ptrdiff_t offset, float distance, int first, int end)
{
    const uint16_t *restrict key = b->key, *restrict other = key + offset;
    const float *restrict depth = b->depth, *restrict beyond = depth + offset;
    const float *restrict red = b->from[0] + offset, *restrict green = b->from[1] + offset, *restrict blue = b->from[2] + offset;
    const float inverse = b->inverse;

    for (int i = first; i < end; i++) {
        const float near = pell_spread_weight(distance * b->mm[i], beyond[i] - depth[i], inverse), w = key[i] == other[i] ? near : 0.0f;
        b->light[0][i] += w * red[i];
        b->light[1][i] += w * green[i];
        b->light[2][i] += w * blue[i];
        b->weight[i] += w;
    }
}

extern const struct pell_spread_kernels PELL_SIMD(pell_spread_kernels);
const struct pell_spread_kernels PELL_SIMD(pell_spread_kernels) = { add };
