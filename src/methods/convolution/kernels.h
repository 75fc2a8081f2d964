/* SPDX-License-Identifier: MIT
 *
 * kernels.h - the inner loops of the convolution method: weights of light in a row of pixels, its distribution to planes and interpolation
 * from them, samples of kernels; in the frequency domain, mixing of planes in one column, in place.
 */
#ifndef PELL_CONVOLUTION_KERNELS_H
#define PELL_CONVOLUTION_KERNELS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

enum { CONV_PLANES = 16, CONV_IMAGES = 3 * CONV_PLANES - 1 };
enum { CONV_ROWS_OCTAVE = 32, CONV_OCTAVES = 52, CONV_ROWS = CONV_ROWS_OCTAVE * CONV_OCTAVES };
enum { CONV_PHASES = 17, CONV_SLANTS = 16, CONV_FINE = 64, CONV_DISTANCES = 128 };
#define CONV_COS_MIN 0.01f /* lower bound of cosines */

/* Response: light that a flat surface receives through planes and the images between them, relative to the exact value; by the coordinate
 * between two planes, t = i/(CONV_PHASES - 1), and the slant, sqrt(1 - cos) = i/(CONV_SLANTS - 1) of the largest, or i/(CONV_FINE - 1).
 * Rows hold the coefficients of linear interpolation to the next row. */
struct conv_response {
    /* 1/sqrt of the response, relative to its mean over t: its value, and its increments to the next phase, the next slant, and both. */
    float coord[(CONV_SLANTS - 1) * (CONV_PHASES - 1)][4];
    /* Light from less, and from more, than the median distance; the exact values; and the increments of both to the next row. */
    float near[CONV_FINE - 1][4], far[CONV_FINE - 1][4];
};

/* Depths of the frame around a row of pixels. Slants are sqrt(1 - |n . d|); if |n . d| exceeds 1, 1 - |n . d|. */
struct conv_depths {
    const float *depth;    /* at pixel (0, 0), as is `group` */
    const uint16_t *group; /* surfaces of other groups are not neighbours */
    ptrdiff_t stride, group_stride;
    int x0, y0, x1, y1; /* bounds of the valid pixels */
    bool parallel;
    bool one_size;                      /* areas are those of pixels at any depth, relative to a pixel that faces the camera */
    float focal_px, middle_x, middle_y; /* of the frame, pixels */
    float median_px;                    /* distance for `far`: pixels at a depth of 1 */
};

/* Inputs of the weights. */
struct conv_weights {
    int planes;
    bool plain;         /* areas only */
    bool by_response;   /* restore=response */
    bool several;       /* each pair of planes has its own response */
    const float *pixel; /* mm: pixel widths of the planes */
    float per_unit2;    /* reciprocal of the area that is the unit of areas */
    const struct conv_response *response[3];
};

/* A row of pixels, or cells, where light enters: the weights of those that are not in group `own` are undefined. */
struct conv_row {
    int count;
    uint16_t own;
    const uint16_t *group;
    const float *coord, *area, *slant, *far; /* coordinate among the planes; mm^2; slants, and slants over a distance */
};

/* Fractions of light: transferred from plane to plane (for hidden light from its own plane), and by distance, i^2 relative to the
 * widest. */
struct conv_transfers {
    const float *arrives[3]; /* [from * CONV_PLANES + to] */
    const float *over[3];    /* CONV_DISTANCES + 1 */
    float per_widest;
};

/* A row of pixels that is distributed to images. Images of planes are `image_size` apart, followed by those between planes. */
struct conv_spread {
    int planes, between;
    bool halves; /* half to each plane, not by distance */
    size_t image_size;
    int x0, x1;      /* valid pixels of the row, counted from the image's first pixel */
    int width, step; /* floats per image row; pixels per pixel of the image */
    uint16_t own;
};

/* A row of pixels where light leaves. */
struct conv_gather {
    const uint16_t *group;
    const float *coord, *exit_weight;
    const float *const *rows; /* of the images of planes, then of those between; NULL: not needed */
    int planes;
    uint16_t own;
    float least; /* a lower bound of the result */
};

enum { CONV_WINDOW = 3 }; /* search radius of `edges` in pixels */

