/* SPDX-License-Identifier: MIT
 *
 * fit.c - fitting profiles by sums of Gaussians, d'Eon, Luebke, Enderton 2007, eqs. (9) and (10).
 *
 * Minimised over the variances, which all channels share: sum over channels of Int r (R - G)^2 dr / Int r R^2 dr. Levenberg-Marquardt
 * (cminpack) moves the logarithms of the variances only; at each step the weights are the best ones for them (non-negative, and of the
 * profile's total unless that is free), and the residuals' derivative takes this into account: variable projection, Golub and Pereyra
 * 1973, "The differentiation of pseudo-inverses and nonlinear least squares problems whose variables separate".
 *
 * The same cost is computed in two ways. pell_fit_project works on the nodes by orthogonal factors and keeps all digits. The rough
 * evaluation works on inner products, Int r G_i G_j dr = 1/(4 pi^2 (v_i + v_j)), in a tenth of the time; its rounding error is about 1e-14
 * of Int r R^2 dr, so it is used for the search, and for the last steps if the error is above 0.1 %.
 *
 * Initial values: for one dipole, the optimum as a function of its two parameters (starts.h). Else the optima with one Gaussian less, plus
 * one whose variance is found by a scan for the smallest cost.
 */
#include <pellucid/gaussians.h>

#include "math/vec.h"
#include "optics/fit/fit.h"
#include "optics/fit/starts.h"
#include "optics/fit/starts_domain.h"
#include "optics/profile/lanes.h"

#include <math.h>
#include <string.h>

/* --- Starts -------------------------------------------------------------------------------------------------------------------- */

bool pell_fit_start(const struct pell_dipole *dipole, int count, bool free_energy, double *x)
{
    const double t = start_t_of_x(dipole->sigma_tr * dipole->zr), u = start_t_of_q(dipole->zv / dipole->zr);
    double tx[START_X] = { 1.0, t }, tq[START_Q] = { 1.0, u };

    if (!(fabs(t) <= 1.0 + 1e-9) || !(fabs(u) <= 1.0))
        return false;
    for (int i = 2; i < START_X; i++)
        tx[i] = 2.0 * t * tx[i - 1] - tx[i - 2];
    for (int i = 2; i < START_Q; i++)
        tq[i] = 2.0 * u * tq[i - 1] - tq[i - 2];
    for (int n = 0; n < count; n++) {
        x[n] = 0.0;
        for (int i = 0; i < START_X; i++)
            for (int j = 0; j < START_Q; j++)
                x[n] += (double) fit_starts[free_energy][count * (count - 1) / 2 + n][i][j] * tx[i] * tq[j];
    }
    return true;
}

/* --- Dipoles ------------------------------------------------------------------------------------------------------------------- */

/* Ranges in which every intermediate value of a fit is finite; wider than any valid medium's. NaN fails. */
static bool dipole_valid(const struct pell_dipole *d)
{
    return d->albedo_reduced >= 0.0 && d->albedo_reduced <= 1.0 && d->zr >= 1e-9 && d->zr <= 1e9 && d->zv >= d->zr &&
           d->zv <= 1e3 * d->zr && d->sigma_tr >= 0.0 && d->sigma_tr * d->zr <= 2.0;
}

static bool params_valid(const struct pell_fit_params *params)
{
    return params->count >= 1 && params->count <= PELL_GAUSSIANS_MAX && params->r_max_mm >= 0.0 && params->r_max_mm < INFINITY &&
           (params->r_max_mm == 0.0 || params->r_max_mm >= 1e-12);
}

/* A free fit may lose light, but not create any: its weights at these variances sum to 1 at most. */
static void limit_energy(struct pell_fit_work *w, struct pell_fit_target *t, const double *total, const struct pell_fit_point *best)
{
    if (!t->free_energy)
        return;
    for (int c = 0; c < t->channels; c++)
        t->max_total[c] = 1.0 / total[c];
    w->ready = false;
    pell_fit_project(w, best->x);
}

/* Writes the result in `w`; channel c of the target is channel order[c], whose weights sum to total[c] unless they are free. */
static void write_result(const struct pell_fit_work *w, const int *order, const double *total, struct pell_gaussians *out,
                         struct pell_fit_report *report)
{
    const struct pell_fit_target *t = w->t;

