/* SPDX-License-Identifier: MIT
 *
 * device_data.h - data of the passes that render an image, with the same bytes in C and in GLSL buffers (std430).
 *
 * A sample is rendered in batches of tiles of 8 x 8 pixels, one workgroup per tile. Data of a batch (points, hits, insides; and results,
 * see irradiance/device_data.h) is indexed by the pixel's index in the batch, data of the image by y * pitch + x.
 *
 * Units    mm; light as in irradiance/stage.h.
 */
#ifndef PELL_PICTURE_DEVICE_DATA_H
#define PELL_PICTURE_DEVICE_DATA_H

#include "render/irradiance/device_data.h"

#define PELL_PICTURE_TILE 8 /* px */
#define PELL_PICTURE_GROUP 64

/* Flags of a frame. Those of PELL_LIT_TOGETHER are passed on to points. */
#define PELL_PICTURE_PUBLISHED 1u  /* the exit factor is not normalized */
#define PELL_PICTURE_STRENGTH 2u   /* the method reads the scattering strength */
#define PELL_PICTURE_SINGLE 4u     /* single scattering is separate */
#define PELL_PICTURE_SHARED 8u     /* shadows of highlights are filtered over pixels */
#define PELL_PICTURE_THROUGH 16u   /* there is straight transmission */
#define PELL_PICTURE_FIRST 32u     /* the frame's first sample */
#define PELL_PICTURE_SKY 64u       /* there are environments */
#define PELL_PICTURE_SCATTERS 128u /* a method provides scattered light */
#define PELL_PICTURE_SPREADS 256u  /* straight transmission is spread */
#define PELL_PICTURE_INSIDES 512u  /* light inside the solids at points has been computed */
#define PELL_PICTURE_ORTHOGRAPHIC 1024u
#define PELL_PICTURE_MAPPED 2048u  /* some material has maps, or some mesh colours */
#define PELL_PICTURE_HITS 4096u    /* the method reads surface positions, */
#define PELL_PICTURE_BASES 8192u   /* or base colours */
#define PELL_PICTURE_LENS 16384u   /* depth of field is applied to the sample */
#define PELL_PICTURE_SHEETS 32768u /* some material is a thin sheet: a batch is followed by the far sides of its points */

/* Flags of the data of solids around points: struct pell_irradiance_params. */
#define PELL_KNOWN_SHAPE 1u   /* curvature */
#define PELL_KNOWN_LOCAL 2u   /* entering light is scaled by the local gain, */
#define PELL_KNOWN_OPPOSED 4u /* or by that for opposed faces */
#define PELL_KNOWN_SOLIDS 8u  /* solid_light */
#define PELL_KNOWN_BETWEEN 16u
#define PELL_KNOWN_INDIRECT 32u
#define PELL_KNOWN_TRANSMITS 64u

/* Flags of a material. */
#define PELL_PICTURE_OPAQUE 1u
#define PELL_PICTURE_TEXTURED 2u     /* translucent, with a textured colour */
#define PELL_PICTURE_SMOOTH 4u       /* light leaves through a smooth boundary */
#define PELL_PICTURE_LINEAR_WIDTH 8u /* the lobe's width is the roughness, not its square */

/* Parameters of a sample. */
struct pell_picture_frame {
    PELL_VEC4 origin, forward, right, up;  /* see struct pell_view; w: focal_px; shadow rays per pixel and light; shift_x; shift_y */
    int32_t width, height, pitch, columns; /* px; columns: in tiles */
    int32_t x0, y0, x1, y1;                /* rectangle of the image that may be covered */
    uint32_t flags, seed, sample_index;
    float weight;
    int32_t mean_at;          /* index of the lobes' mean albedos among the tables' floats */
    uint32_t known;           /* PELL_KNOWN_* flags */
    float depth_mm, fixed_mm; /* a pixel at depth d is d depth_mm + fixed_mm wide */
    float spread;             /* of struct pell_surface */
    uint32_t unused0, unused1, unused2;
};

