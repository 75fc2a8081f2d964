/* SPDX-License-Identifier: MIT
 *
 * levels.c - the scattering level at which blurs have their size in mm, and weights that blend partial sums of Gaussians.
 */
#include "methods/screen_space/screen_space.h"

#include <math.h>

double pell_ss_level(double focal_px, double height_mm)
{
    return 3.0 / sqrt(1.08) * focal_px / height_mm;
}

void pell_ss_blend(const struct pell_gaussians *g, int i, float blend[3])
{
    for (int c = 0; c < 3; c++) {
        double sum = 0.0;
        for (int j = 0; j <= i; j++)
            sum += g->weight[j][c];
        blend[c] = sum > 0.0 ? (float) (g->weight[i][c] / sum) : 1.0f;
    }
}
