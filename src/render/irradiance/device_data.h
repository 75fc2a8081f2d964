/* SPDX-License-Identifier: MIT
 *
 * device_data.h - what direct.comp and transmission.comp read and write, the same bytes in C and in GLSL buffers (std430).
 *
 * A result is some words of 16 bytes a point: of the lights that are no environment's what enters (W/m^2) and the number of rays;
 * with PELL_LIT_HIGHLIGHTS what is mirrored (W/(m^2 sr)), and what shadows took of it as struct pell_lighting has it; with
 * PELL_LIT_SINGLE what is scattered once, of all lights; then of each environment's lights what enters, with how many directions see the
 * sky, and what would enter if nothing were in the way. Where a light has more samples than a slice: the state of its highlight. Then,
 * where something is transmitted, of points with PELL_LIT_STRAIGHT: what lights send through thin parts and, in all channels together,
 * times the mm that it went; where a ray along the inward normal leaves the solid, the share of the smooth rest's light that comes from
 * there, and how many mm it is away; the normal there, and the number of rays.
 *
 * A pass runs in slices of a few samples each, which add to the results: drivers end loops that take too long (Mesa's for CPUs after 65535
 * turns of all loops together), and devices that show a screen end long work.
 *
 * Units    mm; of light as in stage.h.
 */
#ifndef PELL_IRRADIANCE_DEVICE_DATA_H
#define PELL_IRRADIANCE_DEVICE_DATA_H

#include "shared/light_data.h"

/* Of a push. */
#define PELL_LIT_HIGHLIGHTS 1u
#define PELL_LIT_SINGLE 2u
#define PELL_LIT_START 4u  /* the first slice: nothing is there yet */
#define PELL_LIT_RESUME 8u /* the slice has one light, whose first samples were in the one before, */
#define PELL_LIT_PAUSE 16u /* whose last ones come later */

#define PELL_LIT_SLICE 16  /* samples of a slice of direct.comp, */
#define PELL_LIT_THROUGH 8 /* and of transmission.comp, which sends more rays for each */
#define PELL_LIT_SHINE_WORDS 3
#define PELL_LIT_THROUGH_WORDS 3

/* Of a point: rays look for the visibility of the environment's smooth rest; and for light that goes straight through the solid; the
 * camera sees it. */
#define PELL_LIT_AMBIENT 1u
#define PELL_LIT_STRAIGHT 2u
#define PELL_LIT_SEEN 4u
#define PELL_LIT_TOGETHER 0xc0000000u /* pell_lights.together of a pixel */
#define PELL_LIT_BACK 8u              /* the triangle's corners run clockwise from there */
#define PELL_LIT_STRAIGHT_LEAST 1e-4f /* share of transmitted light for which rays are sent: more than what rounding leaves of none */
/* Of a light, beside those of light_data.h: which of each `turns` neighbours it is, that take turns over the multisamples; powers of 2. */
#define PELL_LIT_TURN_AT 8
#define PELL_LIT_TURNS_AT 16

/* Of the patterns of the rays that look for an environment: from the point, and from where light enters a thin part. */
#define PELL_AMBIENT_SALT 0xa54ff53au
#define PELL_BEYOND_SALT 0x3c6ef372u

/* Sizes of the tables, as pellucid/specular.h and optics/medium/specular.h have them. */
#define PELL_LIT_ALBEDO_MU 64
#define PELL_LIT_ALBEDO_ROUGHNESS 32
#define PELL_LIT_ROUGHNESS_MIN 0.03f
#define PELL_LIT_BOUNDARY_MU 256

#define PELL_LIT_THICKNESS_STEPS 512

#define PELL_LIT_NONE 0xffffffffu /* the material of no point */
#define PELL_LIT_GROUP 64         /* invocations of a workgroup */

struct pell_lit_point {
    PELL_VEC4 place;                     /* w: epsilon */
    PELL_VEC4 geometric;                 /* unit; w: terminator_offset */
    PELL_VEC4 normal;                    /* unit; w: roughness */
    PELL_VEC4 view;                      /* unit, toward the camera; w: curvature's shift, red */
    PELL_VEC4 tint;                      /* w: shift, green */
    PELL_VEC4 f0;                        /* w: shift, blue */
    uint32_t hash0, hash1, curve, first; /* what patterns of samples are made of: struct pell_lanes */
    uint32_t material, flags;            /* of the scene; PELL_LIT_AMBIENT, PELL_LIT_STRAIGHT */
    uint32_t number;                     /* of the multisample */
    float turned;                        /* of struct pell_surface */
};

/* Of a material of the scene, as the stage sees it. */
struct pell_lit_material {
    float fd;           /* F0 of the dielectric */
    int32_t model;      /* of the lobe */
    int32_t smooth_at;  /* its boundary's table, in floats; -1: rough */
    float inverse_eta2; /* of `enter` */
    float single_eta2;
    int32_t thickness_at; /* its thickness table, in floats; -1: nothing is transmitted */
    float thickest;       /* mm: no light gets farther */
    int32_t opaque;
    PELL_VEC4 enter_base, enter_slope; /* see render/angle.h */
    PELL_VEC4 pass_base, pass_slope, pass_thick;
    PELL_VEC4 single_albedo, single_g; /* see render/single.h */
};

/* Of a mesh of the scene. */
struct pell_lit_mesh {
    uint32_t corners, normals; /* the first word of its triangles' corners, and of its normals; PELL_LIT_NONE: it has none */
    int32_t object, material;
};

/* A projected image: linear texels of 16 bytes. */
struct pell_lit_image {
    uint32_t first, width, height, nearest;
};

#define PELL_LIT_HIGHLIGHT_WORDS 3 /* a point's, with PELL_LIT_HIGHLIGHTS: what is mirrored, what shadows took of it, and of what enters */

struct pell_lit_push {
    uint32_t count;   /* points */
    uint32_t results; /* words of 16 bytes a point */
    uint32_t environments;
    uint32_t low, high; /* bits of the lights that count, as in struct pell_points_params; 0: all */
    uint32_t flags;
    uint32_t ambient_samples;
    int32_t light_bits, ambient_bits; /* of the number of a light's samples of a frame, and of the environment's */
    uint32_t parts;                   /* of pell_lights.parts */
    uint32_t shine, through;          /* where a point's state of a highlight, and its words of transmission, are among its words */
    uint32_t sky, sky_end;            /* of the slice: samples of the environment; lights, and samples of each of them */
    uint32_t light, light_end, first, last;
};

#endif
