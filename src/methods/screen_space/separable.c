/* SPDX-License-Identifier: MIT
 *
 * separable.c - the two passes of a term of the separable kernel (factors.h) over a row, along the axes or rotated per pixel; compiled once
 * per level of base/simd.h. The mathematics is in README.md.
 */
#include "methods/screen_space/blocks.h"
#include "methods/screen_space/factors.h"

enum { MAX_TAPS = 64 };

/* Positions of the taps of a block, per side: pixels from the centre, and the limits of the interval that each represents. */
struct line {
    int count, at[MAX_TAPS + 1];
    float edge[MAX_TAPS + 1];
    bool sparse; /* there are pixels between taps */
};

/* A pixel's line on the screen: step in x and y, pixels. */
struct step_dir {
    float x, y;
    bool rotated;
    float mm2;    /* rotated: squared length of a step on the surface, relative to the pixel's area */
    float jitter; /* position of each tap within its interval, [0, 1] */
};

/* Every pixel up to w->taps taps; else taps spaced by squares, dense in the centre. */
INLINE struct line line_of(const struct screen_work *w, float reach)
{
    const float half = (float) w->taps + 0.5f;
    struct line line = { .count = 0 };
    int before = 0;

    line.sparse = reach > half;
    line.edge[0] = 0.5f;
    for (int i = 1; i <= w->taps && (float) before < reach; i++) {
        const float square = reach * ((float) i / half) * ((float) i / half);
        const int at = line.sparse && square > (float) i ? (int) (square + 0.5f) : i;
        line.at[i - 1] = at > before ? at : before + 1;
        if (i > 1)
            line.edge[i - 1] = 0.5f * (float) (before + line.at[i - 1]);
        before = line.at[i - 1];
        line.count = i;
        line.edge[i] = (float) before + 0.5f;
    }
    if (line.sparse) /* the last one represents the remainder */
        line.edge[line.count] = reach;
    return line;
}

/* Integral of the factor between two fractions of its extent. */
INLINE float between(const struct screen_factor *f, int channel, float near, float far)
{
    return pell_ss_factor_integral(f, channel, sqrtf(far < 1.0f ? far : 1.0f)) -
           pell_ss_factor_integral(f, channel, sqrtf(near < 1.0f ? near : 1.0f));
}

INLINE struct step_dir step_at(const struct screen_work *w, int axis, const struct screen_cell *cell, const struct line *line, int x, int y)
{
    const size_t index = (size_t) (y * w->stride + x);

    if (!w->rotated || !line->sparse)
        return axis == 0 ? (struct step_dir) { .x = 1.0f } : (struct step_dir) { .x = -cell->skew, .y = 1.0f };
    { /* the axes are perpendicular on the surface, and so are the two passes */
        const int rotation = pell_ss_turn(x, y, w->turn);
        const float *turn = w->turns[rotation];
        const float c = axis == 0 ? turn[0] : -turn[1], s = axis == 0 ? turn[1] : turn[0];
        const float ratio = w->length[0][index] / w->length[1][index], down = s * ratio, along = c - cell->skew * down;
        const float size2 = along * along + down * down, size = sqrtf(size2);
        return (struct step_dir) { along / size, down / size, true, ratio / size2, pell_ss_jitter(rotation) };
    }
}

struct sums {
    float weight[3], light[3];
};

/* A pixel whose taps are summed. */
struct centre {
    const struct screen_work *w;
    const struct screen_factor *factor;
    const struct line *line;
    const float *const *from; /* at the pixel */
    size_t index;
    int axis, x, y;
    struct step_dir step_dir;
    float per_mm; /* reciprocal of the factor's extent */
};

/* Position of a tap: false if it is outside of the rectangle, on another object, or the pixel itself. */
INLINE bool place_tap(const struct centre *p, float ahead, int offset[2])
{
    const struct screen_work *w = p->w;
    const struct pell_rect *rect = &w->in->rect;
    const int ox = (int) floorf(ahead * p->step_dir.x + 0.5f), oy = (int) floorf(ahead * p->step_dir.y + 0.5f);
    ptrdiff_t at;

    if (p->x + ox < rect->x0 || p->x + ox >= rect->x1 || p->y + oy < rect->y0 || p->y + oy >= rect->y1)
        return false;
    offset[0] = ox;
    offset[1] = oy;
    at = (ptrdiff_t) p->index + oy * w->stride + ox;
    return (ox != 0 || oy != 0) && w->key[at] == w->key[p->index] && w->length[p->axis][at] > 0.0f;
}

