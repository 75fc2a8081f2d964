/* SPDX-License-Identifier: MIT
 *
 * kernels.c - the inner loops of the screen-space method; compiled once per level of base/simd.h. The mathematics is in README.md.
 *
 * Vectors are the compiler's generic ones, as wide as the machine's registers. All levels give the same bits: a pixel's operations
 * and their order do not depend on the width.
 */
#include "methods/screen_space/kernels.h"

#include "base/simd.h"
#include "math/lanes.h"
#include "render/material_id.h"

#include <math.h>
#include <string.h>

INLINE int fewer(int a, int b)
{
    return a < b ? a : b;
}

/* Of a block's lanes, by halves. */
typedef float v8 __attribute__((vector_size(32)));
typedef float v4 __attribute__((vector_size(16)));
typedef int32_t i8 __attribute__((vector_size(32)));
typedef int32_t i4 __attribute__((vector_size(16)));

INLINE float top(const float *v)
{
    v8 a, b;
    v4 c, d;
    i8 more;
    i4 more4;

    memcpy(&a, v, sizeof(a));
    memcpy(&b, v + 8, sizeof(b));
    more = a > b;
    a = (v8) (((i8) a & more) | ((i8) b & ~more));
    memcpy(&c, &a, sizeof(c));
    memcpy(&d, (const char *) &a + sizeof(c), sizeof(d));
    more4 = c > d;
    c = (v4) (((i4) c & more4) | ((i4) d & ~more4));
    c[0] = c[0] > c[2] ? c[0] : c[2];
    c[1] = c[1] > c[3] ? c[1] : c[3];
    return c[0] > c[1] ? c[0] : c[1];
}

INLINE float sum_of(const float *v)
{
    v8 a, b;
    v4 c, d;

    memcpy(&a, v, sizeof(a));
    memcpy(&b, v + 8, sizeof(b));
    a += b;
    memcpy(&c, &a, sizeof(c));
    memcpy(&d, (const char *) &a + sizeof(c), sizeof(d));
    c += d;
    return (c[0] + c[2]) + (c[1] + c[3]);
}

/* --- The kernel ---------------------------------------------------------------------------------------------------------------- */

/* A Gaussian of compact support: K(t) = q(t^2/16) - q(0.7225), q(y) = (1 + B1 y + B2 y^2)^8, for |t| < 3.4 and 0 beyond. B1 and B2 make
 * its integral function differ from the Gaussian's of the same variance by 0.00074 at most. Its integral and variance are exact in the
 * constants that follow, so that a blur has the standard deviation asked for. */
/* B1 = -1.08, B2 = 0.646. For y' = sqrt(B2) y the polynomial is a square: q = ((y' + Y_SHIFT)^2 + Q_LEAST)^8. */
#define Y_MAX 0.580703054f    /* 0.7225 sqrt(B2) */
#define Y_SHIFT -0.671858012f /* B1 / (2 sqrt(B2)) */
#define Q_LEAST 0.548606811f  /* 1 - B1^2 / (4 B2) */
/* Taps stand no further apart than this, px, while that makes no more than so many a side: where taps begin to miss or to meet a surface,
 * at silhouettes, wide gaps show as echoes of the edge. */
#define STRIDE_DENSE 2.0f
#define JUMP 4.0f   /* change of depth from a pixel to the next, in pixels' sizes, that may be a silhouette */
#define CREASE 0.5f /* change of that change which wide gaps would miss */
#define TAPS_DENSE 48.0f
#define K_NORM 0.401802782f       /* sqrt(variance) / integral */
#define K_SCALE_ROOT 0.214667712f /* sqrt(sqrt(B2) variance / 16) */
#define K_REACH 3.549853f         /* 3.4 / sqrt(variance): the support in standard deviations */
/* Under 0.6 pixels a sampled Gaussian loses variance. Such a blur is the one of 0.6 pixels, mixed with the unblurred pixel. */
#define S2_MIN 0.36f
#define S2_MIN_VARIANCE 0.347397f /* that K, sampled at whole pixels, has there */

/* Variance in px^2 on the grid of pixels that stands for a Gaussian of variance u, for light that is constant over each pixel: u + 1/12
 * for large u, and 0 for u = 0. Near Sum_j j^2 (Phi((j + 1/2)/sqrt(u)) - Phi((j - 1/2)/sqrt(u))). The form is
 * (u + 1/12) u^3/(u^3 + G1) + G2 u^3/(u^4 + G3), over one divisor, up to WIDE, and u + a constant beyond; its constants make the largest
 * error of a half-lit plane smallest over the published skin and marble profiles and a single Gaussian, at all scales. */
#define G1 4.678e-4f
#define G2 0.01327f
#define G3 0.01634f
#define WIDE 16.0f

struct ratio {
    vf over, under, rest;
};

INLINE struct ratio grid_ratio(vf u)
{
    const vf low = lesser(u, (vf) { 0 } + WIDE), u2 = low * low, u3 = u2 * low, u4 = u2 * u2, a = u3 + G1, b = u4 + G3;
    return (struct ratio) { u3 * ((low + 1.0f / 12.0f) * b + G2 * a), a * b, u - low };
}

INLINE vf grid_variance(vf u)
{
    const struct ratio r = grid_ratio(u);
    return r.over / r.under + r.rest;
}

