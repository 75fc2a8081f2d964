/* SPDX-License-Identifier: MIT
 *
 * load.c - copies the caller's planes of the screen-space method row by row and summarises each block; compiled once per level of
 * base/simd.h.
 */
#include "methods/screen_space/blocks.h"

#include "render/material_id.h"

/* Determines the materials of a block; lanes x0 to x1 are in the rectangle. */
INLINE void find_materials(const struct screen_work *w, ptrdiff_t from, int x0, int x1, float *restrict materials, struct screen_cell *cell,
                           int *low, int *high)
{
    const uint16_t *material = w->in->material + from;
    int first = 0, last = 0, count = 0;
    uint64_t words[SCREEN_BLOCK / 4];

    memset(words, 0, sizeof(words));
    if (x1 - x0 == SCREEN_BLOCK)
        memcpy(words, material, sizeof(words));
    if (words[0] && words[0] == words[1] && words[0] == words[2] && words[0] == words[3] && words[0] == material[0] * 0x0001000100010001u &&
        pell_material_id(w->in, from)) {
        first = last = material[0];
        count = SCREEN_BLOCK;
        for (int l = 0; l < SCREEN_BLOCK; l++)
            materials[l] = (float) first;
    } else {
        for (int l = x0; l < x1; l++) {
            const int m = pell_material_id(w->in, from + l);
            first = m > 0 && (first == 0 || m < first) ? m : first;
            last = m > last ? m : last;
            materials[l] = (float) m;
            count += m > 0;
        }
    }
    *low = first;
    *high = last;
    *cell = (struct screen_cell) { .contents = count == 0              ? SCREEN_EMPTY
                                               : count == SCREEN_BLOCK ? SCREEN_FULL
                                                                       : SCREEN_SOME,
                                   .material = first == last ? (uint16_t) first : SCREEN_MIXED,
                                   .pixels = (uint8_t) count };
}

/* Copies a block of the caller's planes. */
INLINE void load_block(const struct screen_work *w, int x, int y, int x0, int x1, struct screen_cell *cell, struct screen_seen *seen)
{
    const struct pell_frame *in = w->in;
    const size_t to = (size_t) (y * w->stride + x);
    const ptrdiff_t from = y * in->shape.stride + x;
    const vf zero = { 0 }, one = zero + 1.0f;
    _Alignas(64) float material[SCREEN_BLOCK] = { 0 }, z[SCREEN_BLOCK] = { 0 }, strengths[SCREEN_BLOCK], most[SCREEN_BLOCK],
                       least[SCREEN_BLOCK];
    int first, last, count = 0;

    find_materials(w, from, x0, x1, material, cell, &first, &last);
    memcpy(&w->key[to], material, sizeof(material));
    if (cell->contents == SCREEN_EMPTY) {
        memcpy(&w->depth[to], z, sizeof(z));
        return;
    }
    for (int l = 0; l < SCREEN_BLOCK; l++)
        strengths[l] = 1.0f;
    if (cell->contents == SCREEN_FULL) {
        memcpy(z, in->depth + from, sizeof(z));
        if (in->strength)
            memcpy(strengths, in->strength + from, sizeof(strengths));
    } else {
        for (int l = x0; l < x1; l++) {
            z[l] = material[l] > 0.0f ? in->depth[from + l] : 0.0f;
            strengths[l] = material[l] > 0.0f && in->strength ? in->strength[from + l] : 1.0f;
        }
    }
    for (int lane = 0; lane < SCREEN_BLOCK; lane += WIDTH) {
        const vf depth = load(z + lane), strength = load(strengths + lane);
        const vi good = (depth > zero) & (depth < 1e12f);
        const vf d = select(good, depth, zero), mm = d * w->depth_mm + w->fixed_mm, s = vmin(strength, one);
        const vf size = vmin(s * s * w->ratio2 / select(good, mm * mm, one), zero + 1e30f);
        const vf scale = select(good & (strength > zero), size, zero);
        store(&w->depth[to + (size_t) lane], d);
        store(&w->scale[to + (size_t) lane], scale);
        count += __builtin_popcount(movemask(scale > zero));
        store(most + lane, scale);
        store(least + lane, select(scale > zero, zero - scale, zero - 1e30f));
    }
    cell->pixels = (uint8_t) count;
    cell->scale[0] = -max_of(least);
    cell->scale[1] = max_of(most);
    for (int i = 0; i < 3; i++) {
        float *light = &w->now[i][to];
        if (cell->contents == SCREEN_FULL && cell->material != SCREEN_MIXED) {
            for (int lane = 0; lane < SCREEN_BLOCK; lane += WIDTH)
                store(light + lane, load(w->light[i] + from + lane) * w->total[first][i]);
        } else {
            memset(light, 0, SCREEN_BLOCK * sizeof(float));
            for (int l = x0; l < x1; l++)
                if (material[l] > 0.0f)
                    light[l] = w->light[i][from + l] * w->total[(int) material[l]][i];
        }
    }
    seen->first = seen->first == 0 || first < seen->first ? first : seen->first;
    seen->last = last > seen->last ? last : seen->last;
    seen->pixels += count;
    seen->scale = cell->scale[1] > seen->scale ? cell->scale[1] : seen->scale;
}

/* Rows are too short and planes too many for hardware prefetchers: each block prefetches what the one below it will read and write. */
PELL_FETCHING_INLINE void fetch_load(const struct screen_work *w, int x, int y)
{
    const struct pell_frame *in = w->in;
    const size_t to = (size_t) (y * w->stride + x);
    const ptrdiff_t from = y * in->shape.stride + x;

    __builtin_prefetch(in->material + from);
    __builtin_prefetch(in->depth + from);
    if (in->strength)
        __builtin_prefetch(in->strength + from);
    for (int i = 0; i < 3; i++)
        __builtin_prefetch(w->light[i] + from);
    pell_fetch_to_write(w->key + to);
    pell_fetch_to_write(w->depth + to);
    pell_fetch_to_write(w->scale + to);
    fetch3_to_write(w->now, to);
}

PELL_FETCHING void PELL_SIMD(screen_load_row)(const struct screen_work *w, int y, struct screen_seen *seen)
{
    const struct pell_rect *rect = &w->in->rect;

    struct screen_extent *extent = &w->extents[y];

    *seen = (struct screen_seen) { 0 };
    *extent = (struct screen_extent) { w->block1, w->block0 };
    for (int b = w->block0; b < w->block1; b++) {
        const int x = b * SCREEN_BLOCK, x0 = rect->x0 > x ? rect->x0 - x : 0,
                  x1 = rect->x1 - x < SCREEN_BLOCK ? rect->x1 - x : SCREEN_BLOCK;
        if (y + 1 < rect->y1)
            fetch_load(w, x, y + 1);
        load_block(w, x, y, x0, x1, cell_at(w, b, y), seen);
        if (cell_at(w, b, y)->contents != SCREEN_EMPTY) {
            extent->begin = fewer(extent->begin, b);
            extent->end = b + 1;
        }
    }
}
