/* SPDX-License-Identifier: MIT
 *
 * cpu.c - the convolution method on the cpu engine: creation, and a frame, in which each group of pixels that scatter together passes
 * through the steps of state.h in its own rectangle, channel by channel.
 */
#include "methods/convolution/state.h"

#include "methods/thickness.h"

#include "base/pool.h"
#include "base/simd.h"
#include "math/scalar.h"
#include "math/vec.h"
#include "render/engine.h"
#include "render/material_id.h"

#include <string.h>

PELL_SIMD_TABLES(struct conv_kernels, convolution_kernels);

enum { L = PELL_FFT_LANES, E = PELL_FFT_ELEMENT };

/* --- Create and destroy -------------------------------------------------------------------------------------------------------- */

static void convolution_destroy(void *state)
{
    struct convolution_state *st = state;

    if (!st)
        return;
    for (size_t i = 0; i < CONV_SETS; i++)
        pell_free(st->ctx, st->sets[i].memory);
    pell_free(st->ctx, st->job.tables[0]);
    pell_free(st->ctx, st->occupied);
    pell_free(st->ctx, st->lit);
    pell_free(st->ctx, st->uniform);
    pell_free(st->ctx, st->scratch);
    pell_free(st->ctx, st->scratch_memory);
    pell_free(st->ctx, st->half);
    pell_free(st->ctx, st->images);
    pell_free(st->ctx, st->ray_counts);
    pell_free(st->ctx, st->present);
    pell_free(st->ctx, st->rows);
    pell_free(st->ctx, st->sources.behind.group);
    pell_free(st->ctx, st->behind_memory);
    pell_free(st->ctx, st->sources.front.group);
    pell_free(st->ctx, st->front_memory);
    pell_free(st->ctx, st->level_tables);
    pell_free(st->ctx, st->tables);
    pell_free(st->ctx, st->radial);
    pell_free(st->ctx, st->thickness);
    pell_free(st->ctx, st->by_slab);
    pell_solids_destroy(&st->solids);
    pell_free(st->ctx, st);
}

static enum pell_result make_thickness(struct convolution_state *st, const struct pell_frame_shape *shape)
{
    st->thickness = pell_calloc(st->ctx, shape->num_materials, sizeof(*st->thickness));
    st->by_slab = pell_calloc(st->ctx, shape->num_materials, sizeof(*st->by_slab));
    if (!st->thickness || !st->by_slab)
        return PELL_ERR_NOMEM;
    for (size_t i = 0; i < shape->num_materials; i++) {
        const struct pell_frame_material *m = &shape->materials[i];
        const size_t first = pell_first_alike(shape, i);
        struct pell_slab slab[3];
        if (first < i) {
            st->thickness[i] = st->thickness[first];
            st->by_slab[i] = st->by_slab[first];
            continue;
        }
        /* Without hidden faces the planes transmit nothing; a table by thickness is used instead. */
        st->by_slab[i] = !st->solids || pell_slabs_make(m, slab);
        pell_thickness_table_make(m, pell_thickness_beyond, m, true, st->by_slab[i] ? 1.0 : 0.0, &st->thickness[i]);
    }
    return PELL_OK;
}

static enum pell_result make_materials(struct convolution_state *st, const struct pell_frame_shape *shape)
{
    st->materials = shape->materials;
    st->num_materials = shape->num_materials;
    st->radial = pell_calloc(st->ctx, shape->num_materials, sizeof(*st->radial));
    st->tables = pell_alloc_array(st->ctx, shape->num_materials, 3 * CONV_RADIAL_FLOATS * sizeof(float));
    if (st->knobs.strength)
        st->level_tables = pell_alloc_array(st->ctx, CONV_LEVELS, 3 * CONV_RADIAL_FLOATS * sizeof(float));
    if (!st->radial || !st->tables || (st->knobs.strength && !st->level_tables))
        return PELL_ERR_NOMEM;
    for (size_t i = 0; i < shape->num_materials; i++) {
        const float strength = shape->materials[i].strength;
        const double radius_scale = strength > 0.0f ? fmin((double) strength, 1.0) : 1.0;
        convolution_radial_make(&shape->materials[i], radius_scale, st->tables + i * 3 * CONV_RADIAL_FLOATS, st->radial[i]);
    }
    st->num_groups = st->solids ? st->solids->count : shape->num_materials;
    return st->knobs.through == CONV_THROUGH_SLAB ? make_thickness(st, shape) : PELL_OK;
}

