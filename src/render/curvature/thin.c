/* SPDX-License-Identifier: MIT
 *
 * thin.c - how thin an object is under pieces of its surface, by rays along the inward normals.
 */
#include "render/curvature/internal.h"

#include "visibility/rays.h"

#include <string.h>

#define LANES 16
#define INSIDE_MOST 8 /* surfaces that a ray may cross: inner parts of the object do not end it */

struct thin_job {
    const struct curvature_object *object;
    const struct curvature_patch *patch;
    struct curvature_piece *piece;
    size_t count;
};

/* Sets the thinness below a piece from the hit of its ray; returns false if the ray continues, into or out of an inner part. `inside`:
 * number of inner parts that contain the ray. */
static bool measure(const struct thin_job *job, struct curvature_piece *piece, const struct pell_ray_hit16 *r, int i, int *inside)
{
    const struct pell_scene *scene = job->object->scene;
    const struct pell_mesh *mesh = r->hit.mesh[i] < scene->num_meshes ? &scene->meshes[r->hit.mesh[i]] : NULL;
    float opposed;

    if (!mesh || pell_mesh_assembly(mesh) != job->object->id || job->object->same[mesh->material] != job->patch->medium)
        return true;
    opposed = -vec3_dot(piece->normal, vec3_normalize(vec3(r->hit.ngx[i], r->hit.ngy[i], r->hit.ngz[i])));
    if (!(opposed > 0.0f)) {
        ++*inside;
        return false;
    }
    if (*inside > 0) {
        --*inside;
        return false;
    }
    piece->thinness = opposed / (r->ray.tfar[i] + CURVATURE_OFFSET * vec3_max_abs(piece->at));
    return true;
}

/* Pieces inside another part of the object are not surface: their outer side faces an inner side. */
static void drop_buried(const struct thin_job *job, struct curvature_piece *piece, size_t count)
{
    struct pell_ray_hit16 r;
    _Alignas(64) int mask[LANES] = { 0 };
    bool any = false;

    memset(&r, 0, sizeof(r));
    for (size_t i = 0; i < LANES; i++) {
        const struct curvature_piece *p = &piece[i < count ? i : 0];
        mask[i] = i < count && p->thinness > 0.0f ? -1 : 0;
        any |= mask[i] != 0;
        pell_ray16_set(&r.ray, (int) i, vec3_mad(p->at, CURVATURE_OFFSET * vec3_max_abs(p->at), p->normal), p->normal, INFINITY);
        r.hit.mesh[i] = r.hit.instance[i] = PELL_NO_HIT;
    }
    if (!any)
        return;
    pell_rays_closest16(job->object->rays, mask, false, &r);
    for (size_t i = 0; i < count; i++)
        if (mask[i] && pell_hit16_inside(job->object->scene, &r, (int) i, job->object->id))
            piece[i].thinness = 0.0f;
}

static void thin16(void *arg, int index, int worker)
{
    const struct thin_job *job = arg;
    struct curvature_piece *piece = job->piece + (size_t) index * LANES;
    const size_t count = job->count - (size_t) index * LANES < LANES ? job->count - (size_t) index * LANES : LANES;
    struct pell_ray_hit16 r;
    _Alignas(64) int mask[LANES];
    int inside[LANES] = { 0 };
    bool any = true;

    (void) worker;
    memset(&r, 0, sizeof(r));
    for (size_t i = 0; i < LANES; i++) {
        const struct curvature_piece *p = &piece[i < count ? i : 0];
        const struct pell_vec3 inward = vec3_mul(p->normal, -1.0f);
        mask[i] = i < count && p->area > 0.0 ? -1 : 0;
        pell_ray16_set(&r.ray, (int) i, vec3_mad(p->at, CURVATURE_OFFSET * vec3_max_abs(p->at), inward), inward, job->patch->max_thickness);
    }
    for (size_t i = 0; i < count; i++)
        piece[i].thinness = 0.0f;
    for (int step = 0; step < INSIDE_MOST && any; step++) {
        any = false;
        for (size_t i = 0; i < LANES; i++)
            r.hit.mesh[i] = r.hit.instance[i] = PELL_NO_HIT;
        pell_rays_closest16(job->object->rays, mask, false, &r);
        for (size_t i = 0; i < LANES; i++) {
            if (mask[i] && measure(job, &piece[i], &r, (int) i, &inside[i]))
                mask[i] = 0;
            any |= mask[i] != 0;
            r.ray.tnear[i] = r.ray.tfar[i] + CURVATURE_OFFSET * vec3_max_abs(piece[i < count ? i : 0].at);
            r.ray.tfar[i] = job->patch->max_thickness;
        }
    }
    drop_buried(job, piece, count);
}

void curvature_find_thin(const struct curvature_object *object, const struct curvature_patch *patch, struct curvature_piece *piece,
                         size_t count)
{
    struct thin_job job = { object, patch, piece, count };

    pell_pool_run(object->pool, (int) ((count + LANES - 1) / LANES), thin16, &job);
}
