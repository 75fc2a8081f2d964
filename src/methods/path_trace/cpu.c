/* SPDX-License-Identifier: MIT
 *
 * cpu.c - runs the transport over the pixels of a frame, in rounds: a round brings every pixel to one number of samples.
 *
 * Which samples a pixel has decides its sums, never who made them or when: so pictures are the same for any number of threads, and a run
 * that was interrupted between any two samples and goes on from its checkpoint ends with the bits of one that was not.
 *
 * When to stop is asked between rounds: after `samples`; where the error of the picture is `error`, at every fourth sample from the
 * sixteenth on; or where the next round would not end within `time-limit`. The samples of the multisample come one after the other, each
 * with its own film and its share of the time.
 */
#include "methods/path_trace/path_trace.h"

#include "base/file.h"
#include "base/hash.h"
#include "methods/reference_frame.h"
#include "render/engine.h"

#include <stdio.h>
#include <unistd.h>

enum {
    TOGETHER = 4, /* samples of a round, from the fourth on */
    TILE = 512,   /* pixels of a task at most: many walks, so that lanes are seldom free */
    SMALL_TILE = 32,
    TILES = 16,    /* for each thread in a picture, where tiles are not the smallest */
    JOBS = 1024,   /* samples that are traced in one call */
    LEAST = 16,    /* samples of a pixel before its error is believed */
    PLAIN = 64,    /* samples where nothing says when to stop */
    MOST = 1 << 30 /* samples of a pixel */
};

#define CROSSED 0.01       /* of the paths: fewer is rounding at edges */
#define BATCH_SECONDS 0.25 /* between two looks at the clock */
#define LATE_SECONDS 0.25  /* and this share of the time beyond the deadline until a round is given up: most end near it */
#define LATE 0.05

struct pt_state {
    struct reference_frame frame;         /* first */
    const struct pell_services *services; /* borrowed */
    struct pell_context *ctx;
    struct pt_method_knobs knobs;
    struct pt_scene *scene;
    struct pt_walker **walkers;
    int threads;
    struct pt_film *films; /* of each sample of the multisample where they are kept, else one for all */
    size_t num_films;
    uint32_t *places; /* of the film's pixels in the planes */
    size_t places_capacity;
    struct pt_counts before; /* of all frames before this */
    double begin, written;   /* of the frame; of the last checkpoint */
    double shown;            /* progress */
    atomic_bool invalid;     /* some sample of the frame was no number */
    atomic_bool late;        /* the round was given up at the deadline */
    struct pt_pixel *kept;   /* the film before the round, where there is a deadline */
    size_t kept_capacity;
};

/* One sample of the multisample. */
struct run {
    struct pt_state *st;
    const struct pell_frame *in;
    struct pt_film *film;
    struct pell_view view;
    uint32_t number; /* of the sample */
    uint32_t target; /* samples of a pixel after the round */
    size_t first;    /* task of the batch */
    size_t tile;     /* pixels of a task */
};

static bool traced(const struct pt_state *st)
{
    return st->knobs.surface == PT_SURFACE_TRACED;
}

/* --- Films -------------------------------------------------------------------------------------------------------------------------- */

static void drop_films(struct pt_state *st)
{
    for (size_t i = 0; i < st->num_films; i++)
        pell_free(st->ctx, st->films[i].pixels);
    memset(st->films, 0, st->num_films * sizeof(*st->films));
}

static struct pt_checkpoint_key make_key(const struct pt_state *st, const struct pell_frame *in)
{
    const struct pt_knobs *k = &st->knobs.trace;
    const int64_t words[] = { k->normals,
                              k->boundary,
                              k->acceleration,
                              k->events,
                              k->bounces,
                              k->techniques,
                              st->knobs.surface,
                              st->services->settings->boundary,
                              st->services->settings->seed + k->half * (1LL << 60) };
    const char *version = pell_version_string();
    struct pt_checkpoint_key key = { (uint32_t) in->shape.width, (uint32_t) in->shape.height, (uint32_t) st->num_films, 0, 0 };