/* grid_variance(u1) - grid_variance(u0), with one division. */
INLINE vf grid_difference(vf u1, vf u0)
{
    const struct ratio r1 = grid_ratio(u1), r0 = grid_ratio(u0);
    return (r1.over * r0.under - r0.over * r1.under) / (r1.under * r0.under) + (r1.rest - r0.rest);
}

/* What the taps of a block need to know. */
struct block {
    bool uniform;                                                   /* all lanes have the same variances */
    bool wide;                                                      /* and they are far above a pixel's */
    bool bare;                                                      /* and nothing was blurred before */
    float after, before;                                            /* then: mm^2 after and before the step */
    _Alignas(64) float afters[SCREEN_BLOCK], befores[SCREEN_BLOCK]; /* else */
    int active;                                                     /* lanes that are blurred */
    int count, stride;                                              /* taps on each side, and their distance in pixels */
    float skew;                                                     /* of the line of taps along y, see struct screen_cell */
};

/* Variance that the chain reaches with `step`, in mm^2. */
INLINE float variance_of(const struct screen_work *w, int step, int owner)
{
    return w->variance[(size_t) step * (w->num_materials + 1) + (size_t) owner];
}

/* Variance before the running step where a material's pixels have this scale; returns whether the step blurs them. */
INLINE bool applied(const struct screen_work *w, int owner, float scale, float *before)
{
    float last = 0.0f;

    for (int step = 0; step < w->step; step++) {
        const float v = variance_of(w, step, owner);
        last = (v - last) * scale > w->skip ? v : last;
    }
    *before = last;
    return (variance_of(w, w->step, owner) - last) * scale > w->skip;
}

/* Which lanes the step blurs, and by what. False where it blurs none. */
INLINE bool choose(const struct screen_work *w, size_t index, const struct screen_cell *cell, struct block *b)
{
    const float *scale = &w->scale[index], *key = &w->key[index];
    bool low, high;
    float before;

    b->uniform = false;
    b->active = 0;
    if (cell->owner != SCREEN_MIXED) {
        /* Most blocks are blurred by each step so far. */
        if (cell->pixels > 0 && w->least_added[(size_t) w->step * (w->num_materials + 1) + cell->owner] * cell->scale[0] > w->skip) {
            b->uniform = true;
            b->before = w->step > 0 ? variance_of(w, w->step - 1, cell->owner) : 0.0f;
            b->after = variance_of(w, w->step, cell->owner);
            b->active = cell->pixels;
            return true;
        }
        /* Each choice depends on the scale monotonically: where the extremes agree in all of them, so do the lanes between. */
        low = applied(w, cell->owner, cell->scale[0], &before);
        high = applied(w, cell->owner, cell->scale[1], &b->before);
        if (low == high && before == b->before) {
            b->uniform = true;
            b->after = high ? variance_of(w, w->step, cell->owner) : 0.0f;
            b->active = high ? cell->pixels : 0;
            return high;
        }
    }
    for (int l = 0; l < SCREEN_BLOCK; l++) {
        const bool on = applied(w, (int) key[l], scale[l], &before);
        b->active += on;
        b->afters[l] = on ? variance_of(w, w->step, (int) key[l]) : 0.0f;
        b->befores[l] = on ? before : 0.0f;
    }
    return b->active > 0;
}

/* Whether a line of taps stays in smooth blocks. Those of a leaning line are within the columns that it runs through. */
INLINE bool is_clear(const struct screen_work *w, int block, int axis, const struct screen_cell *cell, float skew, float reach)
{
    int beside;

    if (!(reach < (float) cell->clear[axis]))
        return false;
    if (axis == 0 || skew == 0.0f)
        return true;
    beside = (int) (fabsf(skew) * reach * (1.0f / SCREEN_BLOCK)) + 1;
    if (block - beside < w->block0 || block + beside >= w->block1)
        return false;
    for (int k = -beside; k <= beside; k++)
        if (!(reach < (float) cell[k].clear[1]))
            return false;
    return true;
}

/* How many taps, how far apart. */
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
    most += 0.1f; /* what the grid adds at most */
    reach = K_REACH * sqrtf(most > S2_MIN ? most : S2_MIN);
    b->skew = fabsf(cell->skew) * reach < 0.5f ? 0.0f : cell->skew; /* under half a pixel to the side all taps are upright */
    /* Taps may stand 1.5 standard deviations apart of what is blurred already: aliasing is under 2e-4 of a step, then. */
    step = 1.5f * sqrtf(least);
    dense = is_clear(w, block, axis, cell, b->skew, reach) ? reach : reach > STRIDE_DENSE * TAPS_DENSE ? reach / TAPS_DENSE : STRIDE_DENSE;
    step = step < dense ? step : dense;
    b->stride = step >= 2.0f ? (step < 65536.0f ? (int) step : 65536) : 1;
    b->count = reach < 262144.0f ? (int) (reach / (float) b->stride) : 262144;
}

/* Blocks of a row go through three stages, a few at a time: what they need to know, their taps, the end. Each block is a chain of
 * operations that wait for one another (divisions, roots); the processor works on several only where they stand close together. */
enum { JOBS = 8 };

