/* SPDX-License-Identifier: MIT
 *
 * kernels.c - the inner loops of the convolution method; compiled once per level of base/simd.h. All levels give the same bits: lanes are
 * independent.
 */
#include "methods/convolution/kernels.h"

#include "base/simd.h"
#include "methods/convolution/chunks.h"

enum { LANES = 16, ELEMENT = 32 };

/* --- Slants ------------------------------------------------------------------------------------------------------------------------ */

/* Pixels of a row (step 1), or each pixel with its own column (step: the stride). */
struct line {
    vi at, group_at, coord; /* offsets of the line's first pixel in planes of floats and of groups; index of each pixel along the line */
    ptrdiff_t step, group_step;
    int low, high; /* first index inside the image, and the first beyond */
};

/* Slope from each pixel to the one `by` pixels away on either side, the less steep of both; 0 without neighbours. The interpolated quantity
 * is linear in the image for any plane: 1/depth, or depth in a parallel view. */
INLINE vf slope(const struct conv_depths *d, const struct line *on, vf here, vi own, vi by)
{
    vf best = splat(INFINITY);

    for (int dir = -1; dir <= 1; dir += 2) {
        const vi to = on->coord + (dir < 0 ? -by : by), inside = (to >= on->low) & (to < on->high), safe = choose(inside, to, on->coord);
        int32_t i[WIDTH], k[WIDTH];
        float depth[WIDTH];
        int32_t group[WIDTH];
        vi from = on->at + safe * (int32_t) on->step, group_from = on->group_at + safe * (int32_t) on->group_step, in_group;
        vf other, difference;
        memcpy(i, &from, sizeof(from));
        memcpy(k, &group_from, sizeof(group_from));
        for (int l = 0; l < WIDTH; l++) {
            depth[l] = d->depth[i[l]];
            group[l] = d->group[k[l]];
        }
        memcpy(&in_group, group, sizeof(in_group));
        in_group = (in_group == own) & inside;
        other = d->parallel ? load(depth) : 1.0f / select(in_group, load(depth), splat(1.0f));
        difference = dir < 0 ? here - other : other - here;
        best = select(in_group & (vabs(difference) < vabs(best)), difference, best);
    }
    return select(vabs(best) < INFINITY, best / FLOATS(by), splat(0.0f));
}

/* |n . d| of WIDTH pixels from (x, y) on, from `depth`, theirs, and the depths `by` pixels away in the groups `own`. */
INLINE vf facing(const struct conv_depths *d, int x, int y, vf depth, vi own, vi by)
{
    const vf here = d->parallel ? depth : 1.0f / depth, px = lanes_from((float) x);
    const vi column = INTS(vmin(px, splat((float) (d->x1 - 1)))), row = (vi) { 0 } + y;
    const struct line across = { row * (int32_t) d->stride, row * (int32_t) d->group_stride, column, 1, 1, d->x0, d->x1 };
    const struct line down = { column, column, row, d->stride, d->group_stride, d->y0, d->y1 };
    const vf gu = d->focal_px * slope(d, &across, here, own, by), gv = d->focal_px * slope(d, &down, here, own, by);

    if (d->parallel) {
        return 1.0f / vsqrt(1.0f + gu * gu + gv * gv);
    } else {
        const vf tx = (px + (0.5f - d->middle_x)) / d->focal_px;
        const float ty = ((float) y + 0.5f - d->middle_y) / d->focal_px;
        const vf c = here - gu * tx - gv * ty, n = vsqrt(gu * gu + gv * gv + c * c);
        return select(n > 0.0f, here / n, splat(1.0f));
    }
}

INLINE vf slant_of(vf cosine)
{
    const vf f = vmax(cosine, splat(CONV_COS_MIN)), rest = 1.0f - f;
    return select(f < 1.0f, vsqrt(vmax(rest, splat(0.0f))), rest);
}