/* For coarse images, cells of twice their pixel size are fine enough. */
static int behind_step(const struct convolution_knobs *k)
{
    if (k->behind_step != CONV_EVERY_AUTO)
        return k->behind_step;
    return k->resolution == CONV_HALF_SIZE || k->resolution == CONV_QUARTER_SIZE ? CONV_EVERY_4 : CONV_EVERY_2;
}

static enum pell_result make_sources(struct convolution_state *st, const struct pell_frame_shape *shape)
{
    struct conv_front *f = &st->sources.front;
    struct conv_behind *b = &st->sources.behind;
    const size_t size = (size_t) shape->width * (size_t) shape->height;
    size_t cells;

    f->stride = shape->width;
    f->group = pell_calloc(st->ctx, size, sizeof(*f->group));
    st->front_memory = pell_alloc_array(st->ctx, size, 9 * sizeof(float));
    st->rows = pell_calloc(st->ctx, (size_t) shape->height + 1, sizeof(*st->rows));
    st->present = pell_calloc(st->ctx, st->num_groups + 1, 1);
    st->ray_counts = pell_calloc(st->ctx, (size_t) shape->height + 1, sizeof(*st->ray_counts));
    if (!f->group || !st->front_memory || !st->rows || !st->present || !st->ray_counts)
        return PELL_ERR_NOMEM;
    f->area = st->front_memory;
    f->slant = f->area + size;
    f->coord = f->slant + size;
    for (size_t c = 0; c < 3; c++) {
        f->entry_weight[c] = f->coord + (1 + c) * size;
        f->exit_weight[c] = f->coord + (4 + c) * size;
    }
    b->step = 1 << behind_step(&st->knobs);
    b->width = (shape->width + b->step - 1) / b->step;
    b->height = (shape->height + b->step - 1) / b->step;
    b->layers = st->solids ? st->knobs.surfaces - 1 : 0;
    if (b->layers == 0)
        return PELL_OK;
    cells = (size_t) b->width * (size_t) b->height * (size_t) b->layers;
    b->group = pell_calloc(st->ctx, cells, sizeof(*b->group));
    st->behind_memory = pell_alloc_array(st->ctx, cells, 19 * sizeof(float));
    if (!b->group || !st->behind_memory)
        return PELL_ERR_NOMEM;
    b->depth = st->behind_memory;
    b->area = b->depth + cells;
    b->slant = b->area + cells;
    b->coord = b->slant + cells;
    for (size_t c = 0; c < 3; c++) {
        b->light[c] = b->coord + (1 + c) * cells;
        b->entry_weight[c] = b->coord + (4 + c) * cells;
        b->close[c] = b->coord + (7 + c) * cells;
        b->carried[c] = b->coord + (10 + c) * cells;
        b->along_surface[c] = b->coord + (13 + c) * cells;
    }
    return PELL_OK;
}

static bool is_uniform(const struct convolution_state *st)
{
    return st->knobs.borders == CONV_BORDERS_EVEN || (st->knobs.borders == CONV_BORDERS_AUTO && st->knobs.surfaces == 1);
}

/* Sizes of images with `step` pixels of the frame per pixel. */
static void find_format(const struct convolution_state *st, const struct pell_frame_shape *shape, int step, struct conv_format *out)
{
    const int width = (shape->width + 2 * step - 2) / step + 1, height = (shape->height + 2 * step - 2) / step + 1;
    const int planes = convolution_planes(&st->knobs, step);
    const size_t bands = (size_t) (height + CONV_BAND - 1) / CONV_BAND;

    *out = (struct conv_format) {
        .step = step,
        .width = width,
        .height = height,
        .across = pell_fft_good(2 * width, CONV_MULTIPLE),
        .down = pell_fft_good(2 * height, CONV_MULTIPLE),
        .bands = (int) bands,
        .num_images = planes + (st->knobs.restore == CONV_BETWEEN ? planes - 1 : 0) + (st->solids && st->knobs.apart ? planes : 0),
        .image_size = (size_t) conv_round_up(width, L) * bands * CONV_BAND,
    };
    out->half_size = ((size_t) out->across / 32 + 1) * bands * CONV_BAND * E;
}

static enum pell_result make_images(struct convolution_state *st, const struct pell_frame_shape *shape)
{
    const int workers = pell_pool_threads(st->pool), first = st->knobs.resolution == CONV_AUTO_SIZE ? CONV_FULL : st->knobs.resolution;
    const int last = st->knobs.resolution == CONV_AUTO_SIZE ? CONV_HALF_SIZE : st->knobs.resolution;
    size_t images = 0, half = 0, marks = 0, bands = 0, scratch = 0, table = 0, spectra = 0;

