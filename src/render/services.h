/* SPDX-License-Identifier: MIT
 *
 * services.h - services that a method gets when it is created, valid as long as its pass lives. Data of one frame comes in struct
 * pell_frame.
 *
 * With a caller's planes there are only threads and a Vulkan device: `scene` and all members after it are NULL. A method with
 * PELL_NEED_SCENE is never created in that case.
 *
 * Threads    everything here may be used from many threads at once, including from the pool's tasks.
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
struct pell_communicator;

/* Row pitch, in pixels, of an image's planes on a Vulkan device. */
static inline int pell_gpu_pitch(int width)
{
    return (width + 15) / 16 * 16;
}

/* Buffers of a frame there, as in pellucid/vulkan.h; then those that some methods of a renderer also read, 16 bytes per pixel, undefined
 * where the material is 0: bits of mesh, triangle and barycentric coordinates; base colour. */
enum pell_gpu_plane {
    PELL_GPU_PLANE_LIGHT,
    PELL_GPU_PLANE_SURFACE,
    PELL_GPU_PLANE_RESULT,
    PELL_GPU_PLANES_GIVEN, /* provided by a program with its own device */
    PELL_GPU_PLANE_HIT = PELL_GPU_PLANES_GIVEN,
    PELL_GPU_PLANE_BASE,
    PELL_GPU_PLANES
};

/* n points of the scene's triangles. */
struct pell_surface_points {
    const uint32_t *mesh, *triangle; /* mesh PELL_NO_HIT: no point */
    const float *u, *v;              /* barycentric: p = (1 - u - v) p0 + u p1 + v p2 */
    const uint32_t *seed;            /* seeds of the sample patterns of area lights: points with equal seeds share them */
    const float *ambient;            /* visibility of the environment's smooth part, if the caller has computed it; NULL: found by rays */
    const bool *back;                /* true: the side from which the triangle's corners run clockwise; NULL: no point is on that side */
};

/* Light at these points: arrays of n, owned by the caller. All but `irradiance` may be NULL. */
struct pell_surface_light {
    float *irradiance[3];        /* W/m^2, light that enters, times albedo^m; for the outer side, or the back. For a thin sheet the light
                                  * that leaves there, whichever side it came from */
    float *position[3];          /* mm */
    float *normal[3];            /* geometric, unit, outward by the order of the triangle's corners */
    float *albedo[3];            /* albedo^m: factor of the irradiance */
    float *transmission[3];      /* for a thin sheet: fraction of the light on the other side that is transmitted. With `gain` and
                                  * params.local also for a flat thin part of a solid, over what a half-space returns; `gain` then
                                  * includes light that passes around round parts. 0 elsewhere */
    float *strength;             /* scattering strength, [0, 1]; 1 where there is no point */
    float *curvature, *thinness; /* struct pell_curvature_shape; 0 where it is not measured */
    float *gain[3];              /* factor by curvature; 1 where it is not measured */
    float *crossed[3];           /* with `gain`: ratio of a slab's transmission to the transport between faces, in a flat thin part */
    float *uniform[3];           /* with `gain`: struct pell_curvature_effects' `uniform`, and */
    float *small[3];             /* `small` where a part is round; 0 where it is flat, or its shape is not measured */
    float *shifted[3];           /* W/m^2: part of the irradiance that a curved surface moves away from where it enters, */
    float *single_surplus[3];    /* part that accounts for the single scattering of diffuse light, which does not go into the depth, */
    float *direction[3];         /* the mean refracted direction of the rest, not unit, */
    float *diffuse;              /* and the diffuse fraction of the rest, [0, 1] */
    bool *valid;                 /* false: no point, or its material is cut out there by alpha */
};

#define PELL_LIGHT_INDIRECT ((uint64_t) 1 << 63)

static inline uint64_t pell_light_bit(size_t light)
{
    return (uint64_t) 1 << (light < 62 ? light : 62);
}

/* Parameters of all points of a call. */
struct pell_points_params {
    uint64_t lights; /* bit pell_light_bit(i) for each requested light i of the scene, and PELL_LIGHT_INDIRECT for indirect light; 0: all.
                     * The results of disjoint sets add up */
    float mix;       /* as in struct pell_plan */
    float spacing;   /* distance between points, mm, > 0: textures are filtered to it */
    uint32_t first;  /* index of the first of `samples` multisamples, whose mean is returned */
    int samples;
    bool opposed; /* for methods that correct the profile between faces at an angle (optics/medium/opposed.h) */
    bool local;   /* for methods that spread light around its entry, and add transmission through thin parts by a slab's T */
    bool flat;    /* without the factor `gain` */
};

/* Direct light at many points on the engine's device, in batches, with the results of light_points. Calls are made in this order; `send`
 * and `take` may be called by many threads at once. */
struct pell_light_batches {
    /* Capacity of a batch, in points; 0: there is no device, or it cannot light this scene. */
    size_t (*room)(void *engine);
    /* Begins an empty batch. Returns an array for the caller's use, with one value per 16 points of the capacity. */
    uint32_t *(*begin)(void *engine);
    /* Adds at most 16 points, which use params->samples times pell_services_batch_points() of the capacity. Returns their slot. */
    uint32_t (*send)(void *engine, const struct pell_points_params *params, const struct pell_surface_points *in, size_t n);
    /* Computes direct light; the batch's `lights` and `mix` are those of `params`. Returns seconds by the device's clock, and bytes
     * transferred. */
    enum pell_result (*run)(void *engine, const struct pell_points_params *params, double *seconds, int64_t *bytes);
    /* Reads the light of the points in this slot, as light_points would compute it. Returns the number of rays. */
    int64_t (*take)(void *engine, const struct pell_points_params *params, const struct pell_surface_points *in, size_t n, uint32_t slot,
                    const struct pell_surface_light *out);
};