static void cover(const struct conv_depths *d, int y, int from, int to, bool by_depth, float *area, float *slant)
{
    for (int x = from; x < to; x += WIDTH) {
        const int n = to - x;
        const vi own = groups_of(d->group + y * d->group_stride + x, n);
        vf depth = load_first(d->depth + y * d->stride + x, n), f, mm;
        if (!any(own != 0))
            continue;
        depth = select(own != 0, depth, splat(1.0f));
        f = by_depth ? facing(d, x, y, depth, own, (vi) { 0 } + 1) : load_first(slant + x, n);
        mm = d->one_size ? splat(1.0f) : (d->parallel ? splat(1.0f) : depth) / d->focal_px;
        store_first(area + x, mm * mm / vmax(f, splat(CONV_COS_MIN)), n);
        store_first(slant + x, slant_of(f), n);
    }
}

static void far_slants(const struct conv_depths *d, int y, int from, int to, uint16_t own, const float *slant, float *far)
{
    for (int x = from; x < to; x += WIDTH) {
        const int n = to - x;
        const vi in_group = which(d->group + y * d->group_stride + x, own, n);
        const vf self = load_first(slant + x, n), depth = select(in_group, load_first(d->depth + y * d->stride + x, n), splat(1.0f));
        const vf step = d->median_px / (d->parallel ? splat(1.0f) : depth), part = within(step - 0.5f, 0.0f, 1.0f);
        vf out = self;
        if (any(in_group & (self > 0.0f) & (part > 0.0f))) {
            const vi by = INTS(within(step + 0.5f, 1.0f, 65536.0f));
            const vf over = vmin(slant_of(facing(d, x, y, depth, (vi) { 0 } + own, by)), self);
            out = select((self > 0.0f) & (part > 0.0f), mix_of(self, over, part), self);
        }
        store_first(far + x, out, n);
    }
}

/* --- Weights ----------------------------------------------------------------------------------------------------------------------- */

/* A row index in a table over slants. */
struct row {
    vi low;
    vf fraction;
};

INLINE struct row row_of(vf slant, int rows)
{
    const vf s = vmax(slant, splat(0.0f)) * (float) ((rows - 1) / 0.994987437); /* the largest slant: sqrt(1 - CONV_COS_MIN) */
    const vi low = INTS(vmin(s, splat((float) (rows - 2))));

    return (struct row) { low, within(s - FLOATS(low), 0.0f, 1.0f) };
}

/* Pixels on a plane differ in width from pixels at the depth itself, t between two planes whose pixels are p and q mm wide. `coord_factor`,
 * used with restore=response only: 1/sqrt of the response at t of a surface that faces the camera. */
INLINE vf width_factor(bool by_response, vf t, vf p, vf q, vf coord_factor)
{
    vf mean_area = (1.0f - t) / (p * p) + t / (q * q);

    if (by_response) {
        const vf own = (1.0f - t) * (1.0f - t) + t * t, other = vmax(1.0f / (coord_factor * coord_factor) - own, splat(0.0f));
        mean_area = ((1.0f - t) * (1.0f - t) / (p * p) + t * t / (q * q) + other / (p * q)) / (own + other);
    }
    return select(p == q, splat(1.0f), 1.0f / ((p + t * (q - p)) * vsqrt(mean_area)));
}

/* Areas in units of the middle pixel, corrected by the response: the light that a flat surface gets back from splitting and gathering. The
 * dependence on the coordinate among the planes is divided evenly between entering and leaving light; the dependence on the slant, averaged
 * over coordinates, is applied to entering light only, since a single slanted pixel has no neighbours that would contribute more. Near
 * light is weighted by the pixel's own slant, light from farther away by the slant over a distance. */
