/* SPDX-License-Identifier: MIT
 *
 * light.c - weights of the light at pixels and at hidden cells, and its distribution to planes, one band of rows at a time, followed by the
 * row transforms.
 */
#include "methods/convolution/state.h"

#include "base/pool.h"
#include "math/vec.h"

#include <limits.h>
#include <string.h>

#define MIN_VALUE 1e-30f /* 1/mm^2: smaller values of R count as 0, so that its reciprocal is finite */

/* Scratch rows for the weights of pixels, and of hidden cells. */
struct buffers {
    float *far, *front, *behind, *distance, *slant, *over;
};

static struct buffers buffers_of(const struct convolution_state *st, int worker)
{
    const size_t size = (size_t) st->job.in->shape.width + 16;
    float *first = st->scratch[worker];

    return (struct buffers) { first, first + size, first + 2 * size, first + 3 * size, first + 4 * size, first + 5 * size };
}

/* Weights of hidden light in a row of cells [x0, x1), whose layer begins at `row`, relative to row y of pixels in front. With separate
 * images for hidden light, the part missing at the pixel in front is moved to that pixel's coordinate; an excess there reduces it. */
static void weight_hidden(const struct convolution_state *st, const struct buffers *to, size_t row, int x0, int x1, int y)
{
    const struct conv_job *j = &st->job;
    const struct conv_kernels *kernels = st->kernels;
    const struct pell_rect *rect = &j->extent.rect;
    const struct conv_front *f = &st->sources.front;
    const struct conv_behind *b = &st->sources.behind;
    const size_t at = row + (size_t) x0;
    const int count = x1 - x0;
    struct conv_row cells = {
        count, (uint16_t) (j->group + 1), b->group + at, to->behind, b->area + at, b->slant + at, b->slant + at,
    };
    float *const entry_weight[3] = { b->entry_weight[0] + at, b->entry_weight[1] + at, b->entry_weight[2] + at };
    float *const close[3] = { b->close[0] + at, b->close[1] + at, b->close[2] + at };

    for (int i = 0; i < count; i++) {
        const int px = (x0 + i) * b->step, x = px > rect->x0 ? px : rect->x0;
        const ptrdiff_t pixel = y * f->stride + x;
        const bool in_group = cells.group[i] == cells.own, before = in_group && x < rect->x1 && f->group[pixel] == cells.own;
        const float slant = in_group ? b->slant[at + (size_t) i] : 0.0f;
        to->slant[i] = slant < 0.0f ? slant : 0.0f;
        to->over[i] = before ? fminf(slant, to->far[x - rect->x0]) : slant;
        to->behind[i] = in_group ? b->coord[at + (size_t) i] : 0.0f;
        to->front[i] = before ? f->coord[pixel] : 0.0f;
        to->distance[i] = before ? fmaxf(b->depth[at + (size_t) i] - j->in->depth[y * j->in->shape.stride + x], 0.0f) : -1.0f;
    }
    if (j->behind && j->layout.planes > 1) {
        cells.far = to->over;
        kernels->compute_weights(&j->weights, &cells, close, NULL);
    } else {
        for (int c = 0; c < 3; c++)
            memset(close[c], 0, (size_t) count * sizeof(float));
    }
    if (j->behind) /* kernels with an offset in distance do not depend on slants */
        cells.slant = cells.far = to->slant;
    kernels->compute_weights(&j->weights, &cells, entry_weight, NULL);
    if (j->behind && j->layout.planes > 1)
        kernels->split_hidden(&j->transfers, count, to->front, to->behind, to->distance, entry_weight, close);
    for (int c = 0; c < 3; c++)
        for (int i = 0; i < count; i++)
            if (cells.group[i] == cells.own) {
                entry_weight[c][i] *= b->carried[c][at + (size_t) i];
                close[c][i] *= b->carried[c][at + (size_t) i];
            }
}

