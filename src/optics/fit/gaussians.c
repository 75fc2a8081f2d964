/* SPDX-License-Identifier: MIT
 *
 * gaussians.c - evaluating sums of Gaussians, d'Eon, Luebke, Enderton 2007, eqs. (6) and (7). */
#include <pellucid/gaussians.h>

#include "math/vec.h"

#include <math.h>

double pell_gaussians_eval(const struct pell_gaussians *g, int channel, double r_mm)
{
    double sum = 0.0;
    for (int i = 0; i < g->count; i++)
        if (g->weight[i][channel] != 0.0)
            sum += g->weight[i][channel] * exp(-0.5 * r_mm * r_mm / g->variance[i]) / (2.0 * PELL_PI * g->variance[i]);
    return sum;
}

double pell_gaussians_total(const struct pell_gaussians *g, int channel)
{
    double sum = 0.0;
    for (int i = 0; i < g->count; i++)
        sum += g->weight[i][channel];
    return sum;
}
