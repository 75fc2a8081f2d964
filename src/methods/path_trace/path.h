/* SPDX-License-Identifier: MIT
 *
 * path.h - what the files of the transport share.
 *
 * Radiance is carried as L/n^2, n the index of the medium relative to the outside: it stays the same where light refracts, so that every
 * boundary is a probability to go on in a direction, and a walk in a world that absorbs nothing keeps its weight.
 */
#ifndef PELL_PATH_TRACE_PATH_H
#define PELL_PATH_TRACE_PATH_H

#include "lights/light_sampling.h"
#include "methods/path_trace/sampler.h"
#include "methods/path_trace/scalar.h"
#include "methods/path_trace/trace.h"
#include "transport/distance_field.h"
#include "transport/medium_layers.h"
#include "transport/refraction/connect.h"
#include "transport/surface_color.h"
#include "visibility/rays.h"

#define PT_NEST 8   /* solids in solids that a path keeps account of */
#define PT_LOBES 16 /* about connections of a point with a light's place: the nearest ones */
#define PT_ROUGH_CELLS 64
#define PT_LIGHT_VERTICES 8 /* of a path from a light that are kept */

/* --- boundary.c ----------------------------------------------------------------------------------------------------------------- */

/* A rough boundary between two indices, seen from either side: [0] from outside, [1] from inside. */
struct pt_rough {
    float alpha, eta;                    /* eta: inside / outside */
    float albedo[2][PT_ROUGH_CELLS + 1]; /* over mu = i / cells: what single bounces between facets return, both ways together */
    float lost[2][PT_ROUGH_CELLS];       /* density, over mu^2, of the directions in which the rest leaves on a side: it sums to 1 */
    float lost_sum[2][PT_ROUGH_CELLS];   /* of the cells up to and with this one */
    float lost_in_transmission[2];       /* share of the rest that goes through */
};

/* The share of light that reflects; cos_i on the side that it comes from, eta = n_transmitted / n_incident. *cos_t: of the refracted. */
float pt_fresnel(float eta, float cos_i, float *cos_t);

void pt_rough_make(float alpha, float eta, struct pt_rough *out);

/* A way of light at a surface: toward `o`, by the surface's normals, shading's and geometric, both on o's side. */
struct pt_shading_frame {
    struct pell_vec3 o, ns, ng;
    int side; /* 0: o is outside */
};

/* Where light goes on. The density is what pt_rough_density says, the weight is 1. *through: it passed. */
struct pell_vec3 pt_rough_sample(const struct pt_rough *rough, const struct pt_shading_frame *at, struct pt_sampler *s, bool *transmitted);
/* Per sr; w tells by its side of ng whether it passed. */
float pt_rough_density(const struct pt_rough *rough, const struct pt_shading_frame *at, struct pell_vec3 w);

/* Mirrors w about the plane of ng if it lies on the wrong side: shading normals send light there. `above`: it belongs on ng's side. */
static inline struct pell_vec3 pt_to_side(struct pell_vec3 w, struct pell_vec3 ng, bool above)
{
    const float c = vec3_dot(w, ng);
    return (c > 0.0f) == above ? w : vec3_mad(w, -2.0f * c, ng);
}

/* --- medium.c ------------------------------------------------------------------------------------------------------------------- */

struct pt_coefficients {
    float sigma_t[3], sigma_s[3];
    float mean_free_path[3]; /* INFINITY: nothing in the way */
    struct pell_phase phase[3];
    float g[3];
    bool hg;        /* Henyey and Greenstein's for all channels */
    bool alike;     /* one phase function for all channels */
    bool isotropic; /* which scatters evenly */
    bool gray;      /* all channels alike in all */
    bool clear;     /* nothing in it */
};

/* Where layers are by maps. */
struct pt_layer_maps {
    struct pell_medium_layers medium_layers;
    const struct pell_mesh *meshes; /* the scene's */
};

/* What fills a solid: one set of coefficients, or layers by the distance below the surface. */
struct pt_medium {
    float eta;
    bool homogeneous;               /* one layer without a bottom */
    bool ends;                      /* below the layers light is gone */
    bool floor;                     /* but for what a Lambertian surface of the base colour reflects there */
    int layers;                     /* >= 1 */
    struct pt_coefficients *layer;  /* the medium's own, as all that follows */
    float *depth;                   /* mm, of the bottom of each, where nothing is painted; the last's may be INFINITY */
    struct pt_layer_maps *painting; /* NULL: the same all over */
    float deepest;                  /* mm: below it nothing changes any more */
    float largest[3];               /* of sigma_t over the layers */
    float slowest;                  /* least sigma_t of all channels and layers */
};

