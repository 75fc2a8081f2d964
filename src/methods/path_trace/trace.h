/* SPDX-License-Identifier: MIT
 *
 * trace.h - the transport of path-trace: radiance of single samples of single pixels, independent of images.
 *
 * Threads    a scene is constant after create; a walker belongs to one thread. A sample's result depends on the scene, the pixel's index
 *            and the sample's index only: neither on the walker, nor on the samples traced with it, nor on their order.
 */
#ifndef PELL_PATH_TRACE_TRACE_H
#define PELL_PATH_TRACE_TRACE_H

#include "render/services.h"

enum pt_normals { PT_NORMALS_SMOOTH, PT_NORMALS_FLAT };
enum pt_boundary { PT_BOUNDARY_SETTINGS, PT_BOUNDARY_SMOOTH, PT_BOUNDARY_ROUGH }; /* settings: by struct pell_settings */
/* None: one path at a time; lanes: SIMD paths with the same bits; grid: these with a grid of distances. */
enum pt_acceleration { PT_ACCELERATION_NONE, PT_ACCELERATION_LANES, PT_ACCELERATION_GRID };

/* Techniques that find light; tests disable them one by one. */
enum pt_technique {
    PT_HIT_LIGHTS = 1 << 0,        /* a path hits a light with extent, or the environment */
    PT_LIGHT_SAMPLES = 1 << 1,     /* light samples at surfaces: rough boundaries, opaque objects */
    PT_CONNECT = 1 << 2,           /* light samples inside media, through smooth boundaries */
    PT_LIGHT_PATHS = 1 << 3,       /* light paths are connected to camera paths inside media */
    PT_SPECULAR_MANIFOLD = 1 << 4, /* specular manifold sampling from scatterers to delta lights */
    PT_SPLIT = 1 << 5,             /* where a flight may leave a smooth solid, both the leaving and the staying part are traced */
    PT_ALL = 63,
};

#define PT_BOUNCES_ALL (-1)

/* Knobs of the transport; validated when a scene is created. */
struct pt_knobs {
    int normals;         /* enum pt_normals: of boundaries */
    int boundary;        /* enum pt_boundary */
    int acceleration;    /* enum pt_acceleration */
    int events;          /* scattering events and surfaces per path, >= 1 */
    int bounces;         /* segments outside of solids that end at a surface, maximum; PT_BOUNCES_ALL: unlimited */
    float roulette;      /* throughput below which Russian roulette starts, (0, 1] */
    unsigned techniques; /* enum pt_technique; PT_ALL */
    int half;            /* enum reference_half: independent random numbers */
};

struct pt_scene;
struct pt_walker;

/* PELL_ERR_UNSUPPORTED, with a message that names the material, for materials with only a profile and no equivalent medium. Warns once per
 * solid with an open surface. The services must outlive the scene. */
PELL_NODISCARD enum pell_result pt_scene_create(const struct pell_services *services, const struct pt_knobs *knobs, struct pt_scene **out);
void pt_scene_destroy(struct pt_scene **scene);

/* pell_seconds() after which slow samples are abandoned; initially INFINITY: never. Call only while no path is traced. */
void pt_scene_set_deadline(struct pt_scene *scene, double seconds);
/* Cancelled or interrupted: paths end at once, and their samples must be dropped. */
bool pt_stopped(const struct pt_scene *scene);

/* Cost of the paths, and what was left out. Sums. */
struct pt_counts {
    int64_t samples, scatterings, rays;
    int64_t steps_without_ray;  /* flights within the bound of the distance grid */
    int64_t connections;        /* queries through smooth boundaries */
    int64_t chains, chains_cut; /* found; and those of them given up because they could not be found again */
    int64_t late;               /* chains abandoned at the deadline: their samples are invalid */
    int64_t cut;                /* paths terminated by the knob events */
    double cut_weight;          /* their remaining throughput relative to a path's: (R + G + B)/3, sum. Times the brightest radiance of a
                                 * light, over the samples, it is a bound of the bias without delta lights */
    int64_t crossed; /* hits of closed surfaces out of order: entered while inside the solid, or left while outside (surfaces intersect or
                      * touch) */
    int64_t lost;    /* paths that left a solid through no surface (open or intersecting surfaces, rounding), or found none at the pixel */
};

PELL_NODISCARD enum pell_result pt_walker_create(const struct pt_scene *scene, struct pt_walker **out);
void pt_walker_destroy(struct pt_walker **walker);
const struct pt_counts *pt_walker_counts(const struct pt_walker *walker);

/* Origin of a pixel's paths. */
struct pt_point {
    struct pell_vec3 at;     /* mm, the visible surface point (struct pell_frame.position) */
    struct pell_vec3 toward; /* unit, to the camera */
    float depth;             /* mm, distance to the camera along the ray: no occluder within it, > 0 */
    uint16_t material;       /* frame's material + 1, as in struct pell_frame */
    uint32_t pixel;          /* unique index, independent of the frame's stride: seeds the random numbers */
};

/* Radiance, W/(m^2 sr), toward the camera, split by type of path (the sum is the image):
 *     single    left the inside at the pixel's surface, scattered exactly once
 *     multiple  the same, scattered more than once; also unscattered transmission, and reflection by opaque surfaces inside or behind
 *     surface   reflected by the pixel's surface: lights, and mirror images of other surfaces */
struct pt_light {
    double multiple[3], single[3], surface[3];
};

/* A sample of a pixel. */
struct pt_job {
    const struct pt_point *point; /* use the same pointer for the same point */
    uint32_t sample;
    struct pt_light light; /* result */
};

void pt_trace_jobs(const struct pt_scene *scene, struct pt_walker *walker, struct pt_job *jobs, int count);
/* Samples `first` to `first + count - 1` of a pixel. */
void pt_trace(const struct pt_scene *scene, struct pt_walker *walker, const struct pt_point *point, uint32_t first, int count,
              struct pt_light *out);

/* The largest radiance of a light with extent, or of the environment in some hundred directions; 0: none. */
double pt_scene_brightest(const struct pt_scene *scene);
/* 2^result is the order of magnitude of the visible radiance. */
int pt_scene_exponent(const struct pt_scene *scene);

#endif
