/* SPDX-License-Identifier: MIT
 *
 * cpu.c - the convolution method on the cpu engine: samples of the surface, what scatters together in its own rectangle, and for each
 * channel light to planes, rows, columns and kernels, rows back, planes to pixels.
 */
#include "methods/convolution/convolution.h"

#include "base/simd.h"
#include "math/vec.h"
#include "render/renderer.h"

#include <string.h>

PELL_SIMD_TABLES(struct conv_kernels, convolution_kernels);

enum { BAND = 16, SETS = 4, L = PELL_FFT_LANES, E = PELL_FFT_ELEMENT, MULTIPLE = 16 };
enum { T_BEHIND, T_SPECTRA, T_SPREAD, T_ROWS, T_COLUMNS, T_BACK, T_GATHER, TIMES };
#define REACH 1e-4 /* share of the light that may be left out where it goes far */

/* What scatters together: its pixels in a frame. */
struct extent {
    struct pell_rect rect;
    float low, high; /* depth */
    float brightest[3];
    int64_t pixels;
};

struct convolution_state {
    struct pell_renderer *r; /* borrowed */
    struct pell_context *ctx;
    struct pell_pool *pool;
    const struct conv_kernels *kernels;
    struct convolution_knobs knobs;
    struct pell_bodies *bodies; /* or NULL */
    const struct pell_frame_material *materials;
    size_t num_materials, num_groups;
    struct conv_radial (*radial)[3]; /* of materials */
    float *tables;
    struct conv_spectra sets[SETS];
    size_t num_sets;

    struct conv_sources sources;
    float *front_memory, *behind_memory;
    struct extent *rows;  /* of rows of the picture, for one group */
    unsigned char *there; /* groups in a frame */
    int *ray_counts;

    int step; /* pixels to one of an image */
    int num_images;
    float *images, *half, **scratch, *scratch_memory, *even;
    size_t image_size, half_size; /* of one */
    unsigned char *occupied;      /* [band][image] */

    /* The running group and channel. */
    struct job {
        const struct pell_frame *in;
        const struct pell_frame_light *out;
        const struct conv_radial *radial;
        const struct conv_spectra *set;
        struct conv_layout layout;
        struct extent extent;
        size_t group;
        int channel, x0, y0;                     /* of the images' first pixel, in the picture's pixels */
        ptrdiff_t stride;                        /* of images */
        ptrdiff_t block;                         /* of half spectra */
        int between, behind;                     /* images between planes, and of light from behind */
        int bands, column_blocks, behind_blocks; /* blocks of columns: of all, and of those that light from behind has a part in */
        bool even;                               /* of light 1, to divide by */
        bool divide;
        struct pell_fft across, down;
        float *tables[2];
        bool lit[CONV_IMAGES], seen[CONV_IMAGES];
        int list[CONV_IMAGES], count; /* images that the running pass is over, in pairs */
        struct conv_mix mix;
    } job;
    struct pell_pass_time times[TIMES];
    bool timed;
};

/* --- Life ---------------------------------------------------------------------------------------------------------------------- */

static void convolution_destroy(void *state)
{
    struct convolution_state *st = state;

    if (!st)
        return;
    for (size_t i = 0; i < SETS; i++)
        pell_free(st->ctx, st->sets[i].memory);
    pell_free(st->ctx, st->job.tables[0]);
    pell_free(st->ctx, st->occupied);
    pell_free(st->ctx, st->even);
    pell_free(st->ctx, st->scratch);
    pell_free(st->ctx, st->scratch_memory);
    pell_free(st->ctx, st->half);
    pell_free(st->ctx, st->images);
    pell_free(st->ctx, st->ray_counts);
    pell_free(st->ctx, st->there);
    pell_free(st->ctx, st->rows);
    pell_free(st->ctx, st->sources.behind.group);
    pell_free(st->ctx, st->behind_memory);
    pell_free(st->ctx, st->sources.front.group);
    pell_free(st->ctx, st->front_memory);
    pell_free(st->ctx, st->tables);
    pell_free(st->ctx, st->radial);
    pell_bodies_destroy(&st->bodies);
    pell_free(st->ctx, st);
}

static int round_up(int n, int multiple)
{
    return (n + multiple - 1) / multiple * multiple;
}

static enum pell_result make_materials(struct convolution_state *st, const struct pell_frame *shape)
{
    st->materials = shape->materials;
    st->num_materials = shape->num_materials;
    st->radial = pell_calloc(st->ctx, shape->num_materials, sizeof(*st->radial));
    st->tables = pell_alloc_array(st->ctx, shape->num_materials, 3 * CONV_RADIAL_FLOATS * sizeof(float));
    if (!st->radial || !st->tables)
        return PELL_ERR_NOMEM;
    for (size_t i = 0; i < shape->num_materials; i++)
        convolution_radial_make(&shape->materials[i], st->tables + i * 3 * CONV_RADIAL_FLOATS, st->radial[i]);
    st->num_groups = st->bodies ? st->bodies->count : shape->num_materials;
    return PELL_OK;
}

static enum pell_result make_sources(struct convolution_state *st, const struct pell_frame *shape)
{
    struct conv_front *f = &st->sources.front;
    struct conv_behind *b = &st->sources.behind;
    const size_t size = (size_t) shape->width * (size_t) shape->height;
    size_t cells;

