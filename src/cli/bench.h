/* SPDX-License-Identifier: MIT
 *
 * bench.h - rows of times, which `pellucid bench` and the benches of the papers (bench/) share. */
#ifndef PELL_CLI_BENCH_H
#define PELL_CLI_BENCH_H

#include "cli/cli.h"

#define MAX_STAGES 48

struct row {
    char name[96];
    double ms, bandwidth_ms, ratio; /* ratio: to what `against` names; 0: no ratio */
    const char *against;            /* the denominator of `ratio` */
    int64_t pixels, rays, bytes;
    double frame_ms; /* all stages of the frame, including those that all methods share; 0: not measured */
    double error;    /* error of the result; NAN: not measured */
    int64_t items;   /* radii or samples computed in `ms`; 0: none */
    double work;     /* processor seconds times relative variance; NAN: not measured */
};

struct rows {
    struct row items[MAX_STAGES + 16];
    size_t count;
};

/* Columns of the table. */
enum { BENCH_PIXELS = 1, BENCH_RAYS = 2, BENCH_COPY = 4, BENCH_ERROR = 8, BENCH_WORK = 16, BENCH_FRAME = 32 };
/* Prints the table. `items`: what rows count besides pixels ("samples/s"), or NULL. */
void bench_print(const struct rows *rows, unsigned columns, const char *items);
/* Prints the rows: as a table below a few lines with the machine, the build and `setup`, or as JSON with the members of the object `facts`
 * (NULL: none; the reference is taken). */
enum exit_code bench_answer(struct cli *cli, const char *what, json_t *facts, const struct rows *rows, unsigned columns, const char *items,
                            const char *setup);

/* Renders a frame; PELL_ERR_CANCELLED if Ctrl-C ended it early, as that is no measurement. */
enum pell_result bench_frame(struct pell_renderer *renderer, const struct pell_settings *settings, struct pell_render_result *image);
/* Sorts the values and returns their median. */
double bench_median(double *values, int count);
/* Adds a row; NULL if the table is full. */
struct row *bench_add(struct rows *rows, const char *name, double ms);
/* Adds a row with the work of a stage, and its ratio to a copy of the same bytes. */
struct row *bench_add_stage(struct rows *rows, const char *name, double ms, const struct pell_stage_time *stage);
json_t *bench_json(const struct rows *rows);

#endif
