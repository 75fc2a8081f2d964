/* SPDX-License-Identifier: MIT
 *
 * thickness.c - see thickness.h.
 *
 * Between parallel faces a slab transmits the total of its own T(r; d), which includes the light that the far face reflects (Donner and
 * Jensen 2005). Between others light goes as through the half-space: Int R(sqrt(r^2 + d^2)) over the plane at d.
 */
#include "methods/thickness.h"

#include "base/base.h"

#include <math.h>
#include <string.h>

#define LEAST 1e-4    /* of a channel's share at d = 0: where a table ends */
#define FARTHEST 1e6  /* mm */
#define THINNEST 1e-3 /* mm: a stack has no layer without thickness */

bool pell_has_slab(const struct pell_frame_material *m)
{
    bool scatters = m->gaussians.count == 0 && pell_medium_valid(&m->medium, NULL);

    for (int c = 0; c < 3; c++)
        scatters = scatters && m->medium.sigma_a[c] + m->medium.sigma_s_reduced[c] > 0.0;
    return scatters;
}

double pell_slab_transmittance(const struct pell_frame_material *m, int channel, double d)
{
    struct pell_stack stack;
    double out[PELL_STACK_PARTS];

    pell_stack_of_medium(&m->medium, d, &stack);
    return pell_stack_totals(&stack, channel, out, NULL) == PELL_OK ? fmax(out[PELL_STACK_T_PLUS], 0.0) : 0.0;
}

static double slab(const void *of, int channel, double d)
{
    const struct pell_frame_material *m = of;
    const double total = m->white ? pell_profile_total(&m->profile[channel]) : 1.0;

    return total > 0.0 ? pell_slab_transmittance(m, channel, fmax(d, THINNEST)) / total : 0.0;
}

/* Where no channel has more than LEAST of its share at 0. */
static double end_of(pell_thickness_fn *f, const void *of)
{
    double far = 0.0;

    for (int c = 0; c < 3; c++) {
        const double least = LEAST * f(of, c, 0.0);
        double low = 0.0, high = 1e-3;
        if (!(least > 0.0))
            continue;
        while (high < FARTHEST && f(of, c, high) > least) {
            low = high;
            high *= 2.0;
        }
        for (int i = 0; i < 50; i++) {
            const double middle = 0.5 * (low + high);
            if (f(of, c, middle) > least)
                low = middle;
            else
                high = middle;
        }
        far = fmax(far, high);
    }
    return far;
}

static void fill(pell_thickness_fn *f, const void *of, double max_mm, float value[PELL_THICKNESS_STEPS][3])
{
    for (int c = 0; c < 3; c++)
        for (int i = 0; i < PELL_THICKNESS_STEPS; i++) {
            const double place = (double) i / (PELL_THICKNESS_STEPS - 1);
            const float share = (float) f(of, c, max_mm * place * place);
            value[i][c] = i > 0 ? fminf(share, value[i - 1][c]) : share;
        }
}

void pell_thickness_table_make(const struct pell_frame_material *m, pell_thickness_fn *through, const void *of, bool with_slab,
                               double scale, struct pell_thickness_table *t)
{
    const bool has_slab = with_slab && pell_has_slab(m);
    const double end = scale > 0.0 ? fmax(end_of(through, of), has_slab ? end_of(slab, m) : 0.0) : 0.0;

    memset(t, 0, sizeof(*t));
    t->max_mm = (float) fmax(scale * end, 1e-6);
    if (!(end > 0.0))
        return;
    fill(through, of, end, t->value);
    if (has_slab)
        fill(slab, m, end, t->slab);
    else
        memcpy(t->slab, t->value, sizeof(t->slab));
}