    f->stride = shape->width;
    f->group = pell_calloc(st->ctx, size, sizeof(*f->group));
    st->front_memory = pell_alloc_array(st->ctx, size, 9 * sizeof(float));
    st->rows = pell_calloc(st->ctx, (size_t) shape->height + 1, sizeof(*st->rows));
    st->there = pell_calloc(st->ctx, st->num_groups + 1, 1);
    st->ray_counts = pell_calloc(st->ctx, (size_t) shape->height + 1, sizeof(*st->ray_counts));
    if (!f->group || !st->front_memory || !st->rows || !st->there || !st->ray_counts)
        return PELL_ERR_NOMEM;
    f->area = st->front_memory;
    f->lean = f->area + size;
    f->place = f->lean + size;
    for (size_t c = 0; c < 3; c++) {
        f->enters[c] = f->place + (1 + c) * size;
        f->leaves[c] = f->place + (4 + c) * size;
    }
    b->step = 1 << st->knobs.behind_step;
    b->width = (shape->width + b->step - 1) / b->step;
    b->height = (shape->height + b->step - 1) / b->step;
    b->layers = st->bodies ? st->knobs.surfaces - 1 : 0;
    if (b->layers == 0)
        return PELL_OK;
    cells = (size_t) b->width * (size_t) b->height * (size_t) b->layers;
    b->group = pell_calloc(st->ctx, cells, sizeof(*b->group));
    st->behind_memory = pell_alloc_array(st->ctx, cells, 10 * sizeof(float));
    if (!b->group || !st->behind_memory)
        return PELL_ERR_NOMEM;
    b->depth = st->behind_memory;
    b->area = b->depth + cells;
    b->lean = b->area + cells;
    b->place = b->lean + cells;
    for (size_t c = 0; c < 3; c++) {
        b->light[c] = b->place + (1 + c) * cells;
        b->enters[c] = b->place + (4 + c) * cells;
    }
    return PELL_OK;
}

static bool is_even(const struct convolution_state *st)
{
    return st->knobs.borders == CONV_BORDERS_EVEN || (st->knobs.borders == CONV_BORDERS_AUTO && st->knobs.surfaces == 1);
}

static enum pell_result make_images(struct convolution_state *st, const struct pell_frame *shape)
{
    const int width = (shape->width + 2 * st->step - 2) / st->step + 1, height = (shape->height + 2 * st->step - 2) / st->step + 1;
    const int across = pell_fft_good(2 * width, MULTIPLE), down = pell_fft_good(2 * height, MULTIPLE);
    const int workers = pell_pool_threads(st->pool);
    const size_t bands = (size_t) (height + BAND - 1) / BAND;
    size_t scratch, each, table;

    st->num_images = st->knobs.planes + (st->knobs.restore == CONV_BETWEEN ? st->knobs.planes - 1 : 0);
    st->num_images += st->bodies && st->knobs.apart ? st->knobs.planes : 0;
    st->image_size = (size_t) round_up(width, L) * bands * BAND;
    st->half_size = ((size_t) across / 32 + 1) * bands * BAND * E;
    st->images = pell_alloc_array(st->ctx, st->image_size, (size_t) st->num_images * sizeof(float));
    st->half = pell_alloc_array(st->ctx, st->half_size, (size_t) st->num_images * sizeof(float));
    st->occupied = pell_calloc(st->ctx, bands, (size_t) st->num_images);
    if (is_even(st))
        st->even = pell_alloc_array(st->ctx, (size_t) shape->width * (size_t) shape->height, sizeof(float));
    each = pell_fft_buffer(across > down ? across : down);
    scratch = ((size_t) st->num_images + 2) * each;
    if (scratch < convolution_spectra_scratch(width, height))
        scratch = convolution_spectra_scratch(width, height);
    scratch = (scratch + 63) / 16 * 16;
    st->scratch = pell_calloc(st->ctx, (size_t) workers, sizeof(*st->scratch));
    st->scratch_memory = pell_alloc_array(st->ctx, scratch, (size_t) workers * sizeof(float));
    table = 3 * (size_t) (across > down ? across : down) + 4096;
    st->job.tables[0] = pell_alloc_array(st->ctx, table, 2 * sizeof(float));
    if (!st->images || !st->half || !st->occupied || !st->scratch || !st->scratch_memory || !st->job.tables[0] ||
        (is_even(st) && !st->even))
        return PELL_ERR_NOMEM;
    st->job.tables[1] = st->job.tables[0] + table;
    for (int i = 0; i < workers; i++)
        st->scratch[i] = st->scratch_memory + (size_t) i * scratch;
    st->num_sets = st->num_groups < SETS ? st->num_groups : SETS;
    for (size_t i = 0; i < st->num_sets; i++) {
        st->sets[i].size = convolution_spectra_size(&st->knobs, shape->orthographic, width, height);
        st->sets[i].memory = pell_alloc_array(st->ctx, st->sets[i].size, sizeof(float));
        if (!st->sets[i].memory)
            return PELL_ERR_NOMEM;
    }
    return PELL_OK;
}

static enum pell_result convolution_create(struct pell_renderer *r, const struct pell_frame *shape, const void *knobs, void **state)
{
    struct pell_context *ctx = pell_renderer_context(r);
    struct convolution_state *st = pell_zalloc(ctx, sizeof(*st));
    enum pell_result res;

    *state = st;
    if (!st)
        return PELL_ERR_NOMEM;
    st->r = r;
    st->ctx = ctx;
    st->pool = pell_renderer_pool(r);
    st->kernels = convolution_kernels_tables[pell_simd_best()];
    st->knobs = *(const struct convolution_knobs *) knobs;
    st->step = 1 << st->knobs.resolution;
    if (shape->width > PELL_FFT_MOST / 4 || shape->height > PELL_FFT_MOST / 4)
        return pell_error(ctx, PELL_ERR_UNSUPPORTED, "convolution", NULL, "%d x %d pixels, at most %d a side", shape->width, shape->height,
                          PELL_FFT_MOST / 4);
    if (st->knobs.surfaces > 1)
        PELL_TRY(pell_renderer_bodies(r, &st->bodies));
    PELL_TRY(make_materials(st, shape));
    PELL_TRY(make_sources(st, shape));
    PELL_TRY(make_images(st, shape));
    st->sources.r = r;
    st->sources.bodies = st->bodies;
    return PELL_OK;

fail:
    return res;
}

/* --- Who is where -------------------------------------------------------------------------------------------------------------- */

