/* SPDX-License-Identifier: MIT
 *
 * layout.c - extent of each group, planes through it, sizes of images and transforms.
 */
#include "methods/convolution/state.h"

#include "base/pool.h"
#include "math/vec.h"

#include <string.h>

#define REACH 1e-4 /* fraction of the light that may be cut off */

/* --- Extents -------------------------------------------------------------------------------------------------------------------------- */

static void add_depth(struct conv_extent *e, float depth)
{
    e->low = depth < e->low ? depth : e->low;
    e->high = depth > e->high ? depth : e->high;
}

static void add_light(struct conv_extent *e, int c, float light)
{
    e->brightest[c] = light > e->brightest[c] ? light : e->brightest[c];
    e->darkest[c] = light < e->darkest[c] ? light : e->darkest[c];
}

static const struct conv_extent nothing = {
    .rect = { 65536, 65536, 0, 0 }, .low = INFINITY, .high = -INFINITY, .weakest = INFINITY, .strongest = -INFINITY
};

static void extent_row(void *arg, int index, int worker)
{
    struct convolution_state *st = arg;
    const struct pell_frame *in = st->sources.in;
    const struct conv_behind *b = &st->sources.behind;
    const int y = in->rect.y0 + index;
    struct conv_extent e = nothing;

    (void) worker;
    for (int x = in->rect.x0; x < in->rect.x1; x++) {
        if (st->sources.front.group[y * st->sources.front.stride + x] != st->job.group + 1)
            continue;
        e.rect.x0 = e.pixels ? e.rect.x0 : x;
        e.rect.x1 = x + 1;
        e.pixels++;
        add_depth(&e, in->depth[y * in->shape.stride + x]);
        if (in->strength) {
            e.weakest = fminf(e.weakest, in->strength[y * in->shape.stride + x]);
            e.strongest = fmaxf(e.strongest, in->strength[y * in->shape.stride + x]);
        }
        for (int c = 0; c < 3; c++)
            add_light(&e, c, in->irradiance[c][y * in->shape.stride + x]);
    }
    e.rect.y0 = y;
    e.rect.y1 = y + 1;
    /* Cells that begin in this row, and in all rows above. */
    for (int k = 0; k < b->layers && (y % b->step == 0 || index == 0); k++) {
        const size_t row = ((size_t) k * (size_t) b->height + (size_t) (y / b->step)) * (size_t) b->width;
        for (int x = in->rect.x0 / b->step; x <= (in->rect.x1 - 1) / b->step; x++)
            if (b->group[row + (size_t) x] == st->job.group + 1) {
                add_depth(&e, b->depth[row + (size_t) x]);
                for (int c = 0; c < 3; c++)
                    add_light(&e, c, b->light[c][row + (size_t) x]);
            }
    }
    st->rows[index] = e;
}

void convolution_find_extent(struct convolution_state *st)
{
    const struct pell_frame *in = st->sources.in;
    const int rows = in->rect.y1 - in->rect.y0;
    struct conv_extent all = nothing;

    pell_pool_run(st->pool, rows, extent_row, st);
    for (int i = 0; i < rows; i++) {
        const struct conv_extent *e = &st->rows[i];
        if (e->low <= e->high) {
            add_depth(&all, e->low);
            add_depth(&all, e->high);
        }
        for (int c = 0; c < 3; c++) {
            add_light(&all, c, e->brightest[c]);
            add_light(&all, c, e->darkest[c]);
        }
        if (e->pixels == 0)
            continue;
        all.rect.x0 = e->rect.x0 < all.rect.x0 ? e->rect.x0 : all.rect.x0;
        all.rect.x1 = e->rect.x1 > all.rect.x1 ? e->rect.x1 : all.rect.x1;
        all.rect.y0 = e->rect.y0 < all.rect.y0 ? e->rect.y0 : all.rect.y0;
        all.rect.y1 = e->rect.y1;
        all.pixels += e->pixels;
        all.weakest = fminf(all.weakest, e->weakest);
        all.strongest = fmaxf(all.strongest, e->strongest);
    }
    st->job.extent = all;
}

/* --- Planes -------------------------------------------------------------------------------------------------------------------- */

