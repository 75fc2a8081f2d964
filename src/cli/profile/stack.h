/* SPDX-License-Identifier: MIT
 *
 * stack.h - profiles of a layer stack, by any of the solvers. */
#ifndef PELL_CLI_PROFILE_STACK_H
#define PELL_CLI_PROFILE_STACK_H

#include "base/base.h"

#include <pellucid/material.h>
#include <pellucid/profile.h>

enum stack_solver {
    STACK_HANKEL,    /* pell_stack_profile: closed forms per frequency, one discrete Hankel transform back */
    STACK_GAUSSIANS, /* pell_stack_gaussians: polynomials of one narrow Gaussian; no transform */
    STACK_ANALYTIC,  /* the same with `analytic`: from the closed-form pole fits of d'Eon et al. 2007, appendix A */
    STACK_SOLVERS,
};

extern const char *const stack_solver_names[]; /* "hankel", "gaussian", "analytic", NULL */

/* Describes the flags of pellucid/layers.h, or NULL. */
const char *stack_warning(unsigned flags);

struct stack_problem {
    const char *where; /* for messages */
    const struct pell_material_layers *layers;
    double eta_above, eta_below, roughness; /* of the top boundary; an index of 0 means 1 */
    enum stack_solver solver;
    int channel;
};

/* Computes R and, for a stack with a bottom, T (may be NULL). Errors are logged. */
PELL_NODISCARD enum pell_result stack_solve(struct pell_context *ctx, const struct stack_problem *q, struct pell_profile *R,
                                            struct pell_profile *T, unsigned *flags);

#endif
