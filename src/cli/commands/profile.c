/* SPDX-License-Identifier: MIT
 * profile.c - `pellucid profile`: radial profiles and their fits as a table, JSON, CSV, a plot or code. */
#include "cli/profile/profile.h"

#include "base/file.h"
#include "base/simd.h"
#include "cli/plot.h"
#include "scene/file/profile_table.h"
#include "scene/scene.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define RADIUS_MIN 1e-9 /* mm */
#define RADIUS_MAX 1e9
#define DEFAULT_GAUSSIANS 4

/* --- Options ------------------------------------------------------------------------------------------------------------------ */

static enum exit_code unknown_model(struct cli *cli, const char *option, const char *name)
{
    const char *names[PELL_PROFILE_MODELS];
    struct pell_text hint = { .length = 0 };
    size_t n = 0;

    for (int i = 0; i < PELL_PROFILE_MODELS; i++)
        if (pell_profile_model_at((size_t) i))
            names[n++] = pell_profile_model_at((size_t) i)->name;
    pell_text_suggest_or_list(&hint, "there is ", name, names, n);
    return cli_usage(cli, option, hint.str, "there is no profile model \"%s\"", name);
}

/* Makes the profiles of a medium's three channels by a model. */
static enum exit_code make_model(struct cli *cli, const struct profile_job *job, enum pell_profile_model model, struct candidate *out)
{
    out->name = pell_profile_model_at(model)->name;
    for (int c = 0; c < 3; c++) {
        const enum pell_result res = pell_profile_make(model, &job->medium, c, &job->params, &out->R[c]);
        if (pell_cancelled(cli->ctx))
            return EXIT_INTERRUPTED;
        if (res == PELL_ERR_UNSUPPORTED && job->params.roughness > 0.0)
            return cli_usage(cli, "--roughness", "dipole, better-dipole and photon-beam take it",
                             "%s is made for smooth boundaries and can't have another: --roughness must be 0", out->name);
        if (res != PELL_OK) {
            const enum pell_result logged = pell_error(cli->ctx, res, "--model", NULL, "%s can't be made of %s (channel %s, eta %g): %s",
                                                       out->name, job->name, job->names[c], job->medium.eta, pell_result_name(res));
            return cli_failed(cli, logged);
        }
    }
    return EXIT_OK;
}

static enum exit_code compare_with(struct cli *cli, struct profile_job *job, enum pell_profile_model model)
{
    if (strcmp(pell_profile_model_at(model)->name, job->model) == 0)
        return EXIT_OK;
    for (size_t i = 0; i < job->num_others; i++)
        if (strcmp(job->others[i].name, pell_profile_model_at(model)->name) == 0)
            return EXIT_OK;
    return make_model(cli, job, model, &job->others[job->num_others++]);
}

/* --compare NAME,NAME or all. */
static enum exit_code make_others(struct cli *cli, struct profile_job *job)
{
    const char *text = cli->profile.compare;
    enum exit_code code = EXIT_OK;

    if (!text)
        return EXIT_OK;
    job->others = calloc(PELL_PROFILE_MODELS, sizeof(*job->others));
    if (!job->others)
        return EXIT_MEMORY;
    for (int i = 0; strcmp(text, "all") == 0 && i < PELL_PROFILE_MODELS && code == EXIT_OK; i++) {
        struct pell_profile *probe = pell_profile_model_at((size_t) i) ? malloc(sizeof(*probe)) : NULL;
        /* With "all", only models that support this medium and boundary. */
        if (probe && pell_profile_make((enum pell_profile_model) i, &job->medium, 0, &job->params, probe) != PELL_ERR_UNSUPPORTED)
            code = compare_with(cli, job, (enum pell_profile_model) i);
        free(probe);
    }
    while (strcmp(cli->profile.compare, "all") != 0 && code == EXIT_OK) {
        const size_t n = strcspn(text, ",");
        enum pell_profile_model model;
        char name[64];
        snprintf(name, sizeof(name), "%.*s", (int) (n < 63 ? n : 63), text);
        code = pell_profile_model_find(name, &model) ? compare_with(cli, job, model) : unknown_model(cli, "--compare", name);
        if (!text[n])
            break;
        text += n + 1;
    }
    return code;
}

