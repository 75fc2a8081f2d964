/* SPDX-License-Identifier: MIT
 *
 * path.h - declarations shared by the files of the transport.
 *
 * Radiance is carried as L/n^2, n the index of refraction relative to the outside: it is invariant under refraction, so that a boundary is
 * a probability distribution over directions, and a path in a scene without absorption keeps its throughput.
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

#define PT_STACK_DEPTH 8 /* depth of the medium stack: nested solids that a path tracks */
#define PT_LOBES 16      /* lobes around the nearest connections of a point with a light sample */
#define PT_ROUGH_CELLS 64
#define PT_LIGHT_VERTICES 8 /* stored vertices of a light path */

/* --- boundary.c ----------------------------------------------------------------------------------------------------------------- */

/* A rough boundary between two indices of refraction, for either side: [0] from outside, [1] from inside. */
struct pt_rough {
    float alpha, eta;                         /* eta: inside / outside */
    float albedo[2][PT_ROUGH_CELLS + 1];      /* over mu = i / cells: albedo of single bounces, reflection and transmission together */
    float lobe[2][PT_ROUGH_CELLS];            /* density over mu^2 of the compensation lobe on a side; its integral is 1 */
    float lobe_cumulative[2][PT_ROUGH_CELLS]; /* its integral up to the end of the cell */
    float lobe_transmission[2];               /* fraction of the compensation lobe that is transmitted */
};

/* Fresnel reflectance; cos_i on the incident side, eta = n_transmitted / n_incident. *cos_t: cosine of the refracted direction. */
float pt_fresnel(float eta, float cos_i, float *cos_t);

void pt_rough_make(float alpha, float eta, struct pt_rough *out);

/* Local geometry at a surface: outgoing direction `o`, shading and geometric normal, both on o's side. */
struct pt_shading_frame {
    struct pell_vec3 o, ns, ng;
    int side; /* 0: o is outside */
};

/* Samples a direction with the density of pt_rough_density; the weight is 1. *transmitted: whether it was refracted. */
struct pell_vec3 pt_rough_sample(const struct pt_rough *rough, const struct pt_shading_frame *at, struct pt_sampler *s, bool *transmitted);
/* Density per sr; the side of w relative to ng decides between reflection and transmission. */
float pt_rough_density(const struct pt_rough *rough, const struct pt_shading_frame *at, struct pell_vec3 w);

/* Mirrors w about the plane of ng if it is on the wrong side, where shading normals can send it. `above`: it belongs on ng's side. */
static inline struct pell_vec3 pt_to_side(struct pell_vec3 w, struct pell_vec3 ng, bool above)
{
    const float c = vec3_dot(w, ng);
    return (c > 0.0f) == above ? w : vec3_mad(w, -2.0f * c, ng);
}

/* --- medium.c ------------------------------------------------------------------------------------------------------------------- */

struct pt_coefficients {
    float sigma_t[3], sigma_s[3];
    float mean_free_path[3]; /* INFINITY: no extinction */
    struct pell_phase phase[3];
    float g[3];
    bool hg;        /* Henyey-Greenstein in all channels */
    bool alike;     /* the same phase function in all channels */
    bool isotropic; /* which is isotropic */
    bool gray;      /* the channels have the same coefficients */
    bool clear;     /* neither scatters nor absorbs */
};

/* Depth maps of layers. */
struct pt_layer_maps {
    struct pell_medium_layers medium_layers;
    const struct pell_mesh *meshes; /* the scene's */
};

/* The medium of a solid: homogeneous, or layers by the distance below the surface. */
struct pt_medium {
    float eta;
    bool homogeneous;              /* one layer without a bottom */
    bool ends;                     /* light below the layers is absorbed */
    bool floor;                    /* except for the reflection of a Lambertian substrate with the base colour */
    int layers;                    /* >= 1 */
    struct pt_coefficients *layer; /* owned, like all that follows */
    float *depth;                  /* mm: bottom of each layer, without maps; the last one may be INFINITY */
    struct pt_layer_maps *maps;    /* NULL: depths are uniform */
    float deepest;                 /* mm: below it the medium is homogeneous */
    float max_sigma_t[3];          /* largest sigma_t over the layers */
    float min_sigma_t;             /* smallest sigma_t over channels and layers */
};

