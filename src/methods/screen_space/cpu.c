/* SPDX-License-Identifier: MIT
 *
 * cpu.c - screen-space diffusion on the cpu engine: planes and the order of blurs. The inner loops are in kernels.c.
 */
#include "methods/screen_space/chain.h"
#include "methods/screen_space/factors.h"

#include "base/simd.h"
#include "math/vec.h"

#include <math.h>
#include <string.h>

PELL_SIMD_TABLES(struct screen_kernels, pell_ss_kernels);

enum {
    BAND = 8,    /* rows per task */
    PLANES = 13, /* key, depth, scale, 2 lengths, 2 to_px, now and half of 3 */
};

struct band {
    struct screen_seen seen;
    int64_t active[2]; /* number of blurred pixels, by axis */
    double seconds[2];
};

struct spent { /* time spent on a step */
    double seconds;
    int64_t active;
};

struct screen_state {
    struct pell_context *ctx; /* borrowed, as are services and pool */
    const struct pell_services *services;
    struct pell_pool *pool;
    const struct screen_kernels *kernels;
    struct screen_chain chain;
    struct screen_factors factors; /* with kernel=separable */
    float *min_added;              /* of the steps of this frame */
    float (*ones)[3];              /* as blend constants: the whole result of each step */
    float *memory;                 /* all planes */
    float turns[SCREEN_TURNS][2];
    struct screen_cell *cells;
    struct screen_extent *extents;
    uint16_t *run;   /* per block of a row: number of consecutive smooth rows ending here */
    float *tangents; /* of columns, then of rows */
    struct band *bands;
    float *rows;                                     /* per worker: three rows, for results of the pass down before the pass across */
    struct screen_work work, next;                   /* of the pass down, and of the next step's pass across */
    float *const *from, *const *to;                  /* input of the pass across, of either step */
    bool down, across;                               /* passes in progress */
    void (*row)(const struct screen_work *w, int y); /* alternatively, a row function */
    struct pell_pass_time times[1 + SCREEN_STEPS];
    size_t num_times;
};

/* --- The chain of blurs -------------------------------------------------------------------------------------------------------- */

/* Smallest variance that each step of the frame, or one before it, adds. */
static void find_min_added(struct screen_state *st, const float *variance, int steps)
{
    const size_t row = st->chain.num_materials + 1;

    for (size_t m = 0; m < row; m++)
        for (int step = 0; step < steps; step++) {
            const size_t at = (size_t) step * row + m;
            const float added = step > 0 ? variance[at] - variance[at - row] : variance[at];
            st->min_added[at] = step > 0 && st->min_added[at - row] < added ? st->min_added[at - row] : added;
        }
    st->work.min_added = st->min_added;
}

/* --- Create and destroy -------------------------------------------------------------------------------------------------------- */

static void screen_destroy(void *state)
{
    struct screen_state *st = state;

    if (!st)
        return;
    pell_free(st->ctx, st->bands);
    pell_free(st->ctx, st->tangents);
    pell_free(st->ctx, st->extents);
    pell_free(st->ctx, st->rows);
    pell_free(st->ctx, st->cells);
    pell_free(st->ctx, st->run);
    pell_free(st->ctx, st->memory);
    pell_free(st->ctx, st->ones);
    pell_free(st->ctx, st->min_added);
    pell_ss_factors_finish(st->ctx, &st->factors);
    pell_ss_chain_finish(&st->chain);
    pell_free(st->ctx, st);
}

static enum pell_result make_planes(struct screen_state *st, const struct pell_frame_shape *shape)
{
    struct screen_work *w = &st->work;
    const size_t blocks = ((size_t) shape->width + SCREEN_BLOCK - 1) / SCREEN_BLOCK;
    const size_t stride = ((blocks + 2) | 1) * SCREEN_BLOCK, size = stride * ((size_t) shape->height + 2);
    float *plane;

