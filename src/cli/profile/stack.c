/* SPDX-License-Identifier: MIT
 * stack.c - profiles of layer stacks by three solvers, interpolated between nodes. */
#include "cli/profile/stack.h"

#include <pellucid/layers.h>

#include <stdlib.h>

const char *const stack_solver_names[] = { [STACK_HANKEL] = "hankel", [STACK_GAUSSIANS] = "gaussian", [STACK_ANALYTIC] = "analytic", NULL };

const char *stack_warning(unsigned flags)
{
    if (flags & PELL_STACK_CLEAR)
        return "a layer is so thin relative to its mean free path that diffusion is not valid: light passes straight through it";
    if (flags & PELL_STACK_THIN)
        return "a layer is thinner than its mean free path, where diffusion is not exact: its closed form is used";
    if (flags & PELL_STACK_WIDENED)
        return "the core of T(r) is narrower than the solver resolves; its total is correct";
    return NULL;
}

static enum pell_result by_hankel(const struct pell_stack *stack, int c, struct pell_profile *R, struct pell_profile *T)
{
    enum pell_result res = pell_stack_profile(stack, c, PELL_STACK_R_PLUS, R, NULL);

    if (res == PELL_OK && T)
        res = pell_stack_profile(stack, c, PELL_STACK_T_PLUS, T, NULL);
    return res;
}

static enum pell_result by_gaussians(const struct pell_stack *stack, int c, bool analytic, struct pell_profile *R, struct pell_profile *T)
{
    const struct pell_stack_gaussians_params params = { .analytic = analytic };
    const size_t size = pell_stack_workspace_size(&params);
    struct pell_stack_sets *sets = malloc(sizeof(*sets));
    void *workspace = malloc(size);
    enum pell_result res = sets && workspace ? PELL_OK : PELL_ERR_NOMEM;

    if (res == PELL_OK)
        res = pell_stack_gaussians(stack, c, &params, workspace, size, sets);
    if (res == PELL_OK)
        res = pell_stack_sets_profile(sets, PELL_STACK_R_PLUS, R);
    if (res == PELL_OK && T)
        res = pell_stack_sets_profile(sets, PELL_STACK_T_PLUS, T);
    free(workspace);
    free(sets);
    return res;
}

static enum pell_result solve(const struct pell_stack *stack, int c, enum stack_solver solver, struct pell_profile *R,
                              struct pell_profile *T, unsigned *flags)
{
    double totals[PELL_STACK_PARTS];
    enum pell_result res = pell_stack_totals(stack, c, totals, flags);

    if (res == PELL_OK)
        res = solver == STACK_HANKEL ? by_hankel(stack, c, R, T) : by_gaussians(stack, c, solver == STACK_ANALYTIC, R, T);
    return res;
}

static enum pell_result failed(struct pell_context *ctx, const struct stack_problem *q, const struct pell_stack *stack,
                               enum pell_result res)
{
    struct pell_stack_fault fault;

    if (res == PELL_ERR_NOMEM)
        return res;
    if (pell_stack_valid(stack, &fault))
        return pell_error(ctx, res, q->where, NULL, "its layers can't be solved by %s (%s)", stack_solver_names[q->solver],
                          pell_result_name(res));
    if (fault.layer < 0)
        return pell_error(ctx, res, q->where, NULL, "%s is %g, allowed: [%g, %g]", fault.field, fault.value, fault.min, fault.max);
    return pell_error(ctx, res, q->where, NULL, "layer %d: %s is %g, allowed: [%g, %g]", fault.layer, fault.field, fault.value, fault.min,
                      fault.max);
}

enum pell_result stack_solve(struct pell_context *ctx, const struct stack_problem *q, struct pell_profile *R, struct pell_profile *T,
                             unsigned *flags)
{
    struct pell_stack *stack = calloc(1, sizeof(*stack));
    enum pell_result res = stack ? PELL_OK : PELL_ERR_NOMEM;

    if (res == PELL_OK) {
        pell_material_stack(q->layers, stack);
        stack->eta_above = q->eta_above;
        stack->eta_below = q->eta_below;
        stack->roughness[0] = q->roughness;
        res = solve(stack, q->channel, q->solver, R, T, flags);
        if (res != PELL_OK)
            res = failed(ctx, q, stack, res);
    }
    free(stack);
    return res;
}