static void group_row(void *arg, int index, int worker)
{
    const struct convolution_state *st = arg;
    const struct pell_frame *in = st->sources.in;
    const int y = in->rect.y0 + index;
    uint16_t *group = st->sources.front.group + y * st->sources.front.stride;

    (void) worker;
    for (int x = in->rect.x0; x < in->rect.x1; x++) {
        const ptrdiff_t i = y * in->stride + x;
        group[x] = in->material[i];
        if (group[x] && st->bodies)
            group[x] = in->mesh[i] < st->bodies->num_meshes ? (uint16_t) (st->bodies->of_mesh[in->mesh[i]] + 1) : 0;
    }
}

static void front_row(void *arg, int index, int worker)
{
    const struct convolution_state *st = arg;

    (void) worker;
    convolution_front_row(&st->sources, st->sources.in->rect.y0 + index);
}

static void behind_row(void *arg, int index, int worker)
{
    struct convolution_state *st = arg;

    (void) worker;
    st->ray_counts[index] = convolution_behind_row(&st->sources, st->sources.in->rect.y0 / st->sources.behind.step + index);
}

static void add_depth(struct extent *e, float depth)
{
    e->low = depth < e->low ? depth : e->low;
    e->high = depth > e->high ? depth : e->high;
}

static const struct extent nothing = { .rect = { 65536, 65536, 0, 0 }, .low = INFINITY, .high = -INFINITY };

static void extent_row(void *arg, int index, int worker)
{
    struct convolution_state *st = arg;
    const struct pell_frame *in = st->sources.in;
    const struct conv_behind *b = &st->sources.behind;
    const int y = in->rect.y0 + index;
    struct extent e = nothing;

    (void) worker;
    for (int x = in->rect.x0; x < in->rect.x1; x++) {
        if (st->sources.front.group[y * st->sources.front.stride + x] != st->job.group + 1)
            continue;
        e.rect.x0 = e.pixels ? e.rect.x0 : x;
        e.rect.x1 = x + 1;
        e.pixels++;
        add_depth(&e, in->depth[y * in->stride + x]);
        for (int c = 0; c < 3; c++)
            e.brightest[c] = fmaxf(e.brightest[c], in->irradiance[c][y * in->stride + x]);
    }
    e.rect.y0 = y;
    e.rect.y1 = y + 1;
    /* Cells that begin in this row, and those that begin above all. */
    for (int k = 0; k < b->layers && (y % b->step == 0 || index == 0); k++) {
        const size_t row = ((size_t) k * (size_t) b->height + (size_t) (y / b->step)) * (size_t) b->width;
        for (int x = in->rect.x0 / b->step; x <= (in->rect.x1 - 1) / b->step; x++)
            if (b->group[row + (size_t) x] == st->job.group + 1)
                add_depth(&e, b->depth[row + (size_t) x]);
    }
    st->rows[index] = e;
}

/* Of the job's group. */
static struct extent find_extent(struct convolution_state *st)
{
    const struct pell_frame *in = st->sources.in;
    const int rows = in->rect.y1 - in->rect.y0;
    struct extent all = nothing;

    pell_pool_run(st->pool, rows, extent_row, st);
    for (int i = 0; i < rows; i++) {
        const struct extent *e = &st->rows[i];
        if (e->low <= e->high) {
            add_depth(&all, e->low);
            add_depth(&all, e->high);
        }
        if (e->pixels == 0)
            continue;
        all.rect.x0 = e->rect.x0 < all.rect.x0 ? e->rect.x0 : all.rect.x0;
        all.rect.x1 = e->rect.x1 > all.rect.x1 ? e->rect.x1 : all.rect.x1;
        all.rect.y0 = e->rect.y0 < all.rect.y0 ? e->rect.y0 : all.rect.y0;
        all.rect.y1 = e->rect.y1;
        for (int c = 0; c < 3; c++)
            all.brightest[c] = fmaxf(all.brightest[c], e->brightest[c]);
        all.pixels += e->pixels;
    }
    return all;
}

/* --- Planes -------------------------------------------------------------------------------------------------------------------- */

static float clamp(float x, float low, float high)
{
    return x < low ? low : x > high ? high : x;
}

static float pixel_at(const struct pell_frame *in, float depth)
{
    return (in->orthographic ? 1.0f : depth) / in->focal_px;
}

/* The depths under which 1/n, 2/n .. of the surface are, mixed with equal ones. */
static void place_by_surface(const struct convolution_state *st, struct conv_layout *lay, float low, float high)
{
    enum { BINS = 256 };
    const struct pell_frame *in = st->sources.in;
    const struct conv_behind *b = &st->sources.behind;
    const struct extent *e = &st->job.extent;
    const float gap = 8.001f * pixel_at(in, high) * (float) st->step;
    double count[BINS] = { 0 }, all = 0.0, sum = 0.0;
    int at = 1;

    for (int y = e->rect.y0; y < e->rect.y1; y++)
        for (int x = e->rect.x0; x < e->rect.x1; x++)
            if (st->sources.front.group[y * st->sources.front.stride + x] == st->job.group + 1)
                count[(int) (clamp((in->depth[y * in->stride + x] - low) / (high - low), 0.0f, 0.9999f) * BINS)] += 1.0;
    for (size_t i = 0; i < (size_t) b->layers * (size_t) b->width * (size_t) b->height; i++)
        if (b->group[i] == st->job.group + 1)
            count[(int) (clamp((b->depth[i] - low) / (high - low), 0.0f, 0.9999f) * BINS)] += (double) (b->step * b->step);
    for (int i = 0; i < BINS; i++)
        all += count[i];
    for (int i = 0; i < BINS && at < lay->planes - 1; i++) {
        const double share = 0.5 * count[i] / all + 0.5 / BINS;
        for (; at < lay->planes - 1 && sum + share >= (double) at / (lay->planes - 1); at++)
            lay->depth[at] = low + (high - low) * (float) ((i + ((double) at / (lay->planes - 1) - sum) / share) / BINS);
        sum += share;
    }
    /* However much of the surface is at one depth: no closer than lay_out made sure that there is room for. */
    for (int i = 1; i < lay->planes - 1; i++)
        lay->depth[i] = fmaxf(lay->depth[i], lay->depth[i - 1] + gap);
    for (int i = lay->planes - 2; i > 0; i--)
        lay->depth[i] = fminf(lay->depth[i], lay->depth[i + 1] - gap);
}

