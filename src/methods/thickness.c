/* SPDX-License-Identifier: MIT
 *
 * thickness.c - see thickness.h.
 *
 * Between parallel faces a slab transmits the diffuse light given by transport theory (pell_slab_at), including reflection at the far face
 * and excluding unscattered light. Between other faces the half-space profile is used: Int R(sqrt(r^2 + d^2)) over the plane at d.
 */
#include "methods/thickness.h"

#include "base/base.h"

#include <pellucid/layers.h>

#include <math.h>
#include <string.h>

#define LEAST 1e-4   /* relative to a channel's maximum: end of a table */
#define FARTHEST 1e6 /* mm */

bool pell_slabs_make(const struct pell_frame_material *m, struct pell_slab slab[3])
{
    bool made = m->gaussians.count == 0 || m->stack;

    for (int c = 0; c < 3 && made && m->stack; c++)
        made = pell_slab_make_layers(m->stack, c, &slab[c]);
    for (int c = 0; c < 3 && made && !m->stack; c++)
        made = m->medium.sigma_a[c] + m->medium.sigma_s_reduced[c] > 0.0 && pell_slab_make(&m->medium, c, &slab[c]);
    return made;
}

static bool alike(const struct pell_frame_material *a, const struct pell_frame_material *b)
{
    return a->profile == b->profile && a->white == b->white && a->strength == b->strength &&
           (a->stack == b->stack || (a->stack && b->stack && memcmp(a->stack, b->stack, sizeof(*a->stack)) == 0)) &&
           memcmp(&a->medium, &b->medium, sizeof(a->medium)) == 0 && memcmp(&a->gaussians, &b->gaussians, sizeof(a->gaussians)) == 0;
}

size_t pell_first_alike(const struct pell_frame_shape *shape, size_t i)
{
    size_t k = 0;

    while (k < i && !alike(&shape->materials[k], &shape->materials[i]))
        k++;
    return k;
}

struct slabs {
    struct pell_slab slab[3];
    double over[3]; /* divisor of the transmittance */
};

static double slab(const void *of, int channel, double d)
{
    const struct slabs *s = of;

    return s->over[channel] > 0.0 ? pell_slab_at(&s->slab[channel], d).transmitted / s->over[channel] : 0.0;
}

void pell_slab_medium(const struct pell_frame_material *m, double d, struct pell_medium *out)
{
    double top = 0.0;

    *out = m->medium;
    if (!m->stack)
        return;
    *out = (struct pell_medium) { .eta = m->stack->layer[0].eta };
    for (int i = 0; i < m->stack->count; i++) {
        const struct pell_medium_layer *l = &m->stack->layer[i];
        const double end = i + 1 < m->stack->count ? fmin(top + l->thickness, 0.5 * d) : 0.5 * d;
        const double fraction = d > 0.0 ? fmax(end - top, 0.0) / (0.5 * d) : (double) (i == 0);
        for (int c = 0; c < 3; c++) {
            out->sigma_a[c] += fraction * l->sigma_a[c];
            out->sigma_s_reduced[c] += fraction * l->sigma_s_reduced[c];
            out->g[c] += fraction * l->g[c];
        }
        top += l->thickness;
    }
}

/* Lateral spread of the light that a slab transmits, mm^2. */
static double spread(const void *of, int channel, double d)
{
    struct pell_medium medium;

    pell_slab_medium(of, d, &medium);
    return pell_slab_spread(&medium, channel, d);
}

/* Thickness where every channel is below LEAST of its maximum, which a slab has at about one mean free path. */
static double end_of(pell_thickness_fn *f, const void *of)
{
    double far = 0.0;

    for (int c = 0; c < 3; c++) {
        double most = f(of, c, 0.0), low = 0.0, high = 1e-6, least;
        for (double d = high; d < FARTHEST; d *= 2.0)
            if (f(of, c, d) > most) {
                most = f(of, c, d);
                low = d;
            }
        least = LEAST * most;
        if (!(least > 0.0))
            continue;
        for (high = fmax(2.0 * low, high); high < FARTHEST && f(of, c, high) > least; high *= 2.0)
            low = high;
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
            const double root = (double) i / (PELL_THICKNESS_STEPS - 1); /* of the relative thickness */
            value[i][c] = (float) f(of, c, max_mm * root * root);
        }
}

double pell_thickness_beyond(const void *material, int channel, double d)
{
    const struct pell_frame_material *m = material;
    const struct pell_profile *p = &m->profile[channel];

    return (m->white ? 1.0 : pell_profile_total(p)) * (1.0 - pell_profile_cdf(p, d));
}

void pell_thickness_table_make(const struct pell_frame_material *m, pell_thickness_fn *through, const void *of, bool with_slab,
                               double scale, struct pell_thickness_table *t)
{
    struct slabs slabs;
    const bool has_slab = with_slab && pell_slabs_make(m, slabs.slab);
    double end;

    for (int c = 0; c < 3; c++)
        slabs.over[c] = m->white ? pell_profile_total(&m->profile[c]) : 1.0;
    end = scale > 0.0 ? fmax(end_of(through, of), has_slab ? end_of(slab, &slabs) : 0.0) : 0.0;

    memset(t, 0, sizeof(*t));
    t->max_mm = (float) fmax(scale * end, 1e-6);
    if (!(end > 0.0))
        return;
    fill(through, of, end, t->value);
    memcpy(t->slab, t->value, sizeof(t->slab));
    if (!has_slab)
        return;
    fill(slab, &slabs, end, t->slab);
    fill(spread, m, end, t->spread);
    for (int i = 0; i < PELL_THICKNESS_STEPS; i++)
        for (int c = 0; c < 3; c++)
            t->spread[i][c] *= (float) (scale * scale);
}