struct job {
    const struct screen_cell *cell;
    int x, low, high; /* the block's first pixel; taps on either side that are inside */
    struct block b;
    _Alignas(64) float fall[SCREEN_BLOCK], share[SCREEN_BLOCK];      /* see struct centre; of a tap's weight in what comes out */
    _Alignas(64) float weight[SCREEN_BLOCK], light[3][SCREEN_BLOCK]; /* gathered */
};

struct gathered {
    vf weight, light[3];
};

/* The planes, at a pixel. */
struct around {
    const float *key, *depth, *length, *light[3];
};

struct centre {
    vf key, depth;
    vf fall;   /* sqrt(y') per mm */
    vf tan[2]; /* x/f and y/f of the pixel's ray */
};

/* q of y' + Y_SHIFT. */
INLINE float kernel_of(float shifted)
{
    float q = shifted * shifted + Q_LEAST;
    q *= q;
    q *= q;
    return q * q;
}

/* Adds a tap whose distance gives y' = `y`: the weight is K times the length that its pixel covers. */
INLINE void weigh(const struct around *a, ptrdiff_t at, vf y, const struct centre *c, bool several, struct gathered *g)
{
    const vf shifted = lesser(y, (vf) { 0 } + Y_MAX) + Y_SHIFT;
    vf q = shifted * shifted + Q_LEAST, weight;

    q *= q;
    q *= q;
    weight = (q * q - kernel_of(Y_MAX + Y_SHIFT)) * load(a->length + at);
    if (several)
        weight = (vf) ((vi) weight & (load(a->key + at) == c->key));
    g->weight += weight;
    for (int i = 0; i < 3; i++)
        g->light[i] += weight * load(a->light[i] + at);
}

/* A side's next tap. */
struct lane_taps {
    ptrdiff_t at;
    vf slope, fixed;
};

INLINE void upright_tap(const struct around *a, struct lane_taps *side, ptrdiff_t step, vf grow, vf shift, vf aslant2,
                        const struct centre *c, bool several, bool parallel, struct gathered *g)
{
    vf z, along, dz;

    side->at += step;
    if (parallel)
        side->fixed += shift;
    else
        side->slope += grow;
    z = load(a->depth + side->at);
    along = z * side->slope + side->fixed;
    dz = z - c->depth;
    weigh(a, side->at, along * along + dz * dz * aslant2, c, several, g);
}

/* The taps of a block's pixels; those of the two sides in pairs, as most blocks have as many. Between the points of two pixels lies
 * h (x, y, 0) + dz (tx, ty, 1), with h = mm per pixel at the tap; its length, squared, is that along the axis squared and
 * dz^2 (1 + t^2), t of the other axis. The first is linear in the tap's z. */
INLINE void upright(const struct screen_work *w, const struct around *a, int axis, const struct job *job, const struct centre *c,
                    bool several, bool parallel, struct gathered *g)
{
    const float pace = (float) job->b.stride;
    const ptrdiff_t step = job->b.stride * (axis == 0 ? 1 : w->stride);
    const vf other = c->tan[1 - axis], aslant2 = c->fall * c->fall * (other * other + 1.0f);
    const vf grow = c->fall * (pace * w->depth_mm), shift = c->fall * (pace * w->fixed_mm);
    const vf slope = c->fall * c->tan[axis], fixed = (vf) { 0 } - c->depth * slope;
    const int pairs = fewer(job->low, job->high);
    struct lane_taps back = { 0, slope, fixed }, preblur = back; /* left of the first pixel lies the padding */

    for (int j = 0; j < pairs; j++) {
        upright_tap(a, &back, -step, -grow, -shift, aslant2, c, several, parallel, g);
        upright_tap(a, &preblur, step, grow, shift, aslant2, c, several, parallel, g);
    }
    for (int j = pairs; j < job->low; j++)
        upright_tap(a, &back, -step, -grow, -shift, aslant2, c, several, parallel, g);
    for (int j = pairs; j < job->high; j++)
        upright_tap(a, &preblur, step, grow, shift, aslant2, c, several, parallel, g);
}

/* The same down a line that leans: x falls by b->lean pixels as y grows by one. The two taps of a pair lie opposite each other. */
struct leaning {
    vf ray2, across2, grow, shift;
};

struct lean_place {
    vf aslant;    /* 2 (x tx + y ty) */
    vf beside2;   /* from the line that the tap stands for, along x */
    float apart2; /* from the pixel, px^2 */
    int px, py;
};

INLINE struct lean_place lean_place(const struct block *b, int j, const struct centre *c, const struct leaning *l)
{
    const int py = b->stride * j;
    const float exact = -b->skew * (float) py;
    const int px = exact < 0.0f ? -(int) (0.5f - exact) : (int) (exact + 0.5f);
    const float ox = (float) px, oy = (float) py, beside = ox - exact;

    return (struct lean_place) { (2.0f * ox) * c->tan[0] + (2.0f * oy) * c->tan[1], l->across2 * (beside * beside), ox * ox + oy * oy, px,
                                 py };
}

