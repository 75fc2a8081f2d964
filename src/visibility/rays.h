/* SPDX-License-Identifier: MIT
 *
 * rays.h - ray queries. embree.c is the only file that depends on Embree.
 *
 * Packets of 16 rays, structure of arrays, 64-byte aligned. A ray runs from tnear to tfar along a direction that need not be unit (t is in
 * its units). Alpha-masked surfaces are transparent to rays where their alpha is 0.
 *
 * Threads    queries are safe from many threads; build and destroy from one. Denormals should be flushed (the pool does).
 */
#ifndef PELL_RAYS_H
#define PELL_RAYS_H

#include "base/pool.h"
#include "math/vec.h"

#include <pellucid/scene.h>

#define PELL_PACKET 16
#define PELL_NO_HIT UINT32_MAX

struct pell_ray16 {
    _Alignas(64) float ox[16];
    float oy[16], oz[16];
    float tnear[16];
    float dx[16], dy[16], dz[16];
    float time[16];
    float tfar[16]; /* occluded: -infinity if the ray hits something */
    uint32_t mask[16];
    uint32_t id[16];
    uint32_t flags[16];
};

struct pell_hit16 {
    _Alignas(64) float ngx[16]; /* geometric normal, not unit, by the index order */
    float ngy[16], ngz[16];
    float u[16], v[16]; /* barycentric: p = (1 - u - v) p0 + u p1 + v p2 */
    uint32_t triangle[16];
    uint32_t mesh[16]; /* PELL_NO_HIT: nothing was hit */
    uint32_t instance[16];
};

struct pell_ray_hit16 {
    struct pell_ray16 ray;
    struct pell_hit16 hit;
};

/* Ray masks: the surfaces that a ray intersects. */
enum pell_ray_mask {
    PELL_RAY_TRANSLUCENT = 1u << 0, /* meshes of translucent materials */
    PELL_RAY_OPAQUE = 1u << 1,
    PELL_RAY_ALL = 3u,
    PELL_RAY_LIGHT_SHELL = 1u << 2, /* struct pell_mesh.light_shell only */
    PELL_RAY_CAMERA =
        PELL_RAY_ALL | PELL_RAY_LIGHT_SHELL | 1u << 3, /* all, except the backs of single-sided opaque surfaces, as glTF defines it */
};

/* Sets ray i of a packet, from o along d, against all surfaces, up to tfar. */
static inline void pell_ray16_set(struct pell_ray16 *r, int i, struct pell_vec3 o, struct pell_vec3 d, float tfar)
{
    r->ox[i] = o.x;
    r->oy[i] = o.y;
    r->oz[i] = o.z;
    r->dx[i] = d.x;
    r->dy[i] = d.y;
    r->dz[i] = d.z;
    r->tnear[i] = 0.0f;
    r->tfar[i] = tfar;
    r->time[i] = 0.0f;
    r->mask[i] = PELL_RAY_ALL;
    r->id[i] = (uint32_t) i;
    r->flags[i] = 0;
}

/* Whether ray i of a packet has hit this object, */
static inline bool pell_hit16_is_object(const struct pell_scene *scene, const struct pell_ray_hit16 *r, int i, int object)
{
    return r->hit.mesh[i] < scene->num_meshes && pell_mesh_assembly(&scene->meshes[r->hit.mesh[i]]) == object;
}

/* and on its inner side. */
static inline bool pell_hit16_inside(const struct pell_scene *scene, const struct pell_ray_hit16 *r, int i, int object)
{
    const struct pell_hit16 *h = &r->hit;

    return pell_hit16_is_object(scene, r, i, object) &&
           h->ngx[i] * r->ray.dx[i] + h->ngy[i] * r->ray.dy[i] + h->ngz[i] * r->ray.dz[i] > 0.0f;
}

struct pell_rays;

PELL_NODISCARD enum pell_result pell_rays_create(struct pell_context *ctx, const struct pell_scene *scene, struct pell_pool *pool,
                                                 struct pell_rays **out);
void pell_rays_destroy(struct pell_rays **rays);
/* Whether rays intersect triangles of a mesh at all; `cut`: it has alpha cutouts. */
bool pell_rays_show(const struct pell_scene *scene, const struct pell_mesh *m, bool *cut);
/* Whether cameras see only its front. Translucent surfaces have two sides: they bound a medium. */
static inline bool pell_rays_single_sided(const struct pell_scene *scene, const struct pell_mesh *m)
{
    const struct pell_material *material = &scene->materials[m->material];

    return material->opaque && !material->double_sided;
}

/* `valid`: 16 ints, -1 for active rays, 0 for others; 64-byte aligned. `coherent`: the rays of a packet have similar directions. */
void pell_rays_closest16(const struct pell_rays *rays, const int *valid, bool coherent, struct pell_ray_hit16 *packet);
void pell_rays_occluded16(const struct pell_rays *rays, const int *valid, bool coherent, struct pell_ray16 *packet);

/* A single ray, for incoherent paths. The direction need not be unit. */
struct pell_ray {
    float origin[3], tnear;
    float direction[3], tfar;
    uint32_t mask;
};

struct pell_hit {
    float t;
    float ng[3]; /* geometric normal, not unit, by the index order */
    float u, v;  /* as in struct pell_hit16 */
    uint32_t mesh, triangle;
};

/* False: no hit, and *hit is unchanged. */
bool pell_rays_closest(const struct pell_rays *rays, const struct pell_ray *ray, struct pell_hit *hit);
bool pell_rays_occluded(const struct pell_rays *rays, const struct pell_ray *ray);
/* Number of times that a ray leaves an object minus the number of times that it enters it, over all its intersections: the number of the
 * object's closed parts that contain the origin. Intersections at the same distance all count. */
int pell_rays_exits(const struct pell_rays *rays, const struct pell_ray *ray, int object);

/* Whether a point of a surface is inside another part of its object that has the same medium (pell_mesh.overlaps). Rays do not meet such
 * surface. */
bool pell_rays_inner(const struct pell_rays *rays, uint32_t mesh, uint32_t triangle, float u, float v);
/* The same of a whole triangle. */
bool pell_rays_hide(const struct pell_rays *rays, uint32_t mesh, uint32_t triangle);

struct pell_nearest {
    uint32_t mesh, triangle;
    float u, v;             /* barycentric: p = (1 - u - v) p0 + u p1 + v p2 */
    struct pell_vec3 point; /* mm */
    double distance;        /* mm, from the triangle in double precision */
};

/* The nearest point to x, within `radius` mm (may be INFINITY), of the meshes with of_mesh[mesh] == `which` (of_mesh NULL: of all meshes
 * that rays intersect; alpha cutouts count as surface). Of triangles at equal distance the first. False: none. Slower if most nearby
 * geometry is excluded. */
bool pell_rays_closest_point(const struct pell_rays *rays, struct pell_vec3 x, float radius, const int32_t *of_mesh, int32_t which,
                             struct pell_nearest *out);

/* For benchmarks: records the rays of all queries except occlusion packets in order, to be replayed with Embree alone. */
struct pell_ray_record {
    struct pell_ray *rays; /* memory of the caller */
    bool *occlusion;       /* whether it was an occlusion query */
    size_t capacity;
    _Atomic size_t count; /* number of rays; those beyond the capacity are not stored */
};

/* NULL stops recording. Call only while no query runs. */
void pell_rays_record(struct pell_rays *rays, struct pell_ray_record *record);
/* Replays the recorded rays one by one or in packets of 16 consecutive ones; returns the number of hits. */
int64_t pell_rays_trace_record(const struct pell_rays *rays, const struct pell_ray_record *record, bool packets);

#endif
