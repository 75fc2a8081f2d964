/* SPDX-License-Identifier: MIT
 *
 * apart.c - solids of one object that light inside doesn't go between: closed parts that no chord connects. A hollow's wall belongs to the
 * solid around it, and so do parts that are pushed into each other. Parts that are open are taken to be one.
 */
#include "render/indirect/internal.h"

#include "scene/mesh/topology.h"

#define PACKET 16

struct apart {
    struct pell_indirect *in;
    size_t *first;    /* of each mesh's triangles in `part`; SIZE_MAX: its object has one part */
    uint32_t *part;   /* of triangles */
    uint32_t *joined; /* of parts, as pell_union_root reads it */
    size_t num_triangles, num_parts;
    uint32_t *met; /* of samples: part where the ray inward ends, or INDIRECT_NONE */
};

static bool takes_part(const struct pell_scene *scene, const struct pell_mesh *mesh)
{
    return indirect_shown(scene, mesh) && !scene->materials[mesh->material].opaque;
}

/* False for most meshes: all triangles hang together by vertices that they share. */
static enum pell_result may_be_many(struct pell_context *ctx, const struct pell_mesh *mesh, bool *many)
{
    uint32_t *parent = pell_alloc_array(ctx, mesh->num_vertices, sizeof(*parent)), root;

    if (!parent)
        return PELL_ERR_NOMEM;
    for (uint32_t i = 0; i < mesh->num_vertices; i++)
        parent[i] = i;
    for (uint32_t i = 0; i < mesh->num_triangles && !pell_cancelled_at(ctx, i); i++)
        for (int k = 1; k < 3; k++)
            pell_union_join(parent, mesh->index[3 * (size_t) i], mesh->index[3 * (size_t) i + k]);
    root = pell_union_root(parent, mesh->index[0]);
    for (uint32_t i = 0; i < mesh->num_triangles && !*many && !pell_cancelled_at(ctx, i); i++)
        *many = pell_union_root(parent, mesh->index[3 * (size_t) i]) != root;
    pell_free(ctx, parent);
    return PELL_OK;
}

static bool make_room(struct apart *a)
{
    const struct pell_scene *scene = a->in->p.scene;
    size_t triangles = 0;

    for (size_t i = 0; i < scene->num_meshes; i++)
        triangles += scene->meshes[i].num_triangles;
    a->part = pell_alloc_array(a->in->ctx, triangles, sizeof(*a->part));
    a->joined = pell_alloc_array(a->in->ctx, triangles, sizeof(*a->joined)); /* no more parts */
    return a->part && a->joined;
}

/* Numbers the parts of an object behind those of others; open ones are joined. */
static enum pell_result add_parts(struct apart *a, const uint32_t *meshes, const struct pell_topology *t)
{
    struct pell_context *ctx = a->in->ctx;
    struct pell_part *parts = pell_alloc_array(ctx, t->num_parts, sizeof(*parts));
    uint32_t open = INDIRECT_NONE;
    enum pell_result res = PELL_ERR_NOMEM;

    if (!parts || (!a->part && !make_room(a)))
        goto fail;
    pell_topology_parts(t, a->in->p.scene, parts);
    for (size_t m = 0; m < t->num_meshes; m++)
        a->first[meshes[m]] = a->num_triangles + t->first_triangle[m];
    for (uint32_t i = 0; i < t->num_triangles; i++)
        a->part[a->num_triangles + i] = t->part[i] == UINT32_MAX ? INDIRECT_NONE : (uint32_t) a->num_parts + t->part[i];
    for (uint32_t i = 0; i < t->num_parts; i++) {
        const uint32_t number = (uint32_t) a->num_parts + i;
        a->joined[number] = number;
        if (!parts[i].closed && open == INDIRECT_NONE)
            open = number;
        if (!parts[i].closed)
            pell_union_join(a->joined, open, number);
    }
    a->num_triangles += t->num_triangles;
    a->num_parts += t->num_parts;
    res = pell_cancelled(ctx) ? PELL_ERR_CANCELLED : PELL_OK;

fail:
    pell_free(ctx, parts);
    return res;
}

static enum pell_result look_at_object(struct apart *a, const uint32_t *meshes, size_t count)
{
    const struct pell_scene *scene = a->in->p.scene;
    struct pell_topology t;
    size_t shown = 0;
    bool many;
    enum pell_result res = PELL_OK;