/* Chooses planes, sizes and lengths of transforms. */
static void lay_out(struct convolution_state *st)
{
    struct job *j = &st->job;
    const struct pell_frame *in = j->in;
    const struct extent *e = &j->extent;
    const int align = st->step > st->sources.behind.step ? st->step : st->sources.behind.step;
    const double reach = convolution_reach(j->radial, REACH);
    struct conv_layout *lay = &j->layout;
    const float middle = 0.5f * (e->low + e->high), unit = pixel_at(in, middle);
    float low = e->low, high = e->high;
    double pad;

    memset(lay, 0, sizeof(*lay));
    lay->group = j->group;
    lay->planes = st->knobs.planes;
    if (!(high - low > 1e-2f * unit) || !(high - low > 4e-6f * high)) /* as good as flat, and facing */
        lay->planes = 1;
    if (st->knobs.placement == CONV_SURFACE) /* no closer than kernels that are sampled every second pixel want it */
        for (; lay->planes > 2 && high - low < 16.0f * unit * (float) (st->step * (lay->planes - 1)); lay->planes--)
            continue;
    if (st->knobs.placement == CONV_SURFACE && lay->planes == 2 && high - low < 8.0f * unit * (float) st->step)
        lay->planes = 1;
    for (int i = 0; i < lay->planes; i++)
        lay->depth[i] = lay->planes == 1 ? middle : low + (high - low) * ((float) i / (float) (lay->planes - 1));
    if (st->knobs.placement == CONV_SURFACE && lay->planes > 2)
        place_by_surface(st, lay, low, high);
    lay->unit = unit * (float) st->step;
    for (int i = 0; i < lay->planes; i++)
        lay->pixel[i] = clamp(pixel_at(in, lay->depth[i]), 1e-3f * unit, 1e3f * unit) * (float) st->step;
    j->x0 = e->rect.x0 / align * align;
    j->y0 = e->rect.y0 / align * align;
    lay->width = (e->rect.x1 - j->x0 + st->step - 1) / st->step;
    lay->height = (e->rect.y1 - j->y0 + st->step - 1) / st->step;
    pad = ceil(fmin(reach / (double) lay->pixel[0], 1e9)) + 1.0;
    lay->across = pell_fft_good(lay->width + (int) fmin(pad, lay->width), MULTIPLE);
    lay->down = pell_fft_good(lay->height + (int) fmin(pad, lay->height), MULTIPLE);
}

/* Number of the plane before a depth, and how far it is to the next. */
static float find_place(const struct conv_layout *lay, float depth)
{
    int i = 0;
    float t;

    if (lay->planes == 1)
        return 0.0f;
    while (i + 2 < lay->planes && depth >= lay->depth[i + 1])
        i++;
    t = (depth - lay->depth[i]) / (lay->depth[i + 1] - lay->depth[i]);
    return (float) i + clamp(t, 0.0f, 0.99999f);
}

/* How far light behind is from the planes that it and what lies before it share: the distance at which as much arrives as on the mean over
 * all rays. Planes without any: half way to the next. */
static void measure_behind(struct convolution_state *st)
{
    enum { BINS = 48 };
    struct job *j = &st->job;
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
                p = f->place[at];
                q = b->place[i];
                distance = b->depth[i] - j->in->depth[y * j->in->stride + x];
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
            const double next = n == 1 ? 0.0 : (double) (lay->depth[l + 1 < n ? l + 1 : l] - lay->depth[l + 1 < n ? l : l - 1]);
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
            lay->behind[c][l] = (float) (n == 1 ? 0.0 : all > 0.0 ? high : 0.5 * next);
        }
}

static void place_row(void *arg, int index, int worker)
{
    const struct convolution_state *st = arg;
    const struct job *j = &st->job;
    const struct pell_frame *in = j->in;
    const struct conv_front *f = &st->sources.front;
    const struct conv_behind *b = &st->sources.behind;
    const int y = j->extent.rect.y0 + index;

    (void) worker;
    for (int x = j->extent.rect.x0; x < j->extent.rect.x1; x++)
        if (f->group[y * f->stride + x] == j->group + 1)
            f->place[y * f->stride + x] = find_place(&j->layout, in->depth[y * in->stride + x]);
    for (int k = 0; k < b->layers && (y % b->step == 0 || index == 0); k++) {
        const size_t row = ((size_t) k * (size_t) b->height + (size_t) (y / b->step)) * (size_t) b->width;
        for (int x = j->x0 / b->step; x <= (j->extent.rect.x1 - 1) / b->step; x++)
            if (b->group[row + (size_t) x] == j->group + 1)
                b->place[row + (size_t) x] = find_place(&j->layout, b->depth[row + (size_t) x]);
    }
}

/* --- Light to planes ----------------------------------------------------------------------------------------------------------- */

/* What light weighs where it enters and where it leaves, of each channel: areas in pixels of the middle, and what splitting and gathering
 * give back of a flat surface's light. By its place among the planes: half of the factor where light enters, half where it leaves; by its
 * lean, on the mean over places: all where it enters, as a pixel that leans alone has no neighbours that give it more.
 * `leaves` may be NULL. */