/* PELL_ERR_UNSUPPORTED, logged, for profiles that no medium is equivalent to. `out` is to be finished whatever
 * happens. */
PELL_NODISCARD enum pell_result pt_medium_make(struct pell_context *ctx, const struct pell_scene *scene, const struct pell_material *m,
                                               struct pt_medium *out);
void pt_medium_finish(struct pell_context *ctx, struct pt_medium *medium);

/* Density per sr, of each channel, of light going along w that scatters toward v (both along the way that the walk goes). */
void pt_phase_values(const struct pt_coefficients *c, struct pell_vec3 w, struct pell_vec3 v, float out[3]);
/* Scatters w; beta becomes what it is after; returns the density of the new direction by all channels, as they were weighed. */
float pt_phase_sample(const struct pt_coefficients *c, struct pell_vec3 w, struct pt_sampler *s, float beta[3], struct pell_vec3 *out);

/* --- scene.c -------------------------------------------------------------------------------------------------------------------- */

struct pt_solid {
    struct pt_medium medium;
    bool smooth, rough; /* its boundary is, all over */
    bool closed;
    bool grid;               /* the distance grid holds */
    bool connects;           /* lights are looked for through its boundary, smooth all over */
    bool near;               /* the same, rough all over */
    bool lanes;              /* walks go side by side in it */
    float further;           /* mm beyond the bound to which flights are split at its boundary; 0: they are not */
    float ask;               /* mm; how far connections look is -ask log u */
    float share;             /* of the scatterings after the first at which lights are looked for */
    struct pell_vec3 lo, hi; /* bounds */
};

/* How rough a material's boundary is: where its map says different objects, in even steps of roughness. */
struct pt_roughness_step {
    float low, high; /* roughness; what is below the least rough one is smooth. Both 0: smooth all over */
    int steps;       /* 1: no map, or one of one number */
};

struct pt_scene {
    struct pell_context *ctx;
    const struct pell_services *services;
    const struct pell_scene *scene;
    const struct pell_rays *rays;
    struct pt_knobs knobs;
    struct pell_solids *solids;
    struct pt_solid *solid; /* one each */
    struct pt_rough *rough; /* of (material, index ratio) pairs that occur */
    size_t num_rough;
    struct pt_roughness_step *finish; /* of a scene material's boundary */
    struct pell_tint *tint;           /* the same */
    struct pell_light_sampler *light_sampler;
    struct pell_connector *connector; /* NULL: not needed */
    struct pell_distance *distance;   /* NULL: no grid */
    struct pell_vec3 centre;          /* of a sphere about all solids */
    double radius;
    double typical;  /* radiance of that order is seen */
    double deadline; /* of pell_seconds() */
    double brightest;
    bool light_paths, chains; /* of delta lights */
    int light_rays;           /* of a sample: more where what surfaces reflect meets other surfaces */
    double environment_share; /* of what is looked for of the environment: an even one is met by chance as well */
    uint32_t seed;
    float unit; /* mm: some rounding errors of the largest coordinate of a solid */
};

/* A triangle that a ray met. */
struct pt_hit {
    uint32_t mesh, triangle;
    float u, v, t;
    struct pell_vec3 p, ng, ns; /* outward, unit; ns is ng where the knob says flat */
    bool bent;                  /* ns varies */
    float unit;                 /* mm: how far rays start from it, some rounding errors along ng */
    int solid;                  /* -1: opaque */
    int material;               /* scene's */
};

/* maps.c. What a map says there; 1 where it or its coordinates are missing. */
void pt_texel_at(const struct pt_scene *s, const struct pt_hit *hit, const struct pell_texture_map *map, float texel[4]);
void pt_set_tints(struct pt_scene *s);
/* Light that enters a solid there, or leaves it. */
void pt_tint(const struct pt_scene *s, const struct pt_hit *hit, bool enters, float beta[3]);
/* alpha of the boundary there; 0: smooth. */
float pt_alpha(const struct pt_scene *s, const struct pt_hit *hit);
/* NULL: smooth, or indices that match. */
const struct pt_rough *pt_rough_find(const struct pt_scene *s, const struct pt_hit *hit, float eta);
/* A place of a triangle; w stands in for a normal where it has none. All but t. */
void pt_hit_at(const struct pt_scene *s, uint32_t mesh, uint32_t triangle, float u, float v, struct pell_vec3 w, struct pt_hit *out);
/* Whether something is met; `reach` mm. */
bool pt_intersect(const struct pt_scene *s, struct pt_counts *counts, struct pell_vec3 x, struct pell_vec3 w, float reach, uint32_t mask,
                  struct pt_hit *out);