    out->count = w->count;
    for (int i = 0; i < w->count; i++)
        out->variance[i] = exp(w->x[i]) * t->unit * t->unit;
    for (int c = 0; c < t->channels; c++) {
        double sum = 0.0;
        for (int i = 0; i < w->count; i++)
            out->weight[i][order[c]] = w->best[c].w[i] * (t->norm[c] / t->total[c]) * total[c];
        for (int i = 0; i < t->nodes; i++)
            sum += w->residual[c][i] * w->residual[c][i];
        report->error[order[c]] = sqrt(sum);
    }
    report->evaluations = w->evaluations;
}

static void fit_dipoles(const struct pell_dipole *dipoles, int channels, const int *order, const struct pell_fit_params *params, bool table,
                        struct pell_gaussians *out, struct pell_fit_report *report)
{
    struct pell_fit_target t;
    struct pell_fit_work w;
    struct pell_fit_point best;
    double total[3];

    for (int c = 0; c < channels; c++)
        total[c] = pell_dipole_total(&dipoles[c]);
    pell_fit_target_dipoles(dipoles, channels, params, &t);
    pell_fit_begin(&w, &t);
    if (table && channels == 1 && t.closed && pell_fit_start(&dipoles[0], params->count, params->free_energy, best.x))
        pell_fit_finish(&w, params->count, &best);
    else
        pell_fit_search(&w, params->count, &best);
    limit_energy(&w, &t, total, &best);
    write_result(&w, order, total, out, report);
}

static enum pell_result fit_dipole(const struct pell_dipole *dipole, const struct pell_fit_params *params, bool table,
                                   struct pell_gaussians *out, struct pell_fit_report *report)
{
    static const int first[1] = { 0 };
    struct pell_fit_report own = { 0 };
    const bool valid = params_valid(params) && dipole_valid(dipole);

    memset(out, 0, sizeof(*out));
    if (valid && dipole->albedo_reduced > 0.0)
        fit_dipoles(dipole, 1, first, params, table, out, &own);
    if (report)
        *report = own;
    return valid ? PELL_OK : PELL_ERR_INVALID;
}

enum pell_result pell_fit_dipole(const struct pell_dipole *dipole, const struct pell_fit_params *params, struct pell_gaussians *out,
                                 struct pell_fit_report *report)
{
    if (!dipole || !params || !out)
        return PELL_ERR_INVALID;

    return fit_dipole(dipole, params, true, out, report);
}

enum pell_result pell_fit_dipole_searched(const struct pell_dipole *dipole, const struct pell_fit_params *params,
                                          struct pell_gaussians *out, struct pell_fit_report *report)
{
    return fit_dipole(dipole, params, false, out, report);
}

/* Sorts channels into a canonical order, so that swapping them swaps weights bit by bit. Black ones are skipped. */
static void fit_dipole_channels(const struct pell_dipole dipoles[3], const struct pell_fit_params *params, struct pell_gaussians *out,
                                struct pell_fit_report *report)
{
    struct pell_dipole sorted[3];
    int order[3], live = 0;

    for (int c = 0; c < 3; c++) {
        const struct pell_dipole *d = &dipoles[c];
        int at = live;
        if (!(d->albedo_reduced > 0.0))
            continue;
        for (; at > 0 && (d->zr < sorted[at - 1].zr || (d->zr == sorted[at - 1].zr && d->sigma_tr < sorted[at - 1].sigma_tr)); at--) {
            sorted[at] = sorted[at - 1];
            order[at] = order[at - 1];
        }
        sorted[at] = *d;
        order[at] = c;
        live++;
    }
    if (live > 0)
        fit_dipoles(sorted, live, order, params, true, out, report);
}

enum pell_result pell_fit_medium(const struct pell_medium *medium, const struct pell_fit_params *params, struct pell_gaussians *out,
                                 struct pell_fit_report *report)
{
    if (!medium || !params || !out)
        return PELL_ERR_INVALID;

    struct pell_profile profiles[3];

    memset(out, 0, sizeof(*out));
    if (report)
        memset(report, 0, sizeof(*report));
    for (int c = 0; c < 3; c++)
        if (pell_profile_make(PELL_PROFILE_DIPOLE, medium, c, NULL, &profiles[c]) != PELL_OK)
            return PELL_ERR_INVALID;
    return pell_fit_profiles(profiles, params, out, report);
}

/* --- Any profile --------------------------------------------------------------------------------------------------------------- */

