/* SPDX-License-Identifier: MIT
 *
 * profile.c - a material's chain of Gaussians, checked against the paper's conditions, and transmission by thickness.
 */
#include "methods/texture_space/texture_space.h"

#include "methods/thickness.h"
#include "optics/medium/forward.h"

#include <pellucid/layers.h>

#include <string.h>

#define MAX_RATIO 4.0         /* of the variances of successive blurs: section 5.1 */
#define MIN_TRANSMISSION 1e-5 /* relative to the total: thicker parts transmit nothing */
/* Relative to a half-space: where a sheet tapers, the map holds more light than its local thickness implies. */
#define MIN_RETURNED 0.3
#define TAPS_MIDDLE 0.15 /* fraction of the profile in the centre tap of thirteen, and together with the inner ring */
#define TAPS_INNER 0.7
#define MIN_SLAB 0.1 /* mm, lower end of the thickness tables */
#define MAX_SLAB 50.0

/* Normalises each channel's weights to 1. A channel without weights keeps its light in the narrowest Gaussian. */
static void whiten(struct pell_gaussians *g)
{
    for (int c = 0; c < 3; c++) {
        const double sum = pell_gaussians_total(g, c);
        for (int i = 0; i < g->count; i++)
            g->weight[i][c] = sum > 0.0 ? g->weight[i][c] / sum : (i == 0 ? 1.0 : 0.0);
    }
}

/* l_min^2, mm^2; INFINITY if the profile does not define it. */
static double narrowest(const struct pell_frame_material *m)
{
    double least = INFINITY;

    for (int c = 0; c < 3 && m->gaussians.count == 0 && pell_medium_valid(&m->medium, NULL); c++) {
        const double t = m->medium.sigma_a[c] + m->medium.sigma_s_reduced[c];
        if (m->medium.sigma_s_reduced[c] > 0.0)
            least = fmin(least, 1.0 / (t * t));
    }
    return least;
}

static void put(struct ts_profile *p, double variance, const double *weight)
{
    const int last = p->count - 1;

    if (p->count == TS_LEVELS)
        return;
    p->variance[p->count] = variance;
    p->gaussian[p->count] = last < 0 ? 1 : p->gaussian[last] + (p->inserted[last] == 0);
    p->inserted[p->count] = weight ? 0 : last < 0 ? 1 : p->inserted[last] + 1;
    for (int c = 0; c < 3; c++)
        p->weight[p->count][c] = weight ? weight[c] : 0.0;
    p->added += weight == NULL;
    p->count++;
}

/* Gaussian i is valid only if v_1 <= l_min^2 and v_i <= 4 v_(i-1). Inserts blurs without weight where that is violated. */
static void make_chain(const struct pell_gaussians *g, double narrow, struct ts_profile *p)
{
    const int room = (TS_LEVELS - g->count) / (g->count > 0 ? g->count : 1);

    for (int i = 0; i < g->count; i++) {
        const double before = i > 0 ? g->variance[i - 1] : fmin(narrow, g->variance[0]), ratio = g->variance[i] / before;
        int steps = ratio > MAX_RATIO * 1.0001 ? (int) ceil(log(ratio) / log(MAX_RATIO) - 1e-9) : 1;
        steps = steps - 1 < room ? steps : room + 1;
        if (i == 0 && ratio > 1.0001 && steps <= room)
            put(p, before, NULL);
        for (int k = 1; k < steps; k++)
            put(p, before * pow(ratio, (double) k / steps), NULL);
        put(p, g->variance[i], g->weight[i]);
    }
}

static double gaussian_transmission(const struct ts_profile *p, int channel, double d)
{
    double sum = 0.0;

    for (int i = 0; i < p->count; i++)
        sum += p->weight[i][channel] * exp(-d * d / (2.0 * p->variance[i]));
    return sum;
}