    for (size_t m = 0; m < count; m++)
        shown += takes_part(scene, &scene->meshes[meshes[m]]);
    many = shown > 1;
    for (size_t m = 0; m < count && !many && res == PELL_OK; m++)
        if (takes_part(scene, &scene->meshes[meshes[m]]))
            res = may_be_many(a->in->ctx, &scene->meshes[meshes[m]], &many);
    if (res != PELL_OK || !many)
        return res;
    res = pell_topology_make(&t, scene, meshes, count);
    if (res != PELL_OK)
        return res;
    if (t.num_parts > 1)
        res = add_parts(a, meshes, &t);
    pell_topology_finish(&t);
    return res;
}

static enum pell_result look_at_objects(struct apart *a)
{
    const struct pell_scene *scene = a->in->p.scene;
    uint32_t *order = pell_alloc_array(a->in->ctx, scene->num_meshes, 2 * sizeof(*order));
    enum pell_result res = PELL_OK;

    if (!order)
        return PELL_ERR_NOMEM;
    pell_scene_objects(scene, order, order + scene->num_meshes);
    for (size_t i = 0, end; i < scene->num_meshes && res == PELL_OK; i = end) {
        for (end = i + 1; end < scene->num_meshes && scene->meshes[order[end]].object == scene->meshes[order[i]].object; end++)
            ;
        res = look_at_object(a, order + i, end - i);
    }
    pell_free(a->in->ctx, order);
    return res;
}

static uint32_t part_at(const struct apart *a, uint32_t mesh, uint32_t triangle)
{
    return mesh < a->in->p.scene->num_meshes && a->first[mesh] != SIZE_MAX ? a->part[a->first[mesh] + triangle] : INDIRECT_NONE;
}

static void meet16(void *arg, int index, int worker)
{
    const struct apart *a = arg;
    const struct pell_indirect *in = a->in;
    const struct pell_scene *scene = in->p.scene;
    const size_t first = (size_t) index * PACKET;
    _Alignas(64) int valid[PACKET];
    struct pell_ray_hit16 r;

    (void) worker;
    indirect_along_normals16(in, first, true, valid, &r);
    for (size_t i = 0; i < PACKET && first + i < in->num_samples; i++) {
        const struct pell_mesh *from = &scene->meshes[in->samples[first + i].mesh];
        const bool same = valid[i] && pell_hit16_meets(scene, &r, (int) i, from->object);
        a->met[first + i] = same ? part_at(a, r.hit.mesh[i], r.hit.triangle[i]) : INDIRECT_NONE;
    }
}

static enum pell_result join_by_chords(struct apart *a, struct pell_pool *pool)
{
    struct pell_indirect *in = a->in;
    const size_t n = in->num_samples;

    a->met = pell_alloc_array(in->ctx, n, sizeof(*a->met));
    in->part = pell_alloc_array(in->ctx, n, sizeof(*in->part));
    if (!a->met || !in->part)
        return PELL_ERR_NOMEM;
    pell_pool_run(pool, (int) ((n + PACKET - 1) / PACKET), meet16, a);
    if (pell_cancelled(in->ctx))
        return PELL_ERR_CANCELLED;
    for (size_t i = 0; i < n; i++) {
        in->part[i] = part_at(a, in->samples[i].mesh, in->samples[i].triangle);
        if (in->part[i] != INDIRECT_NONE && a->met[i] != INDIRECT_NONE)
            pell_union_join(a->joined, in->part[i], a->met[i]);
    }
    for (size_t i = 0; i < n; i++)
        if (in->part[i] != INDIRECT_NONE)
            in->part[i] = pell_union_root(a->joined, in->part[i]);
    return PELL_OK;
}

enum pell_result indirect_apart_make(struct pell_indirect *in, struct pell_pool *pool)
{
    struct pell_context *ctx = in->ctx;
    const size_t num_meshes = in->p.scene->num_meshes;
    struct apart a = { .in = in, .first = pell_alloc_array(ctx, num_meshes, sizeof(*a.first)) };
    enum pell_result res = PELL_ERR_NOMEM;

    if (!a.first)
        return res;
    for (size_t i = 0; i < num_meshes; i++)
        a.first[i] = SIZE_MAX;
    res = look_at_objects(&a);
    if (res == PELL_OK && a.num_parts > 0)
        res = join_by_chords(&a, pool);
    pell_free(ctx, a.first);
    pell_free(ctx, a.part);
    pell_free(ctx, a.joined);
    pell_free(ctx, a.met);
    return res;
}
