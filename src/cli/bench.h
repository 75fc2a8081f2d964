/* SPDX-License-Identifier: MIT
 *
 * bench.h - rows of times, which the benches share. */
#ifndef PELL_CLI_BENCH_H
#define PELL_CLI_BENCH_H

#include "cli/cli.h"

#define MAX_STAGES 48

struct row {
    char name[96];
    double ms, copy_ms, ratio; /* ratio: what the row says it is, 0 where it has none */
    const char *against;       /* what `ratio` is a ratio to */
    int64_t pixels, rays, bytes;
    double error;  /* of the result, where it is measured; else NAN */
    int64_t items; /* radii or samples that `ms` is for; 0: none */
    double work;   /* seconds of processor time times relative variance, where it is measured; else NAN */
};

struct rows {
    struct row items[MAX_STAGES + 16];
    size_t count;
};

/* A bench that renders: its scene, its rows, and the picture that errors are against. */
struct bench {
    struct cli *cli;
    struct session s;
    struct rows rows;
    int repeats;
    float *truth; /* R, G, B, A, one plane after the other; NULL: none yet */
    int truth_width, truth_height;
};

/* Opens the scene at `path`, one sample a pixel; stages are timed beside copies. bench_close in any case. */
enum exit_code bench_open(struct bench *b, struct cli *cli, const char *path);
void bench_close(struct bench *b);
/* A method with its knobs, all others at their defaults. */
enum pell_result bench_choose(struct bench *b, const char *method, const struct pell_setting *settings, size_t count);
/* Makes light of every material go `factor` times as far. */
enum pell_result bench_stretch(struct bench *b, double factor);
/* Stages that all methods share, whatever they do. */
bool bench_is_common(const char *stage);
/* Keeps the picture as the one that errors are against. */
enum pell_result bench_keep_truth(struct bench *b, const struct pell_picture *picture);
/* Root mean square difference from it over its mean, R, G, B, of its pixels that are wholly covered; NAN where the sizes differ. */
double bench_error(const struct bench *b, const struct pell_picture *picture);

/* Columns of the table. */
enum { BENCH_PIXELS = 1, BENCH_RAYS = 2, BENCH_COPY = 4, BENCH_ERROR = 8 };
/* `items`: what rows count beside pixels ("samples/s"), or NULL. */
void bench_print(const struct rows *rows, unsigned columns, const char *items);
/* The rows as a table, or as JSON; the message says what was measured. */
enum exit_code bench_answer(const struct bench *b, const char *what, unsigned columns, const char *items, const char *fmt, ...)
    PELL_PRINTF(5, 6);

/* A frame; one that Ctrl-C ended early is no measurement: PELL_ERR_CANCELLED. */
enum pell_result bench_frame(struct pell_renderer *renderer, const struct pell_settings *settings, struct pell_picture *picture);
/* Sorts the values. */
double bench_median(double *values, int count);
/* NULL where there is no more room. */
struct row *bench_add(struct rows *rows, const char *name, double ms);
/* With the work of a stage, and its ratio to a copy of the same bytes. */
struct row *bench_add_stage(struct rows *rows, const char *name, double ms, const struct pell_stage_time *stage);
json_t *bench_json(const struct rows *rows);

/* Each in its file bench_NAME.c; `what` is the bench's name, `path` its scene. */
enum exit_code bench_profiles(struct cli *cli);
enum exit_code bench_truth(struct cli *cli, const char *what, const char *path);
enum exit_code bench_mertens(struct cli *cli, const char *what, const char *path);
enum exit_code bench_munoz(struct cli *cli, const char *what, const char *path);
enum exit_code bench_deon(struct cli *cli, const char *what, const char *path);
enum exit_code bench_francois(struct cli *cli, const char *what, const char *path);

#endif
