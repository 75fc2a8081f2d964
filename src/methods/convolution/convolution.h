/* SPDX-License-Identifier: MIT
 *
 * convolution.h - what the files of this method share. Its only symbol for others is pell_method_convolution.
 */
#ifndef PELL_CONVOLUTION_H
#define PELL_CONVOLUTION_H

#include "math/fft.h"
#include "methods/convolution/kernels.h"
#include "render/camera_view.h"

#include <pellucid/method.h>

struct pell_solids;
struct pell_pool;

enum conv_as { CONV_BEST, CONV_PAPER };
enum conv_placement { CONV_EQUAL, CONV_SURFACE };
enum conv_split { CONV_LINEAR, CONV_HALF };
enum conv_restore { CONV_BETWEEN, CONV_RESPONSE, CONV_LOST };
enum conv_threshold_by { CONV_BY_ENERGY, CONV_AS_PRINTED };
enum conv_resolution { CONV_FULL, CONV_HALF_SIZE, CONV_QUARTER_SIZE, CONV_AUTO_SIZE };
enum conv_pixels { CONV_EACH, CONV_ONE };
enum conv_step { CONV_EVERY_1, CONV_EVERY_2, CONV_EVERY_4, CONV_EVERY_AUTO }; /* px: 1 << it */
enum conv_through { CONV_THROUGH_SLAB, CONV_THROUGH_PLANES };
enum conv_borders { CONV_BORDERS_EVEN, CONV_BORDERS_OPEN, CONV_BORDERS_AUTO };

struct convolution_knobs {
    int as;        /* enum conv_as */
    int planes;    /* 0: as convolution_planes says */
    int placement; /* enum conv_placement */
    int split;     /* enum conv_split */
    int restore;   /* enum conv_restore */
    float threshold;
    int threshold_by; /* enum conv_threshold_by */
    int resolution;   /* enum conv_resolution */
    int pixels;       /* enum conv_pixels */
    bool visible;
    int surfaces;
    int behind_step; /* enum conv_step */
    int through;     /* enum conv_through */
    bool apart;
    bool edges;
    int borders; /* enum conv_borders */
    bool strength;
};

/* Planes of images of which one pixel is `step` of the picture's: more of small ones, which cost a quarter. */
static inline int convolution_planes(const struct convolution_knobs *k, int step)
{
    return k->planes > 0 ? k->planes : step > 1 ? 12 : 8;
}

/* --- radial.c: a material's profile as tables -------------------------------------------------------------------------------------- */

enum { CONV_LINE_OCTAVE = 8, CONV_LINE_ROWS = CONV_LINE_OCTAVE * CONV_OCTAVES };

/* One channel. */
struct conv_radial {
    const struct pell_profile *profile;
    double radius; /* scales the profile's radii, (0, 1] */
    float scale;   /* of the profile: 1, or one over its total */
    float total;   /* M of even light of 1 */
    bool point;    /* light does not spread */
    float median2; /* mm^2: squared radius with half of the light inside */
    float per_median2;
    float *value; /* R, 1/mm^2, at squared radii, CONV_ROWS_OCTAVE evenly to an octave: CONV_ROWS + 2 */
    float *line;  /* Int R dy beside a line, 1/mm, at the same with CONV_LINE_OCTAVE: CONV_LINE_ROWS + 2 */
};

/* `memory`: CONV_RADIAL_FLOATS for each of three channels. */
#define CONV_RADIAL_FLOATS (CONV_ROWS + 2 + CONV_LINE_ROWS + 2)
void convolution_radial_make(const struct pell_frame_material *m, double radius, float *memory, struct conv_radial out[3]);
/* R at a squared radius. */
float convolution_radial_value(const struct conv_radial *r, float radius2);
/* Share of the light that enters on a plane which reaches a plane h mm away, and what a square [x - 1/2, x + 1/2] x [y - 1/2, y + 1/2] of
 * pixels of mm `pixel` gets; all for x, y in [0, count): out[y * count + x]. */
double convolution_radial_beyond(const struct conv_radial *r, double h);
void convolution_radial_squares(const struct conv_radial *r, double pixel, int count, double *out);
void convolution_response_make(const struct conv_radial *r, const struct convolution_knobs *k, double spacing, struct conv_response *out);
/* The radius, mm, with all but `share` of the light of every channel inside. */
double convolution_reach(const struct conv_radial r[3], double share);

