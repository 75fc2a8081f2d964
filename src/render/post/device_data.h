/* SPDX-License-Identifier: MIT
 *
 * device_data.h - what the shaders of the frame's end are pushed, the same bytes in C and in GLSL. Offsets count floats of a buffer, in
 * which planes follow one another.
 */
#ifndef PELL_POST_DEVICE_DATA_H
#define PELL_POST_DEVICE_DATA_H

#include "shared/language.h"

/* A workgroup; four of them are a tile of the lens. */
#define PELL_POST_GROUP_X 16
#define PELL_POST_GROUP_Y 4

/* Of depth of field: a window of whole rows of the image, which begins with a row of tiles. */
struct pell_lens_push {
    float scale, inverse_focus; /* as struct pell_dof_params has them */
    uint32_t stride, plane;     /* plane: from one to the next */
    uint32_t width, height;     /* of the window */
    uint32_t columns, rows;     /* tiles */
    int32_t x0, y0, x1, y1;     /* of the composite, in the window */
    uint32_t first;             /* 1: write the sum, 0: add to it */
};

/* Of a step of bloom: each value written is the weighted sum of a line of values. */
struct pell_spread_push {
    uint32_t from, to;      /* of the plane that is read, of that which is written */
    uint32_t of_color;      /* 1: read from the image, 0: from the room */
    uint32_t stride;        /* of both */
    uint32_t width, height; /* written */
    int32_t size;           /* values in a line that is read, mirrored at its ends */
    uint32_t down;          /* 1: lines are columns */
    int32_t factor;         /* the i-th value is made of those from factor i + first to factor i + last - 1 */
    int32_t first, last;
    uint32_t weights; /* of the table */
};

/* Of bloom's end: a channel of the image, with half the weight for each Gaussian. */
struct pell_mix_push {
    uint32_t from; /* of the channel */
    uint32_t stride, width, height;
    uint32_t low0, low1; /* of the room: both Gaussians at their smaller sizes */
    int32_t factor0, width0, height0;
    int32_t factor1, width1, height1;
    float rest, weight; /* of the image, of each Gaussian */
};

/* Of the tone curve; see struct pell_post_tone. */
struct pell_show_push {
    uint32_t stride, width, height, plane;
    float exposure, straight, curve, white_scale;
    uint32_t filmic;
};

#endif