static void compute_weights(const struct conv_weights *w, const struct conv_row *s, float *const entry_weight[3],
                            float *const exit_weight[3])
{
    enum { SIZE = sizeof(struct conv_response) / (4 * sizeof(float)) };

    for (int i = 0; i < s->count; i += WIDTH) {
        const int n = s->count - i;
        const vi in_group = which(s->group + i, s->own, n);
        const vf p = select(in_group, load_first(s->coord + i, n), splat(0.0f)),
                 self = select(in_group, load_first(s->slant + i, n), splat(0.0f));
        const vf over = select(in_group, load_first(s->far + i, n), splat(0.0f)),
                 a = select(in_group, load_first(s->area + i, n), splat(1.0f));
        const vi plane = INTS(p), next = choose(plane < w->planes - 1, plane + 1, plane);
        const vf t = p - FLOATS(plane), u = t * (float) (CONV_PHASES - 1), pixels = within(a * w->per_unit2, 1e-4f, 1e5f);
        const struct row at = row_of(self, CONV_SLANTS), own_at = row_of(self, CONV_FINE), far_at = row_of(over, CONV_FINE);
        const vi b = INTS(vmin(u, splat((float) (CONV_PHASES - 2))));
        const vf fu = u - FLOATS(b), sideways = select(self < 0.0f, 1.0f - self, splat(1.0f));
        const vf narrow = pick(w->pixel, plane), wide = pick(w->pixel, next);
        const vi first = plane * (w->several ? SIZE : 0);
        vf width;
        if (!any(in_group))
            continue;
        width = width_factor(false, t, narrow, wide, splat(1.0f));
        for (int c = 0; c < 3; c++) {
            const struct conv_response *r = w->response[c];
            vf here[4], near[4], beyond[4], by_coord, exact, received;
            if (w->plain) {
                store_first(entry_weight[c] + i, pixels, n);
                if (exit_weight)
                    store_first(exit_weight[c] + i, splat(1.0f), n);
                continue;
            }
            pick4(r->coord[0], first + at.low * (CONV_PHASES - 1) + b, here);
            pick4(r->near[0], first + own_at.low, near);
            pick4(r->far[0], first + far_at.low, beyond);
            by_coord = here[0] + fu * here[1] + at.fraction * (here[2] + fu * here[3]);
            received = near[0] + own_at.fraction * near[2] + beyond[0] + far_at.fraction * beyond[2];
            exact = near[1] + own_at.fraction * near[3] + beyond[1] + far_at.fraction * beyond[3];
            if (w->by_response) {
                pick4(r->coord[0], first + b, here);
                width = width_factor(true, t, narrow, wide, here[0] + fu * here[1]);
            }
            store_first(entry_weight[c] + i, pixels * by_coord * (exact / received) * sideways * width, n);
            if (exit_weight)
                store_first(exit_weight[c] + i, by_coord * width, n);
        }
    }
}

static void split_hidden(const struct conv_transfers *s, int count, const float *p, const float *q, const float *distance,
                         float *const entry_weight[3], float *const close[3])
{
    for (int i = 0; i < count; i += WIDTH) {
        const int n = count - i;
        const vf to = load_first(p + i, n), from = load_first(q + i, n), d = load_first(distance + i, n);
        const vi to_plane = INTS(to), from_plane = INTS(from), at = from_plane * CONV_PLANES + to_plane;
        const vf tp = to - FLOATS(to_plane), tq = from - FLOATS(from_plane);
        const vf coord = vsqrt(vmax(d, splat(0.0f)) * s->per_widest) * (float) CONV_DISTANCES;
        const vi row = INTS(vmin(coord, splat((float) (CONV_DISTANCES - 1))));
        const vf part = within(coord - FLOATS(row), 0.0f, 1.0f);
        for (int c = 0; c < 3; c++) {
            const float *a = s->arrives[c];
            const vf received = mix_of(mix_of(pick(a, at), pick(a, at + 1), tp),
                                       mix_of(pick(a, at + CONV_PLANES), pick(a, at + (CONV_PLANES + 1)), tp), tq);
            const vf exact = mix_of(pick(s->over[c], row), pick(s->over[c], row + 1), part);
            const vi more = exact >= received, none = d < 0.0f;
            const vf missing = within((exact - received) / vmax(1.0f - received, splat(1e-6f)), 0.0f, 1.0f);
            const vf kept = select(none, splat(1.0f), select(more, 1.0f - missing, exact / received));
            store_first(entry_weight[c] + i, load_first(entry_weight[c] + i, n) * kept, n);
            store_first(close[c] + i, select(more & ~none, missing * load_first(close[c] + i, n), splat(0.0f)), n);
        }
    }
}