/* Tap `i` of the line, on the side `sign`. */
INLINE void add_tap(const struct centre *p, int i, float sign, struct sums *sums)
{
    const struct screen_work *w = p->w;
    const struct line *line = p->line;
    const struct step_dir *step_dir = &p->step_dir;
    const float jitter = sign > 0.0f ? step_dir->jitter : 1.0f - step_dir->jitter;
    const float ahead = sign * (step_dir->rotated ? line->edge[i] + jitter * (line->edge[i + 1] - line->edge[i]) : (float) line->at[i]);
    float h, dx, dy, dz, spacing; /* mm per pixel of the line */
    int offset[2];
    ptrdiff_t by, at;
    float size;

    if (!place_tap(p, ahead, offset))
        return;
    by = offset[1] * w->stride + offset[0];
    at = (ptrdiff_t) p->index + by;
    h = w->depth[at] * w->depth_mm + w->fixed_mm;
    dz = w->depth[at] - w->depth[p->index];
    dx = h * (float) offset[0] + dz * w->columns_tan[p->x];
    dy = h * (float) offset[1] + dz * w->rows_tan[p->y];
    if (step_dir->rotated) {
        const float ox = (float) offset[0], oy = (float) offset[1];
        spacing = sqrtf((dx * dx + dy * dy + dz * dz) / (ox * ox + oy * oy));
    } else { /* offset of the nearest pixel from the line */
        const float across = p->axis == 0 ? 0.0f : ((float) offset[0] - ahead * step_dir->x) * w->length[0][p->index];
        spacing = sqrtf(fmaxf(dx * dx + dy * dy + dz * dz - across * across, 0.0f)) / fabsf(ahead);
    }
    if (!(spacing > 0.0f))
        return;
    size = step_dir->rotated ? step_dir->mm2 * w->length[0][at] * w->length[1][at] / (spacing * spacing) : w->length[p->axis][at] / spacing;
    for (int c = 0; c < 3; c++) {
        const float weight = between(p->factor, c, line->edge[i] * spacing * p->per_mm, line->edge[i + 1] * spacing * p->per_mm) * size;
        sums->weight[c] += weight;
        sums->light[c] += weight * p->from[c][by];
    }
}

/* Blurs one pixel; false: none. The weight that its taps do not contribute stays with the pixel. */
INLINE bool blur_pixel(struct centre *p, const struct screen_cell *cell, float out[3])
{
    const struct screen_work *w = p->w;
    const int material = (int) w->key[p->index];
    const float mm = w->depth[p->index] * w->depth_mm + w->fixed_mm, extent = w->factors->extent_mm[material];
    const bool on = w->scale[p->index] > 0.0f && extent > 0.0f && w->length[0][p->index] > 0.0f && w->length[1][p->index] > 0.0f;
    struct sums sums = { { 0.0f }, { 0.0f } };

    if (on) {
        p->per_mm = 1.0f / (extent * sqrtf(w->scale[p->index]) * mm);
        p->step_dir = step_at(w, p->axis, cell, p->line, p->x, p->y);
        for (int i = 0; i < p->line->count; i++) {
            add_tap(p, i, -1.0f, &sums);
            add_tap(p, i, 1.0f, &sums);
        }
    }
    for (int c = 0; c < 3; c++) {
        const float integral = p->factor->integral[c];
        if (integral > 0.0f && sums.weight[c] > integral && w->term == 0) /* lengths vary too fast */
            out[c] = sums.light[c] * (integral / sums.weight[c]);
        else
            out[c] = sums.light[c] + (integral - sums.weight[c]) * p->from[c][0];
    }
    return on;
}

/* Reach in pixels, along either axis if the line is rotated. */
INLINE float reach_of(const struct screen_work *w, const struct screen_cell *cell, int axis, size_t index)
{
    const float *scale = cell->to_px[axis];
    float extent = 0.0f, most = scale[1];

    for (int l = 0; l < SCREEN_BLOCK; l++) {
        const float e = w->factors->extent_mm[(int) w->key[index + (size_t) l]];
        extent = e > extent ? e : extent;
    }
    if (w->rotated)
        most = cell->to_px[1 - axis][1] > most ? cell->to_px[1 - axis][1] : most;
    return most > 0.0f ? fminf(extent * sqrtf(most), 65536.0f) : 0.0f;
}

