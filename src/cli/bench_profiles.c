/* SPDX-License-Identifier: MIT
 * bench_profiles.c - `pellucid bench profiles`: times of fits, of layers and of R(r), each beside what it is a ratio to. */
#include "cli/bench.h"
#include "cli/bench_layers.h"
#include "cli/profile/profile.h"
#include "cli/profile/stack.h"

#include "base/simd.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { RADII = 4096 };

struct profiles {
    const struct pell_context *ctx;
    struct rows rows;
    const struct pell_material_entry *marble, *skin;
    struct pell_profile marble_profile[3], by_solver[STACK_SOLVERS][3], model;
    double r[RADII], R[RADII], *ms; /* of each repeat */
    int repeats;
};

/* After each repeat: whether the next one may begin. */
static enum pell_result goes_on(const struct profiles *b, enum pell_result res)
{
    return res == PELL_OK && pell_cancelled(b->ctx) ? PELL_ERR_CANCELLED : res;
}

/* A row whose time is `ratio` times that of another row. */
static void add(struct profiles *b, const char *name, double ms, const char *against)
{
    struct row *r = bench_add(&b->rows, name, ms);

    for (size_t i = 0; r && against && i < b->rows.count; i++)
        if (strcmp(b->rows.items[i].name, against) == 0 && b->rows.items[i].ms > 0.0) {
            r->ratio = ms / b->rows.items[i].ms;
            r->against = against;
        }
}

static double largest(const double error[3])
{
    return fmax(error[0], fmax(error[1], error[2]));
}

/* d'Eon et al. 2007, appendix A: eight Gaussians a channel, no iteration. Many in a row, as one is shorter than the clock's step. */
static enum pell_result time_appendix_a(struct profiles *b)
{
    const struct pell_medium *m = &b->marble->medium;
    const int many = 256;
    struct pell_gaussians sum[3];
    double error[3];
    enum pell_result res = PELL_OK;

    for (int i = 0; i < b->repeats && res == PELL_OK; i++) {
        const double begin = pell_seconds();
        for (int n = 0; n < many && res == PELL_OK; n++)
            for (int c = 0; c < 3 && res == PELL_OK; c++) {
                const struct pell_dipole d = pell_dipole_make(m->sigma_a[c], m->sigma_s_reduced[c], m->eta, PELL_FRESNEL_EXACT);
                res = pell_dipole_appendix_a(&d, PELL_APPENDIX_A_BEST, &sum[c]);
            }
        b->ms[i] = 1e3 * (pell_seconds() - begin) / many;
        res = goes_on(b, res);
    }
    for (int c = 0; c < 3; c++)
        error[c] = res == PELL_OK ? pell_gaussians_error(&sum[c], 0, &b->marble_profile[c], 0.0) : 0.0;
    add(b, "fit by appendix A, RGB", bench_median(b->ms, b->repeats), NULL);
    b->rows.items[b->rows.count - 1].error = largest(error);
    return res;
}

static enum pell_result time_fit(struct profiles *b, int k, bool shared, const char *name)
{
    const struct pell_fit_params params = { .count = k };
    struct pell_gaussians out;
    struct pell_fit_report report = { .error = { 0 } };
    double error[3] = { 0 };
    enum pell_result res = PELL_OK;

    for (int i = 0; i < b->repeats && res == PELL_OK; i++) {
        const double begin = pell_seconds();
        if (shared)
            res = pell_fit_profiles(b->marble_profile, &params, &out, &report);
        for (int c = 0; c < 3 && !shared && res == PELL_OK; c++) {
            res = pell_fit_profile(&b->marble_profile[c], &params, &out, &report);
            error[c] = report.error[0];
        }
        b->ms[i] = 1e3 * (pell_seconds() - begin);
        res = goes_on(b, res);
    }
    add(b, name, bench_median(b->ms, b->repeats), "fit by appendix A, RGB");
    b->rows.items[b->rows.count - 1].error = largest(shared ? report.error : error);
    return res;
}

static enum pell_result time_layers(struct cli *cli, struct profiles *b)
{
    static const char *const names[STACK_SOLVERS] = { "three layers, Hankel", "three layers, Gaussians", "three layers, analytic" };
    enum pell_result res = PELL_OK;

    for (int s = 0; s < STACK_SOLVERS && res == PELL_OK; s++) {
        double error[3];
        res = bench_layers(cli->ctx, &b->skin->layers, (enum stack_solver) s, b->repeats, b->ms, b->by_solver[s]);
        if (res != PELL_OK)
            break;
        add(b, names[s], bench_median(b->ms, b->repeats), s ? names[0] : NULL);
        for (int c = 0; c < 3; c++)
            error[c] = profile_distance(&b->by_solver[s][c], &b->by_solver[0][c]);
        if (s)
            b->rows.items[b->rows.count - 1].error = largest(error);
    }
    return res;
}

/* A sum that keeps the compiler from leaving work out. */
static volatile double kept;

static enum pell_result time_evaluation(struct profiles *b, enum pell_profile_model model)
{
    const char *title = pell_profile_model_at(model)->name;
    char one[96], many[96];
    enum pell_result res = PELL_OK;
    struct row *r;
    double scalar;

