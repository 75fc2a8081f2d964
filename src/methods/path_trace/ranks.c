/* SPDX-License-Identifier: MIT
 *
 * ranks.c - a run of several ranks. The tasks of rounds have indices, which ranks take until none is left, so fast ranks do more.
 * Each rank adds to its own film and writes it to its own checkpoint: rank 0 to the given file, the others next to it. At the end the films
 * are summed along a binary tree, in pieces. Sums are exact, so neither the distribution of work nor the tree affects the image.
 *
 * A run begins with all existing files, of any number of ranks: rank 0 sums them, writes the sum, removes the others, and broadcasts
 * which samples are present. A file whose samples are all in the sum was left by a run killed between these two steps.
 */
#include "methods/path_trace/run.h"

#include "base/file.h"

#include <dirent.h>
#include <errno.h>
#include <stdio.h>
#include <unistd.h>

enum { PIECE = 16384 }; /* pixels */

/* --- Files of the previous run ------------------------------------------------------------------------------------------------------- */

/* Calls `each` for the rank files next to a checkpoint. */
static enum pell_result visit_files(struct pt_state *st, const char *path,
                                    enum pell_result (*each)(struct pt_state *st, const char *path, void *user), void *user)
{
    const char *name = pell_path_name(path);
    char folder[4096], file[4096 + 300];
    const int length = snprintf(folder, sizeof(folder), "%.*s", (int) (name - path), path);
    enum pell_result res = PELL_OK;
    struct dirent *entry;
    DIR *dir;

    if (length < 0 || length >= (int) sizeof(folder))
        return pell_error(st->ctx, PELL_ERR_IO, path, NULL, "a name of %d bytes is too long", length);
    dir = opendir(length ? folder : ".");
    if (!dir)
        return pell_error(st->ctx, PELL_ERR_IO, path, NULL, "its folder can't be read");
    while (res == PELL_OK && (entry = readdir(dir))) {
        const size_t n = strlen(name), more = strlen(PT_RANK_SUFFIX);
        if (strncmp(entry->d_name, name, n) != 0 || strncmp(entry->d_name + n, PT_RANK_SUFFIX, more) != 0 || !entry->d_name[n + more] ||
            strspn(entry->d_name + n + more, "0123456789") != strlen(entry->d_name + n + more))
            continue;
        snprintf(file, sizeof(file), "%s%s", folder, entry->d_name);
        res = each(st, file, user);
    }
    closedir(dir);
    return res;
}

static enum pell_result add_file(struct pt_state *st, const char *path, void *user)
{
    const struct pt_checkpoint_key *key = user;
    struct pt_film *films = pell_calloc(st->ctx, st->num_films, sizeof(*films));
    enum pell_result res;

    if (!films)
        return PELL_ERR_NOMEM;
    PELL_TRY(pt_read_file(st, key, path, films));
    for (size_t f = 0; f < st->num_films; f++)
        if (!(st->films[f].identity != 0 && st->films[f].identity == films[f].identity && pt_film_holds(&st->films[f], &films[f])))
            PELL_TRY(pt_merge_film(st, path, &st->films[f], &films[f]));

fail:
    for (size_t f = 0; f < st->num_films; f++)
        pt_film_free(st->ctx, &films[f]);
    pell_free(st->ctx, films);
    return res;
}

static enum pell_result remove_file(struct pt_state *st, const char *path, void *user)
{
    ++*(int *) user;
    return unlink(path) == 0 || errno == ENOENT ? PELL_OK : pell_error(st->ctx, PELL_ERR_IO, path, NULL, "can't be removed");
}

static enum pell_result gather_files(struct pt_state *st, const struct pell_frame *in)
{
    struct pt_checkpoint_key key = pt_make_key(st, in);
    const char *path = st->services->checkpoint->path;
    int removed = 0;
    enum pell_result res = PELL_OK;

    if (access(path, F_OK) == 0)
        PELL_TRY(pt_read_file(st, &key, path, st->films));
    PELL_TRY(visit_files(st, path, add_file, &key));
    for (size_t f = 0; f < st->num_films; f++)
        if (st->films[f].identity != 0) { /* the sum is safely stored before the parts are removed */
            PELL_TRY(pt_write_films(st, in, true));
            if (st->unwritten) {
                res = pell_error(st->ctx, PELL_ERR_IO, path, "make room, and run it again",
                                 "the samples of earlier ranks can't be added up: their files are kept");
                goto fail;
            }
            PELL_TRY(visit_files(st, path, remove_file, &removed));
            break;
        }
    if (removed > 0)
        pell_info(st->ctx, path, "samples of %d further ranks were included", removed);
    return PELL_OK;

fail:
    return res;
}

