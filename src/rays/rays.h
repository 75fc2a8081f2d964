/* SPDX-License-Identifier: MIT
 *
 * rays.h - visibility. rays.c is the only file that knows that it is Embree.
 *
 * Packets of 16 rays, planar, 64-byte aligned. A ray runs from tnear to tfar along a direction that need not be unit (t counts in it).
 * Alpha-masked surfaces let rays through where they are transparent.
 *
 * Threads    queries are safe from many threads; build and destroy from one. Denormals should be flushed (the pool does).
 */
#ifndef PELL_RAYS_H
#define PELL_RAYS_H

#include "base/pool.h"

#include <pellucid/scene.h>

#define PELL_PACKET 16
#define PELL_NO_HIT UINT32_MAX

struct pell_ray16 {
    _Alignas(64) float ox[16];
    float oy[16], oz[16];
    float tnear[16];
    float dx[16], dy[16], dz[16];
    float time[16];
    float tfar[16]; /* occluded: -infinity where something is in the way */
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

/* Which surfaces a ray sees: bits of ray.mask. */
enum pell_ray_mask {
    PELL_RAY_TRANSLUCENT = 1u << 0, /* meshes of translucent materials */
    PELL_RAY_OPAQUE = 1u << 1,
    PELL_RAY_ALL = 3u,
};

struct pell_rays;

PELL_NODISCARD enum pell_result pell_rays_create(struct pell_context *ctx, const struct pell_scene *scene, struct pell_pool *pool,
                                                 struct pell_rays **out);
void pell_rays_destroy(struct pell_rays **rays);

/* `valid`: 16 ints, -1 for rays that take part, 0 for others; 64-byte aligned. `coherent`: rays of one packet go much the same way. */
void pell_rays_closest16(const struct pell_rays *rays, const int *valid, bool coherent, struct pell_ray_hit16 *packet);
void pell_rays_occluded16(const struct pell_rays *rays, const int *valid, bool coherent, struct pell_ray16 *packet);

#endif
