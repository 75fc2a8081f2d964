/* SPDX-License-Identifier: MIT
 *
 * nnls.c - the active-set method of Lawson and Hanson, "Solving Least Squares Problems" (1974), chapter 23, with an optional sum
 * kept by eliminating one free weight. */
#include "math/nnls.h"

#include <math.h>
#include <stddef.h>
#include <string.h>

/* A column whose component orthogonal to the others is smaller than this fraction of it counts as linearly dependent. */
static const double dependent = 1e-13;

/* If at least this fraction remains, one orthogonalisation pass is exact to 14 digits. */
static const double cancelled = 1e-2;

static double dot(const double *a, const double *b, int n)
{
    double sum = 0.0;
    for (int i = 0; i < n; i++)
        sum += a[i] * b[i];
    return sum;
}

/* Orthogonalises the directions of the free set `mask` (Gram-Schmidt, twice if much cancels: "twice is enough"). Dependent ones are removed
 * from the set. */
static void factor(const struct pell_nnls *p, unsigned mask, struct pell_nnls_solution *s)
{
    const int n = p->count;

    s->rank = 0;
    s->pivot = -1;
    for (int j = 0; j < n && p->fixed_sum; j++)
        if (mask >> j & 1u)
            s->pivot = j;
    for (int j = 0; j < n; j++) {
        double *v = s->q[s->rank];
        if (!(mask >> j & 1u) || j == s->pivot)
            continue;
        for (int i = 0; i < n; i++)
            v[i] = p->column[j][i] - (s->pivot >= 0 ? p->column[s->pivot][i] : 0.0);
        const double before = sqrt(dot(v, v, n));
        for (int k = 0; k < s->rank; k++)
            s->r[k][s->rank] = 0.0;
        double after = before;
        for (int pass = 0; pass < 2 && (pass == 0 || after < cancelled * before); pass++) {
            for (int k = 0; k < s->rank; k++) {
                const double c = dot(s->q[k], v, n);
                s->r[k][s->rank] += c;
                for (int i = 0; i < n; i++)
                    v[i] -= c * s->q[k][i];
            }
            after = sqrt(dot(v, v, n));
        }
        if (!(after > dependent * before))
            continue;
        for (int i = 0; i < n; i++)
            v[i] /= after;
        s->r[s->rank][s->rank] = after;
        s->free[s->rank++] = j;
    }
}

/* The least-squares weights on the directions of `s`; all others 0. */
static void project(const struct pell_nnls *p, const struct pell_nnls_solution *s, double *w)
{
    const int n = p->count;
    double rhs[PELL_NNLS_MAX], z[PELL_NNLS_MAX], rest = p->sum;

    for (int i = 0; i < n; i++) {
        rhs[i] = p->rhs[i] - (s->pivot >= 0 ? p->sum * p->column[s->pivot][i] : 0.0);
        w[i] = 0.0;
    }
    for (int k = s->rank - 1; k >= 0; k--) {
        z[k] = dot(s->q[k], rhs, n);
        for (int j = k + 1; j < s->rank; j++)
            z[k] -= s->r[k][j] * z[j];
        z[k] /= s->r[k][k];
        w[s->free[k]] = z[k];
        rest -= z[k];
    }
    if (s->pivot >= 0)
        w[s->pivot] = rest;
}

static double objective(const struct pell_nnls *p, const double *w, double *residual)
{
    for (int i = 0; i < p->count; i++) {
        residual[i] = -p->rhs[i];
        for (int j = 0; j < p->count; j++)
            residual[i] += w[j] * p->column[j][i];
    }
    return dot(residual, residual, p->count);
}

/* A feasible start: all zero, or the whole sum in the best single column. */
static unsigned start(const struct pell_nnls *p, double *w)
{
    double residual[PELL_NNLS_MAX], best = INFINITY;
    int at = 0;

    memset(w, 0, PELL_NNLS_MAX * sizeof(*w));
    if (!p->fixed_sum)
        return 0;
    for (int j = 0; j < p->count; j++) {
        w[j] = p->sum;
        const double f = objective(p, w, residual);
        w[j] = 0.0;
        if (f < best) {
            best = f;
            at = j;
        }
    }
    w[at] = p->sum;
    return 1u << at;
}

/* The weight held at 0 whose increase lowers the objective fastest, relative to its column; -1 if none does. */
static int entering(const struct pell_nnls *p, unsigned mask, unsigned barred, const double *w)
{
    double residual[PELL_NNLS_MAX], multiplier = 0.0, steepest = 0.0;
    int at = -1, num_free = 0;
    const double size = sqrt(dot(p->rhs, p->rhs, p->count));

    objective(p, w, residual);
    if (p->fixed_sum) {
        for (int j = 0; j < p->count; j++)
            if (mask >> j & 1u) {
                multiplier += dot(p->column[j], residual, p->count);
                num_free++;
            }
        multiplier /= num_free ? num_free : 1;
    }
    for (int j = 0; j < p->count; j++) {
        if ((mask | barred) >> j & 1u)
            continue;
        const double slope = dot(p->column[j], residual, p->count) - multiplier;
        const double scale = size * sqrt(dot(p->column[j], p->column[j], p->count));
        if (slope < -1e-13 * scale && slope / scale < steepest) {
            steepest = slope / scale;
            at = j;
        }
    }
    return at;
}

void pell_nnls_factor(const struct pell_nnls *p, struct pell_nnls_solution *s)
{
    factor(p, (1u << p->count) - 1u, s);
}

void pell_nnls_solve(const struct pell_nnls *p, struct pell_nnls_solution *s)
{
    const unsigned all = (1u << p->count) - 1u;
    unsigned mask = all, barred = 0;
    double z[PELL_NNLS_MAX];

    /* Usually the unconstrained solution has no negative weight, and one factorisation is enough. */
    project(p, s, s->w);
    for (int j = 0; j < p->count; j++)
        if (!(s->w[j] >= 0.0))
            mask &= ~(1u << j);
    if (mask == all)
        return;

    mask = start(p, s->w);
    for (int round = 0; round < 4 * PELL_NNLS_MAX; round++) {
        const int enter = entering(p, mask, barred, s->w);
        if (enter < 0)
            break;
        mask |= 1u << enter;
        for (;;) {
            double step = 1.0;
            int blocking = -1;
            factor(p, mask, s);
            project(p, s, z);
            for (int j = 0; j < p->count; j++)
                if ((mask >> j & 1u) && z[j] < 0.0) {
                    const double t = s->w[j] / (s->w[j] - z[j]);
                    if (t < step) {
                        step = t;
                        blocking = j;
                    }
                }
            for (int j = 0; j < p->count; j++)
                s->w[j] = fmax(0.0, s->w[j] + step * (z[j] - s->w[j]));
            if (blocking < 0)
                break;
            s->w[blocking] = 0.0;
            mask &= ~(1u << blocking);
            if (blocking == enter) /* rounding: the entering weight is the blocking one; the loop would not end */
                barred |= 1u << enter;
        }
    }
    factor(p, mask, s);
    project(p, s, z);
    for (int j = 0; j < p->count; j++)
        s->w[j] = fmax(0.0, z[j]);
}
