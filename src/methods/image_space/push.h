/* SPDX-License-Identifier: MIT
 *
 * push.h - the push constants of the shaders of the image-space method: C11 and GLSL 4.60. Scalars of 4 bytes alone.
 */
#ifndef PELL_IMAGE_SPACE_PUSH_H
#define PELL_IMAGE_SPACE_PUSH_H

#include "shared/language.h"

/* The grid is that of methods/gpu_planes.h. */
struct is_push {
    int32_t width, height; /* of the grid, px */
    int32_t x0, y0;        /* its first pixel in the picture */
    int32_t picture_width; /* px */
    int32_t materials;
    int32_t orthographic;
    int32_t solids;              /* keys of pixels are their solids + 1, not their materials */
    int32_t strength;            /* strength counts, else it is 1 */
    int32_t colours;             /* base colours are there */
    int32_t samples;             /* of each view */
    int32_t row_samples;         /* of all classes */
    int32_t adaptive;            /* there are classes: adapt.c */
    int32_t halves;              /* half the samples of a class are importance samples, else as many as of `samples` */
    int32_t importance;          /* samples among `samples`, which come first */
    int32_t first_kind;          /* samples before those of another distribution; all where there is one */
    int32_t tile;                /* px: 1, 2, 4, 8 */
    int32_t views;               /* without the camera's */
    int32_t view_size;           /* px */
    int32_t jacobian;            /* 0: not, 1, -1: inverted, as misprinted */
    int32_t by_weight, by_count; /* renormalise; neither: never */
    float factor;                /* of all results */
    float focal_px;
    float mid_x, mid_y; /* half the picture, px, in its coordinates */
};

#endif