/* --- To planes and from them ------------------------------------------------------------------------------------------------------- */

/* Fraction of the light at this coordinate that goes to plane i. */
INLINE vf plane_weight(vf coord, int i)
{
    return vmax(1.0f - vabs(coord - (float) i), splat(0.0f));
}

INLINE vf between_weight(vf coord, int i)
{
    const vf t = coord - (float) i;
    return select((t >= 0.0f) & (t < 1.0f), vsqrt(vmax(2.0f * t * (1.0f - t), splat(0.0f))), splat(0.0f));
}

INLINE void add_image(const struct conv_spread *s, float *image, int x, int n, vf light)
{
    const int halvings = s->step == 4 ? 2 : 1;
    float v[WIDTH];

    if (s->step == 1) {
        store_first(image + x, light, n);
        return;
    }
    memcpy(v, &light, sizeof(v));
    for (int l = 0; l < WIDTH && l < n; l++)
        image[(x + l) >> halvings] += v[l];
}

static void spread(const struct conv_spread *s, const uint16_t *group, const float *coord, const float *entry_weight, const float *light,
                   float *images, unsigned char *marks, int lit[2])
{
    const int count = s->step == 1 ? s->width : s->x1;

    for (int x = 0; x < count; x += WIDTH) {
        const int n = s->x1 - x < WIDTH ? s->x1 - x : WIDTH, room = count - x;
        const vf column = lanes_from((float) x);
        vi in_group = { 0 };
        vf p = { 0 }, e = { 0 };
        float v[WIDTH];
        if (n > 0)
            in_group = which(group + x, s->own, n) & (column >= (float) s->x0);
        if (any(in_group)) {
            p = select(in_group, load_first(coord + x, n), splat(0.0f));
            e = load_first(entry_weight + x, n);
            e = select(in_group, light ? e * load_first(light + x, n) : e, splat(0.0f));
        }
        if (!any(e != 0.0f)) {
            for (int i = 0; i < s->planes + s->between && s->step == 1; i++)
                store_first(images + (size_t) i * s->image_size + x, splat(0.0f), room);
            continue;
        }
        for (int i = 0; i < s->planes; i++) {
            const vf t = p - (float) i, half = select((t >= -1.0f) & (t < 1.0f), splat(0.5f), splat(0.0f));
            const vf to = e * (s->halves && s->planes > 1 ? half : plane_weight(p, i));
            const bool lights = any(to != 0.0f);
            if (lights || s->step == 1)
                add_image(s, images + (size_t) i * s->image_size, x, room, to);
            marks[i] |= lights;
        }
        for (int i = 0; i < s->between; i++) {
            const bool near = any((p >= (float) i) & (p < (float) (i + 1)));
            const vf to = near ? between_weight(p, i) * e : splat(0.0f);
            const bool lights = near && any(to != 0.0f);
            if (lights || s->step == 1)
                add_image(s, images + (size_t) (s->planes + i) * s->image_size, x, room, to);
            marks[s->planes + i] |= lights;
        }
        memcpy(v, &e, sizeof(v));
        for (int l = 0; l < WIDTH; l++)
            if (v[l] != 0.0f) {
                lit[0] = (x + l) / s->step < lit[0] ? (x + l) / s->step : lit[0];
                break;
            }
        for (int l = WIDTH - 1; l >= 0; l--)
            if (v[l] != 0.0f) {
                lit[1] = (x + l) / s->step >= lit[1] ? (x + l) / s->step + 1 : lit[1];
                break;
            }
    }
}