/* A canonical order of profiles, independent of their positions. */
static bool precedes(const struct pell_profile *a, const struct pell_profile *b)
{
    const double median_a = pell_profile_sample(a, 0.5), median_b = pell_profile_sample(b, 0.5);

    if (median_a != median_b)
        return median_a < median_b;
    if (a->total != b->total)
        return a->total < b->total;
    for (double r = 0.125 * median_a; r < 100.0 * median_a; r *= 1.5) {
        const double value_a = pell_profile_eval(a, r), value_b = pell_profile_eval(b, r);
        if (value_a != value_b)
            return value_a < value_b;
    }
    return false;
}

/* The dipole parameters of a profile; false if it is another model. */
static bool dipole_of(const struct pell_profile *p, struct pell_dipole *d)
{
    if (p->kind != PELL_PROFILE_KIND_POLES || p->parameter[PAIR_B] != 0.0)
        return false;
    *d = (struct pell_dipole) { .albedo_reduced = fmin(1.0, p->parameter[PAIR_A] * 4.0 * PELL_PI),
                                .sigma_tr = p->parameter[PAIR_SIGMA],
                                .zr = p->parameter[PAIR_ZR],
                                .zv = p->parameter[PAIR_ZV] };
    return dipole_valid(d);
}

/* `live`: profiles with light, in a canonical order: channel c of the fit is channel order[c]. */
static enum pell_result search_profiles(const struct pell_profile *const *live, int count, const int *order,
                                        const struct pell_fit_params *params, struct pell_gaussians *out, struct pell_fit_report *report)
{
    struct pell_fit_target t;
    struct pell_fit_work w;
    struct pell_fit_point best;
    double total[3];

    if (!pell_fit_target_profiles(live, count, params, 0.0, &t))
        return PELL_ERR_INVALID;
    for (int c = 0; c < count; c++)
        total[c] = pell_profile_total(live[c]);
    pell_fit_begin(&w, &t);
    pell_fit_search(&w, params->count, &best);
    limit_energy(&w, &t, total, &best);
    write_result(&w, order, total, out, report);
    return PELL_OK;
}

static enum pell_result fit_profiles(const struct pell_profile *profiles, int channels, const struct pell_fit_params *params,
                                     struct pell_gaussians *out, struct pell_fit_report *report)
{
    const struct pell_profile *live[3];
    struct pell_fit_report own = { 0 };
    struct pell_dipole dipoles[3] = { { 0 } };
    enum pell_result res = PELL_OK;
    int order[3], count = 0, num_dipoles;

    memset(out, 0, sizeof(*out));
    if (report)
        *report = own;
    if (!params_valid(params))
        return PELL_ERR_INVALID;
    for (int c = 0; c < channels; c++)
        if (!(pell_profile_total(&profiles[c]) >= 0.0) || !isfinite(pell_profile_total(&profiles[c])))
            return PELL_ERR_INVALID;
    for (num_dipoles = 0;
         num_dipoles < channels && (profiles[num_dipoles].total == 0.0 || dipole_of(&profiles[num_dipoles], &dipoles[num_dipoles]));
         num_dipoles++)
        ;
    for (int c = 0; c < channels; c++) {
        int at = count;
        if (num_dipoles == channels || !(pell_profile_total(&profiles[c]) > 0.0))
            continue;
        for (; at > 0 && precedes(&profiles[c], live[at - 1]); at--) {
            live[at] = live[at - 1];
            order[at] = order[at - 1];
        }
        live[at] = &profiles[c];
        order[at] = c;
        count++;
    }
    if (num_dipoles == channels) /* closed forms, and a table of starts */
        fit_dipole_channels(dipoles, params, out, &own);
    else
        res = search_profiles(live, count, order, params, out, &own);
    if (report)
        *report = own;
    return res;
}

enum pell_result pell_fit_profile(const struct pell_profile *profile, const struct pell_fit_params *params, struct pell_gaussians *out,
                                  struct pell_fit_report *report)
{
    if (!profile || !params || !out)
        return PELL_ERR_INVALID;

    return fit_profiles(profile, 1, params, out, report);
}

enum pell_result pell_fit_profiles(const struct pell_profile profiles[3], const struct pell_fit_params *params, struct pell_gaussians *out,
                                   struct pell_fit_report *report)
{
    if (!profiles || !params || !out)
        return PELL_ERR_INVALID;

    return fit_profiles(profiles, 3, params, out, report);
}
