/* SPDX-License-Identifier: MIT
 *
 * cpu.c - the image-space method on the cpu engine: tables, irradiance images, passes. The inner loops are in kernels.c.
 */
#include "methods/image_space/image_space.h"

#include "base/simd.h"
#include "render/engine.h"
#include "render/material_id.h"

#include <string.h>

PELL_SIMD_TABLES(struct is_kernels, pell_is_kernels);

enum { BAND = 4, PLANES = 11 };

struct is_state {
    struct is_setup setup;
    struct pell_context *ctx; /* borrowed, as is the pool */
    struct pell_pool *pool;
    const struct is_kernels *kernels;
    float *memory, *texels;
    int32_t *solid;
    struct is_adapt adapt;
    int64_t *counts;                             /* per band */
    void (*row)(const struct is_work *w, int y); /* row function of the running pass; NULL: gather */
    struct pell_pass_time times[4];
    size_t num_times;
};

/* --- Create and destroy -------------------------------------------------------------------------------------------------------- */

static void is_destroy(void *state)
{
    struct is_state *st = state;

    if (!st)
        return;
    is_setup_finish(&st->setup);
    pell_free(st->ctx, st->adapt.count);
    pell_free(st->ctx, st->adapt.step);
    pell_free(st->ctx, st->adapt.classes);
    pell_free(st->ctx, st->counts);
    pell_free(st->ctx, st->solid);
    pell_free(st->ctx, st->texels);
    pell_free(st->ctx, st->memory);
    pell_free(st->ctx, st);
}

static enum pell_result make_regions(struct is_state *st, const struct pell_frame_shape *shape)
{
    struct is_adapt *a = &st->adapt;
    size_t size;

    if (!is_adapts(&st->setup.knobs))
        return PELL_OK;
    a->width = (shape->width + IS_REGION_X - 1) / IS_REGION_X;
    a->height = (shape->height + IS_REGION_Y - 1) / IS_REGION_Y;
    size = (size_t) a->width * (size_t) a->height;
    a->count = pell_calloc(st->ctx, size, sizeof(*a->count));
    a->step = pell_calloc(st->ctx, size, sizeof(*a->step));
    a->classes = pell_calloc(st->ctx, size, sizeof(*a->classes));
    st->setup.work.classes = a->classes;
    st->setup.work.regions_row = a->width;
    return a->count && a->step && a->classes ? PELL_OK : PELL_ERR_NOMEM;
}

static enum pell_result make_planes(struct is_state *st, const struct pell_frame_shape *shape)
{
    struct is_work *w = &st->setup.work;
    const size_t stride = ((size_t) shape->width + IS_BLOCK - 1) / IS_BLOCK * IS_BLOCK + 2 * IS_MARGIN;
    const size_t size = stride * ((size_t) shape->height + 2 * IS_MARGIN) + 48;
    float **const planes[PLANES] = { &w->key,      &w->w,        &w->gu,       &w->gv,       &w->footprints, &w->alpha[0],
                                     &w->alpha[1], &w->alpha[2], &w->light[0], &w->light[1], &w->light[2] };

    w->stride = (ptrdiff_t) stride;
    w->texel_stride = shape->width;
    st->memory = pell_calloc(st->ctx, size, PLANES * sizeof(float));
    st->texels = pell_calloc(st->ctx, (size_t) shape->width * (size_t) shape->height, IS_TEXEL * sizeof(float));
    st->counts = pell_calloc(st->ctx, (size_t) shape->height / BAND + 2, sizeof(*st->counts));
    if (!st->memory || !st->texels || !st->counts)
        return PELL_ERR_NOMEM;
    if (st->setup.solids) {
        st->solid = pell_calloc(st->ctx, (size_t) shape->width * (size_t) shape->height, sizeof(*st->solid));
        if (!st->solid)
            return PELL_ERR_NOMEM;
    }
    for (size_t i = 0; i < PLANES; i++)
        *planes[i] = st->memory + i * size + IS_MARGIN * stride + IS_MARGIN;
    for (size_t i = 0; i < size; i++)
        st->memory[size + i] = 1.0f; /* a divisor, also in empty pixels */
    w->texels = st->texels;
    w->solid = st->solid;
    return PELL_OK;
}

static enum pell_result is_create(const struct pell_services *services, const struct pell_frame_shape *shape, const void *knobs,
                                  void **state)
{
    struct is_state *st = pell_zalloc(services->ctx, sizeof(*st));
    enum pell_result res;

    *state = st;
    if (!st)
        return PELL_ERR_NOMEM;
    st->ctx = services->ctx;
    st->pool = services->pool;
    st->kernels = pell_is_kernels_tables[pell_simd_best()];
    PELL_TRY(is_setup_make(services, shape, knobs, &st->setup));
    PELL_TRY(make_regions(st, shape));
    return make_planes(st, shape);

fail:
    return res;
}

/* --- A frame ------------------------------------------------------------------------------------------------------------------- */

