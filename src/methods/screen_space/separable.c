/* SPDX-License-Identifier: MIT
 *
 * separable.c - the two passes of a term of the separable kernel (factors.h) over a row, along the axes or turned by pixel; compiled once
 * per level of base/simd.h. The mathematics is in README.md.
 */
#include "methods/screen_space/blocks.h"
#include "methods/screen_space/factors.h"

typedef float v4f __attribute__((vector_size(16)));

enum { TAPS_MOST = 64 };

/* Where the taps of a block are, on either side: pixels from the middle, and the ends of what each stands for. */
struct line {
    int count, at[TAPS_MOST + 1];
    float edge[TAPS_MOST + 1];
    bool sparse; /* pixels lie between taps */
};

/* A pixel's line on the screen: pixels in x and y for a step. */
struct way {
    float x, y;
    bool turned;
    float mm2;   /* turned: square of a step's length on the surface, over the pixel's area */
    float place; /* and where in what it stands for each tap is, [0, 1] */
};

/* Every pixel while that makes no more than w->taps; else taps that are dense in the middle, at squares. */
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
    if (line.sparse) /* the last one stands for all that is left */
        line.edge[line.count] = reach;
    return line;
}

INLINE v4f load4(const float *p)
{
    v4f v;
    memcpy(&v, p, sizeof(v));
    return v;
}

/* Integral of the factor from the middle to a share of its extent. */
INLINE v4f integral(const struct screen_factor *f, float share)
{
    const float place = sqrtf(share < 1.0f ? share : 1.0f) * SCREEN_FACTOR_STEPS;
    const int row = place < SCREEN_FACTOR_STEPS - 1 ? (int) place : SCREEN_FACTOR_STEPS - 1;
    const v4f a = load4(f->integral[row]), b = load4(f->integral[row + 1]);

    return a + (b - a) * (place - (float) row);
}

INLINE struct way way_of(const struct screen_work *w, int axis, const struct screen_cell *cell, const struct line *line, int x, int y)
{
    const size_t index = (size_t) (y * w->stride + x);

    if (!w->turned || !line->sparse)
        return axis == 0 ? (struct way) { .x = 1.0f } : (struct way) { .x = -cell->skew, .y = 1.0f };
    { /* the axes are at right angles on the surface, and so are the two passes */
        const int number = pell_ss_turn(x, y, w->turn);
        const float *turn = w->turns[number];
        const float c = axis == 0 ? turn[0] : -turn[1], s = axis == 0 ? turn[1] : turn[0];
        const float ratio = w->length[0][index] / w->length[1][index], down = s * ratio, along = c - cell->skew * down;
        const float size2 = along * along + down * down, size = sqrtf(size2);
        return (struct way) { along / size, down / size, true, ratio / size2, pell_ss_jitter(number) };
    }
}

struct sums {
    v4f weight, light;
};

/* A pixel whose taps are summed up. */
struct centre {
    const struct screen_work *w;
    const struct screen_factor *factor;
    const struct line *line;
    const float *const *from; /* at the pixel */
    size_t index;
    int axis, x, y;
    struct way way;
    float per_mm; /* of the factor's extent */
};

/* Where a tap is: false where it is beyond the rectangle, of something else, or the pixel itself. */
INLINE bool place_tap(const struct centre *p, float ahead, int offset[2])
{
    const struct screen_work *w = p->w;
    const struct pell_rect *rect = &w->in->rect;
    const int ox = (int) floorf(ahead * p->way.x + 0.5f), oy = (int) floorf(ahead * p->way.y + 0.5f);
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
    const struct way *way = &p->way;
    const float place = sign > 0.0f ? way->place : 1.0f - way->place;
    const float ahead = sign * (way->turned ? line->edge[i] + place * (line->edge[i + 1] - line->edge[i]) : (float) line->at[i]);
    float h, dx, dy, dz, apart; /* mm for each pixel of the line */
    int offset[2];
    ptrdiff_t by, at;
    v4f weight;

    if (!place_tap(p, ahead, offset))
        return;
    by = offset[1] * w->stride + offset[0];
    at = (ptrdiff_t) p->index + by;
    h = w->depth[at] * w->depth_mm + w->fixed_mm;
    dz = w->depth[at] - w->depth[p->index];
    dx = h * (float) offset[0] + dz * w->columns_tan[p->x];
    dy = h * (float) offset[1] + dz * w->rows_tan[p->y];
    if (way->turned) {
        const float ox = (float) offset[0], oy = (float) offset[1];
        apart = sqrtf((dx * dx + dy * dy + dz * dz) / (ox * ox + oy * oy));
    } else { /* from where the line is to the pixel that stands for it */
        const float beside = p->axis == 0 ? 0.0f : ((float) offset[0] - ahead * way->x) * w->length[0][p->index];
        apart = sqrtf(fmaxf(dx * dx + dy * dy + dz * dz - beside * beside, 0.0f)) / fabsf(ahead);
    }
    if (!(apart > 0.0f))
        return;
    weight = integral(p->factor, line->edge[i + 1] * apart * p->per_mm) - integral(p->factor, line->edge[i] * apart * p->per_mm);
    weight *= way->turned ? way->mm2 * w->length[0][at] * w->length[1][at] / (apart * apart) : w->length[p->axis][at] / apart;
    sums->weight += weight;
    sums->light += weight * (v4f) { p->from[0][by], p->from[1][by], p->from[2][by], 0.0f };
}