static void weigh(const struct convolution_state *st, float place, float area, float lean, float enters[3], float leaves[3])
{
    const struct job *j = &st->job;
    const struct conv_layout *lay = &j->layout;
    const int plane = (int) place, next = plane + 1 < lay->planes ? plane + 1 : plane;
    const float t = place - (float) plane, u = t * (CONV_PHASES - 1), p = lay->pixel[plane], q = lay->pixel[next], mm = p + t * (q - p);
    const float s = (lean > 0.0f ? lean : 0.0f) * (float) ((CONV_LEANS - 1) / 0.994987437);
    const int a = s < CONV_LEANS - 2 ? (int) s : CONV_LEANS - 2, b = u < CONV_PHASES - 2 ? (int) u : CONV_PHASES - 2;
    const float fs = clamp(s - (float) a, 0.0f, 1.0f), fu = u - (float) b, pixels = clamp(area / (lay->unit * lay->unit), 1e-4f, 1e5f);

    for (int c = 0; c < 3; c++) {
        const struct conv_response *r = &j->set->response[c][j->set->num_responses > 1 ? plane : 0];
        const float *low = r->value[a] + b, *high = r->value[a + 1] + b,
                    facing = r->value[0][b] + fu * (r->value[0][b + 1] - r->value[0][b]);
        const float first = low[0] + fu * (low[1] - low[0]), second = high[0] + fu * (high[1] - high[0]);
        const float leaning = first + fs * (second - first), mean = r->mean[a] + fs * (r->mean[a + 1] - r->mean[a]);
        float wide = 1.0f;
        enters[c] = pixels;
        if (leaves)
            leaves[c] = 1.0f;
        if (st->knobs.restore == CONV_LOST || j->divide)
            continue;
        if (p != q) { /* pixels of a plane are not as wide as those at the depth itself */
            float share = (1.0f - t) / (p * p) + t / (q * q);
            if (st->knobs.restore == CONV_RESPONSE) {
                const float own = (1.0f - t) * (1.0f - t) + t * t, all = 1.0f / (facing * facing), other = all > own ? all - own : 0.0f;
                share = ((1.0f - t) * (1.0f - t) / (p * p) + t * t / (q * q) + other / (p * q)) / (own + other);
            }
            wide = 1.0f / (mm * sqrtf(share));
        }
        enters[c] *= leaning * mean * (lean < 0.0f ? 1.0f - lean : 1.0f) * wide;
        if (leaves)
            leaves[c] = leaning / mean * wide;
    }
}

static void weigh_row(void *arg, int index, int worker)
{
    const struct convolution_state *st = arg;
    const struct job *j = &st->job;
    const struct conv_front *f = &st->sources.front;
    const struct conv_behind *b = &st->sources.behind;
    const int y = j->extent.rect.y0 + index;
    float enters[3], leaves[3];

    (void) worker;
    for (int x = j->extent.rect.x0; x < j->extent.rect.x1; x++) {
        const ptrdiff_t i = y * f->stride + x;
        if (f->group[i] != j->group + 1)
            continue;
        weigh(st, f->place[i], f->area[i], f->lean[i], enters, leaves);
        for (int c = 0; c < 3; c++) {
            f->enters[c][i] = enters[c];
            f->leaves[c][i] = leaves[c];
        }
    }
    for (int k = 0; k < b->layers && (y % b->step == 0 || index == 0); k++) {
        const size_t row = ((size_t) k * (size_t) b->height + (size_t) (y / b->step)) * (size_t) b->width;
        for (int x = j->x0 / b->step; x <= (j->extent.rect.x1 - 1) / b->step; x++) {
            const size_t i = row + (size_t) x;
            if (b->group[i] != j->group + 1)
                continue;
            weigh(st, b->place[i], b->area[i], b->lean[i], enters, NULL);
            for (int c = 0; c < 3; c++)
                b->enters[c][i] = enters[c];
        }
    }
}

static float *image_at(const struct convolution_state *st, int image)
{
    return st->images + (size_t) image * st->image_size;
}

/* Adds light at pixel i of the images that a band marks as its own. */
static inline void add_light(const struct convolution_state *st, unsigned char *marks, ptrdiff_t i, float place, float light, bool front)
{
    const struct job *j = &st->job;
    const int plane = (int) place, first = front || !j->behind ? plane : plane + j->layout.planes + j->between;
    const float t = place - (float) plane, share = st->knobs.split == CONV_HALF ? 0.5f : t;
    float *image = st->images + (size_t) first * st->image_size + i;

    marks[first] = 1;
    if (j->layout.planes == 1) {
        image[0] += light;
        return;
    }
    image[0] += (1.0f - share) * light;
    image[st->image_size] += share * light;
    marks[first + 1] = 1;
    if (j->between && front) {
        const int between = j->layout.planes + plane;
        st->images[(size_t) between * st->image_size + (size_t) i] += sqrtf(2.0f * t * (1.0f - t)) * light;
        marks[between] = 1;
    }
}

static void spread_front(const struct convolution_state *st, unsigned char *marks, int y)
{
    const struct job *j = &st->job;
    const struct pell_rect *rect = &j->extent.rect;
    const struct conv_front *f = &st->sources.front;
    const uint16_t own = (uint16_t) (j->group + 1);

    for (int py = j->y0 + y * st->step; py < j->y0 + (y + 1) * st->step; py++) {
        const float *light = j->in->irradiance[j->channel] + py * j->in->stride, *enters = f->enters[j->channel] + py * f->stride;
        const float *place = f->place + py * f->stride;
        const uint16_t *group = f->group + py * f->stride;
        for (int x = rect->x0; py >= rect->y0 && py < rect->y1 && x < rect->x1; x++) {
            const float e = group[x] != own ? 0.0f : j->even ? enters[x] : enters[x] * light[x];
            if (e != 0.0f)
                add_light(st, marks, y * j->stride + (x - j->x0) / st->step, place[x], e, true);
        }
    }
}

static void spread_behind(const struct convolution_state *st, unsigned char *marks, int y)
{
    const struct job *j = &st->job;
    const struct conv_behind *b = &st->sources.behind;
    const int first = (j->y0 + y * st->step) / b->step, last = (j->y0 + (y + 1) * st->step - 1) / b->step;
    const int across = b->step > st->step ? b->step / st->step : 1; /* pixels of the images that a cell covers, each way */
    const int top = j->extent.rect.y0 / b->step, end = (j->extent.rect.y1 - 1) / b->step; /* others were not placed */

    for (int k = 0; k < b->layers; k++)
        for (int cy = first > top ? first : top; cy <= last && cy <= end; cy++)
            for (int cx = j->x0 / b->step; cx <= (j->extent.rect.x1 - 1) / b->step; cx++) {
                const size_t i = ((size_t) k * (size_t) b->height + (size_t) cy) * (size_t) b->width + (size_t) cx;
                float e;
                if (b->group[i] != j->group + 1)
                    continue;
                e = (j->even ? 1.0f : b->light[j->channel][i]) * b->enters[j->channel][i] / (float) (across * across);
                if (e == 0.0f)
                    continue;
                for (int n = 0; n < across; n++) {
                    const int x = (cx * b->step - j->x0) / st->step + n;
                    if (x < j->layout.width)
                        add_light(st, marks, y * j->stride + x, b->place[i], e, false);
                }
            }
}

