/* SPDX-License-Identifier: MIT
 *
 * fit.c - fitting dipoles by sums of Gaussians, d'Eon, Luebke, Enderton 2007, eqs. (9) and (10).
 *
 * Minimised over the variances, which all channels share: sum over channels of Int r (R - G)^2 dr / Int r R^2 dr, the integrals from 0
 * to infinity. Levenberg-Marquardt (cminpack) moves the logarithms of the variances only; at each step the weights are the
 * best ones for them (non-negative, and of the profile's total unless that is free), and the residuals' derivative takes this into
 * account: variable projection, Golub and Pereyra 1973, "The differentiation of pseudo-inverses and nonlinear least squares problems
 * whose variables separate".
 *
 * The integrals are trapezoidal sums in x = log r, whose error for these integrands falls as exp(-pi^2/(2 step)): a Gaussian of r is
 * analytic and bounded in |Im x| < pi/4, a pole in |Im x| < pi/2.
 *
 * Starts: the optima of one Gaussian less plus one more, put where a scan over its variance finds the objective smallest.
 */
#include <pellucid/gaussians.h>

#include "math/nnls.h"
#include "math/vec.h"

#include <cminpack.h>
#include <float.h>
#include <math.h>
#include <string.h>

#define COUNT_MAX PELL_GAUSSIANS_MAX
#define NODES 224
#define STEP 0.12   /* of log r; wider only where channels differ by more than 10^4 */
#define SCAN 40     /* variances tried for a new Gaussian */
#define STARTS 3    /* of them improved by Levenberg-Marquardt */
#define KEEP 2      /* optima that live on to the next count */

_Static_assert(PELL_NNLS_MAX >= COUNT_MAX, "one projection holds all weights");

/* What is fitted. Lengths are in units of the smallest zr, so that nothing depends on the scale of the medium. */
struct target {
    int channels, nodes;
    bool free_energy;
    double unit;               /* mm */
    double low, high;          /* log variances of any use */
    double r2[NODES];          /* r^2 */
    double root[NODES];        /* square root of the node's weight r dr, = r sqrt(step) */
    double rhs[3][NODES];      /* root * R / norm */
    double total[3], norm[3];  /* of R / alpha', the norm being sqrt(Int r R^2 dr) */
};

/* One set of log variances with its best weights. */
struct point {
    double x[COUNT_MAX];
    double cost;
};

struct work {
    const struct target *t;
    int count, evaluations;
    bool ready;                                 /* the rest belongs to `x` */
    double x[COUNT_MAX];
    double q[COUNT_MAX][NODES];                 /* orthonormal basis of the Gaussians */
    double slope[COUNT_MAX][NODES];             /* d Gaussian / d log variance */
    double q_slope[COUNT_MAX][COUNT_MAX];       /* q_slope[i][k] = q[k] . slope[i] */
    struct pell_nnls_solution best[3];
    double residual[3][NODES];
    double cost;
};

/* --- Target ------------------------------------------------------------------------------------------------------------------- */

/* Beyond this radius a dipole adds less than 1e-13 to any integral: exponential tail, or r^-4 without absorption. */
static double outer_radius(const struct pell_dipole *d)
{
    const double far = 2e3 * d->zv;
    return d->sigma_tr * far > 24.0 ? fmin(far, 24.0 / d->sigma_tr + 2.0 * d->zv) : far;
}

static void target_make(const struct pell_dipole *dipoles, int channels, bool free_energy, struct target *t)
{
    double inner = INFINITY, outer = 0.0, zv = 0.0;

    t->channels = channels;
    t->free_energy = free_energy;
    for (int c = 0; c < channels; c++) {
        inner = fmin(inner, dipoles[c].zr);
        outer = fmax(outer, outer_radius(&dipoles[c]));
        zv = fmax(zv, dipoles[c].zv);
    }
    t->unit = inner;
    outer /= inner;
    const double a = log(3e-4), range = log(outer) - a;
    t->nodes = (int) fmin(ceil(range / STEP) + 1.0, NODES);
    const double step = range / (t->nodes - 1);
    t->low = log(0.01);
    t->high = 2.0 * log(outer) - 1.0;

    for (int i = 0; i < t->nodes; i++) {
        const double r = exp(a + step * i);
        t->r2[i] = r * r;
        t->root[i] = r * sqrt(step);
    }
    for (int c = 0; c < channels; c++) {
        struct pell_dipole d = dipoles[c]; /* of albedo 1 and in the unit: errors depend on neither */
        double sum = 0.0;
        d.albedo_reduced = 1.0;
        d.zr /= inner;
        d.zv /= inner;
        d.sigma_tr *= inner;
        for (int i = 0; i < t->nodes; i++) {
            t->rhs[c][i] = t->root[i] * pell_dipole_rd(&d, sqrt(t->r2[i]));
            sum += t->rhs[c][i] * t->rhs[c][i];
        }
        t->norm[c] = sqrt(sum);
        t->total[c] = pell_dipole_total(&d);
        for (int i = 0; i < t->nodes; i++)
            t->rhs[c][i] /= t->norm[c];
    }
}

