/* SPDX-License-Identifier: MIT
 *
 * cminpack.h - the one function of cminpack that the optics call, for the page: Debian has cminpack for no browser. lmder.c is its home. */
#ifndef PELL_SITE_CMINPACK_H
#define PELL_SITE_CMINPACK_H

#define __cminpack_func__(name) name

/* Residuals (flag 1), or their derivatives by columns (flag 2), at x. */
typedef int (*cminpack_funcder_mn)(void *user, int m, int n, const double *x, double *residuals, double *jacobian, int stride, int flag);

/* Finds a minimum of the sum of m squared residuals of n variables, from x. Of cminpack's arguments ftol, xtol, maxfev and the arrays are
 * used; the scale of the variables is that of the Jacobian's columns. */
int lmder(cminpack_funcder_mn function, void *user, int m, int n, double *x, double *residuals, double *jacobian, int stride, double ftol,
          double xtol, double gtol, int maxfev, double *diag, int mode, double factor, int nprint, int *nfev, int *njev, int *ipvt,
          double *qtf, double *wa1, double *wa2, double *wa3, double *wa4);

#endif