/* One pixel; false: nothing is blurred there. What its taps do not bring stays. */
INLINE bool blur_pixel(struct centre *p, const struct screen_cell *cell, float out[3])
{
    const struct screen_work *w = p->w;
    const int material = (int) w->key[p->index];
    const float mm = w->depth[p->index] * w->depth_mm + w->fixed_mm, extent = w->factors->extent_mm[material];
    const bool on = w->scale[p->index] > 0.0f && extent > 0.0f && w->length[0][p->index] > 0.0f && w->length[1][p->index] > 0.0f;
    struct sums sums = { { 0 }, { 0 } };

    p->factor = &w->factors->factor[(size_t) material * (size_t) w->factors->rank + (size_t) w->term];
    if (on) {
        p->per_mm = 1.0f / (extent * sqrtf(w->scale[p->index]) * mm);
        p->way = way_of(w, p->axis, cell, p->line, p->x, p->y);
        for (int i = 0; i < p->line->count; i++) {
            add_tap(p, i, -1.0f, &sums);
            add_tap(p, i, 1.0f, &sums);
        }
    }
    for (int c = 0; c < 3; c++) {
        const float pass = p->factor->pass[c];
        if (pass > 0.0f && sums.weight[c] > pass && w->term == 0) /* where lengths vary too fast */
            out[c] = sums.light[c] * (pass / sums.weight[c]);
        else
            out[c] = sums.light[c] + (pass - sums.weight[c]) * p->from[c][0];
    }
    return on;
}

/* The farthest pixel, along either axis where the line turns. */
INLINE float reach_of(const struct screen_work *w, const struct screen_cell *cell, int axis, size_t index)
{
    const float *scale = cell->to_px[axis];
    float extent = 0.0f, most = scale[1];

    for (int l = 0; l < SCREEN_BLOCK; l++) {
        const float e = w->factors->extent_mm[(int) w->key[index + (size_t) l]];
        extent = e > extent ? e : extent;
    }
    if (w->turned)
        most = cell->to_px[1 - axis][1] > most ? cell->to_px[1 - axis][1] : most;
    return most > 0.0f ? fminf(extent * sqrtf(most), 65536.0f) : 0.0f;
}

/* The pixels of a row that can be blurred. */
INLINE int blur_pixels(const struct screen_work *w, int y, int axis, const float *const from[3], float *const to[3])
{
    int active = 0;

    for (int block = w->extents[y].begin; block < w->extents[y].end; block++) {
        const struct screen_cell *cell = cell_at(w, block, y);
        const size_t first = (size_t) (y * w->stride + block * SCREEN_BLOCK);
        struct line line;

        if (cell->live == SCREEN_EMPTY)
            continue;
        line = line_of(w, reach_of(w, cell, axis, first));
        for (size_t index = first; index < first + SCREEN_BLOCK; index++) {
            const int x = block * SCREEN_BLOCK + (int) (index - first);
            const float *const here[3] = { from[0] + index, from[1] + index, from[2] + index };
            struct centre p = { .w = w, .line = &line, .from = here, .index = index, .axis = axis, .x = x, .y = y };
            float light[3];

            if (!(w->key[index] > 0.0f))
                continue;
            active += blur_pixel(&p, cell, light);
            for (int c = 0; c < 3; c++)
                if (axis == 0)
                    to[c][index] = light[c];
                else if (w->last)
                    w->out->light[c][y * w->in->shape.stride + x] = (w->term > 0 ? w->sum[c][index] : 0.0f) + p.factor->sign[c] * light[c];
                else
                    w->sum[c][index] = (w->term > 0 ? w->sum[c][index] : 0.0f) + p.factor->sign[c] * light[c];
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
