/* SPDX-License-Identifier: MIT
 *
 * state.h - a running convolution method on the cpu engine and the steps of a frame, in their order. Each step runs its rows, bands or
 * blocks on the pool; what it is about is in the job.
 */
#ifndef PELL_CONVOLUTION_STATE_H
#define PELL_CONVOLUTION_STATE_H

#include "methods/convolution/convolution.h"

enum { CONV_BAND = 16, CONV_SETS = 4, CONV_MULTIPLE = 16, CONV_LEVELS = 7 };
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

/* What scatters together: its pixels in a frame. */
struct conv_extent {
    struct pell_rect rect;
    float low, high; /* depth */
    unsigned seen;   /* of a row: bit i, pixels between planes i and i + 1 */
    float brightest[3];
    float weakest, strongest; /* strength */
    int64_t pixels;
};

/* Images of one resolution. */
struct conv_room {
    int step;                                           /* pixels of the picture to one of an image */
    int width, height, across, down, bands, num_images; /* at most */
    size_t image_size, half_size;                       /* of one */
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
    struct conv_radial (*radial)[3];        /* of materials */
    struct pell_thickness_table *thickness; /* of materials; NULL with through=planes */
    bool *by_slab;                          /* the same: whether light goes through as through a slab, and not by planes */
    float *tables;
    struct conv_radial level_radial[CONV_LEVELS][3]; /* of a material at other strengths, */
    size_t level_of[CONV_LEVELS];                    /* its number + 1 */
    float *level_tables;
    struct conv_spectra sets[CONV_SETS];
    size_t num_sets;

    struct conv_sources sources;
    float *front_memory, *behind_memory;
    struct conv_extent *rows; /* of rows of the picture, for one group */
    unsigned char *there;     /* groups in a frame */
    int *ray_counts;

    struct conv_room rooms[CONV_AUTO_SIZE], room; /* by enum conv_resolution, those that may be asked for; of the job */
    float *images;                                /* of planes that are smaller than the picture */
    float *half, **scratch, *scratch_memory, *uniform;
    unsigned char *occupied; /* [band][image] */
    struct pell_rect *lit;   /* of bands: where their light is, pixels of images */

    /* The running group and channel. */
    struct conv_job {
        const struct pell_frame *in;
        const struct pell_frame_light *out;
        const struct conv_radial *radial;
        const struct conv_spectra *set;
        struct conv_layout layout;
        float arrives[3][CONV_PLANES][CONV_PLANES]; /* share of the light of a plane that reaches another; of light behind on its own */
        float arrives_over[3][CONV_DISTANCES + 1];  /* over the distance: i^2 of the widest */
        float widest;                               /* mm */
        float median;                               /* mm: the radius with half of the light inside, mean of the channels */
        struct conv_extent extent;
        size_t group;
        int level, first_level, last_level;      /* of its strength; -1: the same everywhere */
        int channel, x0, y0;                     /* of the images' first pixel, in the picture's pixels */
        ptrdiff_t stride;                        /* of images */
        ptrdiff_t block;                         /* of half spectra */
        int between, behind;                     /* images between planes, and of transmitted light */
        int bands, column_blocks, behind_blocks; /* blocks of columns: of all, and of those with transmitted light */
        bool uniform;                            /* of light 1, to divide by */
        bool divide;
        struct pell_rect reached; /* pixels of images that light comes to; beyond it what transforms leave is rounding */
        struct pell_fft across, down;
        float *tables[2];
        bool lit[CONV_IMAGES], seen[CONV_IMAGES];
        struct conv_mix mix;
        struct conv_weights weights;
        struct conv_shares shares;
        struct conv_edges edges[3]; /* fade 0: none */
    } job;
    float *shown; /* what show.c collects; NULL: nobody observes */
    struct pell_pass_time times[CONV_TIMES];
    bool timed;
};

static inline float conv_clamp(float x, float low, float high)
{
    return x < low ? low : x > high ? high : x;
}

static inline float *conv_image(const struct convolution_state *st, int image)
{
    return st->images + (size_t) image * st->room.image_size;
}

static inline float *conv_half(const struct convolution_state *st, int image)
{
    return st->half + (size_t) image * st->room.half_size;
}

/* layout.c: the pixels of the job's group, its planes and the sizes of its images, the place of each sample among the planes, and which
 * images the picture needs. */
void convolution_find_extent(struct convolution_state *st);
void convolution_take_room(struct convolution_state *st);
void convolution_lay_out(struct convolution_state *st);
void convolution_place(struct convolution_state *st);
/* How far light behind is from the planes that it and what lies before it share: the distance at which as much arrives as on the mean over
 * all rays. Planes without any: half way to the next. */
void convolution_measure_behind(struct convolution_state *st);

/* light.c: what light weighs, by place and lean; then for one channel light to planes, and their rows to half spectra. */
void convolution_weigh(struct convolution_state *st);
void convolution_spread(struct convolution_state *st);

/* transforms.c: rows of a band of images to half spectra; all planes through the kernels; rows back, of the images in `which`, which are
 * `size` floats apart. The band's own images, in a worker's scratch, are CONV_BAND rows each. */
float *convolution_band_images(const struct convolution_state *st, int worker);
void convolution_transform_rows(struct convolution_state *st, int band, int worker, float *images);
void convolution_transform_columns(struct convolution_state *st);
void convolution_transform_back(struct convolution_state *st, int band, int worker, const bool *which, float *images, size_t size);

/* levels.c: strength maps. Which levels the job's pixels need; the job's profile at one of them; its pixels' share of a row of one. */
bool convolution_has_strength_maps(const struct pell_scene *scene);
void convolution_find_levels(struct convolution_state *st, float constant);
void convolution_take_level(struct convolution_state *st, const struct pell_frame_material *m, size_t material, int level);
void convolution_blend_row(const struct convolution_state *st, int y, const float *row);

/* gather.c: rows of planes back, and to pixels. */
void convolution_gather(struct convolution_state *st);

/* show.c: for who observes the renderer; nothing otherwise. Around the channels of a group, whose bands tell of the planes in `which`,
 * `size` floats apart. */
PELL_NODISCARD enum pell_result convolution_show_begin(struct convolution_state *st);
void convolution_show_band(const struct convolution_state *st, int band, bool after, const bool *which, const float *images, size_t size);
PELL_NODISCARD enum pell_result convolution_show_end(struct convolution_state *st);
void convolution_show_drop(struct convolution_state *st);

#endif
