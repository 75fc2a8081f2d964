/* SPDX-License-Identifier: MIT
 *
 * search.c - variable projection and the search for the best variances; see fit.c. */
#include "optics/fit/fit.h"

#include "base/simd.h"
#include "math/vec.h"

#include <cminpack.h>
#include <math.h>
#include <string.h>

#define SCAN 32    /* variances tried for a new Gaussian */
#define STARTS 3   /* of these, improved by Levenberg-Marquardt */
#define KEEP 2     /* optima kept for the next count */
#define ROUGH 1e-9 /* a channel's cost above which the rough evaluation is accurate enough to search */
#define FINE 1e-6  /* and for the last steps */

/* --- Projection ---------------------------------------------------------------------------------------------------------------- */

PELL_SIMD_TABLES(struct pell_fit_kernels, pell_fit_kernels);

/* Fills q with Gaussian i and slope with its derivative, both times the nodes' weights. */
static void fill(struct pell_fit_work *w, int i)
{
    w->v[i] = exp(w->x[i]);
    w->k->gaussian(w->t->r2, w->t->root, w->v[i], w->q[i], w->slope[i], w->t->nodes);
}

/* If free weights exceed the allowed total, solves again with the total fixed there: the cost is convex, so that is the optimum. */
static void limit(struct pell_fit_work *w, int c, struct pell_nnls *p)
{
    const double sum = p->sum, bound = p->sum * w->t->max_total[c];
    double total = 0.0;

    for (int i = 0; i < w->count; i++)
        total += w->best[c].w[i];
    if (total <= bound)
        return;
    p->fixed_sum = true;
    p->sum = bound;
    pell_nnls_factor(p, &w->best[c]);
    pell_nnls_solve(p, &w->best[c]);
    p->fixed_sum = false;
    p->sum = sum;
}

/* Evaluates the best weights and residuals for the log variances `x`. */
void pell_fit_project(struct pell_fit_work *w, const double *x)
{
    const struct pell_fit_target *t = w->t;
    const int n = t->nodes;
    struct pell_nnls p = { .count = w->count, .fixed_sum = !t->free_energy };
    struct pell_nnls_solution all;

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
                const double c = w->k->dot(w->q[k], w->q[i], n);
                p.column[i][k] += c;
                w->k->subtract(c, w->q[k], w->q[i], n);
            }
        size = sqrt(w->k->dot(w->q[i], w->q[i], n));
        p.column[i][i] = size;
        for (int j = 0; j < n; j++)
            w->q[i][j] = size > 0.0 ? w->q[i][j] / size : 0.0;
    }
    pell_nnls_factor(&p, &all);
    for (int c = 0; c < t->channels; c++) {
        double shift[FIT_COUNT_MAX], *res = w->residual[c];
        p.sum = t->total[c] / t->norm[c];
        for (int k = 0; k < w->count; k++)
            p.rhs[k] = w->k->dot(w->q[k], t->rhs[c], n);
        w->best[c] = all;
        pell_nnls_solve(&p, &w->best[c]);
        if (t->max_total[c] > 0.0)
            limit(w, c, &p);
        for (int k = 0; k < w->count; k++) {
            shift[k] = 0.0;
            for (int i = k; i < w->count; i++)
                shift[k] += w->best[c].w[i] * p.column[i][k];
        }
        memcpy(res, t->rhs[c], sizeof(*res) * (size_t) n);
        for (int k = 0; k < w->count; k++)
            w->k->subtract(shift[k], w->q[k], res, n);
        w->cost += w->k->dot(res, res, n);
    }
}

/* d residual_c / d x_i = -w_i (slope_i - B B^T slope_i) - (slope_i . residual_c) B R^-T N^T e_i, where B R = (Gaussians N) and N holds
 * the directions in which the weights are free. */
