/* SPDX-License-Identifier: MIT
 * buried.c - see buried.h. */
#include "visibility/buried.h"

#include "math/sampling.h"

#include <string.h>

#define VOTE_STEP 3   /* of the packet's rays, every third is followed through all of the object */
#define MAX_OUTSIDE 4 /* of PELL_PACKET rays, the maximum that may not hit an inner side of the object from a buried point */

static void set_ray(struct pell_ray_hit16 *r, int i, const struct pell_buried_query *p, struct pell_vec3 dir)
{
    pell_ray16_set(&r->ray, i, vec3_mad(p->position, p->clearance, p->normal), dir, INFINITY);
    r->hit.mesh[i] = PELL_NO_HIT;
}

/* Whether most rays of the packet leave the object more often than they enter it. */
static bool leave_object(const struct pell_rays *rays, const struct pell_ray16 *r, int object)
{
    int votes = 0;

    for (int i = VOTE_STEP / 2; i < PELL_PACKET; i += VOTE_STEP) {
        const struct pell_ray ray = { { r->ox[i], r->oy[i], r->oz[i] }, 0.0f, { r->dx[i], r->dy[i], r->dz[i] }, INFINITY, PELL_RAY_ALL };
        votes += pell_rays_exits(rays, &ray, object) > 0 ? 1 : -1;
    }
    return votes > 0;
}

/* Where faces of two parts coincide, a ray hits either of them, so that the side that it hits first does not show whether it was inside. */
static bool is_buried(const struct pell_scene *scene, const struct pell_rays *rays, const struct pell_buried_query *p)
{
    _Alignas(64) int valid[PELL_PACKET];
    struct pell_ray_hit16 r;
    struct pell_vec3 t, b;
    int inner = 0, missed = 0;

    vec3_basis(p->normal, &t, &b);
    memset(&r, 0, sizeof(r));
    for (int i = 0; i < PELL_PACKET; i++) {
        float x, y;
        pell_disc_point(((float) i + 0.5f) / PELL_PACKET, pell_unit_float(pell_sobol0((uint32_t) i)), &x, &y);
        valid[i] = -1;
        set_ray(&r, i, p, vec3_mad(vec3_mad(vec3_mul(p->normal, sqrtf(fmaxf(1.0f - x * x - y * y, 1e-6f))), x, t), y, b));
    }
    pell_rays_closest16(rays, valid, false, &r);
    for (int i = 0; i < PELL_PACKET; i++) {
        inner += pell_hit16_inside(scene, &r, i, p->object);
        missed += !pell_hit16_is_object(scene, &r, i, p->object);
    }
    if (inner >= PELL_PACKET - MAX_OUTSIDE)
        return true;
    return inner > 0 && missed <= MAX_OUTSIDE && leave_object(rays, &r.ray, p->object);
}

/* Where faces of two parts coincide, as of adjacent bricks, the ray along the normal may hit either of them, not necessarily an inner
 * side. */
void pell_buried16(const struct pell_scene *scene, const struct pell_rays *rays, const struct pell_buried_query *points, int count,
                   bool buried[PELL_PACKET])
{
    _Alignas(64) int valid[PELL_PACKET] = { 0 };
    struct pell_ray_hit16 r;

    memset(&r, 0, sizeof(r));
    for (int i = 0; i < count; i++) {
        valid[i] = -1;
        set_ray(&r, i, &points[i], points[i].normal);
    }
    pell_rays_closest16(rays, valid, false, &r);
    for (int i = 0; i < PELL_PACKET; i++)
        buried[i] = i < count && pell_hit16_is_object(scene, &r, i, points[i].object) && is_buried(scene, rays, &points[i]);
}
