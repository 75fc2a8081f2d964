/* SPDX-License-Identifier: MIT
 *
 * kernels.h - the inner loops of the image-space method, and the images that they read.
 *
 * An irradiance image holds IS_TEXEL floats per pixel, so that one sample touches one half of a cache line: the light that entered, and the
 * plane visible in the pixel. The plane is w(u, v) = w + gu du + gv dv, du and dv in pixels from the pixel's centre: w is 1/depth in a
 * perspective view (linear on the screen for any plane) and depth in an orthographic one. With t = (tx, ty, 1) the ray through a point, f
 * the focal length in pixels:
 *
 *     perspective  n ~ (A, B, w - A tx - B ty),  A = f gu, B = f gv;   h = |(A, B, w - A tx - B ty)|: 1/h is the plane's distance from e
 *     orthographic n ~ (A, B, -1);                                     h = |(A, B, -1)|: 1/h is |cos theta|
 *
 * so that the Jacobian between the surface point p, depth z, and the point p' of the tangent plane, depth z', on one ray is (z/z')^3
 * h_p/h_p' in a perspective view, h_p/h_p' in an orthographic one.
 */
#ifndef PELL_IMAGE_SPACE_KERNELS_H
#define PELL_IMAGE_SPACE_KERNELS_H

#include "methods/image_space/formulas.h"

#include <pellucid/frame.h>

enum { IS_BLOCK = 16, IS_TEXEL = 8, IS_MARGIN = 16, IS_VIEWS = 9 };
enum is_texel { IS_RED, IS_GREEN, IS_BLUE, IS_W, IS_GU, IS_GV, IS_H, IS_KEY };

enum is_level { IS_UNIFORM_AT, IS_BROAD2_AT, IS_REACH2_AT, IS_QUARTER_AT }; /* as the fields of struct is_set */

/* The samples of a material, and the data of their weights. Offsets and rows of the material itself come first, then those of the
 * levels. */
struct is_set {
    float *offset;            /* owned or borrowed; for each profile and each class in turn: [(y mod n) * samples + k][3][16 lanes]: x, y in
                               * the tangent plane, mm, and 1/density */
    float *original;          /* owned or borrowed: the original offsets; NULL: offset holds them */
    float (*rows)[8];         /* owned or borrowed */
    float (*level)[IS_LEVEL]; /* owned or borrowed; by level; NULL: no levels */
    bool owned;
    float per_length2; /* 1/mm^2 */
    float reach2;      /* R'^2 in the unit of the tables */
    float uniform;     /* p_u at r = 0, in that unit */
    float broad2;      /* p_u is proportional to 1/(1 + r^2/broad2)^2; 0: it is uniform up to R' */
    float median;      /* mm: median radius of the mean of the channels' profiles */
    float scale[3];    /* M under a uniform irradiance of 1 */
    float quarter[3];  /* mm: radius with a quarter of the channel's light inside */
};

/* A view other than the camera's: P_view = rotate P_eye + shift, both in mm with x right, y down, z forward. */
struct is_view {
    const float *texels;
    int size; /* square */
    bool orthographic;
    float focal_px, centre_px;
    float rotate[3][3], shift[3];
};

/* A class of pixels: its number of samples per view. */
struct is_count {
    int samples, importance; /* number of importance samples, which come first */
    float uniform;           /* number of the others */
    int first;               /* samples of the previous classes in a row of a set */
};

/* One frame's work; the same for all rows and threads. */
struct is_work {
    const struct pell_frame *in;
    const struct pell_frame_light *out;
    ptrdiff_t stride;                      /* of the planes below, which have margins of IS_MARGIN pixels and rows */
    float *key, *w, *gu, *gv, *footprints; /* of the camera's pixels; key 0: empty; footprints off the plane per unit of w */
    float *alpha[3], *light[3];            /* weight of a pixel in the reconstruction, and its M */
    float *texels;                         /* the camera's irradiance image */
    ptrdiff_t texel_stride;                /* texels per row */
    const int32_t *solid;                  /* per pixel, texel_stride apart; NULL: keys are materials */
    const struct is_set *sets;             /* by material */
    struct is_count counts[IS_CLASSES];    /* without adaptive sampling only IS_CLASS_OF_ALL is used */
    int samples_row;                       /* samples of all classes */
    const uint8_t *classes;                /* of regions, from the frame's first one on; NULL: all IS_CLASS_OF_ALL */
    int regions_row;                       /* regions per row of the frame */
    int first_kind;                        /* samples of the first distribution; all if there is only one */
    int tile;                              /* 1, 2, 4, 8 */
    const struct is_view *views;
    int num_views;           /* not counting the camera's */
    bool jacobian, inverted; /* whether to apply the Jacobian; as misprinted */
    bool reconstruct;
    int renormalise; /* enum is_renormalise, never IS_BY_VIEWS */
    float factor;    /* scale of all results */
    float focal_px;
    float mid_x, mid_y; /* half the frame, px */
};

struct is_kernels {
    /* Loads key and w of row y. */
    void (*load)(const struct is_work *w, int y);
    /* Computes gu, gv and the texels of row y; rows y - 1 to y + 1 must be loaded. */
    void (*measure)(const struct is_work *w, int y);
    /* Computes M of row y to `light` or, without reconstruction, to `out`. Returns the number of pixels. */
    int (*gather)(const struct is_work *w, int y);
    /* Reconstructs row y of `light` to `out`. */
    void (*rebuild)(const struct is_work *w, int y);
};

#endif