    key.scene = pell_scene_hash(st->services->scene);
    key.run = pell_hash_bytes(1, version, strlen(version));
    key.run = pell_hash_number(key.run, (double) k->roulette);
    for (size_t i = 0; i < PELL_COUNT(words); i++)
        key.run = pell_hash_word(key.run, (uint64_t) words[i]);
    return key;
}

static enum pell_result read_checkpoint(struct pt_state *st, const struct pell_frame *in)
{
    const struct pt_checkpoint_key key = make_key(st, in);
    const char *path = st->services->checkpoint->path;
    enum pell_result res;
    uint8_t *data;
    size_t size;

    if (access(path, F_OK) != 0)
        return PELL_OK;
    res = pell_file_read(st->ctx, path, &data, &size);
    if (res != PELL_OK)
        return res;
    res = pt_checkpoint_decode(st->ctx, path, data, size, &key, st->films);
    pell_free(st->ctx, data);
    return res;
}

/* A full disk or the like must not end the work of hours: it is said, and the work goes on. */
static void write_checkpoint(struct pt_state *st, const struct pell_frame *in)
{
    const struct pt_checkpoint_key key = make_key(st, in);
    const char *path = st->services->checkpoint->path;
    uint8_t *data;
    size_t size;

    pell_log_downgrade(st->ctx, 1);
    if (pt_checkpoint_encode(st->ctx, &key, st->films, &data, &size) == PELL_OK) {
        if (pell_file_write(st->ctx, path, data, size) != PELL_OK)
            pell_warn(st->ctx, path, NULL, "the checkpoint was not written; the render continues");
        pell_free(st->ctx, data);
    }
    pell_log_downgrade(st->ctx, -1);
    st->written = pell_seconds();
}

/* Lists the pixels, and a number that stands for what they see. */
static enum pell_result list_places(struct run *run, uint64_t *identity)
{
    const struct pell_frame *in = run->in;
    struct pt_state *st = run->st;
    size_t count = 0;

    *identity = 1;
    for (int pass = 0; pass < 2; pass++) {
        if (pass == 1 && count > st->places_capacity) {
            uint32_t *grown = pell_realloc_array(st->ctx, st->places, count, sizeof(*grown));
            if (!grown)
                return PELL_ERR_NOMEM;
            st->places = grown;
            st->places_capacity = count;
        }
        count = 0;
        for (int y = in->rect.y0; y < in->rect.y1; y++)
            for (int x = in->rect.x0; x < in->rect.x1; x++) {
                const size_t at = (size_t) (y * in->shape.stride + x);
                if (!in->material[at])
                    continue;
                if (pass == 1) {
                    const float p[3] = { in->position[0][at], in->position[1][at], in->position[2][at] };
                    st->places[count] = (uint32_t) at;
                    *identity = pell_hash_word(*identity, (uint64_t) x | (uint64_t) y << 16 | (uint64_t) in->material[at] << 32);
                    *identity = pell_hash_bytes(*identity, p, sizeof(p));
                }
                count++;
            }
    }
    run->film->count = count;
    return PELL_OK;
}

/* Readies the film of a sample: empty, or as the checkpoint has it. */
static enum pell_result start_film(struct run *run)
{
    struct pt_state *st = run->st;
    struct pt_film *film = run->film;
    const struct pt_film old = *film;
    const bool kept = st->num_films > 1 || st->services->checkpoint;
    uint64_t identity;
    enum pell_result res;

    PELL_TRY(list_places(run, &identity));
    if (kept && old.count > 0) {
        if (old.count == film->count && old.identity == identity)
            return PELL_OK;
        return pell_error(st->ctx, PELL_ERR_INVALID, st->services->checkpoint->path, "name another file, or remove this one to begin anew",
                          "is of another view of this scene");
    }
    film->identity = identity;
    if (film->count > film->capacity) {
        struct pt_pixel *grown;
        pell_free(st->ctx, film->pixels);
        film->pixels = NULL;
        film->capacity = 0;
        grown = pell_alloc_array(st->ctx, film->count, sizeof(*grown));
        res = PELL_ERR_NOMEM;
        if (!grown)
            goto fail;
        film->pixels = grown;
        film->capacity = film->count;
    }
    if (film->count > 0)
        memset(film->pixels, 0, film->count * sizeof(*film->pixels));
    return PELL_OK;

fail:
    film->count = 0;
    return res;
}

