/* SPDX-License-Identifier: MIT
 *
 * measure.c - surface metric at each pixel of the screen-space method: mm between adjacent pixels, skew of the second pass, depth
 * discontinuities; compiled once per level of base/simd.h.
 */
#include "methods/screen_space/blocks.h"

/* Change of depth per pixel from its one-sided differences: the central difference, limited to twice the smaller of the two (the
 * monotonised central limiter of van Leer 1977), so that an adjacent depth discontinuity does not count as slope. */
INLINE vf limited(vf back, vf ahead, vi has_back, vi has_ahead)
{
    const vf zero = { 0 }, a = select(has_back, back, ahead), b = select(has_ahead, ahead, back);
    const vf size_a = select(a < zero, -a, a), size_b = select(b < zero, -b, b), least = 2.0f * select(size_a < size_b, size_a, size_b);
    const vf mean = 0.5f * (a + b), size = select(mean < zero, -mean, mean), low = select(size < least, size, least);
    const vi slopes = (has_back | has_ahead) & (a * b > zero);

    return select(slopes, select(mean < zero, -low, low), zero);
}

/* Keeps the skew of blocks where it hardly changes along the row, and fades it out within SKEW_FADE blocks of where it does: a block has
 * a single skew, since lanes of a vector read the same row, and different skews of adjacent blocks would show as steps in the image.
 * On planes, Gaussians are therefore round at any slant; on curved surfaces the second pass is upright. cell->to_px[0][0] holds the raw
 * skew. */
static void fade_skews(const struct screen_work *w, int y)
{
    enum { AT_ONCE = 48, MORE = AT_ONCE + 2 * SKEW_FADE };
    const int begin = w->extents[y].begin, end = w->extents[y].end;

    for (int first = begin; first < end; first += AT_ONCE) {
        const int blocks = fewer(end - first, AT_ONCE);
        float change[MORE], worst[AT_ONCE] = { 0 }; /* change[i]: from block first - SKEW_FADE + i to the next */

        for (int i = 0; i < MORE; i++) {
            const int at = first - SKEW_FADE + i;
            const bool within_row = at >= begin && at + 1 < end && i < blocks + 2 * SKEW_FADE;
            const struct screen_cell *cell = cell_at(w, within_row ? at : begin, y);
            const float by = within_row ? fabsf(cell[1].to_px[0][0] - cell->to_px[0][0]) * (1.0f / SKEW_CHANGE) : 0.0f;
            change[i] = !within_row || cell->contents == SCREEN_EMPTY || cell[1].contents == SCREEN_EMPTY ? 0.0f : by < 1.0f ? by : 1.0f;
        }
        for (int k = 1 - SKEW_FADE; k < SKEW_FADE; k++) {
            const float near = 1.0f - (float) (k < 0 ? -k - 1 : k) * (1.0f / SKEW_FADE);
            for (int i = 0; i < AT_ONCE; i++)
                worst[i] = change[SKEW_FADE + i + k] * near > worst[i] ? change[SKEW_FADE + i + k] * near : worst[i];
        }
        for (int i = 0; i < blocks; i++) {
            struct screen_cell *cell = cell_at(w, first + i, y);
            if (cell->contents == SCREEN_EMPTY)
                continue;
            cell->skew = cell->to_px[0][0] * (1.0f - worst[i]);
            if (cell->skew < SKEW_MIN && cell->skew > -SKEW_MIN)
                cell->skew = 0.0f;
        }
    }
}

/* Directions of the passes on the surface: Tx, from a pixel to the next along x, and D = Ty - skew Tx perpendicular to it, so that two
 * passes make a round Gaussian on a surface of any slope. First Tx.Tx, Ty.Ty and Tx.Ty of each pixel, in the planes that will hold their
 * lengths, and the mean skew of each block; then the lengths of Tx and D. */
