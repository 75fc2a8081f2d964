/* SPDX-License-Identifier: MIT
 *
 * cpu.c - runs the transport over the pixels of a frame, in rounds: after each round all pixels have equally many samples.
 *
 * A pixel's sums depend only on the set of its samples, not on the thread or the order that computed them. Images are therefore identical
 * for any number of threads, and an interrupted run that continues from its checkpoint ends with the same bits as an uninterrupted one.
 * Samples are added one tile at a time: a file has all pixels of a tile or none.
 *
 * Stopping criteria are tested between rounds: after `samples`; when the image's error reaches `error`, at every fourth sample from the
 * sixteenth on; or when the next round would exceed `time-limit`. The samples of the multisample are rendered one after the other, each
 * with its own film and its fraction of the time.
 */
#include "methods/path_trace/run.h"

#include "render/engine.h"

#include <float.h>
#include <stdio.h>

enum {
    TASKS_PER_THREAD = 16, /* in a round, unless tasks have the maximum size */
    MIN_SAMPLES = 16,      /* samples per pixel before its error estimate is used */
    DEFAULT_SAMPLES = 64,  /* samples without a stopping criterion */
};

#define UNEVEN 2.0   /* ratio of the sample counts of two samples of the multisample that is reported */
#define CROSSED 0.01 /* fraction of the paths; fewer are rounding errors at edges */
#define LOST 1e-4    /* the same for paths that leave a solid without hitting its surface */
/* In rounding errors of a coordinate: with shorter mean free paths, paths hit the surface they start from. */
#define COORDINATE_ROUNDINGS 64.0
/* A round is abandoned when it exceeds the deadline by LATE_SECONDS and by LATE of the time limit. */
#define LATE_SECONDS 0.25
#define LATE 0.05

/* Whether some pixel has no sample. */
static bool has_black(const struct pt_film *film)
{
    for (size_t i = 0; i < film->count; i++)
        if (film->pixels[i].count == 0)
            return true;
    return false;
}

/* --- Rounds ------------------------------------------------------------------------------------------------------------------------- */

/* Brings all pixels to run->target samples, unless interrupted. */
static enum pell_result do_round(struct pt_run *run, const struct pt_goal *goal, uint32_t from, size_t *batch)
{
    struct pt_state *st = run->st;
    const size_t pixels = run->film->starts[run->end_tile] - run->film->starts[run->first_tile];
    const size_t per_task = pixels / ((size_t) st->threads * TASKS_PER_THREAD);
    size_t tasks;
    const struct pell_checkpoint *checkpoint = st->services->checkpoint;
    enum pell_result res;

    PELL_TRY(pt_film_reserve(st->ctx, run->film, 1));
    PELL_TRY(pt_list_tasks(run, per_task > PT_TASK_PIXELS ? PT_TASK_PIXELS : per_task + 1, &tasks));
    for (run->first = 0; run->first < tasks;) {
        const size_t left = tasks - run->first, count = left < *batch ? left : *batch;
        const double start = pell_seconds();
        double now;

        pell_pool_run(st->services->pool, (int) count, pt_do_task, run);
        if (pell_cancelled(st->ctx))
            return PELL_ERR_CANCELLED;
        if (pell_context_interrupted(st->ctx))
            return PELL_OK;
        if (atomic_load(&st->late))
            return PELL_OK;
        run->first += count;
        now = pell_seconds();
        if (count == *batch && now - start < 0.5 * PT_BATCH_SECONDS && *batch < (1u << 24))
            *batch *= 2;
        else if (now - start > 2.0 * PT_BATCH_SECONDS && *batch > (size_t) st->threads)
            *batch /= 2;
        pt_show(run, pt_progress_of(goal, from + (double) (run->target - from) * (double) run->first / (double) tasks));
        if (checkpoint && now - st->written > checkpoint->every)
            PELL_TRY(pt_write_films(st, run->in, false));
    }
    return PELL_OK;

fail:
    return res;
}

