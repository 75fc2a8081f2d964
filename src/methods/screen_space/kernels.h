/* SPDX-License-Identifier: MIT
 *
 * kernels.h - the inner loops of the screen-space method, and its planes.
 *
 * Planes are whole images of floats with a margin of one block of 16 pixels on the left and right and one row above and below; a pointer
 * points at pixel (0, 0). Blocks begin at multiples of 16 pixels. Outside of translucent surfaces all planes hold finite values, and key
 * and length are 0.
 */
#ifndef PELL_SCREEN_SPACE_KERNELS_H
#define PELL_SCREEN_SPACE_KERNELS_H

#include <pellucid/frame.h>

enum { SCREEN_BLOCK = 16, SCREEN_PREBLUR = 8, SCREEN_STEPS = PELL_GAUSSIANS_MAX + SCREEN_PREBLUR, SCREEN_TURNS = 64 };
enum screen_contents { SCREEN_EMPTY = 0, SCREEN_SOME, SCREEN_FULL };
enum { SCREEN_MIXED = 0xffff }; /* as a block's material: several materials */

/* Summary of a block of 16 pixels in a row. Minima and maxima are over the pixels that can be blurred. */
struct screen_cell {
    uint16_t material; /* material of all its translucent pixels, or SCREEN_MIXED */
    uint8_t contents;  /* enum screen_contents */
    uint8_t pixels;    /* number of pixels that can be blurred */
    float scale[2];    /* minimum, maximum */
    float to_px[2][2]; /* per axis: minimum, maximum */
    bool smooth;       /* full, of one material, and without depth discontinuities */
    uint16_t clear[2]; /* pixels in smooth blocks on either side of it, the smaller number, along each axis */
    float skew;        /* of the second pass: decrease of x in pixels per pixel of y */
};

/* Range of the blocks of a row that contain translucent pixels. */
struct screen_extent {
    int begin, end;
};

struct screen_factors; /* factors.h */

/* One frame's work; the same for all rows and threads. */
struct screen_work {
    const struct pell_frame *in;
    const struct pell_frame_light *out;                /* its light is the weighted sum, updated step by step */
    const float *const *light;                         /* three planes of the caller: input */
    ptrdiff_t stride;                                  /* of the planes below */
    int block0, block1;                                /* range of blocks that cover the rectangle */
    int blocks;                                        /* per row of the image */
    float *key, *depth, *scale, *length[2], *to_px[2]; /* see `load` and `measure` */
    float *now[3], *half[3];                           /* unblurred light; blurred, see cpu.c */
    struct screen_cell *cells;                         /* [y * blocks + block] */
    struct screen_extent *extents;                     /* per row */
    const float *columns_tan, *rows_tan;               /* slopes of the rays through columns (with a margin) and rows */
    size_t num_materials;
    const float (*total)[3];              /* by material: total of its profile; 0 for material 0, which means none */
    const float *variance;                /* [step * (num_materials + 1) + material]: mm^2 applied after the step */
    const float *min_added;               /* likewise: smallest variance in mm^2 that the step, or one before it, adds */
    const float (*blend)[3];              /* likewise: weight of the step's result in the sum */
    float depth_mm, fixed_mm;             /* mm per pixel = depth * depth_mm + fixed_mm */
    float ratio2;                         /* scales all variances: (ssslevel / derived)^2 */
    float skip;                           /* px^2: a step that adds less is skipped */
    float correction, maxdd, unit;        /* the paper's foreshortening: unit is 1/mm of depth */
    int forms;                            /* enum screen_form */
    const struct screen_factors *factors; /* with kernel=separable */
    int term, taps;                       /* index of the kernel's term; taps of a pass, per side */
    const float (*turns)[2];              /* SCREEN_TURNS angles in a quarter circle: cosine and sine */
    bool rotated;                         /* lines of taps with gaps are rotated per pixel */
    int turn;                             /* rotation of this sample, of SCREEN_TURNS */
    int step;
    bool several; /* the frame has several materials */
    bool fresh;   /* the sum is empty */
    bool last;    /* the last step or term */
};

enum screen_form {
    SCREEN_FORM_PAPER_EDGES = 1,
    SCREEN_FORM_PAPER_SLOPE = 2,
};

struct screen_seen { /* gathered by screen_load_row in one row */
    float scale;     /* maximum, px^2 per mm^2 */
    int first, last; /* smallest and largest material, 0: none */
    int pixels;      /* number of translucent pixels */
};

struct screen_kernels {
    /* Copies row y of the caller's planes: key = material, depth, scale = px^2 per mm^2 of the variances (with strength), now = light times
     * the profile's total. */
    void (*load)(const struct screen_work *w, int y, struct screen_seen *seen);
    /* Finds smooth blocks; computes length[0], [1] = mm on the surface between pixels along x, and along the perpendicular line; to_px[0],
     * [1] = px^2 per mm^2 of the variances along them. */
    void (*measure)(const struct screen_work *w, int y);
    /* The two passes of a step over row y, at pixel 0 of `from` and `to`: return the number of blurred pixels. `down` reads adjacent rows,
     * too, and also adds its result to the sum; in the last step only there. */
    int (*across)(const struct screen_work *w, int y, const float *const from[3], float *const to[3]);
    int (*down)(const struct screen_work *w, int y, const float *const from[3], float *const to[3]);
    /* The two passes of a term of a separable kernel over row y; `from` and `to` are planes. `term_down` adds to the sum. They return the
     * number of blurred pixels. */
    int (*term_across)(const struct screen_work *w, int y, const float *const from[3], float *const to[3]);
    int (*term_down)(const struct screen_work *w, int y, const float *const from[3]);
    /* Copies now to `out`, where no step blurs anything. */
    void (*copy)(const struct screen_work *w, int y);
};

#endif