/* --- Projection ---------------------------------------------------------------------------------------------------------------- */

static double dot(const double *a, const double *b, int n)
{
    double s0 = 0.0, s1 = 0.0, s2 = 0.0, s3 = 0.0;
    int i = 0;
    for (; i + 4 <= n; i += 4) {
        s0 += a[i] * b[i];
        s1 += a[i + 1] * b[i + 1];
        s2 += a[i + 2] * b[i + 2];
        s3 += a[i + 3] * b[i + 3];
    }
    for (; i < n; i++)
        s0 += a[i] * b[i];
    return (s0 + s1) + (s2 + s3);
}

/* Fills q with Gaussian i and slope with its derivative, both times the nodes' weights. */
static void fill(struct work *w, int i)
{
    const struct target *t = w->t;
    const double v = exp(w->x[i]), scale = 1.0 / (2.0 * PELL_PI * v);
    for (int k = 0; k < t->nodes; k++) {
        const double e = 0.5 * t->r2[k] / v;
        const double g = e < 80.0 ? scale * t->root[k] * exp(-e) : 0.0;
        w->q[i][k] = g;
        w->slope[i][k] = g * (e - 1.0);
    }
}

/* Makes `w` hold the best weights and residuals for the log variances `x`. */
static void evaluate(struct work *w, const double *x)
{
    const struct target *t = w->t;
    const int n = t->nodes;
    struct pell_nnls p = { .count = w->count, .fixed_sum = !t->free_energy };

    if (w->ready && memcmp(x, w->x, sizeof(*x) * (size_t) w->count) == 0)
        return;
    memcpy(w->x, x, sizeof(*x) * (size_t) w->count);
    w->ready = true;
    w->evaluations++;
    w->cost = 0.0;
    for (int i = 0; i < w->count; i++) {
        double size = 0.0;
        fill(w, i);
        for (int pass = 0; pass < 2; pass++)
            for (int k = 0; k < i; k++) {
                const double c = dot(w->q[k], w->q[i], n);
                p.column[i][k] += c;
                for (int j = 0; j < n; j++)
                    w->q[i][j] -= c * w->q[k][j];
            }
        size = sqrt(dot(w->q[i], w->q[i], n));
        p.column[i][i] = size;
        for (int j = 0; j < n; j++)
            w->q[i][j] = size > 0.0 ? w->q[i][j] / size : 0.0;
    }
    for (int c = 0; c < t->channels; c++) {
        double shift[COUNT_MAX], *res = w->residual[c];
        p.sum = t->total[c] / t->norm[c];
        for (int k = 0; k < w->count; k++)
            p.rhs[k] = dot(w->q[k], t->rhs[c], n);
        pell_nnls_solve(&p, &w->best[c]);
        for (int k = 0; k < w->count; k++) {
            shift[k] = 0.0;
            for (int i = k; i < w->count; i++)
                shift[k] += w->best[c].w[i] * p.column[i][k];
        }
        memcpy(res, t->rhs[c], sizeof(*res) * (size_t) n);
        for (int k = 0; k < w->count; k++)
            for (int j = 0; j < n; j++)
                res[j] -= shift[k] * w->q[k][j];
        w->cost += dot(res, res, n);
    }
}

/* d residual_c / d x_i = -w_i (slope_i - B B^T slope_i) - (slope_i . residual_c) B R^-T N^T e_i, where B R = (Gaussians N) and N holds
 * the directions in which the weights are free. */
static void derivative(struct work *w, int c, int i, double *out)
{
    const int n = w->t->nodes, count = w->count;
    const struct pell_nnls_solution *s = &w->best[c];
    double z[COUNT_MAX], along[COUNT_MAX] = { 0 };
    const double turn = dot(w->slope[i], w->residual[c], n);

    for (int k = 0; k < s->rank; k++) { /* R^T z = N^T e_i */
        z[k] = (s->free[k] == i ? 1.0 : 0.0) - (s->pivot == i ? 1.0 : 0.0);
        for (int j = 0; j < k; j++)
            z[k] -= s->r[j][k] * z[j];
        z[k] /= s->r[k][k];
    }
    for (int k = 0; k < s->rank; k++) {
        const double a = s->w[i] * dot(s->q[k], w->q_slope[i], count) - turn * z[k];
        for (int j = 0; j < count; j++)
            along[j] += a * s->q[k][j];
    }
    for (int j = 0; j < n; j++)
        out[j] = -s->w[i] * w->slope[i][j];
    for (int k = 0; k < count; k++)
        for (int j = 0; j < n; j++)
            out[j] += along[k] * w->q[k][j];
}