static void weight_row(void *arg, int index, int worker)
{
    const struct convolution_state *st = arg;
    const struct conv_job *j = &st->job;
    const struct pell_rect *rect = &j->extent.rect;
    const struct conv_front *f = &st->sources.front;
    const struct conv_behind *b = &st->sources.behind;
    const struct buffers to = buffers_of(st, worker);
    const struct conv_depths depths = convolution_depths(&st->sources, j->median);
    const int y = rect->y0 + index;
    const ptrdiff_t at = y * f->stride + rect->x0;
    const struct conv_row pixels = {
        rect->x1 - rect->x0, (uint16_t) (j->group + 1), f->group + at, f->coord + at, f->area + at, f->slant + at, to.far,
    };
    float *const entry_weight[3] = { f->entry_weight[0] + at, f->entry_weight[1] + at, f->entry_weight[2] + at };
    float *const exit_weight[3] = { f->exit_weight[0] + at, f->exit_weight[1] + at, f->exit_weight[2] + at };

    st->kernels->far(&depths, y, rect->x0, rect->x1, pixels.own, f->slant + y * f->stride, to.far - rect->x0);
    st->kernels->compute_weights(&j->weights, &pixels, entry_weight, exit_weight);
    for (int k = 0; k < b->layers && (y % b->step == 0 || index == 0); k++)
        weight_hidden(st, &to, ((size_t) k * (size_t) b->height + (size_t) (y / b->step)) * (size_t) b->width, j->x0 / b->step,
                      (rect->x1 - 1) / b->step + 1, y);
}

/* Fractions of light transferred from plane to plane, and from hidden light. */
static void measure_arrivals(struct convolution_state *st)
{
    struct conv_job *j = &st->job;
    const struct conv_layout *lay = &j->layout;

    j->widest = fmaxf(lay->depth[lay->planes - 1] - lay->depth[0], 1e-20f);
    for (int c = 0; c < 3; c++) {
        const struct conv_radial *r = &j->radial[c];
        const float per = r->total > 0.0f ? 1.0f / r->total : 0.0f;
        for (int from = 0; from < lay->planes; from++)
            for (int to = 0; to < lay->planes; to++) {
                const float h = from == to ? fmaxf(lay->behind[c][to], 0.0f) : fabsf(lay->depth[to] - lay->depth[from]);
                j->arrives[c][from][to] = per * (float) convolution_radial_beyond(r, (double) h);
            }
        for (int i = 0; i <= CONV_DISTANCES; i++)
            j->arrives_over[c][i] =
                per * (float) convolution_radial_beyond(r, (double) j->widest * i * i / (CONV_DISTANCES * CONV_DISTANCES));
    }
}

static void set_weights(struct convolution_state *st)
{
    struct conv_job *j = &st->job;

    j->weights = (struct conv_weights) {
        .planes = j->layout.planes,
        .plain = st->knobs.restore == CONV_LOST || j->divide,
        .by_response = st->knobs.restore == CONV_RESPONSE,
        .several = j->set->num_responses > 1,
        .pixel = j->layout.pixel,
        .per_unit2 = st->sources.one_size ? 1.0f / (float) (st->format.step * st->format.step) : 1.0f / (j->layout.unit * j->layout.unit),
        .response = { j->set->response[0], j->set->response[1], j->set->response[2] },
    };
    j->transfers = (struct conv_transfers) {
        .arrives = { j->arrives[0][0], j->arrives[1][0], j->arrives[2][0] },
        .over = { j->arrives_over[0], j->arrives_over[1], j->arrives_over[2] },
        .per_widest = 1.0f / j->widest,
    };
}

