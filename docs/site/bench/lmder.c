/* SPDX-License-Identifier: MIT
 * lmder.c - nonlinear least squares by the method of Levenberg and Marquardt: normal equations with a damped diagonal, which is scaled by
 * the largest norm that a column of the Jacobian has had (More 1978), and damping by how well the linear model foretells the residuals
 * (Nielsen 1999). Variables are few (at most 10) and scaled alike, so that the normal equations lose nothing that matters. */
#include "cminpack.h"

#include <math.h>
#include <string.h>

#define MOST 16 /* variables */

static double square(const double *v, int n)
{
    double sum = 0.0;
    for (int i = 0; i < n; i++)
        sum += v[i] * v[i];
    return sum;
}

/* Solves (A + mu D) step = b by Cholesky's decomposition. False: not positive definite. */
static int solve(const double a[MOST][MOST], const double *scale, double mu, const double *b, int n, double *step)
{
    double l[MOST][MOST];

    for (int i = 0; i < n; i++)
        for (int j = 0; j <= i; j++) {
            double sum = a[i][j] + (i == j ? mu * scale[i] * scale[i] : 0.0);
            for (int k = 0; k < j; k++)
                sum -= l[i][k] * l[j][k];
            if (i == j && !(sum > 0.0))
                return 0;
            l[i][j] = i == j ? sqrt(sum) : sum / l[j][j];
        }
    for (int i = 0; i < n; i++) {
        step[i] = b[i];
        for (int k = 0; k < i; k++)
            step[i] -= l[i][k] * step[k];
        step[i] /= l[i][i];
    }
    for (int i = n; i-- > 0;) {
        for (int k = i + 1; k < n; k++)
            step[i] -= l[k][i] * step[k];
        step[i] /= l[i][i];
    }
    return 1;
}

/* The normal equations at x: A = J^T J, b = -J^T residuals. */
static void normal(const double *jacobian, int stride, const double *residuals, int m, int n, double a[MOST][MOST], double *b)
{
    for (int i = 0; i < n; i++) {
        const double *column = jacobian + (size_t) i * stride;
        b[i] = 0.0;
        for (int r = 0; r < m; r++)
            b[i] -= column[r] * residuals[r];
        for (int j = 0; j <= i; j++) {
            const double *other = jacobian + (size_t) j * stride;
            double sum = 0.0;
            for (int r = 0; r < m; r++)
                sum += column[r] * other[r];
            a[i][j] = a[j][i] = sum;
        }
    }
}

int lmder(cminpack_funcder_mn function, void *user, int m, int n, double *x, double *residuals, double *jacobian, int stride, double ftol,
          double xtol, double gtol, int maxfev, double *diag, int mode, double factor, int nprint, int *nfev, int *njev, int *ipvt,
          double *qtf, double *wa1, double *wa2, double *wa3, double *wa4)
{
    double a[MOST][MOST], *step = wa1, *next = wa2, cost, mu = 1e-3, grow = 2.0;

    (void) gtol, (void) mode, (void) factor, (void) nprint, (void) ipvt, (void) qtf, (void) wa3;
    *nfev = 1;
    *njev = 0;
    if (n > MOST || function(user, m, n, x, residuals, jacobian, stride, 1) < 0)
        return 0;
    cost = square(residuals, m);
    memset(diag, 0, (size_t) n * sizeof(*diag));
    while (*nfev < maxfev && cost > 0.0) {
        double b[MOST];

        if (function(user, m, n, x, residuals, jacobian, stride, 2) < 0)
            return 0;
        *njev += 1;
        normal(jacobian, stride, residuals, m, n, a, b);
        for (int i = 0; i < n; i++)
            diag[i] = fmax(diag[i], sqrt(a[i][i]) > 0.0 ? sqrt(a[i][i]) : 1.0);
        for (;;) {
            double foretold = 0.0, length = 0.0, size = 0.0, there;

            if (!solve(a, diag, mu, b, n, step)) {
                mu = fmax(4.0 * mu, 1e-12);
                continue;
            }
            for (int i = 0; i < n; i++) {
                next[i] = x[i] + step[i];
                foretold += step[i] * (mu * diag[i] * diag[i] * step[i] + b[i]);
                length += diag[i] * diag[i] * step[i] * step[i];
                size += diag[i] * diag[i] * x[i] * x[i];
            }
            if (*nfev >= maxfev || function(user, m, n, next, wa4, jacobian, stride, 1) < 0)
                return 0;
            *nfev += 1;
            there = square(wa4, m);
            if (there < cost) {
                const double gain = (cost - there) / foretold, fall = cost - there;
                memcpy(x, next, (size_t) n * sizeof(*x));
                memcpy(residuals, wa4, (size_t) m * sizeof(*residuals));
                mu *= fmax(1.0 / 3.0, 1.0 - pow(2.0 * gain - 1.0, 3.0));
                grow = 2.0;
                if ((fall <= ftol * cost && foretold <= ftol * cost) || sqrt(length) <= xtol * sqrt(size))
                    return 1;
                cost = there;
                break;
            }
            if (foretold <= ftol * cost || sqrt(length) <= xtol * sqrt(size) || mu > 1e30)
                return 1;
            mu *= grow;
            grow *= 2.0;
        }
    }
    return 0;
}
