/* SPDX-License-Identifier: MIT
 *
 * walk.h - walks from the camera, one at a time (walk.c) and side by side (wavefront.c).
 */
#ifndef PELL_PATH_TRACE_WALK_H
#define PELL_PATH_TRACE_WALK_H

#include "methods/path_trace/path.h"

/* The last decision before a walk goes through the open: how else could the light that it meets have been found? */
enum pt_last { PT_LAST_NONE, PT_LAST_SURFACE, PT_LAST_EXIT };

struct pt_walk {
    const struct pt_scene *s;
    struct pt_counts *counts;
    struct pt_sampler *sampler;
    struct pt_light *out;
    const struct pt_light_vertex *vertex; /* of the light's path */
    int vertices;
    struct pell_vec3 x, from, w; /* from: where rays start, x or just off its surface */
    struct pt_medium_stack place;
    float beta[3];
    float safe;
    int events, scattered;
    int bounces;  /* ways through the open that ended at a surface; not that from the camera */
    bool entered; /* at its first surface; else it shows what that reflects */
    bool mixed;   /* something opaque reflected it */
    bool crossed; /* a surface, since it last scattered */
    bool tight;   /* a smooth surface on every edge between scatterings, since the camera or a rough surface: no path of a light can
                          * be joined to it */
    enum pt_last last;
    float density;                /* LAST_SURFACE: of w, per sr */
    struct pell_vec3 surface;     /* LAST_SURFACE: where it is */
    bool looked;                  /* LAST_SURFACE: lights but the environment were looked for at exit.from */
    struct pt_exit exit;          /* LAST_EXIT, or looked; before that what is known of it */
    bool leaving;                 /* exit.from is the last vertex, with no surface since */
    float turn;                   /* see pt_should_connect */
    struct pt_branches *branches; /* NULL: walks are not split */
};

/* Parts of a walk that left a solid and met a surface again: the last of them goes on when it is over. */
#define PT_BRANCHES 8
struct pt_branches {
    int count;
    struct pt_walk walk[PT_BRANCHES];
    struct pt_sampler sampler[PT_BRANCHES];
};

enum pt_split {
    PT_SPLIT_NOT,      /* the flight is as it was */
    PT_SPLIT_COLLIDES, /* it ends inside, at another length */
    PT_SPLIT_REFLECTS, /* p is past its end */
};

/* A flight that may leave a smooth solid for the open: follows what leaves, and makes the flight one that stays. */
enum pt_split pt_split(struct pt_walk *p, struct pt_flight *f);
/* The next part of a walk that is over. False: there is none. */
bool pt_next_branch(struct pt_walk *p);

enum pt_connection { PT_CONNECTION_NOT, PT_CONNECTION_NO, PT_CONNECTION_YES };

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

/* The walks of a sample: through the pixel's own surface, and, where it is smooth, reflected by it. Their light goes to out, which is 0,
 * and their numbers are those of `sampler`; returns how many there are. The light's path is walker->vertex. */
int pt_begin(const struct pt_scene *s, struct pt_walker *walker, const struct pt_point *point, const struct pt_hit *hit, uint32_t sample,
             struct pt_walk walks[2], struct pt_sampler sampler[2], struct pt_light out[2]);
/* One flight and what is at its end. False: the walk is over. */
bool pt_walk_on(struct pt_walk *p);
/* What a step does at a surface that a flight of `length` met; false: the walk is over. */
bool pt_met(struct pt_walk *p, const struct pt_hit *hit, float length);
/* A flight left the solid through no surface, and ended at x. */
void pt_left(struct pt_walk *p, struct pell_vec3 x);
/* What is looked for at a scatterer, and kept of it. asked: whether lights have been asked for already, with what answer. */
void pt_scattered(struct pt_walk *p, const struct pt_scatterer *at, int solid, enum pt_connection asked);
/* Path and steps are too many. */
void pt_cut(struct pt_counts *counts, const float beta[3]);

/* All walks of some samples, side by side. */
struct pt_wavefront;
PELL_NODISCARD enum pell_result pt_wavefront_create(const struct pt_scene *s, struct pt_wavefront **out);
void pt_wavefront_destroy(struct pell_context *ctx, struct pt_wavefront **side);
void pt_wavefront_trace(const struct pt_scene *s, struct pt_walker *walker, struct pt_job *jobs, int count);

#endif
