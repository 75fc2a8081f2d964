/* SPDX-License-Identifier: MIT
 *
 * kernels.c - the two passes of the screen-space method over a row: spacing of taps, evaluation of their sums, the weighted sum of steps;
 * compiled once per level of base/simd.h. The mathematics is in README.md.
 */
#include "methods/screen_space/blocks.h"

/* --- Spacing ------------------------------------------------------------------------------------------------------------------- */

/* grid_variance as a fraction: formulas.h. */
struct ratio {
    vf numerator, denominator, rest;
};

INLINE struct ratio grid_ratio(vf u)
{
    const vf low = vmin(u, (vf) { 0 } + WIDE), u2 = low * low, u3 = u2 * low, u4 = u2 * u2, a = GRID_A(u3), b = GRID_B(u4);
    return (struct ratio) { GRID_NUMERATOR(low, u3, a, b), a * b, u - low };
}

INLINE vf grid_variance(vf u)
{
    const struct ratio r = grid_ratio(u);
    return r.numerator / r.denominator + r.rest;
}

/* grid_variance(u1) - grid_variance(u0), with one division. */
INLINE vf grid_difference(vf u1, vf u0)
{
    const struct ratio r1 = grid_ratio(u1), r0 = grid_ratio(u0);
    return (r1.numerator * r0.denominator - r0.numerator * r1.denominator) / (r1.denominator * r0.denominator) + (r1.rest - r0.rest);
}

/* Whether a line of taps stays in smooth blocks. A skewed line must stay within the columns that it crosses. */
INLINE bool is_clear(const struct screen_work *w, int block, int axis, const struct screen_cell *cell, float skew, float reach)
{
    int margin;

    if (!(reach < (float) cell->clear[axis]))
        return false;
    if (axis == 0 || skew == 0.0f)
        return true;
    margin = (int) (fabsf(skew) * reach * (1.0f / SCREEN_BLOCK)) + 1;
    if (block - margin < w->block0 || block + margin >= w->block1)
        return false;
    for (int k = -margin; k <= margin; k++)
        if (!(reach < (float) cell[k].clear[1]))
            return false;
    return true;
}

/* Number of taps, and their spacing. */
INLINE void space(const struct screen_work *w, size_t index, int block, int axis, const struct screen_cell *cell, struct block *b)
{
    float most = 0.0f, least = 1e30f, reach, step, dense;

    b->wide = b->bare = false;
    if (b->uniform) {
        const float low = b->before * cell->to_px[axis][0], add = (b->after - b->before) * cell->to_px[axis][0];
        most = (b->after - b->before) * cell->to_px[axis][1];
        least = low < add ? low : add;
        b->wide = low > WIDE;
        b->bare = !(b->before > 0.0f);
    } else {
        for (int l = 0; l < SCREEN_BLOCK; l++) {
            const float to_px = w->to_px[axis][index + (size_t) l];
            const float low = b->befores[l] * to_px, add = (b->afters[l] - b->befores[l]) * to_px;
            if (!(b->afters[l] > 0.0f))
                continue;
            most = add > most ? add : most;
            least = low < least ? low : least;
            least = add < least ? add : least;
        }
    }
    most += 0.1f; /* upper bound of the grid's contribution */
    reach = K_REACH * sqrtf(most > S2_MIN ? most : S2_MIN);
    b->skew = fabsf(cell->skew) * reach < 0.5f ? 0.0f : cell->skew; /* with less than half a pixel to the side, taps follow the column */
    /* Taps may be 1.5 standard deviations of the previous blurs apart: aliasing is then below 2e-4 of a step. */
    step = 1.5f * sqrtf(least);
    dense = is_clear(w, block, axis, cell, b->skew, reach) ? reach : reach * (1.0f / TAPS_DENSE);
    step = step < dense ? step : dense;
    b->stride = step >= 2.0f ? (step < 65536.0f ? (int) step : 65536) : 1;
    b->count = reach < 262144.0f ? (int) (reach / (float) b->stride) : 262144;
}

/* Scales of the kernel for each pixel of a block. */
INLINE void scale_kernel(const struct screen_work *w, size_t index, int axis, struct job *job)
{
    const struct block *b = &job->b;
    const vf zero = { 0 }, one = zero + 1.0f;

    for (int part = 0; part < SCREEN_BLOCK; part += WIDTH) {
        const size_t at = index + (size_t) part;
        const vf to_px = load(w->to_px[axis] + at), length = load(w->length[axis] + at);
        const vf a = select(length > zero, length, one);
        const vf u1 = (b->uniform ? zero + b->after : load(b->afters + part)) * to_px;
        const vf u0 = (b->uniform ? zero + b->before : load(b->befores + part)) * to_px;
        const vf add = b->wide ? u1 - u0 : b->bare ? grid_variance(u1) : grid_difference(u1, u0);
        const vf inverse = one / (vsqrt(vmax(add, zero + S2_MIN)) * a), mix = vmax(vmin(add * (1.0f / S2_MIN_VARIANCE), one), zero);

        store(job->kernel_scale + part, inverse * K_SCALE_ROOT);
        store(job->fraction + part, inverse * mix * (K_NORM * (float) b->stride));
    }
}

