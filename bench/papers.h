/* SPDX-License-Identifier: MIT
 * papers.h - shared by the benches of the papers: a scene, a selected method that is timed, errors against a kept image.
 *
 * A bench is a row of the table in main.c; its function adds rows to `rows` and describes them in `setup`. */
#ifndef PELL_BENCH_PAPERS_H
#define PELL_BENCH_PAPERS_H

#include "cli/bench.h"

struct bench {
    struct cli *cli;
    const char *path; /* of the scene, as it was opened */
    struct session s;
    struct rows rows;
    int repeats;
    float *truth; /* R, G, B, A, one plane after the other; NULL: none yet */
    int truth_width, truth_height;
    char setup[320]; /* what was measured, for readers */
};

/* --- papers.c ------------------------------------------------------------------------------------------------------------------- */

/* Closes the open scene and opens it again, one sample per pixel; stages are timed next to copies. `material` NULL: the scene's own. */
enum exit_code bench_open(struct bench *b, const char *material);
void bench_close(struct bench *b);
/* Opens the scene NAME`suffix`.json in the folder of the bench's own, which is closed, and runs that. */
enum pell_result bench_run_sibling(struct bench *b, const char *suffix, enum pell_result (*run)(struct bench *b));
/* A method with its knobs as "name=value name=value", all others at their defaults. */
enum pell_result bench_choose(struct bench *b, const char *method, const char *knobs);
/* Multiplies the mean free paths of every material by `factor`. */
enum pell_result bench_stretch(struct bench *b, double factor);
/* Stages that all methods have in common. */
bool bench_is_common(const char *stage);
/* The time of a stage; 0: the image has none of this name. */
double bench_stage_ms(const struct pell_render_result *image, const char *stage);
/* The sum of the stages that are not common, ms. */
double bench_own_ms(const struct pell_render_result *image);

/* What is timed: a method, knobs as for bench_choose; whether its stages get rows of their own; whether the camera moves from frame to
 * frame, so that nothing is kept and there is no error. */
struct bench_run {
    const char *method, *knobs;
    bool stages, moving;
};

struct bench_result {
    double once_ms;          /* "prepare" of the first frame */
    int64_t visible, pixels; /* of the surface stage; the maximum over the method's own stages */
    struct row *row;         /* the sum of the method's own stages, medians over warm frames, and its error; NULL: no room */
};

/* One cold frame and `repeats` warm ones; adds the row `name`, after those of the stages. `result` may be NULL. */
enum pell_result bench_measure(struct bench *b, const char *name, const struct bench_run *run, struct bench_result *result);

/* Renders with the method and keeps the image as the reference for errors. */
enum pell_result bench_keep_truth(struct bench *b, const char *method, const char *knobs);

/* --- One file each -------------------------------------------------------------------------------------------------------------- */

enum pell_result bench_profiles(struct bench *b);
enum pell_result bench_truth(struct bench *b);
enum pell_result bench_indirect(struct bench *b);
enum pell_result bench_mertens(struct bench *b);
enum pell_result bench_munoz_2(struct bench *b);
enum pell_result bench_munoz_3(struct bench *b);
enum pell_result bench_munoz_5(struct bench *b);
enum pell_result bench_deon(struct bench *b);
enum pell_result bench_francois(struct bench *b);
enum pell_result bench_jimenez(struct bench *b);

#endif
