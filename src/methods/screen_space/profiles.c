/* SPDX-License-Identifier: MIT
 * profiles.c - sums of Gaussians: as published, white, and as transmission over thickness. */
#include "methods/screen_space/screen_space.h"

#include "base/base.h"

#include <math.h>
#include <string.h>

void pell_ss_whiten(struct pell_gaussians *g)
{
    for (int c = 0; c < 3; c++) {
        double sum = 0.0;
        for (int i = 0; i < g->count; i++)
            sum += g->weight[i][c];
        for (int i = 0; i < g->count; i++)
            g->weight[i][c] = sum > 0.0 ? g->weight[i][c] / sum : (i == 0 ? 1.0 : 0.0);
    }
}

static bool same_gaussians(const struct pell_gaussians *a, const struct pell_gaussians *b)
{
    bool same = a->count == b->count;

    for (int i = 0; same && i < a->count; i++)
        same = a->variance[i] == b->variance[i] && memcmp(a->weight[i], b->weight[i], sizeof(a->weight[i])) == 0;
    return same;
}

const struct pell_material_entry *pell_ss_published(const struct pell_frame_material *m)
{
    static const char *const sets[][2] = {
        { "skin", "skin-4gaussian" },
        { "skin-6gaussian", "skin-4gaussian" },
        { "skin-3layer", "skin-4gaussian" },
        { "marble", "marble-4gaussian" },
    };

    for (size_t i = 0; i < PELL_COUNT(sets) && m->preset; i++)
        if (strcmp(m->preset, sets[i][0]) == 0 && same_gaussians(&m->gaussians, &pell_material_find(m->preset)->gaussians))
            return pell_material_find(sets[i][1]);
    return NULL;
}

/* Sum_i w_i exp(-d^2 / (2 v_i)) of a channel, as a share of nothing: with w_i, so at most the channel's total. */
static double transmission(const struct pell_gaussians *g, int channel, double scale2, double d)
{
    double sum = 0.0;

    for (int i = 0; i < g->count; i++)
        sum += g->weight[i][channel] * exp(-d * d / (2.0 * scale2 * g->variance[i]));
    return sum;
}

void pell_ss_thickness(const struct pell_gaussians *g, double scale2, struct pell_thickness_table *t)
{
    double far = 0.0;

    for (int c = 0; c < 3; c++) {
        const double total = pell_gaussians_total(g, c);
        /* The widest Gaussian bounds the sum, so it is under 1e-4 of the total there. */
        double low = 0.0, high = g->count > 0 ? sqrt(2.0 * scale2 * g->variance[g->count - 1] * log(1e4)) : 0.0;
        for (int i = 0; total > 0.0 && i < 60; i++) {
            const double mid = 0.5 * (low + high);
            if (transmission(g, c, scale2, mid) > 1e-4 * total)
                low = mid;
            else
                high = mid;
        }
        if (total > 0.0 && high > far)
            far = high;
    }
    t->max_mm = (float) (far > 0.0 ? far : 1e-6);
    for (int i = 0; i < PELL_THICKNESS_STEPS; i++) {
        const double f = (double) i / (PELL_THICKNESS_STEPS - 1), d = (double) t->max_mm * f * f;
        for (int c = 0; c < 3; c++)
            t->value[i][c] = scale2 > 0.0 ? (float) transmission(g, c, scale2, d) : 0.0f;
    }
}