static struct pt_goal make_goal(const struct pt_run *run)
{
    const struct pt_state *st = run->st;
    const struct pt_method_knobs *k = &st->knobs;
    const int samples = run->in->num_samples, left = samples - (int) run->index;
    const bool open_ended = k->error > 0.0f || k->time_limit > 0.0f;
    const int images = reference_images(k->trace.half), total = ((k->samples > 0 ? k->samples : DEFAULT_SAMPLES) + images - 1) / images;
    struct pt_goal g = { .begin = pell_seconds(), .deadline = (double) INFINITY, .needed = (double) INFINITY };

    g.most = k->samples == 0 && open_ended ? PT_MAX_SAMPLES : (uint32_t) ((total + samples - 1) / samples);
    if (st->services->checkpoint && st->services->checkpoint->end_sample > 0)
        g.most = (uint32_t) (st->services->checkpoint->end_sample / samples);
    g.least = MIN_SAMPLES / (uint32_t) images;
    g.error = reference_sample_error((double) k->error, k->trace.half, samples);
    if (k->time_limit > 0.0f)
        g.deadline = g.begin + fmax((double) k->time_limit / images - (g.begin - st->begin), 0.0) / left;
    return g;
}

/* Saves the film before a round that may be abandoned: all samples of the round are then dropped, because samples that take long differ
 * from the others. */
static enum pell_result save_film(struct pt_run *run)
{
    struct pt_state *st = run->st;
    const struct pt_film *film = run->film;
    struct pt_film *saved = &st->saved;

    if (film->count > saved->capacity || film->tiles != saved->tiles || film->span_capacity != saved->span_capacity) {
        pt_film_free(st->ctx, saved);
        saved->pixels = pell_alloc_array(st->ctx, film->count, sizeof(*saved->pixels));
        saved->num_spans = pell_alloc_array(st->ctx, film->tiles, sizeof(*saved->num_spans));
        saved->spans = pell_alloc_array(st->ctx, film->tiles * film->span_capacity, sizeof(*saved->spans));
        if (!saved->pixels || !saved->num_spans || !saved->spans)
            return PELL_ERR_NOMEM;
        saved->capacity = film->count;
        saved->tiles = film->tiles;
        saved->span_capacity = film->span_capacity;
    }
    memcpy(saved->pixels, film->pixels, film->count * sizeof(*saved->pixels));
    memcpy(saved->num_spans, film->num_spans, film->tiles * sizeof(*saved->num_spans));
    memcpy(saved->spans, film->spans, film->tiles * film->span_capacity * sizeof(*saved->spans));
    return PELL_OK;
}

static void restore_film(struct pt_run *run)
{
    struct pt_film *film = run->film;
    const struct pt_film *saved = &run->st->saved;

    memcpy(film->pixels, saved->pixels, film->count * sizeof(*saved->pixels));
    memcpy(film->num_spans, saved->num_spans, film->tiles * sizeof(*saved->num_spans));
    memcpy(film->spans, saved->spans, film->tiles * film->span_capacity * sizeof(*saved->spans));
}

/* Runs rounds until the goal is reached. */
static enum pell_result run_film(struct pt_run *run)
{
    struct pt_state *st = run->st;
    struct pt_goal g = make_goal(run);
    const size_t pixels = run->film->starts[run->end_tile] - run->film->starts[run->first_tile];
    size_t batch = (size_t) st->threads;
    uint32_t least, most;
    enum pell_result res;

    pt_count_range(run, run->film, &least, &most);
    g.first = least;
    pt_show(run, pt_progress_of(&g, least));
    while (pixels > 0 && least < g.most) {
        uint32_t step = least < PT_ROUND_SAMPLES ? 1 : PT_ROUND_SAMPLES - least % PT_ROUND_SAMPLES;

        /* Not after an interruption that left pixels with more samples than others: an uninterrupted run would not have tested there. */
        if (g.error > 0.0 && least == most && least >= g.least && least % PT_ROUND_SAMPLES == 0) {
            const double error = pt_film_error(run->film, pt_traced(st));
            if (error <= g.error)
                break;
            g.needed = fmax(least + 1.0, least * (error / g.error) * (error / g.error));
        }
        step = step < g.most - least ? step : g.most - least;
        if (isfinite(g.deadline) && least > run->from) {
            const double now = pell_seconds(), each = least > g.first ? (now - g.begin) / (least - g.first) : 0.0;
            while (step > 1 && now + step * each > g.deadline)
                step--;
            if (now + step * each > g.deadline) {
                st->unfinished = st->unfinished || st->knobs.samples > 0 || g.error > 0.0;
                break;
            }
        }
        run->low = run->from;
        run->target = least + step;
        if (isfinite(g.deadline) && least > run->from) {
            PELL_TRY(pt_film_reserve(st->ctx, run->film, 1));
            PELL_TRY(save_film(run));
            atomic_store(&st->late, false);
            pt_scene_set_deadline(st->scene, g.deadline + LATE_SECONDS + LATE * (g.deadline - g.begin));
        }
        res = do_round(run, &g, least, &batch);
        pt_scene_set_deadline(st->scene, (double) INFINITY);
        PELL_TRY(res);
        if (pell_context_interrupted(st->ctx))
            return PELL_OK;
        if (atomic_load(&st->late)) {
            restore_film(run);
            st->unfinished = st->unfinished || st->knobs.samples > 0 || g.error > 0.0;
            break;
        }
        least = run->target;
        most = most > least ? most : least;
    }
    pt_show(run, 1.0);
    return PELL_OK;

fail:
    return res;
}