    st->memory = pell_calloc(st->ctx, size, PLANES * sizeof(float));
    st->cells = pell_calloc(st->ctx, blocks * ((size_t) shape->height + 1), sizeof(*st->cells)); /* one more row, which prefetches touch */
    st->extents = pell_calloc(st->ctx, (size_t) shape->height, sizeof(*st->extents));
    st->rows = pell_calloc(st->ctx, 3 * stride, (size_t) pell_pool_threads(st->pool) * sizeof(*st->rows));
    st->tangents = pell_calloc(st->ctx, stride + (size_t) shape->height, sizeof(*st->tangents));
    st->bands = pell_calloc(st->ctx, (size_t) shape->height / BAND + 2, sizeof(*st->bands));
    st->run = pell_calloc(st->ctx, blocks, sizeof(*st->run));
    if (!st->memory || !st->cells || !st->extents || !st->rows || !st->run || !st->tangents || !st->bands)
        return PELL_ERR_NOMEM;
    w->stride = (ptrdiff_t) stride;
    w->blocks = (int) blocks;
    w->cells = st->cells;
    w->extents = st->extents;
    w->columns_tan = st->tangents;
    w->rows_tan = st->tangents + stride;
    for (size_t x = 0; x < stride; x++)
        st->tangents[x] = ((float) x + 0.5f - 0.5f * (float) shape->width) * w->depth_mm;
    for (int y = 0; y < shape->height; y++)
        st->tangents[stride + (size_t) y] = ((float) y + 0.5f - 0.5f * (float) shape->height) * w->depth_mm;
    plane = st->memory + stride + SCREEN_BLOCK;
    w->key = plane;
    w->depth = plane + size;
    w->scale = plane + 2 * size;
    for (int i = 0; i < 2; i++) {
        w->length[i] = plane + (size_t) (3 + i) * size;
        w->to_px[i] = plane + (size_t) (5 + i) * size;
    }
    for (int i = 0; i < 3; i++) {
        w->now[i] = plane + (size_t) (7 + i) * size;
        w->half[i] = plane + (size_t) (10 + i) * size;
    }
    return PELL_OK;
}

static enum pell_result screen_create(const struct pell_services *services, const struct pell_frame_shape *shape, const void *knobs,
                                      void **state)
{
    struct pell_context *ctx = services->ctx;
    struct screen_state *st = pell_zalloc(ctx, sizeof(*st));
    const struct screen_chain *chain;
    enum pell_result res;
    struct screen_work *w;
    size_t count;

    *state = st;
    if (!st)
        return PELL_ERR_NOMEM;
    st->ctx = ctx;
    st->services = services;
    st->pool = services->pool;
    st->kernels = pell_ss_kernels_tables[pell_simd_best()];
    PELL_TRY(pell_ss_chain_make(ctx, shape, knobs, &st->chain));
    chain = &st->chain;
    if (chain->knobs.kernel == SCREEN_KERNEL_SEPARABLE)
        PELL_TRY(pell_ss_factors_make(chain, shape, &st->factors));
    res = PELL_ERR_NOMEM;
    count = (size_t) (SCREEN_PREBLUR + chain->steps) * (chain->num_materials + 1);
    st->min_added = pell_calloc(ctx, count, sizeof(*st->min_added));
    st->ones = pell_calloc(ctx, count, sizeof(*st->ones));
    if (!st->min_added || !st->ones)
        goto fail;
    for (size_t i = 0; i < count; i++)
        st->ones[i][0] = st->ones[i][1] = st->ones[i][2] = 1.0f;
    w = &st->work;
    w->num_materials = chain->num_materials;
    w->depth_mm = chain->depth_mm;
    w->fixed_mm = chain->fixed_mm;
    w->ratio2 = chain->ratio2;
    w->skip = chain->skip;
    w->correction = chain->correction;
    w->maxdd = chain->maxdd;
    w->unit = chain->unit;
    w->forms = chain->forms;
    w->factors = &st->factors;
    w->taps = chain->knobs.taps;
    w->rotated = chain->knobs.rotate;
    for (int i = 0; i < SCREEN_TURNS; i++) {
        const double angle = 0.5 * PELL_PI * (i + 0.5) / SCREEN_TURNS;
        st->turns[i][0] = (float) cos(angle);
        st->turns[i][1] = (float) sin(angle);
    }
    w->turns = (const float(*)[2]) st->turns;
    PELL_TRY(make_planes(st, shape));
    w->total = (const float(*)[3]) chain->total;
    return PELL_OK;

fail:
    return res;
}

