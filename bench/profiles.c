/* SPDX-License-Identifier: MIT
 * profiles.c - `pellucid-bench profiles`: times of fits, of layers and of R(r), each next to the time that it is compared with. */
#include "papers.h"

#include <pellucid/layers.h>
#include <pellucid/material.h>

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { RADII = 4096, LAYER_RADII = 64 };
enum stack_solver { HANKEL, GAUSSIANS, ANALYTIC, SOLVERS };

struct profiles {
    const struct pell_context *ctx;
    struct rows *rows;
    const struct pell_material_entry *marble, *skin;
    struct pell_profile marble_profile[3], by_solver[SOLVERS][3], model;
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
    struct row *r = bench_add(b->rows, name, ms);

    for (size_t i = 0; r && against && i < b->rows->count; i++)
        if (strcmp(b->rows->items[i].name, against) == 0 && b->rows->items[i].ms > 0.0) {
            r->ratio = ms / b->rows->items[i].ms;
            r->against = against;
        }
}

static double largest(const double error[3])
{
    return fmax(error[0], fmax(error[1], error[2]));
}

/* d'Eon et al. 2007, appendix A: eight Gaussians per channel, no iteration. Repeated many times, as one run is shorter than the clock's
 * resolution. */
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
    b->rows->items[b->rows->count - 1].error = largest(error);
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
    b->rows->items[b->rows->count - 1].error = largest(shared ? report.error : error);
    return res;
}

/* One channel; into `sets`, or `R` at radii. */
static enum pell_result solve(const struct pell_stack *stack, int c, enum stack_solver solver, const double *r, double *R, void *workspace,
                              size_t size, struct pell_stack_sets *sets)
{
    double *const out[PELL_STACK_PARTS] = { R, NULL, NULL, NULL };

    if (solver == HANKEL)
        return pell_stack_hankel(stack, c, r, LAYER_RADII, out, NULL);
    return pell_stack_gaussians(stack, c,
                                &(struct pell_stack_gaussians_params) { .analytic = solver == ANALYTIC, .reflectance_only = true },
                                workspace, size, sets);
}

/* Milliseconds for R of the three channels by one of the solvers: Hankel at LAYER_RADII radii, the others to a sum of Gaussians for any
 * radius. `out`: the result, to compare. */
static enum pell_result time_solver(const struct pell_context *ctx, const struct pell_material_layers *layers, enum stack_solver solver,
                                    int repeats, double *ms, struct pell_profile out[3])
{
    const size_t size = pell_stack_workspace_size(&(struct pell_stack_gaussians_params) { .reflectance_only = true });
    struct pell_stack *stack = calloc(1, sizeof(*stack));
    struct pell_stack_sets *sets = malloc(sizeof(*sets));
    void *workspace = malloc(size);
    double r[LAYER_RADII], R[LAYER_RADII];
    enum pell_result res = stack && sets && workspace ? PELL_OK : PELL_ERR_NOMEM;

    for (int i = 0; i < LAYER_RADII; i++)
        r[i] = 1e-2 * pow(1e4, i / (LAYER_RADII - 1.0));
    if (res == PELL_OK)
        pell_material_stack(layers, stack);
    for (int i = 0; i < repeats && res == PELL_OK; i++) {
        const double begin = pell_seconds();
        for (int c = 0; c < 3 && res == PELL_OK; c++)
            res = solve(stack, c, solver, r, R, workspace, size, sets);
        ms[i] = 1e3 * (pell_seconds() - begin);
        if (pell_cancelled(ctx))
            res = PELL_ERR_CANCELLED;
    }
    for (int c = 0; c < 3 && res == PELL_OK; c++) {
        if (solver == HANKEL) {
            res = pell_stack_profile(stack, c, PELL_STACK_R_PLUS, &out[c], NULL);
        } else {
            res = solve(stack, c, solver, r, R, workspace, size, sets);
            if (res == PELL_OK)
                res = pell_stack_sets_profile(sets, PELL_STACK_R_PLUS, &out[c]);
        }
    }
    free(workspace);
    free(sets);
    free(stack);
    return res;
}