/* --- A frame ------------------------------------------------------------------------------------------------------------------------ */

static void put_light(const struct pt_run *run, const struct pell_frame_light *out)
{
    const struct pt_state *st = run->st;
    const struct pt_film *film = run->shown;

    for (size_t i = 0; i < film->count; i++) {
        const struct pt_pixel *p = &film->pixels[i];
        const uint32_t at = st->pixel_index[i];
        const double n = p->count > 0 ? p->count : 1.0;
        double mean[4], error[4];

        pt_pixel_measure(p, film->exponent, pt_traced(st), mean, error);
        for (int c = 0; c < 3; c++) {
            const double single = pt_sum_value(&p->sum[PT_SINGLE][c], film->exponent);
            const double surface = pt_sum_value(&p->sum[PT_SURFACE][c], film->exponent);
            double light = pt_sum_value(&p->sum[PT_MULTIPLE][c], film->exponent);
            if (out->single[c])
                out->single[c][at] = (float) (single / n);
            else
                light += single;
            if (out->surface[c])
                out->surface[c][at] = (float) (surface / n);
            else if (pt_traced(st))
                light += surface;
            out->light[c][at] = (float) (light / n);
            st->frame.standard_error[c][at] = (float) error[c];
        }
    }
}

static struct pt_counts count_all(const struct pt_state *st)
{
    struct pt_counts sum = { 0 };

    for (int i = 0; i < st->threads; i++) {
        const struct pt_counts *c = pt_walker_counts(st->walkers[i]);
        sum.samples += c->samples;
        sum.scatterings += c->scatterings;
        sum.rays += c->rays;
        sum.steps_without_ray += c->steps_without_ray;
        sum.cut += c->cut;
        sum.cut_weight += c->cut_weight;
        sum.lost += c->lost;
        sum.crossed += c->crossed;
        sum.chains += c->chains;
        sum.chains_cut += c->chains_cut;
        sum.late += c->late;
    }
    return sum;
}

/* The shortest mean free path of the scene's media, mm, if it is within a few rounding errors of positions on surfaces: paths then hit
 * surfaces from the wrong side. Else 0. */
static double shortest_mean_free_path(const struct pell_scene *scene)
{
    double extent = 0.0, shortest = INFINITY;

    for (int c = 0; c < 3; c++)
        extent = fmax(extent, fmax(fabs((double) scene->bounds_min[c]), fabs((double) scene->bounds_max[c])));
    for (size_t i = 0; i < scene->num_materials; i++) {
        const struct pell_medium *m = &scene->materials[i].medium;
        for (int c = 0; c < 3 && !scene->materials[i].opaque; c++)
            shortest = fmin(shortest, 1.0 / (m->sigma_a[c] + m->sigma_s_reduced[c] / (1.0 - m->g[c])));
    }
    return shortest < COORDINATE_ROUNDINGS * FLT_EPSILON * extent ? shortest : 0.0;
}