/* The samples present in a film, which all ranks skip. */
static enum pell_result broadcast_spans(struct pt_state *st, struct pt_film *film, struct pt_film *done)
{
    const struct pell_communicator *comm = pt_communicator(st);
    uint64_t head[3] = { film->identity, film->tiles, film->span_capacity };

    comm->broadcast(comm->user, head, sizeof(head));
    if (head[0] == 0)
        return PELL_OK;
    done->identity = head[0];
    done->tiles = (size_t) head[1];
    done->span_capacity = (uint32_t) head[2];
    done->num_spans = pell_calloc(st->ctx, done->tiles, sizeof(*done->num_spans));
    done->spans = pell_calloc(st->ctx, done->tiles * done->span_capacity, sizeof(*done->spans));
    if (!done->num_spans || !done->spans)
        return PELL_ERR_NOMEM;
    if (comm->rank == 0) {
        memcpy(done->num_spans, film->num_spans, done->tiles * sizeof(*done->num_spans));
        memcpy(done->spans, film->spans, done->tiles * done->span_capacity * sizeof(*done->spans));
    }
    comm->broadcast(comm->user, done->num_spans, done->tiles * sizeof(*done->num_spans));
    comm->broadcast(comm->user, done->spans, done->tiles * done->span_capacity * sizeof(*done->spans));
    return PELL_OK;
}

enum pell_result pt_ranks_start(struct pt_state *st, const struct pell_frame *in)
{
    enum pell_result res;

    pt_drop_films(st);
    for (size_t f = 0; f < st->num_films; f++)
        pt_film_free(st->ctx, &st->done[f]);
    if (!st->services->checkpoint)
        return PELL_OK;
    if (pt_communicator(st)->rank == 0)
        PELL_TRY(gather_files(st, in));
    for (size_t f = 0; f < st->num_films; f++)
        PELL_TRY(broadcast_spans(st, &st->films[f], &st->done[f]));
    return PELL_OK;

fail:
    return res;
}

enum pell_result pt_ranks_finish(struct pt_state *st, const struct pell_frame *in)
{
    struct pell_communicator *comm = pt_communicator(st);
    const bool interrupted = pell_context_interrupted(st->ctx);
    int removed = 0;
    enum pell_result res = PELL_OK;

    comm->finished = true;
    if (!st->services->checkpoint)
        return PELL_OK;
    if (comm->rank == 0 || interrupted)
        PELL_TRY(pt_write_films(st, in, true));
    if (comm->rank == 0 && !interrupted && !st->unwritten)
        PELL_TRY(visit_files(st, st->services->checkpoint->path, remove_file, &removed));
    return PELL_OK;

fail:
    return res;
}

/* --- Films of all ranks ------------------------------------------------------------------------------------------------------------- */

static bool is_black(const struct pt_pixel *pixels, size_t count)
{
    for (size_t i = 0; i < count; i++)
        if (pixels[i].count > 0)
            return false;
    return true;
}

enum pell_result pt_ranks_reduce(struct pell_context *ctx, const struct pell_communicator *comm, const struct pt_film *film,
                                 struct pt_film *total)
{
    struct pt_pixel *pieces = pell_alloc_array(ctx, 2 * PIECE, sizeof(*pieces)), *other = pieces + PIECE;

    if (!pieces)
        return PELL_ERR_NOMEM;
    for (size_t first = 0; first < film->count; first += PIECE) {
        const size_t count = film->count - first < PIECE ? film->count - first : PIECE;
        struct pt_pixel *sum = comm->rank == 0 ? total->pixels + first : pieces;

        memcpy(sum, film->pixels + first, count * sizeof(*sum));
        for (int step = 1; step < comm->ranks; step *= 2) {
            if (comm->rank & step) {
                comm->send(comm->user, comm->rank - step, sum, is_black(sum, count) ? 0 : count * sizeof(*sum));
                break;
            }
            if (comm->rank + step >= comm->ranks)
                continue;
            if (comm->receive(comm->user, comm->rank + step, other, count * sizeof(*other)) == count * sizeof(*other))
                for (size_t i = 0; i < count; i++)
                    pt_pixel_merge(&sum[i], &other[i]);
        }
    }
    pell_free(ctx, pieces);
    return PELL_OK;
}