/* --- A frame ------------------------------------------------------------------------------------------------------------------- */

static void run_load(void *arg, int index, int worker)
{
    struct screen_state *st = arg;
    struct screen_work *w = &st->work;
    struct band *band = &st->bands[index];
    const int y0 = w->in->rect.y0 + index * BAND, y1 = y0 + BAND < w->in->rect.y1 ? y0 + BAND : w->in->rect.y1;

    (void) worker;
    band->seen = (struct screen_seen) { 0 };
    for (int y = y0; y < y1; y++) {
        struct screen_seen seen;
        float *const planes[4] = { w->key, w->depth, w->length[0], w->length[1] };

        /* The area outside of the rectangle must not show the previous frame. */
        for (int i = 0; i < 4; i++) {
            memset(planes[i] + y * w->stride + (w->block0 - 1) * SCREEN_BLOCK, 0, SCREEN_BLOCK * sizeof(float));
            memset(planes[i] + y * w->stride + w->block1 * SCREEN_BLOCK, 0, SCREEN_BLOCK * sizeof(float));
        }
        st->kernels->load(w, y, &seen);
        band->seen.pixels += seen.pixels;
        band->seen.scale = seen.scale > band->seen.scale ? seen.scale : band->seen.scale;
        band->seen.last = seen.last > band->seen.last ? seen.last : band->seen.last;
        if (seen.first > 0 && (band->seen.first == 0 || seen.first < band->seen.first))
            band->seen.first = seen.first;
    }
}

static void run_rows(void *arg, int index, int worker)
{
    struct screen_state *st = arg;
    const struct pell_rect *rect = &st->work.in->rect;
    const int y0 = rect->y0 + index * BAND, y1 = y0 + BAND < rect->y1 ? y0 + BAND : rect->y1;

    (void) worker;
    for (int y = y0; y < y1; y++)
        st->row(&st->work, y);
}

static void pass(struct screen_state *st, void (*row)(const struct screen_work *w, int y))
{
    const struct pell_rect *rect = &st->work.in->rect;

    st->row = row;
    pell_pool_run(st->pool, (rect->y1 - rect->y0 + BAND - 1) / BAND, run_rows, st);
}

/* Blurs rows down by one step (except before the first) and across by the next (except after the last). A row's pass across needs only that
 * row, which is still in the cache. */
static void run_blurs(void *arg, int index, int worker)
{
    struct screen_state *st = arg;
    const struct screen_work *w = &st->work;
    const struct pell_rect *rect = &w->in->rect;
    const int y0 = rect->y0 + index * BAND, y1 = y0 + BAND < rect->y1 ? y0 + BAND : rect->y1;
    float *rows = st->rows + (size_t) worker * 3 * (size_t) w->stride + SCREEN_BLOCK;
    float *const between[3] = { rows, rows + w->stride, rows + 2 * w->stride };
    struct band *band = &st->bands[index];

    for (int y = y0; y < y1; y++) {
        const ptrdiff_t at = y * w->stride;
        const float *const from[3] = { st->from[0] + at, st->from[1] + at, st->from[2] + at };
        float *const to[3] = { st->to[0] + at, st->to[1] + at, st->to[2] + at };
        const double start = pell_seconds();
        double middle = start;

        if (st->down) {
            band->active[1] += st->kernels->down(w, y, from, st->across ? between : to);
            middle = pell_seconds();
        }
        if (st->across)
            band->active[0] += st->kernels->across(&st->next, y, st->down ? (const float *const *) between : from, to);
        band->seconds[1] += middle - start;
        band->seconds[0] += pell_seconds() - middle;
    }
}

