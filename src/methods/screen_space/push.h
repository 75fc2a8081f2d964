/* SPDX-License-Identifier: MIT
 *
 * push.h - push constants of the shaders of the screen-space method: C11 and GLSL 4.60. Only scalars of 4 bytes.
 */
#ifndef PELL_SCREEN_SPACE_PUSH_H
#define PELL_SCREEN_SPACE_PUSH_H

#include "shared/language.h"

#define SCREEN_PLANNED 8 /* steps per pass of plan.comp */

/* The grid is the part of the image that contains the frame's rectangle, from a multiple of 16 pixels on: blocks of 16 pixels of a
 * row. */
struct screen_push {
    int32_t width, height;             /* of the grid, px; the width is a multiple of 16 */
    int32_t x0, y0;                    /* position of its first pixel in the image */
    int32_t image_width, image_height; /* px */
    int32_t row;                       /* entries of a row of the table: materials + 1 */
    int32_t base;                      /* first row of this frame's steps */
    int32_t total;                     /* the row of the profiles' totals */
    int32_t step;                      /* or term of the separable kernel */
    int32_t planned;                   /* the first planned step */
    int32_t end;                       /* one past the last step */
    int32_t whole;                     /* the step's result replaces the sum, for inspection */
    int32_t orthographic;
    int32_t strength;         /* whether strength applies; else it is 1 */
    int32_t rank, taps;       /* of the separable kernel */
    float depth_mm, fixed_mm; /* mm per pixel = depth * depth_mm + fixed_mm */
    float ratio2;             /* scales all variances */
    float skip;               /* px^2: a step that adds less is skipped */
    float correction, maxdd, unit;
};

#endif
