/* SPDX-License-Identifier: MIT
 *
 * taps.c - sums over a block's taps of the screen-space method: along x and down columns (upright), and down skewed lines, so that two
 * passes make a round Gaussian on a slanted plane; compiled once per level of base/simd.h. The mathematics is in README.md.
 */
#include "methods/screen_space/blocks.h"

struct gathered {
    vf weight, light[3];
};

/* The planes, at a pixel. */
struct around {
    const float *key, *depth, *length, *light[3];
};

struct centre {
    vf key, depth;
    vf kernel_scale; /* sqrt(y') per mm */
    vf tan[2];       /* x/f and y/f of the pixel's ray */
};

/* q of y' + Y_SHIFT. */
INLINE float kernel_of(float shifted)
{
    float q = shifted * shifted + Q_MIN;
    q *= q;
    q *= q;
    return q * q;
}

/* Adds a tap whose distance gives y' = `y`: the weight is K times the length covered by its pixel. */
INLINE void weigh(const struct around *a, ptrdiff_t at, vf y, const struct centre *c, bool several, struct gathered *g)
{
    const vf shifted = vmin(y, (vf) { 0 } + Y_MAX) + Y_SHIFT;
    vf q = shifted * shifted + Q_MIN, weight;

    q *= q;
    q *= q;
    weight = (q * q - kernel_of(Y_MAX + Y_SHIFT)) * load(a->length + at);
    if (several)
        weight = (vf) ((vi) weight & (load(a->key + at) == c->key));
    g->weight += weight;
    for (int i = 0; i < 3; i++)
        g->light[i] += weight * load(a->light[i] + at);
}

/* --- Upright ------------------------------------------------------------------------------------------------------------------- */

/* The taps of one side: state of the last one, its distance along the axis from its depth, and increments to the next one. */
struct lane_taps {
    ptrdiff_t at, step;
    vf slope, fixed, grow, shift;
};

INLINE void upright_tap(const struct around *a, struct lane_taps *side, vf dz_scale2, const struct centre *c, bool several, bool parallel,
                        struct gathered *g)
{
    vf z, along, dz;

    side->at += side->step;
    if (parallel)
        side->fixed += side->shift;
    else
        side->slope += side->grow;
    z = load(a->depth + side->at);
    along = z * side->slope + side->fixed;
    dz = z - c->depth;
    weigh(a, side->at, along * along + dz * dz * dz_scale2, c, several, g);
}

/* The taps of a block's pixels; those of the two sides in pairs, as most blocks have equally many. The points of two pixels differ by h (x,
 * y, 0) + dz (tx, ty, 1), with h = mm per pixel at the tap; the squared length is the square along the axis plus dz^2 (1 + t^2), t of the
 * other axis. The first is linear in the tap's z. */
INLINE void upright(const struct screen_work *w, const struct around *a, int axis, const struct job *job, const struct centre *c,
                    bool several, bool parallel, struct gathered *g)
{
    const float spacing = (float) job->b.stride;
    const ptrdiff_t step = job->b.stride * (axis == 0 ? 1 : w->stride);
    const vf other = c->tan[1 - axis], dz_scale2 = c->kernel_scale * c->kernel_scale * (other * other + 1.0f);
    const vf grow = c->kernel_scale * (spacing * w->depth_mm), shift = c->kernel_scale * (spacing * w->fixed_mm);
    const vf slope = c->kernel_scale * c->tan[axis], fixed = (vf) { 0 } - c->depth * slope;
    const int pairs = fewer(job->low, job->high);
    struct lane_taps back = { 0, -step, slope, fixed, -grow, -shift }, ahead = { 0, step, slope, fixed, grow, shift };

    for (int j = 0; j < pairs; j++) { /* planes have a margin on the left of the first pixel */
        upright_tap(a, &back, dz_scale2, c, several, parallel, g);
        upright_tap(a, &ahead, dz_scale2, c, several, parallel, g);
    }
    for (int j = pairs; j < job->low; j++)
        upright_tap(a, &back, dz_scale2, c, several, parallel, g);
    for (int j = pairs; j < job->high; j++)
        upright_tap(a, &ahead, dz_scale2, c, several, parallel, g);
}

/* --- Skewed -------------------------------------------------------------------------------------------------------------------- */

/* The taps down a skewed line: x decreases by b->skew pixels per pixel of y. The two taps of a pair are opposite each other. */
struct skewed {
    vf ray2, across2, grow, shift;
};

struct tap_position {
    vf cross_term;      /* 2 (x tx + y ty) */
    vf off_line2;       /* squared distance from the line that the tap represents, along x, in kernel units */
    float distance2_px; /* squared distance from the pixel, px^2 */
    int px, py;
};