/* `x` is the block's. Taps beside what is translucent are moved to where there is nothing. */
INLINE void leaning_tap(const struct screen_work *w, const struct around *a, int x, int px, int py, vf aslant,
                        const struct lean_place *place, const struct centre *c, const struct leaning *l, bool several, struct gathered *g)
{
    const bool in = x + px + SCREEN_BLOCK > w->block0 * SCREEN_BLOCK && x + px < w->block1 * SCREEN_BLOCK;
    const ptrdiff_t at = (in ? px : (w->block0 - 1) * SCREEN_BLOCK - x) + py * w->stride;
    const vf z = load(a->depth + at), h = z * l->grow + l->shift, fall = (z - c->depth) * c->fall;
    const vf y = fall * (h * aslant + fall * l->ray2) + h * h * place->apart2;

    weigh(a, at, greater(y - place->beside2, (vf) { 0 }), c, several, g);
}

INLINE void skewed_line(const struct screen_work *w, const struct around *a, vf across, const struct job *job, const struct centre *c,
                        bool several, struct gathered *g)
{
    const struct leaning l = { c->tan[0] * c->tan[0] + c->tan[1] * c->tan[1] + 1.0f, across * across, c->fall * w->depth_mm,
                               c->fall * w->fixed_mm };
    const int pairs = fewer(job->low, job->high), most = job->low < job->high ? job->high : job->low;

    for (int j = 1; j <= pairs; j++) {
        const struct lean_place p = lean_place(&job->b, j, c, &l);
        leaning_tap(w, a, job->x, -p.px, -p.py, -p.aslant, &p, c, &l, several, g);
        leaning_tap(w, a, job->x, p.px, p.py, p.aslant, &p, c, &l, several, g);
    }
    for (int j = pairs + 1; j <= most; j++) {
        const struct lean_place p = lean_place(&job->b, job->low > job->high ? -j : j, c, &l);
        leaning_tap(w, a, job->x, p.px, p.py, p.aslant, &p, c, &l, several, g);
    }
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
        const vf inverse = one / (root(greater(add, zero + S2_MIN)) * a), mix = greater(lesser(add * (1.0f / S2_MIN_VARIANCE), one), zero);

        store(job->fall + part, inverse * K_SCALE_ROOT);
        store(job->share + part, inverse * mix * (K_NORM * (float) b->stride));
    }
}

/* Sums up a block's taps. */
INLINE void gather(const struct screen_work *w, int y, int axis, bool skews, bool several, bool parallel, const float *const row[3],
                   struct job *job)
{
    for (int part = 0; part < SCREEN_BLOCK; part += WIDTH) {
        const size_t at = (size_t) (y * w->stride + job->x + part);
        const struct centre c = {
            .key = load(w->key + at),
            .depth = load(w->depth + at),
            .fall = load(job->fall + part),
            .tan = { load(w->columns_tan + job->x + part), (vf) { 0 } + w->rows_tan[y] },
        };
        const struct around a = {
            w->key + at, w->depth + at, w->length[axis] + at, { row[0] + job->x + part, row[1] + job->x + part, row[2] + job->x + part }
        };
        struct gathered g = { { 0 }, { { 0 }, { 0 }, { 0 } } };

        if (skews)
            skewed_line(w, &a, load(w->length[0] + at) * c.fall, job, &c, several, &g);
        else
            upright(w, &a, axis, job, &c, several, parallel, &g);
        store(job->weight + part, g.weight);
        for (int i = 0; i < 3; i++)
            store(&job->light[i][part], g.light[i]);
    }
}

/* Functions of their own: registers are dealt out for their loops alone. */
static __attribute__((noinline)) void gather_along_x(const struct screen_work *w, int y, const float *const row[3], struct job *job)
{
    gather(w, y, 0, false, false, false, row, job);
}

static __attribute__((noinline)) void gather_along_y(const struct screen_work *w, int y, const float *const row[3], struct job *job)
{
    gather(w, y, 1, false, false, false, row, job);
}

static __attribute__((noinline)) void gather_leaning(const struct screen_work *w, int y, const float *const row[3], struct job *job)
{
    gather(w, y, 1, true, false, false, row, job);
}

static __attribute__((noinline)) void gather_any(const struct screen_work *w, int y, int axis, const float *const row[3], struct job *job)
{
    if (axis == 1 && job->b.skew != 0.0f)
        gather(w, y, 1, true, true, false, row, job);
    else
        gather(w, y, axis, false, true, w->depth_mm == 0.0f, row, job);
}

/* What comes out of a block. Light that a tap would have brought but does not (it is outside, of another material, or too far along the
 * surface) stays where it is: a pixel keeps 1 - Sum of weights of its own. */
INLINE void settle(const struct job *job, const float *const row[3], float (*restrict result)[SCREEN_BLOCK])
{
    const vf one = (vf) { 0 } + 1.0f;

    for (int part = 0; part < SCREEN_BLOCK; part += WIDTH) {
        vf share = load(job->share + part);
        const vf weight = load(job->weight + part) * share;
        vf keep = one - weight;

        if (any(weight > one)) { /* where lengths vary too fast what would be kept is negative */
            share = share / greater(weight, one);
            keep = greater(keep, (vf) { 0 });
        }
        for (int i = 0; i < 3; i++)
            store(&result[i][part], load(&job->light[i][part]) * share + keep * load(row[i] + job->x + part));
    }
}

/* --- The paper's taps ---------------------------------------------------------------------------------------------------------- */

