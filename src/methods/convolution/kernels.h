/* SPDX-License-Identifier: MIT
 *
 * kernels.h - the inner loops of the convolution method: what light in a row of pixels weighs, its way to planes and from them, samples of
 * kernels; planes in one column of frequencies, mixed in place.
 */
#ifndef PELL_CONVOLUTION_KERNELS_H
#define PELL_CONVOLUTION_KERNELS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

enum { CONV_PLANES = 16, CONV_IMAGES = 3 * CONV_PLANES - 1 };
enum { CONV_ROWS_OCTAVE = 32, CONV_OCTAVES = 52, CONV_ROWS = CONV_ROWS_OCTAVE * CONV_OCTAVES };
enum { CONV_PHASES = 17, CONV_SLANTS = 16, CONV_FINE = 64, CONV_DISTANCES = 128 };
#define CONV_LEAST_COS 0.01f /* what leans more counts as this */

/* How much of its light a flat surface gets back by planes and images between them, over what it should: by the place between two planes,
 * t = i/(CONV_PHASES - 1), and the lean, sqrt(1 - cos) = i/(CONV_SLANTS - 1) of the largest, or i/(CONV_FINE - 1). Rows hold what linear
 * interpolation to the next needs. */
struct conv_response {
    /* 1/sqrt of it, as a part of its mean over the places: what it is, and more a phase on, a lean on, and by both. */
    float place[(CONV_SLANTS - 1) * (CONV_PHASES - 1)][4];
    /* What comes from less, and from more, than the distance with half of the light; and what should; how much more of both a row on. */
    float near[CONV_FINE - 1][4], far[CONV_FINE - 1][4];
};

/* Depths of the picture around a row of pixels. Leans are sqrt(1 - |n . d|); where |n . d| is over 1, 1 - |n . d|. */
struct conv_depths {
    const float *depth;    /* of pixel (0, 0), as is `group` */
    const uint16_t *group; /* surfaces of others are no neighbours */
    ptrdiff_t stride, group_stride;
    int x0, y0, x1, y1; /* pixels that there are */
    bool parallel;
    bool one_size;                      /* areas are those of pixels at any depth, in areas of a pixel that faces the camera */
    float focal_px, middle_x, middle_y; /* of the picture, pixels */
    float median_px;                    /* pixels at a depth of 1 that `far` is about */
};

/* What weights depend on. */
struct conv_weights {
    int planes;
    bool plain;         /* areas alone */
    bool by_response;   /* restore=response */
    bool several;       /* each pair of planes has its response, not one for all */
    const float *pixel; /* of planes, mm wide */
    float per_unit2;    /* one over the area of the pixel that areas are measured by */
    const struct conv_response *response[3];
};

/* A row of pixels, or cells, that light enters: those that are not `own` count for nothing. */
struct conv_places {
    int count;
    uint16_t own;
    const uint16_t *group;
    const float *place, *area, *slant, *far; /* among the planes; mm^2; leans, and over some distance */
};

/* Shares of light: that planes send to planes (of light behind on its own), and over the distance, i^2 of the widest. */
struct conv_shares {
    const float *arrives[3]; /* [from * CONV_PLANES + to] */
    const float *over[3];    /* CONV_DISTANCES + 1 */
    float per_widest;
};

/* A row of pixels on its way to images. Images of planes are `image_size` apart; then come those between. */
struct conv_spread {
    int planes, between;
    bool halves; /* half and half, not by distance */
    size_t image_size;
    int x0, x1;      /* pixels of the row, from the image's first pixel on, that there are */
    int width, step; /* floats of an image's row; pixels to one of it */
    uint16_t own;
};

/* A row of pixels that light leaves. */
struct conv_gather {
    const uint16_t *group;
    const float *place, *leaves;
    const float *const *rows; /* of the images of planes, then of those between; NULL: none is needed */
    int planes;
    uint16_t own;
};

enum { CONV_WINDOW = 3 }; /* pixels each way that `edges` looks at */

/* Pixels of one channel near edges in depth. */
struct conv_edges {
    const float *depth, *light; /* of pixel (0, 0), as are the rest; `light` NULL: of 1 */
    const uint16_t *group;
    const float *place, *area, *enters, *leaves;
    ptrdiff_t stride, group_stride; /* of the picture's, and of the rest */
    int x0, y0, x1, y1;             /* pixels that there are */
    uint16_t own;
    int planes;
    bool parallel;
    float per_spacing;  /* one over mm between planes */
    float pixel2;       /* area of a pixel at a depth of 1, or at any where rays are parallel or pixels are of one size */
    float flat2;        /* mm^2: depths closer than this are one */
    float fade;         /* of what `edges` does */
    const float *value; /* as in struct conv_radial */
    float per_median2;
    /* By pixels away, [y][x]: squared mm, light in the pixel, one over R there, and R a plane on over that. */
    float radius2[CONV_WINDOW + 1][CONV_WINDOW + 1], square[CONV_WINDOW + 1][CONV_WINDOW + 1];
    float per_value[CONV_WINDOW + 1][CONV_WINDOW + 1], next[CONV_WINDOW + 1][CONV_WINDOW + 1];
};