static void derivative(struct pell_fit_work *w, int c, int i, double *out)
{
    const int n = w->t->nodes, count = w->count;
    const struct pell_nnls_solution *s = &w->best[c];
    double z[FIT_COUNT_MAX], along[FIT_COUNT_MAX] = { 0 };
    const double slope_residual = w->k->dot(w->slope[i], w->residual[c], n);

    for (int k = 0; k < s->rank; k++) { /* R^T z = N^T e_i */
        z[k] = (s->free[k] == i ? 1.0 : 0.0) - (s->pivot == i ? 1.0 : 0.0);
        for (int j = 0; j < k; j++)
            z[k] -= s->r[j][k] * z[j];
        z[k] /= s->r[k][k];
    }
    for (int k = 0; k < s->rank; k++) {
        const double a = s->w[i] * w->k->dot(s->q[k], w->q_slope[i], count) - slope_residual * z[k];
        for (int j = 0; j < count; j++)
            along[j] += a * s->q[k][j];
    }
    for (int j = 0; j < n; j++)
        out[j] = -s->w[i] * w->slope[i][j];
    for (int k = 0; k < count; k++)
        w->k->subtract(-along[k], w->q[k], out, n);
}

/* cminpack's callback: residuals (flag 1) or Jacobian by columns (flag 2). */
int pell_fit_residuals(void *arg, int m, int n, const double *x, double *fvec, double *fjac, int ldfjac, int flag)
{
    struct pell_fit_work *w = arg;
    const struct pell_fit_target *t = w->t;
    (void) m;

    for (int i = 0; i < n; i++) /* a step far out of range: large residuals make the solver reject it */
        if (!(fabs(x[i]) < 100.0)) {
            for (int j = 0; j < m; j++)
                fvec[j] = 1e3;
            return flag == 1 ? 0 : -1;
        }
    pell_fit_project(w, x);
    if (flag == 1) {
        for (int c = 0; c < t->channels; c++)
            memcpy(fvec + c * t->nodes, w->residual[c], sizeof(*fvec) * (size_t) t->nodes);
        return 0;
    }
    for (int i = 0; i < n; i++)
        for (int k = 0; k < n; k++)
            w->q_slope[i][k] = w->k->dot(w->q[k], w->slope[i], t->nodes);
    for (int i = 0; i < n; i++)
        for (int c = 0; c < t->channels; c++)
            derivative(w, c, i, fjac + (size_t) i * (size_t) ldfjac + c * t->nodes);
    return 0;
}

/* --- The rough evaluation ------------------------------------------------------------------------------------------------------ */

/* Int r G_i G_j dr, or, by `order`, its derivatives with respect to log v_i, and to both. */
static double inner(const struct pell_fit_work *w, int order, int i, int j)
{
    if (!w->t->closed) {
        const double *a = order > 0 ? w->slope[i] : w->q[i], *b = order > 1 ? w->slope[j] : w->q[j];
        return w->k->dot(a, b, w->t->nodes);
    }
    const double vi = w->v[i], vj = w->v[j], sum = vi + vj, value = 1.0 / (4.0 * PELL_PI * PELL_PI * sum);
    return order == 0 ? value : order == 1 ? -value * vi / sum : 2.0 * value * vi * vj / (sum * sum);
}

/* L y = rhs */
static void forward(const struct pell_fit_work *w, const double *rhs, double *y)
{
    for (int i = 0; i < w->count; i++) {
        y[i] = rhs[i];
        for (int k = 0; k < i; k++)
            y[i] -= w->factor[i][k] * y[k];
        y[i] /= w->factor[i][i];
    }
}

/* Evaluates the weights and the cost for `x` by inner products; Gaussians before `first` are those of the last call. `known`, if not NULL,
 * are the inner products of the last one with the channels. */