/* Refuses --solver for materials without layers. */
static enum exit_code refuse_solver(struct cli *cli, const struct profile_job *job)
{
    if (!cli->profile.solver)
        return EXIT_OK;
    return cli_usage(cli, "--solver", NULL, "combines layers, and %s has none", job->name);
}

static enum exit_code open_table(struct cli *cli, struct profile_job *job, const char *path)
{
    uint8_t *data = NULL;
    size_t size = 0;
    enum pell_result res;

    job->model = job->profile->name = "table";
    if (refuse_solver(cli, job) != EXIT_OK || profile_refuse_medium_options(cli, job, "table of R(r)") != EXIT_OK)
        return EXIT_USAGE;
    res = pell_file_read(cli->ctx, path, &data, &size);
    if (res == PELL_OK)
        res = pell_profile_table_read(cli->ctx, path, data, size, job->profile->R);
    pell_free(cli->ctx, data);
    return cli_failed(cli, res);
}

static enum exit_code open_gaussians(struct cli *cli, struct profile_job *job, const struct pell_material_entry *entry)
{
    enum pell_result res = PELL_OK;

    job->model = job->profile->name = "gaussians";
    job->own = entry->gaussians.count;
    if (refuse_solver(cli, job) != EXIT_OK || profile_refuse_medium_options(cli, job, "sum of Gaussians") != EXIT_OK)
        return EXIT_USAGE;
    for (int c = 0; c < 3 && res == PELL_OK; c++)
        res = pell_profile_from_gaussians(&entry->gaussians, c, &job->profile->R[c]);
    if (res != PELL_OK)
        res = pell_error(cli->ctx, res, job->name, NULL, "its Gaussians give no profile");
    return cli_failed(cli, res);
}

static enum exit_code open_medium(struct cli *cli, struct profile_job *job, const struct pell_medium *medium)
{
    enum pell_profile_model model = PELL_PROFILE_DIPOLE;
    enum exit_code code = refuse_solver(cli, job);

    if (code != EXIT_OK)
        return code;
    if (cli->profile.model && !pell_profile_model_find(cli->profile.model, &model))
        return unknown_model(cli, "--model", cli->profile.model);
    job->has_medium = true;
    job->medium = *medium;
    job->model = pell_profile_model_at(model)->name;
    code = profile_take_number(cli, "--eta", cli->profile.eta, PELL_ETA_MIN, PELL_ETA_MAX, &job->medium.eta);
    if (code == EXIT_OK)
        code = profile_take_number(cli, "--roughness", cli->profile.roughness, 0.0, 1.0, &job->params.roughness);
    if (code == EXIT_OK)
        code = make_model(cli, job, model, job->profile);
    if (code == EXIT_OK)
        code = make_others(cli, job);
    return code;
}

static enum exit_code unknown_material(struct cli *cli, const struct profile_job *job, const char *name)
{
    const size_t count = pell_material_count();
    const char **names = calloc(count + 1, sizeof(*names));
    struct pell_text hint = { .length = 0 };

    for (size_t i = 0; names && i < count; i++)
        names[i] = pell_material_at(i)->name;
    if (!names || !pell_text_suggest(&hint, "", name, names, count))
        pell_text_add(&hint, "`pellucid materials` lists the built-in names");
    free(names);
    return cli_usage(cli, "MATERIAL|FILE", hint.str,
                     "\"%s\", must be a built-in material, a material file (wax.json) or a table of R(r) (wax.csv)", job->name);
}

static enum exit_code open_material(struct cli *cli, struct profile_job *job, const char *name)
{
    struct pell_material_entry entry = { 0 };
    enum exit_code code;

