/* SPDX-License-Identifier: MIT
 *
 * tasks.c - tasks of a round: the missing samples of some tiles are traced and added one tile at a time.
 */
#include "methods/path_trace/run.h"

enum {
    POINTS = 512, /* pixels per call */
    JOBS = 1024   /* samples traced per call */
};

void pt_count_range(const struct pt_run *run, const struct pt_film *film, uint32_t *least, uint32_t *most)
{
    bool any = false;

    *least = UINT32_MAX;
    *most = run->from;
    for (size_t t = run->first_tile; t < run->end_tile; t++) {
        const uint32_t spans = film->num_spans[t];
        uint32_t next, missing;
        if (run->film->starts[t] == run->film->starts[t + 1])
            continue;
        missing = pt_film_missing(film, t, run->from, &next);
        any = true;
        *least = missing < *least ? missing : *least;
        if (spans > 0 && film->spans[t * film->span_capacity + spans - 1].end > *most)
            *most = film->spans[t * film->span_capacity + spans - 1].end;
    }
    if (!any)
        *least = 0;
}

static void start_point(const struct pt_run *run, size_t at, struct pt_point *point)
{
    const struct pell_frame *in = run->in;
    const struct pell_view *v = &run->view;
    const int x = (int) (at % (size_t) in->shape.stride), y = (int) (at / (size_t) in->shape.stride);
    const struct pell_vec3 p = vec3(in->position[0][at], in->position[1][at], in->position[2][at]), to = vec3_sub(v->origin, p);

    *point = (struct pt_point) {
        .at = p,
        .toward = in->shape.orthographic ? vec3_mul(v->forward, -1.0f) : vec3_normalize(to),
        .depth = in->shape.orthographic ? in->depth[at] : vec3_length(to),
        .material = in->material[at],
        .pixel = (uint32_t) y * (uint32_t) in->shape.width + (uint32_t) x +
                 run->index * (uint32_t) in->shape.width * (uint32_t) in->shape.height,
    };
}

/* Samples of all pixels of a tile. */
struct block {
    uint32_t tile;
    struct pt_span span;
};

/* Blocks of a worker's next call, and their samples. */
struct batch {
    struct block blocks[JOBS];
    struct pt_point points[POINTS];
    struct pt_job jobs[JOBS];
    int num_blocks, num_points, num_jobs;
};

/* Traces the blocks and adds them. False: interrupted; they are dropped. */
static bool do_blocks(struct pt_run *run, struct batch *b, int worker)
{
    struct pt_state *st = run->st;
    struct pt_film *film = run->film;
    const int64_t late = pt_walker_counts(st->walkers[worker])->late;
    const struct pt_job *job = b->jobs;

    if (pt_stopped(st->scene) || atomic_load_explicit(&st->late, memory_order_relaxed))
        return false;
    pt_trace_jobs(st->scene, st->walkers[worker], b->jobs, b->num_jobs);
    if (pt_stopped(st->scene))
        return false;
    if (pt_walker_counts(st->walkers[worker])->late > late) {
        atomic_store_explicit(&st->late, true, memory_order_relaxed);
        return false;
    }
    for (int k = 0; k < b->num_blocks; k++) {
        const struct block *block = &b->blocks[k];
        for (uint32_t i = film->starts[block->tile]; i < film->starts[block->tile + 1]; i++)
            for (uint32_t n = block->span.first; n < block->span.end; n++, job++)
                if (!pt_pixel_add(&film->pixels[i], film->exponent, &job->light, pt_traced(st)))
                    atomic_store_explicit(&st->invalid, true, memory_order_relaxed);
        pt_film_cover(film, block->tile, block->span);
    }
    b->num_blocks = b->num_points = b->num_jobs = 0;
    return true;
}

/* Like pt_film_missing, for samples that neither this rank nor an earlier run has. */
static uint32_t missing(const struct pt_run *run, size_t tile, uint32_t from, uint32_t *next)
{
    uint32_t end, before;

    from = pt_film_missing(run->film, tile, from, next);
    while (run->done) {
        before = from;
        from = pt_film_missing(run->done, tile, from, &end);
        *next = end < *next ? end : *next;
        if (from == before)
            break;
        from = pt_film_missing(run->film, tile, from, next);
    }
    return from;
}

static bool do_tile(struct pt_run *run, uint32_t tile, struct batch *b, int worker)
{
    const struct pt_film *film = run->film;
    const uint32_t first = film->starts[tile], pixels = film->starts[tile + 1] - first, most = JOBS / pixels;
    uint32_t next, from = missing(run, tile, run->low, &next);

    while (from < run->target) {
        uint32_t end = next < run->target ? next : run->target;

        end = end - from > most ? from + most : end;
        if (b->num_jobs + (int) (pixels * (end - from)) > JOBS || b->num_points + (int) pixels > POINTS)
            if (!do_blocks(run, b, worker))
                return false;
        b->blocks[b->num_blocks++] = (struct block) { tile, { from, end } };
        for (uint32_t i = 0; i < pixels; i++) {
            struct pt_point *point = &b->points[b->num_points++];
            start_point(run, run->st->pixel_index[first + i], point);
            for (uint32_t n = from; n < end; n++)
                b->jobs[b->num_jobs++] = (struct pt_job) { .point = point, .sample = n };
        }
        from = missing(run, tile, end, &next);
    }
    return true;
}

void pt_do_task(void *arg, int index, int worker)
{
    struct pt_run *run = arg;
    const uint32_t *tasks = run->st->tasks + run->first + (size_t) index;
    struct batch batch = { .num_blocks = 0 };

    for (uint32_t tile = tasks[0]; tile < tasks[1]; tile++)
        if (run->film->starts[tile] < run->film->starts[tile + 1] && !do_tile(run, tile, &batch, worker))
            return;
    if (batch.num_blocks > 0)
        do_blocks(run, &batch, worker);
}

enum pell_result pt_list_tasks(struct pt_run *run, size_t pixels, size_t *count)
{
    struct pt_state *st = run->st;
    const uint32_t *starts = run->film->starts;
    size_t begin = run->first_tile;

    if (run->film->tiles + 1 > st->tasks_capacity) {
        uint32_t *grown = pell_realloc_array(st->ctx, st->tasks, run->film->tiles + 1, sizeof(*grown));
        if (!grown)
            return PELL_ERR_NOMEM;
        st->tasks = grown;
        st->tasks_capacity = run->film->tiles + 1;
    }
    *count = 0;
    for (size_t t = begin; t < run->end_tile; t++)
        if (starts[t + 1] - starts[begin] >= pixels || (t + 1 == run->end_tile && starts[t + 1] > starts[begin])) {
            st->tasks[(*count)++] = (uint32_t) begin;
            begin = t + 1;
        }
    st->tasks[*count] = (uint32_t) begin;
    return PELL_OK;
}

void pt_show(struct pt_run *run, double done)
{
    const double fraction = (run->index + fmin(fmax(done, 0.0), 1.0)) / run->in->num_samples;

    run->st->shown = fmax(run->st->shown, fraction);
    pell_progress(run->st->ctx, "path-trace", run->st->shown);
}

double pt_progress_of(const struct pt_goal *g, double samples)
{
    const double by_samples = g->most < PT_MAX_SAMPLES ? samples / g->most : 0.0, by_error = samples / g->needed;
    const double by_time = isfinite(g->deadline) ? (pell_seconds() - g->begin) / (g->deadline - g->begin) : 0.0;

    return fmax(by_samples, fmax(by_error, by_time));
}
