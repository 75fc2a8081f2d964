/* SPDX-License-Identifier: MIT
 * profiles.c - sums of Gaussians: as published, white, and as transmission by thickness. */
#include "methods/screen_space/screen_space.h"

#include "base/base.h"

#include <math.h>
#include <string.h>

void pell_ss_whiten(struct pell_gaussians *g)
{
    if (g->count == 0) { /* nothing scatters: light stays where it is */
        *g = (struct pell_gaussians) { .count = 1, .variance = { 1e-9 } };
    }
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

double pell_ss_transmission(const void *gaussians, int channel, double d)
{
    const struct pell_gaussians *g = gaussians;
    double sum = 0.0;

    for (int i = 0; i < g->count; i++)
        sum += g->weight[i][channel] * exp(-d * d / (2.0 * g->variance[i]));
    return sum;
}
