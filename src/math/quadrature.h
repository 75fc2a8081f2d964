/* SPDX-License-Identifier: MIT
 *
 * quadrature.h - integration of a function of one variable: adaptive, and by the nodes of a rule.
 *
 * Errors     none: an error estimate is returned for the caller to check.
 * Threads    safe; allocates nothing.
 */
#ifndef PELL_QUADRATURE_H
#define PELL_QUADRATURE_H

typedef double (*pell_integrand)(double x, const void *arg);

/* Int_a^b f dx by the 15-point Gauss-Kronrod rule, bisecting the worst interval until the estimated error is at most
 * max(tol_abs, tol_rel |integral|) or 200 intervals are in use. End points are never evaluated. `error` may be NULL. */
double pell_integrate(pell_integrand f, const void *arg, double a, double b, double tol_abs, double tol_rel, double *error);

/* Nodes (rising) and weights of the Gauss-Legendre rule on [0, 1], exact for polynomials of degree 2 count - 1; count in [1, 64]. */
void pell_gauss_legendre(int count, double *x, double *w);

#endif