/* --- sources.c: what the camera sees, and what lies behind it ------------------------------------------------------------------------ */

#define CONV_SURFACES_MOST 8

/* Samples of the surface. Those in front are pixels; those behind are cells of `step` x `step` pixels. */
struct conv_front {
    uint16_t *group;              /* of pixels: 0, or what scatters together + 1; stride as below */
    float *area;                  /* mm^2 that a pixel covers */
    float *enters[3], *leaves[3]; /* what light weighs where it enters a pixel, and where it leaves */
    float *place;                 /* among the planes: number of the nearer, and how far on to the next */
    float *slant;                 /* sqrt(1 - |n . d|); where |n . d| is over 1, 1 - |n . d| */
    ptrdiff_t stride;
};

struct conv_behind {
    int step, width, height, layers;
    uint16_t *group; /* [layer][cell] */
    float *depth, *area, *slant, *place, *light[3];
    float *enters[3], *close[3]; /* what light weighs behind, and what it weighs at the place of the pixel before it */
    float *counts[3];            /* share of the light that the planes bring */
    float *even[3];              /* of that, the share along the surface, of faces that look where pixels do */
};

struct conv_sources {
    const struct pell_services *services;
    const struct conv_kernels *kernels;
    const struct pell_solids *solids; /* NULL: no scene, materials are groups */
    const bool *by_slab;              /* of materials: hidden faces send light along the surface alone, not through it; NULL: none */
    const struct pell_frame *in;
    struct pell_view view;
    bool one_size;   /* pixels=one */
    float far_depth; /* behind all */
    struct conv_front front;
    struct conv_behind behind;
};

/* mm that a pixel at this depth is wide. */
static inline float conv_pixel_at(const struct pell_frame *in, float depth)
{
    return (in->shape.orthographic ? 1.0f : depth) / in->shape.focal_px;
}

/* The picture's depths; `median`: mm, as in struct conv_depths. */
struct conv_depths convolution_depths(const struct conv_sources *s, float median);
/* A row of pixels. */
void convolution_front_row(const struct conv_sources *s, int y);
/* A row of cells; returns rays. */
int convolution_behind_row(const struct conv_sources *s, int cell_y);
void convolution_sources_aim(struct conv_sources *s);

/* --- spectra.c: planes and the spectra of their kernels ----------------------------------------------------------------------------- */

/* What the spectra of a group depend on. */
struct conv_layout {
    size_t group;                 /* and the level of its strength */
    int planes;                   /* in use */
    float depth[CONV_PLANES];     /* mm, rising */
    float pixel[CONV_PLANES];     /* mm that a pixel of the plane is wide, reduced resolution counted in */
    float unit;                   /* the same of the plane that areas are measured on */
    int width, height;            /* of the images */
    int across, down;             /* lengths of the transforms */
    float behind[3][CONV_PLANES]; /* mm from light behind to the plane that it lies on, of each channel; negative: it has none apart */
};

struct conv_spectra {
    struct conv_layout layout; /* that they are of; planes 0: of nothing yet */
    float *memory;
    struct conv_spectrum own[3][CONV_PLANES], behind[3][CONV_PLANES], far[3][CONV_PLANES * (CONV_PLANES - 1) / 2];
    struct conv_pair pairs[3][CONV_PLANES * (CONV_PLANES - 1) / 2];
    int num_pairs, num_own, num_far; /* of each channel */
    int kept[3];                     /* pairs whose spectrum is there */
    struct conv_response response[3][CONV_PLANES];
    int num_responses;
};

/* Pixels that kernels send light as far as: beyond them it would come round in transforms of this length. */
static inline int convolution_cut(int length, int size)
{
    return 2 * (length - size) < length ? length - size : length / 2;
}

/* Floats of spectra for images of up to this size. */
size_t convolution_spectra_size(const struct convolution_knobs *k, int step, bool orthographic, int width, int height);
/* Floats of one worker's scratch. */
size_t convolution_spectra_scratch(int width, int height);
/* Makes what is not there yet; `scratch` of each worker. */
void convolution_spectra_make(struct pell_pool *pool, const struct convolution_knobs *k, const struct conv_radial radial[3],
                              const struct conv_layout *layout, const struct conv_kernels *kernels, float *const *scratch,
                              struct conv_spectra *out);

extern const struct pell_method_engine pell_convolution_cpu;

#endif
