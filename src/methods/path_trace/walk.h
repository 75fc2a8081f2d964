/* SPDX-License-Identifier: MIT
 *
 * walk.h - paths from the camera, one at a time (walk.c) and in SIMD lanes (wavefront.c).
 */
#ifndef PELL_PATH_TRACE_WALK_H
#define PELL_PATH_TRACE_WALK_H

#include "methods/path_trace/path.h"

/* The last event before a path continues outside; determines which other technique could have found the light that it hits. */
enum pt_last { PT_LAST_NONE, PT_LAST_SURFACE, PT_LAST_EXIT };

struct pt_walk {
    const struct pt_scene *s;
    struct pt_counts *counts;
    struct pt_sampler *sampler;
    struct pt_light *out;
    const struct pt_light_vertex *vertex; /* of the light path */
    int vertices;
    struct pell_vec3 x, from, w; /* from: ray origin, x or just off its surface */
    struct pt_medium_stack stack;
    float beta[3];
    float safe;
    int events, scattered;
    int bounces;     /* segments outside that ended at a surface, without the camera's */
    bool entered;    /* through its first surface; else it is the reflection */
    bool hit_opaque; /* an opaque surface reflected it */
    bool crossed;    /* a surface since the last scattering event */
    /* A smooth surface on every edge between scattering events since the camera or a rough surface: no light path can be connected. */
    bool all_specular;
    enum pt_last last;
    float density;                /* PT_LAST_SURFACE: of w, per sr */
    struct pell_vec3 surface;     /* PT_LAST_SURFACE: its point */
    bool nee_done;                /* PT_LAST_SURFACE: next-event estimation except for the environment was done at exit.from */
    struct pt_exit exit;          /* for PT_LAST_EXIT, or after pt_should_connect; until then partly set */
    bool leaving;                 /* exit.from is the last vertex, without a surface since */
    float selection;              /* see pt_should_connect */
    struct pt_branches *branches; /* NULL: no splitting */
};

/* Queue of split paths that left a solid and hit a surface again; they are traced after the current path, last first. */
#define PT_BRANCHES 8
struct pt_branches {
    int count;
    struct pt_walk walk[PT_BRANCHES];
    struct pt_sampler sampler[PT_BRANCHES];
};

enum pt_split {
    PT_SPLIT_NOT,      /* the flight is unchanged */
    PT_SPLIT_COLLIDES, /* it collides inside, at a different length */
    PT_SPLIT_REFLECTS, /* p is past its end */
};

/* A flight that may leave a smooth solid: traces the exiting path, and conditions the flight to stay inside. */
enum pt_split pt_split(struct pt_walk *p, struct pt_flight *f);
/* The next queued path after a path is complete. False: there is none. */
bool pt_next_branch(struct pt_walk *p);

enum pt_connection { PT_CONNECTION_UNDECIDED, PT_CONNECTION_NO, PT_CONNECTION_YES };

/* The surface at the pixel's point. */
bool pt_find(const struct pt_scene *s, struct pt_counts *counts, const struct pt_point *point, struct pt_hit *hit);

static inline void pt_light_add(struct pt_light *sum, const struct pt_light *light)
{
    for (int c = 0; c < 3; c++) {
        sum->multiple[c] += light->multiple[c];
        sum->single[c] += light->single[c];
        sum->surface[c] += light->surface[c];
    }
}

/* Starts the paths of a sample: through the pixel's own surface and, if it is smooth, reflected by it. Their light is added to out, which
 * is 0; their random numbers come from `sampler`; returns their number. The light path is in walker->vertex. */
int pt_begin(const struct pt_scene *s, struct pt_walker *walker, const struct pt_point *point, const struct pt_hit *hit, uint32_t sample,
             struct pt_walk walks[2], struct pt_sampler sampler[2], struct pt_light out[2]);
/* One flight and the event at its end. False: the path is complete. */
bool pt_step(struct pt_walk *p);
/* The event at a surface hit by a flight of `length`; false: the path is complete. */
bool pt_surface_event(struct pt_walk *p, const struct pt_hit *hit, float length);
/* A flight left the solid through no surface, and ended at x. */
void pt_escaped(struct pt_walk *p, struct pell_vec3 x);
/* Next-event estimation at a scatterer. `decision`: result of an earlier decision whether to connect, if any. */
void pt_scattering_event(struct pt_walk *p, const struct pt_scatterer *at, int solid, enum pt_connection decision);
/* Records a path terminated by the limit of events. */
void pt_count_cut(struct pt_counts *counts, const float beta[3]);

/* Traces all paths of some samples in SIMD lanes. */
struct pt_wavefront;
PELL_NODISCARD enum pell_result pt_wavefront_create(const struct pt_scene *s, struct pt_wavefront **out);
void pt_wavefront_destroy(struct pell_context *ctx, struct pt_wavefront **wavefront);
void pt_wavefront_trace(const struct pt_scene *s, struct pt_walker *walker, struct pt_job *jobs, int count);

#endif