/* PELL_ERR_UNSUPPORTED, logged, for profiles without an equivalent medium. Call pt_medium_finish on `out` even after a failure. */
PELL_NODISCARD enum pell_result pt_medium_make(struct pell_context *ctx, const struct pell_scene *scene, const struct pell_material *m,
                                               struct pt_medium *out);
void pt_medium_finish(struct pell_context *ctx, struct pt_medium *medium);

/* Phase function per sr, for each channel, from the direction w to v (both in the direction of the path). */
void pt_phase_values(const struct pt_coefficients *c, struct pell_vec3 w, struct pell_vec3 v, float out[3]);
/* Samples the phase function; updates beta; returns the density of the new direction by the channel weights. */
float pt_phase_sample(const struct pt_coefficients *c, struct pell_vec3 w, struct pt_sampler *s, float beta[3], struct pell_vec3 *out);

/* --- scene.c -------------------------------------------------------------------------------------------------------------------- */

struct pt_solid {
    struct pt_medium medium;
    bool smooth, rough; /* its whole boundary is smooth, or rough */
    bool closed;
    bool grid;               /* the distance grid is valid */
    bool connects;           /* next-event estimation by connections through its boundary, which is smooth everywhere */
    bool connects_rough;     /* the same through a boundary that is rough everywhere: pt_connect_rough */
    bool lanes;              /* its paths may run in SIMD lanes */
    float split_mm;          /* mm beyond the distance bound within which flights are split at its boundary; 0: no splitting */
    float connect_mm;        /* mm; the maximum distance of connections is -connect_mm log u */
    float fraction;          /* fraction of the scattering events after the first with next-event estimation */
    struct pell_vec3 lo, hi; /* bounds */
};

/* Range of roughness of a material's boundary, quantised in uniform steps where a map varies it. */
struct pt_roughness_range {
    float low, high; /* roughness; at low values the boundary is smooth. Both 0: smooth everywhere */
    int steps;       /* 1: no map, or a constant one */
};

struct pt_scene {
    struct pell_context *ctx;
    const struct pell_services *services;
    const struct pell_scene *scene;
    const struct pell_rays *rays;
    struct pt_knobs knobs;
    struct pell_solids *solids;
    struct pt_solid *solid; /* array of the solids */
    struct pt_rough *rough; /* distinct (material, index ratio) pairs */
    size_t num_rough;
    struct pt_roughness_range *roughness_ranges; /* by material of the scene */
    struct pell_tint *tint;                      /* by material of the scene */
    struct pell_light_sampler *light_sampler;
    struct pell_connector *connector; /* NULL: not needed */
    struct pell_distance *distance;   /* NULL: no grid */
    struct pell_vec3 centre;          /* of a sphere around all solids */
    double radius;
    double typical;  /* order of magnitude of visible radiance */
    double deadline; /* in pell_seconds() */
    double brightest;
    bool light_paths, chains;    /* for delta lights */
    int light_rays;              /* per sample: more if reflected light hits other surfaces */
    double environment_fraction; /* probability of next-event estimation for it: random directions sample a uniform one well enough */
    uint32_t seed;
    float epsilon; /* mm: several rounding errors of the largest coordinate of a solid */
};

/* Intersection of a ray with a triangle. */
struct pt_hit {
    uint32_t mesh, triangle;
    float u, v, t;
    struct pell_vec3 p, ng, ns; /* outward, unit; ns equals ng with the knob normals=flat */
    bool interpolated;          /* ns varies over the triangle */
    float epsilon;              /* mm: offset of ray origins along ng, several rounding errors */
    int solid;                  /* -1: opaque */
    int material;               /* of the scene */
};

/* maps.c. A map's value at the hit; 1 if the map or its coordinates are missing. */
void pt_texel_at(const struct pt_scene *s, const struct pt_hit *hit, const struct pell_texture_map *map, float texel[4]);
void pt_set_tints(struct pt_scene *s);
/* Applies the tint of light that enters a solid, or leaves it. */
void pt_tint(const struct pt_scene *s, const struct pt_hit *hit, bool enters, float beta[3]);
/* GGX alpha of the boundary; 0: smooth. */
float pt_alpha(const struct pt_scene *s, const struct pt_hit *hit);
/* NULL: smooth, or matched indices. */
const struct pt_rough *pt_rough_find(const struct pt_scene *s, const struct pt_hit *hit, float eta);
/* A point of a triangle; w replaces a missing normal. Sets everything except t. */
void pt_hit_at(const struct pt_scene *s, uint32_t mesh, uint32_t triangle, float u, float v, struct pell_vec3 w, struct pt_hit *out);
/* Finds the closest hit; `reach` in mm. */
bool pt_intersect(const struct pt_scene *s, struct pt_counts *counts, struct pell_vec3 x, struct pell_vec3 w, float reach, uint32_t mask,
                  struct pt_hit *out);
