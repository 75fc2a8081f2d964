/* SPDX-License-Identifier: MIT
 *
 * formulas.h - numbers of the texture-space method's blurs that its kernels in C and its shaders share: C11 and GLSL 4.60. What they mean:
 * README.md.
 */
#ifndef PELL_TEXTURE_SPACE_FORMULAS_H
#define PELL_TEXTURE_SPACE_FORMULAS_H

/* K(t) = k(t^2/32) - k(3.4^2/32), k(y) = ((1 - y + y^2/2))^16 ~ exp(-16 y), for |t| < 3.4. Its integral function differs by 0.002 from
 * that of the Gaussian of its own variance, V = 0.969786. */
#define Y_SHIFT 0.36125f /* 3.4^2/32 */
#define K_END 0.00364057731f
#define K_FALL 0.0303058276f /* V/32: y = K_FALL (distance/sigma)^2 */
#define K_REACH 3.45255705f  /* 3.4/sqrt(V): the support in standard deviations */
/* Under 0.6 texels a sampled Gaussian loses variance. Such a blur is the one of 0.6 texels, mixed with the texel as it is. */
#define S2_MIN 0.36f
#define S2_MIN_VARIANCE 0.347774418f /* that K, sampled at whole texels, has there */
#define ADD_LEAST 1e-4f              /* texels^2: a blur that adds less is none */
#define TAPS_MOST 4096

#define SEVEN_SPAN 0.99800f /* sqrt(0.996): what seven taps a standard deviation apart have, in standard deviations */

#define TS_TAPS 13   /* of kernel=jittered-13 */
#define TS_LEVELS 32 /* blurs of a chain, those without weight included */
#define TS_THICK 96  /* rows of a table over thickness */

#endif