static void spread_band(void *arg, int band, int worker)
{
    struct convolution_state *st = arg;
    const struct job *j = &st->job;
    const int y1 = (band + 1) * BAND < j->layout.height ? (band + 1) * BAND : j->layout.height;
    unsigned char *marks = st->occupied + band * st->num_images;

    (void) worker;
    for (int i = 0; i < j->layout.planes + j->between + j->behind; i++)
        memset(image_at(st, i) + band * BAND * j->stride, 0, (size_t) (y1 - band * BAND) * (size_t) j->stride * sizeof(float));
    memset(marks, 0, (size_t) st->num_images);
    for (int y = band * BAND; y < y1; y++) {
        spread_front(st, marks, y);
        spread_behind(st, marks, y);
    }
}

/* --- Transforms ---------------------------------------------------------------------------------------------------------------- */

static void buffers_of(const struct convolution_state *st, int worker, float *buffer[2])
{
    const struct conv_layout *lay = &st->job.layout;

    buffer[0] = st->scratch[worker];
    buffer[1] = buffer[0] + pell_fft_buffer(lay->across > lay->down ? lay->across : lay->down);
}

static float *half_at(const struct convolution_state *st, int image)
{
    return st->half + (size_t) image * st->half_size;
}

/* Two images of a list: a band each. */
static void rows_band(void *arg, int index, int worker)
{
    struct convolution_state *st = arg;
    const struct job *j = &st->job;
    const int pair = index / j->bands, band = index % j->bands, y = band * BAND;
    const int rows = j->layout.height - y < BAND ? j->layout.height - y : BAND;
    const int a = j->list[2 * pair], b = 2 * pair + 1 < j->count ? j->list[2 * pair + 1] : -1;
    const bool any = st->occupied[band * st->num_images + a] || (b >= 0 && st->occupied[band * st->num_images + b]);
    float *buffer[2];

    buffers_of(st, worker, buffer);
    if (any) {
        pell_fft_rows(&j->across, image_at(st, a) + y * j->stride, b >= 0 ? image_at(st, b) + y * j->stride : NULL, j->stride,
                      j->layout.width, rows, half_at(st, a) + E * y, b >= 0 ? half_at(st, b) + E * y : NULL, j->block, buffer);
        return;
    }
    for (int i = 0; i < 2; i++)
        for (int at = 0; at < j->column_blocks && (i == 0 || b >= 0); at++)
            memset(half_at(st, i ? b : a) + at * j->block + E * y, 0, (size_t) rows * E * sizeof(float));
}

static void back_band(void *arg, int index, int worker)
{
    struct convolution_state *st = arg;
    const struct job *j = &st->job;
    const int pair = index / j->bands, band = index % j->bands, y = band * BAND;
    const int rows = j->layout.height - y < BAND ? j->layout.height - y : BAND;
    const int a = j->list[2 * pair], b = 2 * pair + 1 < j->count ? j->list[2 * pair + 1] : -1;
    float *buffer[2];

    buffers_of(st, worker, buffer);
    pell_fft_rows_back(&j->across, half_at(st, a) + E * y, b >= 0 ? half_at(st, b) + E * y : NULL, j->block,
                       image_at(st, a) + y * j->stride, b >= 0 ? image_at(st, b) + y * j->stride : NULL, j->stride, j->layout.width, rows,
                       buffer);
}

/* All images of a block of columns: there, through the kernels, and back. */
static void columns_block(void *arg, int index, int worker)
{
    struct convolution_state *st = arg;
    const struct job *j = &st->job;
    const int down = j->layout.down, height = j->layout.height;
    const size_t size = (size_t) height * E * sizeof(float), rest = (size_t) (down - height) * E * sizeof(float);
    struct conv_mix mix = j->mix;
    float *spare = st->scratch[worker];

    if (pell_cancelled(st->ctx))
        return;
    for (int i = 0; i < mix.planes + mix.between + mix.behind; i++) {
        float *data = st->scratch[worker] + (size_t) (i + 1) * pell_fft_buffer(down), *there;
        mix.column[i] = NULL;
        if ((!j->lit[i] && !j->seen[i]) || (i >= mix.planes + mix.between && index >= j->behind_blocks))
            continue;
        if (!j->lit[i]) {
            memset(data, 0, size + rest);
            mix.column[i] = data;
            continue;
        }
        memcpy(data, half_at(st, i) + index * j->block, size);
        memset(data + (ptrdiff_t) height * E, 0, rest);
        there = pell_fft_run(&j->down, false, data, spare);
        if (there != data)
            memcpy(data, there, size + rest);
        mix.column[i] = data;
    }
    st->kernels->mix(&mix, index);
    for (int i = 0; i < mix.planes + mix.between + mix.behind; i++)
        if (j->seen[i])
            memcpy(half_at(st, i) + index * j->block, pell_fft_run(&j->down, true, mix.column[i], spare), size);
}

/* --- Planes to pixels ---------------------------------------------------------------------------------------------------------- */

/* Between the four pixels of an image around a point. */
static inline float between_pixels(const float *p, ptrdiff_t right, ptrdiff_t down, float fx, float fy)
{
    const float top = p[0] + fx * (p[right] - p[0]), bottom = p[down] + fx * (p[down + right] - p[down]);
    return top + fy * (bottom - top);
}