    if (cli_is_image(name))
        return cli_usage(cli, "MATERIAL|FILE", NULL, "\"%s\" is an image, not a material or a table of R(r)", name);
    if (!pell_material_is_path(name) && !pell_material_find(name))
        return unknown_material(cli, job, name);
    code = cli_failed(cli, pell_material_open(cli->ctx, name, name, &entry));
    if (code == EXIT_OK)
        switch (entry.kind) {
        case PELL_MATERIAL_MEDIUM: code = open_medium(cli, job, &entry.medium); break;
        case PELL_MATERIAL_GAUSSIANS: code = open_gaussians(cli, job, &entry); break;
        case PELL_MATERIAL_LAYERS: code = profile_open_layers(cli, job, &entry.layers); break;
        }
    pell_free(cli->ctx, (char *) entry.name);
    return code;
}

static enum exit_code open_profile(struct cli *cli, struct profile_job *job)
{
    const char *what = cli->num_arguments ? cli->arguments[0] : NULL, *other = cli->profile.layers ? "--layers" : "--skin";
    const bool skin = cli->profile.skin || cli->profile.wavelength;

    if (skin && cli->profile.layers)
        return cli_usage(cli, "--layers", NULL, "can't be combined with %s: a profile is of one of them",
                         cli->profile.skin ? "--skin" : "--wavelength");
    if (what && (skin || cli->profile.layers))
        return cli_usage(cli, what, "leave one of them out", "can't be combined with %s: a profile is of one of them",
                         cli->profile.skin || cli->profile.layers ? other : "--wavelength");
    if (!what && !skin && !cli->profile.layers)
        return cli_usage(cli, "profile", "`--help` shows examples", "MATERIAL|FILE is missing, and neither --layers nor --skin is given");
    if (skin)
        return profile_open_skin(cli, job);
    if (cli->profile.layers)
        return profile_open_stack_file(cli, job);
    pell_printable(pell_path_name(what), job->name, sizeof(job->name));
    return pell_path_has_extension(what, "csv") ? open_table(cli, job, what) : open_material(cli, job, what);
}

/* --- Radii -------------------------------------------------------------------------------------------------------------------- */

/* Rounds to 1, 2 or 5 times a power of ten, at most (or at least) `value`. */
static double round_nicely(double value, bool up)
{
    static const double steps[] = { 1.0, 2.0, 5.0, 10.0 };
    const double power = pow(10.0, floor(log10(value)));

    for (size_t i = 0; up && i < PELL_COUNT(steps); i++)
        if (steps[i] * power >= value * (1.0 - 1e-12))
            return steps[i] * power;
    for (size_t i = PELL_COUNT(steps); !up && i-- > 0;)
        if (steps[i] * power <= value * (1.0 + 1e-12))
            return steps[i] * power;
    return value;
}

/* The radii that hold the light: all but a thousandth beyond `from` in any channel, and all but half a thousandth within `to`. Farther out,
 * R falls as exp(-sigma_tr r) or faster, except for white materials. */
static void find_light(struct profile_job *job)
{
    double low = INFINITY, high = 0.0;

    for (int k = 0; k < (job->slab ? 6 : 3); k++) {
        const struct pell_profile *p = k < 3 ? &job->profile->R[k] : &job->profile->T[k - 3];
        if (pell_profile_total(p) > 0.0) {
            low = fmin(low, pell_profile_sample(p, 1e-3));
            high = fmax(high, pell_profile_sample(p, 0.9995));
        }
    }
    job->from = low > 0.0 && isfinite(low) ? fmax(round_nicely(low, false), RADIUS_MIN) : 1e-3;
    job->to = high > 0.0 && isfinite(high) ? fmin(round_nicely(high, true), RADIUS_MAX) : 1e3 * job->from;
    if (job->to <= job->from)
        job->to = 1e3 * job->from;
}

static enum exit_code choose_radii(struct cli *cli, struct profile_job *job)
{
    const bool plain = !cli->json && !cli->profile.csv, given = cli->profile.from || cli->profile.to;
    enum exit_code code = EXIT_OK;