/* Whether nothing of `mask` is between. */
bool pt_unoccluded(const struct pt_scene *s, struct pt_counts *counts, struct pell_vec3 x, struct pell_vec3 w, float reach, uint32_t mask);
/* A start for rays from a surface to a side of it. */
static inline struct pell_vec3 pt_leave(const struct pt_hit *hit, struct pell_vec3 w)
{
    return vec3_mad(hit->p, vec3_dot(w, hit->ng) >= 0.0f ? hit->unit : -hit->unit, hit->ng);
}
/* Diffuse light that comes along w to something opaque: the normal of the side on which it leaves, of thin sheets by chance, and what is
 * left of it, over the density of that choice. */
struct pell_vec3 pt_leave_opaque(const struct pt_scene *s, const struct pt_hit *hit, struct pell_vec3 w, struct pt_sampler *sampler,
                                 float weight[3]);

/* Where a path is: solids that it entered, the last on top. */
struct pt_medium_stack {
    int count;
    int16_t solid[PT_NEST];
};

static inline int pt_top(const struct pt_medium_stack *p)
{
    return p->count > 0 ? p->solid[p->count - 1] : -1;
}

static inline float pt_index(const struct pt_scene *s, int solid)
{
    return solid >= 0 ? s->solid[solid].medium.eta : 1.0f;
}

/* The places on both sides of a solid's surface that light meets at `place`; `enter`: it goes against the outward normal. False: it is
 * inside already, and the surface is passed. What leaves a solid that it never entered is taken to have been inside. */
bool pt_cross(const struct pt_scene *s, const struct pt_medium_stack *place, int solid, bool enter, struct pt_medium_stack *before,
              struct pt_medium_stack *after);

/* --- distance_sampling.c -------------------------------------------------------------------------------------------------------- */

/* A way from x along w. Rays start at `from`: x, or just off the surface that x is on. */
struct pt_ray {
    struct pell_vec3 x, from, w;
};

/* One flight through a solid. */
struct pt_free_path {
    struct pell_vec3 x; /* where it ends */
    bool met;           /* a surface: `hit` */
    bool floor;         /* what is below the layers: reflects `albedo`, x is just off it, on the side of n */
    bool lost;          /* left the solid through no surface */
    float length;
    const struct pt_coefficients *medium; /* of what it scatters in */
    struct pt_hit hit;
    struct pell_vec3 n;
    float albedo[3];
};

/* A flight through a homogeneous medium that is not weighed yet. */
struct pt_flight {
    float further; /* mm beyond the bound to which a surface is looked for in any case, if a ray is needed at all */
    float length;  /* to where it scatters, if no surface comes first */
    float bound;   /* of a flight that needed a ray: mm before which nothing is, as was known before */
    int channel;   /* whose distance it is */
    bool met;      /* a surface comes first: `hit` */
    bool found;    /* hit is there, even if it is farther than the length */
    struct pt_hit hit;
    float over[3]; /* of each channel: 1 over the probability that it stays inside; 1 where flights are not split */
};

/* By the channels' weights beta. The caller has set `further`. */
void pt_fly(const struct pt_scene *s, struct pt_counts *counts, int solid, const struct pt_ray *ray, const float beta[3], float *safe,
            struct pt_sampler *sampler, struct pt_flight *out);
/* Where it ends; beta becomes what it is there. */
void pt_land(const struct pt_scene *s, int solid, const struct pt_ray *ray, const struct pt_flight *flight, float beta[3],
             struct pt_free_path *out);
/* By the channels' weights beta, which become what they are at the end, a collision's sigma_s with them. *safe: a distance from x that is
 * known to be free of surfaces; becomes what is left. */
void pt_sample_distance(const struct pt_scene *s, struct pt_counts *counts, int solid, const struct pt_ray *ray, float beta[3], float *safe,
                        struct pt_sampler *sampler, struct pt_free_path *out);
