/* SPDX-License-Identifier: MIT
 *
 * profile.c - radial profiles behind one interface: models as rows, kinds as shapes. */
#include <pellucid/profile.h>

#include "base/simd.h"
#include "math/vec.h"
#include "optics/profile/kernels.h"
#include "optics/profile/lanes.h"
#include "optics/profile/shape.h"

/* --- Models ---------------------------------------------------------------------------------------------------------------------- */

static const struct pell_profile_source *const sources[PELL_PROFILE_MODELS] = {
    [PELL_PROFILE_DIPOLE] = &pell_profile_source_dipole,
    [PELL_PROFILE_BETTER_DIPOLE] = &pell_profile_source_better_dipole,
    [PELL_PROFILE_NORMALIZED_DIFFUSION] = &pell_profile_source_normalized_diffusion,
    [PELL_PROFILE_PHOTON_BEAM] = &pell_profile_source_photon_beam,
    [PELL_PROFILE_MONTE_CARLO] = &pell_profile_source_monte_carlo,
};

size_t pell_profile_model_count(void)
{
    return PELL_PROFILE_MODELS;
}

const struct pell_profile_model_row *pell_profile_model_at(size_t index)
{
    return index < PELL_PROFILE_MODELS ? &sources[index]->row : NULL;
}

bool pell_profile_model_find(const char *name, enum pell_profile_model *out)
{
    for (int i = 0; i < PELL_PROFILE_MODELS; i++) {
        if (sources[i] && strcmp(sources[i]->row.name, name) == 0) {
            *out = (enum pell_profile_model) i;
            return true;
        }
    }
    return false;
}

enum pell_result pell_profile_make(enum pell_profile_model model, const struct pell_medium *medium, int channel,
                                   const struct pell_profile_params *params, struct pell_profile *out)
{
    if (!medium || !out)
        return PELL_ERR_INVALID;

    const struct pell_profile_params none = { 0 };
    const struct pell_profile_params *p = params ? params : &none;
    enum pell_result res;

    memset(out, 0, sizeof(*out));
    if (channel < 0 || channel > 2 || !pell_medium_valid(medium, NULL) || !pell_profile_model_at((size_t) model))
        return PELL_ERR_INVALID;
    if ((int) p->fresnel < PELL_FRESNEL_EXACT || (int) p->fresnel > PELL_FRESNEL_POLY4 || !(p->roughness >= 0.0 && p->roughness <= 1.0) ||
        !(p->A >= 0.0 && p->A <= PELL_PROFILE_A_MAX))
        return PELL_ERR_INVALID;
    res = sources[model]->make(medium, channel, p, out);
    if (res != PELL_OK)
        memset(out, 0, sizeof(*out));
    pell_profile_drop_traces(out);
    return res;
}

/* --- Values ---------------------------------------------------------------------------------------------------------------------- */

double pell_profile_eval(const struct pell_profile *p, double r_mm)
{
    double r;

    if (!(p->total > 0.0))
        return 0.0;
    switch ((enum pell_profile_kind) p->kind) {
    case PELL_PROFILE_KIND_POLES: return lanes_pair(p->parameter, r_mm);
    case PELL_PROFILE_KIND_BURLEY: return lanes_burley(p->parameter, r_mm);
    case PELL_PROFILE_KIND_GAUSSIANS: return lanes_gaussians(p->parameter, (int) p->parameter[0], r_mm);
    case PELL_PROFILE_KIND_NODES: r = lanes_radius(r_mm); return r > p->r[p->count - 1] ? lanes_tail(p, r) : lanes_nodes(p, r);
    case PELL_PROFILE_KINDS: break;
    }
    return 0.0;
}

PELL_SIMD_TABLES(struct pell_profile_kernels, pell_profile_kernels);

const struct pell_profile_kernels *pell_profile_kernels_best(void)
{
    return pell_profile_kernels_tables[pell_simd_best()];
}