/* Visibility test against `mask`. */
bool pt_unoccluded(const struct pt_scene *s, struct pt_counts *counts, struct pell_vec3 x, struct pell_vec3 w, float reach, uint32_t mask);
/* Origin of a ray from a surface toward a side. */
static inline struct pell_vec3 pt_offset_origin(const struct pt_hit *hit, struct pell_vec3 w)
{
    return vec3_mad(hit->p, vec3_dot(w, hit->ng) >= 0.0f ? hit->epsilon : -hit->epsilon, hit->ng);
}
/* Diffuse scattering at an opaque surface of light along w: the normal of the side where it leaves, for thin sheets chosen at random, and
 * the albedo over the probability of that choice. */
struct pell_vec3 pt_scatter_opaque(const struct pt_scene *s, const struct pt_hit *hit, struct pell_vec3 w, struct pt_sampler *sampler,
                                   float weight[3]);

/* Stack of the solids that the path has entered, the last on top. */
struct pt_medium_stack {
    int count;
    int16_t solid[PT_STACK_DEPTH];
};

static inline int pt_top(const struct pt_medium_stack *p)
{
    return p->count > 0 ? p->solid[p->count - 1] : -1;
}

static inline float pt_index(const struct pt_scene *s, int solid)
{
    return solid >= 0 ? s->solid[solid].medium.eta : 1.0f;
}

/* The media on both sides of a solid's surface for a path in `stack`; `enter`: against the outward normal. False: it is already inside, and
 * the surface is ignored. A path that leaves a solid without having entered it is assumed to have been inside. */
bool pt_cross(const struct pt_scene *s, const struct pt_medium_stack *stack, int solid, bool enter, struct pt_medium_stack *before,
              struct pt_medium_stack *after);

/* --- distance_sampling.c -------------------------------------------------------------------------------------------------------- */

/* A ray from x along w. Intersections start at `from`: x, or just off the surface that x is on. */
struct pt_ray {
    struct pell_vec3 x, from, w;
};

/* One free flight through a solid. */
struct pt_free_path {
    struct pell_vec3 x; /* its end point */
    bool has_hit;       /* it ends at a surface: `hit` */
    bool floor;         /* it ends at the substrate below the layers: reflects `albedo`, x is offset to the side of n */
    bool lost;          /* it left the solid through no surface */
    float length;
    const struct pt_coefficients *medium; /* medium of the collision */
    struct pt_hit hit;
    struct pell_vec3 n;
    float albedo[3];
};

/* A sampled flight through a homogeneous medium before its weights are applied. */
struct pt_flight {
    float lookahead; /* mm beyond the distance bound to which a surface is searched in any case, if a ray is needed at all */
    float length;    /* to the collision, unless a surface comes first */
    float bound;     /* of a flight that needed a ray: mm known to be free of surfaces */
    int channel;     /* whose distribution was sampled */
    bool has_hit;    /* a surface comes first: `hit` */
    bool found;      /* hit is valid, even if it is beyond the length */
    struct pt_hit hit;
    float inverse_stay[3]; /* per channel: reciprocal of the probability to stay inside; 1 without splitting */
};

/* Samples a flight by the channel throughputs beta. The caller sets `lookahead`. */
void pt_sample_flight(const struct pt_scene *s, struct pt_counts *counts, int solid, const struct pt_ray *ray, const float beta[3],
                      float *safe, struct pt_sampler *sampler, struct pt_flight *out);
/* Computes its end point; updates beta. */
void pt_end_flight(const struct pt_scene *s, int solid, const struct pt_ray *ray, const struct pt_flight *flight, float beta[3],
                   struct pt_free_path *out);
/* Samples a flight by the channel throughputs beta and updates them, including sigma_s of a collision. *safe: radius around x known to be
 * free of surfaces; becomes the remaining radius. */