/* Thickness where each channel transmits less than MIN_TRANSMISSION of its total. */
static double gaussian_end(const struct ts_profile *p)
{
    double far = 0.0;

    for (int c = 0; c < 3; c++) {
        const double total = gaussian_transmission(p, c, 0.0);
        double low = 0.0, high = 6.0 * p->widest;
        for (int i = 0; total > 0.0 && i < 50; i++) {
            const double mid = 0.5 * (low + high);
            if (gaussian_transmission(p, c, mid) > MIN_TRANSMISSION * total)
                low = mid;
            else
                high = mid;
        }
        far = fmax(far, total > 0.0 ? high : 0.0);
    }
    return far;
}

/* Projects T(r; d) onto the chain's variances; preserves the total, and the second moment where the variances reach it. */
static enum pell_result slab_row(struct pell_context *ctx, const struct pell_frame_material *m, const struct ts_profile *p, double d,
                                 const struct pell_slab slab[3], struct pell_stack_sets *sets, void *workspace,
                                 float fraction[TS_LEVELS][3])
{
    double target[TS_LEVELS], out[TS_LEVELS];
    int level[TS_LEVELS], targets = 0;

    for (int i = 0; i < p->count; i++) {
        bool any = false;
        for (int c = 0; c < 3; c++)
            any |= p->weight[i][c] > 0.0;
        if (any) {
            level[targets] = i;
            target[targets++] = p->variance[i];
        }
    }
    for (int c = 0; c < 3; c++) {
        const double total = pell_slab_at(&slab[c], d).transmitted;
        struct pell_medium medium;
        struct pell_stack stack;
        double sum = 0.0;
        pell_slab_medium(m, d, &medium);
        pell_stack_of_medium(&medium, d, &stack);
        for (int i = 0; i < p->count; i++)
            fraction[i][c] = 0.0f;
        if (!(total > 0.0))
            continue;
        if (pell_stack_gaussians(&stack, c, NULL, workspace, pell_stack_workspace_size(NULL), sets) != PELL_OK)
            return pell_error(ctx, PELL_ERR_INVALID, m->name, "through=gaussian", "has no slab of %g mm", d);
        pell_gaussian_set_reduce(sets->variance, sets->weight[PELL_STACK_T_PLUS], (size_t) sets->count, target, (size_t) targets, out);
        for (int i = 0; i < targets; i++)
            sum += out[i] > 0.0 ? out[i] : 0.0;
        for (int i = 0; i < targets; i++)
            fraction[level[i]][c] = sum > 0.0 && out[i] > 0.0 ? (float) (out[i] / sum * total) : 0.0f;
    }
    return PELL_OK;
}

/* Subtracts the light that clear media pass forward from the diffuse transmission: the engine adds it, with its directions. */
static void subtract_forward(const struct pell_medium *medium, struct ts_profile *p)
{
    struct pell_opposed diffuse;
    struct pell_forward forward;

    if (!pell_forward_make(medium, &forward) || !pell_opposed_make(medium, &diffuse))
        return;
    for (int k = 0; k < TS_THICK; k++) {
        const double f = (double) k / (TS_THICK - 1);
        for (int c = 0; c < 3; c++) {
            const float rest =
                pell_forward_diffuse(&forward, c, (float) (p->thickest * f * f), pell_forward_separation(&forward, &diffuse, c));
            for (int i = 0; i < p->count; i++)
                p->fraction[k][i][c] *= rest;
        }
    }
}

/* Rows at d = thickest f^2. A white material's profile is scaled to 1 in each channel, and so is its transmission. The map holds the light
 * that entered a thin part without what leaves at its far side, so the remainder has to supply that. */