/* --- Search -------------------------------------------------------------------------------------------------------------------- */

/* cminpack's callback: residuals (flag 1) or Jacobian by columns (flag 2). */
static int residuals(void *arg, int m, int n, const double *x, double *fvec, double *fjac, int ldfjac, int flag)
{
    struct work *w = arg;
    const struct target *t = w->t;
    (void) m;

    for (int i = 0; i < n; i++) /* a step to nowhere: tell the solver that it is bad, and stay finite */
        if (!(fabs(x[i]) < 100.0)) {
            for (int j = 0; j < m; j++)
                fvec[j] = 1e3;
            return flag == 1 ? 0 : -1;
        }
    evaluate(w, x);
    if (flag == 1) {
        for (int c = 0; c < t->channels; c++)
            memcpy(fvec + c * t->nodes, w->residual[c], sizeof(*fvec) * (size_t) t->nodes);
        return 0;
    }
    for (int i = 0; i < n; i++)
        for (int k = 0; k < n; k++)
            w->q_slope[i][k] = dot(w->q[k], w->slope[i], t->nodes);
    for (int i = 0; i < n; i++)
        for (int c = 0; c < t->channels; c++)
            derivative(w, c, i, fjac + (size_t) i * (size_t) ldfjac + c * t->nodes);
    return 0;
}

static void sort(double *x, int n)
{
    for (int i = 1; i < n; i++)
        for (int j = i; j > 0 && x[j] < x[j - 1]; j--) {
            const double swap = x[j];
            x[j] = x[j - 1];
            x[j - 1] = swap;
        }
}

/* Walks from p->x to a local optimum; `relative` is the relative change of the cost at which it stops. */
static void descend(struct work *w, struct point *p, double relative, int evaluations)
{
    double fvec[3 * NODES], fjac[COUNT_MAX * 3 * NODES], diag[COUNT_MAX], qtf[COUNT_MAX], wa[3][COUNT_MAX], wa4[3 * NODES];
    int ipvt[COUNT_MAX], nfev, njev;
    const int m = w->t->channels * w->t->nodes;

    __cminpack_func__(lmder)(residuals, w, m, w->count, p->x, fvec, fjac, m, relative, 1e-12, 0.0, evaluations, diag, 1, 1.0, 0, &nfev,
                             &njev, ipvt, qtf, wa[0], wa[1], wa[2], wa4);
    sort(p->x, w->count);
    evaluate(w, p->x);
    p->cost = w->cost;
}

/* Puts `p` into a list of the best, which is in order of cost; optima that are the same are kept once. */
static int keep(struct point *list, int count, int max, const struct point *p, int dims)
{
    int at = count;
    for (int i = 0; i < count; i++) {
        double apart = 0.0;
        for (int j = 0; j < dims; j++)
            apart = fmax(apart, fabs(list[i].x[j] - p->x[j]));
        if (apart < 1e-3) {
            if (p->cost < list[i].cost)
                list[i] = *p;
            return count;
        }
    }
    while (at > 0 && p->cost < list[at - 1].cost)
        at--;
    if (at >= max)
        return count;
    if (count < max)
        count++;
    for (int i = count - 1; i > at; i--)
        list[i] = list[i - 1];
    list[at] = *p;
    return count;
}

/* Starts for one Gaussian more than `from` has: local minima of the cost over the new variance. */
static int scan(struct work *w, const struct point *from, struct point *starts, int count)
{
    struct point tried[SCAN];
    const double step = (w->t->high - w->t->low) / (SCAN - 1);

    for (int i = 0; i < SCAN; i++) {
        memcpy(tried[i].x, from->x, sizeof(from->x));
        tried[i].x[w->count - 1] = w->t->low + step * i;
        evaluate(w, tried[i].x);
        tried[i].cost = w->cost;
    }
    for (int i = 0; i < SCAN; i++) {
        const bool falls = i == 0 || tried[i].cost <= tried[i - 1].cost, rises = i == SCAN - 1 || tried[i].cost <= tried[i + 1].cost;
        if (falls && rises) {
            sort(tried[i].x, w->count);
            count = keep(starts, count, STARTS, &tried[i], w->count);
        }
    }
    return count;
}