void pt_sample_distance(const struct pt_scene *s, struct pt_counts *counts, int solid, const struct pt_ray *ray, float beta[3], float *safe,
                        struct pt_sampler *sampler, struct pt_free_path *out);
bool pt_outside(const struct pt_solid *b, struct pell_vec3 x, float margin);
/* Distance at which a ray leaves the bounds; x is inside. */
float pt_exit_distance(const struct pt_solid *b, struct pell_vec3 x, struct pell_vec3 w);
/* Updates the weights for `length` without a collision; relative to the probability of no collision. */
void pt_attenuate(const struct pt_coefficients *m, float length, float beta[3]);
/* Transmittance of a solid (-1: outside) along `reach` mm from x without surfaces; for layers an unbiased estimate. */
void pt_transmittance(const struct pt_scene *s, int solid, struct pell_vec3 x, struct pell_vec3 w, float reach, struct pt_sampler *sampler,
                      float out[3]);

/* --- next_event.c: next-event estimation ---------------------------------------------------------------------------------------- */

/* A scattering event: in a medium, at an opaque surface, or at a rough boundary. */
struct pt_scatterer {
    struct pell_vec3 x, w;                 /* w: incident direction. x at an opaque surface: offset from it */
    const struct pt_coefficients *medium;  /* NULL: a surface */
    struct pell_vec3 n;                    /* at a surface: unit, on the incident side */
    const struct pt_rough *rough;          /* NULL: opaque */
    const struct pt_shading_frame *facing; /* rough */
    float off;                             /* mm: offset of ray origins from a rough boundary */
    float beta[3];                         /* throughput including the collision; on light paths power, mm^2 W/m^2 */
    int bounces;                           /* of the path up to here */
    float tint[3];                         /* rough boundary: tint of the light that it transmits to the incident side */
};

/* Whether a path may have this many segments outside between surfaces: the knob bounces. */
static inline bool pt_bounce_allowed(const struct pt_scene *s, int bounces)
{
    return s->knobs.bounces == PT_BOUNCES_ALL || bounces <= s->knobs.bounces;
}

/* BSDF or phase function per sr toward the unit direction v. */
void pt_scatter_values(const struct pt_scatterer *at, struct pell_vec3 v, float out[3]);
/* Samples a scattered direction; cosine-weighted at opaque surfaces, not used for rough boundaries. Updates beta (in a medium). */
struct pell_vec3 pt_scatter_sample(const struct pt_scatterer *at, struct pt_sampler *s, float beta[3]);

/* A path that leaves a smooth solid from a scatterer straight to a light, with the data for MIS between the techniques. */
struct pt_exit {
    struct pt_scatterer from;
    int solid;
    struct pt_hit hit;  /* exit point */
    struct pell_vec3 w; /* unit, from the scatterer to it */
    float length, transmit;
    float fraction; /* fraction of the scatterers with next-event estimation */
};

/* Russian roulette: a weight of `now` below `least` survives with the probability now/least and becomes `least`. False: terminated. */
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

/* An independent sampler for a decision off the path, which leaves the path's own random numbers unchanged. */
static inline struct pt_sampler pt_independent_sampler(const struct pt_sampler *walk, uint64_t salt)
{
    return (struct pt_sampler) { .state = pt_mix(walk->state ^ salt ^ (uint64_t) walk->at << 56), .at = PT_QUASI_RANDOM_NUMBERS };
}

/* Solid angle at the scatterer per area perpendicular to the beam at `distance` mm beyond the boundary (INFINITY: per solid angle outside);
 * 0 under total internal reflection. */
double pt_beam(const struct pt_scene *s, const struct pt_exit *e, double distance);
/* Density of the path's own sampling of this direction, per sr at the scatterer; the same for all callers. */
double pt_exit_density(const struct pt_scene *s, const struct pt_exit *e);
/* Probability that pt_connect_lights samples a light in this direction. */
double pt_exit_nee_probability(const struct pt_scene *s, const struct pt_exit *e, const struct pell_light_sample *source);

/* Samples a point on a light for a receiver at x. False: no light. */
bool pt_sample_light(const struct pt_scene *s, struct pell_vec3 x, struct pt_sampler *sampler, struct pell_light_sample *source);

#define PT_RANGE_RATE 0.6               /* the range of connections is exponential, with this rate per optical depth */
#define PT_NEE_SALT 0x5851f42d4c957f2du /* of the random numbers for that range */