static enum pell_result make_slabs(struct pell_context *ctx, const struct pell_frame_material *m, const struct pell_slab slab[3],
                                   bool local, struct ts_profile *p)
{
    const size_t size = pell_stack_workspace_size(NULL);
    struct pell_stack_sets *sets = pell_alloc(ctx, sizeof(*sets));
    void *workspace = pell_alloc(ctx, size);
    double low = MIN_SLAB, high = MAX_SLAB;
    enum pell_result res = PELL_ERR_NOMEM;

    p->fraction = pell_calloc(ctx, TS_THICK, sizeof(*p->fraction));
    if (!sets || !workspace || !p->fraction)
        goto fail;
    for (int i = 0; i < 40; i++) {
        const double mid = 0.5 * (low + high);
        double most = 0.0;
        for (int c = 0; c < 3; c++)
            most = fmax(most, pell_slab_at(&slab[c], mid).transmitted);
        if (most > MIN_TRANSMISSION)
            low = mid;
        else
            high = mid;
    }
    p->thickest = high;
    for (int k = 0; k < TS_THICK; k++) {
        const double f = (double) k / (TS_THICK - 1), d = fmax(p->thickest * f * f, 1e-2 * MIN_SLAB);
        PELL_TRY(slab_row(ctx, m, p, d, slab, sets, workspace, p->fraction[k]));
        for (int c = 0; c < 3; c++) {
            const double total = m->white ? pell_profile_total(&m->profile[c]) : 1.0;
            const double half = pell_slab_at(&slab[c], (double) INFINITY).reflected;
            const double kept = half > 0.0 ? pell_slab_at(&slab[c], d).reflected / half : 1.0;
            const double whole = total * (local ? fmax(kept, MIN_RETURNED) : 1.0);
            for (int i = 0; i < p->count; i++)
                p->fraction[k][i][c] = total > 0.0 ? (float) ((double) p->fraction[k][i][c] / whole) : 0.0f;
        }
    }
    p->slab = true;
    res = PELL_OK;

fail:
    pell_free(ctx, workspace);
    pell_free(ctx, sets);
    return res;
}

/* --- Thirteen taps --------------------------------------------------------------------------------------------------------------- */

/* Fraction of a channel's light that leaves within r mm of its entry point. */
static double within(const struct ts_profile *p, int first, int channel, double r)
{
    double sum = 0.0;

    for (int i = first; i < p->count; i++)
        sum += p->weight[i][channel] * -expm1(-r * r / (2.0 * p->variance[i]));
    return sum;
}

/* The same averaged over the channels, each relative to its own total. */
static double mean_within(const struct ts_profile *p, int first, double r)
{
    double sum = 0.0, n = 0.0;

    for (int c = 0; c < 3; c++) {
        const double all = within(p, first, c, 1e3 * p->widest);
        sum += all > 0.0 ? within(p, first, c, r) / all : 0.0;
        n += all > 0.0;
    }
    return n > 0.0 ? sum / n : 1.0;
}

static double radius_of(const struct ts_profile *p, int first, double fraction)
{
    double low = 0.0, high = 8.0 * p->widest;

    for (int i = 0; i < 50; i++) {
        const double mid = 0.5 * (low + high);
        if (mean_within(p, first, mid) < fraction)
            low = mid;
        else
            high = mid;
    }
    return high;
}

/* Hable, Borshukov and Hejl 2009: a centre tap and two rings of six taps, each jittered in its sixth of the ring and weighted per channel
 * by the profile's integral over the ring. Their taps are fitted to one skin; here the rings' radii are quantiles of any profile. */