static void search(struct work *w, int count, struct point *best)
{
    struct point optima[KEEP];
    int kept = 1;

    memset(&optima[0], 0, sizeof(optima[0]));
    for (w->count = 1; w->count <= count; w->count++) {
        struct point starts[STARTS], next[KEEP];
        int num_starts = 0, num_next = 0;
        w->ready = false;
        for (int i = 0; i < kept; i++)
            num_starts = scan(w, &optima[i], starts, num_starts);
        for (int i = 0; i < num_starts; i++) {
            descend(w, &starts[i], w->count < count ? 1e-4 : 1e-6, 60);
            num_next = keep(next, num_next, KEEP, &starts[i], w->count);
        }
        memcpy(optima, next, sizeof(optima));
        kept = num_next;
    }
    w->count = count;
    *best = optima[0];
    descend(w, best, 1e-14, 200);
}

/* Fits `channels` dipoles of albedo > 0; out->weight[i][c] belongs to dipoles[c]. */
static void fit(const struct pell_dipole *dipoles, int channels, const struct pell_fit_params *params, struct pell_gaussians *out,
                struct pell_fit_report *report)
{
    struct target t;
    struct work w;
    struct point best;

    target_make(dipoles, channels, params->free_energy, &t);
    w.t = &t;
    w.evaluations = 0;
    search(&w, params->count, &best);

    memset(out, 0, sizeof(*out));
    out->count = params->count;
    evaluate(&w, best.x);
    for (int i = 0; i < params->count; i++)
        out->variance[i] = exp(best.x[i]) * t.unit * t.unit;
    for (int c = 0; c < channels; c++) {
        for (int i = 0; i < params->count; i++)
            out->weight[i][c] = w.best[c].w[i] * t.norm[c] * dipoles[c].albedo_reduced;
        report->error[c] = sqrt(dot(w.residual[c], w.residual[c], t.nodes));
    }
    report->evaluations = w.evaluations;
}

/* --- Public -------------------------------------------------------------------------------------------------------------------- */

/* Ranges in which every intermediate value of a fit is finite; wider than any valid medium's. NaN fails. */
static bool dipole_valid(const struct pell_dipole *d)
{
    return d->albedo_reduced >= 0.0 && d->albedo_reduced <= 1.0 && d->zr >= 1e-9 && d->zr <= 1e9 && d->zv >= d->zr
           && d->zv <= 1e3 * d->zr && d->sigma_tr >= 0.0 && d->sigma_tr * d->zr <= 2.0;
}

static bool params_valid(const struct pell_fit_params *params)
{
    return params->count >= 1 && params->count <= PELL_GAUSSIANS_MAX;
}

enum pell_result pell_fit_dipole(const struct pell_dipole *dipole, const struct pell_fit_params *params, struct pell_gaussians *out,
                                 struct pell_fit_report *report)
{
    struct pell_fit_report own = { 0 };

    memset(out, 0, sizeof(*out));
    if (report)
        *report = own;
    if (!params_valid(params) || !dipole_valid(dipole))
        return PELL_ERR_INVALID;
    if (dipole->albedo_reduced > 0.0)
        fit(dipole, 1, params, out, &own);
    if (report)
        *report = own;
    return PELL_OK;
}

enum pell_result pell_fit_medium(const struct pell_medium *medium, const struct pell_fit_params *params, struct pell_gaussians *out,
                                 struct pell_fit_report *report)
{
    struct pell_dipole dipoles[3];
    struct pell_gaussians sorted = { 0 };
    struct pell_fit_report own = { 0 };
    int order[3], live = 0;

    memset(out, 0, sizeof(*out));
    if (report)
        *report = own;
    if (!params_valid(params) || !pell_medium_valid(medium, NULL))
        return PELL_ERR_INVALID;

    /* In an order of their own, so that swapping channels swaps weights bit by bit. Black channels take no part. */
    for (int c = 0; c < 3; c++) {
        const struct pell_dipole d =
            pell_dipole_make(medium->sigma_a[c], medium->sigma_s_reduced[c], medium->eta, PELL_FRESNEL_EXACT);
        int at = live;
        if (!(d.albedo_reduced > 0.0))
            continue;
        for (; at > 0 && (d.zr < dipoles[at - 1].zr || (d.zr == dipoles[at - 1].zr && d.sigma_tr < dipoles[at - 1].sigma_tr)); at--) {
            dipoles[at] = dipoles[at - 1];
            order[at] = order[at - 1];
        }
        dipoles[at] = d;
        order[at] = c;
        live++;
    }
    if (live > 0) {
        struct pell_fit_report by_order = { 0 };
        fit(dipoles, live, params, &sorted, &by_order);
        *out = sorted;
        memset(out->weight, 0, sizeof(out->weight));
        for (int k = 0; k < live; k++) {
            for (int i = 0; i < sorted.count; i++)
                out->weight[i][order[k]] = sorted.weight[i][k];
            own.error[order[k]] = by_order.error[k];
        }
        own.evaluations = by_order.evaluations;
    }
    if (report)
        *report = own;
    return PELL_OK;
}