/* Pixels of one channel near depth edges. */
struct conv_edges {
    const float *depth, *light; /* at pixel (0, 0), as are the other planes; `light` NULL: 1 everywhere */
    const uint16_t *group;
    const float *coord, *area, *entry_weight, *exit_weight;
    ptrdiff_t stride, group_stride; /* of the frame, and of the other planes */
    int x0, y0, x1, y1;             /* bounds of the valid pixels */
    uint16_t own;
    int planes;
    bool parallel;
    float least;        /* a lower bound of the result */
    float per_spacing;  /* reciprocal of the mm between planes */
    float pixel2;       /* area of a pixel at a depth of 1; at any depth in a parallel view or if all pixels have one size */
    float flat2;        /* mm^2: smaller depth differences are ignored */
    float fade;         /* weight of the correction by `edges` */
    const float *value; /* as in struct conv_radial */
    float per_median2;
    /* By pixel offset, [y][x]: squared mm, light in the pixel, 1/R there, and R one plane farther relative to R. */
    float radius2[CONV_WINDOW + 1][CONV_WINDOW + 1], square[CONV_WINDOW + 1][CONV_WINDOW + 1];
    float per_value[CONV_WINDOW + 1][CONV_WINDOW + 1], next[CONV_WINDOW + 1][CONV_WINDOW + 1];
};

/* A profile along a column of pixels. */
struct conv_samples {
    const float *value; /* as in struct conv_radial */
    float per_median2, pixel2, distance2;
    bool fine; /* averages four points of each pixel */
};

/* The spectrum of a kernel, real and even, in blocks of 16 columns: frequency (16 b + lane, y) at [b * block + 16 y + lane], y <= half of
 * the height. A truncated spectrum is 0 beyond `blocks` and `rows`. */
struct conv_spectrum {
    const float *data;
    ptrdiff_t block;
    int blocks, rows;
};

/* Transfer between two planes, in units of the receiving plane's pixels. Spectrum NULL: none. */
struct conv_pair {
    int from, to; /* from < to; in both directions */
    const struct conv_spectrum *spectrum;
    float factor;
};

struct conv_mix {
    int height;                                    /* frequencies per column */
    int planes, between, behind;                   /* numbers of images: planes, those between planes, then transmitted light on planes */
    const struct conv_spectrum *own[CONV_PLANES];  /* by plane */
    const struct conv_spectrum *next[CONV_PLANES]; /* from plane i to i + 1, or NULL */
    float next_factor[CONV_PLANES];
    const struct conv_spectrum *behind_own[CONV_PLANES]; /* of transmitted light on its own plane, or NULL */
    const struct conv_pair *pairs;
    int num_pairs;
    float *column[CONV_IMAGES]; /* elements of struct pell_fft; NULL: an image without light whose result is not needed */
};

struct conv_kernels {
    /* Areas, mm^2, and slants of pixels [from, to) of row y, from the depths of neighbours or from |n . d|, which `slant` holds on
     * input. */
    void (*cover)(const struct conv_depths *d, int y, int from, int to, bool by_depth, float *area, float *slant);
    /* Slants over a distance: at most a pixel's own, and equal to it where that distance is within the pixel. */
    void (*far)(const struct conv_depths *d, int y, int from, int to, uint16_t own, const float *slant, float *far);
    /* Weights of entering and leaving light; undefined for other groups. `exit_weight` may be NULL. */
    void (*compute_weights)(const struct conv_weights *w, const struct conv_row *s, float *const entry_weight[3],
                            float *const exit_weight[3]);
    /* Hidden light at coordinate q, and the pixel in front of it at p; distance < 0: none. `close`: on input its weight as if it
     * were in front; on output the part that moves to the coordinate of that pixel. `entry_weight` keeps the part that stays behind. */
    void (*split_hidden)(const struct conv_transfers *s, int count, const float *p, const float *q, const float *distance,
                         float *const entry_weight[3], float *const close[3]);
    /* Distributes the light of pixels in s->own, `light` NULL: 1. With a step of 1 it writes whole rows of the images, else it adds to
     * them. Marks the images that received any; lit: extended to the pixels of the images that did. */
    void (*spread)(const struct conv_spread *s, const uint16_t *group, const float *coord, const float *entry_weight, const float *light,
                   float *images, unsigned char *marks, int lit[2]);
    /* Interpolates the light of pixels [from, to) at their coordinates among the planes, at least 0. Pixels of other groups are
     * unchanged. */
    void (*gather)(const struct conv_gather *g, int from, int to, float *out);
    /* In a row, replaces the light of near pixels off the tangent plane at each pixel by that of the plane's continuation with uniform
     * light: by as much as the difference in distance changes R, as the planes transport both. */
    void (*edges)(const struct conv_edges *s, int y, int from, int to, float *out);
    /* Adds cells to a row of up to `room` pixels; each cell is `repeat` pixels wide, or `per` cells share a pixel. */
    void (*add_cells)(const float *cells, int count, int repeat, int per, float scale, int room, float *out);
    /* A row of pixels, `step` per pixel of the image, interpolated between two of its rows; spare: width + 48 floats. */
    void (*expand)(const float *top, const float *bottom, float t, int width, int step, float *spare, float *out);
    /* count samples at (x, y), (x, y + step) ..; a multiple of 16. */
    void (*sample)(const struct conv_samples *s, float x, float y, float step, int count, float *out);
    void (*mix)(const struct conv_mix *m, int block);
};

#endif
