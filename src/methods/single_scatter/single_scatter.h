/* SPDX-License-Identifier: MIT
 *
 * single_scatter.h - what the files of this method share. Its only symbol for others is pell_method_single_scatter.
 */
#ifndef PELL_SINGLE_SCATTER_H
#define PELL_SINGLE_SCATTER_H

#include "transport/refraction/connect.h"
#include "lights/light_sampling.h"
#include "transport/medium_layers.h"

#include <pellucid/method.h>

enum ss_as { SS_BEST, SS_PAPER };
enum ss_distance { SS_BOTH, SS_TRANSMITTANCE, SS_EQUIANGULAR };
enum ss_refraction { SS_EXACT, SS_NONE };
enum ss_normals { SS_SMOOTH, SS_FLAT };

struct ss_knobs {
    int as; /* enum ss_as */
    float error;
    int most;
    int distance;   /* enum ss_distance */
    int refraction; /* enum ss_refraction */
    int normals;    /* enum ss_normals */
};

/* --- medium.c: what fills a body ------------------------------------------------------------------------------------------------- */

#define SS_STRETCHES 64 /* of a straight way, each in one layer */
#define SS_OPAQUE 30.0  /* optical depth that nothing is looked for beyond: e^-30 */

struct ss_layer {
    double bottom; /* mm below the surface, where nothing is painted; the last has none: INFINITY */
    double sigma_s[3], sigma_t[3];
    struct pell_phase phase[3];
};

/* Where layers are by maps. */
struct ss_painting {
    struct pell_strata strata;
    const struct pell_rays *rays;
    const struct pell_mesh *meshes;
    const int32_t *of_mesh; /* body of each mesh */
    double texel;           /* mm: about what the finest map tells apart */
};

/* Layers by the distance to the nearest surface of the body; a homogeneous medium is one layer. What is black below them is one, too. */
struct ss_medium {
    double eta;
    int layers;
    struct ss_layer *layer;       /* the medium's own, as what is painted */
    struct ss_painting *painting; /* NULL: bottoms are the same all over */
};

/* PELL_ERR_UNSUPPORTED, logged, for materials of which only a profile is known. `out` is to be finished whatever happens. */
PELL_NODISCARD enum pell_result ss_medium_make(struct pell_context *ctx, const struct pell_material *m, struct ss_medium *out);
void ss_medium_finish(struct pell_context *ctx, struct ss_medium *medium);
/* What a painted medium needs to know of the body that it fills; borrowed. */
void ss_medium_place(struct ss_medium *medium, const struct pell_scene *scene, const struct pell_rays *rays,
                     const struct pell_bodies *bodies, int body);

/* A straight way through a body. */
struct ss_way {
    int count;
    struct ss_stretch {
        double end; /* mm from the start */
        int layer;
        double depth[3]; /* optical, at its end */
    } stretch[SS_STRETCHES];
};

/* `length` mm from x along the unit w, or as far as any light comes. Where a layer is crossed is found by steps of the distance to it,
 * within 1e-4 of the thinnest layer; painted ones by steps of 0.7 of that or two texels, then by halving to 1e-5 of the deepest. */
void ss_way_make(const struct pell_connector *connector, int body, const struct ss_medium *m, struct pell_vec3 x, struct pell_vec3 w,
                 double length, struct ss_way *out);
/* The stretch that holds a place at `s` mm, and the optical depths there. */
int ss_way_at(const struct ss_way *way, const struct ss_medium *m, double s, double depth[3]);
/* The place where channel c has an optical depth in [0, all of it). */
double ss_way_find(const struct ss_way *way, const struct ss_medium *m, int c, double depth);

/* --- scatter.c: the light of one place -------------------------------------------------------------------------------------------- */

/* All that light needs; borrowed, but for what the method's state owns. */
struct ss_world {
    struct pell_context *ctx;
    const struct pell_scene *scene;
    const struct pell_rays *rays;
    const struct pell_bodies *bodies;
    const struct pell_connector *connector;
    const struct pell_emitters *emitters;
    const struct ss_medium *medium; /* of each body */
    struct ss_knobs knobs;
    uint32_t seed;
};

/* One a worker. */
struct ss_counts {
    _Alignas(64) int64_t pixels, samples, rays, over; /* over: pixels that stopped at the knob most */
};

/* Radiance that light scattered once inside sends from the surface at `at` along `toward` (unit, to the eye, which is at least `depth` mm
 * away), W/(m^2 sr), and its standard error. Of no body, or none that light enters: 0. Depends on these arguments and the seed alone. */
void ss_estimate(const struct ss_world *world, struct pell_vec3 at, struct pell_vec3 toward, double depth, struct ss_counts *counts,
                 float out[3], float noise[3]);

extern const struct pell_method_engine pell_single_scatter_cpu;

#endif
