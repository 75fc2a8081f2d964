/* SPDX-License-Identifier: MIT
 *
 * formulas.h - constants of the texture-space method's blurs, shared by its C kernels and its shaders: C11 and GLSL 4.60. Derivation:
 * README.md.
 */
#ifndef PELL_TEXTURE_SPACE_FORMULAS_H
#define PELL_TEXTURE_SPACE_FORMULAS_H

/* K(t) = k(t^2/32) - k(3.4^2/32), k(y) = ((1 - y + y^2/2))^16 ~ exp(-16 y), for |t| < 3.4. Its integral function differs by 0.002 from
 * that of the Gaussian of its own variance, V = 0.969786. */
#define Y_SHIFT 0.36125f /* 3.4^2/32 */
#define K_END 0.00364057731f
#define K_SCALE 0.0303058276f /* V/32: y = K_SCALE (distance/sigma)^2 */
#define K_REACH 3.45255705f   /* 3.4/sqrt(V): the support in standard deviations */
/* Below 0.6 texels a sampled Gaussian loses variance. Such a blur is a mix of the one of 0.6 texels and the unblurred texel. */
#define S2_MIN 0.36f
#define S2_MIN_VARIANCE 0.347774418f /* variance of K, sampled at whole texels, at that width */
#define ADD_LEAST 1e-4f              /* texels^2: a blur that adds less is skipped */
#define MAX_TAPS 4096

/* sqrt(0.996): standard deviation of seven taps that are one standard deviation apart, in standard deviations. */
#define SEVEN_SPAN 0.99800f

#define TS_TAPS 13   /* taps of kernel=jittered-13 */
#define TS_LEVELS 32 /* maximum number of blurs in a chain, including those without weight */
#define TS_THICK 96  /* rows of a table over thickness */

#endif