static void count_range(const struct pt_film *film, uint32_t *least, uint32_t *most)
{
    *least = film->count ? UINT32_MAX : 0;
    *most = 0;
    for (size_t i = 0; i < film->count; i++) {
        *least = film->pixels[i].count < *least ? film->pixels[i].count : *least;
        *most = film->pixels[i].count > *most ? film->pixels[i].count : *most;
    }
}

/* --- Rounds ------------------------------------------------------------------------------------------------------------------------- */

static void start_point(const struct run *run, size_t at, struct pt_point *point)
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
                 run->number * (uint32_t) in->shape.width * (uint32_t) in->shape.height,
    };
}

/* Traces samples of the pixels from `first` on, and adds them in their order. False: interrupted, they are dropped. */
static bool do_jobs(struct run *run, struct pt_job *jobs, int count, size_t first, int worker)
{
    struct pt_state *st = run->st;
    struct pt_pixel *pixel = &run->film->pixels[first];
    const struct pt_point *point = jobs[0].point;
    const int64_t late = pt_walker_counts(st->walkers[worker])->late;

    if (pt_stopped(st->scene) || atomic_load_explicit(&st->late, memory_order_relaxed))
        return false;
    pt_trace_jobs(st->scene, st->walkers[worker], jobs, count);
    if (pt_stopped(st->scene))
        return false;
    if (pt_walker_counts(st->walkers[worker])->late > late) {
        atomic_store_explicit(&st->late, true, memory_order_relaxed);
        return false;
    }
    for (int i = 0; i < count; i++) {
        pixel += jobs[i].point - point;
        point = jobs[i].point;
        if (!pt_pixel_add(pixel, &jobs[i].light, traced(st)))
            atomic_store_explicit(&st->invalid, true, memory_order_relaxed);
    }
    return true;
}

static void do_tile(void *arg, int index, int worker)
{
    struct run *run = arg;
    const struct pt_film *film = run->film;
    const size_t begin = (run->first + (size_t) index) * run->tile;
    const size_t end = begin + run->tile < film->count ? begin + run->tile : film->count;
    struct pt_point points[TILE];
    struct pt_job jobs[JOBS];
    size_t first = begin;
    int count = 0;

    for (size_t i = begin; i < end; i++)
        start_point(run, run->st->places[i], &points[i - begin]);
    for (size_t i = begin; i < end; i++)
        for (uint32_t k = film->pixels[i].count; k < run->target; k++) {
            if (count == JOBS) {
                if (!do_jobs(run, jobs, count, first, worker))
                    return;
                count = 0;
            }
            if (count == 0)
                first = i;
            jobs[count++] = (struct pt_job) { .point = &points[i - begin], .sample = k };
        }
    if (count > 0)
        do_jobs(run, jobs, count, first, worker);
}

/* `done`: of this sample of the multisample. */
static void show(struct run *run, double done)
{
    const double whole = (run->number + fmin(fmax(done, 0.0), 1.0)) / run->in->num_samples;

    run->st->shown = fmax(run->st->shown, whole);
    pell_progress(run->st->ctx, "path-trace", run->st->shown);
}

struct goal {
    uint32_t most;   /* samples */
    uint32_t least;  /* samples before the error is believed */
    double error;    /* of this film; 0: not asked for */
    double deadline; /* INFINITY: none */
    double begin;
    uint32_t first; /* samples that were there at the beginning */
    double needed;  /* samples that the error asks for, as far as is known; INFINITY */
};