static void make_taps(struct ts_profile *p, bool unblurred)
{
    static const double limit[4] = { 0.0, TAPS_MIDDLE, TAPS_INNER, 1.0 };
    static const double jitter[12] = { 0.17, 0.62, 0.38, 0.85, 0.05, 0.73, 0.58, 0.13, 0.91, 0.34, 0.76, 0.29 };
    static const int order[6] = { 0, 3, 5, 1, 4, 2 };
    double radius[4] = { 0.0 }, before[3] = { 0.0 };
    int first = 0;

    while (unblurred && first < p->count && !(p->weight[first][0] > 0.0 || p->weight[first][1] > 0.0 || p->weight[first][2] > 0.0))
        first++;
    first += unblurred;
    for (int ring = 0, n = 0; ring < 3; ring++) {
        const int count = ring == 0 ? 1 : 6;
        radius[ring + 1] = ring < 2 ? radius_of(p, first, limit[ring + 1]) : 1e3 * p->widest;
        for (int k = 0; k < count; k++, n++) {
            const double part = (order[k] + 0.5) / 6.0, fraction = limit[ring] + part * (limit[ring + 1] - limit[ring]);
            const double r = ring == 0 ? 0.0 : radius_of(p, first, fraction), phi = 2.0 * PELL_PI * (k + jitter[n > 0 ? n - 1 : 0]) / 6.0;
            p->taps[n].x = (float) (r * cos(phi));
            p->taps[n].y = (float) (r * sin(phi));
            for (int c = 0; c < 3; c++)
                p->taps[n].weight[c] = (float) ((within(p, first, c, radius[ring + 1]) - before[c]) / count);
        }
        for (int c = 0; c < 3; c++)
            before[c] = within(p, first, c, radius[ring + 1]);
    }
}

enum pell_result ts_profile_make(struct pell_context *ctx, const struct pell_frame_material *m, const struct ts_knobs *knobs, bool local,
                                 bool forward, struct ts_profile *out)
{
    const struct pell_fit_params params = { .count = knobs->gaussians };
    struct pell_gaussians g = m->gaussians;
    struct pell_slab slab[3];
    enum pell_result res = PELL_OK;

    memset(out, 0, sizeof(*out));
    if (g.count == 0 && pell_fit_profiles(m->profile, &params, &g, NULL) != PELL_OK)
        return pell_error(ctx, PELL_ERR_INVALID, m->name, "change its coefficients, or use fewer Gaussians",
                          "no sum of %d Gaussians fits this material's profile", params.count);
    if (m->white)
        whiten(&g);
    make_chain(&g, narrowest(m), out);
    if (out->count == 0)
        return PELL_OK;
    if (out->added > 0)
        pell_debug(ctx, m->name, "%d blurs without weight keep the ratio of variances at most %g", out->added, MAX_RATIO);
    out->widest = sqrt(out->variance[out->count - 1]);
    out->thickest = gaussian_end(out);
    make_taps(out, knobs->first == TS_FIRST_UNBLURRED);
    if (knobs->transmission == TS_TRANSMISSION_SLAB && knobs->tsm != TS_TSM_OFF && pell_slabs_make(m, slab))
        PELL_TRY(make_slabs(ctx, m, slab, local, out));
    if (out->slab && forward && !m->stack)
        subtract_forward(&m->medium, out);

fail:
    return res;
}

void ts_profile_finish(struct pell_context *ctx, struct ts_profile *p)
{
    pell_free(ctx, p->fraction);
    p->fraction = NULL;
}

void ts_profile_transmission(const struct ts_profile *p, int i, float d, float opposed, float fraction[3])
{
    const float v = (float) p->variance[i], e = d * d < 80.0f * v ? expf(-d * d / (2.0f * v)) : 0.0f;

    for (int c = 0; c < 3; c++)
        fraction[c] = (float) p->weight[i][c] * e;
    if (!p->slab)
        return;
    for (int c = 0; c < 3; c++)
        fraction[c] *= 1.0f - opposed;
    if (d < (float) p->thickest) {
        const float f = sqrtf(d / (float) p->thickest) * (TS_THICK - 1);
        const int row = f < (float) (TS_THICK - 2) ? (int) f : TS_THICK - 2;
        for (int c = 0; c < 3; c++)
            fraction[c] += opposed * (p->fraction[row][i][c] + (f - (float) row) * (p->fraction[row + 1][i][c] - p->fraction[row][i][c]));
    }
}
