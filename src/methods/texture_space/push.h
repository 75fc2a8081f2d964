/* SPDX-License-Identifier: MIT
 *
 * push.h - push constants of the shaders of the texture-space method, and a texel that receives transmitted light: C11 and GLSL 4.60. Only
 * scalars of 4 bytes.
 */
#ifndef PELL_TEXTURE_SPACE_PUSH_H
#define PELL_TEXTURE_SPACE_PUSH_H

#include "shared/language.h"

/* Texel (x, y) of a map is entry `origin` + y `stride` + x of a buffer. */
struct ts_push {
    int32_t width, height, blocks, stride, origin; /* of the map */
    /* Of a blur. */
    int32_t near; /* blocks farther from charts are left out */
    int32_t tilts;
    float before, after; /* mm^2: variance of the chain before and after it */
    float read_variance; /* texels^2 that reading the map adds */
    int32_t add;         /* adds the result to the sum, with these weights */
    float weight_r, weight_g, weight_b;
    /* Of lists. */
    int32_t count; /* entries: borders, or texels that receive transmitted light */
    int32_t far;   /* borders farther from charts are left out */
    int32_t keep;  /* of borders: keep the fourth component */
    /* Of a level's transmission; the weights are the Gaussian's. */
    int32_t level, linear, slab;
    float variance, reach;  /* mm^2; mm, of fade=linear */
    float widest, thickest; /* mm */
};

/* Of read.comp: the image, px, and the map of a solid. */
struct ts_read_push {
    int32_t pitch, rows;
    int32_t meshes;
    int32_t width, height, stride, origin;
    int32_t clear; /* pixels of other solids are set to 0 */
    float unblurred_r, unblurred_g, unblurred_b;
};

/* See struct ts_transmitted_texel. */
struct ts_entry {
    int32_t at, from, second; /* texels; the lower left ones of four */
    float from_key, from_x, from_y, second_key, second_x, second_y;
    float second_weight, surface_distance, m, opposed;
    int32_t along_surface;
    float remaining_r, remaining_g, remaining_b, strength;
};

#endif