/* Full correction if the median radius is within one pixel, none from three pixels on, where near pixels no longer matter. */
static void set_edges(struct convolution_state *st, int c)
{
    enum { SIDE = CONV_WINDOW + 1 };
    struct conv_job *j = &st->job;
    const struct conv_layout *lay = &j->layout;
    const struct conv_radial *r = &j->radial[c];
    const struct conv_front *f = &st->sources.front;
    struct conv_edges *s = &j->edges[c];
    const float spacing = lay->planes > 1 ? (lay->depth[lay->planes - 1] - lay->depth[0]) / (float) (lay->planes - 1) : 0.0f;
    double squares[SIDE * SIDE];

    *s = (struct conv_edges) {
        .depth = j->in->depth,
        .light = j->in->irradiance[c],
        .group = f->group,
        .coord = f->coord,
        .area = f->area,
        .entry_weight = f->entry_weight[c],
        .exit_weight = f->exit_weight[c],
        .stride = j->in->shape.stride,
        .group_stride = f->stride,
        .x0 = j->extent.rect.x0,
        .y0 = j->extent.rect.y0,
        .x1 = j->extent.rect.x1,
        .y1 = j->extent.rect.y1,
        .own = (uint16_t) (j->group + 1),
        .planes = lay->planes,
        .least = convolution_least(&j->extent, c),
        .per_spacing = spacing > 0.0f ? 1.0f / spacing : 0.0f,
        .parallel = j->in->shape.orthographic || st->sources.one_size,
        .pixel2 = st->sources.one_size ? 1.0f : 1.0f / (j->in->shape.focal_px * j->in->shape.focal_px),
        .flat2 = 0.01f * r->median2,
        .value = r->value,
        .per_median2 = r->per_median2,
    };
    if (!st->knobs.edges || st->format.step > 1 || st->knobs.split == CONV_HALF || st->knobs.restore != CONV_BETWEEN || r->point ||
        lay->planes == 1)
        return;
    s->fade = conv_clamp(1.5f - 0.5f * sqrtf(r->median2) / lay->unit, 0.0f, 1.0f);
    convolution_radial_squares(r, (double) lay->unit, SIDE, squares);
    for (int y = 0; y < SIDE; y++)
        for (int x = 0; x < SIDE; x++) {
            const float radius2 = (float) (x * x + y * y) * lay->unit * lay->unit, value = convolution_radial_value(r, radius2);
            const bool positive = value > MIN_VALUE;
            s->radius2[y][x] = radius2;
            s->square[y][x] = positive ? (float) squares[y * SIDE + x] : 0.0f;
            s->per_value[y][x] = positive ? 1.0f / value : 0.0f;
            s->next[y][x] = s->per_value[y][x] * convolution_radial_value(r, radius2 + spacing * spacing);
        }
}

void convolution_compute_weights(struct convolution_state *st)
{
    const struct conv_radial *r = st->job.radial;

    st->job.median = powf(r[0].median2, 1.0f / 6.0f) * powf(r[1].median2, 1.0f / 6.0f) * powf(r[2].median2, 1.0f / 6.0f);
    if (st->job.behind)
        measure_arrivals(st);
    set_weights(st);
    for (int c = 0; c < 3; c++)
        set_edges(st, c);
    pell_pool_run(st->pool, st->job.extent.rect.y1 - st->job.extent.rect.y0, weight_row, st);
}

/* The images of a band of rows in a worker's scratch. */
struct band {
    float *images;
    size_t size; /* floats per image */
    unsigned char *marks;
    struct pell_rect *lit;
    int y0, y1;
};

static inline void extend(struct pell_rect *lit, int x, int y)
{
    lit->x0 = x < lit->x0 ? x : lit->x0;
    lit->x1 = x >= lit->x1 ? x + 1 : lit->x1;
    lit->y0 = y < lit->y0 ? y : lit->y0;
    lit->y1 = y >= lit->y1 ? y + 1 : lit->y1;
}

static void extend_row(const struct band *to, const int ends[2], int y)
{
    if (ends[0] < ends[1]) {
        extend(to->lit, ends[0], y);
        extend(to->lit, ends[1] - 1, y);
    }
}

static void spread_front(const struct convolution_state *st, const struct band *to, int y)
{
    const struct conv_job *j = &st->job;
    const struct pell_rect *rect = &j->extent.rect;
    const struct conv_front *f = &st->sources.front;
    struct conv_spread s = {
        .planes = j->layout.planes,
        .between = j->between,
        .halves = st->knobs.split == CONV_HALF,
        .image_size = to->size,
        .x0 = rect->x0 - j->x0,
        .width = (int) j->stride,
        .step = st->format.step,
        .own = (uint16_t) (j->group + 1),
    };
    int ends[2] = { INT_MAX, 0 };

    for (int row = j->y0 + y * st->format.step; row < j->y0 + (y + 1) * st->format.step; row++) {
        const bool inside = row >= rect->y0 && row < rect->y1;
        const int py = inside ? row : rect->y0;
        const ptrdiff_t at = py * f->stride + j->x0;
        s.x1 = inside ? rect->x1 - j->x0 : 0;
        st->kernels->spread(&s, f->group + at, f->coord + at, f->entry_weight[j->channel] + at,
                            j->uniform ? NULL : j->in->irradiance[j->channel] + py * j->in->shape.stride + j->x0,
                            to->images + (y - to->y0) * j->stride, to->marks, ends);
    }
    extend_row(to, ends, y);
}