static void gather(const struct conv_gather *g, int from, int to, float *out)
{
    const float *const *const between = g->rows + g->planes;

    for (int x = from; x < to; x += WIDTH) {
        const int n = to - x;
        const vi in_group = which(g->group + x, g->own, n);
        const vf p = select(in_group, load_first(g->coord + x, n), splat(-2.0f));
        vf sum = { 0 };
        if (!any(in_group))
            continue;
        for (int i = 0; i < g->planes; i++) {
            const vf weight = plane_weight(p, i);
            if (!any(weight > 0.0f))
                continue;
            sum += weight * load_first(g->rows[i] + x, n);
            if (i + 1 < g->planes && between[i])
                sum += between_weight(p, i) * load_first(between[i] + x, n);
        }
        sum = vmax(sum * load_first(g->exit_weight + x, n), splat(g->least));
        store_first(out + x, select(in_group, sum, load_first(out + x, n)), n);
    }
}

static void add_cells(const float *cells, int count, int repeat, int per, float scale, int room, float *out)
{
    if (repeat == 1 && per == 1) { /* common case, written so that compilers vectorise it */
        for (int x = 0; x < room && x < count; x++)
            out[x] += scale * cells[x];
        return;
    }
    if (repeat == 2)
        for (int x = 0; 2 * x + 1 < room && x < count; x++) {
            out[2 * x] += scale * cells[x];
            out[2 * x + 1] += scale * cells[x];
        }
    for (int x = repeat == 2 && room % 2 == 0 ? room : repeat == 2 ? room - 1 : 0; x < room && x / repeat * per < count; x++)
        for (int k = x / repeat * per; k < x / repeat * per + per && k < count; k++)
            out[x] += scale * cells[k];
}

static void expand(const float *top, const float *bottom, float t, int width, int step, float *spare, float *out)
{
    float *const row = spare + WIDTH;

    for (int x = 0; x < width; x += WIDTH) {
        const int n = width - x;
        const vf a = load_first(top + x, n);
        store(row + x, a + t * (load_first(bottom + x, n) - a));
    }
    row[-1] = row[0];
    row[width] = row[width - 1];
    for (int x = 0; x < width && step == 2; x++) { /* common case, written so that compilers vectorise it */
        out[2 * x] = row[x - 1] + 0.75f * (row[x] - row[x - 1]);
        out[2 * x + 1] = row[x] + 0.25f * (row[x + 1] - row[x]);
    }
    for (int m = 0; m < step && step != 2; m++) {
        const float at = ((float) m + 0.5f) / (float) step - 0.5f, f = at < 0.0f ? 1.0f + at : at;
        const float *from = at < 0.0f ? row - 1 : row;
        for (int x = 0; x < width; x++)
            out[x * step + m] = from[x] + f * (from[x + 1] - from[x]);
    }
}

/* --- Samples of kernels ------------------------------------------------------------------------------------------------------------ */

/* Mirrors convolution_radial_value. */
INLINE vf value_at(const float *value, float per_median2, vf radius2)
{
    const vi bits = (vi) (radius2 * per_median2), row = (bits >> 18) - ((127 - CONV_OCTAVES / 2) << 5);
    const vi safe = choose(row < 0, (vi) { 0 }, choose(row > CONV_ROWS, (vi) { 0 } + CONV_ROWS, row));
    const vf part = select(row < 0, splat(0.0f), FLOATS(bits & 0x3ffff) * (1.0f / 262144.0f));

    return select(row >= CONV_ROWS, splat(0.0f), mix_of(pick(value, safe), pick(value, safe + 1), part));
}

static void sample(const struct conv_samples *s, float x, float y, float step, int count, float *out)
{
    const float a = s->fine ? 0.288675135f : 0.0f; /* offset of two-point Gauss-Legendre quadrature */

    for (int i = 0; i < count; i += WIDTH) {
        const vf v = lanes_from((float) i) * step + y;
        vf sum = { 0 };
        for (int k = 0; k < (s->fine ? 4 : 1); k++) {
            const float px = x + (k & 1 ? a : -a);
            const vf py = v + (k & 2 ? a : -a);
            sum += value_at(s->value, s->per_median2, (px * px + py * py) * s->pixel2 + s->distance2);
        }
        store(out + i, s->fine ? 0.25f * sum : sum);
    }
}

