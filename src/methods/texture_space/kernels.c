/* SPDX-License-Identifier: MIT
 *
 * kernels.c - the inner loops of the texture-space method; compiled once per level of base/simd.h. The mathematics is in README.md.
 *
 * Vectors are the compiler's generic ones, as wide as the machine's registers. All levels give the same bits: a texel's operations and
 * their order do not depend on the width.
 */
#include "methods/texture_space/kernels.h"
#include "methods/texture_space/formulas.h"

#include "base/simd.h"
#include "math/lanes.h"

#include <math.h>
#include <string.h>

/* --- The kernel ---------------------------------------------------------------------------------------------------------------- */

INLINE vf kernel(vf y)
{
    const vf a = vmin(y, (vf) { 0 } + Y_SHIFT) - 1.0f;
    vf k = (a * a + 1.0f) * 0.5f;

    k *= k;
    k *= k;
    k *= k;
    return k * k - K_END;
}

/* Variance in texels^2 that the chain has added where a texel is 1/density mm long; the variance that reading the map adds is
 * subtracted. */
INLINE vf on_grid(float variance, vf density2, float read_variance)
{
    return vmax(density2 * variance - read_variance, (vf) { 0 });
}

INLINE float on_grid1(float variance, float length, float read_variance)
{
    const float v = variance / (length * length) - read_variance;
    return v > 0.0f ? v : 0.0f;
}

struct gathered {
    vf weight, light[TS_PLANES];
};

/* The texels that are blurred. */
struct centre {
    ptrdiff_t at;
    vf key, kernel_scale, tilt; /* kernel_scale: y per mm^2 */
};

/* The line of taps through them. */
struct line {
    int axis, stride; /* plane offset between two taps */
    float skew;       /* down columns, as in struct ts_cell */
};

/* The taps of one side, `sign`: distances accumulate along the line, from the length of each texel. */
INLINE void side(const struct ts_work *w, const struct centre *m, const struct line *line, int sign, int count, int planes,
                 struct gathered *g)
{
    const int axis = line->axis;
    const ptrdiff_t step = sign * line->stride * (axis == 0 ? 1 : w->stride);
    const float half_stride = 0.5f * (float) line->stride;
    const vf tilt = sign < 0 ? -m->tilt : m->tilt;
    ptrdiff_t at = m->at;
    vf last = load(w->length[axis] + at), distance = { 0 };

    for (int j = 0; j < count; j++) {
        vf here, weight;
        at += step;
        here = load(w->length[axis] + at);
        distance += (last + here) * half_stride;
        last = here;
        weight = kernel(distance * distance * m->kernel_scale) * here * vmax(distance * tilt + 1.0f, (vf) { 0 });
        weight = (vf) ((vi) weight & (load(w->key + at) == m->key));
        g->weight += weight;
        for (int c = 0; c < planes; c++)
            g->light[c] += weight * load(w->from[c] + at);
    }
}

/* The same up or down a skewed line; `x` is the block's. */
INLINE void skewed_side(const struct ts_work *w, const struct centre *m, const struct line *line, int x, int sign, int count, int planes,
                        struct gathered *g)
{
    const float half_stride = 0.5f * (float) line->stride;
    const vf tilt = sign < 0 ? -m->tilt : m->tilt;
    vf last = load(w->length[1] + m->at), distance = { 0 };

    for (int j = 1; j <= count; j++) {
        const int py = sign * line->stride * j;
        const float exact = -line->skew * (float) py;
        const int px = exact < 0.0f ? -(int) (0.5f - exact) : (int) (exact + 0.5f);
        const ptrdiff_t at = m->at + px + py * w->stride;
        vf here, weight;
        if (x + px <= -TS_BLOCK || x + px >= w->width)
            return;
        here = load(w->length[1] + at);
        distance += (last + here) * half_stride;
        last = here;
        weight = kernel(distance * distance * m->kernel_scale) * here * vmax(distance * tilt + 1.0f, (vf) { 0 });
        weight = (vf) ((vi) weight & (load(w->key + at) == m->key));
        g->weight += weight;
        for (int c = 0; c < planes; c++)
            g->light[c] += weight * load(w->from[c] + at);
    }
}

/* Reach of the taps of a texel: K_REACH standard deviations of the variance that the blur adds. */
INLINE float reach_of(float add)
{
    return add > ADD_LEAST ? K_REACH * sqrtf(add > S2_MIN ? add : S2_MIN) : 0.0f;
}

static float reach(const struct ts_work *w, float length)
{
    return reach_of(on_grid1(w->after, length, w->read_variance) - on_grid1(w->before, length, w->read_variance));
}