/* State that a method keeps after its pass, for the next one of a renderer: a moving scene is a new scene in each frame, with the same
 * triangles. Whoever takes `state` sets it to NULL. */
struct pell_kept {
    void *state; /* NULL: nothing */
    void (*destroy)(void *state);
};

struct pell_services {
    struct pell_context *ctx;
    struct pell_pool *pool;
    struct pell_gpu *gpu;                  /* NULL: not the engine vulkan */
    struct pell_gpu_buffer *const *planes; /* enum pell_gpu_plane: planes that the method reads and writes there; NULL: planes in host
                                            * memory */
    const struct pell_scene *scene;
    const struct pell_rays *rays;
    const uint16_t *frame_index; /* per scene material + 1: the frame's material + 1, or 0 */
    const struct pell_frame_material *materials;
    const struct pell_settings *settings;     /* of the current frame: updated in place if a pass outlives a change */
    const struct pell_checkpoint *checkpoint; /* NULL: none */
    struct pell_communicator *communicator;   /* NULL: this process renders the frame alone */
    struct pell_kept *kept;                   /* NULL: nothing can be kept */
    const struct pell_observer *observer;     /* NULL: intermediate images are not requested */
    void *engine;                             /* passed to the functions below, which the engine fills in */
    int64_t (*light_points)(void *engine, const struct pell_points_params *params, const struct pell_surface_points *in, size_t n,
                            const struct pell_surface_light *out);
    const struct pell_light_batches *batches; /* NULL: none */
    const struct pell_light_grid *(*light_grid)(void *engine, size_t light);
    void (*transmitted)(void *engine, const struct pell_points16 *points, int count, float fraction[3][16]);
    void (*returned)(void *engine, const struct pell_points16 *points, int count, float factor[3][16], float crossed[3][16]);
};

/* Computes light that enters at n points, like the stage "irradiance" at pixels: same lights, tables and formulas. Runs on the calling
 * thread and allocates nothing. Returns the number of rays traced. */
static inline int64_t pell_services_light_points(const struct pell_services *s, const struct pell_points_params *params,
                                                 const struct pell_surface_points *in, size_t n, const struct pell_surface_light *out)
{
    return s->light_points(s->engine, params, in, n, out);
}

/* Capacity that 16 points use per multisample: sheets have two sides. */
static inline size_t pell_services_batch_points(const struct pell_services *s)
{
    return pell_scene_has_sheets(s->scene) ? 32 : 16;
}

/* Points in packets of 16, like rays, and their light. */
struct pell_points16 {
    uint32_t mesh[16], triangle[16];
    float u[16], v[16];
    uint32_t seed[16];
};

struct pell_points16_light {
    float irradiance[3][16], position[3][16], normal[3][16], strength[16];
    bool valid[16];
};

/* Loads the surface points of `count` pixels of a frame that has its hits, except `seed`. */
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
    return (struct pell_surface_points) { p->mesh, p->triangle, p->u, p->v, p->seed, ambient, NULL };
}

static inline struct pell_surface_light pell_points16_out(struct pell_points16_light *light)
{
    return (struct pell_surface_light) {
        .irradiance = { light->irradiance[0], light->irradiance[1], light->irradiance[2] },
        .position = { light->position[0], light->position[1], light->position[2] },
        .normal = { light->normal[0], light->normal[1], light->normal[2] },
        .strength = light->strength,
        .valid = light->valid,
    };
}

/* Computes the light of the first `count` points. */
static inline int64_t pell_services_light16(const struct pell_services *s, const struct pell_points_params *params,
                                            const struct pell_points16 *p, const float *ambient, int count,
                                            struct pell_points16_light *light)
{
    const struct pell_surface_points in = pell_points16_in(p, ambient);
    const struct pell_surface_light out = pell_points16_out(light);

    return pell_services_light_points(s, params, &in, (size_t) count, &out);
}

/* Fraction of a slab's transmission that a method adds at the first `count` points, [0, 1], if it transmits by its plan: 0 where the
 * engine knows the light in the solid and adds it, 1 where it does not. */
static inline void pell_services_transmitted(const struct pell_services *s, const struct pell_points16 *points, int count,
                                             float fraction[3][16])
{
    s->transmitted(s->engine, points, count, fraction);
}

/* For a method that adds transport between faces at an angle, at points on a flat thin part: the return of a profile there over that of
 * a half-space, and the transmission over that of optics/medium/opposed.h. 1 elsewhere, and where diffusion in the solid was solved. */
static inline void pell_services_returned(const struct pell_services *s, const struct pell_points16 *points, int count, float factor[3][16],
                                          float crossed[3][16])
{
    s->returned(s->engine, points, count, factor, crossed);
}

/* Light grid of light `light` of the scene (visibility/light_grid.h), during a frame; NULL: none, use rays. */
static inline const struct pell_light_grid *pell_services_light_grid(const struct pell_services *s, size_t light)
{
    return s->light_grid(s->engine, light);
}

/* The scene's solids over the frame's materials. pell_solids_destroy when done. */
static inline PELL_NODISCARD enum pell_result pell_services_solids(const struct pell_services *s, struct pell_solids **out)
{
    return pell_solids_create(s->ctx, s->scene, s->frame_index, s->materials, out);
}

/* Whether intermediate images of this sample are requested. */
static inline bool pell_services_observed(const struct pell_services *s, const struct pell_frame *in)
{
    return s->observer && in->first;
}

/* The 32-bit seed in struct pell_frame.seed. */
static inline uint32_t pell_settings_seed(const struct pell_settings *settings)
{
    const uint64_t seed = (uint64_t) settings->seed;

    return (uint32_t) (seed ^ seed >> 32);
}

#endif