/* Span in pixels over that of a facing surface. */
INLINE float paper_slope(const struct screen_work *w, size_t index, int x, int y, int axis)
{
    const float d = w->depth[index];
    float change, level;

    if (!(w->forms & SCREEN_FORM_PAPER_SLOPE)) {
        const float mm = d * w->depth_mm + w->fixed_mm;
        return w->length[axis][index] > 0.0f ? mm / w->length[axis][index] : 0.0f;
    }
    /* Derivatives are those of a quad of 2 x 2 pixels. Where the other pixel is not of this surface, the limit: the depth behind it is
     * far away. */
    {
        const ptrdiff_t other = axis == 0 ? ((x & 1) ? -1 : 1) : ((y & 1) ? -w->stride : w->stride);
        const ptrdiff_t at = (ptrdiff_t) index + other;
        change = w->key[at] == w->key[index] ? fabsf(w->depth[at] - d) * w->unit : w->maxdd;
    }
    if (change > w->maxdd)
        change = w->maxdd;
    level = w->in->shape.orthographic ? 1.0f : d * w->unit;
    return level / (level + w->correction * change);
}

/* Listing 7.1 with taps outside the mask left out: seven bilinear taps over +-span. */
INLINE int gather_listing(const struct screen_work *w, size_t index, int x, int y, int axis, const struct screen_cell *cell,
                          const float *const row[3], float (*restrict result)[SCREEN_BLOCK], float *restrict on)
{
    static const float weights[7] = { 0.006f, 0.061f, 0.242f, 0.382f, 0.242f, 0.061f, 0.006f };
    const int low = axis == 0 ? w->block0 * SCREEN_BLOCK : w->in->rect.y0, high = axis == 0 ? w->block1 * SCREEN_BLOCK : w->in->rect.y1;
    const int here = axis == 0 ? x : y;
    const ptrdiff_t pace = axis == 0 ? 1 : w->stride;
    struct block b;
    const bool any = choose(w, index, cell, &b);

    for (int l = 0; l < SCREEN_BLOCK; l++)
        on[l] = any && w->scale[index + (size_t) l] > 0.0f && (b.uniform || b.afters[l] > 0.0f) ? 1.0f : 0.0f;
    for (int l = 0; any && l < SCREEN_BLOCK; l++) {
        const size_t at = index + (size_t) l;
        const int place = axis == 0 ? here + l : here;
        float sum[3] = { 0 }, all = 0.0f, span;

        for (int i = 0; i < 3; i++)
            result[i][l] = row[i][x + l];
        if (!(on[l] > 0.0f))
            continue;
        span = SCREEN_SPAN * sqrtf((b.uniform ? b.after - b.before : b.afters[l] - b.befores[l]) * w->scale[at]);
        span *= paper_slope(w, at, x + l, y, axis);
        if (span > 262144.0f)
            span = 262144.0f;
        for (int t = 0; t < 7; t++) {
            const float offset = (float) (t - 3) * (1.0f / 3.0f) * span, whole = floorf(offset), part = offset - whole;
            const float share[2] = { weights[t] * (1.0f - part), weights[t] * part };

            for (int k = 0; k < 2; k++) {
                const int step = (int) whole + k;
                if (place + step < low || place + step >= high || w->key[(ptrdiff_t) at + step * pace] != w->key[at])
                    continue;
                all += share[k];
                for (int i = 0; i < 3; i++)
                    sum[i] += share[k] * row[i][x + l + step * pace];
            }
        }
        for (int i = 0; i < 3; i++)
            result[i][l] = sum[i] / all;
    }
    return b.active;
}

/* --- Rows ---------------------------------------------------------------------------------------------------------------------- */

INLINE struct screen_cell *cell_at(const struct screen_work *w, int block, int y)
{
    return &w->cells[(size_t) y * (size_t) w->blocks + (size_t) block];
}

/* Looks at the materials of a block, of which lanes x0 to x1 lie in the rectangle. */
INLINE void find_owners(const struct screen_work *w, ptrdiff_t from, int x0, int x1, float *restrict owners, struct screen_cell *cell,
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
            owners[l] = (float) first;
    } else {
        for (int l = x0; l < x1; l++) {
            const int m = pell_material_id(w->in, from + l);
            first = m > 0 && (first == 0 || m < first) ? m : first;
            last = m > last ? m : last;
            owners[l] = (float) m;
            count += m > 0;
        }
    }
    *low = first;
    *high = last;
    *cell = (struct screen_cell) { .live = count == 0              ? SCREEN_EMPTY
                                           : count == SCREEN_BLOCK ? SCREEN_FULL
                                                                   : SCREEN_SOME,
                                   .owner = first == last ? (uint16_t) first : SCREEN_MIXED,
                                   .pixels = (uint8_t) count };
}

/* Rows are too short for the processor to foresee their next lines, and there are many planes: each block asks for what the one below it
 * will read, and for what it will write. */
PELL_FETCHING_INLINE void fetch3_to_write(float *const plane[3], size_t at)
{
    for (int i = 0; i < 3; i++)
        pell_fetch_to_write(plane[i] + at);
}

