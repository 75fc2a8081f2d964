/* SPDX-License-Identifier: MIT
 *
 * convolution.h - declarations shared by the files of this method. Its only external symbol is pell_method_convolution.
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
enum conv_step { CONV_EVERY_1, CONV_EVERY_2, CONV_EVERY_4, CONV_EVERY_AUTO }; /* px: 1 << value */
enum conv_through { CONV_THROUGH_SLAB, CONV_THROUGH_PLANES };
enum conv_borders { CONV_BORDERS_EVEN, CONV_BORDERS_OPEN, CONV_BORDERS_AUTO };

struct convolution_knobs {
    int as;        /* enum conv_as */
    int planes;    /* 0: by convolution_planes */
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

/* Number of planes for images with `step` pixels of the rendered image per pixel: more for small images, which cost a quarter. */
static inline int convolution_planes(const struct convolution_knobs *k, int step)
{
    return k->planes > 0 ? k->planes : step > 1 ? 12 : 8;
}

/* --- radial.c: a material's profile as tables -------------------------------------------------------------------------------------- */

enum { CONV_LINE_OCTAVE = 8, CONV_LINE_ROWS = CONV_LINE_OCTAVE * CONV_OCTAVES };

/* One channel. */
struct conv_radial {
    const struct pell_profile *profile;
    double radius_scale; /* of the profile's radii, (0, 1] */
    float scale;         /* of the profile: 1, or the reciprocal of its total */
    float total;         /* M under a uniform irradiance of 1 */
    bool point;          /* the profile is a delta function */
    float median2;       /* mm^2: squared median radius, which contains half of the light */
    float per_median2;
    float *value; /* R, 1/mm^2, at squared radii, with CONV_ROWS_OCTAVE uniform rows per octave: CONV_ROWS + 2 */
    float *line;  /* Int R dy along a line, 1/mm, by the squared distance of the line, with CONV_LINE_OCTAVE rows per octave: CONV_LINE_ROWS
                   * + 2 */
};

/* `memory`: CONV_RADIAL_FLOATS for each of three channels. */
#define CONV_RADIAL_FLOATS (CONV_ROWS + 2 + CONV_LINE_ROWS + 2)
void convolution_radial_make(const struct pell_frame_material *m, double radius_scale, float *memory, struct conv_radial out[3]);
/* R at a squared radius. */
float convolution_radial_value(const struct conv_radial *r, float radius2);
/* Fraction of the light that enters on a plane and arrives on a plane h mm away, and the light in a square [x - 1/2, x + 1/2] x [y - 1/2, y
 * + 1/2] of pixels with the width `pixel`, mm; for all x, y in [0, count): out[y * count + x]. */
double convolution_radial_beyond(const struct conv_radial *r, double h);
void convolution_radial_squares(const struct conv_radial *r, double pixel, int count, double *out);
void convolution_response_make(const struct conv_radial *r, const struct convolution_knobs *k, double spacing, struct conv_response *out);
/* The radius, mm, that contains all but `fraction` of the light of every channel. */
double convolution_reach(const struct conv_radial r[3], double fraction);

/* --- sources.c: surface visible to the camera, and hidden surface behind it ---------------------------------------------------------- */

#define CONV_SURFACES_MOST 8

/* Samples of the surface. Visible samples are pixels; hidden ones are cells of `step` x `step` pixels. */
struct conv_front {
    uint16_t *group;                         /* per pixel: group + 1, 0: none; rows are `stride` apart */
    float *area;                             /* mm^2 that a pixel covers */
    float *entry_weight[3], *exit_weight[3]; /* weight of the light that enters at a pixel, and that leaves there */
    float *coord;                            /* coordinate among the planes: index of the nearer one plus the fraction toward the next */
    float *slant;                            /* sqrt(1 - |n . d|); if |n . d| exceeds 1, 1 - |n . d| */
    ptrdiff_t stride;
};

struct conv_behind {
    int step, width, height, layers;
    uint16_t *group; /* [layer][cell] */
    float *depth, *area, *slant, *coord, *light[3];
    float *entry_weight[3], *close[3]; /* weight of the light of hidden cells, and its weight at the coordinate of the pixel in front */
    float *carried[3];                 /* fraction of the light that the planes carry */
    float *along_surface[3];           /* the part of it that is diffuse along the surface, for faces with the orientation of the pixels */
};

struct conv_sources {
    const struct pell_services *services;
    const struct conv_kernels *kernels;
    const struct pell_solids *solids; /* NULL: no scene, materials are groups */
    const bool *by_slab;              /* by material: light of hidden faces propagates along the surface only, not through the object; NULL:
                                       * none */
    const struct pell_frame *in;
    struct pell_view view;
    bool one_size;   /* pixels=one */
    float far_depth; /* greater than all depths */
    struct conv_front front;
    struct conv_behind behind;
};

/* Width of a pixel at this depth, mm. */
static inline float conv_pixel_at(const struct pell_frame *in, float depth)
{
    return (in->shape.orthographic ? 1.0f : depth) / in->shape.focal_px;
}

/* Depths of the frame; `median`: mm, as in struct conv_depths. */
struct conv_depths convolution_depths(const struct conv_sources *s, float median);
/* Samples a row of pixels. */
void convolution_front_row(const struct conv_sources *s, int y);
/* Samples a row of cells; returns the number of rays. */
int convolution_behind_row(const struct conv_sources *s, int cell_y);
void convolution_sources_aim(struct conv_sources *s);

/* --- spectra.c: planes and the spectra of their kernels ----------------------------------------------------------------------------- */

enum { CONV_MULTIPLE = 16 }; /* sizes of transforms are multiples of it */

/* Inputs of the spectra of a group. */
struct conv_layout {
    size_t group;                 /* and the level of its strength */
    int planes;                   /* number in use */
    float depth[CONV_PLANES];     /* mm, increasing */
    float pixel[CONV_PLANES];     /* mm: width of a pixel of the plane, at the images' resolution */
    float unit;                   /* the same on the plane that is the unit of areas */
    int width, height;            /* of the images */
    int across, down;             /* sizes of the transforms */
    float behind[3][CONV_PLANES]; /* per channel: mm from the hidden light to the plane that represents it; negative: it has no separate
                                   * image */
};

struct conv_spectra {
    struct conv_layout layout; /* layout of the spectra; planes 0: none yet */
    float *memory;
    struct conv_spectrum own[3][CONV_PLANES], behind[3][CONV_PLANES], far[3][CONV_PLANES * (CONV_PLANES - 1) / 2];
    struct conv_pair pairs[3][CONV_PLANES * (CONV_PLANES - 1) / 2];
    int num_pairs, num_own; /* per channel */
    struct conv_response response[3][CONV_PLANES];
    int num_responses;
};

static inline int conv_round_up(int n, int multiple)
{
    return (n + multiple - 1) / multiple * multiple;
}

/* Reach of the kernels in pixels: beyond it light would wrap around in transforms of this size. */
static inline int convolution_cut(int length, int size)
{
    return 2 * (length - size) < length ? length - size : length / 2;
}

/* Number of floats for the spectra of images up to this size. */
size_t convolution_spectra_size(const struct convolution_knobs *k, int step, bool orthographic, int width, int height);
/* Floats of scratch memory per worker. */
size_t convolution_spectra_scratch(int width, int height);
/* Computes the missing spectra; `scratch` is per worker. */
void convolution_spectra_make(struct pell_pool *pool, const struct convolution_knobs *k, const struct conv_radial radial[3],
                              const struct conv_layout *layout, const struct conv_kernels *kernels, float *const *scratch,
                              struct conv_spectra *out);

extern const struct pell_method_engine pell_convolution_cpu;

#endif
