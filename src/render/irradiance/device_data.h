/* SPDX-License-Identifier: MIT
 *
 * device_data.h - what direct.comp reads and writes, the same bytes in C and in GLSL buffers (std430).
 *
 * A result is some words of 16 bytes a point: of the lights that are no environment's what enters (W/m^2) and the number of rays;
 * with PELL_LIT_HIGHLIGHTS what is mirrored (W/(m^2 sr)), and what shadows took of it as struct pell_lighting has it; with
 * PELL_LIT_SINGLE what is scattered once, of all lights; then of each environment's lights what enters and the visibility of its smooth
 * rest, and what would enter if nothing were in the way.
 *
 * Units    mm; of light as in stage.h.
 */
#ifndef PELL_IRRADIANCE_DEVICE_DATA_H
#define PELL_IRRADIANCE_DEVICE_DATA_H

#include "shared/light_data.h"

/* Of a push. */
#define PELL_LIT_HIGHLIGHTS 1u
#define PELL_LIT_SINGLE 2u
/* Of a point: rays look for the visibility of the environment's smooth rest. */
#define PELL_LIT_AMBIENT 1u

/* Sizes of the tables, as pellucid/specular.h and optics/medium/specular.h have them. */
#define PELL_LIT_ALBEDO_MU 64
#define PELL_LIT_ALBEDO_ROUGHNESS 32
#define PELL_LIT_ROUGHNESS_MIN 0.03f
#define PELL_LIT_BOUNDARY_MU 256

#define PELL_LIT_NONE 0xffffffffu /* the material of no point */
#define PELL_LIT_GROUP 64         /* invocations of a workgroup */

struct pell_lit_point {
    PELL_VEC4 place;                                 /* w: epsilon */
    PELL_VEC4 geometric;                             /* unit; w: terminator_offset */
    PELL_VEC4 normal;                                /* unit; w: roughness */
    PELL_VEC4 view;                                  /* unit, toward the camera; w: curvature's shift, red */
    PELL_VEC4 tint;                                  /* w: shift, green */
    PELL_VEC4 f0;                                    /* w: shift, blue */
    uint32_t pattern0, pattern1, ambient0, ambient1; /* of the samples of lights, of the environment's smooth rest */
    uint32_t material, flags;                        /* of the scene; PELL_LIT_AMBIENT */
    uint32_t number, unused;                         /* of the multisample */
};

/* Of a material of the scene, as the stage sees it. */
struct pell_lit_material {
    float fd;           /* F0 of the dielectric */
    int32_t model;      /* of the lobe */
    int32_t smooth_at;  /* its boundary's table, in floats; -1: rough */
    float inverse_eta2; /* of `enter` */
    float single_eta2;
    float unused0, unused1, unused2;
    PELL_VEC4 enter_base, enter_slope; /* see render/angle.h */
    PELL_VEC4 single_albedo, single_g; /* see render/single.h */
};

/* A projected image: linear texels of 16 bytes. */
struct pell_lit_image {
    uint32_t first, width, height, nearest;
};

struct pell_lit_push {
    uint32_t count;   /* points */
    uint32_t results; /* words of 16 bytes a point */
    uint32_t lights, environments;
    uint32_t low, high; /* bits of the lights that count, as in struct pell_points_params; 0: all */
    uint32_t flags;
    uint32_t ambient_samples;
    int32_t light_bits; /* of the number of a light's samples of a frame */
};

#endif