/* Prefetches the next row while one is blurred: columns have more streams than hardware prefetchers follow. */
INLINE void prefetch_next(const struct ts_work *w, ptrdiff_t index, int y, int axis, int reach, int planes)
{
    const int below = w->height - 1 - y;
    const ptrdiff_t next = index + (below > 0 ? w->stride : 0), last = index + (below > reach ? reach + 1 : below) * w->stride;

    for (int c = 0; c < planes; c++) {
        __builtin_prefetch(w->from[c] + last, 0, 2);
        __builtin_prefetch(w->to[c] + next, 1, 2);
    }
    __builtin_prefetch(w->length[axis] + last, 0, 2);
    __builtin_prefetch(w->key + last, 0, 2);
    __builtin_prefetch(w->tilt[axis] + next, 0, 2);
    for (int c = 0; c < 3 && axis == 1 && w->sum[0]; c++)
        __builtin_prefetch(w->sum[c] + next, 1, 2);
}

/* `low` and `high`: texels before and after the block's along the axis that taps may reach. */
INLINE void blur_block(const struct ts_work *w, const struct ts_cell *cell, int x, int y, int axis, int low, int high, int planes)
{
    const ptrdiff_t index = (ptrdiff_t) y * w->stride + x;
    const float add_most =
        on_grid1(w->after, cell->least[axis], w->read_variance) - on_grid1(w->before, cell->least[axis], w->read_variance);
    const float before = on_grid1(w->before, cell->most[axis], w->read_variance);
    const float add_least = on_grid1(w->after, cell->most[axis], w->read_variance) - before;
    const float smooth = before < add_least ? before : add_least, reach = reach_of(add_most);
    struct line line = { .axis = axis, .skew = cell->skew };
    float space;
    bool skews;
    int stride, count;

    if (!(reach > 0.0f)) {
        for (int c = 0; c < planes; c++)
            memcpy(w->to[c] + index, w->from[c] + index, TS_BLOCK * sizeof(float));
        return;
    }
    /* Taps may be 1.5 standard deviations of the previous blurs apart. */
    space = 1.5f * sqrtf(smooth);
    line.stride = stride = space >= 2.0f ? (space < 4096.0f ? (int) space : 4096) : 1;
    count = reach < (float) (MAX_TAPS * stride) ? (int) (reach / (float) stride) : MAX_TAPS;
    count = count > 0 ? count : 1;
    skews = axis == 1 && fabsf(cell->skew) * reach >= 0.5f; /* with less than half a texel to the side, taps follow the column */
    prefetch_next(w, index, y, axis, axis == 1 ? count * stride : 0, planes);
    low = low / stride < count ? low / stride : count;
    high = high / stride < count ? high / stride : count;
    for (int lane = 0; lane < TS_BLOCK; lane += WIDTH) {
        const ptrdiff_t at = index + lane;
        const vf zero = { 0 }, one = zero + 1.0f, length = load(w->length[axis] + at);
        const vi inside = length > zero;
        const vf inverse = one / select(inside, length, one), density2 = inverse * inverse;
        const vf add = on_grid(w->after, density2, w->read_variance) - on_grid(w->before, density2, w->read_variance);
        const vf mix = vmin(add * (1.0f / S2_MIN_VARIANCE), one);
        const struct centre m = {
            .at = at,
            .key = load(w->key + at),
            .kernel_scale = K_SCALE * density2 / vmax(add, zero + S2_MIN),
            .tilt = w->tilts ? load(w->tilt[axis] + at) * inverse : zero,
        };
        struct gathered g;
        vf scale, keep;

        g.weight = select(inside, length, one) * (1.0f - K_END);
        for (int c = 0; c < planes; c++)
            g.light[c] = g.weight * load(w->from[c] + at);
        if (skews) {
            skewed_side(w, &m, &line, x + lane, -1, low, planes, &g);
            skewed_side(w, &m, &line, x + lane, 1, high, planes, &g);
        } else {
            side(w, &m, &line, -1, low, planes, &g);
            side(w, &m, &line, 1, high, planes, &g);
        }
        scale = mix / g.weight;
        keep = one - mix;
        for (int c = 0; c < planes; c++)
            store(w->to[c] + at, g.light[c] * scale + keep * load(w->from[c] + at));
    }
}

INLINE void add_to_sum(const struct ts_work *w, ptrdiff_t index)
{
    for (int lane = 0; lane < TS_BLOCK; lane += WIDTH)
        for (int c = 0; c < 3; c++) {
            vf light = load(w->to[c] + index + lane);
            if (w->planes == TS_PLANES)
                light += load(w->to[TS_LOCAL + c] + index + lane);
            store(w->sum[c] + index + lane, load(w->sum[c] + index + lane) + w->weight[c] * light);
        }
}

INLINE void blur(const struct ts_work *w, int y, int from, int to, int axis)
{
    for (int b = from; b < to; b++) {
        const struct ts_cell *cell = &w->cells[(ptrdiff_t) y * w->blocks + b];
        const ptrdiff_t index = (ptrdiff_t) y * w->stride + b * TS_BLOCK;
        const int low = axis == 0 ? b * TS_BLOCK + TS_BLOCK - 1 : y, high = axis == 0 ? w->width - 1 - b * TS_BLOCK : w->height - 1 - y;

        if (cell->near > w->near || (w->need && w->need[(ptrdiff_t) y * w->blocks + b] < w->stage))
            continue;
        if (w->planes == 3)
            blur_block(w, cell, b * TS_BLOCK, y, axis, low, high, 3);
        else if (w->planes == TS_ALPHA + 1)
            blur_block(w, cell, b * TS_BLOCK, y, axis, low, high, TS_ALPHA + 1);
        else
            blur_block(w, cell, b * TS_BLOCK, y, axis, low, high, TS_PLANES);
        if (axis == 1 && w->sum[0])
            add_to_sum(w, index);
    }
}