static void run_rows(void *arg, int index, int worker)
{
    struct is_state *st = arg;
    const struct is_work *w = &st->setup.work;
    const struct pell_rect *rect = &w->in->rect;
    const int y0 = rect->y0 + index * BAND, y1 = y0 + BAND < rect->y1 ? y0 + BAND : rect->y1;

    (void) worker;
    for (int y = y0; y < y1; y++) {
        if (st->row == st->kernels->load) {
            memset(w->key + y * w->stride + rect->x0 - IS_MARGIN, 0, IS_MARGIN * sizeof(float));
            memset(w->key + y * w->stride + rect->x1, 0, IS_MARGIN * sizeof(float));
            if (st->solid)
                is_find_solids(&st->setup, w->in, y, st->solid + y * w->texel_stride);
        }
        if (st->row)
            st->row(w, y);
        else if (!pell_cancelled(st->ctx))
            st->counts[index] += st->kernels->gather(w, y);
    }
}

static void pass(struct is_state *st, void (*row)(const struct is_work *w, int y))
{
    const struct pell_rect *rect = &st->setup.work.in->rect;

    st->row = row;
    pell_pool_run(st->pool, (rect->y1 - rect->y0 + BAND - 1) / BAND, run_rows, st);
}

static void run_regions(void *arg, int index, int worker)
{
    struct is_state *st = arg;

    (void) worker;
    is_adapt_row(&st->setup.work, &st->adapt, st->setup.work.in->rect.y0 / IS_REGION_Y + index);
}

/* Chooses the number of samples of each region. */
static void adapt(struct is_state *st)
{
    const struct pell_rect *rect = &st->setup.work.in->rect;

    if (!st->setup.work.classes)
        return;
    pell_pool_run(st->pool, (rect->y1 + IS_REGION_Y - 1) / IS_REGION_Y - rect->y0 / IS_REGION_Y, run_regions, st);
    is_adapt_choose(&st->setup.work, &st->adapt);
}

static void note_time(struct is_state *st, const char *name, double *from, int64_t pixels, int64_t bytes)
{
    const double now = pell_seconds();

    st->times[st->num_times++] = (struct pell_pass_time) { .name = name, .seconds = now - *from, .pixels = pixels, .bytes = bytes };
    *from = now;
}

static enum pell_result is_render(void *state, const struct pell_frame *in, const struct pell_frame_light *out)
{
    struct is_state *st = state;
    struct is_work *w = &st->setup.work;
    struct pell_frame frame = *in;
    const size_t width = ((size_t) (in->rect.x1 - in->rect.x0) + 2 * IS_MARGIN) * sizeof(float);
    const int bands = (in->rect.y1 - in->rect.y0 + BAND - 1) / BAND;
    double clock = pell_seconds();
    int64_t pixels = 0;
    enum pell_result res;

    st->num_times = 0;
    if (!st->setup.knobs.strength)
        frame.strength = NULL;
    if (!frame.base[1] || !frame.base[2])
        frame.base[0] = NULL;
    w->in = &frame;
    w->out = out;
    res = is_setup_frame(&st->setup, &frame);
    if (res != PELL_OK)
        return res;
    memset(st->counts, 0, (size_t) bands * sizeof(*st->counts));
    for (int i = 1; i <= IS_MARGIN; i++) {
        memset(w->key + (in->rect.y0 - i) * w->stride + in->rect.x0 - IS_MARGIN, 0, width);
        memset(w->key + (in->rect.y1 - 1 + i) * w->stride + in->rect.x0 - IS_MARGIN, 0, width);
    }
    pass(st, st->kernels->load);
    pass(st, st->kernels->measure);
    adapt(st);
    note_time(st, "load", &clock, 0, 0);
    pass(st, NULL);
    for (int i = 0; i < bands; i++)
        pixels += st->counts[i];
    st->times[0].pixels = pixels;
    st->times[0].bytes = pixels * (18 + 16 + IS_TEXEL * 4);
    note_time(st, "sample", &clock, pixels, pixels * (IS_TEXEL * 4 + 12));
    if (w->reconstruct) {
        pass(st, st->kernels->rebuild);
        note_time(st, "reconstruct", &clock, pixels, pixels * 52);
    }
    w->in = NULL;
    w->out = NULL;
    return pell_cancelled(st->ctx) ? PELL_ERR_CANCELLED : PELL_OK;
}

static size_t is_times(const void *state, struct pell_pass_time *list, size_t size)
{
    const struct is_state *st = state;

    for (size_t i = 0; i < st->num_times && i < size; i++)
        list[i] = st->times[i];
    return st->num_times < size ? st->num_times : size;
}

static const struct pell_thickness_table *is_thickness(const void *state, size_t material)
{
    return is_setup_thickness(&((const struct is_state *) state)->setup, material);
}

const struct pell_method_engine pell_is_cpu = {
    .create = is_create,
    .record = is_render,
    .destroy = is_destroy,
    .thickness = is_thickness,
    .times = is_times,
};