    find_light(job);
    if (cli->profile.from)
        code = cli_failed(cli, pell_parse_length(cli->ctx, "--from", cli->profile.from, &job->from));
    job->to_given = cli->profile.to != NULL;
    if (code == EXIT_OK && job->to_given)
        code = cli_failed(cli, pell_parse_length(cli->ctx, "--to", cli->profile.to, &job->to));
    if (code != EXIT_OK)
        return code;
    if (!(job->from >= RADIUS_MIN && job->to <= RADIUS_MAX && job->to > job->from)) {
        if (given)
            return cli_usage(cli, cli->profile.to ? "--to" : "--from", "radii rise from --from to --to, within [1e-9, 1e9] mm",
                             "the radii from %g mm to %g mm are no range", job->from, job->to);
        return cli_failed(cli, pell_error(cli->ctx, PELL_ERR_FORMAT, job->name, "--from and --to choose other radii",
                                          "has no light between %g mm and %g mm", RADIUS_MIN, RADIUS_MAX));
    }
    job->count = cli->numbers.points ? (size_t) cli->numbers.points : plain ? 13 : 64;
    if (job->count < 2)
        return cli_usage(cli, "--points", NULL, "is %d, allowed: 0 or [2, 4096]", cli->numbers.points);
    job->r = calloc(job->count, sizeof(*job->r));
    if (!job->r)
        return EXIT_MEMORY;
    for (size_t i = 0; i < job->count; i++)
        job->r[i] = i + 1 == job->count ? job->to : job->from * pow(job->to / job->from, (double) i / (double) (job->count - 1));
    return EXIT_OK;
}

/* --- Fits --------------------------------------------------------------------------------------------------------------------- */

static enum exit_code make_fit(struct cli *cli, struct profile_job *job, int k)
{
    const struct pell_fit_params params = { .count = k, .free_energy = cli->profile.free_energy };
    enum pell_result res = profile_add_fit(job, &params, cli->profile.shared);

    if (pell_cancelled(cli->ctx))
        return EXIT_INTERRUPTED;
    if (res != PELL_OK)
        res = pell_error(cli->ctx, res, "--gaussians", NULL, "no sum of %d Gaussians fits %s (%s)", k, job->name, pell_result_name(res));
    return cli_failed(cli, res);
}

/* --gaussians K, or K,K,... */
static enum exit_code make_fits(struct cli *cli, struct profile_job *job)
{
    /* a profile of fewer Gaussians is its own fit */
    const char usual[] = { (char) ('0' + (job->own > 0 && job->own < DEFAULT_GAUSSIANS ? job->own : DEFAULT_GAUSSIANS)), '\0' };
    const char *text = cli->profile.gaussians ? cli->profile.gaussians : usual;
    enum exit_code code = EXIT_OK;

    if (strcmp(text, "0") == 0)
        return EXIT_OK;
    for (; code == EXIT_OK; text++) {
        const size_t n = strcspn(text, ",");
        int64_t k;
        if (!pell_parse_int(text, n, &k) || k < 1 || k > PELL_GAUSSIANS_MAX)
            return cli_usage(cli, "--gaussians", NULL, "\"%.*s\", must be 0 (no fit), or whole numbers in [1, %d] with commas between",
                             (int) (n < 40 ? n : 40), text, PELL_GAUSSIANS_MAX);
        if (job->num_fits == PROFILE_FITS)
            return cli_usage(cli, "--gaussians", NULL, "at most %d fits are made at a time", PROFILE_FITS);
        code = make_fit(cli, job, (int) k);
        text += n;
        if (!*text)
            break;
    }
    return code;
}

/* --- Answers ------------------------------------------------------------------------------------------------------------------ */

static json_t *values_json(const struct profile_job *job, const struct pell_profile *p)
{
    json_t *list = json_array();
    for (size_t i = 0; i < job->count; i++)
        json_array_append_new(list, json_real(pell_profile_eval(p, job->r[i])));
    return list;
}

static json_t *fit_json(const struct profile_fit *fit, int c)
{
    json_t *gaussians = json_array();

    for (int i = 0; i < fit->sum[c].count; i++)
        json_array_append_new(gaussians,
                              json_pack("{s:f,s:f}", "variance_mm2", fit->sum[c].variance[i], "weight", fit->sum[c].weight[i][0]));
    return json_pack("{s:i,s:f,s:o}", "k", fit->sum[c].count, "error", fit->error[c], "gaussians", gaussians);
}

