/* SPDX-License-Identifier: MIT
 *
 * services.h - what a method is lent when it is created, for as long as its pass lives. Facts of one frame come in struct pell_frame.
 *
 * On a caller's planes there are threads, a Vulkan device and nothing else: `scene` and all that follows it are NULL. A method with
 * PELL_NEED_SCENE is never created there.
 *
 * Threads    everything here may be used from many threads at once, from inside the pool's tasks, too.
 */
#ifndef PELL_SERVICES_H
#define PELL_SERVICES_H

#include "base/pool.h"
#include "render/camera_view.h"
#include "scene/material_maps.h"
#include "transport/solids.h"

#include <pellucid/method.h>
#include <pellucid/render.h>

struct pell_gpu;
struct pell_gpu_buffer;
struct pell_light_grid;
struct pell_points16;
struct pell_share;

/* Pixels from row to row of a picture's planes on a Vulkan device. */
static inline int pell_gpu_pitch(int width)
{
    return (width + 15) / 16 * 16;
}

/* Buffers of a frame there, as pellucid/vulkan.h has them; then those that some methods of a renderer read, too, 16 bytes a pixel, with no
 * meaning where the material is 0: bits of mesh, triangle and barycentric coordinates; base colour. */
enum pell_gpu_plane {
    PELL_GPU_PLANE_LIGHT,
    PELL_GPU_PLANE_SURFACE,
    PELL_GPU_PLANE_RESULT,
    PELL_GPU_PLANES_GIVEN, /* by a program with a device of its own */
    PELL_GPU_PLANE_HIT = PELL_GPU_PLANES_GIVEN,
    PELL_GPU_PLANE_BASE,
    PELL_GPU_PLANES
};

/* n points of the scene's triangles. */
struct pell_surface_points {
    const uint32_t *mesh, *triangle; /* mesh PELL_NO_HIT: no point */
    const float *u, *v;              /* barycentric: p = (1 - u - v) p0 + u p1 + v p2 */
    const uint32_t *number;          /* names the patterns in which lights with extent are sampled: points of one number share them */
    const float *ambient; /* visibility of the environment's smooth rest, where the caller knows it better; NULL: found by rays */
    const bool *back;     /* of the side from which the triangle's corners run clockwise; NULL: of none */
};

/* What light does at them: arrays of n, the caller's. All but `irradiance` may be NULL. */
struct pell_surface_light {
    float *irradiance[3];        /* W/m^2, entered, with albedo^m; of the outer side, or the back. Of a thin sheet what leaves there,
                                  * whichever side it came from */
    float *position[3];          /* mm */
    float *normal[3];            /* geometric, unit, outward by the order of the triangle's corners */
    float *albedo[3];            /* albedo^m: what the irradiance is multiplied by */
    float *transmission[3];      /* of a thin sheet: share of what meets the other side; with `gain` and params.local of a flat thin
                                  * part of a solid, too, over what a half-space returns; `gain` has what passes round parts then. 0
                                  * elsewhere */
    float *strength;             /* of scattering, [0, 1]; 1 where no point is */
    float *curvature, *thinness; /* struct pell_curvature_shape; 0 where it is not measured */
    float *gain[3];              /* what curvature scales light by; 1 where it is not measured */
    float *crossed[3];           /* with `gain`: of what goes between faces through a flat thin part, the share that a slab lets through */
    float *aside[3];     /* W/m^2, of the irradiance: what is not scattered where it enters, but beside it on a curved surface; then also */
    float *once[3];      /* what stands for the single scattering of diffuse light, */
    float *direction[3]; /* the mean refracted direction of the rest, not unit, */
    float *diffuse;      /* and how much of that has no direction, [0, 1] */
    bool *there;         /* false: no point, or one where the material is cut out by its alpha */
};

#define PELL_LIGHT_INDIRECT ((uint64_t) 1 << 63)

static inline uint64_t pell_light_bit(size_t light)
{
    return (uint64_t) 1 << (light < 62 ? light : 62);
}