    if (pell_profile_make(model, &b->marble->medium, 1, NULL, &b->model) != PELL_OK)
        return PELL_ERR_INVALID;
    snprintf(one, sizeof(one), "R(r) of %s, one by one", title);
    snprintf(many, sizeof(many), "R(r) of %s, vectorised", title);
    for (int i = 0; i < b->repeats && res == PELL_OK; i++) {
        const double begin = pell_seconds();
        double sum = 0.0;
        for (int k = 0; k < RADII; k++)
            sum += pell_profile_eval(&b->model, b->r[k]);
        kept = sum;
        b->ms[i] = 1e3 * (pell_seconds() - begin);
        res = goes_on(b, res);
    }
    scalar = bench_median(b->ms, b->repeats);
    add(b, one, scalar, NULL);
    b->rows.items[b->rows.count - 1].items = RADII;
    for (int i = 0; i < b->repeats && res == PELL_OK; i++) {
        const double begin = pell_seconds();
        pell_profile_eval_many(&b->model, b->r, b->R, RADII);
        kept = b->R[RADII / 2];
        b->ms[i] = 1e3 * (pell_seconds() - begin);
        res = goes_on(b, res);
    }
    r = bench_add(&b->rows, many, bench_median(b->ms, b->repeats));
    if (r && scalar > 0.0) {
        r->ratio = r->ms / scalar;
        r->against = "one by one";
        r->items = RADII;
    }
    return res;
}

static enum pell_result measure(struct cli *cli, struct profiles *b)
{
    enum pell_result res = PELL_OK;

    for (int i = 0; i < RADII; i++)
        b->r[i] = 1e-3 * pow(1e5, (i * 1597 % RADII) / (RADII - 1.0)); /* in no order */
    for (int c = 0; c < 3 && res == PELL_OK; c++)
        res = pell_profile_make(PELL_PROFILE_DIPOLE, &b->marble->medium, c, NULL, &b->marble_profile[c]);
    PELL_TRY(res);
    PELL_TRY(time_appendix_a(b));
    PELL_TRY(time_fit(b, 4, true, "fit of 4 Gaussians, RGB, shared"));
    PELL_TRY(time_fit(b, 6, true, "fit of 6 Gaussians, RGB, shared"));
    PELL_TRY(time_fit(b, 6, false, "fit of 6 Gaussians, RGB, own"));
    if (b->skin)
        PELL_TRY(time_layers(cli, b));
    for (int i = 0; i < PELL_PROFILE_MODELS; i++)
        if (pell_profile_model_at((enum pell_profile_model) i))
            PELL_TRY(time_evaluation(b, (enum pell_profile_model) i));

fail:
    return res;
}

static enum exit_code answer(struct cli *cli, const struct profiles *b)
{
    char device[160], build[64];

    cli_device_name(device, sizeof(device));
    snprintf(build, sizeof(build), "%s, SIMD level %s", pell_version(), pell_simd_name(pell_simd_best()));
    if (cli->json)
        return cli_print_json(cli, json_pack("{s:s,s:s,s:s,s:i,s:s,s:i,s:o}", "bench", "profiles", "engine", "cpu", "device", device,
                                             "threads", 1, "build", build, "repeats", b->repeats, "rows", bench_json(&b->rows)));
    printf("profiles: one thread, %s\npellucid %s\nmedians of %d runs; marble, and %s at %d radii\n\n", device, build, b->repeats,
           b->skin ? b->skin->name : "no layers", BENCH_LAYERS_RADII);
    printf("%-44s %10s %9s %9s  %s\n", "row", "ms", "ns each", "error %", "ratio");
    for (size_t i = 0; i < b->rows.count; i++) {
        const struct row *r = &b->rows.items[i];
        printf("%-44s %10.4f ", r->name, r->ms);
        if (r->items)
            printf("%9.2f ", 1e6 * r->ms / (double) r->items);
        else
            printf("%9s ", "");
        if (isfinite(r->error))
            printf("%9.3g  ", 100.0 * r->error);
        else
            printf("%9s  ", "");
        if (r->against)
            printf("%.3g x %s", r->ratio, r->against);
        putchar('\n');
    }
    return EXIT_OK;
}

enum exit_code bench_profiles(struct cli *cli)
{
    struct profiles *b = calloc(1, sizeof(*b));
    enum exit_code code = EXIT_MEMORY;

    if (b)
        b->ms = calloc((size_t) cli->numbers.repeats, sizeof(*b->ms));
    if (b && b->ms) {
        enum pell_result res;
        b->ctx = cli->ctx;
        b->repeats = cli->numbers.repeats;
        b->marble = pell_material_find("marble");
        b->skin = pell_material_find("skin-3layer");
        res = b->marble ? measure(cli, b) : PELL_ERR_UNSUPPORTED;
        if (res != PELL_OK && res != PELL_ERR_CANCELLED && res != PELL_ERR_NOMEM)
            res = pell_error(cli->ctx, res, "bench profiles", NULL, "can't be measured: %s", pell_result_name(res));
        code = cli_failed(cli, res);
    }
    if (code == EXIT_OK)
        code = answer(cli, b);
    if (b)
        free(b->ms);
    free(b);
    return code;
}
