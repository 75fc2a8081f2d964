/* SPDX-License-Identifier: MIT
 *
 * formulas.h - constants and formulas of the image-space method shared by its C kernels and its shaders: C11 and GLSL 4.60. Formulas are
 * macros, because kernels evaluate them on vectors. Explanations: kernels.h and README.md.
 */
#ifndef PELL_IMAGE_SPACE_FORMULAS_H
#define PELL_IMAGE_SPACE_FORMULAS_H

/* Radial tables: rows at squared radii in units of length^2, IS_ROWS_OCTAVE per factor of two, from 2^-IS_OCTAVES to 2^IS_OCTAVES. A row
 * holds R of each channel over its total, and the mean of these over the channels with light (the density of importance samples), all times
 * length^2; then the increments of the four to the next row. R is constant below the first row and 0 beyond the last. */
#define IS_OCTAVES 24
#define IS_SHIFT 18
#define IS_ROWS_OCTAVE (1 << (23 - IS_SHIFT))
#define IS_ROWS (2 * IS_OCTAVES * IS_ROWS_OCTAVE)
#define IS_SQUARE_MIN (1.0f / 16777216.0f)                   /* 2^-IS_OCTAVES */
#define IS_SQUARE_MAX 16777216.0f                            /* 2^IS_OCTAVES */
#define IS_SQUARE_LAST 16777214.0f                           /* the last float below */
#define IS_FIRST_ROW ((127 - IS_OCTAVES) << (23 - IS_SHIFT)) /* a float's bits >> IS_SHIFT */

/* If a texture gives the colour and the scattering distance depends on it, there are profiles of the material's mean free path at IS_LEVELS
 * albedos, uniform in 1 - sqrt(1 - albedo): samples are those of the nearest level, weights are interpolated between two levels. */
#define IS_LEVELS 16
#define IS_ALBEDO_MIN 0.01f
#define IS_ALBEDO_MAX 0.98f
#define IS_LEVEL 8 /* floats: enum is_level */
/* `root`: sqrt(1 - albedo). */
#define IS_LEVEL_COORD(root, root_least, root_most) (((root_least) - (root)) * ((IS_LEVELS - 1.0f) / ((root_least) - (root_most))))

#define IS_FAR_PX 1e5f                   /* upper bound of the distance between a pixel and a lookup in an image */
#define IS_WEIGHT_MAX 1e12f              /* upper bound of a sample's weight; larger ones are rounding errors */
#define IS_STRENGTH_MIN (1.0f / 1024.0f) /* below this strength light leaves where it enters */
#define IS_SLOPE_MAX 20.0f               /* upper bound of 1/cos of a surface seen from the view */
#define IS_OFF_PLANE (1.0f / 16.0f)      /* 1/px^2: taps of the reconstruction may be up to 4 pixel footprints off both planes together */
/* Channels for which a quarter of the light stays within `from` .. `to` pixels take part in the reconstruction not at all .. fully. */
#define IS_RECONSTRUCT_FROM 0.4f
#define IS_RECONSTRUCT_TO 1.5f
#define IS_RECONSTRUCT(t) ((t) * (t) * (3.0f - 2.0f * (t))) /* t in [0, 1] */

/* With adaptive sampling (adapt.c) a frame is divided into regions of pixels, from its first pixel on. */
#define IS_REGION_X 16
#define IS_REGION_Y 8 /* >= the largest tile */
#define IS_CLASSES 4  /* sample counts: half of `samples`, one, two, and four times */
#define IS_CLASS_OF_ALL 1
#define IS_MAX_ADAPTED 128 /* larger sample counts are not adapted */
/* Steps of log2 of the variance: 8 per factor of 2, so 16 from one class to the next. */
#define IS_STEP_SHIFT 20
#define IS_CLASS_STEPS 16
#define IS_STEPS 2048
#define IS_STEP_OF_ONE 1024      /* step of a variance of 1 */
#define IS_MAX_DISTANCE 64       /* px: upper bound of the first distance */
#define IS_SECOND_DISTANCE 4     /* second distance relative to the first */
#define IS_NEAR 3.0f             /* largest depth difference, relative to that distance on the surface */
#define IS_DIFFERENCE_BIAS 1e-4f /* relative to the squared light: bias added to a squared difference */

/* w of a texel's plane at an offset of du and dv pixels from its centre. */
#define IS_PLANE_AT(w, gu, gv, du, dv) ((w) + (gu) * (du) + (gv) * (dv))
/* dA_p/dA_p' of a perspective view: h_p/h_p' times the cube of z/z'. */
#define IS_AREA_RATIO(h_ratio, z_ratio) ((h_ratio) * ((z_ratio) * (z_ratio) * (z_ratio)))

#endif