void pell_profile_eval_many(const struct pell_profile *p, const double *r_mm, double *R, size_t count)
{
    if (!(p->total > 0.0)) {
        for (size_t i = 0; i < count; i++)
            R[i] = 0.0;
    } else if (count < 8) { /* no more than finding the level costs */
        for (size_t i = 0; i < count; i++)
            R[i] = pell_profile_eval(p, r_mm[i]);
    } else {
        pell_profile_kernels_best()->of_kind[p->kind](p, r_mm, R, count);
    }
}

static const struct pell_profile_shape *shape_of(const struct pell_profile *p)
{
    static const struct pell_profile_shape *const shapes[PELL_PROFILE_KINDS] = {
        [PELL_PROFILE_KIND_POLES] = &pell_profile_pair,
        [PELL_PROFILE_KIND_BURLEY] = &pell_profile_burley,
        [PELL_PROFILE_KIND_GAUSSIANS] = &pell_profile_gaussians,
        [PELL_PROFILE_KIND_NODES] = &pell_profile_nodes,
    };
    return shapes[p->kind];
}

double pell_profile_total(const struct pell_profile *p)
{
    return p->total;
}

double pell_profile_cdf(const struct pell_profile *p, double r_mm)
{
    if (!(p->total > 0.0))
        return 1.0;
    return fmin(1.0, shape_of(p)->inside(p, lanes_radius(r_mm)) / p->total);
}

double pell_profile_pdf(const struct pell_profile *p, double r_mm)
{
    return p->total > 0.0 ? pell_profile_eval(p, r_mm) / p->total : 0.0;
}

double pell_profile_transform(const struct pell_profile *p, double s)
{
    const double at = lanes_radius(s);
    return p->total > 0.0 && at < LANES_RADIUS_MAX ? shape_of(p)->transform(p, at) : 0.0;
}

/* --- Sampling -------------------------------------------------------------------------------------------------------------------- */

/* Solves inside(r) = xi total, or outside(r) = (1 - xi) total for the outer half, by Newton's method on their logarithms over log r (both
 * are nearly straight at the ends: powers of r), within a bracket that shrinks with every step. */
double pell_profile_sample(const struct pell_profile *p, double xi)
{
    const struct pell_profile_shape *shape = shape_of(p);
    const double u = xi > 0.0 ? (xi < 1.0 ? xi : 1.0 - 0x1p-53) : 0.0;
    const bool outer = u > 0.5;
    const double target = (outer ? 1.0 - u : u) * p->total;
    double low = 0.0, high = LANES_RADIUS_MAX, last_miss = INFINITY, r;

    if (!(p->total > 0.0) || u == 0.0)
        return 0.0;
    r = shape->scale(p);
    for (int i = 0; i < 400; i++) {
        const double flux = outer ? shape->outside(p, r) : shape->inside(p, r);
        const double density = 2.0 * PELL_PI * r * r * pell_profile_eval(p, r);
        const double miss = flux > 0.0 ? log(target / flux) : INFINITY;
        const bool close = fabs(miss) < 1e-8; /* only one more Newton step is needed, or rounding of the flux limits accuracy */
        double next = -1.0;

        if ((miss > 0.0) != outer)
            low = r;
        else
            high = r;
        if (density > 0.0 && flux > 0.0 && (close || fabs(miss) < 0.5 * last_miss))
            next = r * exp((outer ? -miss : miss) * (flux / density)); /* log flux falls (outer) or rises by density/flux for log r */
        if (close)
            return next > 0.0 && fabs(next - r) < 1e-6 * r ? next : r;
        last_miss = fabs(miss);
        if (!(next > low && next < high))
            next = low == 0.0                 ? 0.125 * high
                   : high >= LANES_RADIUS_MAX ? 8.0 * low
                   : high > 4.0 * low         ? sqrt(low * high)
                                              : 0.5 * (low + high);
        if (!(next > low && next < high))
            return r;
        r = next;
    }
    return r;
}

double pell_profile_mean_radius(const struct pell_profile *p)
{
    enum { RADII = 256 };
    double sum = 0.0;

    for (int i = 0; i < RADII; i++)
        sum += pell_profile_sample(p, (i + 0.5) / RADII);
    return sum / RADII;
}