static float gather_pixel(const struct convolution_state *st, int x, int y)
{
    const struct job *j = &st->job;
    const float place = st->sources.front.place[y * st->sources.front.stride + x];
    const int plane = (int) place, several = j->layout.planes > 1;
    const float t = place - (float) plane, *first = image_at(st, plane), *second = first + (several ? st->image_size : 0);
    const float *between = j->between ? image_at(st, j->layout.planes + plane) : NULL;
    float sum;

    if (st->step == 1) {
        const ptrdiff_t i = (y - j->y0) * j->stride + x - j->x0;
        sum = first[i] + t * (second[i] - first[i]);
        return between ? sum + sqrtf(2.0f * t * (1.0f - t)) * between[i] : sum;
    } else {
        const int last_x = j->layout.width - 1, last_y = j->layout.height - 1;
        const float u = clamp(((float) (x - j->x0) + 0.5f) / (float) st->step - 0.5f, 0.0f, (float) last_x);
        const float v = clamp(((float) (y - j->y0) + 0.5f) / (float) st->step - 0.5f, 0.0f, (float) last_y);
        const int px = (int) u, py = (int) v;
        const ptrdiff_t i = py * j->stride + px, right = px < last_x, down = py < last_y ? j->stride : 0;
        const float fx = u - (float) px, fy = v - (float) py;
        sum = (1.0f - t) * between_pixels(first + i, right, down, fx, fy) + t * between_pixels(second + i, right, down, fx, fy);
        return between ? sum + sqrtf(2.0f * t * (1.0f - t)) * between_pixels(between + i, right, down, fx, fy) : sum;
    }
}

static void gather_row(void *arg, int index, int worker)
{
    struct convolution_state *st = arg;
    const struct job *j = &st->job;
    const struct conv_front *f = &st->sources.front;
    const struct conv_radial *r = &j->radial[j->channel];
    const int y = j->extent.rect.y0 + index;
    float *out = j->out->light[j->channel] + y * j->in->stride;

    (void) worker;
    for (int x = j->extent.rect.x0; x < j->extent.rect.x1; x++) {
        const ptrdiff_t i = y * f->stride + x;
        float m;
        if (f->group[i] != j->group + 1)
            continue;
        m = gather_pixel(st, x, y) * f->leaves[j->channel][i];
        if (j->even) {
            st->even[i] = m;
            continue;
        }
        if (j->divide) { /* a mean of what is there, whatever rounding says of light that is far dimmer than elsewhere */
            m = st->even[i] > 0.0f ? m / st->even[i] : j->in->irradiance[j->channel][y * j->in->stride + x];
            m = r->total * (m < j->extent.brightest[j->channel] ? m : j->extent.brightest[j->channel]);
        }
        out[x] = m > 0.0f ? m : 0.0f;
    }
}

/* --- A frame ------------------------------------------------------------------------------------------------------------------- */

static void note_time(struct convolution_state *st, int which, double *from, int64_t pixels, int64_t bytes)
{
    const double now = pell_seconds();

    st->times[which].seconds += now - *from;
    st->times[which].pixels += pixels;
    st->times[which].bytes += bytes;
    *from = now;
}

static void list_images(struct job *j, const bool *which)
{
    j->count = 0;
    for (int i = 0; i < j->layout.planes + j->between + j->behind; i++)
        if (which[i])
            j->list[j->count++] = i;
}

/* Which images the picture needs. */
static void find_seen(struct convolution_state *st)
{
    struct job *j = &st->job;
    const struct pell_rect *rect = &j->extent.rect;
    const struct conv_front *f = &st->sources.front;

    for (int i = 0; i < CONV_IMAGES; i++)
        j->seen[i] = !st->knobs.visible && i < j->layout.planes + j->between;
    for (int y = rect->y0; y < rect->y1 && st->knobs.visible; y++)
        for (int x = rect->x0; x < rect->x1; x++)
            if (f->group[y * f->stride + x] == j->group + 1) {
                const int plane = (int) f->place[y * f->stride + x];
                j->seen[plane] = true;
                if (j->layout.planes > 1)
                    j->seen[plane + 1] = true;
                if (j->between)
                    j->seen[j->layout.planes + plane] = true;
            }
}

static void set_mix(struct convolution_state *st)
{
    struct job *j = &st->job;
    const int c = j->channel, n = j->layout.planes;

    memset(&j->mix, 0, sizeof(j->mix));
    j->mix.height = j->layout.down;
    j->mix.planes = n;
    j->mix.between = j->between;
    j->mix.behind = j->behind;
    for (int i = 0; i < j->behind; i++)
        j->mix.behind_own[i] = j->set->behind[c][i].data ? &j->set->behind[c][i] : NULL;
    j->behind_blocks = 0;
    for (int i = 0; i < j->behind; i++)
        j->behind_blocks = j->set->behind[c][i].blocks > j->behind_blocks ? j->set->behind[c][i].blocks : j->behind_blocks;
    for (int i = 0; i < j->set->num_pairs; i++)
        if (j->set->pairs[c][i].spectrum && j->set->pairs[c][i].spectrum->blocks > j->behind_blocks)
            j->behind_blocks = j->set->pairs[c][i].spectrum->blocks;
    j->mix.pairs = j->set->pairs[c];
    j->mix.num_pairs = j->set->num_pairs;
    for (int i = 0; i < n; i++)
        j->mix.own[i] = &j->set->own[c][j->set->num_own > 1 ? i : 0];
    for (int i = 0, at = 0; i < n; i++)
        for (int to = i + 1; to < n; to++, at++)
            if (to == i + 1) {
                j->mix.next[i] = j->set->pairs[c][at].spectrum;
                j->mix.next_factor[i] = j->set->pairs[c][at].factor;
            }
}