/* Copies a block of the caller's planes. */
INLINE void load_block(const struct screen_work *w, int x, int y, int x0, int x1, struct screen_cell *cell, struct screen_seen *seen)
{
    const struct pell_frame *in = w->in;
    const size_t to = (size_t) (y * w->stride + x);
    const ptrdiff_t from = y * in->shape.stride + x;
    const vf zero = { 0 }, one = zero + 1.0f;
    _Alignas(64) float owner[SCREEN_BLOCK] = { 0 }, z[SCREEN_BLOCK] = { 0 }, part[SCREEN_BLOCK], most[SCREEN_BLOCK], least[SCREEN_BLOCK];
    int first, last, count = 0;

    find_owners(w, from, x0, x1, owner, cell, &first, &last);
    memcpy(&w->key[to], owner, sizeof(owner));
    if (cell->live == SCREEN_EMPTY) {
        memcpy(&w->depth[to], z, sizeof(z));
        return;
    }
    for (int l = 0; l < SCREEN_BLOCK; l++)
        part[l] = 1.0f;
    if (cell->live == SCREEN_FULL) {
        memcpy(z, in->depth + from, sizeof(z));
        if (in->strength)
            memcpy(part, in->strength + from, sizeof(part));
    } else {
        for (int l = x0; l < x1; l++) {
            z[l] = owner[l] > 0.0f ? in->depth[from + l] : 0.0f;
            part[l] = owner[l] > 0.0f && in->strength ? in->strength[from + l] : 1.0f;
        }
    }
    for (int lane = 0; lane < SCREEN_BLOCK; lane += WIDTH) {
        const vf depth = load(z + lane), strength = load(part + lane);
        const vi good = (depth > zero) & (depth < 1e12f);
        const vf d = select(good, depth, zero), mm = d * w->depth_mm + w->fixed_mm, s = lesser(strength, one);
        const vf size = lesser(s * s * w->ratio2 / select(good, mm * mm, one), zero + 1e30f);
        const vf scale = select(good & (strength > zero), size, zero);
        store(&w->depth[to + (size_t) lane], d);
        store(&w->scale[to + (size_t) lane], scale);
        count += __builtin_popcount(members(scale > zero));
        store(most + lane, scale);
        store(least + lane, select(scale > zero, zero - scale, zero - 1e30f));
    }
    cell->pixels = (uint8_t) count;
    cell->scale[0] = -top(least);
    cell->scale[1] = top(most);
    for (int i = 0; i < 3; i++) {
        float *light = &w->now[i][to];
        if (cell->live == SCREEN_FULL && cell->owner != SCREEN_MIXED) {
            for (int lane = 0; lane < SCREEN_BLOCK; lane += WIDTH)
                store(light + lane, load(w->light[i] + from + lane) * w->total[first][i]);
        } else {
            memset(light, 0, SCREEN_BLOCK * sizeof(float));
            for (int l = x0; l < x1; l++)
                if (owner[l] > 0.0f)
                    light[l] = w->light[i][from + l] * w->total[(int) owner[l]][i];
        }
    }
    seen->first = seen->first == 0 || first < seen->first ? first : seen->first;
    seen->last = last > seen->last ? last : seen->last;
    seen->pixels += count;
    seen->scale = cell->scale[1] > seen->scale ? cell->scale[1] : seen->scale;
}

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

static PELL_FETCHING void load_row(const struct screen_work *w, int y, struct screen_seen *seen)
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
        if (cell_at(w, b, y)->live != SCREEN_EMPTY) {
            extent->begin = fewer(extent->begin, b);
            extent->end = b + 1;
        }
    }
}

#define LEAN_MIN 0.015625f /* pixels of x per pixel of y: less is as good as upright */
#define LEAN_MAX 8.0f
#define LEAN_FADE 8       /* blocks */
#define LEAN_CHANGE 0.08f /* from a block to the next: more is no plane */

/* Change of depth per pixel from its one-sided differences: the central difference, but at most twice the smaller of the two (the
 * monotonised central limiter of van Leer 1977), so that a jump in depth beside the pixel does not count as its slope. */
INLINE vf limited(vf back, vf preblur, vi has_back, vi has_preblur)
{
    const vf zero = { 0 }, a = select(has_back, back, preblur), b = select(has_preblur, preblur, back);
    const vf size_a = select(a < zero, -a, a), size_b = select(b < zero, -b, b), least = 2.0f * select(size_a < size_b, size_a, size_b);
    const vf mean = 0.5f * (a + b), size = select(mean < zero, -mean, mean), low = select(size < least, size, least);
    const vi slopes = (has_back | has_preblur) & (a * b > zero);

    return select(slopes, select(mean < zero, -low, low), zero);
}

/* Lets leans be where they hardly change along the row, and fades them out within LEAN_FADE blocks of where they do: a lean is one number
 * for a block, since lanes of a vector read the same row, and blocks that lean differently would show as steps in the picture. So
 * planes have round Gaussians however they slant; curved surfaces have upright second passes. cell->to_px[0][0] holds the raw leans. */