INLINE struct tap_position tap_position(const struct block *b, int j, const struct centre *c, const struct skewed *l)
{
    const int py = b->stride * j;
    const float exact = -b->skew * (float) py;
    const int px = exact < 0.0f ? -(int) (0.5f - exact) : (int) (exact + 0.5f);
    const float ox = (float) px, oy = (float) py, off_line = ox - exact;

    return (struct tap_position) { (2.0f * ox) * c->tan[0] + (2.0f * oy) * c->tan[1], l->across2 * (off_line * off_line), ox * ox + oy * oy,
                                   px, py };
}

INLINE struct tap_position opposite(const struct tap_position *p)
{
    return (struct tap_position) { -p->cross_term, p->off_line2, p->distance2_px, -p->px, -p->py };
}

/* `x` is the block's. Taps outside of translucent surface are redirected to an empty pixel. */
INLINE void skewed_tap(const struct screen_work *w, const struct around *a, int x, struct tap_position p, const struct centre *c,
                       const struct skewed *l, bool several, struct gathered *g)
{
    const bool in = x + p.px + SCREEN_BLOCK > w->block0 * SCREEN_BLOCK && x + p.px < w->block1 * SCREEN_BLOCK;
    const ptrdiff_t at = (in ? p.px : (w->block0 - 1) * SCREEN_BLOCK - x) + p.py * w->stride;
    const vf z = load(a->depth + at), h = z * l->grow + l->shift, dz = (z - c->depth) * c->kernel_scale;
    const vf y = dz * (h * p.cross_term + dz * l->ray2) + h * h * p.distance2_px;

    weigh(a, at, vmax(y - p.off_line2, (vf) { 0 }), c, several, g);
}

INLINE void skewed_line(const struct screen_work *w, const struct around *a, vf across, const struct job *job, const struct centre *c,
                        bool several, struct gathered *g)
{
    const struct skewed l = { c->tan[0] * c->tan[0] + c->tan[1] * c->tan[1] + 1.0f, across * across, c->kernel_scale * w->depth_mm,
                              c->kernel_scale * w->fixed_mm };
    const int pairs = fewer(job->low, job->high), most = job->low < job->high ? job->high : job->low;

    for (int j = 1; j <= pairs; j++) {
        const struct tap_position p = tap_position(&job->b, j, c, &l);
        skewed_tap(w, a, job->x, opposite(&p), c, &l, several, g);
        skewed_tap(w, a, job->x, p, c, &l, several, g);
    }
    for (int j = pairs + 1; j <= most; j++)
        skewed_tap(w, a, job->x, tap_position(&job->b, job->low > job->high ? -j : j, c, &l), c, &l, several, g);
}

/* --- Blocks -------------------------------------------------------------------------------------------------------------------- */

/* Sums a block's taps. */
INLINE void gather(const struct screen_work *w, int y, int axis, bool skews, bool several, bool parallel, const float *const row[3],
                   struct job *job)
{
    for (int part = 0; part < SCREEN_BLOCK; part += WIDTH) {
        const size_t at = (size_t) (y * w->stride + job->x + part);
        const struct centre c = {
            .key = load(w->key + at),
            .depth = load(w->depth + at),
            .kernel_scale = load(job->kernel_scale + part),
            .tan = { load(w->columns_tan + job->x + part), (vf) { 0 } + w->rows_tan[y] },
        };
        const struct around a = {
            w->key + at, w->depth + at, w->length[axis] + at, { row[0] + job->x + part, row[1] + job->x + part, row[2] + job->x + part }
        };
        struct gathered g = { { 0 }, { { 0 }, { 0 }, { 0 } } };

        if (skews)
            skewed_line(w, &a, load(w->length[0] + at) * c.kernel_scale, job, &c, several, &g);
        else
            upright(w, &a, axis, job, &c, several, parallel, &g);
        store(job->weight + part, g.weight);
        for (int i = 0; i < 3; i++)
            store(&job->light[i][part], g.light[i]);
    }
}

/* Separate functions, so that registers are allocated for one loop at a time. */
void PELL_SIMD(screen_gather_along_x)(const struct screen_work *w, int y, const float *const row[3], struct job *job)
{
    gather(w, y, 0, false, false, false, row, job);
}

void PELL_SIMD(screen_gather_along_y)(const struct screen_work *w, int y, const float *const row[3], struct job *job)
{
    gather(w, y, 1, false, false, false, row, job);
}

void PELL_SIMD(screen_gather_skewed)(const struct screen_work *w, int y, const float *const row[3], struct job *job)
{
    gather(w, y, 1, true, false, false, row, job);
}

void PELL_SIMD(screen_gather_any)(const struct screen_work *w, int y, int axis, const float *const row[3], struct job *job)
{
    if (axis == 1 && job->b.skew != 0.0f)
        gather(w, y, 1, true, true, false, row, job);
    else
        gather(w, y, axis, false, true, w->depth_mm == 0.0f, row, job);
}
