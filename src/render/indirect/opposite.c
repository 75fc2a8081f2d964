/* SPDX-License-Identifier: MIT
 *
 * opposite.c - the samples on the other side: of a sheet, whose two sides have samples at the same points, the front's first; of a solid,
 * by a ray along the inward normal, as the stage "curvature" measures thickness.
 */
#include "render/indirect/internal.h"

#define PACKET 16

/* Returns the sample where a ray leaves the solid, on the same object and medium; INDIRECT_NONE if it does not exit there. */
static uint32_t exit_sample(const struct pell_indirect *in, const struct indirect_sample *s, const struct pell_ray_hit16 *r, int i)
{
    const struct pell_hit16 *h = &r->hit;
    const struct pell_scene *scene = in->p.scene;
    const struct pell_vec3 d = vec3(r->ray.dx[i], r->ray.dy[i], r->ray.dz[i]);

    if (!pell_hit16_inside(scene, r, i, pell_mesh_assembly(&scene->meshes[s->mesh])) ||
        in->same[scene->meshes[h->mesh[i]].material] != s->medium)
        return INDIRECT_NONE;
    return indirect_sample_at(in, h->mesh[i], h->triangle[i], h->u[i], h->v[i], false,
                              vec3_mad(vec3(r->ray.ox[i], r->ray.oy[i], r->ray.oz[i]), r->ray.tfar[i], d));
}

static void opposite16(void *arg, int index, int worker)
{
    const struct pell_indirect *in = arg;
    const size_t first = (size_t) index * PACKET;
    _Alignas(64) int valid[PACKET];
    struct pell_ray_hit16 r;

    (void) worker;
    indirect_along_normals16(in, first, true, valid, &r);
    for (size_t i = 0; i < PACKET && first + i < in->num_samples; i++) {
        const size_t k = first + i, twin = in->samples[k].back ? k - 1 : k + 1;
        if (valid[i])
            in->opposite[k] = exit_sample(in, &in->samples[k], &r, (int) i);
        else
            in->opposite[k] = twin < in->num_samples ? (uint32_t) twin : INDIRECT_NONE;
    }
}

enum pell_result indirect_opposite_make(struct pell_indirect *in, struct pell_pool *pool)
{
    const struct pell_scene *scene = in->p.scene;
    bool any = pell_scene_has_sheets(scene);

    for (size_t i = 0; i < scene->num_materials; i++)
        any |= !scene->materials[i].opaque;
    if (!any)
        return PELL_OK;
    in->opposite = pell_alloc_array(in->ctx, in->num_samples, sizeof(*in->opposite));
    in->transmitted = pell_alloc_array(in->ctx, in->num_samples, sizeof(*in->transmitted));
    in->passed = pell_alloc_array(in->ctx, in->num_samples, sizeof(*in->passed));
    in->behind = pell_calloc(in->ctx, in->num_values, sizeof(*in->behind));
    if (!in->opposite || !in->transmitted || !in->passed || !in->behind)
        return PELL_ERR_NOMEM;
    pell_pool_run(pool, (int) ((in->num_samples + PACKET - 1) / PACKET), opposite16, in);
    return pell_cancelled(in->ctx) ? PELL_ERR_CANCELLED : PELL_OK;
}