enum { CELLS = 128 };

/* Cells that go to columns of images from x on, rows [y, y1). */
struct cells {
    const uint16_t *group;
    const float *coord, *entry_weight, *light;
    int count, x, y, y1;
};

/* Adds cells to the images from `first` on, and to those between planes if they are in front. */
static void spread_cells(const struct convolution_state *st, const struct band *to, int first, bool front, const struct cells *c)
{
    const struct conv_job *j = &st->job;
    const int step = st->sources.behind.step, repeat = step > st->format.step ? step / st->format.step : 1,
              per = st->format.step > step ? st->format.step / step : 1;
    const struct conv_spread s = {
        .planes = j->layout.planes,
        .between = front ? j->between : 0,
        .halves = st->knobs.split == CONV_HALF,
        .image_size = CELLS,
        .x1 = c->count,
        .width = CELLS,
        .step = 1,
        .own = (uint16_t) (j->group + 1),
    };
    const int room = (int) j->stride - c->x;
    _Alignas(64) float parts[2 * CONV_PLANES][CELLS];
    unsigned char marks[2 * CONV_PLANES] = { 0 };
    int ends[2] = { INT_MAX, 0 };

    st->kernels->spread(&s, c->group, c->coord, c->entry_weight, c->light, parts[0], marks, ends);
    if (ends[0] >= ends[1])
        return;
    for (int i = 0; i < s.planes + s.between; i++)
        for (int row = c->y; row < c->y1 && marks[i]; row++) {
            to->marks[first + i] = 1;
            st->kernels->add_cells(parts[i], c->count, repeat, per, 1.0f / (float) (repeat * repeat), room,
                                   to->images + (size_t) (first + i) * to->size + (row - to->y0) * j->stride + c->x);
        }
    ends[0] = c->x + ends[0] * repeat / per;
    ends[1] = c->x + (ends[1] - 1) * repeat / per + repeat;
    ends[1] = ends[1] < j->layout.width ? ends[1] : j->layout.width;
    for (int row = c->y; row < c->y1; row++)
        extend_row(to, ends, row);
}

/* Light of cells from `at` on, at column x and pixel row py. Pixels are later divided by the response to uniform light, which corrects for
 * missing surface. Transmitted light is not a mean over surface, so it is multiplied by the same response here. */
static void weight_transmitted(const struct convolution_state *st, size_t at, int x, int py, int count, float *out)
{
    const struct conv_job *j = &st->job;
    const struct conv_front *f = &st->sources.front;
    const struct conv_behind *b = &st->sources.behind;
    const float *light = b->light[j->channel] + at, *along_surface = b->along_surface[j->channel] + at;
    const float total = j->radial[j->channel].total, per = total > 0.0f ? 1.0f / total : 0.0f;

    for (int i = 0; i < count; i++) {
        const int px = (x + i) * b->step > j->extent.rect.x0 ? (x + i) * b->step : j->extent.rect.x0;
        const ptrdiff_t pixel = py * f->stride + px;
        const bool own = b->group[at + (size_t) i] == j->group + 1;
        const bool before = own && px < j->extent.rect.x1 && f->group[pixel] == j->group + 1;
        out[i] = before ? light[i] * (along_surface[i] + (1.0f - along_surface[i]) * per * st->uniform[pixel]) : own ? light[i] : 0.0f;
    }
}

