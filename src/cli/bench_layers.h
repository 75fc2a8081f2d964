/* SPDX-License-Identifier: MIT
 *
 * bench_layers.h - times of the solvers of layers. */
#ifndef PELL_CLI_BENCH_LAYERS_H
#define PELL_CLI_BENCH_LAYERS_H

#include "base/base.h"
#include "cli/profile/stack.h"

#include <pellucid/material.h>
#include <pellucid/profile.h>

enum { BENCH_LAYERS_RADII = 64 };

/* Milliseconds of R for the three channels by one of the solvers, a time for each of `repeats` runs: Hankel at
 * BENCH_LAYERS_RADII radii, the others to a sum of Gaussians for any radius. `out`: what it gave, to compare. */
PELL_NODISCARD enum pell_result bench_layers(struct pell_context *ctx, const struct pell_material_layers *layers, enum stack_solver solver,
                                             int repeats, double *ms, struct pell_profile out[3]);

#endif
