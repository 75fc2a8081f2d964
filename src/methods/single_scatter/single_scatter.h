/* SPDX-License-Identifier: MIT
 *
 * single_scatter.h - what the files of this method share. Its only symbol for others is pell_method_single_scatter.
 */
#ifndef PELL_SINGLE_SCATTER_H
#define PELL_SINGLE_SCATTER_H

#include "lights/light_sampling.h"
#include "transport/medium_layers.h"
#include "transport/refraction/connect.h"
#include "transport/surface_color.h"

#include <pellucid/method.h>

enum single_as { SINGLE_BEST, SINGLE_PAPER };
enum single_distance { SINGLE_BOTH, SINGLE_TRANSMITTANCE, SINGLE_EQUIANGULAR };
enum single_refraction { SINGLE_EXACT, SINGLE_NONE };
enum single_normals { SINGLE_SMOOTH, SINGLE_FLAT };

struct single_knobs {
    int as; /* enum single_as */
    float error;
    int most;
    int distance;   /* enum single_distance */
    int refraction; /* enum single_refraction */
    int normals;    /* enum single_normals */
    int half;       /* enum reference_half */
};

/* --- medium.c: what fills a solid ------------------------------------------------------------------------------------------------- */

#define SINGLE_STRETCHES 64 /* of a straight way, each in one layer */
#define SINGLE_OPAQUE 30.0  /* optical depth that nothing is looked for beyond: e^-30 */

struct single_layer {
    double bottom; /* mm below the surface, where nothing is painted; the last has none: INFINITY */
    double sigma_s[3], sigma_t[3];
    struct pell_phase phase[3];
};

/* Where layers are by maps. */
struct single_painting {
    struct pell_medium_layers medium_layers;
    const struct pell_rays *rays;
    const struct pell_mesh *meshes;
    const int32_t *of_mesh; /* solid of each mesh */
    double texel;           /* mm: about what the finest map tells apart */
};

/* Layers by the distance to the nearest surface of the solid; a homogeneous medium is one layer. What is black below them is one, too. */
struct single_medium {
    double eta;
    int layers;
    struct single_layer *layer;       /* the medium's own, as what is painted */
    struct single_painting *painting; /* NULL: bottoms are the same all over */
};

/* PELL_ERR_UNSUPPORTED, logged, for materials of which only a profile is known. `out` is to be finished whatever happens. */
PELL_NODISCARD enum pell_result single_medium_make(struct pell_context *ctx, const struct pell_material *m, struct single_medium *out);
void single_medium_finish(struct pell_context *ctx, struct single_medium *medium);
/* What a painted medium needs to know of the solid that it fills; borrowed. */
void single_medium_place(struct single_medium *medium, const struct pell_scene *scene, const struct pell_rays *rays,
                         const struct pell_solids *solids, int solid);

/* A straight way through a solid. */
struct single_way {
    int count;
    struct single_stretch {
        double end; /* mm from the start */
        int layer;
        double depth[3]; /* optical, at its end */
    } stretch[SINGLE_STRETCHES];
};

/* `length` mm from x along the unit w, or as far as any light comes. Where a layer is crossed is found by steps of the distance to it,
 * within 1e-4 of the thinnest layer; painted ones by steps of 0.7 of that or two texels, then by halving to 1e-5 of the deepest. */
void single_way_make(const struct pell_connector *connector, int solid, const struct single_medium *m, struct pell_vec3 x,
                     struct pell_vec3 w, double length, struct single_way *out);
/* The stretch that holds a place at `s` mm, and the optical depths there. */
int single_way_at(const struct single_way *way, const struct single_medium *m, double s, double depth[3]);
/* The place where channel c has an optical depth in [0, all of it). */
double single_way_find(const struct single_way *way, const struct single_medium *m, int c, double depth);

/* --- scatter.c: the light of one place -------------------------------------------------------------------------------------------- */

/* All that light needs; borrowed, but for what the method's state owns. */
struct single_world {
    struct pell_context *ctx;
    const struct pell_scene *scene;
    const struct pell_rays *rays;
    const struct pell_solids *solids;
    const struct pell_connector *connector;
    const struct pell_light_sampler *light_sampler;
    const struct single_medium *medium; /* of each solid */
    const struct pell_tint *tint;       /* of the scene's materials */
    struct single_knobs knobs;
    double error; /* relative standard error of a multisample */
    uint32_t seed;
};

/* One a worker. */
struct single_counts {
    _Alignas(64) int64_t pixels, samples, rays, over; /* over: pixels that stopped at the knob most */
};

/* Radiance that light scattered once inside sends from the surface at `at` along `toward` (unit, to the camera, which is at least `depth`
 * mm away), W/(m^2 sr), and its standard error. Of no solid, or none that light enters: 0. Depends on these arguments and the seed
 * alone. */
void single_estimate(const struct single_world *world, struct pell_vec3 at, struct pell_vec3 toward, double depth,
                     struct single_counts *counts, float out[3], float standard_error[3]);

extern const struct pell_method_engine pell_single_scatter_cpu;

#endif
