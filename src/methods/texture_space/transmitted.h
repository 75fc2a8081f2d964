/* SPDX-License-Identifier: MIT
 *
 * transmitted.h - what translucent_shadow_map.c and transmission_rays.c share: points of the surface where light enters, and what a texel
 * gets from there.
 */
#ifndef PELL_TEXTURE_SPACE_TRANSMITTED_H
#define PELL_TEXTURE_SPACE_TRANSMITTED_H

#include "methods/texture_space/texture_space.h"

#include <stdatomic.h>

enum { TS_CHUNK = 1024 }; /* texels that are known to have transmitted light, of a second way at once */

/* A point of the solid. */
struct ts_surface_point {
    uint32_t triangle; /* of the solid; UINT32_MAX: there is none */
    float u, v;
};

struct ts_task {
    const struct ts_tsm_params *p;
    float *alpha;
    const uint8_t *faces;
    struct ts_transmitted_texel *found; /* of TS_TILE rows at first[row / TS_TILE] */
    const int *first;                   /* per TS_TILE rows */
    int *count;
    const float *const *lit; /* what enters of this light alone; NULL: not known yet */
    size_t known;            /* texels that were found before it was */
    struct pell_view view;
    struct ts_surface_point *map;
    _Atomic int64_t rays;
};

struct ts_spot {
    struct pell_vec3 at, geometric, normal;
    float largest;
};

/* A point of a triangle, whose normal is the triangle's; the smooth one; that of a texel, smooth. */
struct ts_spot ts_flat_spot(const struct ts_atlas *a, struct ts_surface_point p);
struct ts_spot ts_smooth_spot(const struct ts_atlas *a, struct ts_surface_point p, struct ts_spot flat);
struct ts_spot ts_spot_of(const struct ts_atlas *a, struct ts_surface_point p);
struct ts_spot ts_spot_at(const struct ts_atlas *a, ptrdiff_t at);
/* Where a texel is on its triangle. */
struct ts_surface_point ts_point_at(const struct ts_atlas *a, ptrdiff_t at);

/* The way from a point to the light's middle, unit; to an environment straight through the solid. *far: how far that is. */
static inline struct pell_vec3 ts_toward(const struct pell_light *light, struct pell_vec3 from, struct pell_vec3 normal, float *far)
{
    struct pell_vec3 way;

    if (light->type == PELL_LIGHT_ENVIRONMENT) {
        *far = INFINITY;
        return vec3_mul(normal, -1.0f);
    }
    if (light->type == PELL_LIGHT_DIRECTIONAL) {
        *far = INFINITY;
        return vec3_mul(vec3_normalize(vec3_load(light->direction)), -1.0f);
    }
    way = vec3_sub(vec3_load(light->position), from);
    *far = vec3_length(way);
    return *far > 0.0f ? vec3_mul(way, 1.0f / *far) : vec3(0.0f, 0.0f, 1.0f);
}

/* Texels that face away from the light; with the light known those that face it in the dark. All where it will not be known. */
bool ts_asks(const struct ts_task *t, ptrdiff_t at);
/* Light that enters at `entry`, seen from texel C along the unit `way`: its thickness and what else the blurs ask. False: there is none. */
bool ts_pass_through(const struct ts_task *t, ptrdiff_t at, const struct ts_spot *c, struct ts_surface_point entry, struct pell_vec3 way,
                     struct pell_vec3 light, struct ts_transmitted_texel *out);

/* --- transmission_rays.c --- */

/* Ways from texels to the light, 16 at a time. */
struct ts_packet {
    _Alignas(64) int open[16];
    struct pell_ray_hit16 rays;
    struct pell_vec3 light[16];
    float left[16]; /* mm to go at most */
    bool to_light;
    ptrdiff_t at[16];
    struct ts_spot flat[16];          /* of them: ts_flat_spot */
    struct ts_surface_point exit[16]; /* where the way has left the solid; none: nowhere yet */
    size_t known[16];                 /* a way that goes on: which of the list it is */
    int count;
};

/* Follows the ways of the packet and lists the texels of the TS_TILE rows that light came to; the packet is empty then. */
void ts_trace(struct ts_task *t, int tile, struct ts_packet *k);
/* Adds ways of the texels of a block that ask for the light, `first` its first texel; traces the packet whenever it is full. */
void ts_ray_texels(struct ts_task *t, ptrdiff_t first, int tile, const uint8_t *texels, int count, struct ts_packet *k);
/* Second rays of a chunk of the texels that are known: of those whose way ends in the dark, further on; and of those that are lit through
 * a face at an angle, straight to that face. Tasks of a pool; `arg` is a struct ts_task. */
void ts_go_on(void *arg, int chunk, int worker);
void ts_approach(void *arg, int chunk, int worker);

#endif
