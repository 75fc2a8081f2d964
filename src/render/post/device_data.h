/* SPDX-License-Identifier: MIT
 *
 * device_data.h - push constants of the shaders of the stage "post", with the same bytes in C and in GLSL. Offsets count floats of a
 * buffer, in which planes follow one another.
 */
#ifndef PELL_POST_DEVICE_DATA_H
#define PELL_POST_DEVICE_DATA_H

#include "shared/language.h"

/* Size of a workgroup; four of them are a tile of depth of field. */
#define PELL_POST_GROUP_X 16
#define PELL_POST_GROUP_Y 4

/* Depth of field, in a window of whole rows of the image that begins with a row of tiles. */
struct pell_lens_push {
    float scale, inverse_focus; /* struct pell_dof_params */
    uint32_t stride, plane;     /* distance of rows, and of planes */
    uint32_t width, height;     /* of the window */
    uint32_t columns, rows;     /* tiles */
    int32_t x0, y0, x1, y1;     /* of the composite, in the window */
    uint32_t first;             /* 1: write the sum, 0: add to it */
};

/* A step of bloom: each value written is the weighted sum of a line of values. */
struct pell_bloom_push {
    uint32_t from, to;      /* offsets of the planes that are read and written */
    uint32_t of_color;      /* 1: read from the image, 0: from scratch */
    uint32_t stride;        /* of both */
    uint32_t width, height; /* of the plane that is written */
    int32_t size;           /* values per line that is read, mirrored at its ends */
    uint32_t down;          /* 1: lines are columns */
    int32_t factor;         /* the i-th value is made of those from factor i + first to factor i + last - 1 */
    int32_t first, last;
    uint32_t weights; /* offset in the table */
};

/* The last step of bloom: adds both Gaussians to a channel of the image. */
struct pell_mix_push {
    uint32_t from; /* offset of the channel */
    uint32_t stride, width, height;
    uint32_t low0, low1; /* offsets in scratch of the Gaussians at their smaller sizes */
    int32_t factor0, width0, height0;
    int32_t factor1, width1, height1;
    float rest, weight; /* weights of the image, and of each Gaussian */
};

/* The tone curve; see struct pell_post_tone. */
struct pell_show_push {
    uint32_t stride, width, height, plane;
    float exposure, min_alpha, curve, white_scale;
    uint32_t filmic;
};

#endif