/* Quantiles of the surface's depths at 1/n, 2/n .., blended with uniform spacing. */
static void place_planes(const struct convolution_state *st, struct conv_layout *lay, float low, float high)
{
    enum { BINS = 256 };
    const struct pell_frame *in = st->sources.in;
    const struct conv_behind *b = &st->sources.behind;
    const struct conv_extent *e = &st->job.extent;
    const float gap = 8.001f * conv_pixel_at(in, high) * (float) st->format.step;
    double count[BINS] = { 0 }, all = 0.0, sum = 0.0;
    int plane = 1;

    for (int y = e->rect.y0; y < e->rect.y1; y++)
        for (int x = e->rect.x0; x < e->rect.x1; x++)
            if (st->sources.front.group[y * st->sources.front.stride + x] == st->job.group + 1)
                count[(int) (conv_clamp((in->depth[y * in->shape.stride + x] - low) / (high - low), 0.0f, 0.9999f) * BINS)] += 1.0;
    for (size_t i = 0; i < (size_t) b->layers * (size_t) b->width * (size_t) b->height; i++)
        if (b->group[i] == st->job.group + 1)
            count[(int) (conv_clamp((b->depth[i] - low) / (high - low), 0.0f, 0.9999f) * BINS)] += (double) (b->step * b->step);
    for (int i = 0; i < BINS; i++)
        all += count[i];
    for (int i = 0; i < BINS && plane < lay->planes - 1; i++) {
        const double fraction = 0.5 * count[i] / all + 0.5 / BINS;
        for (; plane < lay->planes - 1 && sum + fraction >= (double) plane / (lay->planes - 1); plane++)
            lay->depth[plane] = low + (high - low) * (float) ((i + ((double) plane / (lay->planes - 1) - sum) / fraction) / BINS);
        sum += fraction;
    }
    /* Lower bound of the spacing, however concentrated the depths are: convolution_spectra_size relies on it. */
    for (int i = 1; i < lay->planes - 1; i++)
        lay->depth[i] = fmaxf(lay->depth[i], lay->depth[i - 1] + gap);
    for (int i = lay->planes - 2; i > 0; i--)
        lay->depth[i] = fminf(lay->depth[i], lay->depth[i + 1] - gap);
}

/* resolution=auto: half resolution if the median radius of every channel is this many pixels. The blur added by half resolution is then
 * small relative to the profile on a surface in depth; on a caller's planes the convolution stays exact. */
#define FAR_PX 3.0f

void convolution_choose_format(struct convolution_state *st)
{
    const struct conv_job *j = &st->job;
    const float pixel = conv_pixel_at(j->in, 0.5f * (j->extent.low + j->extent.high));
    bool far = st->solids != NULL;

    for (int c = 0; c < 3; c++)
        far = far && (!(j->radial[c].total > 0.0f) || (!j->radial[c].point && sqrtf(j->radial[c].median2) >= FAR_PX * pixel));
    st->format = st->formats[st->knobs.resolution != CONV_AUTO_SIZE ? st->knobs.resolution : far ? CONV_HALF_SIZE : CONV_FULL];
}

/* Chooses planes, and sizes of images and transforms. */
void convolution_lay_out(struct convolution_state *st)
{
    struct conv_job *j = &st->job;
    const struct pell_frame *in = j->in;
    const struct conv_extent *e = &j->extent;
    const int align = st->format.step > st->sources.behind.step ? st->format.step : st->sources.behind.step;
    const double reach = convolution_reach(j->radial, REACH);
    struct conv_layout *lay = &j->layout;
    const float middle = 0.5f * (e->low + e->high), unit = conv_pixel_at(in, middle);
    float low = e->low, high = e->high;
    double pad;

    memset(lay, 0, sizeof(*lay));
    lay->group = j->group * (CONV_LEVELS + 1);
    lay->planes = convolution_planes(&st->knobs, st->format.step);
    if (!(high - low > 1e-2f * unit) || !(high - low > 4e-6f * high)) /* practically flat and facing the camera */
        lay->planes = 1;
    if (st->knobs.placement == CONV_SURFACE) /* at least the spacing at which kernels can be sampled at every second pixel */
        for (; lay->planes > 2 && high - low < 16.0f * unit * (float) (st->format.step * (lay->planes - 1)); lay->planes--)
            continue;
    if (st->knobs.placement == CONV_SURFACE && lay->planes == 2 && high - low < 8.0f * unit * (float) st->format.step)
        lay->planes = 1;
    for (int i = 0; i < lay->planes; i++)
        lay->depth[i] = lay->planes == 1 ? middle : low + (high - low) * ((float) i / (float) (lay->planes - 1));
    if (st->knobs.placement == CONV_SURFACE && lay->planes > 2)
        place_planes(st, lay, low, high);
    lay->unit = unit * (float) st->format.step;
    for (int i = 0; i < lay->planes; i++)
        lay->pixel[i] = st->knobs.pixels == CONV_ONE
                            ? lay->unit
                            : conv_clamp(conv_pixel_at(in, lay->depth[i]), 1e-3f * unit, 1e3f * unit) * (float) st->format.step;
    j->x0 = e->rect.x0 / align * align;
    j->y0 = e->rect.y0 / align * align;
    lay->width = (e->rect.x1 - j->x0 + st->format.step - 1) / st->format.step;
    lay->height = (e->rect.y1 - j->y0 + st->format.step - 1) / st->format.step;
    pad = ceil(fmin(reach / (double) lay->pixel[0], 1e9)) + 1.0;
    lay->across = pell_fft_good(lay->width + (int) fmin(pad, lay->width), CONV_MULTIPLE);
    lay->down = pell_fft_good(lay->height + (int) fmin(pad, lay->height), CONV_MULTIPLE);
}

/* Index of the plane before a depth, and the fraction toward the next. */
static float find_coord(const struct conv_layout *lay, float depth)
{
    int i = 0;
    float t;

    if (lay->planes == 1)
        return 0.0f;
    while (i + 2 < lay->planes && depth >= lay->depth[i + 1])
        i++;
    t = (depth - lay->depth[i]) / (lay->depth[i + 1] - lay->depth[i]);
    return (float) i + conv_clamp(t, 0.0f, 0.99999f);
}