static void fade_leans(const struct screen_work *w, int y)
{
    enum { AT_ONCE = 48, MORE = AT_ONCE + 2 * LEAN_FADE };
    const int begin = w->extents[y].begin, end = w->extents[y].end;

    for (int first = begin; first < end; first += AT_ONCE) {
        const int blocks = fewer(end - first, AT_ONCE);
        float change[MORE], worst[AT_ONCE] = { 0 }; /* change[i]: from block first - LEAN_FADE + i to the next */

        for (int i = 0; i < MORE; i++) {
            const int at = first - LEAN_FADE + i;
            const bool within_row = at >= begin && at + 1 < end && i < blocks + 2 * LEAN_FADE;
            const struct screen_cell *cell = cell_at(w, within_row ? at : begin, y);
            const float by = within_row ? fabsf(cell[1].to_px[0][0] - cell->to_px[0][0]) * (1.0f / LEAN_CHANGE) : 0.0f;
            change[i] = !within_row || cell->live == SCREEN_EMPTY || cell[1].live == SCREEN_EMPTY ? 0.0f : by < 1.0f ? by : 1.0f;
        }
        for (int k = 1 - LEAN_FADE; k < LEAN_FADE; k++) {
            const float near = 1.0f - (float) (k < 0 ? -k - 1 : k) * (1.0f / LEAN_FADE);
            for (int i = 0; i < AT_ONCE; i++)
                worst[i] = change[LEAN_FADE + i + k] * near > worst[i] ? change[LEAN_FADE + i + k] * near : worst[i];
        }
        for (int i = 0; i < blocks; i++) {
            struct screen_cell *cell = cell_at(w, first + i, y);
            if (cell->live == SCREEN_EMPTY)
                continue;
            cell->skew = cell->to_px[0][0] * (1.0f - worst[i]);
            if (cell->skew < LEAN_MIN && cell->skew > -LEAN_MIN)
                cell->skew = 0.0f;
        }
    }
}

/* The two directions of the passes on the surface: Tx, from a pixel to the next along x, and D = Ty - lean Tx at right angles to it, so
 * that two passes make a round Gaussian on a surface of any slope. First Tx.Tx, Ty.Ty and Tx.Ty of each pixel, in the planes that their
 * lengths will take, and the mean lean of each block; then the lengths of Tx and D. */
static PELL_FETCHING void measure_row(const struct screen_work *w, int y)
{
    const vf zero = { 0 }, one = zero + 1.0f;
    const float ty = w->rows_tan[y], ty2 = 1.0f + ty * ty;

    for (int block = w->block0; block < w->block1; block++) {
        struct screen_cell *cell = cell_at(w, block, y);
        const size_t index = (size_t) (y * w->stride + block * SCREEN_BLOCK);
        const size_t below = index + (size_t) w->stride, next = below + (size_t) w->stride; /* there is a margin */
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
        if (cell->live == SCREEN_EMPTY) {
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
            const vf x2 = mm * (mm + dx * (tx + tx)) + dx * dx * ray2, y2 = mm * (mm + dy * (2.0f * ty)) + dy * dy * ray2;
            const vf both = dx * dy * ray2 + mm * (dx * ty + dy * tx);
            const vi on = (own > zero) & (z > zero) & (x2 > zero) & (y2 > zero);
            const vf crease = mm * CREASE;
            rough |= (magnitude(left) > jump) | (magnitude(right) > jump) | (magnitude(above) > jump) | (magnitude(under) > jump) |
                     (magnitude(right - left) > crease) | (magnitude(under - above) > crease);
            store(w->length[0] + at, select(on, x2, zero));
            store(w->length[1] + at, select(on, y2, zero));
            store(w->to_px[0] + at, select(on, both, zero));
            store(skews + part, select(on, both / select(on, x2, one), zero));
        }
        cell->smooth = cell->live == SCREEN_FULL && cell->owner != SCREEN_MIXED && !any(rough);
        mean = cell->pixels > 0 ? sum_of(skews) / (float) cell->pixels : 0.0f;
        cell->to_px[0][0] = mean < LEAN_MAX ? (mean > -LEAN_MAX ? mean : -LEAN_MAX) : LEAN_MAX;
    }
    fade_leans(w, y);
    for (int block = w->extents[y].begin; block < w->extents[y].end; block++) {
        struct screen_cell *cell = cell_at(w, block, y);
        const size_t index = (size_t) (y * w->stride + block * SCREEN_BLOCK);
        _Alignas(64) float most[2][SCREEN_BLOCK], least[2][SCREEN_BLOCK];

        if (cell->live == SCREEN_EMPTY)
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
                store(w->length[axis] + at, root(select(on, size2, zero)));
                store(w->to_px[axis] + at, to_px);
                store(most[axis] + part, to_px);
                store(least[axis] + part, select(to_px > zero, zero - to_px, zero - 1e30f));
            }
        }
        for (int axis = 0; axis < 2; axis++) {
            cell->to_px[axis][0] = -top(least[axis]);
            cell->to_px[axis][1] = top(most[axis]);
        }
    }
}

/* Blends the step's result into the sum. Where a pixel left the step out, its weight goes to the last result, or, as in the paper (`on`),
 * to all that the sum holds. */