/* --- Near pixels ------------------------------------------------------------------------------------------------------------------- */

/* A pixel relative to the planes. */
struct plane_position {
    vf plane, t, between;
};

INLINE struct plane_position plane_position_of(vf coord)
{
    const vf plane = FLOATS(INTS(coord)), t = coord - plane;

    return (struct plane_position) { plane, t, vsqrt(vmax(2.0f * t * (1.0f - t), splat(0.0f))) };
}

/* Fraction of the light of pixel a that already reaches pixel b through the planes. `next`: R at one more plane distance, divided by R. */
INLINE vf exchange(struct plane_position a, struct plane_position b, float next)
{
    const vf step = b.plane - a.plane, both = (1.0f - a.t) * (1.0f - b.t) + a.t * b.t;
    const vf up = a.t * (1.0f - b.t), down = (1.0f - a.t) * b.t;
    const vf same = both + (up + down) * next + a.between * b.between * (1.0f - next);

    return select(step == 0.0f, same, select(vabs(step) == 1.0f, select(step > 0.0f, up, down) + both * next, splat(0.0f)));
}

/* A vector of pixels. */
struct pixel_lanes {
    vi valid;
    vf depth, flux, coord; /* flux and coord: by load_rest */
};

INLINE vf load_between(const float *row, int x, int x0, int x1)
{
    float v[WIDTH] = { 0 };
    const int skip = x < x0 ? x0 - x : 0, n = x1 - x < WIDTH ? x1 - x : WIDTH;

    if (skip == 0 && n == WIDTH)
        return load(row + x);
    if (skip < n)
        memcpy(v + skip, row + x + skip, (size_t) (n - skip) * sizeof(float));
    return load(v);
}

INLINE struct pixel_lanes find_pixels(const struct conv_edges *s, int x, int y)
{
    struct pixel_lanes o = { 0 };
    const int skip = x < s->x0 ? s->x0 - x : 0, n = s->x1 - x < WIDTH ? s->x1 - x : WIDTH;
    uint16_t group[WIDTH] = { 0 };

    if (y < s->y0 || y >= s->y1 || skip >= n)
        return o;
    memcpy(group + skip, s->group + y * s->group_stride + x + skip, (size_t) (n - skip) * sizeof(*group));
    o.valid = which(group, s->own, n) & (lanes_from(0.0f) >= (float) skip);
    o.depth = select(o.valid, load_between(s->depth + y * s->stride, x, s->x0, s->x1), splat(1.0f));
    return o;
}

INLINE void load_rest(const struct conv_edges *s, int x, int y, struct pixel_lanes *o)
{
    const ptrdiff_t row = y * s->group_stride;

    if (y < s->y0 || y >= s->y1)
        return;
    o->flux = load_between(s->entry_weight + row, x, s->x0, s->x1);
    if (s->light)
        o->flux *= load_between(s->light + y * s->stride, x, s->x0, s->x1);
    o->flux = select(o->valid, o->flux, splat(0.0f));
    o->coord = select(o->valid, load_between(s->coord + row, x, s->x0, s->x1), splat(0.0f));
}

/* The less steep of the depth steps to both sides. */
INLINE vf less_steep(vf depth, struct pixel_lanes before, struct pixel_lanes after)
{
    const vf low = depth - before.depth, high = after.depth - depth;
    const vi is_low = before.valid & (~after.valid | (vabs(low) <= vabs(high)));

    return select(is_low, low, select(after.valid, high, splat(0.0f)));
}

/* Depth steps per pixel of a surface that covers `times` the area of a pixel, whose squared width is width2, mm^2: of the steps given, only
 * the direction is kept. */
