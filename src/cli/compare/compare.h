/* SPDX-License-Identifier: MIT
 *
 * compare.h - what `compare A B` and `compare INPUT` share: the folder that is written, the numbers as JSON, the report.
 *
 * Ownership  the result of a function is released by its *_drop or *_close, which accept half-built objects.
 */
#ifndef PELL_CLI_COMPARE_H
#define PELL_CLI_COMPARE_H

#include "cli/cli.h"
#include "cli/folder.h"

#include "compare/errors.h"

#include <pellucid/compare.h>
#include <pellucid/render.h>

/* --- images.c, scene.c: the two commands ------------------------------------------------------------------------ */

enum exit_code compare_images(struct cli *cli);
enum exit_code compare_scene(struct cli *cli);

/* --- runs.c: what `compare INPUT` renders -------------------------------------------------------------------------------------------- */

#define MAX_RUNS 24
#define MAX_REFERENCES 2

/* One rendering: a method with its knobs. */
struct run {
    const struct pell_method *method; /* NULL: no scattering */
    char label[200];                  /* as given: "screen-space:as=paper" */
    char file[200];                   /* the same, usable as a file name */
    struct settings_list knobs;       /* knobs of the label */
    void *values;
    struct pell_settings settings; /* as=paper changes some */
    bool optional;                 /* selected by "all": left out if the engine does not support it */
    bool mixes;                    /* gives a finished image: its subsurface light can't be separated from surface reflection */
    double seconds, cpu_seconds;
    struct pell_metrics measured; /* metrics of its subsurface light against the last reference that it was compared with */
    json_t *answer, *shown;       /* entries in metrics.json and in the report */
};

struct run_list {
    struct run list[MAX_RUNS]; /* references come first */
    size_t count, num_references;
    struct settings_list set; /* --set */
};

/* Chooses the runs from --reference, --methods and --set; takes the knobs of `cli`. */
enum exit_code runs_choose(struct cli *cli, struct run_list *runs);
/* Leaves out of `all` what the session's engine does not support, and adds the scene file's knobs to the others. */
enum exit_code runs_open(struct cli *cli, struct run_list *runs, const struct session *s);
void runs_finish(struct run_list *runs);

/* --- halves.c: a sampled reference as the mean of two independent images ---------------------------------------------------------- */

struct halves {
    float *planes; /* planes of the first image, then of the mean, without padding */
    struct pell_channel *channels;
    struct pell_stage_time *stages;
    char (*names)[48]; /* names of the stages */
    struct pell_render_result first;
};

/* 2 for a method with the knob `half` if it is 0 (whole image), else 1. */
int halves_of(const struct run *run);
/* Sets the knob `half` in a method's values, if it has one; 0: the whole image. */
void halves_choose(const struct pell_method *method, void *values, int half);
/* Keeps the first image; turns the second into the mean of both, whose planes belong to `h`. */
PELL_NODISCARD enum pell_result halves_add(struct cli *cli, struct pell_render_result *image, struct halves *h);
void halves_drop(struct cli *cli, struct halves *h);

/* --- answer.c: numbers ------------------------------------------------------------------------------------------------------ */

/* Comparison parameters from the command line and a table of knobs; `exposure` 0 if neither sets it. */
PELL_NODISCARD enum pell_result compare_params(struct cli *cli, struct pell_compare_params *params);
/* Compares, warns of pixels that are not finite, and reports an error if none is left. `rows`: see pell_compare_by_rows. */
struct pell_compare_rows;
PELL_NODISCARD enum pell_result compare_run(struct cli *cli, const char *test, const char *reference, const struct pell_compare_input *in,
                                            const struct pell_compare_rows *rows, const struct pell_compare_params *params,
                                            struct pell_comparison *out);
json_t *compare_metrics(const struct pell_metrics *m, bool display);
/* Metrics of a part of the light: "rel_mse", "rel_bias", "rel_mse_error", "rel_bias_error"; null where noise hides them or they are
 * unknown. */
