/* SPDX-License-Identifier: MIT
 *
 * formulas.h - numbers and formulas of the screen-space method that its kernels in C and its shaders share: C11 and GLSL 4.60. Formulas are
 * macros, since kernels evaluate them on vectors. What they mean: README.md.
 */
#ifndef PELL_SCREEN_SPACE_FORMULAS_H
#define PELL_SCREEN_SPACE_FORMULAS_H

#define SCREEN_FACTOR_PARTS 32                           /* cubics that a factor of a separable kernel is made of */
#define SCREEN_FACTOR_SIZE (2 + 3 * SCREEN_FACTOR_PARTS) /* vectors of one on a device: see separable.comp */
#define SCREEN_SPAN 2.88675135f /* 3/sqrt(1.08): the listing's 7 taps over +-span have a standard deviation of span/SCREEN_SPAN */

/* A Gaussian of compact support: K(t) = q(t^2/16) - q(0.7225), q(y) = (1 + B1 y + B2 y^2)^8, for |t| < 3.4 and 0 beyond. B1 and B2 make
 * its integral function differ from the Gaussian's of the same variance by 0.00074 at most. Its integral and variance are exact in the
 * constants that follow, so that a blur has the standard deviation asked for. */
/* B1 = -1.08, B2 = 0.646. For y' = sqrt(B2) y the polynomial is a square: q = ((y' + Y_SHIFT)^2 + Q_LEAST)^8. */
#define Y_MAX 0.580703054f        /* 0.7225 sqrt(B2) */
#define Y_SHIFT -0.671858012f     /* B1 / (2 sqrt(B2)) */
#define Q_LEAST 0.548606811f      /* 1 - B1^2 / (4 B2) */
#define K_NORM 0.401802782f       /* sqrt(variance) / integral */
#define K_SCALE_ROOT 0.214667712f /* sqrt(sqrt(B2) variance / 16) */
#define K_REACH 3.549853f         /* 3.4 / sqrt(variance): the support in standard deviations */
/* Under 0.6 pixels a sampled Gaussian loses variance. Such a blur is the one of 0.6 pixels, mixed with the unblurred pixel. */
#define S2_MIN 0.36f
#define S2_MIN_VARIANCE 0.347397f /* that K, sampled at whole pixels, has there */

/* Where a silhouette is in reach, taps stand at every pixel while that makes no more than so many a side. With gaps, pixels beside the
 * edge differ in how many taps meet the surface: lines of one pixel, and echoes of the edge. */
#define TAPS_DENSE 96.0f

/* Variance in px^2 on the grid of pixels that stands for a Gaussian of variance u, for light that is constant over each pixel: u + 1/12
 * for large u, and 0 for u = 0. Near Sum_j j^2 (Phi((j + 1/2)/sqrt(u)) - Phi((j - 1/2)/sqrt(u))). The form is
 * (u + 1/12) u^3/(u^3 + G1) + G2 u^3/(u^4 + G3), over one divisor, a b, up to WIDE, and u + a constant beyond; its constants make the
 * largest error of a half-lit plane smallest over the published skin and marble profiles and a single Gaussian, at all scales. */
#define G1 4.678e-4f
#define G2 0.01327f
#define G3 0.01634f
#define WIDE 16.0f
#define GRID_A(u3) ((u3) + G1)
#define GRID_B(u4) ((u4) + G3)
#define GRID_OVER(u, u3, a, b) ((u3) * (((u) + 1.0f / 12.0f) * (b) + G2 * (a)))

#define JUMP 4.0f          /* change of depth from a pixel to the next, in pixels' sizes, that may be a silhouette */
#define CREASE 0.5f        /* change of that change which wide gaps would miss */
#define LEAN_MIN 0.015625f /* pixels of x per pixel of y: less is as good as upright */
#define LEAN_MAX 8.0f
#define LEAN_FADE 8       /* blocks */
#define LEAN_CHANGE 0.08f /* from a block to the next: more is no plane */

/* Squared lengths on the surface from a pixel of size `mm` to the next along an axis, and the product of both: `d` the change of depth, `t`
 * the ray's slope along the axis, `ray2` = 1 + tx^2 + ty^2. */
#define STEP_LENGTH2(mm, d, t, ray2) ((mm) * ((mm) + (d) * ((t) + (t))) + (d) * (d) * (ray2))
#define STEP_PRODUCT(mm, dx, dy, tx, ty, ray2) ((dx) * (dy) * (ray2) + (mm) * ((dx) * (ty) + (dy) * (tx)))

#endif