/* Error (10) of d'Eon et al. 2007 of R, by M. */
static double distance(const struct pell_profile *R, const struct pell_profile *M)
{
    const double low = pell_profile_sample(M, 1e-3), high = 10.0 * pell_profile_sample(M, 0.9999);
    double numerator = 0.0, denominator = 0.0;

    for (int i = 0; i <= RADII; i++) {
        const double r = low * pow(high / low, (double) i / RADII), m = pell_profile_eval(M, r), d = pell_profile_eval(R, r) - m;
        numerator += r * r * d * d;
        denominator += r * r * m * m;
    }
    return sqrt(numerator / denominator);
}

static enum pell_result time_layers(struct profiles *b)
{
    static const char *const names[SOLVERS] = { "three layers, Hankel", "three layers, Gaussians", "three layers, analytic" };
    enum pell_result res = PELL_OK;

    for (int s = 0; s < SOLVERS && res == PELL_OK; s++) {
        double error[3];
        res = time_solver(b->ctx, &b->skin->layers, (enum stack_solver) s, b->repeats, b->ms, b->by_solver[s]);
        if (res != PELL_OK)
            break;
        add(b, names[s], bench_median(b->ms, b->repeats), s ? names[0] : NULL);
        for (int c = 0; c < 3; c++)
            error[c] = distance(&b->by_solver[s][c], &b->by_solver[0][c]);
        if (s)
            b->rows->items[b->rows->count - 1].error = largest(error);
    }
    return res;
}

/* A sum that prevents the compiler from eliminating the work. */
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
    b->rows->items[b->rows->count - 1].items = RADII;
    for (int i = 0; i < b->repeats && res == PELL_OK; i++) {
        const double begin = pell_seconds();
        pell_profile_eval_many(&b->model, b->r, b->R, RADII);
        kept = b->R[RADII / 2];
        b->ms[i] = 1e3 * (pell_seconds() - begin);
        res = goes_on(b, res);
    }
    r = bench_add(b->rows, many, bench_median(b->ms, b->repeats));
    if (r && scalar > 0.0) {
        r->ratio = r->ms / scalar;
        r->against = "one by one";
        r->items = RADII;
    }
    return res;
}

static enum pell_result measure(struct profiles *b)
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
        PELL_TRY(time_layers(b));
    for (int i = 0; i < PELL_PROFILE_MODELS; i++)
        if (pell_profile_model_at((size_t) i))
            PELL_TRY(time_evaluation(b, (enum pell_profile_model) i));

fail:
    return res;
}

enum pell_result bench_profiles(struct bench *bench)
{
    struct profiles *b = calloc(1, sizeof(*b));
    enum pell_result res = PELL_ERR_NOMEM;

    if (b)
        b->ms = calloc((size_t) bench->repeats, sizeof(*b->ms));
    if (b && b->ms) {
        b->ctx = bench->cli->ctx;
        b->rows = &bench->rows;
        b->repeats = bench->repeats;
        b->marble = pell_material_find("marble");
        b->skin = pell_material_find("skin-3layer");
        snprintf(bench->setup, sizeof(bench->setup), "one thread; medians of %d runs; marble, and %s at %d radii", b->repeats,
                 b->skin ? b->skin->name : "no layers", LAYER_RADII);
        res = b->marble ? measure(b) : PELL_ERR_UNSUPPORTED;
        if (res != PELL_OK && res != PELL_ERR_CANCELLED && res != PELL_ERR_NOMEM)
            res = pell_error(bench->cli->ctx, res, "profiles", NULL, "can't be measured: %s", pell_result_name(res));
    }
    if (b)
        free(b->ms);
    free(b);
    return res;
}
