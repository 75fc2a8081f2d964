/* SPDX-License-Identifier: MIT
 * kernel.c - see kernel.h; compiled once per SIMD level. */
#include "render/highlights/kernel.h"

#include "shared/highlights.h"

static void add(struct pell_highlights_block *restrict b, ptrdiff_t offset, float weight, float next, int first, int end)
{
    const uint16_t *restrict material = b->material, *restrict other = material + offset;
    const float *restrict depth = b->depth, *restrict beyond = depth + offset;
    const float *restrict nx = b->normal[0], *restrict ny = b->normal[1], *restrict nz = b->normal[2];
    const float nearer = next / weight;
    const float depth_mm = b->depth_mm * b->slope, fixed_mm = b->fixed_mm * b->slope;
    float w[PELL_HIGHLIGHTS_BLOCK];

    for (int i = first; i < end; i++) {
        const float turn = nx[i] * nx[i + offset] + ny[i] * ny[i + offset] + nz[i] * nz[i + offset];
        const float alike = pell_highlights_alike(turn, fabsf(beyond[i] - depth[i]), depth[i] * depth_mm + fixed_mm);
        const float near = material[i] == other[i] && b->hidden[0][i + offset] >= 0.0f ? weight : 0.0f;
        w[i] = near > 0.0f && alike > 0.0f ? near * alike : 0.0f; /* pixels that show nothing may hold anything, NaN, too */
    }
    for (int c = 0; c < PELL_HIGHLIGHTS_SUMS; c++) {
        const float *restrict light = b->light[c] + offset, *restrict hidden = b->hidden[c] + offset;
        for (int i = first; i < end; i++) {
            b->seen[c][i] += w[i] > 0.0f ? w[i] * light[i] : 0.0f;
            b->all[c][i] += w[i] > 0.0f ? w[i] * (light[i] + hidden[i]) : 0.0f;
        }
        if (!(next > 0.0f))
            continue;
        for (int i = first; i < end; i++) {
            b->next[c][i] += w[i] > 0.0f ? nearer * w[i] * light[i] : 0.0f;
            b->next_all[c][i] += w[i] > 0.0f ? nearer * w[i] * (light[i] + hidden[i]) : 0.0f;
        }
    }
}

static void end(const struct pell_highlights_block *restrict b, float *const out[PELL_HIGHLIGHTS_SUMS], int count)
{
    for (int c = 0; c < PELL_HIGHLIGHTS_SUMS; c++) {
        float *restrict to = out[c];
        for (int i = 0; i < count; i++) {
            const float light = b->light[c][i], seen = b->seen[c][i], all = b->all[c][i], next_all = b->next_all[c][i];
            const float around = seen / (all > 0.0f ? all : 1.0f), next = next_all > 0.0f ? b->next[c][i] / next_all : around;
            const float shared = pell_highlights_shared(light, b->hidden[c][i], pell_highlights_seen(next, around, b->rays), seen, all);
            to[i] = b->hidden[0][i] >= 0.0f ? shared : light;
        }
    }
}

extern const struct pell_highlights_kernels PELL_SIMD(pell_highlights_kernels);
const struct pell_highlights_kernels PELL_SIMD(pell_highlights_kernels) = { add, end };
