/* SPDX-License-Identifier: MIT
 *
 * thin.c - how thin an object is under pieces of its surface, by rays along the inward normals.
 */
#include "render/curvature/internal.h"

#include "visibility/rays.h"

#include <string.h>

#define LANES 16

struct thin_job {
    const struct curvature_object *object;
    const struct curvature_patch *patch;
    struct curvature_piece *piece;
    size_t count;
    int id; /* of the object */
};

static float largest(struct pell_vec3 p)
{
    return fmaxf(fabsf(p.x), fmaxf(fabsf(p.y), fabsf(p.z)));
}

static void thin16(void *arg, int index, int worker)
{
    const struct thin_job *job = arg;
    const struct pell_scene *scene = job->object->scene;
    struct curvature_piece *piece = job->piece + (size_t) index * LANES;
    const size_t count = job->count - (size_t) index * LANES < LANES ? job->count - (size_t) index * LANES : LANES;
    struct pell_ray_hit16 r;
    _Alignas(64) int mask[LANES];

    (void) worker;
    memset(&r, 0, sizeof(r));
    for (size_t i = 0; i < LANES; i++) {
        const struct curvature_piece *p = &piece[i < count ? i : 0];
        const struct pell_vec3 inward = vec3_mul(p->normal, -1.0f);
        const float e = 2.4e-5f * largest(p->at);
        mask[i] = i < count && p->area > 0.0 ? -1 : 0;
        pell_ray16_set(&r.ray, (int) i, vec3_mad(p->at, e, inward), inward, job->patch->farthest);
        r.hit.mesh[i] = r.hit.instance[i] = PELL_NO_HIT;
    }
    pell_rays_closest16(job->object->rays, mask, false, &r);
    for (size_t i = 0; i < count; i++) {
        const struct pell_mesh *mesh = mask[i] && r.hit.mesh[i] < scene->num_meshes ? &scene->meshes[r.hit.mesh[i]] : NULL;
        const float e = 2.4e-5f * largest(piece[i].at);
        float opposed;
        piece[i].thinness = 0.0f;
        if (!mesh || mesh->object != job->id || (uint32_t) mesh->material != job->patch->material)
            continue;
        opposed = -vec3_dot(piece[i].normal, vec3_normalize(vec3(r.hit.ngx[i], r.hit.ngy[i], r.hit.ngz[i])));
        if (opposed > 0.0f)
            piece[i].thinness = opposed / (r.ray.tfar[i] + e);
    }
}

void curvature_find_thin(const struct curvature_object *object, const struct curvature_patch *patch, struct curvature_piece *piece,
                         size_t count)
{
    struct thin_job job = { object, patch, piece, count, object->id };

    pell_pool_run(object->pool, (int) ((count + LANES - 1) / LANES), thin16, &job);
}