static void evaluate(struct pell_fit_work *w, const double *x, int first, const double known[3])
{
    const struct pell_fit_target *t = w->t;
    const int n = t->nodes, count = w->count;
    struct pell_nnls p = { .count = count, .fixed_sum = !t->free_energy };
    struct pell_nnls_solution all;

    memcpy(w->x, x, sizeof(*x) * (size_t) count);
    w->ready = true;
    w->curved = false;
    w->evaluations++;
    w->cost = 0.0;
    for (int i = first; i < count; i++) {
        const bool look_up = known && i == count - 1;
        double products[3];
        if (look_up)
            w->v[i] = exp(x[i]);
        else
            fill(w, i);
        for (int k = 0; k <= i; k++) {
            double s = inner(w, 0, i, k);
            const double size = s;
            for (int j = 0; j < k; j++)
                s -= w->factor[i][j] * w->factor[k][j];
            w->factor[i][k] = k < i ? s / w->factor[k][k] : sqrt(fmax(s, 1e-15 * size)); /* equal variances stay finite */
        }
        for (int c = 0; c < t->channels; c++) {
            products[c] = look_up ? known[c] : w->k->dot(w->q[i], t->rhs[c], n);
            w->with_slope[c][i] = look_up ? NAN : w->k->dot(w->slope[i], t->rhs[c], n);
            for (int k = 0; k < i; k++)
                products[c] -= w->factor[i][k] * w->along[c][k];
            w->along[c][i] = products[c] / w->factor[i][i];
        }
    }
    for (int i = 0; i < count; i++)
        for (int k = 0; k <= i; k++)
            p.column[i][k] = w->factor[i][k];
    pell_nnls_factor(&p, &all);
    for (int c = 0; c < t->channels; c++) {
        double cost = 1.0;
        p.sum = t->total[c] / t->norm[c];
        memcpy(p.rhs, w->along[c], sizeof(p.rhs));
        w->best[c] = all;
        pell_nnls_solve(&p, &w->best[c]);
        for (int k = 0; k < count; k++) {
            double rest = p.rhs[k];
            for (int i = k; i < count; i++)
                rest -= w->best[c].w[i] * p.column[i][k];
            cost += rest * rest - p.rhs[k] * p.rhs[k];
        }
        w->cost += fmax(cost, 0.0);
    }
}

/* Gradient of half the cost, and the matrix J^T J of the derivative J that pell_fit_residuals gives. */
static void curvature(struct pell_fit_work *w, double gradient[FIT_COUNT_MAX], double matrix[FIT_COUNT_MAX][FIT_COUNT_MAX])
{
    const int count = w->count;
    double slope_slope[FIT_COUNT_MAX][FIT_COUNT_MAX], value_slope[FIT_COUNT_MAX][FIT_COUNT_MAX], basis[FIT_COUNT_MAX][FIT_COUNT_MAX];

    for (int i = 0; i < count; i++) {
        gradient[i] = 0.0;
        for (int j = 0; j < count; j++) {
            value_slope[i][j] = inner(w, 1, i, j);
            slope_slope[i][j] = j <= i ? inner(w, 2, i, j) : 0.0;
            matrix[i][j] = 0.0;
        }
        forward(w, value_slope[i], basis[i]);
    }
    for (int c = 0; c < w->t->channels; c++) {
        const struct pell_nnls_solution *s = &w->best[c];
        double slope_in_basis[FIT_COUNT_MAX][FIT_COUNT_MAX], weight_term[FIT_COUNT_MAX][FIT_COUNT_MAX];
        for (int i = 0; i < count; i++) {
            double slope_residual = w->with_slope[c][i];
            for (int j = 0; j < count; j++)
                slope_residual -= s->w[j] * value_slope[i][j];
            gradient[i] -= s->w[i] * slope_residual;
            for (int k = 0; k < s->rank; k++) {
                double z = (s->free[k] == i ? 1.0 : 0.0) - (s->pivot == i ? 1.0 : 0.0);
                for (int j = 0; j < k; j++)
                    z -= s->r[j][k] * weight_term[i][j];
                weight_term[i][k] = z / s->r[k][k];
                slope_in_basis[i][k] = 0.0;
                for (int j = 0; j < count; j++)
                    slope_in_basis[i][k] += s->q[k][j] * basis[i][j];
            }
            for (int k = 0; k < s->rank; k++)
                weight_term[i][k] *= slope_residual;
            for (int j = 0; j <= i; j++) {
                double product = slope_slope[i][j], weight_product = 0.0;
                for (int k = 0; k < s->rank; k++) {
                    product -= slope_in_basis[i][k] * slope_in_basis[j][k];
                    weight_product += weight_term[i][k] * weight_term[j][k];
                }
                matrix[i][j] += s->w[i] * s->w[j] * product + weight_product;
            }
        }
    }
}