/* Reports on the image. */
static void report(struct pt_state *st, const struct pt_run *run)
{
    const struct pt_counts now = count_all(st);
    const double samples = fmax((double) (now.samples - st->before.samples), 1.0), brightest = pt_scene_brightest(st->scene);
    const double cut_weight = (now.cut_weight - st->before.cut_weight) / samples, films = run->index + 1.0;
    const int64_t cut = now.cut - st->before.cut, lost = now.lost - st->before.lost, crossed = now.crossed - st->before.crossed;
    const int64_t chains = now.chains - st->before.chains, dropped = now.chains_cut - st->before.chains_cut;
    char error[80] = "", bound[96] = "", hint[32];

    if (isfinite(st->error2) && run->from == 0 && run->end_tile - run->first_tile == run->film->tiles)
        snprintf(error, sizeof(error), ", relative error %.2f %% (standard error of its pixels)", 100.0 * sqrt(st->error2) / films);
    if (run->film->count > 0 && now.samples > st->before.samples)
        pell_info(st->ctx, "path-trace", "%.0f samples per pixel%s; %.0f scatterings and %.1f rays a sample", (double) st->made, error,
                  (double) (now.scatterings - st->before.scatterings) / samples, (double) (now.rays - st->before.rays) / samples);
    if (run->film->count > 0 && st->services->checkpoint && !pt_merges(st) && now.samples == st->before.samples)
        pell_info(st->ctx, "path-trace", "%.0f samples per pixel are in the checkpoint already, %d were asked for: none is added",
                  (double) st->made, st->knobs.samples > 0 ? st->knobs.samples : DEFAULT_SAMPLES);
    snprintf(hint, sizeof(hint), "--samples %.0f", fmin(st->most * films, PT_MAX_SAMPLES));
    if (st->most > UNEVEN * (double) st->fewest && !pell_context_interrupted(st->ctx))
        pell_warn(st->ctx, "path-trace", hint, "one multisample has %u samples, others end with %u: the image has their noise", st->most,
                  st->fewest);
    if (brightest > 0.0)
        snprintf(bound, sizeof(bound), ": on average at most %.3g W/(m^2 sr) a pixel of the light of area lights", cut_weight * brightest);
    if (cut > 0)
        pell_warn(st->ctx, "path-trace", "raise the knob events", "%.3g %% of the paths were cut, with %.3g %% of the weight%s",
                  100.0 * (double) cut / samples, 100.0 * cut_weight, bound);
    if ((double) lost > LOST * samples)
        pell_warn(st->ctx, "path-trace", "`pellucid check` lists open surfaces; leave a gap between solids that touch",
                  "%.3g %% of the paths left a solid without hitting its surface", fmin(100.0 * (double) lost / samples, 100.0));
    if ((double) crossed > CROSSED * samples && shortest_mean_free_path(st->services->scene) > 0.0)
        pell_warn(st->ctx, "path-trace", "scattering is not visible at this size: an opaque material looks the same",
                  "the mean free path of %.3g mm is below the precision of positions on the object: light near its surface is unreliable",
                  shortest_mean_free_path(st->services->scene));
    else if ((double) crossed > CROSSED * samples)
        pell_warn(st->ctx, "path-trace", "make them one surface, or leave a gap between solids",
                  "surfaces cross themselves or touch others: %.3g in 100 paths hit one from the wrong side",
                  100.0 * (double) crossed / samples);
    if (dropped > 0)
        pell_warn(st->ctx, "path-trace", "make the mesh finer",
                  "%lld of %lld specular manifold solutions were not found again and were dropped", (long long) dropped,
                  (long long) chains);
    if (atomic_load(&st->invalid))
        pell_warn(st->ctx, "path-trace", "please report the scene", "some samples were not finite and were set to 0");
}

static void add_to_report(struct pt_state *st, const struct pt_run *run)
{
    uint32_t least, most;

    pt_count_range(run, run->film, &least, &most);
    if (run->film->count == 0)
        return;
    st->made += least;
    st->fewest = least < st->fewest ? least : st->fewest;
    st->most = least > st->most ? least : st->most;
    st->error2 += least > 1 ? pow(pt_film_error(run->film, pt_traced(st)), 2.0) : (double) INFINITY;
}

