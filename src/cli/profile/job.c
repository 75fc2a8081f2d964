/* SPDX-License-Identifier: MIT
 *
 * job.c - what the parts of `pellucid profile` share: a text that grows, numbers of options, distances between profiles.
 */
#include "cli/profile/profile.h"

#include "base/file.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { QUADRATURE = 2048 };

void profile_add(struct profile_text *text, const char *fmt, ...)
{
    const size_t room = 512; /* upper bound on what one call adds */
    va_list args;

    if (text->capacity - text->length < room && !text->failed) {
        const size_t capacity = 2 * text->capacity + 4096;
        char *grown = realloc(text->bytes, capacity);
        text->failed = !grown;
        text->bytes = grown ? grown : text->bytes;
        text->capacity = grown ? capacity : text->capacity;
    }
    if (text->failed)
        return;
    va_start(args, fmt);
    const int n = vsnprintf(text->bytes + text->length, room, fmt, args);
    va_end(args);
    text->length += n < 0 ? 0 : (size_t) n < room ? (size_t) n : room - 1;
}

enum exit_code profile_write(struct cli *cli, struct profile_text *text)
{
    enum exit_code code = EXIT_MEMORY;

    if (!text->failed)
        code = cli_failed(cli, pell_file_write(cli->ctx, cli->output ? cli->output : "-", text->bytes, text->length));
    free(text->bytes);
    return code;
}

/* Trapezoidal rule in log r, from the radius that encloses 1/1000 of the light: profiles with single scattering rise as 1/r, and the
 * integral of r R^2 diverges towards 0 (pell_fit_profile does the same). */
double profile_distance(const struct pell_profile *R, const struct pell_profile *M)
{
    const double low = pell_profile_sample(M, 1e-3), high = 10.0 * pell_profile_sample(M, 0.9999);
    double numerator = 0.0, denominator = 0.0;

    if (!(low > 0.0) || !(high > low))
        return (double) NAN;
    for (int i = 0; i <= QUADRATURE; i++) {
        const double r = low * pow(high / low, (double) i / QUADRATURE), m = pell_profile_eval(M, r), d = pell_profile_eval(R, r) - m;
        numerator += r * r * d * d;
        denominator += r * r * m * m;
    }
    return sqrt(numerator / denominator);
}

const struct candidate *profile_reference(const struct profile_job *job)
{
    for (size_t i = 0; i < job->num_others; i++)
        if (strcmp(job->others[i].name, "monte-carlo") == 0)
            return &job->others[i];
    return job->profile;
}

enum exit_code profile_take_number(struct cli *cli, const char *option, const char *text, double min, double max, double *value)
{
    double v;

    if (!text)
        return EXIT_OK;
    if (!pell_parse_number(text, strlen(text), &v))
        return cli_usage(cli, option, NULL, "\"%s\" is not a number; allowed: [%g, %g]", text, min, max);
    if (!(v >= min && v <= max))
        return cli_usage(cli, option, NULL, "is %s, allowed: [%g, %g]", text, min, max);
    *value = v;
    return EXIT_OK;
}

enum exit_code profile_refuse_medium_options(struct cli *cli, const struct profile_job *job, const char *kind)
{
    const struct {
        const char *option, *text;
        bool layers; /* the option is allowed for layers */
    } given[] = { { "--model", cli->profile.model, false },
                  { "--compare", cli->profile.compare, false },
                  { "--eta", cli->profile.eta, false },
                  { "--roughness", cli->profile.roughness, true } };
    const bool layers = strcmp(kind, "stack of layers") == 0;

    for (size_t i = 0; i < PELL_COUNT(given); i++)
        if (given[i].text && !(layers && given[i].layers))
            return cli_usage(cli, given[i].option, layers && i < 2 ? "--solver chooses how layers are combined" : NULL,
                             "needs a medium, but %s is a %s", job->name, kind);
    return EXIT_OK;
}

/* --- Fits --------------------------------------------------------------------------------------------------------------------- */

/* Splits shared variances into sums per channel. */
static enum pell_result fit_shared(const struct profile_job *job, const struct pell_fit_params *params, struct profile_fit *fit)
{
    struct pell_fit_report report;
    const enum pell_result res = pell_fit_profiles(job->profile->R, params, &fit->shared, &report);

    for (int c = 0; c < 3 && res == PELL_OK; c++) {
        fit->sum[c] = fit->shared;
        for (int i = 0; i < fit->shared.count; i++) {
            fit->sum[c].weight[i][0] = fit->shared.weight[i][c];
            fit->sum[c].weight[i][1] = fit->sum[c].weight[i][2] = 0.0;
        }
        fit->error[c] = report.error[c];
    }
    return res;
}

static enum pell_result fit_own(const struct profile_job *job, const struct pell_fit_params *params, struct profile_fit *fit)
{
    enum pell_result res = PELL_OK;

    for (int c = 0; c < 3 && res == PELL_OK; c++) {
        struct pell_fit_report report = { .error = { 0 } };
        res = pell_fit_profile(&job->profile->R[c], params, &fit->sum[c], &report);
        fit->error[c] = report.error[0];
    }
    return res;
}

enum pell_result profile_add_fit(struct profile_job *job, const struct pell_fit_params *params, bool shared)
{
    struct profile_fit *fit = &job->fits[job->num_fits];
    enum pell_result res;

    fit->k = params->count;
    res = shared ? fit_shared(job, params, fit) : fit_own(job, params, fit);
    job->num_fits += res == PELL_OK;
    return res;
}