static json_t *channel_json(const struct profile_job *job, int c)
{
    const double dmfp = job->has_medium ? pell_diffuse_mean_free_path(&job->medium, c) : (double) NAN;
    json_t *o =
        json_pack("{s:s,s:f,s:o,s:o,s:o}", "channel", job->names[c], "rd_total", pell_profile_total(&job->profile->R[c]), "sigma_tr",
                  cli_number(1.0 / dmfp), "r_mm", cli_numbers(job->r, job->count), "R", values_json(job, &job->profile->R[c]));

    if (o && job->slab) {
        json_object_set_new(o, "td_total", json_real(pell_profile_total(&job->profile->T[c])));
        json_object_set_new(o, "T", values_json(job, &job->profile->T[c]));
    }
    if (o && job->num_fits)
        json_object_set_new(o, "fit", fit_json(&job->fits[0], c));
    if (o && job->num_fits > 1) {
        json_t *fits = json_array();
        for (size_t i = 0; i < job->num_fits; i++)
            json_array_append_new(fits, fit_json(&job->fits[i], c));
        json_object_set_new(o, "fits", fits);
    }
    return o;
}

static json_t *other_json(const struct profile_job *job, const struct candidate *other)
{
    json_t *channels = json_array();

    for (int c = 0; c < 3; c++)
        json_array_append_new(channels,
                              json_pack("{s:s,s:f,s:o,s:o}", "channel", job->names[c], "rd_total", pell_profile_total(&other->R[c]),
                                        "distance", cli_number(profile_distance(&other->R[c], &profile_reference(job)->R[c])), "R",
                                        values_json(job, &other->R[c])));
    return json_pack("{s:s,s:o}", "model", other->name, "channels", channels);
}

static enum exit_code answer_json(struct cli *cli, const struct profile_job *job)
{
    json_t *channels = json_array(), *others = json_array(), *o;
    double mfp[3], dmfp[3];

    for (int c = 0; c < 3; c++) {
        mfp[c] = job->has_medium ? pell_mean_free_path(&job->medium, c) : (double) NAN;
        dmfp[c] = job->has_medium ? pell_diffuse_mean_free_path(&job->medium, c) : (double) NAN;
        json_array_append_new(channels, channel_json(job, c));
    }
    for (size_t i = 0; i <= job->num_others; i++)
        json_array_append_new(others, other_json(job, i ? &job->others[i - 1] : job->profile));
    o = json_pack("{s:o,s:s,s:o,s:o,s:o,s:o}", "material", cli_text(job->name), "model", job->model, "eta",
                  cli_number(job->has_medium ? job->medium.eta : (double) NAN), "mean_free_path", cli_numbers(mfp, 3),
                  "diffuse_mean_free_path", cli_numbers(dmfp, 3), "channels", channels);
    if (o && job->num_others) {
        json_object_set_new(o, "reference", json_string(profile_reference(job)->name));
        json_object_set(o, "compare", others);
    }
    if (o && cli->output)
        json_object_set_new(o, "plot", cli_text(cli->output));
    json_decref(others);
    return cli_print_json(cli, o);
}

static enum exit_code answer_csv(struct cli *cli, const struct profile_job *job)
{
    struct profile_text text = { .length = 0 };

    const char *const *n = job->columns;

    profile_add(&text, "r_mm,%s,%s,%s", n[0], n[1], n[2]);
    if (job->slab)
        profile_add(&text, ",tr_%s,tr_%s,tr_%s", n[0], n[1], n[2]);
    for (size_t k = 0; k < job->num_others; k++)
        for (int c = 0; c < 3; c++)
            profile_add(&text, ",%s_%s", job->others[k].name, n[c]);
    for (size_t i = 0; i < job->count; i++) {
        profile_add(&text, "\n%.9g", job->r[i]);
        for (int c = 0; c < 3; c++)
            profile_add(&text, ",%.9g", pell_profile_eval(&job->profile->R[c], job->r[i]));
        for (int c = 0; c < 3 && job->slab; c++)
            profile_add(&text, ",%.9g", pell_profile_eval(&job->profile->T[c], job->r[i]));
        for (size_t k = 0; k < 3 * job->num_others; k++)
            profile_add(&text, ",%.9g", pell_profile_eval(&job->others[k / 3].R[k % 3], job->r[i]));
    }
    profile_add(&text, "\n");
    return profile_write(cli, &text);
}

