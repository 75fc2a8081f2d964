/* SPDX-License-Identifier: MIT
 *
 * formulas.h - constants and formulas of the screen-space method shared by its C kernels and its shaders: C11 and GLSL 4.60. Formulas are
 * macros, because kernels evaluate them on vectors. Explanations: README.md.
 */
#ifndef PELL_SCREEN_SPACE_FORMULAS_H
#define PELL_SCREEN_SPACE_FORMULAS_H

#define SCREEN_FACTOR_PARTS 32                           /* number of cubics per factor of a separable kernel */
#define SCREEN_FACTOR_SIZE (2 + 3 * SCREEN_FACTOR_PARTS) /* vectors per factor on a device: see separable.comp */
#define SCREEN_SPAN 2.88675135f /* 3/sqrt(1.08): the listing's 7 taps over +-span have a standard deviation of span/SCREEN_SPAN */

/* A Gaussian of compact support: K(t) = q(t^2/16) - q(0.7225), q(y) = (1 + B1 y + B2 y^2)^8, for |t| < 3.4 and 0 beyond. B1 and B2 are such
 * that its integral function differs from that of the Gaussian with the same variance by at most 0.00074. The constants below contain its
 * exact integral and variance, so that a blur has exactly the requested standard deviation. */
/* B1 = -1.08, B2 = 0.646. For y' = sqrt(B2) y the polynomial is a square: q = ((y' + Y_SHIFT)^2 + Q_MIN)^8. */
#define Y_MAX 0.580703054f        /* 0.7225 sqrt(B2) */
#define Y_SHIFT -0.671858012f     /* B1 / (2 sqrt(B2)) */
#define Q_MIN 0.548606811f        /* 1 - B1^2 / (4 B2) */
#define K_NORM 0.401802782f       /* sqrt(variance) / integral */
#define K_SCALE_ROOT 0.214667712f /* sqrt(sqrt(B2) variance / 16) */
#define K_REACH 3.549853f         /* 3.4 / sqrt(variance): the support in standard deviations */
/* Below 0.6 pixels a sampled Gaussian loses variance. Such a blur is a mix of the one of 0.6 pixels and the unblurred pixel. */
#define S2_MIN 0.36f
#define S2_MIN_VARIANCE 0.347397f /* variance of K, sampled at whole pixels, at that width */

/* Within reach of a silhouette there is a tap at every pixel, up to this many per side. With gaps, pixels next to the edge would differ in
 * how many taps hit the surface: one-pixel lines, and echoes of the edge. */
#define TAPS_DENSE 96.0f

/* Variance in px^2 on the pixel grid that represents a Gaussian of variance u, for light that is constant over each pixel: u + 1/12 for
 * large u, and 0 for u = 0; approximately Sum_j j^2 (Phi((j + 1/2)/sqrt(u)) - Phi((j - 1/2)/sqrt(u))). The form is (u + 1/12) u^3/(u^3 +
 * G1) + G2 u^3/(u^4 + G3), with a common divisor, a b, up to WIDE, and u + a constant beyond; its constants minimise the largest error of a
 * half-lit plane over the published skin and marble profiles and a single Gaussian, at all scales. */
#define G1 4.678e-4f
#define G2 0.01327f
#define G3 0.01634f
#define WIDE 16.0f
#define GRID_A(u3) ((u3) + G1)
#define GRID_B(u4) ((u4) + G3)
#define GRID_NUMERATOR(u, u3, a, b) ((u3) * (((u) + 1.0f / 12.0f) * (b) + G2 * (a)))

#define JUMP 4.0f          /* in pixel sizes: a larger change of depth between pixels may be a silhouette */
#define CREASE 0.5f        /* a larger second difference of depth would be missed by wide gaps */
#define SKEW_MIN 0.015625f /* pixels of x per pixel of y: smaller skews count as upright */
#define SKEW_MAX 8.0f
#define SKEW_FADE 8       /* blocks */
#define SKEW_CHANGE 0.08f /* per block: a larger change means that the surface is not planar */

/* Squared lengths on the surface between pixels of size `mm` along either axis, and their scalar product: `d` the change of depth, `t` the
 * ray's slope along the axis, `ray2` = 1 + tx^2 + ty^2. */
#define STEP_LENGTH2(mm, d, t, ray2) ((mm) * ((mm) + (d) * ((t) + (t))) + (d) * (d) * (ray2))
#define STEP_PRODUCT(mm, dx, dy, tx, ty, ray2) ((dx) * (dy) * (ray2) + (mm) * ((dx) * (ty) + (dy) * (tx)))

#endif