/* Adds time and counts to the steps. */
static void blur(struct screen_state *st, bool down, bool across, struct spent *spent)
{
    const struct pell_rect *rect = &st->work.in->rect;
    const int bands = (rect->y1 - rect->y0 + BAND - 1) / BAND, step = down ? st->work.step : st->next.step - 1;
    const double start = pell_seconds();
    double seconds[2] = { 0.0, 0.0 }, fraction;
    int64_t active[2] = { 0, 0 };

    st->down = down;
    st->across = across;
    for (int i = 0; i < bands; i++) {
        st->bands[i].active[0] = st->bands[i].active[1] = 0;
        st->bands[i].seconds[0] = st->bands[i].seconds[1] = 0.0;
    }
    pell_pool_run(st->pool, bands, run_blurs, st);
    for (int i = 0; i < bands; i++)
        for (int axis = 0; axis < 2; axis++) {
            active[axis] += st->bands[i].active[axis];
            seconds[axis] += st->bands[i].seconds[axis];
        }
    /* Divides the elapsed time in proportion to the threads' times. */
    fraction = seconds[0] + seconds[1] > 0.0 ? (pell_seconds() - start) / (seconds[0] + seconds[1]) : 0.0;
    if (down) {
        spent[step].seconds += fraction * seconds[1];
        spent[step].active += active[1];
    }
    if (across) {
        spent[step + 1].seconds += fraction * seconds[0];
        spent[step + 1].active += active[0];
    }
}

/* Distance along each axis from a block to the next one with an edge: blurs that reach no edge may have gaps between taps. */
static void find_clear(struct screen_state *st)
{
    const struct screen_work *w = &st->work;
    const struct pell_rect *rect = &w->in->rect;
    const int blocks = w->block1 - w->block0;

    for (int back = 0; back < 2; back++) {
        memset(st->run, 0, (size_t) blocks * sizeof(*st->run));
        for (int i = 0; i < rect->y1 - rect->y0; i++) {
            struct screen_cell *row = &w->cells[(ptrdiff_t) (back ? rect->y1 - 1 - i : rect->y0 + i) * w->blocks + w->block0];
            int along = 0;
            for (int j = 0; j < blocks; j++) {
                const int b = back ? blocks - 1 - j : j, pixels = (along < 4000 ? along : 4000) * SCREEN_BLOCK;
                struct screen_cell *cell = &row[b];
                if (!cell->smooth) {
                    cell->clear[0] = cell->clear[1] = 0;
                    along = st->run[b] = 0;
                    continue;
                }
                cell->clear[0] = (uint16_t) (!back || pixels < cell->clear[0] ? pixels : cell->clear[0]);
                cell->clear[1] = !back || st->run[b] < cell->clear[1] ? st->run[b] : cell->clear[1];
                along++;
                st->run[b] = (uint16_t) (st->run[b] + (st->run[b] < UINT16_MAX));
            }
        }
    }
}

static struct screen_seen load(struct screen_state *st)
{
    const struct screen_work *w = &st->work;
    const struct pell_rect *rect = &w->in->rect;
    const int bands = (rect->y1 - rect->y0 + BAND - 1) / BAND;
    const size_t width = (size_t) (w->block1 - w->block0) * SCREEN_BLOCK * sizeof(float);
    float *const planes[2] = { w->key, w->depth }; /* prefetched for a row's neighbours */
    struct screen_seen all = { 0 };

    for (int i = 0; i < 2; i++) {
        memset(planes[i] + (rect->y0 - 1) * w->stride + w->block0 * SCREEN_BLOCK, 0, width);
        memset(planes[i] + rect->y1 * w->stride + w->block0 * SCREEN_BLOCK, 0, width);
    }
    pell_pool_run(st->pool, bands, run_load, st);
    for (int i = 0; i < bands; i++) {
        const struct screen_seen *s = &st->bands[i].seen;
        all.pixels += s->pixels;
        all.scale = s->scale > all.scale ? s->scale : all.scale;
        all.last = s->last > all.last ? s->last : all.last;
        if (s->first > 0 && (all.first == 0 || s->first < all.first))
            all.first = s->first;
    }
    return all;
}

static struct screen_seen load_frame(struct screen_state *st)
{
    const struct screen_seen seen = load(st);

    st->work.several = seen.first != seen.last;
    pass(st, st->kernels->measure);
    find_clear(st);
    return seen;
}

static void note_time(struct screen_state *st, const char *name, double seconds, int64_t pixels, int64_t bytes)
{
    st->times[st->num_times++] = (struct pell_pass_time) { .name = name, .seconds = seconds, .pixels = pixels, .bytes = bytes };
}

/* One step's pass down and the next one's pass across. The passes across alternate between `now` and `half`; the step before the first only
 * starts the pipeline. */