bool pt_outside(const struct pt_solid *b, struct pell_vec3 x, float margin);
/* The distance at which a ray leaves the bounds; x is inside. */
float pt_exit_distance(const struct pt_solid *b, struct pell_vec3 x, struct pell_vec3 w);
/* What is left of the weights after `length` without a collision; by the density of having passed. */
void pt_attenuate(const struct pt_coefficients *m, float length, float beta[3]);
/* What a solid (-1: the open) lets through unscattered of light along `reach` mm from x, where nothing is in the way; of layers an
 * estimate. */
void pt_transmittance(const struct pt_scene *s, int solid, struct pell_vec3 x, struct pell_vec3 w, float reach, struct pt_sampler *sampler,
                      float out[3]);

/* --- next_event.c: light that is looked for ------------------------------------------------------------------------------------- */

/* Where a walk scattered: in a medium, at something opaque, or at a rough boundary. */
struct pt_scatterer {
    struct pell_vec3 x, w;                 /* w: the way the walk came. x opaque: just off the surface */
    const struct pt_coefficients *medium;  /* NULL: a surface */
    struct pell_vec3 n;                    /* of a surface: unit, on the walk's side */
    const struct pt_rough *rough;          /* NULL: opaque */
    const struct pt_shading_frame *facing; /* rough */
    float off;                             /* mm: how far from a rough boundary rays start */
    float beta[3];                         /* the weights with the collision; a light's path has power here, mm^2 W/m^2 */
    int bounces;                           /* of the path up to here */
    float tint[3];                         /* of a rough boundary: of the light that passes it, to the walk's side */
};

/* Whether a path may have so many ways through the open from a surface to a surface: the knob. */
static inline bool pt_may_bounce(const struct pt_scene *s, int bounces)
{
    return s->knobs.bounces == PT_BOUNCES_ALL || bounces <= s->knobs.bounces;
}

/* Share per sr of what scatters toward the unit direction v. */
void pt_scatter_values(const struct pt_scatterer *at, struct pell_vec3 v, float out[3]);
/* A direction that it scatters to; something opaque by the cosine, rough boundaries never. beta (of a medium) becomes what it is after. */
struct pell_vec3 pt_scatter_sample(const struct pt_scatterer *at, struct pt_sampler *s, float beta[3]);

/* A walk that leaves a smooth solid from a scatterer straight to a light, and what decides between the ways of finding that light. */
struct pt_exit {
    struct pt_scatterer from;
    int solid;
    struct pt_hit hit;  /* where it leaves */
    struct pell_vec3 w; /* unit, from the scatterer to it */
    float length, transmit;
    float share; /* of the scatterers at which lights are looked for */
};

/* Weights of `now` on the whole that are below `least` go on by chance, and are `least` then. False: they don't. */
static inline bool pt_roulette(float beta[3], float now, float least, struct pt_sampler *sampler)
{
    if (!(now > 0.0f))
        return false;
    if (now >= least)
        return true;
    if (pt_random(sampler) * least >= now)
        return false;
    for (int c = 0; c < 3; c++)
        beta[c] *= least / now;
    return true;
}

/* Numbers for a question beside the walk, whose own stay as they are. */
static inline struct pt_sampler pt_own_numbers(const struct pt_sampler *walk, uint64_t salt)
{
    return (struct pt_sampler) { .state = pt_mix(walk->state ^ salt ^ (uint64_t) walk->at << 56), .at = PT_QUASI_RANDOM_NUMBERS };
}

/* Solid angle at the scatterer per area across the beam at `distance` mm beyond the boundary (INFINITY: per solid angle outside); 0 where
 * nothing gets out. */
double pt_beam(const struct pt_scene *s, const struct pt_exit *e, double distance);
/* Density by which the walk goes this way, per sr at the scatterer; the same for whoever asks. */
double pt_exit_density(const struct pt_scene *s, const struct pt_exit *e);
/* Probability by which pt_connect_lights looks for a light this way. */
double pt_exit_looked(const struct pt_scene *s, const struct pt_exit *e, const struct pell_light_sample *source);

/* A place on a light that is chosen for what is at x. False: no light. */
bool pt_sample_light(const struct pt_scene *s, struct pell_vec3 x, struct pt_sampler *sampler, struct pell_light_sample *source);