static void print_three(const char *name, const double v[3], const char *unit)
{
    printf("  %-26s", name);
    for (int c = 0; c < 3; c++)
        if (isfinite(v[c]))
            printf(" %11.5g", v[c]);
        else
            printf(" %11s", "infinite");
    printf("%s%s\n", unit[0] ? "  " : "", unit);
}

static void print_gaussians(const struct cli *cli, const struct profile_job *job, const struct profile_fit *fit)
{
    printf("\n%s%d Gaussian%s%s, R(r) = sum of weight exp(-r^2/(2 variance)) / (2 pi variance)%s%s\n", cli_style(cli, stdout, 1), fit->k,
           fit->k > 1 ? "s" : "", cli_style(cli, stdout, 0), cli->profile.shared ? ", shared variances" : "",
           cli->profile.free_energy ? ", energy free" : "");
    for (int c = 0; c < 3; c++) {
        printf("  %s, error %.3g %%\n", job->titles[c], 100.0 * fit->error[c]);
        for (int i = 0; i < fit->sum[c].count; i++)
            printf("    variance %12.6g mm^2   weight %10.6g\n", fit->sum[c].variance[i], fit->sum[c].weight[i][0]);
    }
}

static void print_others(const struct cli *cli, const struct profile_job *job)
{
    const struct candidate *reference = profile_reference(job);
    char head[64];

    snprintf(head, sizeof(head), "distance from %s, %%", reference->name);
    printf("\n%sModels%s %48s   %s\n", cli_style(cli, stdout, 1), cli_style(cli, stdout, 0), "total reflectance", head);
    printf("  %-22s %9.9s %9.9s %9.9s   %9.9s %9.9s %9.9s\n", "", job->titles[0], job->titles[1], job->titles[2], job->titles[0],
           job->titles[1], job->titles[2]);
    for (size_t i = 0; i <= job->num_others; i++) {
        const struct candidate *k = i ? &job->others[i - 1] : job->profile;
        printf("  %-22s", k->name);
        for (int c = 0; c < 3; c++)
            printf(" %9.4g", pell_profile_total(&k->R[c]));
        printf("  ");
        for (int c = 0; c < 3 && k != reference; c++)
            printf(" %9.3g", 100.0 * profile_distance(&k->R[c], &reference->R[c]));
        putchar('\n');
    }
}

#define TRANSMITTED "                        T(r), 1/mm^2"

/* Prints T(r) of a slab if the first table has no room for it. */
static void print_transmitted(const struct profile_job *job)
{
    printf("\n  %-26s %35s\n", "r, mm", "T(r), 1/mm^2");
    for (size_t i = 0; i < job->count; i++) {
        printf("  %-26.4g", job->r[i]);
        for (int c = 0; c < 3; c++)
            printf(" %11.4g", pell_profile_eval(&job->profile->T[c], job->r[i]));
        putchar('\n');
    }
}

/* Gaussians fall faster than profiles do: the table shows large relative errors where there may be little light, which the fit's error
 * accounts for. */
static void explain_far_errors(const struct profile_job *job)
{
    double from = 0.0, fraction = 0.0;

    for (size_t i = job->count; i-- > 0;) {
        bool far = false;
        for (int c = 0; c < 3; c++) {
            const double R = pell_profile_eval(&job->profile->R[c], job->r[i]);
            far = far || (R > 0.0 && fabs(pell_gaussians_eval(&job->fits[0].sum[c], 0, job->r[i]) / R - 1.0) > 0.2);
        }
        if (!far)
            break;
        from = job->r[i];
    }
    if (!(from > 0.0))
        return;
    for (int c = 0; c < 3; c++)
        fraction = fmax(fraction, 1.0 - pell_profile_cdf(&job->profile->R[c], from));
    printf("  errors over 20 %% begin at %.4g mm, beyond which at most %.2g %% of the light leaves\n", from, 100.0 * fraction);
}