static enum pell_result make_total(struct pt_run *run)
{
    struct pt_state *st = run->st;
    const struct pt_film *film = run->film;
    struct pt_film *total = &st->total;

    if (pt_communicator(st)->rank != 0)
        return PELL_OK;
    if (total->capacity < film->count) {
        pell_free(st->ctx, total->pixels);
        total->capacity = 0;
        total->pixels = pell_alloc_array(st->ctx, film->count, sizeof(*total->pixels));
        if (!total->pixels)
            return PELL_ERR_NOMEM;
        total->capacity = film->count;
    }
    total->count = film->count;
    total->exponent = film->exponent;
    return PELL_OK;
}

/* --- Rounds ------------------------------------------------------------------------------------------------------------------------- */

/* Consecutive rounds with `tasks` tasks each. */
struct rounds {
    uint32_t from, step, end; /* samples: round i ends at from + (i + 1) step, or at the end */
    size_t tasks;
    int64_t count; /* number of rounds */
};

static enum pell_result do_items(struct pt_run *run, const struct rounds *r, int64_t first, int64_t end)
{
    struct pt_state *st = run->st;

    while (first < end) {
        const int64_t round = first / (int64_t) r->tasks, task = first % (int64_t) r->tasks;
        const int64_t left = (int64_t) r->tasks - task, count = end - first < left ? end - first : left;
        const enum pell_result res = pt_film_reserve(st->ctx, run->film, 1 + (run->done ? run->done->span_capacity : 0));

        if (res != PELL_OK)
            return res;
        run->low = r->from + (uint32_t) round * r->step;
        run->target = r->end - run->low > r->step ? run->low + r->step : r->end;
        run->first = (size_t) task;
        pell_pool_run(st->services->pool, (int) count, pt_do_task, run);
        if (pell_cancelled(st->ctx))
            return PELL_ERR_CANCELLED;
        if (pell_context_interrupted(st->ctx))
            return PELL_OK;
        first += count;
    }
    return PELL_OK;
}

/* Takes items until none is left, in smaller portions towards the end. */
static enum pell_result do_rounds(struct pt_run *run, const struct pt_goal *goal, const struct rounds *r)
{
    struct pt_state *st = run->st;
    const struct pell_communicator *comm = pt_communicator(st);
    const struct pell_checkpoint *checkpoint = st->services->checkpoint;
    const int64_t items = r->count * (int64_t) r->tasks;
    int64_t batch = st->threads, first = 0;
    enum pell_result res;

    comm->begin(comm->user);
    while (items > 0) {
        const int64_t fair = (items - first) / (4 * comm->ranks), most = fair > st->threads ? fair : st->threads;
        const int64_t count = batch < most ? batch : most;
        const double start = pell_seconds();
        double now;

        first = comm->take(comm->user, count);
        if (first >= items)
            break;
        PELL_TRY(do_items(run, r, first, first + count < items ? first + count : items));
        if (pell_context_interrupted(st->ctx)) {
            comm->stop(comm->user);
            break;
        }
        now = pell_seconds();
        if (now - start < 0.5 * PT_BATCH_SECONDS && batch < 1 << 24)
            batch *= 2;
        else if (now - start > 2.0 * PT_BATCH_SECONDS && batch > st->threads)
            batch /= 2;
        pt_show(run, pt_progress_of(goal, r->from + (double) (r->end - r->from) * (double) first / (double) items));
        if (checkpoint && now - st->written > checkpoint->every)
            PELL_TRY(pt_write_films(st, run->in, false));
    }
    if (comm->any(comm->user, pell_context_interrupted(st->ctx)))
        pell_context_interrupt(st->ctx);
    return PELL_OK;

fail:
    return res;
}

/* Decision of rank 0 before rounds. */
struct decision {
    uint32_t end; /* end of the next round's samples; unchanged: done */
    uint32_t unfinished;
};

static struct decision decide(const struct pt_run *run, struct pt_goal *g, const struct pt_film *film, uint32_t least, bool equal)
{
    const struct pt_state *st = run->st;
    uint32_t step = least < PT_ROUND_SAMPLES ? 1 : PT_ROUND_SAMPLES - least % PT_ROUND_SAMPLES;
    const struct decision done = { least, 0 };

