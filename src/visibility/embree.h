/* SPDX-License-Identifier: MIT
 *
 * embree.h - the ray structure of embree.c, for the files of this room that query it.
 */
#ifndef PELL_EMBREE_H
#define PELL_EMBREE_H

#include "visibility/rays.h"

#include <embree3/rtcore.h>

/* Parts of one object may touch and overlap. Surface that is inside the object does not exist for rays. */
enum pell_side { SIDE_OUTER, SIDE_INNER, SIDE_MIXED };

/* A mesh, and what its filter function needs. */
struct pell_rays_surface {
    const struct pell_mesh *mesh;
    const struct pell_material *material;
    uint32_t mask;
    bool alpha;        /* test the base colour's alpha */
    bool single_sided; /* cameras see only its front */
    uint8_t *side;     /* per triangle: enum pell_side. NULL: all of it is outer surface */
    uint32_t medium;   /* pell_scene_same_media */
    RTCScene scene;
};

struct pell_rays {
    struct pell_context *ctx;
    RTCDevice device;
    RTCScene scene;
    bool committed;                     /* its build was started */
    struct pell_rays_surface *surfaces; /* one per mesh */
    size_t num_surfaces;
    _Atomic int64_t bytes;            /* allocated by Embree */
    atomic_bool over_limit, building; /* building: its tasks have begun */
    _Atomic int error;                /* first enum RTCError */
    char text[120];                   /* Embree's error message */
    struct pell_ray_record *record;   /* borrowed; NULL: none */
    bool native16;                    /* Embree traverses packets of 16 itself */
};

static inline struct RTCIntersectContext pell_intersect_context(bool coherent)
{
    struct RTCIntersectContext context;

    rtcInitIntersectContext(&context);
    context.flags = coherent ? RTC_INTERSECT_CONTEXT_FLAG_COHERENT : RTC_INTERSECT_CONTEXT_FLAG_INCOHERENT;
    return context;
}

static inline struct RTCRay pell_embree_ray(const struct pell_ray *ray)
{
    return (struct RTCRay) {
        .org_x = ray->origin[0],
        .org_y = ray->origin[1],
        .org_z = ray->origin[2],
        .tnear = ray->tnear,
        .dir_x = ray->direction[0],
        .dir_y = ray->direction[1],
        .dir_z = ray->direction[2],
        .tfar = ray->tfar,
        .mask = ray->mask,
    };
}

/* For filters: whether a point of the surface is inside its object, which rays do not meet; whether the query is one that asks. */
bool pell_surface_is_inside(const struct pell_rays_surface *surface, uint32_t triangle, float u, float v);
bool pell_counts_crossings(const struct RTCIntersectContext *context);
/* Sets the sides of all triangles of objects whose parts overlap, once the structure is built; incomplete where the work was cancelled. */
void pell_rays_find_sides(const struct pell_rays *rays, const struct pell_scene *scene, struct pell_pool *pool);

#endif
