/* SPDX-License-Identifier: MIT
 *
 * single_scatter.h - declarations shared by the files of this method. Its only external symbol is pell_method_single_scatter.
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

/* --- medium.c: the medium of a solid ---------------------------------------------------------------------------------------------- */

#define SINGLE_MAX_SEGMENTS 64 /* maximum number of segments of a ray, each in one layer */
#define SINGLE_OPAQUE 30.0     /* optical depth where a ray ends: e^-30 */

struct single_layer {
    double bottom; /* mm below the surface, without maps; INFINITY for the last layer */
    double sigma_s[3], sigma_t[3];
    struct pell_phase phase[3];
};

/* Depth maps of layers. */
struct single_layer_maps {
    struct pell_medium_layers medium_layers;
    const struct pell_rays *rays;
    const struct pell_mesh *meshes;
    const int32_t *of_mesh; /* index of the solid of each mesh */
    double texel;           /* mm: approximate texel size of the finest map */
};

/* Layers by the distance to the nearest surface of the solid; a homogeneous medium is one layer. A black substrate below them is one,
 * too. */
struct single_medium {
    double eta;
    int layers;
    struct single_layer *layer;     /* owned by the medium, like `maps` */
    struct single_layer_maps *maps; /* NULL: depths are uniform */
};

/* PELL_ERR_UNSUPPORTED, logged, for materials with only a diffusion profile. Call single_medium_finish on `out` even after a failure. */
PELL_NODISCARD enum pell_result single_medium_make(struct pell_context *ctx, const struct pell_material *m, struct single_medium *out);
void single_medium_finish(struct pell_context *ctx, struct single_medium *medium);
/* Gives a medium with depth maps access to its solid; the arguments are borrowed. */
void single_medium_attach(struct single_medium *medium, const struct pell_scene *scene, const struct pell_rays *rays,
                          const struct pell_solids *solids, int solid);

/* A straight ray through a solid, divided by layers. */
struct single_segments {
    int count;
    struct single_segment {
        double end; /* mm from the origin */
        int layer;
        double depth[3]; /* optical depths at its end */
    } segment[SINGLE_MAX_SEGMENTS];
};

/* Divides `length` mm of a ray from x along the unit w, or as much as is not opaque. Layer crossings are found by sphere tracing, within
 * 1e-4 of the thinnest layer; with depth maps by steps of 0.7 of the distance or two texels, then by bisection to 1e-5 of the deepest. */
void single_segments_make(const struct pell_connector *connector, int solid, const struct single_medium *m, struct pell_vec3 x,
                          struct pell_vec3 w, double length, struct single_segments *out);
/* Index of the segment that contains the distance `s`, mm, and the optical depths there. */
int single_segments_at(const struct single_segments *segments, const struct single_medium *m, double s, double depth[3]);
/* The distance where channel c has an optical depth in [0, its total). */
double single_segments_find(const struct single_segments *segments, const struct single_medium *m, int c, double depth);

/* --- scatter.c: single scattering at a point -------------------------------------------------------------------------------------- */

/* Inputs of the estimate; borrowed, owned by the method's state. */
struct single_world {
    struct pell_context *ctx;
    const struct pell_scene *scene;
    const struct pell_rays *rays;
    const struct pell_solids *solids;
    const struct pell_connector *connector;
    const struct pell_light_sampler *light_sampler;
    const struct single_medium *medium; /* by solid */
    const struct pell_tint *tint;       /* by material of the scene */
    struct single_knobs knobs;
    double error; /* target relative standard error of a multisample */
    uint32_t seed;
};

/* One per worker. */
struct single_counts {
    _Alignas(64) int64_t pixels, samples, rays, over; /* over: pixels that stopped at the knob most */
};

/* Radiance of single scattering from the surface at `at` along `toward` (unit, to the camera, which is at least `depth` mm away), W/(m^2
 * sr), and its standard error. 0 outside of solids and without incident light. Depends on these arguments and the seed only. */
void single_estimate(const struct single_world *world, struct pell_vec3 at, struct pell_vec3 toward, double depth,
                     struct single_counts *counts, float out[3], float standard_error[3]);

extern const struct pell_method_engine pell_single_scatter_cpu;

#endif
