/* SPDX-License-Identifier: MIT
 * kernel.c - see kernel.h; compiled once per SIMD level. */
#include "render/highlights/kernel.h"

#include "math/lanes.h"
#include "shared/highlights.h"

/* Weights of the tap's pixel for the pixels of the block. */
static void weigh(const struct pell_highlights_block *restrict b, const struct pell_highlights_tap *tap, float *restrict w)
{
    const ptrdiff_t offset = tap->offset;
    const uint16_t *restrict material = b->material, *restrict other = material + offset;
    const float *restrict depth = b->depth, *restrict beyond = depth + offset, *restrict hidden = b->hidden[0] + offset;
    const float *restrict nx = b->normal[0], *restrict ny = b->normal[1], *restrict nz = b->normal[2];
    const float depth_mm = b->depth_mm * b->slope, fixed_mm = b->fixed_mm * b->slope, weight = tap->weight;

    memset(w, 0, PELL_HIGHLIGHTS_BLOCK * sizeof(*w));
    for (int i = tap->first; i < tap->end; i++) {
        const float turn = nx[i] * nx[i + offset] + ny[i] * ny[i + offset] + nz[i] * nz[i + offset];
        const float alike = pell_highlights_weight(turn, fabsf(beyond[i] - depth[i]), depth[i] * depth_mm + fixed_mm);
        const float near = material[i] == other[i] && hidden[i] >= 0.0f ? weight : 0.0f;
        w[i] = near > 0.0f && alike > 0.0f ? near * alike : 0.0f; /* uncovered pixels may hold any value, including NaN */
    }
}

/* Adds a row's taps to one of the sums at WIDTH pixels from `i` on, in registers. */
INLINE void add_taps(struct pell_highlights_block *restrict b, const struct pell_highlights_tap *taps, int count,
                     float (*restrict w)[PELL_HIGHLIGHTS_BLOCK], int c, int i)
{
    vf seen = load(b->seen[c] + i), both = load(b->all[c] + i), next = load(b->next[c] + i), next_all = load(b->next_all[c] + i);

    for (int k = 0; k < count; k++) {
        const vf weight = load(w[k] + i), light = load(b->light[c] + taps[k].offset + i), hidden = load(b->hidden[c] + taps[k].offset + i);
        const vi on = weight > splat(0.0f);
        seen += select(on, weight * light, splat(0.0f));
        both += select(on, weight * (light + hidden), splat(0.0f));
        if (!(taps[k].next > 0.0f))
            continue;
        const vf next_weight = splat(taps[k].next / taps[k].weight) * weight;
        next += select(on, next_weight * light, splat(0.0f));
        next_all += select(on, next_weight * (light + hidden), splat(0.0f));
    }
    store(b->seen[c] + i, seen);
    store(b->all[c] + i, both);
    store(b->next[c] + i, next);
    store(b->next_all[c] + i, next_all);
}

/* The same at one pixel, where some taps may be outside the image. */
static void add_here(struct pell_highlights_block *restrict b, const struct pell_highlights_tap *taps, int count,
                     float (*restrict w)[PELL_HIGHLIGHTS_BLOCK], int c, int i)
{
    for (int k = 0; k < count; k++) {
        if (!(w[k][i] > 0.0f))
            continue;
        const float weight = w[k][i], light = b->light[c][taps[k].offset + i], hidden = b->hidden[c][taps[k].offset + i];
        const float next_weight = taps[k].next / taps[k].weight * weight;
        b->seen[c][i] += weight * light;
        b->all[c][i] += weight * (light + hidden);
        b->next[c][i] += taps[k].next > 0.0f ? next_weight * light : 0.0f;
        b->next_all[c][i] += taps[k].next > 0.0f ? next_weight * (light + hidden) : 0.0f;
    }
}

static void add(struct pell_highlights_block *restrict b, const struct pell_highlights_tap *taps, int count)
{
    _Alignas(64) float w[PELL_HIGHLIGHTS_TAPS][PELL_HIGHLIGHTS_BLOCK];
    int first = 0, last = PELL_HIGHLIGHTS_BLOCK;

    for (int k = 0; k < count; k++) {
        weigh(b, &taps[k], w[k]);
        first = taps[k].first > first ? taps[k].first : first;
        last = taps[k].end < last ? taps[k].end : last;
    }
    for (int c = 0; c < PELL_HIGHLIGHTS_SUMS; c++) {
        int i = first;
        for (; i + WIDTH <= last; i += WIDTH)
            add_taps(b, taps, count, w, c, i);
        for (; i < PELL_HIGHLIGHTS_BLOCK; i++)
            add_here(b, taps, count, w, c, i);
        for (i = 0; i < first; i++)
            add_here(b, taps, count, w, c, i);
    }
}

static void end(const struct pell_highlights_block *restrict b, float *const out[PELL_HIGHLIGHTS_SUMS], int count)
{
    for (int c = 0; c < PELL_HIGHLIGHTS_SUMS; c++) {
        float *restrict to = out[c];
        for (int i = 0; i < count; i++) {
            const float light = b->light[c][i], seen = b->seen[c][i], all = b->all[c][i], next_all = b->next_all[c][i];
            const float around = seen / (all > 0.0f ? all : 1.0f), next = next_all > 0.0f ? b->next[c][i] / next_all : around;
            const float shared =
                pell_highlights_filtered(light, b->hidden[c][i], pell_highlights_visibility(next, around, b->rays), seen, all);
            to[i] = b->hidden[0][i] >= 0.0f ? shared : light;
        }
    }
}

extern const struct pell_highlights_kernels PELL_SIMD(pell_highlights_kernels);
const struct pell_highlights_kernels PELL_SIMD(pell_highlights_kernels) = { add, end };
