/* SPDX-License-Identifier: MIT
 *
 * bench.h - rows of times, which `pellucid bench` and the benches of the papers (bench/) share. */
#ifndef PELL_CLI_BENCH_H
#define PELL_CLI_BENCH_H

#include "cli/cli.h"

#define MAX_STAGES 48

struct row {
    char name[96];
    double ms, bandwidth_ms, ratio; /* ratio: what the row says it is, 0 where it has none */
    const char *against;            /* what `ratio` is a ratio to */
    int64_t pixels, rays, bytes;
    double frame_ms; /* of all stages, those that all methods share included; 0: not measured */
    double error;    /* of the result, where it is measured; else NAN */
    int64_t items;   /* radii or samples that `ms` is for; 0: none */
    double work;     /* seconds of processor time times relative variance, where it is measured; else NAN */
};

struct rows {
    struct row items[MAX_STAGES + 16];
    size_t count;
};

/* Columns of the table. */
enum { BENCH_PIXELS = 1, BENCH_RAYS = 2, BENCH_COPY = 4, BENCH_ERROR = 8, BENCH_WORK = 16, BENCH_FRAME = 32 };
/* Prints the table. `items`: what rows count beside pixels ("samples/s"), or NULL. */
void bench_print(const struct rows *rows, unsigned columns, const char *items);
/* The rows as a table below a few lines with the machine, the build and `setup`; or as JSON with the members of the object `facts` (NULL:
 * none; the reference is taken). */
enum exit_code bench_answer(struct cli *cli, const char *what, json_t *facts, const struct rows *rows, unsigned columns, const char *items,
                            const char *setup);

/* A frame; one that Ctrl-C ended early is no measurement: PELL_ERR_CANCELLED. */
enum pell_result bench_frame(struct pell_renderer *renderer, const struct pell_settings *settings, struct pell_render_result *image);
/* Sorts the values. */
double bench_median(double *values, int count);
/* NULL where there is no more room. */
struct row *bench_add(struct rows *rows, const char *name, double ms);
/* With the work of a stage, and its ratio to a copy of the same bytes. */
struct row *bench_add_stage(struct rows *rows, const char *name, double ms, const struct pell_stage_time *stage);
json_t *bench_json(const struct rows *rows);

#endif