/* --- Blocks of one material without rotation: vectorised over lanes ------------------------------------------------------------------ */

/* Data of a pass over the pixels of a block. */
struct block_pass {
    const struct screen_work *w;
    const struct screen_factor *factor;
    const float *const *from; /* planes */
    int axis, y;
    float skew; /* of its lines of taps */
};

struct pixel_vector { /* a vector of pixels of a block */
    size_t index;
    vf x, key, depth, length0, per_mm, column;
    vi on;
    vf weight[3], light[3];
};

/* The cubic that contains a fraction of the extent, and the position in it. */
INLINE vf in_cubic(vf fraction, vi *k)
{
    const vf p = vsqrt(vmin(fraction, splat(1.0f))) * (float) SCREEN_FACTOR_PARTS, last = splat(SCREEN_FACTOR_PARTS - 1);

    *k = __builtin_convertvector(vmin(p, last), vi);
    return p - __builtin_convertvector(*k, vf);
}

INLINE vf cubic(const float (*a)[SCREEN_FACTOR_PARTS], vi k, vf t)
{
    return lookup32(a[0], k) + t * (lookup32(a[1], k) + t * (lookup32(a[2], k) + t * lookup32(a[3], k)));
}

/* The pixels at `offset` on the line, `ahead` steps along it. */
INLINE void add_taps(const struct block_pass *b, const int offset[2], float ahead, const float edge[2], struct pixel_vector *p)
{
    const struct screen_work *w = b->w;
    const struct pell_rect *rect = &w->in->rect;
    const ptrdiff_t at = (ptrdiff_t) p->index + offset[1] * w->stride + offset[0];
    const vf zero = splat(0.0f), x = p->x + (float) offset[0], length = load(w->length[b->axis] + at), depth = load(w->depth + at);
    const vi valid =
        p->on & (load(w->key + at) == p->key) & (length > zero) & (x >= splat((float) rect->x0)) & (x < splat((float) rect->x1));
    vf h, dx, dy, dz, d2, spacing, near, far, size;
    vi known, k0, k1;

    if (!any(valid))
        return;
    h = depth * w->depth_mm + w->fixed_mm;
    dz = depth - p->depth;
    dx = h * (float) offset[0] + dz * p->column;
    dy = h * (float) offset[1] + dz * w->rows_tan[b->y];
    d2 = dx * dx + dy * dy + dz * dz;
    if (b->axis == 1) { /* offset of the nearest pixel from the line */
        const vf across = ((float) offset[0] + ahead * b->skew) * p->length0;
        d2 = vmax(d2 - across * across, zero);
    }
    spacing = vsqrt(d2) / splat(fabsf(ahead));
    known = valid & (spacing > zero);
    size = length / select(known, spacing, splat(1.0f));
    near = in_cubic(edge[0] * spacing * p->per_mm, &k0);
    far = in_cubic(edge[1] * spacing * p->per_mm, &k1);
    for (int c = 0; c < 3; c++) {
        const vf weight = select(known, (cubic(b->factor->cubic[c], k1, far) - cubic(b->factor->cubic[c], k0, near)) * size, zero);
        p->weight[c] += weight;
        p->light[c] += weight * load(b->from[c] + at);
    }
}