INLINE void put(const struct screen_work *w, int x, int y, size_t index, const struct screen_cell *cell,
                float (*restrict light)[SCREEN_BLOCK], const float *on)
{
    const size_t row = (size_t) w->step * (w->num_materials + 1);
    float *const *before = w->fresh ? w->now : w->sum;

    for (int i = 0; i < 3; i++) {
        _Alignas(64) float mixed[SCREEN_BLOCK], shares[SCREEN_BLOCK];

        if (cell->owner == SCREEN_MIXED)
            for (int l = 0; l < SCREEN_BLOCK; l++)
                shares[l] = w->blend[row + (size_t) w->key[index + (size_t) l]][i];
        for (int part = 0; part < SCREEN_BLOCK; part += WIDTH) {
            vf share = cell->owner == SCREEN_MIXED ? load(shares + part) : (vf) { 0 } + w->blend[row + cell->owner][i];
            if (on)
                share *= load(on + part);
            store(mixed + part, load(before[i] + index + part) * (1.0f - share) + load(&light[i][part]) * share);
        }
        if (!w->last) {
            memcpy(&w->sum[i][index], mixed, sizeof(mixed));
        } else {
            float *out = w->out->light[i] + y * w->in->shape.stride + x;
            if (cell->live == SCREEN_FULL)
                memcpy(out, mixed, sizeof(mixed));
            else
                for (int l = 0; l < SCREEN_BLOCK; l++)
                    if (w->key[index + (size_t) l] > 0.0f)
                        out[l] = mixed[l];
        }
    }
}

/* How many of a side's taps lie within so many pixels. */
INLINE int within(int pixels, const struct block *b)
{
    return (int64_t) b->count * b->stride <= pixels ? b->count : pixels / b->stride;
}

/* Where a block's taps are, and their scales. */
PELL_FETCHING_INLINE void prepare(const struct screen_work *w, int block, int y, int axis, const float *const from[3], float *const to[3],
                                  struct job *job)
{
    const struct screen_extent *extent = &w->extents[y];
    const int x = block * SCREEN_BLOCK;
    const size_t index = (size_t) (y * w->stride + x), below = index + (size_t) w->stride;
    int before, behind;

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
        fetch3_to_write(w->sum, below);
    }
    if ((w->forms & SCREEN_FORM_PAPER_EDGES) || !choose(w, index, job->cell, &job->b)) {
        job->b.active = 0;
        return;
    }
    space(w, index, block, axis, job->cell, &job->b);
    before = axis == 0 ? x + SCREEN_BLOCK - 1 - extent->begin * SCREEN_BLOCK : y - w->in->rect.y0;
    behind = axis == 0 ? extent->end * SCREEN_BLOCK - 1 - x : w->in->rect.y1 - 1 - y;
    job->low = within(before, &job->b);
    job->high = within(behind, &job->b);
    if (axis == 1 && (job->b.count + 1) * (int64_t) job->b.stride <= behind) { /* the row that the block below reaches for the first time */
        const ptrdiff_t reached = (job->b.count * job->b.stride + 1) * w->stride;
        __builtin_prefetch(w->depth + index + reached);
        __builtin_prefetch(w->length[1] + index + reached);
        for (int i = 0; i < 3; i++)
            __builtin_prefetch(from[i] + x + reached);
    }
    scale_kernel(w, index, axis, job);
}

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
            if (cell_at(w, block, y)->live != SCREEN_EMPTY)
                prepare(w, block, y, axis, from, to, &jobs[count++]);
        for (int k = 0; k < count; k++)
            if (jobs[k].b.active == 0)
                continue;
            else if (w->several || w->depth_mm == 0.0f)
                gather_any(w, y, axis, from, &jobs[k]);
            else if (axis == 0)
                gather_along_x(w, y, from, &jobs[k]);
            else if (jobs[k].b.skew != 0.0f)
                gather_leaning(w, y, from, &jobs[k]);
            else
                gather_along_y(w, y, from, &jobs[k]);
        for (int k = 0; k < count; k++) {
            const int x = jobs[k].x;
            const size_t index = (size_t) (y * w->stride + x);
            _Alignas(64) float result[3][SCREEN_BLOCK], on[SCREEN_BLOCK];
            int blurred = jobs[k].b.active;

            if (paper)
                blurred = gather_listing(w, index, x, y, axis, jobs[k].cell, from, result, on);
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
    /* What the pass along x reads of `to` beside what is written. */
    for (int block = w->extents[y].begin - 1; block <= w->extents[y].end; block++)
        if (block < w->extents[y].begin || block == w->extents[y].end || cell_at(w, block, y)->live == SCREEN_EMPTY)
            for (int i = 0; !w->last && i < 3; i++)
                memset(to[i] + block * SCREEN_BLOCK, 0, SCREEN_BLOCK * sizeof(float));
    return blur_row(w, y, 1, from, to);
}

static void copy_row(const struct screen_work *w, int y)
{
    for (int block = w->block0; block < w->block1; block++) {
        const size_t index = (size_t) (y * w->stride + block * SCREEN_BLOCK);

        for (int l = 0; cell_at(w, block, y)->live != SCREEN_EMPTY && l < SCREEN_BLOCK; l++)
            for (int i = 0; w->key[index + (size_t) l] > 0.0f && i < 3; i++)
                w->out->light[i][y * w->in->shape.stride + block * SCREEN_BLOCK + l] = w->now[i][index + (size_t) l];
    }
}

extern const struct screen_kernels PELL_SIMD(pell_ss_kernels);
const struct screen_kernels PELL_SIMD(pell_ss_kernels) = {
    .load = load_row,
    .measure = measure_row,
    .across = across_row,
    .down = down_row,
    .copy = copy_row,
};