INLINE void scale_gradient(vf times, float width2, vf *gx, vf *gy)
{
    const vf tangent2 = vmax(times * times - 1.0f, splat(0.0f)) * width2, length2 = *gx * *gx + *gy * *gy;
    const vi known = length2 > 1e-6f * width2;
    const vf scale = vsqrt(tangent2 / select(known, length2, splat(1.0f)));

    *gx = select(known, *gx * scale, vsqrt(tangent2));
    *gy = select(known, *gy * scale, splat(0.0f));
}

static void edges(const struct conv_edges *s, int y, int from, int to, float *out)
{
    for (int x = from; x < to; x += WIDTH) {
        const int n = to - x;
        struct pixel_lanes own = find_pixels(s, x, y);
        struct plane_position here;
        vi near_edge = { 0 };
        vf sum = { 0 }, gx, gy, area, exit_weight;
        if (!any(own.valid))
            continue;
        for (int dy = -CONV_WINDOW; dy <= CONV_WINDOW; dy++)
            for (int dx = -CONV_WINDOW; dx <= CONV_WINDOW; dx++) {
                const struct pixel_lanes o = find_pixels(s, x + dx, y + dy);
                const vf d = o.depth - own.depth;
                near_edge |= own.valid & (~o.valid | (d * d > s->flat2));
            }
        if (!any(near_edge))
            continue;
        load_rest(s, x, y, &own);
        here = plane_position_of(own.coord);
        exit_weight = load_between(s->exit_weight + y * s->group_stride, x, s->x0, s->x1);
        area = select(own.valid, load_between(s->area + y * s->group_stride, x, s->x0, s->x1), splat(1.0f));
        gx = less_steep(own.depth, find_pixels(s, x - 1, y), find_pixels(s, x + 1, y));
        gy = less_steep(own.depth, find_pixels(s, x, y - 1), find_pixels(s, x, y + 1));
        scale_gradient(area / (s->pixel2 * (s->parallel ? splat(1.0f) : own.depth * own.depth)), s->radius2[0][1], &gx, &gy);
        for (int dy = -CONV_WINDOW; dy <= CONV_WINDOW; dy++)
            for (int dx = -CONV_WINDOW; dx <= CONV_WINDOW; dx++) {
                const int ax = dx < 0 ? -dx : dx, ay = dy < 0 ? -dy : dy;
                const vf on = gx * (float) dx + gy * (float) dy;
                const vf coord = within(own.coord + on * s->per_spacing, 0.0f, (float) (s->planes - 1) - 1e-5f);
                struct pixel_lanes o = find_pixels(s, x + dx, y + dy);
                const vf d = o.depth - own.depth - on;
                const vf value = value_at(s->value, s->per_median2, s->radius2[ay][ax] + d * d);
                vf on_own, on_its;
                const vf alike = select(o.valid, s->per_value[ay][ax] * value, splat(0.0f));
                load_rest(s, x + dx, y + dy, &o);
                on_own = own.flux * exchange(here, plane_position_of(coord), s->next[ay][ax]);
                on_its = o.flux * exchange(here, plane_position_of(o.coord), s->next[ay][ax]);
                sum += s->square[ay][ax] * (1.0f - alike) * (on_own - on_its);
            }
        sum = vmax(load_first(out + x, n) + s->fade * exit_weight * sum, splat(s->least));
        store_first(out + x, select(near_edge, sum, load_first(out + x, n)), n);
    }
}

/* --- Frequency domain -------------------------------------------------------------------------------------------------------------- */

INLINE const float *at(const struct conv_spectrum *s, int block, int y)
{
    return s->data + block * s->block + LANES * y;
}

INLINE int reaches(const struct conv_spectrum *s, int block, int y)
{
    return s && block < s->blocks && y < s->rows;
}

static void scale(float *element, vf k, int l)
{
    store(element + l, load(element + l) * k);
    store(element + LANES + l, load(element + LANES + l) * k);
}