/* Whether a scatterer does next-event estimation through a smooth boundary: `fraction` of those within range of it, evenly along the
 * path. *safe: mm around x without a surface, updated; *selection: in [0, 1), accumulates the fractions. */
bool pt_should_connect(const struct pt_scene *s, int solid, struct pell_vec3 x, float *safe, float fraction, float *selection,
                       const struct pt_sampler *sampler);
/* Next-event estimation at a scatterer inside a solid: adds to sum. Through smooth boundaries by refractive connections; through rough ones
 * near them, for a fraction of the scatterers (without the environment). The path's own random numbers are unchanged. */
void pt_connect_lights(const struct pt_scene *s, struct pt_counts *counts, int solid, const struct pt_scatterer *at, float fraction,
                       const struct pt_sampler *sampler, double sum[3]);
void pt_connect_rough(const struct pt_scene *s, struct pt_counts *counts, int solid, const struct pt_scatterer *at, float fraction,
                      float *selection, const struct pt_sampler *sampler, double sum[3]);
/* Density with which pt_connect_rough would have sampled the direction e->w from the scatterer e->from toward the light sample, including
 * the probability to connect at all. */
double pt_rough_nee_density(const struct pt_scene *s, struct pt_counts *counts, const struct pt_exit *e,
                            const struct pell_light_sample *source);

/* Next-event estimation at a surface outside of solids, at a rough boundary or a Lambertian surface. `outer_side`: the side of at->n
 * that is outside, +1 or -1. `environments`: the environment only. */
void pt_next_event(const struct pt_scene *s, struct pt_counts *counts, const struct pt_hit *hit, const struct pt_scatterer *at,
                   int outer_side, bool environments, struct pt_sampler *sampler, double sum[3]);

/* --- light_path.c: paths from lights -------------------------------------------------------------------------------------------- */

/* A vertex of a light path that no refractive connection finds: a scattering event, or a beam through a homogeneous solid along which light
 * may scatter anywhere; at.x is its origin. */
struct pt_light_vertex {
    struct pt_scatterer at; /* at.w: direction of the light; at.beta: power at the origin of a beam, without the phase function */
    float length;           /* mm, of a beam; 0: a point */
    int solid;
};

struct pt_walker {
    struct pell_context *ctx;
    struct pt_counts counts;
    struct pt_light_vertex vertex[PT_LIGHT_VERTICES];
    int vertices;
    struct pt_branches *branches;   /* of paths traced one after the other */
    struct pt_wavefront *wavefront; /* NULL: paths are traced one after the other */
};

void pt_light_path(const struct pt_scene *s, struct pt_walker *w, struct pt_sampler *sampler);
/* Connects a scatterer of the camera path to the light path: adds to sum. */
void pt_connect_paths(const struct pt_scene *s, struct pt_counts *counts, const struct pt_light_vertex *vertex, int count, int solid,
                      const struct pt_scatterer *at, const struct pt_sampler *sampler, double sum[3]);

/* --- specular_manifold.c: delta lights through specular chains ------------------------------------------------------------------ */

/* Light of delta lights at a scatterer through any number of smooth surfaces, except for single refractions where connections find those:
 * adds to sum. here: medium stack at the scatterer; beyond: on the other side of a rough boundary, else NULL; safe: mm around it without a
 * surface. */
void pt_specular_manifold(const struct pt_scene *s, struct pt_counts *counts, const struct pt_scatterer *at,
                          const struct pt_medium_stack *here, const struct pt_medium_stack *beyond, float safe,
                          const struct pt_sampler *walk, double sum[3]);

/* --- Smooth boundaries: boundary.c, scene.c ------------------------------------------------------------------------------------------ */

/* Refracts or reflects at a smooth boundary by the random number u: true if transmitted. *w becomes the new unit direction. *wrong: it had
 * to be mirrored to its side. */
bool pt_smooth(const struct pt_shading_frame *at, float eta, float u, struct pell_vec3 *w, float *fresnel, bool *wrong);
/* Unit shading normal at the hit, and its differentials dn for displacements dp in the triangle's plane. */
struct pell_dvec3 pt_normal_at(const struct pt_scene *s, const struct pt_hit *hit, struct pell_dvec3 at, const struct pell_dvec3 dp[2],
                               struct pell_dvec3 dn[2]);

#endif