    if (least >= g->most)
        return done;
    if (!(g->error > 0.0) && !isfinite(g->deadline))
        return (struct decision) { g->most, 0 };
    if (g->error > 0.0 && equal && least >= g->least && least % PT_ROUND_SAMPLES == 0) {
        const double error = pt_film_error(film, pt_traced(st));
        if (error <= g->error)
            return done;
        g->needed = fmax(least + 1.0, least * (error / g->error) * (error / g->error));
    }
    step = step < g->most - least ? step : g->most - least;
    if (isfinite(g->deadline) && least > run->from) {
        const double now = pell_seconds(), each = least > g->first ? (now - g->begin) / (least - g->first) : 0.0;
        while (step > 1 && now + step * each > g->deadline)
            step--;
        if (now + step * each > g->deadline)
            return (struct decision) { least, st->knobs.samples > 0 || g->error > 0.0 };
    }
    return (struct decision) { least + step, 0 };
}

/* Copies the sum over all ranks to the film of rank 0, which then has all samples before `end`. */
static void copy_total(struct pt_run *run, uint32_t end)
{
    struct pt_film *film = run->film;

    memcpy(film->pixels, run->st->total.pixels, film->count * sizeof(*film->pixels));
    for (size_t t = run->first_tile; t < run->end_tile; t++) {
        uint32_t next, from;
        while (film->starts[t] < film->starts[t + 1] && (from = pt_film_missing(film, t, run->from, &next)) < end)
            pt_film_cover(film, t, (struct pt_span) { from, next < end ? next : end });
    }
}

enum pell_result pt_ranks_run(struct pt_run *run, struct pt_goal *g)
{
    struct pt_state *st = run->st;
    const struct pell_communicator *comm = pt_communicator(st);
    const struct pt_film *known = run->film;
    const size_t pixels = run->film->starts[run->end_tile] - run->film->starts[run->first_tile];
    struct rounds rounds = { 0 };
    uint64_t threads = (uint64_t) st->threads * (uint64_t) comm->ranks, each;
    uint32_t least, most;
    bool equal, reduced = false;
    enum pell_result res;

    comm->broadcast(comm->user, &threads, sizeof(threads)); /* of rank 0: tasks must be the same on all ranks */
    each = pixels / (threads * 16);
    PELL_TRY(make_total(run));
    PELL_TRY(pt_list_tasks(run, each > PT_TASK_PIXELS ? PT_TASK_PIXELS : (size_t) each + 1, &rounds.tasks));
    pt_count_range(run, run->done ? run->done : run->film, &least, &most);
    g->first = least;
    equal = least == most;
    while (pixels > 0) {
        struct decision next = comm->rank == 0 ? decide(run, g, known, least, equal) : (struct decision) { 0, 0 };

        comm->broadcast(comm->user, &next, sizeof(next));
        st->unfinished = st->unfinished || next.unfinished;
        if (next.end <= least)
            break;
        rounds.from = least;
        rounds.end = next.end;
        rounds.step = ((next.end - least) / 16 + PT_ROUND_SAMPLES - 1) / PT_ROUND_SAMPLES * PT_ROUND_SAMPLES;
        rounds.step = rounds.step < PT_ROUND_SAMPLES ? PT_ROUND_SAMPLES : rounds.step;
        rounds.count = (next.end - least + rounds.step - 1) / rounds.step;
        PELL_TRY(do_rounds(run, g, &rounds));
        reduced = false;
        if (pell_context_interrupted(st->ctx))
            break;
        least = next.end;
        equal = equal || least >= most;
        if (g->error > 0.0 && least >= g->least && least % PT_ROUND_SAMPLES == 0) {
            PELL_TRY(pt_ranks_reduce(st->ctx, comm, run->film, &st->total));
            known = &st->total;
            reduced = true;
        }
    }
    if (!reduced)
        PELL_TRY(pt_ranks_reduce(st->ctx, comm, run->film, &st->total));
    if (comm->rank == 0 && !pell_context_interrupted(st->ctx) && pixels > 0) {
        PELL_TRY(pt_film_reserve(st->ctx, run->film, 1));
        copy_total(run, least);
    } else if (comm->rank == 0) {
        run->shown = &st->total;
    }
    pt_show(run, 1.0);
    return PELL_OK;

fail:
    return res;
}
