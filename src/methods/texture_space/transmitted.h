/* SPDX-License-Identifier: MIT
 *
 * transmitted.h - shared by translucent_shadow_map.c and transmission_rays.c: entry points of light, and the light that a texel receives
 * from them.
 */
#ifndef PELL_TEXTURE_SPACE_TRANSMITTED_H
#define PELL_TEXTURE_SPACE_TRANSMITTED_H

#include "methods/texture_space/texture_space.h"

#include <stdatomic.h>

enum { TS_CHUNK = 1024 }; /* texels per task of second rays */

/* A point on the solid's surface. */
struct ts_surface_point {
    uint32_t triangle; /* of the solid; UINT32_MAX: none */
    float u, v;
};

struct ts_task {
    const struct ts_tsm_params *p;
    float *alpha;
    const uint8_t *faces;
    struct ts_transmitted_texel *found; /* for TS_TILE rows at first[row / TS_TILE] */
    const int *first;                   /* per TS_TILE rows */
    int *count;
    const float *const *lit; /* irradiance of this light alone; NULL: not known yet */
    size_t known;            /* number of texels found before it was known */
    struct pell_view view;
    struct ts_surface_point *map;
    _Atomic int64_t rays;
};

struct ts_shading_point {
    struct pell_vec3 at, geometric, normal;
    float max_coordinate;
};

/* The point with the triangle's normal; with the interpolated normal; the same of a texel. */
struct ts_shading_point ts_flat_point(const struct ts_atlas *a, struct ts_surface_point p);
struct ts_shading_point ts_smooth_point(const struct ts_atlas *a, struct ts_surface_point p, struct ts_shading_point flat);
struct ts_shading_point ts_shading_point_of(const struct ts_atlas *a, struct ts_surface_point p);
struct ts_shading_point ts_shading_point_at(const struct ts_atlas *a, ptrdiff_t at);
/* A texel's point on its triangle. */
struct ts_surface_point ts_point_at(const struct ts_atlas *a, ptrdiff_t at);

/* Unit direction from a point to the light's centre; to an environment straight through the solid. *far: distance. */
static inline struct pell_vec3 ts_toward(const struct pell_light *light, struct pell_vec3 from, struct pell_vec3 normal, float *far)
{
    struct pell_vec3 dir;

    if (light->type == PELL_LIGHT_ENVIRONMENT) {
        *far = INFINITY;
        return vec3_mul(normal, -1.0f);
    }
    if (light->type == PELL_LIGHT_DIRECTIONAL) {
        *far = INFINITY;
        return vec3_mul(vec3_normalize(vec3_load(light->direction)), -1.0f);
    }
    dir = vec3_sub(vec3_load(light->position), from);
    *far = vec3_length(dir);
    return *far > 0.0f ? vec3_mul(dir, 1.0f / *far) : vec3(0.0f, 0.0f, 1.0f);
}

/* Whether a texel needs a ray: it faces away from the light or, once the light is known, faces it but is in shadow. With at_once: all
 * texels. */
bool ts_needs_ray(const struct ts_task *t, ptrdiff_t at);
/* Evaluates transmission from `entry` to texel C along the unit ray direction: thickness and the inputs of the blurs. False: none. */
bool ts_transmit(const struct ts_task *t, ptrdiff_t at, const struct ts_shading_point *c, struct ts_surface_point entry,
                 struct pell_vec3 dir, struct pell_vec3 light, struct ts_transmitted_texel *out);

/* --- transmission_rays.c --- */

/* A packet of 16 rays from texels to the light. */
struct ts_packet {
    _Alignas(64) int active[16];
    struct pell_ray_hit16 rays;
    struct pell_vec3 light[16];
    float remaining[16]; /* mm: remaining length */
    bool to_light;
    ptrdiff_t at[16];
    struct ts_shading_point flat[16]; /* their origins */
    struct ts_surface_point exit[16]; /* exit from the solid; triangle UINT32_MAX: none yet */
    size_t known[16];                 /* of a second ray: index in the list */
    int count;
};

/* Traces the packet, lists the texels of the TS_TILE rows that receive light, and empties the packet. */
void ts_trace(struct ts_task *t, int tile, struct ts_packet *k);
/* Adds rays for the texels of a block that need one, `first` its first texel; traces the packet whenever it is full. */
void ts_ray_texels(struct ts_task *t, ptrdiff_t first, int tile, const uint8_t *texels, int count, struct ts_packet *k);
/* Second rays of a chunk of the known texels: rays that end in shadow continue; rays that hit a lit face at an angle are replaced by ones
 * perpendicular to it. Tasks of a pool; `arg` is a struct ts_task. */
void ts_trace_beyond_shadow(void *arg, int chunk, int worker);
void ts_trace_to_face(void *arg, int chunk, int worker);

#endif
