/* SPDX-License-Identifier: MIT
 * cpu.c - renders a frame of single scattering: pixels are independent, rows are distributed over the threads. */
#include "methods/single_scatter/single_scatter.h"

#include "methods/reference_frame.h"
#include "render/engine.h"

#include <stdatomic.h>
#include <string.h>

struct single_state {
    struct reference_frame frame;         /* first member */
    const struct pell_services *services; /* borrowed */
    struct pell_context *ctx;
    struct pell_solids *solids;
    struct pell_connector *connector;
    struct pell_light_sampler *light_sampler;
    struct single_medium *medium; /* by solid */
    struct pell_tint *tint;       /* by material of the scene */
    struct single_world world;    /* refers to the above */
    struct single_counts *counts;
};

struct frame_task {
    const struct single_state *st;
    const struct pell_frame *in;
    const struct pell_frame_light *out;
    const struct pell_view *view;
    int rows;
    atomic_int *done; /* rows */
};

static void do_row(void *arg, int index, int worker)
{
    const struct frame_task *t = arg;
    const struct pell_frame *in = t->in;
    const ptrdiff_t row = (in->rect.y0 + index) * in->shape.stride;
    int done;

    for (ptrdiff_t at = row + in->rect.x0; at < row + in->rect.x1 && !pell_cancelled(t->st->ctx); at++) {
        const bool separate = t->out->single[0] != NULL;
        struct pell_vec3 x, toward;
        float light[3], standard_error[3];
        if (!in->material[at])
            continue;
        x = vec3(in->position[0][at], in->position[1][at], in->position[2][at]);
        toward = in->shape.orthographic ? vec3_mul(t->view->forward, -1.0f) : vec3_normalize(vec3_sub(t->view->origin, x));
        single_estimate(&t->st->world, x, toward, (double) in->depth[at], &t->st->counts[worker], light, standard_error);
        for (int c = 0; c < 3; c++) {
            t->out->light[c][at] = separate ? 0.0f : light[c];
            if (separate)
                t->out->single[c][at] = light[c];
            t->st->frame.standard_error[c][at] = standard_error[c];
        }
    }
    done = atomic_fetch_add(t->done, 1) + 1;
    if (worker == 0 && !pell_cancelled(t->st->ctx)) /* the calling thread; a row may take seconds */
        reference_progress(t->st->ctx, "single-scatter", in, done, t->rows);
}

static enum pell_result single_render(void *state, const struct pell_frame *in, const struct pell_frame_light *out)
{
    struct single_state *st = state;
    atomic_int done = 0;
    struct frame_task t = { st, in, out, in->view, in->rect.y1 - in->rect.y0, &done };
    struct single_counts sum = { 0 };
    const int threads = pell_pool_threads(st->services->pool);
    const double start = pell_seconds();

    memset(st->frame.standard_error[0], 0, 3 * (size_t) in->shape.stride * (size_t) in->shape.height * sizeof(float));
    memset(st->counts, 0, (size_t) threads * sizeof(*st->counts));
    st->world.error = reference_sample_error((double) st->world.knobs.error, st->world.knobs.half, in->num_samples);
    st->world.seed = reference_half_seed(in->seed, st->world.knobs.half);
    pell_pool_run(st->services->pool, t.rows, do_row, &t);
    if (pell_cancelled(st->ctx))
        return PELL_ERR_CANCELLED;
    reference_progress(st->ctx, "single-scatter", in, t.rows, t.rows);
    for (int i = 0; i < threads; i++) {
        sum.pixels += st->counts[i].pixels;
        sum.samples += st->counts[i].samples;
        sum.rays += st->counts[i].rays;
        sum.over += st->counts[i].over;
    }
    st->frame.time = (struct pell_pass_time) {
        .name = "single-scatter", .seconds = pell_seconds() - start, .pixels = sum.pixels, .bytes = sum.pixels * 40, .rays = sum.rays
    };
    if (sum.pixels > 0)
        pell_info(st->ctx, "single-scatter", "%.0f samples and %.0f rays per pixel; %.2f %% of the pixels reached the maximum (knob most)",
                  (double) sum.samples / (double) sum.pixels, (double) sum.rays / (double) sum.pixels,
                  100.0 * (double) sum.over / (double) sum.pixels);
    return PELL_OK;
}

static void single_destroy(void *state)
{
    struct single_state *st = state;

    if (!st)
        return;
    pell_free(st->ctx, st->frame.standard_error[0]);
    pell_free(st->ctx, st->counts);
    for (size_t i = 0; st->medium && i < st->solids->count; i++)
        single_medium_finish(st->ctx, &st->medium[i]);
    pell_free(st->ctx, st->medium);
    pell_free(st->ctx, st->tint);
    pell_light_sampler_destroy(&st->light_sampler);
    pell_connector_destroy(&st->connector);
    pell_solids_destroy(&st->solids);
    pell_free(st->ctx, st);
}

static enum pell_result single_create(const struct pell_services *services, const struct pell_frame_shape *shape, const void *knobs,
                                      void **state)
{
    const struct single_knobs *k = knobs;
    struct pell_context *ctx = services->ctx;
    const struct pell_scene *scene = services->scene;
    struct single_state *st = pell_zalloc(ctx, sizeof(*st));
    enum pell_result res;

    *state = st;
    if (!st)
        return PELL_ERR_NOMEM;
    st->services = services;
    st->ctx = ctx;
    PELL_TRY(pell_services_solids(services, &st->solids));
    PELL_TRY(pell_connector_create(ctx, scene, services->rays, st->solids, k->normals == SINGLE_FLAT, &st->connector));
    PELL_TRY(pell_light_sampler_create(ctx, scene, &st->light_sampler));
    res = PELL_ERR_NOMEM;
    st->medium = pell_calloc(ctx, st->solids->count + 1, sizeof(*st->medium));
    st->tint = pell_calloc(ctx, scene->num_materials + 1, sizeof(*st->tint));
    st->counts = pell_calloc(ctx, (size_t) pell_pool_threads(services->pool), sizeof(*st->counts));
    if (!st->medium || !st->tint || !st->counts)
        goto fail;
    for (size_t i = 0; i < scene->num_materials; i++)
        pell_tint_make(&scene->materials[i], &st->tint[i]);
    PELL_TRY(reference_make_planes(ctx, shape, &st->frame));
    for (size_t i = 0; i < st->solids->count; i++) {
        const struct pell_solid *b = &st->solids->solids[i];
        if (b->num_triangles == 0)
            continue;
        PELL_TRY(single_medium_make(ctx, &scene->materials[scene->meshes[b->triangles[0].mesh].material], &st->medium[i]));
        single_medium_attach(&st->medium[i], scene, services->rays, st->solids, (int) i);
    }
    st->world = (struct single_world) {
        .ctx = ctx,
        .scene = scene,
        .rays = services->rays,
        .solids = st->solids,
        .connector = st->connector,
        .light_sampler = st->light_sampler,
        .medium = st->medium,
        .tint = st->tint,
        .knobs = *k,
    };
    return PELL_OK;

fail:
    return res;
}

const struct pell_method_engine pell_single_scatter_cpu = { .create = single_create,
                                                            .record = single_render,
                                                            .destroy = single_destroy,
                                                            .times = reference_times,
                                                            .standard_error = reference_standard_error };
