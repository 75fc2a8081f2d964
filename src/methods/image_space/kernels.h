/* SPDX-License-Identifier: MIT
 *
 * kernels.h - the inner loops of the image-space method, and the images that they work on.
 *
 * An irradiance image holds IS_TEXEL floats a pixel, so that one sample touches one half of a cache line: the light that entered, and the
 * plane that the pixel sees. The plane is w(u, v) = w + gu du + gv dv, du and dv in pixels from the pixel's centre: w is 1/depth in a
 * perspective view (linear on the screen for any plane) and depth in an orthographic one. With t = (tx, ty, 1) the ray through a point,
 * f the focal length in pixels:
 *
 *     perspective  n ~ (A, B, w - A tx - B ty),  A = f gu, B = f gv;   h = |(A, B, w - A tx - B ty)|: 1/h is the plane's distance from e
 *     orthographic n ~ (A, B, -1);                                     h = |(A, B, -1)|: 1/h is |cos theta|
 *
 * so that the Jacobian of spec (8) between the surface point p, depth z, and the point p' of the tangent plane, depth z', on one ray is
 * (z/z')^3 h_p/h_p' in perspective, h_p/h_p' in an orthographic view.
 */
#ifndef PELL_IMAGE_SPACE_KERNELS_H
#define PELL_IMAGE_SPACE_KERNELS_H

#include "methods/image_space/formulas.h"

#include <pellucid/frame.h>

enum { IS_BLOCK = 16, IS_TEXEL = 8, IS_MARGIN = 16, IS_VIEWS = 9 };
enum is_texel { IS_RED, IS_GREEN, IS_BLUE, IS_W, IS_GU, IS_GV, IS_H, IS_KEY };

enum is_level { IS_UNIFORM_AT, IS_BROAD2_AT, IS_REACH2_AT, IS_QUARTER_AT }; /* as the fields of struct is_set */

/* The samples of a material, and what they are weighed by. Offsets and rows of the material itself come first, then those of the levels. */
struct is_set {
    float *offset;            /* owned or another's, of each profile and each class after the other: [(y mod n) * samples + k][3][16 lanes]:
                               * x, y in the tangent plane, mm, and 1/density */
    float *made;              /* owned or another's: the offsets as they were made; NULL: as they are */
    float (*rows)[8];         /* likewise */
    float (*level)[IS_LEVEL]; /* likewise; of each level; NULL: there are none */
    bool owned;
    float per_length2; /* 1/mm^2 */
    float reach2;      /* R'^2 in the unit of the tables */
    float uniform;     /* p_u in that unit, at r = 0 */
    float broad2;      /* p_u falls with (1 + r^2/broad2)^2; 0: it is uniform up to R' */
    float middle;      /* mm: radius with half of the light inside, mean of the channels */
    float scale[3];    /* M of even light of 1 */
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

/* Of a class of pixels: how many samples each takes of each view. */
struct is_count {
    int samples, importance; /* importance samples among them, which come first */
    float uniform;           /* the others */
    int first;               /* samples of the classes before it in a row of a set */
};

/* One frame's work; the same for all rows and threads. */
struct is_work {
    const struct pell_frame *in;
    const struct pell_frame_light *out;
    ptrdiff_t stride;                   /* of the planes below, which have margins of IS_MARGIN pixels and rows */
    float *key, *w, *gu, *gv, *flat;    /* of the camera's pixels; key 0: none */
    float *alpha[3], *light[3];         /* how much a pixel takes part in the reconstruction, and its M */
    float *texels;                      /* the camera's irradiance image */
    ptrdiff_t texel_stride;             /* texels in a row */
    const int32_t *solid;               /* of pixels, texel_stride apart; NULL: materials are keys */
    const struct is_set *sets;          /* of materials */
    struct is_count counts[IS_CLASSES]; /* where they do not adapt, IS_CLASS_OF_ALL alone is there */
    int samples_row;                    /* samples of all classes */
    const uint8_t *classes;             /* of regions, from the picture's first on; NULL: all IS_CLASS_OF_ALL */
    int regions_row;                    /* regions in a row of the picture */
    int first_kind;                     /* samples before those of another distribution; all where there is one */
    int tile;                           /* 1, 2, 4, 8 */
    const struct is_view *views;
    int num_views;           /* without the camera's */
    bool jacobian, inverted; /* of the Jacobian: at all, as misprinted */
    bool reconstruct;
    int renormalise; /* enum is_renormalise, never IS_AS_VIEWS_ASK */
    float factor;    /* of all results */
    float focal_px;
    float mid_x, mid_y; /* half the picture, px */
};

struct is_kernels {
    /* key and w of row y. */
    void (*load)(const struct is_work *w, int y);
    /* gu, gv and the texels of row y; rows y - 1 to y + 1 are loaded. */
    void (*measure)(const struct is_work *w, int y);
    /* M of row y, to `light` or, without reconstruction, to `out`. Returns the number of pixels. */
    int (*gather)(const struct is_work *w, int y);
    /* Row y of `light` to `out`. */
    void (*rebuild)(const struct is_work *w, int y);
};

#endif