/* Adds a row of cells in a layer to rows [y, y1) of the images. */
static void spread_behind(const struct convolution_state *st, const struct band *to, int layer, int cell_y, int y, int y1)
{
    const struct conv_job *j = &st->job;
    const struct pell_rect *rect = &j->extent.rect;
    const struct conv_front *f = &st->sources.front;
    const struct conv_behind *b = &st->sources.behind;
    const size_t row = ((size_t) layer * (size_t) b->height + (size_t) cell_y) * (size_t) b->width;
    const int first = j->x0 / b->step, end = (rect->x1 - 1) / b->step + 1;
    const int py = cell_y * b->step > rect->y0 ? cell_y * b->step : rect->y0;

    for (int x = first; x < end; x += CELLS) {
        float weighed[CELLS];
        const size_t at = row + (size_t) x;
        struct cells c = {
            .group = b->group + at,
            .coord = b->coord + at,
            .entry_weight = b->entry_weight[j->channel] + at,
            .light = (j->uniform ? b->along_surface : b->light)[j->channel] + at,
            .count = end - x < CELLS ? end - x : CELLS,
            .x = (x * b->step - j->x0) / st->format.step,
            .y = y,
            .y1 = y1,
        };
        const float *close = b->close[j->channel] + at;
        float coord[CELLS];
        bool any = false;
        if (j->divide && !j->uniform) {
            weight_transmitted(st, at, x, py, c.count, weighed);
            c.light = weighed;
        }
        spread_cells(st, to, j->behind ? j->layout.planes + j->between : 0, false, &c);
        for (int i = 0; i < c.count; i++) {
            const int px = (x + i) * b->step > rect->x0 ? (x + i) * b->step : rect->x0;
            const bool moved = b->group[at + (size_t) i] == j->group + 1 && close[i] != 0.0f;
            coord[i] = moved ? f->coord[py * f->stride + px] : 0.0f;
            any = any || moved;
        }
        c.coord = coord;
        c.entry_weight = close;
        if (any)
            spread_cells(st, to, 0, true, &c);
    }
}

static void spread_band(void *arg, int band, int worker)
{
    struct convolution_state *st = arg;
    const struct conv_job *j = &st->job;
    const struct conv_behind *b = &st->sources.behind;
    const int images = j->layout.planes + j->between + j->behind, y0 = band * CONV_BAND;
    const int top = j->extent.rect.y0 / b->step, last = (j->extent.rect.y1 - 1) / b->step; /* other cells have no coordinate */
    const int repeat = b->step > st->format.step ? b->step / st->format.step : 1;
    const struct band to = {
        .images = convolution_band_images(st, worker),
        .size = (size_t) CONV_BAND * (size_t) j->stride,
        .marks = st->occupied + band * st->format.num_images,
        .lit = &st->lit[band],
        .y0 = y0,
        .y1 = y0 + CONV_BAND < j->layout.height ? y0 + CONV_BAND : j->layout.height,
    };

    for (int i = st->format.step == 1 ? j->layout.planes + j->between : 0; i < images; i++) /* the other images are written completely */
        memset(to.images + (size_t) i * to.size, 0, to.size * sizeof(float));
    memset(to.marks, 0, (size_t) st->format.num_images);
    *to.lit = (struct pell_rect) { INT_MAX, INT_MAX, 0, 0 };
    for (int y = y0; y < to.y1; y++)
        spread_front(st, &to, y);
    for (int k = 0; k < b->layers; k++)
        for (int y = y0; y < to.y1; y += repeat)
            for (int cy = (j->y0 + y * st->format.step) / b->step; cy * b->step < j->y0 + (y + repeat) * st->format.step; cy++)
                if (cy >= top && cy <= last)
                    spread_behind(st, &to, k, cy, y, y + repeat < to.y1 ? y + repeat : to.y1);
    convolution_transform_rows(st, band, worker, to.images);
}

void convolution_spread(struct convolution_state *st)
{
    struct conv_job *j = &st->job;
    const int across = convolution_cut(j->layout.across, j->layout.width), down = convolution_cut(j->layout.down, j->layout.height);
    struct pell_rect all = { INT_MAX, INT_MAX, 0, 0 };

    pell_pool_run(st->pool, j->bands, spread_band, st);
    for (int i = 0; i < j->bands; i++)
        if (st->lit[i].x0 < st->lit[i].x1) {
            extend(&all, st->lit[i].x0, st->lit[i].y0);
            extend(&all, st->lit[i].x1 - 1, st->lit[i].y1 - 1);
        }
    j->reached = (struct pell_rect) { 0 };
    if (all.x0 < all.x1)
        j->reached = (struct pell_rect) { all.x0 - across, all.y0 - down, all.x1 + across, all.y1 + down };
}