/* The weight that its taps do not contribute stays with the pixel. Returns the number of blurred pixels. */
INLINE int blur_block(const struct block_pass *b, const struct screen_cell *cell, const struct line *line, int x0,
                      float (*restrict out)[SCREEN_BLOCK])
{
    const struct screen_work *w = b->w;
    const struct pell_rect *rect = &w->in->rect;
    const float extent = w->factors->extent_mm[cell->material];
    const size_t first = (size_t) (b->y * w->stride + x0);
    const vf zero = splat(0.0f);
    int active = 0;

    for (int lane = 0; lane < SCREEN_BLOCK; lane += WIDTH) {
        struct pixel_vector p = { .index = first + (size_t) lane };
        const vf scale = load(w->scale + p.index);
        const vi on = (scale > zero) & (load(w->length[0] + p.index) > zero) & (load(w->length[1] + p.index) > zero);
        for (int l = 0; l < WIDTH; l++)
            p.x[l] = (float) (x0 + lane + l);
        p.key = load(w->key + p.index);
        p.on = extent > 0.0f ? on & (p.key > zero) : (vi) { 0 };
        p.depth = load(w->depth + p.index);
        p.length0 = load(w->length[0] + p.index);
        p.column = load(w->columns_tan + x0 + lane);
        p.per_mm = splat(1.0f) / (extent * vsqrt(select(p.on, scale, splat(1.0f))) * (p.depth * w->depth_mm + w->fixed_mm));
        active += __builtin_popcount(movemask(p.on));
        for (int tap = 0; tap < 2 * line->count && any(p.on); tap++) {
            const int i = tap / 2;
            const float ahead = (float) (tap % 2 ? line->at[i] : -line->at[i]);
            const int along = (int) ahead, down = b->axis == 0 ? 0 : along;
            const int offset[2] = { b->axis == 0 ? along : (int) floorf(0.5f - ahead * b->skew), down };
            if (b->y + down >= rect->y0 && b->y + down < rect->y1 && x0 + lane + offset[0] < rect->x1 &&
                x0 + lane + WIDTH + offset[0] > rect->x0)
                add_taps(b, offset, ahead, line->edge + i, &p);
        }
        for (int c = 0; c < 3; c++) {
            const vf integral = splat(b->factor->integral[c]), sum = p.light[c] + (integral - p.weight[c]) * load(b->from[c] + p.index);
            const vi less = (p.weight[c] > integral) & (integral > zero); /* lengths vary too fast */
            store(&out[c][lane], w->term > 0 ? sum : select(less, p.light[c] * (integral / select(less, p.weight[c], integral)), sum));
        }
    }
    return active;
}

/* --- Rows --------------------------------------------------------------------------------------------------------------------------- */

/* Result of a pixel after a pass: input of the next one, or added to the sum. */
INLINE void put_pixel(const struct screen_work *w, int x, int y, int axis, size_t index, const float sign[3], const float light[3],
                      float *const to[3])
{
    const ptrdiff_t at = y * w->in->shape.stride + x;

    for (int c = 0; c < 3; c++)
        if (axis == 0)
            to[c][index] = light[c];
        else
            w->out->light[c][at] = (w->term > 0 ? w->out->light[c][at] : 0.0f) + sign[c] * light[c];
}

/* Blurs the pixels of a row; returns the number of blurred ones. */
INLINE int blur_pixels(const struct screen_work *w, int y, int axis, const float *const from[3], float *const to[3])
{
    int active = 0;

    for (int block = w->extents[y].begin; block < w->extents[y].end; block++) {
        const struct screen_cell *cell = cell_at(w, block, y);
        const size_t first = (size_t) (y * w->stride + block * SCREEN_BLOCK);
        float all_light[3][SCREEN_BLOCK];
        struct line line;
        bool vectorised;

        if (cell->contents == SCREEN_EMPTY)
            continue;
        line = line_of(w, reach_of(w, cell, axis, first));
        vectorised = cell->material != SCREEN_MIXED && !(w->rotated && line.sparse);
        if (vectorised) {
            const struct screen_factor *f = &w->factors->factor[(size_t) cell->material * (size_t) w->factors->rank + (size_t) w->term];
            const struct block_pass pass = { w, f, from, axis, y, axis == 0 ? 0.0f : cell->skew };
            active += blur_block(&pass, cell, &line, block * SCREEN_BLOCK, all_light);
        }
        for (size_t index = first; index < first + SCREEN_BLOCK; index++) {
            const int l = (int) (index - first), x = block * SCREEN_BLOCK + l;
            const float *const here[3] = { from[0] + index, from[1] + index, from[2] + index };
            struct centre p = { .w = w, .line = &line, .from = here, .index = index, .axis = axis, .x = x, .y = y };
            float light[3];

            if (!(w->key[index] > 0.0f))
                continue;
            p.factor = &w->factors->factor[(size_t) w->key[index] * (size_t) w->factors->rank + (size_t) w->term];
            for (int c = 0; vectorised && c < 3; c++)
                light[c] = all_light[c][l];
            if (!vectorised)
                active += blur_pixel(&p, cell, light);
            put_pixel(w, x, y, axis, index, p.factor->sign, light, to);
        }
    }
    return active;
}

int PELL_SIMD(screen_term_across)(const struct screen_work *w, int y, const float *const from[3], float *const to[3])
{
    return blur_pixels(w, y, 0, from, to);
}

int PELL_SIMD(screen_term_down)(const struct screen_work *w, int y, const float *const from[3])
{
    return blur_pixels(w, y, 1, from, NULL);
}
