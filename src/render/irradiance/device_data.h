/* SPDX-License-Identifier: MIT
 *
 * device_data.h - inputs and outputs of direct.comp and transmission.comp, with the same bytes in C and in GLSL buffers (std430).
 *
 * A result is a number of 16-byte words per point: entering light (W/m^2) of lights that belong to no environment, and the number of
 * rays; with PELL_LIT_HIGHLIGHTS the highlights (W/(m^2 sr)), and what shadows removed as in struct pell_lighting; with PELL_LIT_SINGLE
 * the single scattering of all lights; then for each environment's lights the entering light with the count of directions from which the
 * smooth part arrives (shared/through.h), and the unoccluded entering light. If a light has more samples than a slice: the state of its
 * highlight. Then, where there is transmission, for points with PELL_LIT_STRAIGHT: light transmitted through thin parts and, summed over
 * channels, times its path length in mm; where a ray along the inward normal leaves the solid, the transmitted fraction of the smooth
 * part's light, and the distance in mm; the normal there, and the number of rays.
 *
 * A pass runs in slices of a few samples each, which accumulate in the results: drivers abort loops that take too long (Mesa's for CPUs
 * after 65535 iterations of all loops together), and devices that drive a display abort long work.
 *
 * Units: mm; light as in stage.h.
 */
#ifndef PELL_IRRADIANCE_DEVICE_DATA_H
#define PELL_IRRADIANCE_DEVICE_DATA_H

#include "shared/light_data.h"
#include "shared/through.h"

/* Flags of struct pell_lit_push. */
#define PELL_LIT_HIGHLIGHTS 1u
#define PELL_LIT_SINGLE 2u
#define PELL_LIT_START 4u   /* the first slice: results are not initialized */
#define PELL_LIT_RESUME 8u  /* the slice has one light, whose first samples were in the previous slice, */
#define PELL_LIT_PAUSE 16u  /* whose last samples are in a later slice */
#define PELL_LIT_PASSES 32u /* media pass light into their shadows */

#define PELL_LIT_SLICE 16  /* samples of a slice of direct.comp, */
#define PELL_LIT_THROUGH 8 /* and of transmission.comp, which traces more rays per sample; */
#define PELL_LIT_PASSING 4 /* of both with PELL_LIT_PASSES */
#define PELL_LIT_HIGHLIGHT_STATE_WORDS 2
#define PELL_LIT_THROUGH_WORDS 3

/* Flags of a point. */
#define PELL_LIT_AMBIENT 1u           /* trace the visibility of the environment's smooth part */
#define PELL_LIT_STRAIGHT 2u          /* trace straight transmission */
#define PELL_LIT_SEEN 4u              /* the camera sees the point */
#define PELL_LIT_BACK 8u              /* on the side from which the triangle's corners run clockwise */
#define PELL_LIT_TOGETHER 0xc0000000u /* pell_lights.together, for a pixel */
#define PELL_LIT_STRAIGHT_LEAST 1e-4f /* fraction of transmitted light above which rays are traced: more than rounding errors of 0 */
/* Flags of a light, in addition to those of light_data.h: its index among `turns` lights that alternate over multisamples; powers of 2. */
#define PELL_LIT_TURN_AT 8
#define PELL_LIT_TURNS_AT 16

/* Salts of the patterns of ambient rays: from the point, and from where light enters a thin part. */
#define PELL_AMBIENT_SALT 0xa54ff53au
#define PELL_BEYOND_SALT 0x3c6ef372u

/* Sizes of the tables, as in pellucid/specular.h and optics/medium/specular.h. */
#define PELL_LIT_ALBEDO_MU 64
#define PELL_LIT_ALBEDO_ROUGHNESS 32
#define PELL_LIT_ROUGHNESS_MIN 0.03f
#define PELL_LIT_BOUNDARY_MU 256

#define PELL_LIT_THICKNESS_STEPS 512

#define PELL_LIT_NONE 0xffffffffu /* material of an unused point */
#define PELL_LIT_GROUP 64         /* invocations of a workgroup */

struct pell_lit_point {
    PELL_VEC4 position;                  /* w: epsilon */
    PELL_VEC4 geometric;                 /* unit; w: terminator_offset */
    PELL_VEC4 normal;                    /* unit; w: roughness */
    PELL_VEC4 view;                      /* unit, toward the camera; w: curvature's shift, red */
    PELL_VEC4 tint;                      /* w: shift, green */
    PELL_VEC4 f0;                        /* w: shift, blue */
    uint32_t hash0, hash1, curve, first; /* seeds of sample patterns: struct pell_lanes */
    uint32_t material, flags;            /* material: of the scene */
    uint32_t sample_index;               /* of the multisample */
    float slope_variance;                /* of struct pell_surface */
};

/* A scene material, as needed by the stage. */
struct pell_lit_material {
    float fd;           /* F0 of the dielectric */
    int32_t model;      /* of the lobe */
    int32_t smooth_at;  /* offset of its boundary's table, in floats; -1: rough */
    float inverse_eta2; /* of enter_base, enter_slope, pass_base and pass_slope */
    float single_eta2;
    int32_t thickness_at; /* offset of its thickness table, in floats; -1: no transmission */
    float thickest;       /* mm: largest path length with transmission */
    int32_t opaque;
    PELL_VEC4 enter_base, enter_slope; /* see render/angle.h */
    PELL_VEC4 pass_base, pass_slope, pass_per_mm;
    PELL_VEC4 single_albedo, single_g; /* see render/single.h */
    PELL_VEC4 sigma_t;                 /* of media that pass light into their shadows: see render/unscattered/stage.h */
    float roughness, rho_s;            /* of their boundary, without maps */
    int32_t is_traced, unused;
};

/* A mesh of the scene. */
struct pell_lit_mesh {
    uint32_t corners, normals; /* first word of its triangles' corners, and of its normals; PELL_LIT_NONE: none */
    int32_t object, material;
};

/* A projected image: linear texels of 16 bytes. */
struct pell_lit_image {
    uint32_t first, width, height, nearest;
};

#define PELL_LIT_HIGHLIGHT_WORDS 3 /* per point with PELL_LIT_HIGHLIGHTS: highlights, what shadows removed of them, and of entering light */

struct pell_lit_push {
    uint32_t count;   /* points */
    uint32_t results; /* 16-byte words per point */
    uint32_t environments;
    uint32_t low, high; /* mask of requested lights, as in struct pell_points_params; 0: all */
    uint32_t flags;
    uint32_t ambient_samples;
    int32_t light_bits, ambient_bits;       /* bits of a light's sample count per frame, and of the environment's */
    uint32_t parts;                         /* of pell_lights.parts */
    uint32_t highlight_state, through;      /* offsets of the highlight's state and of transmission in a point's words */
    uint32_t sky, sky_end;                  /* in the slice: samples of the environment, */
    uint32_t light, light_end, first, last; /* lights, and samples of each */
};

#endif