/* A material of the scene. */
struct pell_picture_material {
    PELL_VEC4 base;       /* w: strength */
    PELL_VEC4 specular;   /* w: roughness */
    PELL_VEC4 emissive;   /* w: metallic */
    PELL_VEC4 total;      /* total of its profile; w: exponent of the base colour for entering light */
    PELL_VEC4 exit_base;  /* see render/angle.h; w: exponent of the base colour for leaving light */
    PELL_VEC4 exit_slope; /* w: mean transmittance of its smooth boundary */
    PELL_VEC4 enter_mean; /* w: 1 over the square of its index, for light that leaves */
    PELL_VEC4 sheet;      /* transmission of a thin sheet; w: its fraction; 0: not a thin sheet */
    PELL_VEC4 radius;     /* mean radius of its profile, mm; w unused */
    uint32_t flags;
    float normal_scale;
    float diffuse; /* diffuse fraction of the light */
    uint32_t unused0;
};

/* Surface at a pixel's hit. */
struct pell_picture_hit {
    PELL_VEC4 albedo;     /* colour factor of entering light; w: depth */
    PELL_VEC4 exit_color; /* colour factor of leaving light; w: strength */
    PELL_VEC4 emissive;   /* w: bits of the method's material */
    PELL_VEC4 sheet;      /* for a thin sheet, transmitted fraction; w: reflected fraction, 1 for other surfaces */
    uint32_t mesh, triangle;
    float u, v;
};

/* Effects of a solid's shape, and of the light inside it, on the light of a pixel: irradiance/inside.c. */
struct pell_picture_inside {
    PELL_VEC4 all, single; /* factors of entering light; w of all: fraction of a slab's variance by which straight light spreads */
    PELL_VEC4 sum_weight, transmitted, solved, light, entered; /* struct pell_inside */
    PELL_VEC4 indirect, indirect_transmitted; /* indirect light that enters here, and that is transmitted from the far side */
};

/* Shading of a pixel for the composite. */
struct pell_picture_shown {
    PELL_VEC4 factor;   /* factor of leaving light; w: bits of the scene's material + 1, or 0 */
    PELL_VEC4 specular; /* w: luminance of arriving light, without albedo */
};

/* Data for stages that read neighbouring pixels. */
struct pell_picture_around {
    PELL_VEC4 hidden;       /* see struct pell_lighting; w: bits of the numbers of rays */
    PELL_VEC4 lost;         /* the same; w unused */
    PELL_VEC4 meter_factor; /* from entering light to metered light; w unused */
    PELL_VEC4 normal;       /* shading normal; w: depth */
};

/* Statistics of a row of pixels. */
struct pell_picture_row {
    float arriving, covered;              /* over all samples: luminance of arriving light, and number of covered pixels */
    uint32_t pixels, translucent, x0, x1; /* of the last sample: covered pixels; translucent pixels, and their range of x */
    uint32_t rays, through;
    float depth, strength;         /* of the pixel where a method's kernel is widest; depth 0: none */
    float finest, widest;          /* of straight transmission: least width of a pixel, mm, and largest variance, mm^2; widest < 0: none */
    uint32_t straight0, straight1; /* range of x with straight transmission */
};

/* Push constants of passes over a batch. */
struct pell_picture_push {
    uint32_t first, count;     /* range of tiles */
    uint32_t results, through; /* per point, in words of 16 bytes: number of words, and offset of those of transmission */
    uint32_t far_sides;        /* offset of far sides, in points; 0: none */
};

/* Push constants of the composite: destination of a sample for depth of field (post/device.h). */
struct pell_composite_push {
    uint32_t plane, stride; /* floats */
    int32_t y0;
};

/* Push constants of a level of spread/stage.h, or of its blur. */
struct pell_spread_push {
    int32_t x0, y0, x1, y1;
    float below, here, above; /* mm^2: variances of the level and of its neighbours */
    float inverse;            /* 1/mm^2: 1 over the blur's squared reach */
    int32_t taps, spacing, level;
    uint32_t down, first;
};

#endif