/* --- Rows ---------------------------------------------------------------------------------------------------------------------- */

/* Result of a block. The weight of taps that contribute nothing (outside, of another material, or too far along the surface) stays with the
 * pixel: it keeps 1 - Sum of weights of its own light. */
INLINE void settle(const struct job *job, const float *const row[3], float (*restrict result)[SCREEN_BLOCK])
{
    const vf one = (vf) { 0 } + 1.0f;

    for (int part = 0; part < SCREEN_BLOCK; part += WIDTH) {
        vf fraction = load(job->fraction + part);
        const vf weight = load(job->weight + part) * fraction;
        vf keep = one - weight;

        if (any(weight > one)) { /* if lengths vary too fast, the weight of the pixel itself is negative */
            fraction = fraction / vmax(weight, one);
            keep = vmax(keep, (vf) { 0 });
        }
        for (int i = 0; i < 3; i++)
            store(&result[i][part], load(&job->light[i][part]) * fraction + keep * load(row[i] + job->x + part));
    }
}

/* Blends the step's result into the sum. Where a pixel skipped the step, its weight goes to the last result or, as in the paper (`on`), to
 * the whole sum. */
INLINE void put(const struct screen_work *w, int x, int y, size_t index, const struct screen_cell *cell,
                float (*restrict light)[SCREEN_BLOCK], const float *on)
{
    const size_t row = (size_t) w->step * (w->num_materials + 1);

    for (int i = 0; i < 3; i++) {
        _Alignas(64) float fractions[SCREEN_BLOCK], some[SCREEN_BLOCK] = { 0 }, mixed[SCREEN_BLOCK];
        float *sum = w->out->light[i] + y * w->in->shape.stride + x;
        const float *before = w->fresh ? w->now[i] + index : cell->contents == SCREEN_FULL ? sum : some;

        for (int l = 0; before == some && l < SCREEN_BLOCK; l++) /* the caller's plane may end inside the block */
            if (w->key[index + (size_t) l] > 0.0f)
                some[l] = sum[l];
        if (cell->material == SCREEN_MIXED)
            for (int l = 0; l < SCREEN_BLOCK; l++)
                fractions[l] = w->blend[row + (size_t) w->key[index + (size_t) l]][i];
        for (int part = 0; part < SCREEN_BLOCK; part += WIDTH) {
            vf fraction = cell->material == SCREEN_MIXED ? load(fractions + part) : (vf) { 0 } + w->blend[row + cell->material][i];
            if (on)
                fraction *= load(on + part);
            store(mixed + part, load(before + part) * (1.0f - fraction) + load(&light[i][part]) * fraction);
        }
        if (cell->contents == SCREEN_FULL)
            memcpy(sum, mixed, sizeof(mixed));
        else
            for (int l = 0; l < SCREEN_BLOCK; l++)
                if (w->key[index + (size_t) l] > 0.0f)
                    sum[l] = mixed[l];
    }
}

/* Number of taps of a side within this many pixels. */
INLINE int within(int pixels, const struct block *b)
{
    return (int64_t) b->count * b->stride <= pixels ? b->count : pixels / b->stride;
}

/* Positions of a block's taps, and their scales. */
PELL_FETCHING_INLINE void prepare(const struct screen_work *w, int block, int y, int axis, const float *const from[3], float *const to[3],
                                  struct job *job)
{
    const struct screen_extent *extent = &w->extents[y];
    const int x = block * SCREEN_BLOCK;
    const size_t index = (size_t) (y * w->stride + x), below = index + (size_t) w->stride;
    int before, after;

    job->x = x;
    job->cell = cell_at(w, block, y);
    __builtin_prefetch(job->cell + w->blocks);
    __builtin_prefetch(w->to_px[axis] + below);
    if (axis == 0) {
        __builtin_prefetch(w->length[0] + below);
        for (int i = 0; i < 3; i++)
            pell_fetch_to_write(to[i] + x + w->stride);
        for (int i = 0; w->fresh && i < 3; i++)
            __builtin_prefetch(from[i] + x + w->stride);
    } else {
        for (int i = 0; i < 3; i++)
            pell_fetch_to_write(w->out->light[i] + (y + 1) * w->in->shape.stride + x);
    }
    if ((w->forms & SCREEN_FORM_PAPER_EDGES) || !choose(w, index, job->cell, &job->b)) {
        job->b.num_active = 0;
        return;
    }
    space(w, index, block, axis, job->cell, &job->b);
    before = axis == 0 ? x + SCREEN_BLOCK - 1 - extent->begin * SCREEN_BLOCK : y - w->in->rect.y0;
    after = axis == 0 ? extent->end * SCREEN_BLOCK - 1 - x : w->in->rect.y1 - 1 - y;
    job->low = within(before, &job->b);
    job->high = within(after, &job->b);
    if (axis == 1 && (job->b.count + 1) * (int64_t) job->b.stride <= after) { /* the row that the block below reaches for the first time */
        const ptrdiff_t reached = (job->b.count * job->b.stride + 1) * w->stride;
        __builtin_prefetch(w->depth + index + reached);
        __builtin_prefetch(w->length[1] + index + reached);
        for (int i = 0; i < 3; i++)
            __builtin_prefetch(from[i] + x + reached);
    }
    scale_kernel(w, index, axis, job);
}