static enum pell_result start_frame(struct pt_state *st, const struct pell_frame *in)
{
    st->begin = st->written = pell_seconds();
    st->shown = 0.0;
    st->unfinished = st->unwritten = st->gaps = false;
    atomic_store(&st->invalid, false);
    atomic_store(&st->late, false);
    st->before = count_all(st);
    st->made = 0;
    st->fewest = UINT32_MAX;
    st->most = 0;
    st->error2 = 0.0;
    st->frame.time = (struct pell_pass_time) { .name = "path-trace" };
    if (pt_communicator(st))
        return pt_ranks_start(st, in);
    if (!st->services->checkpoint)
        return PELL_OK;
    pt_drop_films(st);
    return pt_read_films(st, in);
}

/* Determines which tiles and samples the run computes. */
static void set_range(struct pt_run *run)
{
    const struct pt_state *st = run->st;
    const struct pt_film *done = &st->done[run->film - st->films];
    const struct pell_checkpoint *c = run->st->services->checkpoint;
    const size_t tiles = pt_tiles((uint32_t) run->in->shape.width, (uint32_t) run->in->shape.height);

    run->shown = run->film;
    run->done = pt_communicator(st) && done->identity != 0 ? done : NULL;
    run->from = c ? (uint32_t) (c->first_sample / run->in->num_samples) : 0;
    run->first_tile = c && (size_t) c->first_tile < tiles ? (size_t) c->first_tile : 0;
    run->end_tile = c && c->end_tile > 0 && (size_t) c->end_tile < tiles ? (size_t) c->end_tile : tiles;
}

/* Whether merged files lack samples of some tile that the first sample of the multisample has: then all later ones lack them, because a run
 * renders them one after the other. */
static bool is_incomplete(const struct pt_run *run)
{
    const struct pt_film *first = run->st->films, *film = run->film;

    if (!pt_merges(run->st) || run->st->services->checkpoint->mode != PELL_CHECKPOINT_MERGE_PARTIAL || film == first)
        return false;
    if (film->identity == 0 || film->tiles != first->tiles)
        return true;
    for (size_t t = 0; t < film->tiles; t++)
        if (film->num_spans[t] == 0 && first->num_spans[t] > 0 && film->starts[t] < film->starts[t + 1])
            return true;
    return false;
}

static enum pell_result skip_sample(struct pt_run *run)
{
    struct pt_state *st = run->st;
    enum pell_result res;

    PELL_TRY(pt_write_films(st, run->in, true));
    pell_warn(st->ctx, st->services->checkpoint->parts[0], NULL,
              "a partial image: it is the mean of %u of %d samples of the multisample, the others lack tiles and are left out", run->index,
              run->in->num_samples);
    return PELL_ERR_CANCELLED;

fail:
    return res;
}

/* Runs that ended by an error or a time limit: the merged result has the sample count of the longest one. */
static enum pell_result check_merged(struct pt_run *run)
{
    const struct pt_goal g = make_goal(run);
    uint32_t least, most;

    pt_count_range(run, run->film, &least, &most);
    return pt_check_gaps(run, g.most == PT_MAX_SAMPLES ? most : g.most);
}

static enum pell_result run_shared(struct pt_run *run)
{
    struct pt_goal g = make_goal(run);

    return pt_ranks_run(run, &g);
}

static enum pell_result path_trace_render(void *state, const struct pell_frame *in, const struct pell_frame_light *out)
{
    struct pt_state *st = state;
    const int index = in->sample, samples = in->num_samples;
    const double start = pell_seconds();
    struct pt_run run = {
        .st = st,
        .in = in,
        .film = &st->films[st->num_films > 1 ? index : 0],
        .view = *in->view,
        .index = (uint32_t) index,
    };
    struct pt_counts counts;
    bool last;
    enum pell_result res;