/* What holds for all points of a call. */
struct pell_points_params {
    uint64_t
        lights;     /* bit pell_light_bit(i) of each light i of the scene that counts, and PELL_LIGHT_INDIRECT for light that left a surface
                      * before; 0: all. Their sums are all light */
    float mix;      /* as in struct pell_plan */
    float spacing;  /* mm between points, > 0: textures are filtered to it */
    uint32_t first; /* number of the multisample, of `samples` whose mean is taken */
    int samples;
    bool opposed; /* for methods that turn the profile between faces at an angle (optics/medium/opposed.h) */
    bool local;   /* for methods that spread light around where it enters, and add what thin parts let through by a slab's T */
    bool flat;    /* not scaled by `gain` */
};

/* Direct light at many points on the engine's device: what light_points gives, in batches. Calls are made in this order; `send` and `take`
 * by many threads at once. */
struct pell_light_batches {
    /* Points that a batch has room for; 0: there is no device, or it does not light this scene. */
    size_t (*room)(void *engine);
    /* An empty batch. Returns numbers for the caller's use, one for each 16 points of the room. */
    uint32_t *(*begin)(void *engine);
    /* Adds n points, at most 16, which take params->samples times pell_services_batch_points() of the room. Returns their number. */
    uint32_t (*send)(void *engine, const struct pell_points_params *params, const struct pell_surface_points *in, size_t n);
    /* Finds their direct light; the batch's `lights` and `mix` are those of `params`. Seconds by the device's clock; bytes that moved. */
    enum pell_result (*run)(void *engine, const struct pell_points_params *params, double *seconds, int64_t *bytes);
    /* The light of points that were sent as this number, as light_points gives it. Returns the number of rays. */
    int64_t (*take)(void *engine, const struct pell_points_params *params, const struct pell_surface_points *in, size_t n, uint32_t number,
                    const struct pell_surface_light *out);
};

/* What a method keeps beyond its pass, for the next one of a renderer: a scene that moves is a new scene each frame, with the same
 * triangles. Whoever takes `state` sets it to NULL. */
struct pell_kept {
    void *state; /* NULL: nothing */
    void (*destroy)(void *state);
};

struct pell_services {
    struct pell_context *ctx;
    struct pell_pool *pool;
    struct pell_gpu *gpu;                  /* NULL: not the engine vulkan */
    struct pell_gpu_buffer *const *planes; /* enum pell_gpu_plane: where the method reads and writes there; NULL: planes of the host */
    const struct pell_scene *scene;
    const struct pell_rays *rays;
    const uint16_t *frame_index; /* per scene material + 1: the frame's material + 1, or 0 */
    const struct pell_frame_material *materials;
    const struct pell_settings *settings;     /* of the frame that is made: where a pass outlives a change they change under it */
    const struct pell_checkpoint *checkpoint; /* NULL: none */
    struct pell_share *share;                 /* NULL: this process renders the frame alone */
    struct pell_kept *kept;                   /* NULL: nothing can be kept */
    const struct pell_observer *observer;     /* NULL: nobody asks for intermediate images */
    void *engine;                             /* passed to the functions below, which the engine fills in */
    int64_t (*light_points)(void *engine, const struct pell_points_params *params, const struct pell_surface_points *in, size_t n,
                            const struct pell_surface_light *out);
    const struct pell_light_batches *batches; /* NULL: none */
    const struct pell_light_grid *(*light_grid)(void *engine, size_t light);
    void (*transmitted)(void *engine, const struct pell_points16 *points, int count, float share[3][16]);
    void (*returned)(void *engine, const struct pell_points16 *points, int count, float share[3][16], float crossed[3][16]);
};

/* Light that enters at n points, as the stage "irradiance" finds it at pixels: the same lights, tables and formulas. Runs on the calling
 * thread and allocates nothing. Returns the number of rays traced. */
static inline int64_t pell_services_light_points(const struct pell_services *s, const struct pell_points_params *params,
                                                 const struct pell_surface_points *in, size_t n, const struct pell_surface_light *out)
{
    return s->light_points(s->engine, params, in, n, out);
}

