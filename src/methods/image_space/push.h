/* SPDX-License-Identifier: MIT
 *
 * push.h - push constants of the shaders of the image-space method: C11 and GLSL 4.60. Only scalars of 4 bytes.
 */
#ifndef PELL_IMAGE_SPACE_PUSH_H
#define PELL_IMAGE_SPACE_PUSH_H

#include "shared/language.h"

/* The grid is described in methods/gpu_planes.h. */
struct is_push {
    int32_t width, height; /* of the grid, px */
    int32_t x0, y0;        /* position of its first pixel in the image */
    int32_t image_width;   /* px */
    int32_t materials;
    int32_t orthographic;
    int32_t solids;              /* keys of pixels are solids + 1 instead of materials */
    int32_t strength;            /* whether strength applies; else it is 1 */
    int32_t colours;             /* whether there are base colours */
    int32_t samples;             /* per view */
    int32_t row_samples;         /* of all classes */
    int32_t adaptive;            /* with adaptive sampling: adapt.c */
    int32_t halves;              /* half of a class's samples are importance samples, else all or none, as of `samples` */
    int32_t importance;          /* importance samples among `samples`, which come first */
    int32_t first_kind;          /* samples of the first distribution; all if there is only one */
    int32_t tile;                /* px: 1, 2, 4, 8 */
    int32_t views;               /* not counting the camera's */
    int32_t view_size;           /* px */
    int32_t jacobian;            /* 0: none, 1, -1: inverted, as misprinted */
    int32_t by_weight, by_count; /* renormalisation; neither: none */
    float factor;                /* scale of all results */
    float focal_px;
    float mid_x, mid_y; /* half the size of the frame, px, in its coordinates */
};

#endif
