/* SPDX-License-Identifier: MIT
 *
 * medium.c - the ranges of optical coefficients, and lengths derived from them. */
#include "optics/medium/range.h"

#include <math.h>

bool pell_medium_valid(const struct pell_medium *m, struct pell_medium_fault *fault)
{
    static const char *const names[4][3] = {
        { "sigma_a[0]", "sigma_a[1]", "sigma_a[2]" },
        { "sigma_s_reduced[0]", "sigma_s_reduced[1]", "sigma_s_reduced[2]" },
        { "sigma_a[0] + sigma_s_reduced[0]", "sigma_a[1] + sigma_s_reduced[1]", "sigma_a[2] + sigma_s_reduced[2]" },
        { "g[0]", "g[1]", "g[2]" },
    };

    if (fault)
        *fault = (struct pell_medium_fault) { 0 };
    for (int c = 0; c < 3; c++)
        if (!pell_in_range(names[0][c], m->sigma_a[c], 0.0, PELL_SIGMA_MAX, fault) ||
            !pell_in_range(names[1][c], m->sigma_s_reduced[c], 0.0, PELL_SIGMA_MAX, fault) ||
            !pell_in_range(names[2][c], m->sigma_a[c] + m->sigma_s_reduced[c], PELL_SIGMA_T_MIN, 2.0 * PELL_SIGMA_MAX, fault) ||
            !pell_in_range(names[3][c], m->g[c], -PELL_G_MAX, PELL_G_MAX, fault))
            return false;
    return pell_in_range("eta", m->eta, PELL_ETA_MIN, PELL_ETA_MAX, fault);
}

double pell_mean_free_path(const struct pell_medium *m, int channel)
{
    const double sigma_t = m->sigma_a[channel] + m->sigma_s_reduced[channel];
    return sigma_t > 0.0 ? 1.0 / sigma_t : INFINITY;
}

double pell_diffuse_mean_free_path(const struct pell_medium *m, int channel)
{
    const double sigma_t = m->sigma_a[channel] + m->sigma_s_reduced[channel];
    const double sigma_tr = sqrt(3.0 * m->sigma_a[channel] * sigma_t);
    return sigma_tr > 0.0 ? 1.0 / sigma_tr : INFINITY;
}
