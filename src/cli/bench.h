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

/* A frame; one that Ctrl-C ended early is no measurement: PELL_ERR_CANCELLED. */
enum pell_result bench_frame(struct pell_renderer *renderer, const struct pell_settings *settings, struct pell_picture *picture);
/* Sorts the values. */
double bench_median(double *values, int count);
/* NULL where there is no more room. */
struct row *bench_add(struct rows *rows, const char *name, double ms);
json_t *bench_json(const struct rows *rows);

/* bench_profiles.c */
enum exit_code bench_profiles(struct cli *cli);
/* bench_truth.c, of the scene at `path` */
enum exit_code bench_truth(struct cli *cli, const char *path);
/* bench_mertens.c */
enum exit_code bench_mertens(struct cli *cli, const char *path);
/* bench_munoz.c: `what` is munoz-2, munoz-3 or munoz-5 */
enum exit_code bench_munoz(struct cli *cli, const char *what, const char *path);
/* bench_deon.c */
enum exit_code bench_deon(struct cli *cli, const char *path);
/* bench_francois.c */
enum exit_code bench_francois(struct cli *cli, const char *path);

#endif
