/* SPDX-License-Identifier: MIT
 *
 * push.h - the push constants of the shaders of the texture-space method, and a texel that light is transmitted to: C11 and GLSL 4.60.
 * Scalars of 4 bytes alone.
 */
#ifndef PELL_TEXTURE_SPACE_PUSH_H
#define PELL_TEXTURE_SPACE_PUSH_H

#include "shared/language.h"

/* Texel (x, y) of a map is entry `origin` + y `stride` + x of a buffer. */
struct ts_push {
    int32_t width, height, blocks, stride, origin; /* of the map */
    /* Of a blur. */
    int32_t near; /* blocks that are further from charts than this are left out */
    int32_t tilts;
    float before, after; /* mm^2 of the chain before and after it */
    float grid;          /* texels^2 that reading the map adds by itself */
    int32_t add;         /* the result to the sum, by these weights */
    float weight_r, weight_g, weight_b;
    /* Of lists. */
    int32_t count; /* entries: borders, or texels that light is transmitted to */
    int32_t far;   /* borders that are further from charts are left out */
    int32_t keep;  /* of borders: the fourth component */
    /* Of a level's transmission; the weights are the Gaussian's. */
    int32_t level, linear, slab;
    float variance, reach;  /* mm^2; mm, of fade=linear */
    float widest, thickest; /* mm */
};

/* Of read.comp: the picture, px, and the map of a solid. */
struct ts_read_push {
    int32_t pitch, rows;
    int32_t meshes;
    int32_t width, height, stride, origin;
    int32_t clear; /* pixels of other solids get 0 */
    float unblurred_r, unblurred_g, unblurred_b;
};

/* See struct ts_transmitted_texel. */
struct ts_through {
    int32_t at, from, also; /* texels; the lower left ones of four */
    float from_key, from_x, from_y, also_key, also_x, also_y;
    float part, apart, m, opposed;
    int32_t round;
    float left_r, left_g, left_b, strength;
};

#endif