    if (index == 0)
        PELL_TRY(start_frame(st, in));
    set_range(&run);
    if (is_incomplete(&run))
        return skip_sample(&run);
    PELL_TRY(pt_start_film(&run));
    memset(st->frame.standard_error[0], 0, 3 * (size_t) in->shape.stride * (size_t) in->shape.height * sizeof(float));
    counts = count_all(st);
    PELL_TRY(pt_communicator(st) ? run_shared(&run) : pt_merges(st) ? check_merged(&run) : run_film(&run));
    put_light(&run, out);
    last = index == samples - 1 || pell_context_interrupted(st->ctx);
    st->unfinished = st->unfinished || pell_context_interrupted(st->ctx);
    if (pt_communicator(st) && last)
        PELL_TRY(pt_ranks_finish(st, in));
    else if (st->services->checkpoint && last)
        PELL_TRY(pt_write_films(st, in, true));
    /* A sample of the multisample with black pixels for lack of paths would darken the earlier ones, and an image without any would replace
     * a complete one. */
    if (pell_context_interrupted(st->ctx) && has_black(run.shown) && !(index == 0 && (pt_communicator(st) || pt_merges(st)))) {
        if (index == 0)
            pell_warn(st->ctx, "path-trace", NULL, "ended before every pixel had a sample, so there is no image yet");
        return PELL_ERR_CANCELLED;
    }
    if (run.shown == run.film) {
        add_to_report(st, &run);
        if (last)
            report(st, &run);
    }
    st->frame.time.seconds = pell_seconds() - start;
    st->frame.time.pixels = (int64_t) run.film->count;
    st->frame.time.bytes = (int64_t) (run.film->count * (sizeof(struct pt_pixel) + 40));
    st->frame.time.rays = count_all(st).rays - counts.rays;
    return PELL_OK;

fail:
    return res;
}

static void path_trace_destroy(void *state)
{
    struct pt_state *st = state;

    if (!st)
        return;
    if (st->films)
        pt_drop_films(st);
    for (int i = 0; st->walkers && i < st->threads; i++)
        pt_walker_destroy(&st->walkers[i]);
    pell_free(st->ctx, st->walkers);
    pell_free(st->ctx, st->films);
    pell_free(st->ctx, st->pixel_index);
    pell_free(st->ctx, st->tile_pixels);
    for (size_t i = 0; st->done && i < st->num_films; i++)
        pt_film_free(st->ctx, &st->done[i]);
    pell_free(st->ctx, st->done);
    pt_film_free(st->ctx, &st->total);
    pt_film_free(st->ctx, &st->saved);
    pell_free(st->ctx, st->tasks);
    pell_free(st->ctx, st->frame.standard_error[0]);
    pt_scene_destroy(&st->scene);
    pell_free(st->ctx, st);
}

static bool path_trace_unwritten(const void *state)
{
    const struct pt_state *st = state;

    return st->unwritten;
}

static bool path_trace_unfinished(const void *state)
{
    const struct pt_state *st = state;

    return st->unfinished;
}

static enum pell_result path_trace_create(const struct pell_services *services, const struct pell_frame_shape *shape, const void *knobs,
                                          void **state)
{
    struct pell_context *ctx = services->ctx;
    struct pt_state *st = pell_zalloc(ctx, sizeof(*st));
    enum pell_result res;

    *state = st;
    if (!st)
        return PELL_ERR_NOMEM;
    st->services = services;
    st->ctx = ctx;
    st->knobs = *(const struct pt_method_knobs *) knobs;
    if (!st->knobs.reentry)
        st->knobs.trace.bounces = 0;
    st->knobs.trace.techniques = st->knobs.connections ? PT_ALL : PT_HIT_LIGHTS | PT_LIGHT_SAMPLES;
    st->threads = pell_pool_threads(services->pool);
    st->num_films = services->checkpoint ? (size_t) services->settings->msaa : 1;
    res = PELL_ERR_NOMEM;
    st->films = pell_calloc(ctx, st->num_films, sizeof(*st->films));
    st->walkers = pell_calloc(ctx, (size_t) st->threads, sizeof(*st->walkers));
    st->done = pell_calloc(ctx, st->num_films, sizeof(*st->done));
    if (!st->films || !st->walkers || !st->done)
        goto fail;
    PELL_TRY(reference_make_planes(ctx, shape, &st->frame));
    PELL_TRY(pt_scene_create(services, &st->knobs.trace, &st->scene));
    for (int i = 0; i < st->threads; i++)
        PELL_TRY(pt_walker_create(st->scene, &st->walkers[i]));
    return PELL_OK;

fail:
    return res;
}

const struct pell_method_engine pell_path_trace_cpu = {
    .create = path_trace_create,
    .record = path_trace_render,
    .destroy = path_trace_destroy,
    .times = reference_times,
    .standard_error = reference_standard_error,
    .unfinished = path_trace_unfinished,
    .unwritten = path_trace_unwritten,
};
