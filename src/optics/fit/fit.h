/* SPDX-License-Identifier: MIT
 *
 * fit.h - parts of a fit by Gaussians: the target on its nodes, and the search for the variances. For fit.c and its tests.
 *
 * Threads    pure and safe; allocates nothing.
 */
#ifndef PELL_OPTICS_FIT_H
#define PELL_OPTICS_FIT_H

#include <pellucid/gaussians.h>

#include "math/nnls.h"
#include "optics/fit/kernels.h"

#define FIT_COUNT_MAX PELL_GAUSSIANS_MAX
#define FIT_NODES 240

_Static_assert(PELL_NNLS_MAX >= FIT_COUNT_MAX, "one projection holds all weights");

/* The target of a fit. Lengths are in units of a length of the profiles, so that nothing depends on the scale of the medium. */
struct pell_fit_target {
    int channels, nodes;
    bool free_energy;
    bool closed;              /* integrals from 0 to infinity without a weight: inner products of Gaussians are known */
    double unit;              /* mm */
    double low, high;         /* range of useful log variances */
    double r2[FIT_NODES];     /* r^2 */
    double root[FIT_NODES];   /* square root of the node's weight r dr */
    double rhs[3][FIT_NODES]; /* root * R / norm */
    double total[3], norm[3]; /* in the unit, the norm being sqrt(Int r R^2 dr) */
    double max_total[3];      /* > 0: bound on the sum of free weights, as a multiple of the total; 0: none */
};

/* Dipoles with albedo > 0, scaled to albedo 1: errors don't depend on it. r_max_mm as in struct pell_fit_params. */
void pell_fit_target_dipoles(const struct pell_dipole *dipoles, int channels, const struct pell_fit_params *params,
                             struct pell_fit_target *t);

/* Profiles with light. False if a value is not finite, or nothing is left inside r_max. `step` of log r. */
bool pell_fit_target_profiles(const struct pell_profile *const *profiles, int channels, const struct pell_fit_params *params, double step,
                              struct pell_fit_target *t);

/* One set of log variances (in the unit) with its best weights. */
struct pell_fit_point {
    double x[FIT_COUNT_MAX];
    double cost; /* sum over channels of the squared error (10) */
};

struct pell_fit_work {
    const struct pell_fit_target *t;
    const struct pell_fit_kernels *k;
    int count, evaluations;
    bool rough;                                   /* evaluate by inner products */
    bool ready;                                   /* the members below belong to `x` */
    double x[FIT_COUNT_MAX], v[FIT_COUNT_MAX];    /* v = exp(x) */
    double q[FIT_COUNT_MAX][FIT_NODES];           /* orthonormal basis of the Gaussians; rough: the Gaussians */
    double slope[FIT_COUNT_MAX][FIT_NODES];       /* d Gaussian / d log variance */
    double q_slope[FIT_COUNT_MAX][FIT_COUNT_MAX]; /* q_slope[i][k] = q[k] . slope[i] */
    struct pell_nnls_solution best[3];
    double residual[3][FIT_NODES];
    double factor[FIT_COUNT_MAX][FIT_COUNT_MAX]; /* rough: Cholesky factor of the Gaussians' inner products */
    double along[3][FIT_COUNT_MAX];              /* rough: the channel in the orthonormal basis of this factor */
    double with_slope[3][FIT_COUNT_MAX];         /* rough: its inner products with the slopes */
    bool curved;                                 /* rough: the members below belong to `x` */
    double rows[FIT_COUNT_MAX][FIT_COUNT_MAX], f[FIT_COUNT_MAX + 1];
    double cost;
};

void pell_fit_begin(struct pell_fit_work *w, const struct pell_fit_target *t);
/* The best weights and residuals for the log variances `x`, to all digits. */
void pell_fit_project(struct pell_fit_work *w, const double *x);
/* cminpack's callback for these: residuals (flag 1) or their derivative by columns (flag 2), channels one after the other. */
int pell_fit_residuals(void *work, int m, int n, const double *x, double *fvec, double *fjac, int ldfjac, int flag);
/* Descends from p->x to a local optimum; stops at the relative change `relative` of the cost. */
void pell_fit_descend(struct pell_fit_work *w, struct pell_fit_point *p, double relative, int evaluations);
/* The best optimum of `count` Gaussians, without a start, or from one start near it. */
void pell_fit_search(struct pell_fit_work *w, int count, struct pell_fit_point *best);
void pell_fit_finish(struct pell_fit_work *w, int count, struct pell_fit_point *best);

/* Log variances near the optimum of a dipole in units of zr; false outside the table. */
bool pell_fit_start(const struct pell_dipole *dipole, int count, bool free_energy, double *x);

/* The fit of one dipole without the table of starts, which is generated from it. */
enum pell_result pell_fit_dipole_searched(const struct pell_dipole *dipole, const struct pell_fit_params *params,
                                          struct pell_gaussians *out, struct pell_fit_report *report);

#endif