void convolution_measure_behind(struct convolution_state *st)
{
    enum { BINS = 48 };
    struct conv_job *j = &st->job;
    struct conv_layout *lay = &j->layout;
    const struct conv_front *f = &st->sources.front;
    const struct conv_behind *b = &st->sources.behind;
    const int n = lay->planes;
    double count[CONV_PLANES][BINS] = { { 0.0 } }, widest = 0.0;

    for (int i = 0; i + 1 < n; i++)
        widest = fmax(widest, 2.0 * (double) (lay->depth[i + 1] - lay->depth[i]));
    for (int k = 0; k < b->layers && n > 1; k++)
        for (int cy = j->y0 / b->step; cy <= (j->extent.rect.y1 - 1) / b->step; cy++)
            for (int cx = j->x0 / b->step; cx <= (j->extent.rect.x1 - 1) / b->step; cx++) {
                const size_t i = ((size_t) k * (size_t) b->height + (size_t) cy) * (size_t) b->width + (size_t) cx;
                const int x = cx * b->step, y = cy * b->step;
                const ptrdiff_t at = y * f->stride + x;
                float p, q, distance;
                if (x < j->extent.rect.x0 || y < j->extent.rect.y0 || b->group[i] != j->group + 1 || f->group[at] != j->group + 1)
                    continue;
                p = f->coord[at];
                q = b->coord[i];
                distance = b->depth[i] - j->in->depth[y * j->in->shape.stride + x];
                for (int l = (int) p; l <= (int) p + 1 && l < n; l++) {
                    const float w = (1.0f - fabsf(p - (float) l)) * (1.0f - fabsf(q - (float) l));
                    const double bin = fmin(fmax((double) distance / widest * BINS - 0.5, 0.0), BINS - 1.001), part = bin - floor(bin);
                    if (fabsf(q - (float) l) >= 1.0f)
                        continue;
                    count[l][(int) bin] += (1.0 - part) * (double) w;
                    count[l][(int) bin + 1] += part * (double) w;
                }
            }
    for (int c = 0; c < 3; c++)
        for (int l = 0; l < n; l++) {
            const double spacing = n == 1 ? 0.0 : (double) (lay->depth[l + 1 < n ? l + 1 : l] - lay->depth[l + 1 < n ? l : l - 1]);
            double all = 0.0, arrives = 0.0, low = 0.0, high = widest;
            for (int i = 0; i < BINS; i++) {
                all += count[l][i];
                arrives += count[l][i] > 0.0 ? count[l][i] * convolution_radial_beyond(&j->radial[c], (i + 0.5) * widest / BINS) : 0.0;
            }
            for (int i = 0; i < 40; i++) {
                const double middle = 0.5 * (low + high);
                if (convolution_radial_beyond(&j->radial[c], middle) * all > arrives)
                    low = middle;
                else
                    high = middle;
            }
            lay->behind[c][l] = (float) (n == 1 ? 0.0 : all > 0.0 ? high : 0.5 * spacing);
        }
}

static void coord_row(void *arg, int index, int worker)
{
    struct convolution_state *st = arg;
    const struct conv_job *j = &st->job;
    const struct pell_frame *in = j->in;
    const struct conv_front *f = &st->sources.front;
    const struct conv_behind *b = &st->sources.behind;
    const int y = j->extent.rect.y0 + index;

    unsigned seen = 0;

    (void) worker;
    for (int x = j->extent.rect.x0; x < j->extent.rect.x1; x++)
        if (f->group[y * f->stride + x] == j->group + 1) {
            const float coord = find_coord(&j->layout, in->depth[y * in->shape.stride + x]);
            f->coord[y * f->stride + x] = coord;
            seen |= 1u << (int) coord;
        }
    st->rows[index].seen = seen;
    for (int k = 0; k < b->layers && (y % b->step == 0 || index == 0); k++) {
        const size_t row = ((size_t) k * (size_t) b->height + (size_t) (y / b->step)) * (size_t) b->width;
        for (int x = j->x0 / b->step; x <= (j->extent.rect.x1 - 1) / b->step; x++)
            if (b->group[row + (size_t) x] == j->group + 1)
                b->coord[row + (size_t) x] = find_coord(&j->layout, b->depth[row + (size_t) x]);
    }
}

void convolution_find_coords(struct convolution_state *st)
{
    struct conv_job *j = &st->job;
    const int rows = j->extent.rect.y1 - j->extent.rect.y0, n = j->layout.planes;
    unsigned seen = 0;

    pell_pool_run(st->pool, rows, coord_row, st);
    for (int i = 0; i < rows; i++)
        seen |= st->rows[i].seen;
    if (!st->knobs.visible)
        seen = (1u << n) - 1;
    for (int i = 0; i < CONV_IMAGES; i++)
        j->seen[i] = i < n ? (seen | seen << 1) >> i & 1 : i < n + j->between && (seen >> (i - n) & 1);
}