static void run_step(struct screen_state *st, int step, int first, int steps, struct spent *spent)
{
    struct screen_work *w = &st->work;
    float *const *swap;

    if (step < first) {
        st->from = w->now;
        st->to = w->half;
    }
    swap = st->to;
    w->step = step;
    w->fresh = step == first;
    w->last = step == steps - 1;
    st->next = *w;
    st->next.step = step + 1;
    st->next.fresh = step + 1 == first;
    if (w->rotated && step >= first && step + 1 < steps) { /* rotated lines leave their row */
        blur(st, true, false, spent);
        st->to = st->from;
        st->from = swap;
        swap = st->to;
        blur(st, false, true, spent);
    } else {
        blur(st, step >= first, step + 1 < steps, spent);
    }
    st->to = st->from;
    st->from = swap;
}

/* Result of each step by itself: the steps with a weight of one. */
static enum pell_result take_blurs(struct screen_state *st, int first, int steps, int preblur, pell_take_blur *take, void *user)
{
    struct screen_work *w = &st->work;
    const float(*const blend)[3] = w->blend;
    struct spent spent[SCREEN_STEPS] = { { 0 } };
    enum pell_result res = PELL_OK;

    w->blend = (const float(*)[3]) st->ones;
    for (int step = first - 1; step < steps && first < steps && res == PELL_OK; step++) {
        run_step(st, step, first, steps, spent);
        if (step >= first)
            res = take(user, (const float *const *) w->out->light, w->in->shape.stride, step, preblur);
    }
    w->blend = blend;
    return res;
}

/* Starts a frame: the number of preblur steps, and the first step that blurs any pixel. */
static struct screen_seen begin(struct screen_state *st, struct pell_frame *frame, const struct pell_frame_light *out, int *preblur,
                                int *first)
{
    struct screen_work *w = &st->work;
    const size_t row = st->chain.num_materials + 1;
    struct screen_seen seen;

    if (!st->chain.knobs.strength)
        frame->strength = NULL;
    w->in = frame;
    w->out = out;
    w->light = st->chain.knobs.input == SCREEN_INPUT_SHADED ? frame->shaded : frame->irradiance;
    w->block0 = frame->rect.x0 / SCREEN_BLOCK;
    w->block1 = (frame->rect.x1 + SCREEN_BLOCK - 1) / SCREEN_BLOCK;
    w->turn = frame->num_samples > 1 ? SCREEN_TURNS * frame->sample / frame->num_samples : 0;
    seen = load_frame(st);
    pell_ss_chain_choose(&st->chain, seen.scale, preblur, first);
    w->variance = st->chain.variance + (size_t) (SCREEN_PREBLUR - *preblur) * row;
    w->blend = (const float(*)[3]) st->chain.blend + (size_t) (SCREEN_PREBLUR - *preblur) * row;
    find_min_added(st, w->variance, *preblur + st->chain.steps);
    return seen;
}

static void end(struct screen_state *st)
{
    st->work.in = NULL;
    st->work.out = NULL;
    st->work.light = NULL;
}

static enum pell_result screen_blurs(void *state, const struct pell_frame *in, const struct pell_frame_light *out, pell_take_blur *take,
                                     void *user)
{
    struct screen_state *st = state;
    struct pell_frame frame = *in;
    int preblur, first;
    enum pell_result res;

    if (in->rect.x0 >= in->rect.x1 || in->rect.y0 >= in->rect.y1)
        return PELL_OK;
    begin(st, &frame, out, &preblur, &first);
    for (int step = preblur; step < first; step++) /* narrower than a pixel */
        PELL_TRY(take(user, (const float *const *) in->irradiance, in->shape.stride, step, preblur));
    PELL_TRY(take_blurs(st, first, preblur + st->chain.steps, preblur, take, user));
    res = pell_cancelled(st->ctx) ? PELL_ERR_CANCELLED : PELL_OK;

fail:
    end(st);
    return res;
}

static enum pell_result show(void *state, const float *const light[3], ptrdiff_t stride, int step, int preblur)
{
    struct screen_state *st = state;

    return pell_ss_show(&st->chain, st->services, st->work.in, light, stride, step, preblur);
}

/* --- Separable kernel ---------------------------------------------------------------------------------------------------------- */