    for (int i = first; i <= last; i++) {
        struct conv_format *r = &st->formats[i];
        size_t longest;
        find_format(st, shape, 1 << i, r);
        longest = (size_t) (r->across > r->down ? r->across : r->down);
        images = LARGER(images, i == CONV_FULL ? 0 : r->image_size * (size_t) r->num_images);
        half = LARGER(half, r->half_size * (size_t) r->num_images);
        bands = LARGER(bands, (size_t) r->bands);
        marks = LARGER(marks, (size_t) r->bands * (size_t) r->num_images);
        scratch = LARGER(scratch, ((size_t) r->num_images + 2) * pell_fft_buffer((int) longest));
        scratch = LARGER(scratch, convolution_spectra_scratch(r->width, r->height));
        spectra = LARGER(spectra, convolution_spectra_size(&st->knobs, r->step, shape->orthographic, r->width, r->height));
        table = LARGER(table, 3 * longest + 4096);
    }
    st->format = st->formats[first];
    if (images > 0)
        st->images = pell_alloc_array(st->ctx, images, sizeof(float));
    st->half = pell_alloc_array(st->ctx, half, sizeof(float));
    st->occupied = pell_calloc(st->ctx, marks, 1);
    st->lit = pell_calloc(st->ctx, bands, sizeof(*st->lit));
    if (is_uniform(st))
        st->uniform = pell_alloc_array(st->ctx, (size_t) shape->width * (size_t) shape->height, sizeof(float));
    scratch = (scratch + 63) / 16 * 16;
    st->scratch = pell_calloc(st->ctx, (size_t) workers, sizeof(*st->scratch));
    st->scratch_memory = pell_alloc_array(st->ctx, scratch, (size_t) workers * sizeof(float));
    st->job.tables[0] = pell_alloc_array(st->ctx, table, 2 * sizeof(float));
    if ((images > 0 && !st->images) || !st->half || !st->occupied || !st->lit || !st->scratch || !st->scratch_memory ||
        !st->job.tables[0] || (is_uniform(st) && !st->uniform))
        return PELL_ERR_NOMEM;
    st->job.tables[1] = st->job.tables[0] + table;
    for (int i = 0; i < workers; i++)
        st->scratch[i] = st->scratch_memory + (size_t) i * scratch;
    st->num_sets = st->num_groups;
    if (st->knobs.strength && convolution_has_strength_maps(st->services->scene))
        st->num_sets *= CONV_LEVELS + 1;
    st->num_sets = st->num_sets < CONV_SETS ? st->num_sets : CONV_SETS;
    for (size_t i = 0; i < st->num_sets; i++) {
        st->sets[i].memory = pell_alloc_array(st->ctx, spectra, sizeof(float));
        if (!st->sets[i].memory)
            return PELL_ERR_NOMEM;
    }
    return PELL_OK;
}

static enum pell_result convolution_create(const struct pell_services *services, const struct pell_frame_shape *shape, const void *knobs,
                                           void **state)
{
    struct pell_context *ctx = services->ctx;
    struct convolution_state *st = pell_zalloc(ctx, sizeof(*st));
    enum pell_result res;

    *state = st;
    if (!st)
        return PELL_ERR_NOMEM;
    st->services = services;
    st->ctx = ctx;
    st->pool = services->pool;
    st->kernels = convolution_kernels_tables[pell_simd_best()];
    st->knobs = *(const struct convolution_knobs *) knobs;
    if (shape->width > PELL_FFT_MOST / 4 || shape->height > PELL_FFT_MOST / 4)
        return pell_error(ctx, PELL_ERR_UNSUPPORTED, "convolution", NULL, "%d x %d pixels, at most %d a side", shape->width, shape->height,
                          PELL_FFT_MOST / 4);
    if ((int64_t) shape->stride * shape->height > INT32_MAX) /* kernels index pixels with 32 bits */
        return pell_error(ctx, PELL_ERR_UNSUPPORTED, "convolution", NULL, "%lld pixels with the rows' ends, at most %d",
                          (long long) shape->stride * shape->height, INT32_MAX);
    if (st->knobs.surfaces > 1)
        PELL_TRY(pell_services_solids(services, &st->solids));
    if ((st->solids ? st->solids->count : shape->num_materials) >= UINT16_MAX) /* groups are stored in 16 bits, and 0 means none */
        return pell_error(ctx, PELL_ERR_UNSUPPORTED, "convolution", "join objects, or use hierarchical", "%zu solids, at most %d",
                          st->solids ? st->solids->count : shape->num_materials, UINT16_MAX - 1);
    PELL_TRY(make_materials(st, shape));
    PELL_TRY(make_sources(st, shape));
    PELL_TRY(make_images(st, shape));
    st->sources.services = services;
    st->sources.solids = st->solids;
    st->sources.one_size = st->knobs.pixels == CONV_ONE;
    st->sources.by_slab = st->by_slab;
    st->sources.kernels = st->kernels;
    return PELL_OK;

fail:
    return res;
}