static double progress_of(const struct goal *g, double samples)
{
    const double by_samples = g->most < MOST ? samples / g->most : 0.0, by_error = samples / g->needed;
    const double by_time = isfinite(g->deadline) ? (pell_seconds() - g->begin) / (g->deadline - g->begin) : 0.0;

    return fmax(by_samples, fmax(by_error, by_time));
}

/* Brings all pixels to run->target samples, or as far as an interruption lets it. */
static enum pell_result do_round(struct run *run, const struct goal *goal, uint32_t from, size_t *batch)
{
    struct pt_state *st = run->st;
    const size_t homogeneous = run->film->count / ((size_t) st->threads * TILES);
    size_t tiles;
    const struct pell_checkpoint *checkpoint = st->services->checkpoint;

    run->tile = homogeneous > TILE ? TILE : homogeneous > SMALL_TILE ? homogeneous : SMALL_TILE;
    tiles = (run->film->count + run->tile - 1) / run->tile;
    for (run->first = 0; run->first < tiles;) {
        const size_t left = tiles - run->first, count = left < *batch ? left : *batch;
        const double start = pell_seconds();
        double now;

        pell_pool_run(st->services->pool, (int) count, do_tile, run);
        if (pell_cancelled(st->ctx))
            return PELL_ERR_CANCELLED;
        if (pell_context_interrupted(st->ctx))
            return PELL_OK;
        if (atomic_load(&st->late))
            return PELL_OK;
        run->first += count;
        now = pell_seconds();
        if (count == *batch && now - start < 0.5 * BATCH_SECONDS && *batch < (1u << 24))
            *batch *= 2;
        else if (now - start > 2.0 * BATCH_SECONDS && *batch > (size_t) st->threads)
            *batch /= 2;
        show(run, progress_of(goal, from + (double) (run->target - from) * (double) run->first / (double) tiles));
        if (checkpoint && now - st->written > checkpoint->every)
            write_checkpoint(st, run->in);
    }
    return PELL_OK;
}

static struct goal make_goal(const struct run *run)
{
    const struct pt_state *st = run->st;
    const struct pt_method_knobs *k = &st->knobs;
    const int samples = run->in->num_samples, left = samples - (int) run->number;
    const bool open = k->error > 0.0f || k->time_limit > 0.0f;
    const int share = k->trace.half == REFERENCE_WHOLE ? 1 : 2, total = ((k->samples > 0 ? k->samples : PLAIN) + share - 1) / share;
    struct goal g = { .begin = pell_seconds(), .deadline = (double) INFINITY, .needed = (double) INFINITY };

    g.most = k->samples == 0 && open ? MOST : (uint32_t) ((total + samples - 1) / samples);
    g.least = LEAST / (uint32_t) share;
    g.error = reference_half_error((double) k->error, k->trace.half) * sqrt((double) samples);
    if (k->time_limit > 0.0f)
        g.deadline = g.begin + fmax((double) k->time_limit / share - (g.begin - st->begin), 0.0) / left;
    return g;
}

/* A round that may be given up: all of its samples, since those that take long are not like the others. */
static enum pell_result keep_film(struct run *run)
{
    struct pt_state *st = run->st;

    if (run->film->count > st->kept_capacity) {
        pell_free(st->ctx, st->kept);
        st->kept_capacity = 0;
        st->kept = pell_alloc_array(st->ctx, run->film->count, sizeof(*st->kept));
        if (!st->kept)
            return PELL_ERR_NOMEM;
        st->kept_capacity = run->film->count;
    }
    memcpy(st->kept, run->film->pixels, run->film->count * sizeof(*st->kept));
    return PELL_OK;
}

/* Rounds until the goal is reached. */
static enum pell_result run_film(struct run *run)
{
    struct pt_state *st = run->st;
    struct goal g = make_goal(run);
    size_t batch = (size_t) st->threads;
    uint32_t least, most;
    enum pell_result res;