static void run_term(void *arg, int index, int worker)
{
    struct screen_state *st = arg;
    const struct screen_work *w = &st->work;
    const struct pell_rect *rect = &w->in->rect;
    const int y0 = rect->y0 + index * BAND, y1 = y0 + BAND < rect->y1 ? y0 + BAND : rect->y1;

    (void) worker;
    st->bands[index].active[0] = 0;
    for (int y = y0; y < y1; y++)
        st->bands[index].active[0] += st->across ? st->kernels->term_across(w, y, (const float *const *) w->now, w->half)
                                                 : st->kernels->term_down(w, y, (const float *const *) w->half);
}

static enum pell_result render_terms(struct screen_state *st)
{
    struct screen_work *w = &st->work;
    const struct pell_rect *rect = &w->in->rect;
    const int bands = (rect->y1 - rect->y0 + BAND - 1) / BAND, rank = st->factors.rank;
    const bool observed = pell_services_observed(st->services, w->in);

    for (w->term = 0; w->term < rank; w->term++) {
        const double start = pell_seconds();
        int64_t active = 0;

        w->last = w->term == rank - 1;
        for (int down = 0; down < 2; down++) {
            st->across = !down;
            pell_pool_run(st->pool, bands, run_term, st);
            for (int i = 0; i < bands; i++)
                active += st->bands[i].active[0];
        }
        note_time(st, pell_ss_term_name(w->term), pell_seconds() - start, active / 2, active * 16);
        if (observed) {
            const enum pell_result res =
                pell_ss_show(&st->chain, st->services, w->in, (const float *const *) w->out->light, w->in->shape.stride, w->term, 0);
            if (res != PELL_OK)
                return res;
        }
    }
    return PELL_OK;
}

static enum pell_result screen_render(void *state, const struct pell_frame *in, const struct pell_frame_light *out)
{
    struct screen_state *st = state;
    struct pell_frame frame = *in;
    struct screen_seen seen;
    const double start = pell_seconds();
    struct spent spent[SCREEN_STEPS] = { { 0 } };
    int preblur, first, steps;
    enum pell_result res;

    st->num_times = 0;
    if (in->rect.x0 >= in->rect.x1 || in->rect.y0 >= in->rect.y1)
        return PELL_OK;
    seen = begin(st, &frame, out, &preblur, &first);
    if (st->chain.knobs.kernel == SCREEN_KERNEL_SEPARABLE) {
        note_time(st, "load", pell_seconds() - start, seen.pixels, (int64_t) seen.pixels * 40);
        PELL_TRY(render_terms(st));
        res = pell_cancelled(st->ctx) ? PELL_ERR_CANCELLED : PELL_OK;
        goto fail;
    }
    steps = preblur + st->chain.steps;
    if (pell_services_observed(st->services, in)) {
        PELL_TRY(take_blurs(st, first, steps, preblur, show, st));
        load_frame(st);
    }
    note_time(st, "load", pell_seconds() - start, seen.pixels, (int64_t) seen.pixels * 40);

    if (first == steps)
        pass(st, st->kernels->copy);
    for (int step = first - 1; step < steps && first < steps; step++)
        run_step(st, step, first, steps, spent);
    for (int step = first; step < steps; step++)
        note_time(st, pell_ss_step_name(step, preblur), spent[step].seconds, spent[step].active, spent[step].active * 32);
    res = pell_cancelled(st->ctx) ? PELL_ERR_CANCELLED : PELL_OK;

fail:
    end(st);
    return res;
}

static const struct pell_thickness_table *thickness(const void *state, size_t material)
{
    const struct screen_state *st = state;

    return st->chain.thickness && material < st->chain.num_materials ? &st->chain.thickness[material] : NULL;
}

static size_t times(const void *state, struct pell_pass_time *list, size_t size)
{
    const struct screen_state *st = state;

    for (size_t i = 0; i < st->num_times && i < size; i++)
        list[i] = st->times[i];
    return st->num_times < size ? st->num_times : size;
}

const struct pell_method_engine pell_ss_cpu = {
    .create = screen_create,
    .record = screen_render,
    .blurs = screen_blurs,
    .destroy = screen_destroy,
    .thickness = thickness,
    .times = times,
};