/* The row of a radius: R, and T of a slab or the fit's error where R is above 0. */
static void print_radius(const struct profile_job *job, double r)
{
    struct pell_text row = { .length = 0 };

    pell_text_add(&row, "  %-26.4g", r);
    for (int c = 0; c < 3; c++)
        pell_text_add(&row, " %11.4g", pell_profile_eval(&job->profile->R[c], r));
    for (int c = 0; c < 3 && job->slab && !job->num_fits; c++)
        pell_text_add(&row, " %11.4g", pell_profile_eval(&job->profile->T[c], r));
    for (int c = 0; c < 3 && job->num_fits; c++) {
        const double R = pell_profile_eval(&job->profile->R[c], r);
        const double percent = R > 0.0 ? 100.0 * (pell_gaussians_eval(&job->fits[0].sum[c], 0, r) / R - 1.0) : NAN;
        if (isnan(percent))
            pell_text_add(&row, " %s%8s", c ? "" : " ", "");
        else
            pell_text_add(&row, " %s%8.2f", c ? "" : " ", fabs(percent) < 0.005 ? 0.0 : percent);
    }
    while (row.length && row.str[row.length - 1] == ' ')
        row.str[--row.length] = '\0';
    puts(row.str);
}

static enum exit_code answer_table(struct cli *cli, const struct profile_job *job)
{
    double mfp[3], dmfp[3], total[3];

    printf("%s%s%s: %s", cli_style(cli, stdout, 1), job->name, cli_style(cli, stdout, 0), job->model);
    if (job->has_medium && !cli->profile.model)
        printf(" (render takes %s)", pell_profile_model_at(PELL_MATERIAL_MODEL)->name);
    if (job->has_medium)
        printf(", eta %g", job->medium.eta);
    if (job->params.roughness > 0.0)
        printf(", roughness %g", job->params.roughness);
    printf("\n\n  %-26s %11s %11s %11s\n", "", job->titles[0], job->titles[1], job->titles[2]);
    for (int c = 0; c < 3; c++) {
        mfp[c] = job->has_medium ? pell_mean_free_path(&job->medium, c) : 0.0;
        dmfp[c] = job->has_medium ? pell_diffuse_mean_free_path(&job->medium, c) : 0.0;
        total[c] = pell_profile_total(&job->profile->R[c]);
    }
    if (job->has_medium) {
        print_three("mean free path", mfp, "mm");
        print_three("diffuse mean free path", dmfp, "mm");
    }
    print_three("total reflectance", total, "");
    for (int c = 0; c < 3; c++)
        total[c] = pell_profile_total(&job->profile->T[c]);
    if (job->slab)
        print_three("total transmittance", total, "");
    printf("\n  %-26s %35s%s\n", "r, mm", "R(r), 1/mm^2", job->num_fits ? "       error of the fit, % of R" : job->slab ? TRANSMITTED : "");
    for (size_t i = 0; i < job->count; i++)
        print_radius(job, job->r[i]);
    if (job->slab && job->num_fits)
        print_transmitted(job);
    if (job->num_others)
        print_others(cli, job);
    if (job->num_fits)
        explain_far_errors(job);
    for (size_t i = 0; i < job->num_fits; i++)
        print_gaussians(cli, job, &job->fits[i]);
    return EXIT_OK;
}

