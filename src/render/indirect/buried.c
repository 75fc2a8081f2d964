/* SPDX-License-Identifier: MIT
 *
 * buried.c - removes samples that are inside a solid: visibility/buried.h.
 */
#include "render/indirect/internal.h"

#include "visibility/buried.h"

#include <string.h>

#define PACKET PELL_PACKET

struct buried {
    const struct pell_indirect *in;
    bool *flags;
};

static void set_ray(struct pell_ray_hit16 *r, int i, const struct indirect_sample *s, float spacing, struct pell_vec3 offset_direction,
                    struct pell_vec3 direction)
{
    pell_ray16_set(&r->ray, i, vec3_mad(s->position, indirect_ray_offset(s->position, spacing), offset_direction), direction, INFINITY);
    r->hit.mesh[i] = PELL_NO_HIT;
}

void indirect_along_normals16(const struct pell_indirect *in, size_t first, bool inward, int valid[16], struct pell_ray_hit16 *r)
{
    memset(r, 0, sizeof(*r));
    memset(valid, 0, PACKET * sizeof(*valid));
    for (size_t i = 0; i < PACKET && first + i < in->num_samples; i++) {
        const struct indirect_sample *s = &in->samples[first + i];
        const struct pell_vec3 direction = vec3_mul(s->normal, inward ? -1.0f : 1.0f);
        valid[i] = in->p.scene->materials[s->medium].opaque ? 0 : -1;
        set_ray(r, (int) i, s, inward ? 0.0f : s->spacing, direction, direction);
    }
    pell_rays_closest16(in->p.rays, valid, false, r);
}

static void test16(void *arg, int index, int worker)
{
    const struct buried *b = arg;
    const struct pell_indirect *in = b->in;
    const size_t first = (size_t) index * PACKET;
    struct pell_buried_query points[PACKET] = { { .object = 0 } };
    size_t sample[PACKET];
    bool is[PACKET];
    int count = 0;

    (void) worker;
    for (size_t i = first; i < first + PACKET && i < in->num_samples; i++) {
        const struct indirect_sample *s = &in->samples[i];
        if (in->p.scene->materials[s->medium].opaque)
            continue;
        points[count] = (struct pell_buried_query) { s->position, s->normal, indirect_ray_offset(s->position, s->spacing),
                                                     pell_mesh_assembly(&in->p.scene->meshes[s->mesh]) };
        sample[count++] = i;
    }
    pell_buried16(in->p.scene, in->p.rays, points, count, is);
    for (int i = 0; i < count; i++)
        b->flags[sample[i]] = is[i];
}

enum pell_result indirect_drop_buried(struct pell_indirect *in, struct pell_pool *pool)
{
    struct buried b = { in, pell_calloc(in->ctx, in->num_samples, sizeof(*b.flags)) };
    size_t kept = 0;

    if (!b.flags)
        return PELL_ERR_NOMEM;
    pell_pool_run(pool, (int) ((in->num_samples + PACKET - 1) / PACKET), test16, &b);
    for (size_t i = 0; i < in->num_samples; i++)
        if (!b.flags[i])
            in->samples[kept++] = in->samples[i];
    in->num_samples = kept;
    pell_free(in->ctx, b.flags);
    return pell_cancelled(in->ctx) ? PELL_ERR_CANCELLED : PELL_OK;
}
