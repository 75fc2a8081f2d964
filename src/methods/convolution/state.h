/* SPDX-License-Identifier: MIT
 *
 * state.h - state of the convolution method on the cpu engine, and the steps of a frame in order. Each step runs over rows, bands or blocks
 * on the thread pool; its inputs are in the job.
 */
#ifndef PELL_CONVOLUTION_STATE_H
#define PELL_CONVOLUTION_STATE_H

#include "methods/convolution/convolution.h"

enum { CONV_BAND = 16, CONV_SETS = 4, CONV_LEVELS = 7 };
enum {
    CONV_T_AREAS,
    CONV_T_BEHIND,
    CONV_T_PLANES,
    CONV_T_SPECTRA,
    CONV_T_WEIGHTS,
    CONV_T_SPREAD,
    CONV_T_COLUMNS,
    CONV_T_GATHER,
    CONV_TIMES
};

/* A group's pixels in a frame. */
struct conv_extent {
    struct pell_rect rect;
    float low, high;                /* depth */
    unsigned seen;                  /* of a row: bit i: pixels between planes i and i + 1 */
    float brightest[3], darkest[3]; /* of the light, W/m^2; 0 is between them */
    float weakest, strongest;       /* strength */
    int64_t pixels;
};

/* A lower bound of the light that leaves: rounding errors below 0 are removed where no light is negative. */
static inline float convolution_least(const struct conv_extent *extent, int channel)
{
    return extent->darkest[channel] < 0.0f ? -INFINITY : 0.0f;
}

/* Sizes of the images at one resolution. */
struct conv_format {
    int step;                                           /* pixels of the frame per pixel of an image */
    int width, height, across, down, bands, num_images; /* upper bounds */
    size_t image_size, half_size;                       /* per image */
};

struct convolution_state {
    const struct pell_services *services; /* borrowed */
    struct pell_context *ctx;
    struct pell_pool *pool;
    const struct conv_kernels *kernels;
    struct convolution_knobs knobs;
    struct pell_solids *solids; /* or NULL */
    const struct pell_frame_material *materials;
    size_t num_materials, num_groups;
    struct conv_radial (*radial)[3];        /* by material */
    struct pell_thickness_table *thickness; /* by material; NULL with through=planes */
    bool *by_slab;                          /* by material: light is transmitted as through a slab, not by the planes */
    float *tables;
    struct conv_radial level_radial[CONV_LEVELS][3]; /* of a material at other strengths */
    size_t level_material[CONV_LEVELS];              /* that material's index + 1 */
    float *level_tables;
    struct conv_spectra sets[CONV_SETS];
    size_t num_sets;

    struct conv_sources sources;
    float *front_memory, *behind_memory;
    struct conv_extent *rows; /* per row of the frame, for one group */
    unsigned char *present;   /* groups present in a frame */
    int *ray_counts;

    struct conv_format formats[CONV_AUTO_SIZE], format; /* by enum conv_resolution, the possible ones; and that of the job */
    float *images;                                      /* of planes at reduced resolution */
    float *half, **scratch, *scratch_memory, *uniform;
    unsigned char *occupied; /* [band][image] */
    struct pell_rect *lit;   /* per band: bounds of its light, pixels of images */

    /* The current group and channel. */
    struct conv_job {
        const struct pell_frame *in;
        const struct pell_frame_light *out;
        const struct conv_radial *radial;
        const struct conv_spectra *set;
        struct conv_layout layout;
        float arrives[3][CONV_PLANES][CONV_PLANES]; /* fraction of the light of one plane that reaches another; on the diagonal: of hidden
                                                     * light on its plane */
        float arrives_over[3][CONV_DISTANCES + 1];  /* by distance: i^2 relative to the widest */
        float widest;                               /* mm */
        float median;                               /* mm: geometric mean of the channels' median radii */
        struct conv_extent extent;
        size_t group;
        int level, first_level, last_level;      /* of its strength; -1: uniform */
        int channel, x0, y0;                     /* position of the images' first pixel, in pixels of the frame */
        ptrdiff_t stride;                        /* of images */
        ptrdiff_t block;                         /* of half spectra */
        int between, behind;                     /* numbers of images between planes, and of transmitted light */
        int bands, column_blocks, behind_blocks; /* blocks of columns: all, and those with transmitted light */
        bool uniform;                            /* the light is 1 everywhere, to compute the response */
        bool divide;
        struct pell_rect reached; /* pixels of images that light reaches; outside, the transforms leave rounding errors only */
        struct pell_fft across, down;
        float *tables[2];
        bool lit[CONV_IMAGES], seen[CONV_IMAGES];
        struct conv_mix mix;
        struct conv_weights weights;
        struct conv_transfers transfers;
        struct conv_edges edges[3]; /* fade 0: none */
    } job;
    float *shown; /* collected by show.c; NULL: no observer */
    struct pell_pass_time times[CONV_TIMES];
    bool timed;
};

static inline float conv_clamp(float x, float low, float high)
{
    return x < low ? low : x > high ? high : x;
}

static inline float *conv_image(const struct convolution_state *st, int image)
{
    return st->images + (size_t) image * st->format.image_size;
}

static inline float *conv_half(const struct convolution_state *st, int image)
{
    return st->half + (size_t) image * st->format.half_size;
}

/* layout.c: extent of the job's group, its planes and the sizes of its images, the coordinate of each sample among the planes, and the
 * images that the frame needs. */
void convolution_find_extent(struct convolution_state *st);
void convolution_choose_format(struct convolution_state *st);
void convolution_lay_out(struct convolution_state *st);
void convolution_find_coords(struct convolution_state *st);
/* Distance of hidden light from the plane that it shares with visible light: the distance with the mean transfer over all rays. Planes
 * without hidden light: half of the spacing. */
void convolution_measure_behind(struct convolution_state *st);

/* light.c: weights by coordinate and slant; then, per channel, the distribution of light to planes, and row transforms. */
void convolution_compute_weights(struct convolution_state *st);
void convolution_spread(struct convolution_state *st);

/* transforms.c: rows of a band of images to half spectra; all planes through the kernels; inverse transforms of rows, for the images in
 * `which`, which are `size` floats apart. A band's own images, in a worker's scratch, have CONV_BAND rows each. */
float *convolution_band_images(const struct convolution_state *st, int worker);
void convolution_transform_rows(struct convolution_state *st, int band, int worker, float *images);
void convolution_transform_columns(struct convolution_state *st);
void convolution_transform_back(struct convolution_state *st, int band, int worker, const bool *which, float *images, size_t size);

/* levels.c: strength maps: the levels that the job's pixels need; the job's profile at one level; the light of a level, added to
 * a row of the frame. */
bool convolution_has_strength_maps(const struct pell_scene *scene);
void convolution_find_levels(struct convolution_state *st, float constant);
void convolution_take_level(struct convolution_state *st, const struct pell_frame_material *m, size_t material, int level);
void convolution_blend_row(const struct convolution_state *st, int y, const float *row);

/* gather.c: inverse transforms of rows of planes, and interpolation to pixels. */
void convolution_gather(struct convolution_state *st);

/* show.c: intermediate images for observers of the renderer, if any. Call around the channels of a group; its bands report the planes in
 * `which`, `size` floats apart. */
PELL_NODISCARD enum pell_result convolution_show_begin(struct convolution_state *st);
void convolution_show_band(const struct convolution_state *st, int band, bool after, const bool *which, const float *images, size_t size);
PELL_NODISCARD enum pell_result convolution_show_end(struct convolution_state *st);
void convolution_show_drop(struct convolution_state *st);

#endif