/* Own kernels of planes; and of the images between planes: the mean of the two planes' minus the transfer between them. */
static void mix_own(const struct conv_mix *m, int block, int y, int k)
{
    for (int i = 0; i < m->planes; i++)
        for (int l = 0; l < LANES && m->column[i]; l += WIDTH)
            scale(m->column[i] + ELEMENT * y, load(at(m->own[i], block, k) + l), l);
    for (int i = 0; i < m->between; i++)
        for (int l = 0; l < LANES && m->column[m->planes + i]; l += WIDTH) {
            vf own = (load(at(m->own[i], block, k) + l) + load(at(m->own[i + 1], block, k) + l)) * 0.5f;
            if (reaches(m->next[i], block, k))
                own -= load(at(m->next[i], block, k) + l) * m->next_factor[i];
            scale(m->column[m->planes + i] + ELEMENT * y, own, l);
        }
}

/* Light that enters on a plane, in front and behind. */
static void load_plane(const struct conv_mix *m, int i, int y, float *to)
{
    const float *front = m->column[i], *behind = i < m->behind ? m->column[m->planes + m->between + i] : 0;

    for (int l = 0; l < ELEMENT; l += WIDTH) {
        vf sum = { 0 };
        if (front)
            sum = load(front + ELEMENT * y + l);
        if (behind)
            sum += load(behind + ELEMENT * y + l);
        store(to + l, sum);
    }
}

/* Light that enters on the far side, with the kernel of its distance. */
static void mix_behind(const struct conv_mix *m, int block, int y, int k)
{
    for (int i = 0; i < m->behind; i++) {
        float *to = m->column[i];
        const float *from = m->column[m->planes + m->between + i];
        if (!to || !from || !reaches(m->behind_own[i], block, k))
            continue;
        for (int l = 0; l < LANES; l += WIDTH) {
            const vf f = load(at(m->behind_own[i], block, k) + l);
            for (int lane = l; lane < ELEMENT; lane += LANES)
                store(to + ELEMENT * y + lane, load(to + ELEMENT * y + lane) + load(from + ELEMENT * y + lane) * f);
        }
    }
}

static void mix(const struct conv_mix *m, int block)
{
    int blocks = 0, rows = 0;

    for (int i = 0; i < m->num_pairs; i++) {
        const struct conv_spectrum *s = m->pairs[i].spectrum;
        blocks = s && s->blocks > blocks ? s->blocks : blocks;
        rows = s && s->rows > rows ? s->rows : rows;
    }
    for (int y = 0; y < m->height; y++) {
        const int k = 2 * y <= m->height ? y : m->height - y;
        _Alignas(64) float before[CONV_PLANES][ELEMENT];
        const int far = block < blocks && k < rows;
        for (int i = 0; far && i < m->planes; i++)
            load_plane(m, i, y, before[i]);
        mix_own(m, block, y, k);
        mix_behind(m, block, y, k);
        for (int i = 0; far && i < m->num_pairs; i++) {
            const struct conv_pair *p = &m->pairs[i];
            if (!reaches(p->spectrum, block, k))
                continue;
            for (int l = 0; l < LANES; l += WIDTH) {
                const vf f = load(at(p->spectrum, block, k) + l) * p->factor;
                for (int lane = l; lane < ELEMENT; lane += LANES)
                    for (int dir = 0; dir < 2; dir++) {
                        float *to = m->column[dir ? p->from : p->to];
                        if (!to)
                            continue;
                        to += ELEMENT * y + lane;
                        store(to, load(to) + load(before[dir ? p->to : p->from] + lane) * f);
                    }
            }
        }
    }
}

extern const struct conv_kernels PELL_SIMD(convolution_kernels);
const struct conv_kernels PELL_SIMD(convolution_kernels) = {
    .cover = cover,
    .far = far_slants,
    .compute_weights = compute_weights,
    .split_hidden = split_hidden,
    .spread = spread,
    .gather = gather,
    .edges = edges,
    .add_cells = add_cells,
    .expand = expand,
    .sample = sample,
    .mix = mix,
};