/* Condenses these into n + 1 residuals f and the rows of their derivative: matrix = C C^T, C f = gradient, |f|^2 = cost. */
static void condense(struct pell_fit_work *w)
{
    double gradient[FIT_COUNT_MAX], rest = w->cost;

    curvature(w, gradient, w->rows);
    for (int i = 0; i < w->count; i++) {
        const double size = w->rows[i][i];
        double solved = gradient[i];
        for (int k = 0; k <= i; k++) {
            double s = w->rows[i][k];
            for (int j = 0; j < k; j++)
                s -= w->rows[i][j] * w->rows[k][j];
            w->rows[i][k] = k < i ? (w->rows[k][k] > 0.0 ? s / w->rows[k][k] : 0.0) : s > 1e-13 * size ? sqrt(s) : 0.0;
        }
        for (int k = 0; k < i; k++)
            solved -= w->rows[i][k] * w->f[k];
        w->f[i] = w->rows[i][i] > 0.0 ? solved / w->rows[i][i] : 0.0;
        rest -= w->f[i] * w->f[i];
    }
    w->f[w->count] = sqrt(fmax(rest, 0.0));
    w->curved = true;
}

/* cminpack's callback for the condensed residuals. */
static int rough_residuals(void *arg, int m, int n, const double *x, double *fvec, double *fjac, int ldfjac, int flag)
{
    struct pell_fit_work *w = arg;

    for (int i = 0; i < n; i++)
        if (!(fabs(x[i]) < 100.0)) {
            for (int j = 0; j < m; j++)
                fvec[j] = 1e3;
            return flag == 1 ? 0 : -1;
        }
    if (!w->ready || memcmp(x, w->x, sizeof(*x) * (size_t) n) != 0)
        evaluate(w, x, 0, NULL);
    if (!w->curved)
        condense(w);
    if (flag == 1)
        memcpy(fvec, w->f, sizeof(*fvec) * (size_t) m);
    else
        for (int i = 0; i < n; i++)
            for (int k = 0; k <= n; k++)
                fjac[i * ldfjac + k] = k <= i ? w->rows[i][k] : 0.0;
    return 0;
}

/* --- Search -------------------------------------------------------------------------------------------------------------------- */