/* --- The paper's taps ---------------------------------------------------------------------------------------------------------- */

/* Seven taps one standard deviation apart, linearly interpolated between texels; the stretch, texels per mm, is in the last two planes. */
static void seven(const struct ts_work *w, int y, int from, int to, int axis)
{
    static const float weights[4] = { 1.0f, 0.60653066f, 0.13533528f, 0.011108997f };
    const ptrdiff_t pitch = axis == 0 ? 1 : w->stride;
    const float span = sqrtf(w->after - w->before) * (1.0f / SEVEN_SPAN);
    const int most = axis == 0 ? w->width : w->height;

    for (int x = from * TS_BLOCK; x < to * TS_BLOCK && x < w->width; x++) {
        const ptrdiff_t at = (ptrdiff_t) y * w->stride + x;
        const int here = axis == 0 ? x : y;
        float total = 0.0f, sum[TS_PLANES] = { 0 }, spacing;

        if (!(w->key[at] > 0.0f))
            continue;
        spacing = span * w->from[w->planes - 2 + axis][at];
        spacing = spacing < 1e4f ? spacing : 1e4f;
        for (int j = -3; j <= 3; j++) {
            const float offset = (float) j * spacing, base = floorf(offset), fraction = offset - base;
            for (int k = 0; k < 2; k++) {
                const int step = (int) base + k;
                const float weight = weights[j < 0 ? -j : j] * (k ? fraction : 1.0f - fraction);
                const ptrdiff_t tap = at + step * pitch;
                if (here + step < 0 || here + step >= most || !(weight > 0.0f) || w->key[tap] != w->key[at])
                    continue;
                total += weight;
                for (int c = 0; c < w->planes; c++)
                    sum[c] += weight * w->from[c][tap];
            }
        }
        for (int c = 0; c < w->planes; c++)
            w->to[c][at] = sum[c] / total; /* the centre tap always contributes */
        for (int c = 0; axis == 1 && w->sum[0] && c < 3; c++)
            w->sum[c][at] += w->weight[c] * w->to[c][at];
    }
}

/* --- Taps at arbitrary positions -------------------------------------------------------------------------------------------------- */

static void scatter(const struct ts_work *w, const float *skew, const struct ts_tap *taps, int count, int y, int from, int to)
{
    for (int x = from * TS_BLOCK; x < to * TS_BLOCK && x < w->width; x++) {
        const ptrdiff_t at = (ptrdiff_t) y * w->stride + x;
        float all[3] = { 0 }, found[3] = { 0 }, sum[3] = { 0 }, across, down;

        if (!(w->key[at] > 0.0f))
            continue;
        across = 1.0f / w->length[0][at];
        down = 1.0f / w->length[1][at];
        for (int i = 0; i < count; i++) {
            const float dy = taps[i].y * down, py = (float) y + dy;
            const float px = (float) x + taps[i].x * across - (w->tilts ? skew[at] * dy : 0.0f);
            const float fx = floorf(px), fy = floorf(py);
            float inside = 0.0f, light[3] = { 0 };
            for (int c = 0; c < 3; c++)
                all[c] += taps[i].weight[c];
            if (!(fx >= 0.0f && fy >= 0.0f && fx < (float) (w->width - 1) && fy < (float) (w->height - 1)))
                continue;
            for (int k = 0; k < 4; k++) {
                const ptrdiff_t tap = ((ptrdiff_t) fy + k / 2) * w->stride + (ptrdiff_t) fx + k % 2;
                const float weight = (k % 2 ? px - fx : 1.0f - (px - fx)) * (k / 2 ? py - fy : 1.0f - (py - fy));
                if (w->key[tap] != w->key[at])
                    continue;
                inside += weight;
                for (int c = 0; c < 3; c++)
                    light[c] += weight * w->from[c][tap];
            }
            for (int c = 0; c < 3; c++) {
                found[c] += taps[i].weight[c] * inside;
                sum[c] += taps[i].weight[c] * light[c];
            }
        }
        for (int c = 0; c < 3; c++)
            w->sum[c][at] += found[c] > 0.0f ? sum[c] * all[c] / found[c] : 0.0f;
    }
}

static void across(const struct ts_work *w, int y, int from, int to)
{
    if (w->seven)
        seven(w, y, from, to, 0);
    else
        blur(w, y, from, to, 0);
}

static void down(const struct ts_work *w, int y, int from, int to)
{
    if (w->seven)
        seven(w, y, from, to, 1);
    else
        blur(w, y, from, to, 1);
}

extern const struct ts_kernels PELL_SIMD(pell_ts_kernels);
const struct ts_kernels PELL_SIMD(pell_ts_kernels) = { .across = across, .down = down, .scatter = scatter, .reach = reach };
