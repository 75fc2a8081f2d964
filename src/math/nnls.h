/* SPDX-License-Identifier: MIT
 *
 * nnls.h - small dense least squares with non-negative weights and, optionally, a given sum.
 *
 * Threads    safe; allocates nothing.
 */
#ifndef PELL_NNLS_H
#define PELL_NNLS_H

#include <stdbool.h>

#define PELL_NNLS_MAX 10

/* Minimise |sum_j w_j column[j] - rhs|^2 over w_j >= 0 and, if fixed_sum, sum_j w_j = sum (which must be positive). */
struct pell_nnls {
    int count;                                   /* number of columns, and their length: reduce a tall matrix to its R by QR first */
    double column[PELL_NNLS_MAX][PELL_NNLS_MAX]; /* column[j][row] */
    double rhs[PELL_NNLS_MAX];
    bool fixed_sum;
    double sum;
};

/* The solution, and an orthonormal basis of the directions in which it was free to move, as needed for its derivative. Directions are
 * columns of N: e_free[i] without fixed_sum, e_free[i] - e_pivot with it. (columns N) = Q R. */
struct pell_nnls_solution {
    double w[PELL_NNLS_MAX];
    int rank;                               /* number of directions */
    int pivot;                              /* the weight that takes the remainder of the sum, -1 without fixed_sum */
    int free[PELL_NNLS_MAX];                /* `rank` indices of the other weights that are not held at 0 */
    double q[PELL_NNLS_MAX][PELL_NNLS_MAX]; /* q[direction][row] */
    double r[PELL_NNLS_MAX][PELL_NNLS_MAX]; /* r[i][j], upper triangular */
};

/* Factorises with no weight held at 0, which depends on the columns only: one call serves all right-hand sides. */
void pell_nnls_factor(const struct pell_nnls *problem, struct pell_nnls_solution *solution);
/* `solution` comes from pell_nnls_factor, or from a copy of its result for the same columns. */
void pell_nnls_solve(const struct pell_nnls *problem, struct pell_nnls_solution *solution);

#endif