void pell_fit_begin(struct pell_fit_work *w, const struct pell_fit_target *t)
{
    w->t = t;
    w->k = pell_fit_kernels_tables[pell_simd_best()];
    w->count = 0;
    w->evaluations = 0;
    w->rough = false;
    w->ready = false;
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

/* Sorts the variances of a point and evaluates its cost. */
static void evaluate_point(struct pell_fit_work *w, struct pell_fit_point *p)
{
    sort(p->x, w->count);
    w->ready = false;
    if (w->rough)
        evaluate(w, p->x, 0, NULL);
    else
        pell_fit_project(w, p->x);
    p->cost = w->cost;
}

void pell_fit_descend(struct pell_fit_work *w, struct pell_fit_point *p, double relative, int evaluations)
{
    double fvec[3 * FIT_NODES], fjac[FIT_COUNT_MAX * 3 * FIT_NODES], diag[FIT_COUNT_MAX], qtf[FIT_COUNT_MAX], wa[3][FIT_COUNT_MAX],
        wa4[3 * FIT_NODES];
    int ipvt[FIT_COUNT_MAX], nfev, njev;
    const int n = w->count, m = w->rough ? n + 1 : w->t->channels * w->t->nodes;

    w->ready = false;
    __cminpack_func__(lmder)(w->rough ? rough_residuals : pell_fit_residuals, w, m, n, p->x, fvec, fjac, m, relative, 1e-12, 0.0,
                             evaluations, diag, 1, 1.0, 0, &nfev, &njev, ipvt, qtf, wa[0], wa[1], wa[2], wa4);
    evaluate_point(w, p);
}

/* Inserts `p` into a list of the best, sorted by cost; equal optima are kept once. */
static int keep(struct pell_fit_point *list, int count, int max, const struct pell_fit_point *p, int dims)
{
    int at = count;
    for (int i = 0; i < count; i++) {
        double distance = 0.0;
        for (int j = 0; j < dims; j++)
            distance = fmax(distance, fabs(list[i].x[j] - p->x[j]));
        if (distance < 1e-3) {
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

/* Starts with one Gaussian more than `from`: local minima of the cost over the new variance. */
static int scan(struct pell_fit_work *w, double grid[SCAN][3], const struct pell_fit_point *from, struct pell_fit_point *starts, int count)
{
    struct pell_fit_point tried[SCAN];
    const double step = (w->t->high - w->t->low) / (SCAN - 1);

    for (int i = 0; i < SCAN; i++) {
        memcpy(tried[i].x, from->x, sizeof(from->x));
        tried[i].x[w->count - 1] = w->t->low + step * i;
        if (w->rough)
            evaluate(w, tried[i].x, i > 0 ? w->count - 1 : 0, w->t->closed ? grid[i] : NULL);
        else
            pell_fit_project(w, tried[i].x);
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

void pell_fit_finish(struct pell_fit_work *w, int count, struct pell_fit_point *best)
{
    w->count = count;
    w->rough = true;
    w->ready = false;
    evaluate(w, best->x, 0, NULL);
    w->rough = w->cost > FINE * w->t->channels;
    pell_fit_descend(w, best, 1e-14, 200);
    if (w->rough) {
        w->rough = false;
        evaluate_point(w, best);
    }
}

void pell_fit_search(struct pell_fit_work *w, int count, struct pell_fit_point *best)
{
    struct pell_fit_point optima[KEEP];
    double grid[SCAN][3] = { { 0.0 } }; /* the channels' inner products with a Gaussian of each variance tried */
    int kept = 1;

    for (int i = 0; i < SCAN && w->t->closed; i++) {
        w->x[0] = w->t->low + (w->t->high - w->t->low) / (SCAN - 1) * i;
        fill(w, 0);
        for (int c = 0; c < w->t->channels; c++)
            grid[i][c] = w->k->dot(w->q[0], w->t->rhs[c], w->t->nodes);
    }

    memset(&optima[0], 0, sizeof(optima[0]));
    w->rough = true;
    for (w->count = 1; w->count <= count; w->count++) {
        struct pell_fit_point starts[STARTS], next[KEEP];
        int num_starts = 0, num_next = 0;
        w->ready = false;
        for (int i = 0; i < kept; i++)
            num_starts = scan(w, grid, &optima[i], starts, num_starts);
        for (int i = 0; i < num_starts; i++) {
            pell_fit_descend(w, &starts[i], w->count < count ? 1e-3 : 1e-4, 20);
            num_next = keep(next, num_next, KEEP, &starts[i], w->count);
        }
        memcpy(optima, next, sizeof(optima));
        kept = num_next;
        w->rough = optima[0].cost > ROUGH * w->t->channels;
    }
    *best = optima[0];
    pell_fit_finish(w, count, best);
}
