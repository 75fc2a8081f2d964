/* SPDX-License-Identifier: MIT
 *
 * tile.h - FLIP and SSIM of a tile of two images; tile.c is compiled once per SIMD level (base/simd.h).
 *
 * A tile is padded on all sides by the radius of the filters, so that a tile's pixels depend on nothing but their neighbourhood: tiles
 * may be done in any order. Rows of filtered tiles are PELL_TILE_WIDTH floats, whatever the tile's width.
 *
 * FLIP works on y = Y/Y_n, x - y and y - z of XYZ over the white: Y C_x C_z without their constant factors, which commute with linear
 * filters. A filter over two dimensions is a sum of products of two over one: exact for Gaussians and their derivatives.
 *
 * Threads    each caller has a scratch of its own.
 */
#ifndef PELL_COMPARE_TILE_H
#define PELL_COMPARE_TILE_H

#include "base/base.h"
#include "base/simd.h"

#define PELL_TILE_WIDTH 128
#define PELL_TILE_HEIGHT 64
#define PELL_FLIP_RADIUS_MAX 64 /* for pell_compare_params.ppd up to 400 */
#define PELL_SSIM_RADIUS 5

/* Halves of filters: weight [k] for offsets +-k. */
struct pell_flip_filters {
    int achromatic_radius, red_green_radius, blue_yellow_radius, feature_radius;
    int radius; /* the largest */
    float achromatic[PELL_FLIP_RADIUS_MAX + 1], red_green[PELL_FLIP_RADIUS_MAX + 1];
    float blue_yellow[2][PELL_FLIP_RADIUS_MAX + 1], blue_yellow_weight[2];
    float smooth[PELL_FLIP_RADIUS_MAX + 1];   /* of features: Gaussian, */
    float edge[PELL_FLIP_RADIUS_MAX + 1];     /* its derivative: -edge[k] at +k, */
    float point[PELL_FLIP_RADIUS_MAX + 1];    /* its second derivative */
    float to_xyz[9], from_xyz[9];             /* linear Rec.709 and XYZ over the white, row by row */
    float scale, low_slope, high_slope, knee; /* from HyAB^0.7 to [0, 1]: two lines that join at `knee`; `scale` is their end */
};

/* Tone mapping of linear images. */
struct pell_tone {
    int curve;                   /* enum pell_compare_tonemap */
    float exposure, white_scale; /* 1/white^2 */
};

struct pell_tile {
    int width, height;        /* size of the tile: at most PELL_TILE_WIDTH x PELL_TILE_HEIGHT */
    int pad, row;             /* padding on every side; floats per padded row */
    int rows;                 /* padded rows */
    const float *light[2][3]; /* linear, finite, row x rows: the test's, then the reference's */
    float *scratch;           /* pell_tile_scratch floats */
};

struct pell_tile_kernels {
    /* One error per pixel, in rows of PELL_TILE_WIDTH; only the tile's width x height are valid. */
    void (*flip)(const struct pell_tile *tile, const struct pell_flip_filters *filters, const struct pell_tone *tone, float *error);
    /* SSIM of the luma, then of R, G, B. */
    void (*ssim)(const struct pell_tile *tile, const float *window, const struct pell_tone *tone, float *map[4]);
    /* x^exponent and the cube root, for tests; x in [0, 1e4]. */
    void (*power)(const float *x, float exponent, float *out, int count);
    void (*cube_root)(const float *x, float *out, int count);
};
PELL_SIMD_TABLES(struct pell_tile_kernels, pell_tile);

/* Floats per padded row, and of the scratch, for a padding. */
int pell_tile_row(int pad);
size_t pell_tile_scratch(int pad);

/* --- flip.c ------------------------------------------------------------------------------------------------------------------- */

/* `ppd` in [1, 400]. */
void pell_flip_prepare(double ppd, struct pell_flip_filters *filters);

/* log2 of the exposures of HDR-FLIP for a reference whose largest and median luminance these are (both above 0). */
void pell_flip_exposures(double largest, double median, double *start, double *stop, int *count);

/* The ACES curve (Narkowicz 2015, with its factor of 0.6 undone), as HDR-FLIP applies it to exposed values: for any finite x >= 0. */
double pell_aces(double x);

/* Half of the window of SSIM: PELL_SSIM_RADIUS + 1 weights. */
void pell_ssim_window(float *window);

#endif
