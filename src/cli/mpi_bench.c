/* SPDX-License-Identifier: MIT
 *
 * mpi_bench.c - `pellucid-mpi bench`: the costs of a shared run, measured with the ranks present, and the time predicted for more ranks.
 */
#include "cli/mpi_bench.h"

#include "cli/bench.h"
#include "methods/path_trace/path_trace.h"
#include "render/communicator.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { TAKES = 2000, TILE_PIXELS = PT_TILE * PT_TILE, SEND = 64 << 20, MOST_RANKS = 10000 };

/* Costs in seconds. */
struct costs {
    double load;      /* reading the scene and creating the renderer */
    double take;      /* taking a work item from the counter */
    double broadcast; /* broadcasting a byte, per step of a binary tree */
    double reduce;    /* reducing a byte of a film, per step of a binary tree */
    double film;      /* size of a film of the image, bytes */
    double work;      /* one thread tracing one sample of all pixels */
    double samples;   /* samples per pixel */
    double films;     /* films of the multisample antialiasing */
    double threads;   /* threads per rank */
};

static double steps(double ranks)
{
    return ranks > 1.0 ? ceil(log2(ranks)) : 0.0;
}

/* Predicted time of a run after the launcher has started it: loading, samples shared by all threads, the tail of the last blocks (1/8 s of
 * each film at most), one reduction per film. */
static double run_seconds(const struct costs *c, double ranks)
{
    const double samples = c->work * c->samples / (ranks * c->threads), tail = fmin(0.125 * c->films, 0.5 * samples);

    return c->load + samples + (ranks > 1.0 ? tail : 0.0) + c->films * steps(ranks) * c->film * c->reduce;
}

static enum pell_result measure_reduce(struct cli *cli, struct costs *c)
{
    struct pell_communicator *comm = cli->program->communicator;
    const size_t tiles = (size_t) (c->film / sizeof(struct pt_pixel)) / TILE_PIXELS;
    uint8_t *pixels = pell_alloc(cli->ctx, tiles);
    struct pt_film film = { 0 }, total = { 0 };
    double best = (double) INFINITY;
    enum pell_result res = PELL_ERR_NOMEM;

    if (!pixels)
        return res;
    memset(pixels, TILE_PIXELS, tiles);
    PELL_TRY(pt_film_create(cli->ctx, pixels, tiles, &film));
    if (comm->rank == 0)
        PELL_TRY(pt_film_create(cli->ctx, pixels, tiles, &total));
    for (size_t i = 0; i < film.count; i++)
        film.pixels[i].count = 1;
    for (int i = 0; i < 3; i++) {
        double start;
        comm->any(comm->user, false);
        start = pell_seconds();
        PELL_TRY(pt_ranks_reduce(cli->ctx, comm, &film, &total));
        comm->any(comm->user, false);
        best = fmin(best, pell_seconds() - start);
    }
    c->film = (double) film.count * sizeof(struct pt_pixel);
    c->reduce = comm->ranks > 1 ? best / (c->film * steps(comm->ranks)) : best / c->film;
    if (comm->rank == 0 && total.pixels[0].count != (uint32_t) comm->ranks)
        res = pell_error(cli->ctx, PELL_ERR_DEVICE, "bench", NULL, "the films were not added: %u of %d ranks", total.pixels[0].count,
                         comm->ranks);

fail:
    pt_film_free(cli->ctx, &film);
    pt_film_free(cli->ctx, &total);
    pell_free(cli->ctx, pixels);
    return res;
}

static enum pell_result measure_messages(struct cli *cli, struct costs *c)
{
    struct pell_communicator *comm = cli->program->communicator;
    char *data = pell_zalloc(cli->ctx, SEND);
    double start;

    if (!data)
        return PELL_ERR_NOMEM;
    comm->begin(comm->user);
    start = pell_seconds();
    for (int i = 0; i < TAKES; i++)
        comm->take(comm->user, 1);
    c->take = (pell_seconds() - start) / TAKES;
    comm->broadcast(comm->user, data, SEND);
    comm->any(comm->user, false);
    start = pell_seconds();
    comm->broadcast(comm->user, data, SEND);
    comm->any(comm->user, false);
    c->broadcast = (pell_seconds() - start) / SEND / fmax(steps(comm->ranks), 1.0);
    pell_free(cli->ctx, data);
    return PELL_OK;
}

static enum pell_result measure_render(struct cli *cli, struct session *s, struct costs *c, struct rows *rows)
{
    struct pell_communicator *comm = cli->program->communicator;
    struct pell_render_result image;
    struct row *row;
    enum pell_result res;