json_t *compare_part(const struct pell_metrics *m);
/* Adds the numbers of `m` to `to`. */
void compare_add_metrics(json_t *to, const struct pell_metrics *m, bool display);
#define COMPARE_LIKELY 0.01 /* p of the Z-test; below it the images differ by more than noise */
/* Why noise hides the "rel_mse" of these metrics, in words; NULL: it is resolved. */
const char *compare_unresolved(const json_t *metrics);
/* Adds how the reference is displayed: "exposure", "white", "hdr_exposures" (null for display images). */
void compare_add_shown(json_t *to, const struct pell_comparison *r, bool display);
PELL_NODISCARD enum pell_result compare_write_maps(struct cli *cli, const struct pell_comparison *r, bool display, struct output_folder *f);
PELL_NODISCARD enum pell_result compare_write_errors(struct cli *cli, const struct pell_comparison *r, struct output_folder *f,
                                                     const char *name);
PELL_NODISCARD enum pell_result compare_write_json(struct cli *cli, const json_t *answer, struct output_folder *f);

/* --- decompose.c: an error in its parts -------------------------------------------------------------------------------------- */

enum { DECOMPOSE_METHOD, DECOMPOSE_INTERREFLECTION, DECOMPOSE_TOTAL, DECOMPOSE_PARTS };

struct decompose_input {
    struct pell_compare_input whole; /* both images with interreflection, planes without padding */
    struct pell_compare_part direct; /* their light without interreflection */
    struct pell_metrics total;       /* metrics of the masked pixels of `whole` */
};

struct decomposition {
    /* relative to the reference with interreflection; mse to rel_bias and their standard errors */
    struct pell_metrics part[DECOMPOSE_PARTS];
    double interreflection[3]; /* fraction of interreflection in the reference */
};

PELL_NODISCARD enum pell_result decompose_error(struct cli *cli, int threads, const struct decompose_input *in, struct decomposition *out);
json_t *decompose_json(const struct decomposition *d);
void decompose_print_head(const struct cli *cli, const char *truth, const double interreflection[3]);
void decompose_print(const char *name, const json_t *parts);

/* --- table.c: printed tables ------------------------------------------------------------------------------------------------- */

void table_head(const struct cli *cli, const char *title, bool times);
void table_row(const char *name, const json_t *metrics, double seconds); /* negative: no time */
/* Header of the rows with standard errors and the Z-test, in the same columns as the metrics above. */
void table_noise_head(const struct cli *cli);
void table_noise_row(const char *name, const json_t *metrics);

/* --- report.c: report.html ---------------------------------------------------------------------------------------------------- */

/* Images larger than this are reduced by a whole factor in the report, which states it; metrics are always of the full size. */
#define REPORT_PIXELS (1 << 20)

struct report;

/* Opens a report. It grows in memory: images are compressed as they are added, so that they need not be kept. */
PELL_NODISCARD enum pell_result report_open(struct pell_context *ctx, int width, int height, struct report **out);
/* Adds three planes of linear light (16-bit floats in the report) or a map of [0, 1] (8 bit). `*id` is a new JSON text by which the
 * report's data refers to them. */
PELL_NODISCARD enum pell_result report_image(struct report *r, const float *const rgb[3], ptrdiff_t stride, json_t **id);
PELL_NODISCARD enum pell_result report_map(struct report *r, const float *map, ptrdiff_t stride, json_t **id);
/* One view of the images with its metrics; `mask` NULL: all pixels. `result`: comparison of the first method. */
json_t *report_view(struct report *r, const char *id, const char *title, const char *text, const struct pell_compare_input *in,
                    const struct pell_compare_params *params, const struct pell_comparison *result);
/* Returns the page as text allocated by malloc, once. The report can then only be closed. */
PELL_NODISCARD enum pell_result report_page(struct report *r, json_t *data, char **page, size_t *size);
/* Writes the page once; `data` is the data that the page's scripts display. The report can then only be closed. */
PELL_NODISCARD enum pell_result report_write(struct report *r, json_t *data, const char *path);
void report_close(struct report **r);

#endif
