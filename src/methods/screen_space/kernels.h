/* SPDX-License-Identifier: MIT
 *
 * kernels.h - the inner loops of the screen-space method, and the planes that they work on.
 *
 * Planes are whole pictures of floats with a margin of one block of 16 pixels left and right and one row above and below; a pointer
 * points at pixel (0, 0). Blocks begin at multiples of 16 pixels. Where there is no translucent pixel every plane holds finite values,
 * key and length 0.
 */
#ifndef PELL_SCREEN_SPACE_KERNELS_H
#define PELL_SCREEN_SPACE_KERNELS_H

#include <pellucid/frame.h>

enum { SCREEN_BLOCK = 16, SCREEN_PREBLUR = 8, SCREEN_STEPS = PELL_GAUSSIANS_MAX + SCREEN_PREBLUR, SCREEN_TURNS = 64 };
enum screen_live { SCREEN_EMPTY = 0, SCREEN_SOME, SCREEN_FULL };
enum { SCREEN_MIXED = 0xffff }; /* as a block's material: there are several in it */

/* What is known of a block of 16 pixels in a row. The smallest and largest values are those of pixels that can be blurred. */
struct screen_cell {
    uint16_t owner;    /* the material of all its translucent pixels, or SCREEN_MIXED */
    uint8_t live;      /* enum screen_live */
    uint8_t pixels;    /* that can be blurred */
    float scale[2];    /* smallest, largest */
    float to_px[2][2]; /* of each axis: smallest, largest */
    bool smooth;       /* full, of one material, and nowhere a jump in depth */
    uint16_t clear[2]; /* pixels before and behind it, along each axis, that are of smooth blocks alone */
    float skew;        /* of the second pass: pixels that x falls as y grows by one */
};

/* The blocks of a row from the first to behind the last that holds anything translucent. */
struct screen_extent {
    int begin, end;
};

struct screen_factors; /* factors.h */

/* One frame's work; the same for all rows and threads. */
struct screen_work {
    const struct pell_frame *in;
    const struct pell_frame_light *out;                /* its light is the weighted sum, step by step */
    const float *const *light;                         /* three planes of the caller: what is blurred */
    ptrdiff_t stride;                                  /* of the planes below */
    int block0, block1;                                /* blocks that hold the rectangle */
    int blocks;                                        /* in a row of the picture */
    float *key, *depth, *scale, *length[2], *to_px[2]; /* see `load` and `measure` */
    float *now[3], *half[3];                           /* light as it was loaded; blurred, see cpu.c */
    struct screen_cell *cells;                         /* [y * blocks + block] */
    struct screen_extent *extents;                     /* of each row */
    const float *columns_tan, *rows_tan;               /* slopes of the rays through columns (with a margin) and rows */
    size_t num_materials;
    const float (*total)[3];              /* of each material's profile; all zeros for material 0, which is none */
    const float *variance;                /* [step * (num_materials + 1) + material]: mm^2 applied after the step */
    const float *least_added;             /* likewise: mm^2 that the step, or one before it, adds least */
    const float (*blend)[3];              /* likewise: share of the step's result in the sum */
    float depth_mm, fixed_mm;             /* mm per pixel = depth * depth_mm + fixed_mm */
    float ratio2;                         /* scales all variances: (ssslevel / derived)^2 */
    float skip;                           /* px^2: a step that adds less is left out */
    float correction, maxdd, unit;        /* foreshortening of the paper: unit is 1/mm of depth */
    int forms;                            /* enum screen_form */
    const struct screen_factors *factors; /* with kernel=separable */
    int term, taps;                       /* of the kernel; of a pass, on either side */
    const float (*turns)[2];              /* SCREEN_TURNS of a quarter of a circle: cosine and sine */
    bool turned;                          /* lines of taps with gaps turn from pixel to pixel */
    int turn;                             /* by this sample, of SCREEN_TURNS */
    int step;
    bool several; /* more than one material in this frame */
    bool fresh;   /* nothing is in the sum yet */
    bool last;    /* no step or term comes after it */
};

enum screen_form {
    SCREEN_FORM_PAPER_EDGES = 1,
    SCREEN_FORM_PAPER_SLOPE = 2,
};

struct screen_seen { /* by screen_load in one row */
    float scale;     /* the largest: px^2 per mm^2 */
    int first, last; /* smallest and largest material, 0 where there is none */
    int pixels;      /* that are translucent */
};

struct screen_kernels {
    /* Copies row y of the caller's planes: key = material, depth, scale = px^2 per mm^2 of the variances (with strength), now = light
     * times the profile's total. */
    void (*load)(const struct screen_work *w, int y, struct screen_seen *seen);
    /* Which blocks are smooth; length[0], [1] = mm on the surface from one pixel to the next along x, and along the line at right angles to
     * it; to_px[0], [1] = px^2 per mm^2 of the variances along them. */
    void (*measure)(const struct screen_work *w, int y);
    /* The two passes of a step over row y, which `from` and `to` point at (pixel 0): they return the number of pixels that were blurred.
     * `down` reads the rows around it, too, puts what comes of it into the sum as well, and in the last step there alone. */
    int (*across)(const struct screen_work *w, int y, const float *const from[3], float *const to[3]);
    int (*down)(const struct screen_work *w, int y, const float *const from[3], float *const to[3]);
    /* The two passes of a term of a separable kernel over row y; `from` and `to` are planes. `term_down` adds to the sum.
     * They return the number of pixels that were blurred. */
    int (*term_across)(const struct screen_work *w, int y, const float *const from[3], float *const to[3]);
    int (*term_down)(const struct screen_work *w, int y, const float *const from[3]);
    /* now -> `out`, where no step blurs anything. */
    void (*copy)(const struct screen_work *w, int y);
};

#endif
