/* SPDX-License-Identifier: MIT
 *
 * trace.h - the transport of path-trace: the radiance of single samples of single pixels, and nothing of pictures.
 *
 * Threads    a scene is constant after create; a walker belongs to one thread. What a sample gives depends on the scene, the pixel's number
 *            and the sample's number alone: neither on the walker, nor on the samples traced with it, nor on their order.
 */
#ifndef PELL_PATH_TRACE_TRACE_H
#define PELL_PATH_TRACE_TRACE_H

#include "render/services.h"

enum pt_normals { PT_NORMALS_SMOOTH, PT_NORMALS_FLAT };
enum pt_boundary { PT_BOUNDARY_SETTINGS, PT_BOUNDARY_SMOOTH, PT_BOUNDARY_ROUGH }; /* settings: as struct pell_settings has it */
/* The plain walk; many side by side, the same bits; these with a grid of distances. */
enum pt_acceleration { PT_ACCELERATION_NONE, PT_ACCELERATION_LANES, PT_ACCELERATION_GRID };

/* Ways by which light is found; tests switch them off one by one. */
enum pt_technique {
    PT_CHANCE = 1 << 0,  /* the walk meets a light with extent, or the environment */
    PT_LIGHTS = 1 << 1,  /* lights are sampled at surfaces: rough boundaries, opaque objects */
    PT_CONNECT = 1 << 2, /* lights are sampled inside media, through smooth boundaries */
    PT_LIGHT = 1 << 3,   /* paths from the lights are joined to the walk inside media */
    PT_CHAIN = 1 << 4,   /* chains of smooth surfaces are solved for, from scatterers to delta lights */
    PT_SPLIT = 1 << 5,   /* where a flight may leave a smooth solid, both what leaves and what stays is followed */
    PT_ALL = 63,
};

#define PT_BOUNCES_ALL (-1)

/* Knobs of the transport; all of it is in range when a scene is made. */
struct pt_knobs {
    int normals;         /* enum pt_normals: of boundaries */
    int boundary;        /* enum pt_boundary */
    int acceleration;    /* enum pt_acceleration */
    int events;          /* scatterings and surfaces of a path at most, >= 1 */
    int bounces;         /* how often light leaves a surface through the open and meets one again, at most; PT_BOUNCES_ALL: any number */
    float roulette;      /* a walk whose weight falls below this goes on by chance, (0, 1] */
    unsigned techniques; /* enum pt_technique; PT_ALL */
    int half;            /* enum reference_half: random numbers of its own */
};

struct pt_scene;
struct pt_walker;

/* PELL_ERR_UNSUPPORTED, with a message that names the material, for those of which only a profile is known. Warns once of each solid whose
 * surface is open. The services must outlive the scene. */
PELL_NODISCARD enum pell_result pt_scene_create(const struct pell_services *services, const struct pt_knobs *knobs, struct pt_scene **out);
void pt_scene_destroy(struct pt_scene **scene);

/* pell_seconds() after which what may take long is given up; INFINITY, as it is at first: never. While no walk runs. */
void pt_scene_set_deadline(struct pt_scene *scene, double seconds);
/* Cancelled or interrupted: walks end where they are, and their samples must be dropped. */
bool pt_stopped(const struct pt_scene *scene);

/* What walks cost, and what they left undone. Sums. */
struct pt_counts {
    int64_t samples, scatterings, rays;
    int64_t steps_without_ray;  /* flights that stayed inside the bound of the distance grid */
    int64_t connections;        /* asked for, through smooth boundaries */
    int64_t chains, chains_cut; /* found; of these given up, too hard to find again */
    int64_t late;               /* chains given up at the deadline: their samples are no good */
    int64_t cut;                /* paths ended by the knob events */
    double cut_weight;          /* that these still carried, as a share of a path's: (R + G + B)/3, sum. Times the brightest radiance that a
                                * light shows, over the samples, it limits what the bound cost where no delta light is */
    int64_t crossed; /* closed surfaces met out of order: entered while inside the solid, or left while outside (they cross or touch) */
    int64_t lost;    /* walks that left a solid through no surface (open or crossing ones, rounding), or found none at the pixel */
};

PELL_NODISCARD enum pell_result pt_walker_create(const struct pt_scene *scene, struct pt_walker **out);
void pt_walker_destroy(struct pt_walker **walker);
const struct pt_counts *pt_walker_counts(const struct pt_walker *walker);

/* Where a pixel's paths begin. */
struct pt_point {
    struct pell_vec3 at;     /* mm, on the surface that the pixel sees (struct pell_frame.position) */
    struct pell_vec3 toward; /* unit, to the camera */
    float depth;             /* mm, from the camera along the ray: how far back from `at` nothing may be in the way, > 0 */
    uint16_t material;       /* frame's material + 1, as in struct pell_frame */
    uint32_t pixel;          /* number of the pixel, its own, whatever the frame's stride: names its random numbers */
};

/* Radiance, W/(m^2 sr), toward the camera, by what light did on its way (the sum is the picture):
 *     single    left from inside at the pixel's surface, scattered exactly once
 *     multiple  the same, scattered more than once; also what passed unscattered, or was reflected by something opaque inside or behind
 *     surface   reflected by the pixel's surface: lights, and the mirror image of other surfaces */
struct pt_light {
    double multiple[3], single[3], surface[3];
};

/* A sample of a pixel. */
struct pt_job {
    const struct pt_point *point; /* the same pointer for the same point */
    uint32_t sample;
    struct pt_light light; /* what comes of it */
};

void pt_trace_jobs(const struct pt_scene *scene, struct pt_walker *walker, struct pt_job *jobs, int count);
/* Samples `first` to `first + count - 1` of a pixel. */
void pt_trace(const struct pt_scene *scene, struct pt_walker *walker, const struct pt_point *point, uint32_t first, int count,
              struct pt_light *out);

/* The brightest radiance that a light with extent shows, or the environment at some hundred places; 0: there is none. */
double pt_scene_brightest(const struct pt_scene *scene);
/* 2^this is of the order of the radiance that is seen. */
int pt_scene_exponent(const struct pt_scene *scene);

#endif