/* A profile along a column of pixels. */
struct conv_samples {
    const float *value; /* as in struct conv_radial */
    float per_median2, pixel2, distance2;
    bool fine; /* means of four points of each pixel */
};

/* The spectrum of a kernel, real and even, in blocks of 16 columns: frequency (16 b + lane, y) at [b * block + 16 y + lane], y <= half of
 * the height. A spectrum that ends earlier, in `blocks` and `rows`, is 0 from there. */
struct conv_spectrum {
    const float *data;
    ptrdiff_t block;
    int blocks, rows;
};

/* What a plane sends to another: itself in units of the other's pixels. NULL spectrum: nothing. */
struct conv_pair {
    int from, to; /* from < to; both ways */
    const struct conv_spectrum *spectrum;
    float factor;
};

struct conv_mix {
    int height;                                    /* frequencies in a column */
    int planes, between, behind;                   /* images: planes, those between planes, then transmitted light on planes */
    const struct conv_spectrum *own[CONV_PLANES];  /* of planes */
    const struct conv_spectrum *next[CONV_PLANES]; /* of plane i to i + 1, or NULL */
    float next_factor[CONV_PLANES];
    const struct conv_spectrum *behind_own[CONV_PLANES]; /* of transmitted light on its own plane, or NULL */
    const struct conv_pair *pairs;
    int num_pairs;
    float *column[CONV_IMAGES]; /* elements of struct pell_fft; NULL: an image without light whose result is not asked for */
};

struct conv_kernels {
    /* Areas, mm^2, and leans of pixels [from, to) of row y: by their neighbours' depths, or by |n . d|, which `slant` holds. */
    void (*cover)(const struct conv_depths *d, int y, int from, int to, bool by_depth, float *area, float *slant);
    /* Leans over some distance: no more than a pixel's own, and its own where that distance lies in the pixel. */
    void (*far)(const struct conv_depths *d, int y, int from, int to, uint16_t own, const float *slant, float *far);
    /* What light weighs where it enters and where it leaves; what is written for others means nothing. `leaves` may be NULL. */
    void (*weigh)(const struct conv_weights *w, const struct conv_places *s, float *const enters[3], float *const leaves[3]);
    /* Light behind, at q, and the pixel before it, at p; distances under 0: there is none. `close`: in, what it weighs as if it were in
     * front; out, the part of that which goes there, and enters, what stays behind. */
    void (*share)(const struct conv_shares *s, int count, const float *p, const float *q, const float *distance, float *const enters[3],
                  float *const close[3]);
    /* Light of pixels that are s->own, `light` NULL: of 1. With a step of 1 all of the images' rows is written, else added to. Marks images
     * that got any; lit: widened to the images' pixels that did. */
    void (*spread)(const struct conv_spread *s, const uint16_t *group, const float *place, const float *enters, const float *light,
                   float *images, unsigned char *marks, int lit[2]);
    /* Of pixels [from, to) what their places among the planes give, no less than 0. Others than `own` are left alone. */
    void (*gather)(const struct conv_gather *g, int from, int to, float *out);
    /* In a row, adds the light of the surface going on evenly as the plane that it is at each pixel, in place of that of near pixels which
     * are not on that plane: as much of it as their distance takes from R, as planes bring both. */
    void (*edges)(const struct conv_edges *s, int y, int from, int to, float *out);
    /* Adds cells, `repeat` pixels wide each, or `per` of them to a pixel, to a row of up to `room` pixels. */
    void (*add_cells)(const float *cells, int count, int repeat, int per, float scale, int room, float *out);
    /* A row of pixels, `step` for each of the image's, between two of its rows; spare: width + 48 floats. */
    void (*expand)(const float *top, const float *bottom, float part, int width, int step, float *spare, float *out);
    /* count samples at (x, y), (x, y + step) ..; a multiple of 16. */
    void (*sample)(const struct conv_samples *s, float x, float y, float step, int count, float *out);
    void (*mix)(const struct conv_mix *m, int block);
};

#endif