    count_range(run->film, &least, &most);
    g.first = least;
    show(run, progress_of(&g, least));
    while (run->film->count > 0 && least < g.most) {
        uint32_t step = least < TOGETHER ? 1 : TOGETHER - least % TOGETHER;

        /* Not where an interruption left pixels of more samples than others: the run that was not interrupted did not ask there. */
        if (g.error > 0.0 && least == most && least >= g.least && least % TOGETHER == 0) {
            const double error = pt_film_error(run->film, traced(st));
            if (error <= g.error)
                break;
            g.needed = fmax(least + 1.0, least * (error / g.error) * (error / g.error));
        }
        step = step < g.most - least ? step : g.most - least;
        if (isfinite(g.deadline) && least > 0) {
            const double now = pell_seconds(), each = least > g.first ? (now - g.begin) / (least - g.first) : 0.0;
            while (step > 1 && now + step * each > g.deadline)
                step--;
            if (now + step * each > g.deadline)
                break;
        }
        run->target = least + step;
        if (isfinite(g.deadline) && least > 0) {
            PELL_TRY(keep_film(run));
            atomic_store(&st->late, false);
            pt_scene_set_deadline(st->scene, g.deadline + LATE_SECONDS + LATE * (g.deadline - g.begin));
        }
        res = do_round(run, &g, least, &batch);
        pt_scene_set_deadline(st->scene, (double) INFINITY);
        PELL_TRY(res);
        if (pell_context_interrupted(st->ctx))
            return PELL_OK;
        if (atomic_load(&st->late)) {
            memcpy(run->film->pixels, st->kept, run->film->count * sizeof(*st->kept));
            break;
        }
        least = run->target;
        most = most > least ? most : least;
    }
    show(run, 1.0);
    return PELL_OK;

fail:
    return res;
}

/* --- A frame ------------------------------------------------------------------------------------------------------------------------ */