/* --- A frame ------------------------------------------------------------------------------------------------------------------- */

static void group_row(void *arg, int index, int worker)
{
    const struct convolution_state *st = arg;
    const struct pell_frame *in = st->sources.in;
    const int y = in->rect.y0 + index;
    uint16_t *group = st->sources.front.group + y * st->sources.front.stride;

    (void) worker;
    for (int x = in->rect.x0; x < in->rect.x1; x++) {
        const ptrdiff_t i = y * in->shape.stride + x;
        group[x] = pell_material_id(in, i);
        if (group[x] && st->solids)
            group[x] = in->mesh[i] < st->solids->num_meshes ? (uint16_t) (st->solids->of_mesh[in->mesh[i]] + 1) : 0;
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

static void note_time(struct convolution_state *st, int which, double *from, int64_t pixels, int64_t bytes)
{
    const double now = pell_seconds();

    st->times[which].seconds += now - *from;
    st->times[which].pixels += pixels;
    st->times[which].bytes += bytes;
    *from = now;
}

static void convolve(struct convolution_state *st, int channel, bool uniform)
{
    struct conv_job *j = &st->job;
    const int images = j->layout.planes + j->between + j->behind;
    const int64_t image_pixels = (int64_t) j->layout.width * j->layout.height;
    const int64_t half_bytes = (int64_t) (j->layout.across / 2) * j->layout.height * 8;
    double clock = pell_seconds();
    int num_lit = 0;

    j->channel = channel;
    j->uniform = uniform;
    convolution_spread(st);
    for (int i = 0; i < images; i++) {
        j->lit[i] = false;
        for (int band = 0; band < j->bands; band++)
            j->lit[i] = j->lit[i] || st->occupied[band * st->format.num_images + i];
        num_lit += j->lit[i];
    }
    note_time(st, CONV_T_SPREAD, &clock, j->extent.pixels, j->extent.pixels * 20 + num_lit * half_bytes);
    convolution_transform_columns(st);
    note_time(st, CONV_T_COLUMNS, &clock, images * image_pixels, images * half_bytes * 2);
    convolution_gather(st);
    note_time(st, CONV_T_GATHER, &clock, j->extent.pixels, j->extent.pixels * 24 + (j->layout.planes + j->between) * half_bytes);
}

/* Processes the group at one level of its strength: light to planes, convolution, and planes to pixels. */
static enum pell_result render_level(struct convolution_state *st)
{
    struct conv_job *j = &st->job;
    struct conv_spectra *set;
    double clock = pell_seconds();
    enum pell_result res;

    j->layout.group = j->group * (CONV_LEVELS + 1) + (size_t) (j->level + 1);
    set = &st->sets[(j->level < 0 ? j->group : j->layout.group) % st->num_sets];
    for (int c = 0; c < 3; c++)
        for (int i = 0; i < CONV_PLANES; i++)
            j->layout.behind[c][i] = -1.0f;
    if (j->behind)
        convolution_measure_behind(st);
    convolution_spectra_make(st->pool, &st->knobs, j->radial, &j->layout, st->kernels, st->scratch, set);
    if (pell_cancelled(st->ctx)) {
        set->layout.planes = 0;
        return PELL_ERR_CANCELLED;
    }
    j->set = set;
    note_time(st, CONV_T_SPECTRA, &clock, 0, 0);
    convolution_compute_weights(st);
    note_time(st, CONV_T_WEIGHTS, &clock, j->extent.pixels, j->extent.pixels * 44);
    PELL_TRY(convolution_show_begin(st));
    for (int c = 0; c < 3; c++) {
        if (j->divide)
            convolve(st, c, true);
        convolve(st, c, false);
        res = PELL_ERR_CANCELLED;
        if (pell_cancelled(st->ctx))
            goto fail;
    }
    return convolution_show_end(st);

fail:
    convolution_show_drop(st);
    return res;
}

static enum pell_result render_group(struct convolution_state *st, size_t group)
{
    struct conv_job *j = &st->job;
    const size_t material = st->solids ? st->solids->solids[group].material : group;
    const struct pell_frame_material *m = &st->materials[material];
    double clock = pell_seconds();
    enum pell_result res;

    j->group = group;
    convolution_find_extent(st);
    if (j->extent.pixels == 0)
        return PELL_OK;
    convolution_find_levels(st, m->strength);
    convolution_take_level(st, m, material, j->last_level);
    convolution_choose_format(st);
    convolution_take_level(st, m, material, j->first_level); /* the layout is that of the widest profile */
    convolution_lay_out(st);
    j->between = st->knobs.restore == CONV_BETWEEN ? j->layout.planes - 1 : 0;
    j->behind = st->knobs.apart && st->sources.behind.layers > 0 ? j->layout.planes : 0;
    j->stride = conv_round_up(j->layout.width, L);
    j->block = (ptrdiff_t) j->layout.height * E;
    j->bands = (j->layout.height + CONV_BAND - 1) / CONV_BAND;
    j->column_blocks = j->layout.across / 32 + 1;
    j->divide = is_uniform(st);
    pell_fft_init(&j->across, j->layout.across, j->tables[0]);
    pell_fft_init(&j->down, j->layout.down, j->tables[1]);
    convolution_find_coords(st);
    note_time(st, CONV_T_PLANES, &clock, j->extent.pixels, j->extent.pixels * 16);
    for (int level = j->first_level; level <= j->last_level; level++) {
        convolution_take_level(st, m, material, level);
        PELL_TRY(render_level(st));
    }
    return PELL_OK;

fail:
    return res;
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
        st->times[CONV_T_BEHIND].rays += st->ray_counts[i];
    note_time(st, CONV_T_BEHIND, &clock, (int64_t) rows * b->width, (int64_t) rows * b->width * b->layers * 32);
}

static enum pell_result convolution_render(void *state, const struct pell_frame *in, const struct pell_frame_light *out)
{
    static const char *const names[CONV_TIMES] = {
        "areas", "behind", "planes", "spectra", "weights", "light to planes, rows", "columns", "rows back, to pixels"
    };
    struct convolution_state *st = state;
    double clock = pell_seconds();
    enum pell_result res;

    for (int i = 0; i < CONV_TIMES; i++)
        st->times[i] = (struct pell_pass_time) { .name = names[i] };
    st->timed = true;
    st->sources.in = st->job.in = in;
    st->job.out = out;
    pell_pool_run(st->pool, in->rect.y1 - in->rect.y0, group_row, st);
    if (st->solids)
        convolution_sources_aim(&st->sources);
    pell_pool_run(st->pool, in->rect.y1 - in->rect.y0, front_row, st);
    note_time(st, CONV_T_AREAS, &clock, (int64_t) (in->rect.x1 - in->rect.x0) * (in->rect.y1 - in->rect.y0),
              (int64_t) (in->rect.x1 - in->rect.x0) * (in->rect.y1 - in->rect.y0) * 24);
    if (st->sources.behind.layers > 0 && in->first)
        find_behind(st);
    memset(st->present, 0, st->num_groups + 1);
    for (int y = in->rect.y0; y < in->rect.y1; y++)
        for (int x = in->rect.x0; x < in->rect.x1; x++)
            st->present[st->sources.front.group[y * st->sources.front.stride + x]] = 1;
    for (size_t i = 0; i < st->num_groups; i++)
        if (st->present[i + 1])
            PELL_TRY(render_group(st, i));
    return pell_cancelled(st->ctx) ? PELL_ERR_CANCELLED : PELL_OK;

fail:
    return res;
}

static size_t convolution_times(const void *state, struct pell_pass_time *list, size_t size)
{
    const struct convolution_state *st = state;
    size_t n = 0;

    for (int i = 0; st->timed && i < CONV_TIMES && n < size; i++)
        if (i != CONV_T_BEHIND || st->sources.behind.layers > 0)
            list[n++] = st->times[i];
    return n;
}

static const struct pell_thickness_table *convolution_thickness(const void *state, size_t material)
{
    const struct convolution_state *st = state;

    return st->thickness && material < st->num_materials ? &st->thickness[material] : NULL;
}

const struct pell_method_engine pell_convolution_cpu = {
    .create = convolution_create,
    .record = convolution_render,
    .destroy = convolution_destroy,
    .times = convolution_times,
    .thickness = convolution_thickness,
};