/* Refuses options that would have no effect in combination with others, so that they are not silently ignored. */
static enum exit_code refuse_idle(struct cli *cli)
{
    const bool csv = cli->profile.csv, code = cli->profile.export != NULL;
    const bool no_fit = cli->profile.gaussians && strcmp(cli->profile.gaussians, "0") == 0;
    const struct {
        const char *option;
        bool idle;
        const char *why;
    } rows[] = {
        { "--taps", !code, "has no effect without --export: it sets the taps of the exported kernel" },
        { "--rank", !code, "has no effect without --export: it sets the rank of the exported kernel" },
        { "--shared", no_fit, "has no effect with --gaussians 0, which disables the fit" },
        { "--free", no_fit, "has no effect with --gaussians 0, which disables the fit" },
        { "--gaussians", csv && !no_fit, "has no effect with --csv, which contains no fits" },
        { "--shared", csv, "has no effect with --csv, which contains no fits" },
        { "--free", csv, "has no effect with --csv, which contains no fits" },
        { "--compare", code, "does not go with --export: one profile is written" },
        { "--from", code, "has no effect on --export: the table is as long as the profile" },
        { "--to", code, "has no effect on --export: the table is as long as the profile" },
        { "--points", code, "has no effect on --export: its table has a fixed number of points" },
    };

    for (size_t i = 0; i < PELL_COUNT(rows); i++)
        if (rows[i].idle && cli_given(cli, rows[i].option))
            return cli_usage(cli, rows[i].option, NULL, "%s", rows[i].why);
    if (code && cli->profile.gaussians && strchr(cli->profile.gaussians, ','))
        return cli_usage(cli, "--gaussians", NULL, "\"%s\": --export writes one fit", cli->profile.gaussians);
    if (code && cli->profile.solver && strcmp(cli->profile.solver, "all") == 0)
        return cli_usage(cli, "--solver", NULL, "\"all\": --export writes one profile");
    return EXIT_OK;
}

/* Refuses conflicting options before any work. */
static enum exit_code check_options(struct cli *cli)
{
    const bool text = cli->profile.csv || cli->profile.export;

    if (cli->profile.csv && cli->profile.export)
        return cli_usage(cli, "--export", NULL, "does not go with --csv: one text is written");
    if (cli->json && text)
        return cli_usage(cli, cli->profile.csv ? "--csv" : "--export", cli->profile.csv ? NULL : "--export json writes a kernel as JSON",
                         "does not go with --json: only one of them can be printed");
    if (cli->output && !text && !plot_can_write(cli->output))
        return cli_usage(cli, "--output", "with --csv or --export it names a text file", "\"%s\", a plot must end in .svg, .pdf or .png",
                         cli->output);
    if (cli->output && cli->num_arguments && strcmp(cli->output, cli->arguments[0]) == 0)
        return cli_usage(cli, "--output", NULL, "\"%s\" is the input", cli->output);
    if (cli->profile.weighted && (!cli->output || text))
        return cli_usage(cli, "--weighted", "add -o profile.svg", "needs a plot (-o)");
    return refuse_idle(cli);
}

enum exit_code command_profile(struct cli *cli)
{
    struct profile_job job = { .names = { "r", "g", "b" }, .titles = { "red", "green", "blue" }, .columns = { "R", "G", "B" } };
    enum exit_code code = check_options(cli);

    pell_simd_check(cli->ctx);
    if (code == EXIT_OK && cli->profile.export)
        code = profile_check_export(cli);
    if (code == EXIT_OK && !(job.profile = calloc(1, sizeof(*job.profile))))
        code = EXIT_MEMORY;
    if (code == EXIT_OK)
        code = open_profile(cli, &job);
    if (code == EXIT_OK)
        code = choose_radii(cli, &job);
    if (code == EXIT_OK && !cli->profile.csv)
        code = make_fits(cli, &job);
    if (code == EXIT_OK && pell_cancelled(cli->ctx))
        code = EXIT_INTERRUPTED;
    if (code == EXIT_OK && cli->output)
        code = cli_spare_input(cli, "--output", cli->output);
    if (code == EXIT_OK && cli->output && !cli->profile.csv && !cli->profile.export)
        code = profile_plot(cli, &job);
    if (code == EXIT_OK && !(cli->output && (cli->profile.csv || cli->profile.export)))
        cli_answer_begins(); /* a plot has been written by now */
    if (code == EXIT_OK)
        code = cli->json             ? answer_json(cli, &job)
               : cli->profile.csv    ? answer_csv(cli, &job)
               : cli->profile.export ? profile_export(cli, &job)
                                     : answer_table(cli, &job);
    free(job.r);
    free(job.others);
    free(job.profile);
    return code;
}
