/* SPDX-License-Identifier: MIT
 * bench_layers.c - times of the solvers of layers. */
#include "cli/bench_layers.h"

#include <pellucid/layers.h>

#include <math.h>
#include <stdlib.h>

/* One channel; into `sets`, or `R` at radii. */
static enum pell_result solve(const struct pell_stack *stack, int c, enum stack_solver solver, const double *r, double *R,
                              void *workspace, size_t size, struct pell_stack_sets *sets)
{
    double *const out[PELL_STACK_PARTS] = { R, NULL, NULL, NULL };

    if (solver == STACK_HANKEL)
        return pell_stack_hankel(stack, c, r, BENCH_LAYERS_RADII, out, NULL);
    return pell_stack_gaussians(
        stack, c, &(struct pell_stack_gaussians_params){ .analytic = solver == STACK_ANALYTIC, .reflectance_only = true }, workspace,
        size, sets);
}

enum pell_result bench_layers(struct pell_context *ctx, const struct pell_material_layers *layers, enum stack_solver solver, int repeats,
                              double *ms, struct pell_profile out[3])
{
    const size_t size = pell_stack_workspace_size(&(struct pell_stack_gaussians_params){ .reflectance_only = true });
    struct pell_stack *stack = calloc(1, sizeof(*stack));
    struct pell_stack_sets *sets = malloc(sizeof(*sets));
    void *workspace = malloc(size);
    double r[BENCH_LAYERS_RADII], R[BENCH_LAYERS_RADII];
    enum pell_result res = stack && sets && workspace ? PELL_OK : PELL_ERR_NOMEM;

    for (int i = 0; i < BENCH_LAYERS_RADII; i++)
        r[i] = 1e-2 * pow(1e4, i / (BENCH_LAYERS_RADII - 1.0));
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
        if (solver == STACK_HANKEL) {
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
