/* SPDX-License-Identifier: MIT
 *
 * buried.c - samples inside the solid: parts of an object are often pushed into each other, and what is inside of another part is no
 * surface. No light enters there, and none leaves.
 */
#include "render/indirect/internal.h"

#include <string.h>

#define PACKET 16
#define MOST_OUTSIDE 4 /* of PACKET rays that may see no inner side of the object from a buried sample */

struct buried {
    const struct pell_indirect *in;
    bool *is;
};

static void set_ray(struct pell_ray_hit16 *r, int i, const struct indirect_sample *s, float spacing, struct pell_vec3 from,
                    struct pell_vec3 way)
{
    pell_ray16_set(&r->ray, i, vec3_mad(s->position, indirect_clearance(s->position, spacing), from), way, INFINITY);
    r->hit.mesh[i] = PELL_NO_HIT;
}

void indirect_along_normals16(const struct pell_indirect *in, size_t first, bool inward, int valid[16], struct pell_ray_hit16 *r)
{
    memset(r, 0, sizeof(*r));
    memset(valid, 0, PACKET * sizeof(*valid));
    for (size_t i = 0; i < PACKET && first + i < in->num_samples; i++) {
        const struct indirect_sample *s = &in->samples[first + i];
        const struct pell_vec3 way = vec3_mul(s->normal, inward ? -1.0f : 1.0f);
        valid[i] = in->p.scene->materials[s->material].opaque ? 0 : -1;
        set_ray(r, (int) i, s, inward ? 0.0f : s->spacing, way, way);
    }
    pell_rays_closest16(in->p.rays, valid, false, r);
}

static int object_of(const struct pell_indirect *in, size_t sample)
{
    return in->p.scene->meshes[in->samples[sample].mesh].object;
}

/* Whether most rays that leave a sample come to the inner side of its own object. */
static bool is_buried(const struct pell_indirect *in, size_t number)
{
    const struct indirect_sample *s = &in->samples[number];
    _Alignas(64) int valid[PACKET];
    struct pell_ray_hit16 r;
    struct pell_vec3 t, b;
    int outside = 0;

    vec3_basis(s->normal, &t, &b);
    memset(&r, 0, sizeof(r));
    for (int i = 0; i < PACKET; i++) {
        float x, y;
        pell_disc_point(((float) i + 0.5f) / PACKET, pell_unit_float(pell_sobol0((uint32_t) i)), &x, &y);
        valid[i] = -1;
        set_ray(&r, i, s, s->spacing, s->normal,
                vec3_mad(vec3_mad(vec3_mul(s->normal, sqrtf(fmaxf(1.0f - x * x - y * y, 1e-6f))), x, t), y, b));
    }
    pell_rays_closest16(in->p.rays, valid, false, &r);
    for (int i = 0; i < PACKET; i++)
        outside += !pell_hit16_inside(in->p.scene, &r, i, object_of(in, number));
    return outside <= MOST_OUTSIDE;
}

/* A ray along the normal tells of most that they are not. Where faces of two parts lie on each other, as of bricks side by side, it is luck
 * which of them it meets. */
static void look16(void *arg, int index, int worker)
{
    const struct buried *b = arg;
    const struct pell_indirect *in = b->in;
    const size_t first = (size_t) index * PACKET;
    _Alignas(64) int valid[PACKET];
    struct pell_ray_hit16 r;

    (void) worker;
    indirect_along_normals16(in, first, false, valid, &r);
    for (size_t i = 0; i < PACKET && first + i < in->num_samples; i++)
        b->is[first + i] = valid[i] && pell_hit16_meets(in->p.scene, &r, (int) i, object_of(in, first + i)) && is_buried(in, first + i);
}

enum pell_result indirect_drop_buried(struct pell_indirect *in, struct pell_pool *pool)
{
    struct buried b = { in, pell_calloc(in->ctx, in->num_samples, sizeof(*b.is)) };
    size_t kept = 0;

    if (!b.is)
        return PELL_ERR_NOMEM;
    pell_pool_run(pool, (int) ((in->num_samples + PACKET - 1) / PACKET), look16, &b);
    for (size_t i = 0; i < in->num_samples; i++)
        if (!b.is[i])
            in->samples[kept++] = in->samples[i];
    in->num_samples = kept;
    pell_free(in->ctx, b.is);
    return pell_cancelled(in->ctx) ? PELL_ERR_CANCELLED : PELL_OK;
}
