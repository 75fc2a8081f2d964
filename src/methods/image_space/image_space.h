/* SPDX-License-Identifier: MIT
 *
 * image_space.h - declarations shared by the files of this method. Its only external symbol is pell_method_image_space.
 */
#ifndef PELL_IMAGE_SPACE_H
#define PELL_IMAGE_SPACE_H

#include "methods/image_space/kernels.h"
#include "render/camera_view.h"

#include <pellucid/method.h>

struct pell_solids;
struct pell_services;

enum is_as { IS_BEST, IS_PAPER };
enum is_sampling { IS_COMBINED, IS_SEPARATE, IS_IMPORTANCE, IS_UNIFORM };
enum is_tile { IS_TILE_1, IS_TILE_2, IS_TILE_4, IS_TILE_8 };
enum is_views { IS_VIEWS_CAMERA, IS_VIEWS_LIGHTS, IS_VIEWS_AROUND };
enum is_renormalise { IS_BY_VIEWS, IS_BY_WEIGHT, IS_BY_COUNT, IS_NEVER };
enum is_spread { IS_SPREAD_MATERIAL, IS_SPREAD_ALBEDO };
enum is_profile { IS_PROFILE_MATERIAL, IS_PROFILE_DIPOLE };
enum is_through { IS_THROUGH_AUTO, IS_THROUGH_OFF, IS_THROUGH_PROFILE, IS_THROUGH_SLAB };
enum is_misprint { IS_AS_MEANT, IS_MISPRINT_TWO_PI, IS_MISPRINT_JACOBIAN, IS_MISPRINT_ONE_NUMBER };

struct is_knobs {
    int as; /* enum is_as */
    int samples;
    int sampling;    /* enum is_sampling */
    int tile;        /* enum is_tile */
    int views;       /* enum is_views */
    int view_size;   /* px */
    int renormalise; /* enum is_renormalise */
    bool adaptive, progressive, jacobian, reconstruct, strength;
    int spread;   /* enum is_spread */
    int profile;  /* enum is_profile */
    int through;  /* enum is_through: is_through_of */
    int misprint; /* enum is_misprint */
};

/* The knob `through`, with auto resolved: views of lights, or from around, contain the surface where light enters, so that no light is
 * missing. */
static inline int is_through_of(const struct is_knobs *k)
{
    return k->through != IS_THROUGH_AUTO ? k->through : k->views != IS_VIEWS_CAMERA ? IS_THROUGH_OFF : IS_THROUGH_SLAB;
}

/* --- samples.c: the sample set of a material ------------------------------------------------------------------------------------ */

#define IS_ENERGY 0.99 /* fraction of the widest channel's light inside R' */

/* With both kinds half of the samples each; a single sample is of the first kind. */
int is_importance_samples(const struct is_knobs *k);
int is_uniform_samples(const struct is_knobs *k);
int is_tile_side(const struct is_knobs *k);
/* Whether sample counts adapt; the samples of a class (0: it does not exist), and of all classes. */
bool is_adapts(const struct is_knobs *k);
int is_class_samples(const struct is_knobs *k, int class);
int is_row_samples(const struct is_knobs *k);

/* R': the radius with 99 % of the light of the widest channel; 0 for a material that returns no light. */
double is_reach(const struct pell_frame_material *m);
/* `most`: upper bound of R' for which broad samples are distributed, mm. The caller frees set->offset, set->rows and set->level. With
 * IS_SPREAD_ALBEDO a material whose colour is a texture, and whose profile is computed from coefficients by a model, has IS_LEVELS
 * levels. */
PELL_NODISCARD enum pell_result is_set_make(struct pell_context *ctx, const struct pell_frame_material *m, const struct is_knobs *knobs,
                                            double most, struct is_set *set);
/* Copies the patterns for image `image_index` into the offsets of an owned set; 0: the original ones. */
void is_set_turn(const struct is_knobs *knobs, uint64_t image_index, const struct is_set *set);
/* Albedo of a level. */
double is_level_albedo(int level);
/* Radius and angle (turns) of sample k of the pixel at (x, y) of the tile, before the table stores them in single precision. */
void is_set_sample(const struct pell_frame_material *m, const struct is_knobs *knobs, double reach, int x, int y, int k, double *r_mm,
                   double *turns);

/* --- adapt.c: number of samples per region ---------------------------------------------------------------------------------------- */

struct is_adapt {
    int width, height; /* number of regions of the frame */
    uint8_t *count;    /* translucent pixels per region; owned, as are the other two */
    uint16_t *step;    /* log step of the variance of the surrounding light */
    uint8_t *classes;
};

/* Counts and steps of the regions of row ry. Thread-safe for different rows. */
void is_adapt_row(const struct is_work *w, struct is_adapt *a, int ry);
/* Chooses their classes, after all rows. */
void is_adapt_choose(const struct is_work *w, struct is_adapt *a);

/* --- views.c: irradiance images from the lights, or from around -------------------------------------------------------------------- */

#define IS_VIEWS_MAX 8 /* maximum number of lights with a view; further lights are reported */

struct is_light_view {
    struct pell_view view;
    float *texels; /* owned; size x size of IS_TEXEL floats */
};

/* One view per light that is not an environment, or in both directions along each axis (IS_VIEWS_AROUND), of all translucent surfaces; keys
 * are solid + 1. Borrows the renderer's scene. */
PELL_NODISCARD enum pell_result is_light_views_make(const struct pell_services *services, const struct pell_solids *solids,
                                                    const struct is_knobs *k, struct is_light_view *views, int *count);

/* --- setup.c: setup common to all engines ------------------------------------------------------------------------------------------ */

struct is_setup {
    const struct pell_services *services; /* borrowed, as is ctx */
    struct pell_context *ctx;
    struct is_knobs knobs;
    struct is_set *sets;
    size_t num_sets;
    struct pell_solids *solids;             /* for views of lights, or NULL */
    struct pell_thickness_table *thickness; /* by material, or NULL */
    struct is_light_view light_views[IS_VIEWS_MAX];
    struct is_view views[IS_VIEWS_MAX];
    uint64_t image_index; /* index of the image that the patterns of the sets are for: is_set_turn */
    struct is_work work;  /* planes and image are the engine's; everything else is set here */
};

/* `st` is zeroed. Call is_setup_finish even after a failure. */
PELL_NODISCARD enum pell_result is_setup_make(const struct pell_services *services, const struct pell_frame_shape *shape,
                                              const struct is_knobs *knobs, struct is_setup *st);
void is_setup_finish(struct is_setup *st);
/* Sets what depends on the frame; shows images of it to observers of the renderer. */
PELL_NODISCARD enum pell_result is_setup_frame(struct is_setup *st, const struct pell_frame *in);
/* Solids + 1 of the translucent pixels of row y of the frame, by column; only with st->solids. Thread-safe. */
void is_find_solids(const struct is_setup *st, const struct pell_frame *in, int y, int32_t *to);

static inline const struct pell_thickness_table *is_setup_thickness(const struct is_setup *st, size_t material)
{
    return st->thickness && material < st->num_sets ? &st->thickness[material] : NULL;
}

extern const struct pell_method_engine pell_is_cpu, pell_is_vulkan;

/* show.c: intermediate images for observers of the renderer (pell_services_observed). */
PELL_NODISCARD enum pell_result is_show_samples(const struct pell_services *services, const struct is_knobs *knobs,
                                                const struct is_set *sets, size_t count);
PELL_NODISCARD enum pell_result is_show_view(const struct pell_services *services, const struct is_light_view *view, int index);

#endif