    pell_renderer_set_communicator(s->renderer, comm);
    res = pell_renderer_render(s->renderer, &s->settings, &image);
    cli_progress_end(cli);
    if (res != PELL_OK)
        return res;
    for (size_t i = 0; i < image.num_stages; i++)
        if (strcmp(image.stages[i].name, "path-trace") == 0) {
            const struct pell_stage_time *t = &image.stages[i];
            c->films = s->settings.msaa;
            c->threads = pell_device_threads(s->device);
            c->work = 1e-3 * t->ms * comm->ranks * c->threads / c->samples;
            row = bench_add(rows, "path-trace, all ranks", t->ms);
            if (row)
                row->pixels = t->pixels;
        }
    return PELL_OK;
}

static void print_model(const struct costs *c, json_t *facts)
{
    json_t *model = json_array();
    const double one = run_seconds(c, 1.0);

    for (double ranks = 1.0; ranks <= MOST_RANKS; ranks = ranks == 8192.0 ? MOST_RANKS : ranks * 2.0) {
        const double seconds = run_seconds(c, ranks);
        json_array_append_new(model, json_pack("{s:i,s:f,s:f,s:f,s:f}", "ranks", (int) ranks, "seconds", seconds, "efficiency",
                                               one / (ranks * seconds), "reduce_seconds", c->films * steps(ranks) * c->film * c->reduce,
                                               "rank_bytes", c->film * (c->films + (ranks > 1.0))));
        if (ranks >= MOST_RANKS)
            break;
    }
    json_object_set_new(facts, "model", model);
}

enum exit_code command_mpi_bench(struct cli *cli)
{
    struct pell_communicator *comm = cli->program->communicator;
    struct costs c = { .samples = 8.0, .film = 1.0 };
    struct rows rows = { .count = 0 };
    struct session s;
    json_t *facts = json_object(), *row;
    char setup[256];
    size_t i;
    enum exit_code code = session_open(cli, cli->arguments[0], &s);

    if (code == EXIT_OK && (!s.method || !s.method->partial))
        code = cli_usage(cli, "--method", "-m path-trace", "only path-trace is shared by ranks");
    if (code == EXIT_OK) {
        const struct pell_knob *knob = pell_knob_find(s.method->knobs, "samples");
        int *samples = (int *) ((char *) s.knobs + knob->offset);
        *samples = *samples > 0 ? *samples : 8;
        c.samples = *samples;
        c.film = (double) s.settings.width * s.settings.height * sizeof(struct pt_pixel);
        c.load = s.load_seconds;
        code = cli_failed(cli, pell_renderer_set_method(s.renderer, s.method, s.knobs));
    }
    if (code == EXIT_OK)
        code = cli_failed(cli, measure_messages(cli, &c));
    if (code == EXIT_OK)
        code = cli_failed(cli, measure_render(cli, &s, &c, &rows));
    if (code == EXIT_OK)
        code = cli_failed(cli, measure_reduce(cli, &c));
    if (code == EXIT_OK && comm->rank == 0) {
        bench_add(&rows, "scene, each rank", 1e3 * c.load);
        bench_add(&rows, "block from the counter", 1e3 * c.take);
        bench_add(&rows, "64 MiB to all ranks", 1e3 * c.broadcast * SEND * fmax(steps(comm->ranks), 1.0));
        bench_add(&rows, "film of the whole image, added", 1e3 * c.reduce * c.film * fmax(steps(comm->ranks), 1.0));
        print_model(&c, facts);
        json_object_set_new(facts, "ranks", json_integer(comm->ranks));
        json_object_set_new(facts, "film_bytes", json_real(c.film));
        snprintf(setup, sizeof(setup), "%d ranks of %d threads, %d x %d, %g samples; film %.0f MB", comm->ranks, (int) c.threads,
                 s.settings.width, s.settings.height, c.samples, 1e-6 * c.film);
        row = json_incref(json_object_get(facts, "model"));
        code = bench_answer(cli, "mpi", cli->json ? facts : NULL, &rows, BENCH_PIXELS, NULL, setup);
        if (!cli->json) {
            json_t *m;
            printf("\n%-8s %12s %12s %12s %14s\n", "ranks", "seconds", "efficiency", "reduce s", "bytes a rank");
            json_array_foreach(row, i, m)
                printf("%-8d %12.3f %12.3f %12.3f %14.0f\n", (int) json_integer_value(json_object_get(m, "ranks")),
                       json_real_value(json_object_get(m, "seconds")), json_real_value(json_object_get(m, "efficiency")),
                       json_real_value(json_object_get(m, "reduce_seconds")), json_real_value(json_object_get(m, "rank_bytes")));
            json_decref(facts);
        }
        json_decref(row);
        facts = NULL;
    }
    comm->finished = comm->finished && code == EXIT_OK;
    json_decref(facts);
    session_close(&s);
    return code;
}