/* Blocks of a row go through three stages, a few at a time: inputs, taps, result. Each block is a chain of dependent operations with long
 * latency (divisions, square roots); interleaving blocks lets the processor overlap them. */
enum { JOBS = 8 };

/* One pass over row y: along x, or along y and into the sum. `from` and `to` are rows, at pixel 0. */
PELL_FETCHING_INLINE int blur_row(const struct screen_work *w, int y, int axis, const float *const from[3], float *const to[3])
{
    const int begin = w->extents[y].begin, end = w->extents[y].end;
    const bool paper = w->forms & SCREEN_FORM_PAPER_EDGES;
    struct job jobs[JOBS];
    int active = 0;

    for (int block = begin; block < end;) {
        int count = 0;

        for (; block < end && count < JOBS; block++)
            if (cell_at(w, block, y)->contents != SCREEN_EMPTY)
                prepare(w, block, y, axis, from, to, &jobs[count++]);
        for (int k = 0; k < count; k++)
            if (jobs[k].b.num_active == 0)
                continue;
            else if (w->several || w->depth_mm == 0.0f)
                PELL_SIMD(screen_gather_any)(w, y, axis, from, &jobs[k]);
            else if (axis == 0)
                PELL_SIMD(screen_gather_along_x)(w, y, from, &jobs[k]);
            else if (jobs[k].b.skew != 0.0f)
                PELL_SIMD(screen_gather_skewed)(w, y, from, &jobs[k]);
            else
                PELL_SIMD(screen_gather_along_y)(w, y, from, &jobs[k]);
        for (int k = 0; k < count; k++) {
            const int x = jobs[k].x;
            const size_t index = (size_t) (y * w->stride + x);
            _Alignas(64) float result[3][SCREEN_BLOCK], on[SCREEN_BLOCK];
            int blurred = jobs[k].b.num_active;

            if (paper)
                blurred = PELL_SIMD(screen_gather_listing)(w, y, axis, &jobs[k], from, result, on);
            else if (blurred > 0)
                settle(&jobs[k], from, result);
            if (blurred <= 0)
                for (int i = 0; i < 3; i++)
                    memcpy(result[i], from[i] + x, sizeof(result[i]));
            if (axis == 1)
                put(w, x, y, index, jobs[k].cell, result, paper ? on : NULL);
            if (axis == 0 || !w->last)
                for (int i = 0; i < 3; i++)
                    memcpy(to[i] + x, result[i], sizeof(result[i]));
            active += blurred;
        }
    }
    return active;
}

static PELL_FETCHING int across_row(const struct screen_work *w, int y, const float *const from[3], float *const to[3])
{
    return blur_row(w, y, 0, from, to);
}

static PELL_FETCHING int down_row(const struct screen_work *w, int y, const float *const from[3], float *const to[3])
{
    /* Clears the parts of `to` that the pass along x reads but no pixel writes. */
    for (int block = w->extents[y].begin - 1; block <= w->extents[y].end; block++)
        if (block < w->extents[y].begin || block == w->extents[y].end || cell_at(w, block, y)->contents == SCREEN_EMPTY)
            for (int i = 0; !w->last && i < 3; i++)
                memset(to[i] + block * SCREEN_BLOCK, 0, SCREEN_BLOCK * sizeof(float));
    return blur_row(w, y, 1, from, to);
}

static void copy_row(const struct screen_work *w, int y)
{
    for (int block = w->block0; block < w->block1; block++) {
        const size_t index = (size_t) (y * w->stride + block * SCREEN_BLOCK);

        for (int l = 0; cell_at(w, block, y)->contents != SCREEN_EMPTY && l < SCREEN_BLOCK; l++)
            for (int i = 0; w->key[index + (size_t) l] > 0.0f && i < 3; i++)
                w->out->light[i][y * w->in->shape.stride + block * SCREEN_BLOCK + l] = w->now[i][index + (size_t) l];
    }
}

extern const struct screen_kernels PELL_SIMD(pell_ss_kernels);
const struct screen_kernels PELL_SIMD(pell_ss_kernels) = {
    .load = PELL_SIMD(screen_load_row),
    .measure = PELL_SIMD(screen_measure_row),
    .across = across_row,
    .down = down_row,
    .term_across = PELL_SIMD(screen_term_across),
    .term_down = PELL_SIMD(screen_term_down),
    .copy = copy_row,
};
