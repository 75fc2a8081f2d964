/* SPDX-License-Identifier: MIT
 *
 * profile.h - what the files of `pellucid profile` share: the requested profiles and their properties. */
#ifndef PELL_CLI_PROFILE_H
#define PELL_CLI_PROFILE_H

#include "cli/cli.h"

#include <pellucid/kernel.h>
#include <pellucid/material.h>

/* One model of the three channels. */
struct candidate {
    const char *name;               /* name of the model */
    struct pell_profile R[3], T[3]; /* T: slabs only */
};

#define PROFILE_FITS 4

struct profile_fit {
    int k;                        /* Gaussians */
    struct pell_gaussians sum[3]; /* sums per channel: weights are weight[i][0] */
    struct pell_gaussians shared; /* sum shared by all three channels; count 0: each has its own variances */
    double error[3];              /* error (10) of d'Eon et al. 2007, a fraction */
};

struct profile_job {
    char name[256];    /* name of the material */
    const char *model; /* "dipole", "table", "gaussians", or a solver of layers */
    bool layers, slab; /* slab: T is valid */
    bool has_medium;
    struct pell_medium medium; /* with the options' eta */
    struct pell_profile_params params;
    const char *names[3];      /* names of the channels: "r", "g", "b" */
    const char *titles[3];     /* "red", "green", "blue" */
    const char *columns[3];    /* table headers: "R", "G", "B" */
    struct candidate *profile; /* the requested profile */
    struct candidate *others;  /* models to compare with it */
    size_t num_others;

    struct profile_fit fits[PROFILE_FITS];
    size_t num_fits;
    int own; /* number of Gaussians that the profile itself is a sum of, 0: none */

    double from, to; /* mm */
    bool to_given;
    double *r; /* radii of the table */
    size_t count;
};

/* --- profile/job.c ---------------------------------------------------------------------------------------------------------- */

/* A text that grows. */
struct profile_text {
    char *bytes;
    size_t length, capacity;
    bool failed; /* an allocation failed */
};

/* At most 511 bytes a call. */
void profile_add(struct profile_text *text, const char *fmt, ...) PELL_PRINTF(2, 3);
/* Writes to --output, or stdout; frees the text. */
enum exit_code profile_write(struct cli *cli, struct profile_text *text);

/* Fits job->profile by a sum of Gaussians, and adds it to job->fits, which has room; `shared`: all channels have the same variances. */
enum pell_result profile_add_fit(struct profile_job *job, const struct pell_fit_params *params, bool shared);

/* The reference for comparison: monte-carlo if it is one of the models, else the requested one. */
const struct candidate *profile_reference(const struct profile_job *job);
/* sqrt(Int r (R - M)^2 dr) / sqrt(Int r M^2 dr): error (10) of d'Eon et al. 2007 of R for M; not finite where M is 0. */
double profile_distance(const struct pell_profile *R, const struct pell_profile *M);

/* Parses a number of an option in [min, max]; *value is unchanged if the option was not given. */
enum exit_code profile_take_number(struct cli *cli, const char *option, const char *text, double min, double max, double *value);
/* Refuses options that change a medium if the profile has none (`kind`: "table of R(r)"), so that they are not silently ignored. */
enum exit_code profile_refuse_medium_options(struct cli *cli, const struct profile_job *job, const char *kind);

/* --- profile/layers.c --------------------------------------------------------------------------------------------------------- */

enum exit_code profile_open_layers(struct cli *cli, struct profile_job *job, const struct pell_material_layers *layers);
enum exit_code profile_open_stack_file(struct cli *cli, struct profile_job *job); /* --layers */
enum exit_code profile_open_skin(struct cli *cli, struct profile_job *job);       /* --skin, --wavelength */

/* --- profile/plot.c ----------------------------------------------------------------------------------------------------------- */

enum exit_code profile_plot(struct cli *cli, const struct profile_job *job);

/* --- profile/export.c --------------------------------------------------------------------------------------------------------- */

/* Values of --export; ends with NULL. */
extern const char *const profile_language_names[];
/* Checks --export and --taps. */
enum exit_code profile_check_export(struct cli *cli);
/* Adds the first fit, a separable kernel and a table as constants of a language: "c", "glsl", "hlsl" or "json". PELL_ERR_INVALID, not
 * logged: another language, or a profile without a kernel. The caller frees text->bytes in any case. `separable_error` (may be NULL):
 * relative error of the separable kernel's worst channel. */
enum pell_result profile_code(const struct profile_job *job, const char *language, int taps, int rank, struct profile_text *text,
                              double *separable_error);
/* The same with --export, --taps and --rank, to --output or stdout. */
enum exit_code profile_export(struct cli *cli, const struct profile_job *job);

#endif