PELL_FETCHING void PELL_SIMD(screen_measure_row)(const struct screen_work *w, int y)
{
    const vf zero = { 0 }, one = zero + 1.0f;
    const float ty = w->rows_tan[y], ty2 = 1.0f + ty * ty;

    for (int block = w->block0; block < w->block1; block++) {
        struct screen_cell *cell = cell_at(w, block, y);
        const size_t index = (size_t) (y * w->stride + block * SCREEN_BLOCK);
        const size_t below = index + (size_t) w->stride, next = below + (size_t) w->stride; /* the plane has a margin */
        _Alignas(64) float skews[SCREEN_BLOCK];
        float mean;
        vi rough = { 0 };

        __builtin_prefetch(w->key + next);
        __builtin_prefetch(w->depth + next);
        __builtin_prefetch(w->scale + below);
        for (int axis = 0; axis < 2; axis++) {
            pell_fetch_to_write(w->length[axis] + below);
            pell_fetch_to_write(w->to_px[axis] + below);
        }
        if (cell->contents == SCREEN_EMPTY) {
            memset(&w->length[0][index], 0, SCREEN_BLOCK * sizeof(float));
            memset(&w->length[1][index], 0, SCREEN_BLOCK * sizeof(float));
            cell->smooth = false;
            continue;
        }
        for (int part = 0; part < SCREEN_BLOCK; part += WIDTH) {
            const size_t at = index + (size_t) part;
            const float *key = w->key + at, *depth = w->depth + at;
            const vf z = load(depth), own = load(key), mm = z * w->depth_mm + w->fixed_mm;
            const vf tx = load(w->columns_tan + block * SCREEN_BLOCK + part), ray2 = tx * tx + ty2;
            const vf left = z - load(depth - 1), right = load(depth + 1) - z;
            const vf above = z - load(depth - w->stride), under = load(depth + w->stride) - z;
            const vf dx = limited(left, right, load(key - 1) == own, load(key + 1) == own);
            const vf dy = limited(above, under, load(key - w->stride) == own, load(key + w->stride) == own);
            const vf jump = mm * JUMP;
            const vf x2 = STEP_LENGTH2(mm, dx, tx, ray2), y2 = STEP_LENGTH2(mm, dy, ty, ray2);
            const vf both = STEP_PRODUCT(mm, dx, dy, tx, ty, ray2);
            const vi on = (own > zero) & (z > zero) & (x2 > zero) & (y2 > zero);
            const vf crease = mm * CREASE;
            rough |= (vabs(left) > jump) | (vabs(right) > jump) | (vabs(above) > jump) | (vabs(under) > jump) |
                     (vabs(right - left) > crease) | (vabs(under - above) > crease);
            store(w->length[0] + at, select(on, x2, zero));
            store(w->length[1] + at, select(on, y2, zero));
            store(w->to_px[0] + at, select(on, both, zero));
            store(skews + part, select(on, both / select(on, x2, one), zero));
        }
        cell->smooth = cell->contents == SCREEN_FULL && cell->material != SCREEN_MIXED && !any(rough);
        mean = cell->pixels > 0 ? sum_of(skews) / (float) cell->pixels : 0.0f;
        cell->to_px[0][0] = mean < SKEW_MAX ? (mean > -SKEW_MAX ? mean : -SKEW_MAX) : SKEW_MAX;
    }
    fade_skews(w, y);
    for (int block = w->extents[y].begin; block < w->extents[y].end; block++) {
        struct screen_cell *cell = cell_at(w, block, y);
        const size_t index = (size_t) (y * w->stride + block * SCREEN_BLOCK);
        _Alignas(64) float most[2][SCREEN_BLOCK], least[2][SCREEN_BLOCK];

        if (cell->contents == SCREEN_EMPTY)
            continue;
        for (int part = 0; part < SCREEN_BLOCK; part += WIDTH) {
            const size_t at = index + (size_t) part;
            const vf x2 = load(w->length[0] + at), xy = load(w->to_px[0] + at);
            const vf d2 = load(w->length[1] + at) + cell->skew * (cell->skew * x2 - 2.0f * xy);
            const vf mm = load(w->depth + at) * w->depth_mm + w->fixed_mm, facing = load(w->scale + at) * (mm * mm);
            for (int axis = 0; axis < 2; axis++) {
                const vf size2 = axis == 0 ? x2 : d2;
                const vi on = size2 > zero;
                const vf to_px = select(on, facing / select(on, size2, one), zero);
                store(w->length[axis] + at, vsqrt(select(on, size2, zero)));
                store(w->to_px[axis] + at, to_px);
                store(most[axis] + part, to_px);
                store(least[axis] + part, select(to_px > zero, zero - to_px, zero - 1e30f));
            }
        }
        for (int axis = 0; axis < 2; axis++) {
            cell->to_px[axis][0] = -max_of(least[axis]);
            cell->to_px[axis][1] = max_of(most[axis]);
        }
    }
}