/* Room of a batch that 16 points take for each multisample: sheets have two sides. */
static inline size_t pell_services_batch_points(const struct pell_services *s)
{
    return pell_scene_has_sheets(s->scene) ? 32 : 16;
}

/* Points that are found 16 at a time, as rays are, and their light. */
struct pell_points16 {
    uint32_t mesh[16], triangle[16];
    float u[16], v[16];
    uint32_t number[16];
};

struct pell_points16_light {
    float irradiance[3][16], position[3][16], normal[3][16], strength[16];
    bool there[16];
};

/* The surface at `count` pixels of a frame that has its hits; `number` is left. */
static inline void pell_points16_of_pixels(const struct pell_frame *in, const ptrdiff_t *at, int count, struct pell_points16 *p)
{
    for (int i = 0; i < count; i++) {
        p->mesh[i] = in->mesh[at[i]];
        p->triangle[i] = in->triangle[at[i]];
        p->u[i] = in->barycentric[0][at[i]];
        p->v[i] = in->barycentric[1][at[i]];
    }
}

/* `ambient` may be NULL. */
static inline struct pell_surface_points pell_points16_in(const struct pell_points16 *p, const float *ambient)
{
    return (struct pell_surface_points) { p->mesh, p->triangle, p->u, p->v, p->number, ambient, NULL };
}

static inline struct pell_surface_light pell_points16_out(struct pell_points16_light *light)
{
    return (struct pell_surface_light) {
        .irradiance = { light->irradiance[0], light->irradiance[1], light->irradiance[2] },
        .position = { light->position[0], light->position[1], light->position[2] },
        .normal = { light->normal[0], light->normal[1], light->normal[2] },
        .strength = light->strength,
        .there = light->there,
    };
}

/* Light of the first `count` of them. */
static inline int64_t pell_services_light16(const struct pell_services *s, const struct pell_points_params *params,
                                            const struct pell_points16 *p, const float *ambient, int count,
                                            struct pell_points16_light *light)
{
    const struct pell_surface_points in = pell_points16_in(p, ambient);
    const struct pell_surface_light out = pell_points16_out(light);

    return pell_services_light_points(s, params, &in, (size_t) count, &out);
}

/* Share of what a slab transmits that a method adds at the first `count` of the points, [0, 1], if it transmits by its plan: 0 where the
 * engine knows the light in the solid and adds it, 1 where it does not. */
static inline void pell_services_transmitted(const struct pell_services *s, const struct pell_points16 *points, int count,
                                             float share[3][16])
{
    s->transmitted(s->engine, points, count, share);
}

/* For a method that adds what goes between faces at an angle, at those of the points that are on a flat thin part: what a profile returns
 * there over what it returns of a half-space, and what gets through over what would by optics/medium/opposed.h. 1 elsewhere, and where
 * diffusion in the solid was solved. */
static inline void pell_services_returned(const struct pell_services *s, const struct pell_points16 *points, int count, float share[3][16],
                                          float crossed[3][16])
{
    s->returned(s->engine, points, count, share, crossed);
}

/* What light number `light` of the scene sees (visibility/light_grid.h), during a frame; NULL: it has none, ask the rays. */
static inline const struct pell_light_grid *pell_services_light_grid(const struct pell_services *s, size_t light)
{
    return s->light_grid(s->engine, light);
}

/* The scene's solids over the frame's materials. pell_solids_destroy when done. */
static inline PELL_NODISCARD enum pell_result pell_services_solids(const struct pell_services *s, struct pell_solids **out)
{
    return pell_solids_create(s->ctx, s->scene, s->frame_index, s->materials, out);
}

/* Whether intermediate images of this sample are asked for. */
static inline bool pell_services_observed(const struct pell_services *s, const struct pell_frame *in)
{
    return s->observer && in->first;
}

/* The 32 bits that struct pell_frame.seed has. */
static inline uint32_t pell_settings_seed(const struct pell_settings *settings)
{
    const uint64_t seed = (uint64_t) settings->seed;

    return (uint32_t) (seed ^ seed >> 32);
}

#endif