static void put_light(const struct run *run, const struct pell_frame_light *out)
{
    const struct pt_state *st = run->st;

    for (size_t i = 0; i < run->film->count; i++) {
        const struct pt_pixel *p = &run->film->pixels[i];
        const uint32_t at = st->places[i];
        const double n = p->count > 0 ? p->count : 1.0;
        double mean[4], error[4];

        pt_pixel_measure(p, traced(st), mean, error);
        for (int c = 0; c < 3; c++) {
            double light = p->sum[PT_MULTIPLE][c];
            if (out->single[c])
                out->single[c][at] = (float) (p->sum[PT_SINGLE][c] / n);
            else
                light += p->sum[PT_SINGLE][c];
            if (out->surface[c])
                out->surface[c][at] = (float) (p->sum[PT_SURFACE][c] / n);
            else if (traced(st))
                light += p->sum[PT_SURFACE][c];
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

/* What there is to say about the picture. */
static void report(struct pt_state *st, const struct run *run)
{
    const struct pt_counts now = count_all(st);
    const double samples = fmax((double) (now.samples - st->before.samples), 1.0), lights = pt_scene_brightest(st->scene);
    const double missing = (now.cut_weight - st->before.cut_weight) / samples, films = run->number + 1.0;
    const int64_t cut = now.cut - st->before.cut, lost = now.lost - st->before.lost, crossed = now.crossed - st->before.crossed;
    const int64_t chains = now.chains - st->before.chains, given_up = now.chains_cut - st->before.chains_cut;
    char error[48] = "", bound[96] = "";
    uint32_t least, most;

    count_range(run->film, &least, &most);
    if (least > 1)
        snprintf(error, sizeof(error), ", relative error %.2f %%", 100.0 * pt_film_error(run->film, traced(st)) / sqrt(films));
    if (run->film->count > 0 && now.samples > st->before.samples)
        pell_info(st->ctx, "path-trace", "%.0f samples per pixel%s; %.0f scatterings and %.1f rays a sample", least * films, error,
                  (double) (now.scatterings - st->before.scatterings) / samples, (double) (now.rays - st->before.rays) / samples);
    if (lights > 0.0)
        snprintf(bound, sizeof(bound), ": on average at most %.3g W/(m^2 sr) a pixel of the light of area lights", missing * lights);
    if (cut > 0)
        pell_warn(st->ctx, "path-trace", "raise the knob events", "%.3g %% of the paths were cut, with %.3g %% of the weight%s",
                  100.0 * (double) cut / samples, 100.0 * missing, bound);
    if (lost > 0)
        pell_warn(st->ctx, "path-trace", "`pellucid check` lists open surfaces",
                  "%.3g %% of the paths left a solid without hitting its surface", 100.0 * (double) lost / samples);
    if ((double) crossed > CROSSED * samples)
        pell_warn(st->ctx, "path-trace", "make them one surface, or leave a gap between solids",
                  "surfaces cross themselves or touch others: %.3g in 100 paths hit one from the wrong side",
                  100.0 * (double) crossed / samples);
    if (given_up > 0)
        pell_warn(st->ctx, "path-trace", "make the mesh finer",
                  "%lld of %lld specular manifold solutions were not found again and were dropped", (long long) given_up,
                  (long long) chains);
    if (atomic_load(&st->invalid))
        pell_warn(st->ctx, "path-trace", "please report the scene", "samples that were not finite were set to 0");
    if (least == 0 && most > 0)
        pell_warn(st->ctx, "path-trace", NULL, "ended before every pixel had a sample: the others are black");
}

static enum pell_result start_frame(struct pt_state *st, const struct pell_frame *in)
{
    st->begin = st->written = pell_seconds();
    st->shown = 0.0;
    atomic_store(&st->invalid, false);
    atomic_store(&st->late, false);
    st->before = count_all(st);
    st->frame.time = (struct pell_pass_time) { .name = "path-trace" };
    if (!st->services->checkpoint) {
        for (size_t i = 0; i < st->num_films; i++)
            st->films[i].count = 0;
        return PELL_OK;
    }
    drop_films(st);
    return read_checkpoint(st, in);
}

static enum pell_result path_trace_render(void *state, const struct pell_frame *in, const struct pell_frame_light *out)
{
    struct pt_state *st = state;
    const int number = in->sample, samples = in->num_samples;
    const double start = pell_seconds();
    struct run run = {
        .st = st,
        .in = in,
        .film = &st->films[st->num_films > 1 ? number : 0],
        .view = *in->view,
        .number = (uint32_t) number,
    };
    struct pt_counts counts;
    uint32_t least, most;
    bool last;
    enum pell_result res;

    if (number == 0)
        PELL_TRY(start_frame(st, in));
    PELL_TRY(start_film(&run));
    memset(st->frame.standard_error[0], 0, 3 * (size_t) in->shape.stride * (size_t) in->shape.height * sizeof(float));
    counts = count_all(st);
    PELL_TRY(run_film(&run));
    put_light(&run, out);
    last = number == samples - 1 || pell_context_interrupted(st->ctx);
    if (st->services->checkpoint && last)
        write_checkpoint(st, in);
    /* A sample of the multisample in which pixels are black for want of a path would darken those before it. */
    count_range(run.film, &least, &most);
    if (number > 0 && run.film->count > 0 && least == 0)
        return PELL_ERR_CANCELLED;
    if (last)
        report(st, &run);
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
        drop_films(st);
    for (int i = 0; st->walkers && i < st->threads; i++)
        pt_walker_destroy(&st->walkers[i]);
    pell_free(st->ctx, st->walkers);
    pell_free(st->ctx, st->films);
    pell_free(st->ctx, st->places);
    pell_free(st->ctx, st->kept);
    pell_free(st->ctx, st->frame.standard_error[0]);
    pt_scene_destroy(&st->scene);
    pell_free(st->ctx, st);
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
    st->knobs.trace.techniques = st->knobs.connections ? PT_ALL : PT_CHANCE | PT_LIGHTS;
    st->threads = pell_pool_threads(services->pool);
    st->num_films = services->checkpoint ? (size_t) services->settings->msaa : 1;
    res = PELL_ERR_NOMEM;
    st->films = pell_calloc(ctx, st->num_films, sizeof(*st->films));
    st->walkers = pell_calloc(ctx, (size_t) st->threads, sizeof(*st->walkers));
    if (!st->films || !st->walkers)
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
};