#define PT_REACH 0.6                     /* of the extinction: how far connections look */
#define PT_LOOK_SALT 0x5851f42d4c957f2du /* of the numbers by which they do */

/* Whether a scatterer looks for lights through a smooth boundary: `share` of those from which connections may reach it do, evenly along the
 * walk. *safe: mm around x without a surface, what becomes known of it; *turn: in [0, 1), whose turn it is. */
bool pt_should_connect(const struct pt_scene *s, int solid, struct pell_vec3 x, float *safe, float share, float *turn,
                       const struct pt_sampler *sampler);
/* Light of lights at a scatterer inside a solid that asks, or at a share of them: adds to sum. Through smooth boundaries by connections,
 * through rough ones near them (but for the environment); the walk's own numbers stay as they are. */
void pt_connect_lights(const struct pt_scene *s, struct pt_counts *counts, int solid, const struct pt_scatterer *at, float share,
                       const struct pt_sampler *sampler, double sum[3]);
void pt_connect_rough(const struct pt_scene *s, struct pt_counts *counts, int solid, const struct pt_scatterer *at, float share,
                      float *turn, const struct pt_sampler *sampler, double sum[3]);
/* Density by which pt_connect_rough would have gone from the walk's scatterer e->from along e->w for the light's place, and asked at
 * all. */
double pt_rough_looked(const struct pt_scene *s, struct pt_counts *counts, const struct pt_exit *e, const struct pell_light_sample *source);

/* Light of lights at a surface in the open, and what the walk does there: a rough boundary's, or Lambert's. `open`: the side of at->n that
 * is in the open, +1 or -1. `environments`: of the environment alone. */
void pt_next_event(const struct pt_scene *s, struct pt_counts *counts, const struct pt_hit *hit, const struct pt_scatterer *at, int open,
                   bool environments, struct pt_sampler *sampler, double sum[3]);

/* --- light_path.c: paths from lights -------------------------------------------------------------------------------------------- */

/* Where light of a delta light was scattered that no refractive connection finds, or a beam of it through a solid of one medium, anywhere
 * along which it may scatter: at.x is where it begins. */
struct pt_light_vertex {
    struct pt_scatterer at; /* at.w: the way the light goes; at.beta: of a beam at its beginning, without the phase function */
    float length;           /* mm, of a beam; 0: a place */
    int solid;
};

struct pt_walker {
    struct pell_context *ctx;
    struct pt_counts counts;
    struct pt_light_vertex vertex[PT_LIGHT_VERTICES];
    int vertices;
    struct pt_branches *branches; /* of walks that are one after the other */
    struct pt_wavefront *side;    /* NULL: walks are one after the other */
};

void pt_light_path(const struct pt_scene *s, struct pt_walker *w, struct pt_sampler *sampler);
/* Joins a scatterer of the walk to the light's: adds to sum. */
void pt_connect_paths(const struct pt_scene *s, struct pt_counts *counts, const struct pt_light_vertex *vertex, int count, int solid,
                      const struct pt_scatterer *at, const struct pt_sampler *sampler, double sum[3]);

/* --- specular_manifold.c: delta lights over smooth surfaces --------------------------------------------------------------------- */

/* Light of delta lights at a scatterer that comes over any number of smooth surfaces, but for what one refraction brings where connections
 * find that: adds to sum. here: where the walk is; beyond: of a rough boundary, what is on its other side, else NULL; safe: mm
 * around it without a surface. */
void pt_specular_manifold(const struct pt_scene *s, struct pt_counts *counts, const struct pt_scatterer *at,
                          const struct pt_medium_stack *here, const struct pt_medium_stack *beyond, float safe,
                          const struct pt_sampler *walk, double sum[3]);

/* --- Smooth boundaries: boundary.c, scene.c ------------------------------------------------------------------------------------------ */

/* Refracts or reflects at a smooth boundary by the random number u: true where it passes. *w becomes the new way, unit. *wrong: it had to
 * be mirrored to its side. */
bool pt_smooth(const struct pt_shading_frame *at, float eta, float u, struct pell_vec3 *w, float *fresnel, bool *wrong);
/* Unit shading normal at a place of the hit's triangle, and its changes dn where the place moves by dp in the triangle's plane. */
struct pell_dvec3 pt_normal_at(const struct pt_scene *s, const struct pt_hit *hit, struct pell_dvec3 at, const struct pell_dvec3 dp[2],
                               struct pell_dvec3 dn[2]);

#endif