static void convolve(struct convolution_state *st, int channel, bool even)
{
    struct job *j = &st->job;
    const int images = j->layout.planes + j->between + j->behind;
    const int64_t image_pixels = (int64_t) j->layout.width * j->layout.height;
    const int64_t half_bytes = (int64_t) (j->layout.across / 2) * j->layout.height * 8;
    double clock = pell_seconds();
    int lit = 0;

    j->channel = channel;
    j->even = even;
    set_mix(st);
    pell_pool_run(st->pool, j->bands, spread_band, st);
    for (int i = 0; i < images; i++) {
        j->lit[i] = false;
        for (int band = 0; band < j->bands; band++)
            j->lit[i] = j->lit[i] || st->occupied[band * st->num_images + i];
        lit += j->lit[i];
    }
    note_time(st, T_SPREAD, &clock, j->extent.pixels, j->extent.pixels * 20 + images * image_pixels * 4);
    list_images(j, j->lit);
    pell_pool_run(st->pool, j->bands * ((j->count + 1) / 2), rows_band, st);
    note_time(st, T_ROWS, &clock, lit * image_pixels, lit * (image_pixels * 4 + half_bytes));
    pell_pool_run(st->pool, j->column_blocks, columns_block, st);
    note_time(st, T_COLUMNS, &clock, images * image_pixels, images * half_bytes * 2);
    list_images(j, j->seen);
    pell_pool_run(st->pool, j->bands * ((j->count + 1) / 2), back_band, st);
    note_time(st, T_BACK, &clock, j->count * image_pixels, j->count * (image_pixels * 4 + half_bytes));
    pell_pool_run(st->pool, j->extent.rect.y1 - j->extent.rect.y0, gather_row, st);
    note_time(st, T_GATHER, &clock, j->extent.pixels, j->extent.pixels * 24);
}

static enum pell_result render_group(struct convolution_state *st, size_t group)
{
    struct job *j = &st->job;
    struct conv_spectra *set = &st->sets[group % st->num_sets];
    double clock = pell_seconds();

    j->group = group;
    j->radial = st->radial[st->bodies ? st->bodies->bodies[group].material : group];
    j->extent = find_extent(st);
    if (j->extent.pixels == 0)
        return PELL_OK;
    lay_out(st);
    j->between = st->knobs.restore == CONV_BETWEEN ? j->layout.planes - 1 : 0;
    j->stride = round_up(j->layout.width, L);
    j->block = (ptrdiff_t) j->layout.height * E;
    j->bands = (j->layout.height + BAND - 1) / BAND;
    j->column_blocks = j->layout.across / 32 + 1;
    j->divide = is_even(st);
    pell_fft_init(&j->across, j->layout.across, j->tables[0]);
    pell_fft_init(&j->down, j->layout.down, j->tables[1]);
    pell_pool_run(st->pool, j->extent.rect.y1 - j->extent.rect.y0, place_row, st);
    find_seen(st);
    for (int c = 0; c < 3; c++)
        for (int i = 0; i < CONV_PLANES; i++)
            j->layout.behind[c][i] = -1.0f;
    j->behind = st->knobs.apart && st->sources.behind.layers > 0 ? j->layout.planes : 0;
    if (j->behind)
        measure_behind(st);
    convolution_spectra_make(st->pool, &st->knobs, j->radial, &j->layout, st->scratch, set);
    if (pell_cancelled(st->ctx)) {
        set->layout.planes = 0;
        return PELL_ERR_CANCELLED;
    }
    j->set = set;
    pell_pool_run(st->pool, j->extent.rect.y1 - j->extent.rect.y0, weigh_row, st);
    note_time(st, T_SPECTRA, &clock, 0, 0);
    for (int c = 0; c < 3; c++) {
        if (j->divide)
            convolve(st, c, true);
        convolve(st, c, false);
        if (pell_cancelled(st->ctx))
            return PELL_ERR_CANCELLED;
    }
    return PELL_OK;
}

static void find_behind(struct convolution_state *st)
{
    const struct pell_frame *in = st->sources.in;
    const struct conv_behind *b = &st->sources.behind;
    const int rows = (in->rect.y1 - 1) / b->step - in->rect.y0 / b->step + 1;
    double clock = pell_seconds();

    memset(st->sources.behind.group, 0, (size_t) b->layers * (size_t) b->width * (size_t) b->height * sizeof(*b->group));
    pell_pool_run(st->pool, rows, behind_row, st);
    for (int i = 0; i < rows; i++)
        st->times[T_BEHIND].rays += st->ray_counts[i];
    note_time(st, T_BEHIND, &clock, (int64_t) rows * b->width, (int64_t) rows * b->width * b->layers * 32);
}

static enum pell_result convolution_render(void *state, const struct pell_frame *in, const struct pell_frame_light *out)
{
    static const char *const names[TIMES] = { "behind", "spectra", "light to planes", "rows", "columns", "rows back", "planes to pixels" };
    struct convolution_state *st = state;
    enum pell_result res;

    for (int i = 0; i < TIMES; i++)
        st->times[i] = (struct pell_pass_time){ .name = names[i] };
    st->timed = true;
    st->sources.in = st->job.in = in;
    st->job.out = out;
    pell_pool_run(st->pool, in->rect.y1 - in->rect.y0, group_row, st);
    if (st->bodies)
        convolution_sources_aim(&st->sources);
    pell_pool_run(st->pool, in->rect.y1 - in->rect.y0, front_row, st);
    if (st->sources.behind.layers > 0 && pell_renderer_sample(st->r) == 0)
        find_behind(st);
    memset(st->there, 0, st->num_groups + 1);
    for (int y = in->rect.y0; y < in->rect.y1; y++)
        for (int x = in->rect.x0; x < in->rect.x1; x++)
            st->there[st->sources.front.group[y * st->sources.front.stride + x]] = 1;
    for (size_t i = 0; i < st->num_groups; i++)
        if (st->there[i + 1])
            PELL_TRY(render_group(st, i));
    return pell_cancelled(st->ctx) ? PELL_ERR_CANCELLED : PELL_OK;

fail:
    return res;
}

static size_t convolution_times(const void *state, struct pell_pass_time *list, size_t size)
{
    const struct convolution_state *st = state;
    size_t n = 0;

    for (int i = 0; st->timed && i < TIMES && n < size; i++)
        if (i != T_BEHIND || st->sources.behind.layers > 0)
            list[n++] = st->times[i];
    return n;
}

const struct pell_method_engine pell_convolution_cpu = {
    .create = convolution_create, .render = convolution_render, .destroy = convolution_destroy, .times = convolution_times
};
