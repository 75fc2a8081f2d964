/* SPDX-License-Identifier: MIT
 *
 * parts.c - separate solids of one object, between which no light passes inside: closed parts that no chord connects. The wall of a hollow
 * belongs to the solid around it, and overlapping parts are one solid. Parts that are not closed are taken to be one solid. Also finds
 * solids that contain other objects.
 */
#include "render/indirect/internal.h"

#include "scene/mesh/topology.h"
#include "scene/triangle.h"

#define PACKET 16

struct part_search {
    struct pell_indirect *in;
    size_t *first;    /* first triangle of each mesh in `part`; SIZE_MAX: its object has one part */
    uint32_t *part;   /* per triangle */
    uint32_t *joined; /* per part: union-find parent, for pell_union_root */
    size_t num_triangles, num_parts;
    uint32_t *hit_part; /* per sample: part that the inward ray hits, or INDIRECT_NONE */
};

static bool is_translucent(const struct pell_scene *scene, const struct pell_mesh *mesh)
{
    return indirect_shown(scene, mesh) && !scene->materials[mesh->material].opaque;
}

/* Sets *many if the triangles are not all connected by shared vertices, which is rare. */
static enum pell_result has_components(struct pell_context *ctx, const struct pell_mesh *mesh, bool *many)
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

static bool make_room(struct part_search *a)
{
    const struct pell_scene *scene = a->in->p.scene;
    size_t triangles = 0;

    for (size_t i = 0; i < scene->num_meshes; i++)
        triangles += scene->meshes[i].num_triangles;
    a->part = pell_alloc_array(a->in->ctx, triangles, sizeof(*a->part));
    a->joined = pell_alloc_array(a->in->ctx, triangles, sizeof(*a->joined)); /* upper bound of the part_index of parts */
    return a->part && a->joined;
}

/* Appends the parts of an object; those that are not closed are joined. */
static enum pell_result add_parts(struct part_search *a, const uint32_t *meshes, const struct pell_topology *t)
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
        const uint32_t part_index = (uint32_t) a->num_parts + i;
        a->joined[part_index] = part_index;
        if (!parts[i].closed && open == INDIRECT_NONE)
            open = part_index;
        if (!parts[i].closed)
            pell_union_join(a->joined, open, part_index);
    }
    a->num_triangles += t->num_triangles;
    a->num_parts += t->num_parts;
    res = pell_cancelled(ctx) ? PELL_ERR_CANCELLED : PELL_OK;

fail:
    pell_free(ctx, parts);
    return res;
}

static enum pell_result add_object(struct part_search *a, const uint32_t *meshes, size_t count)
{
    const struct pell_scene *scene = a->in->p.scene;
    struct pell_topology t;
    size_t meshes_shown = 0;
    bool many;
    enum pell_result res = PELL_OK;

    for (size_t m = 0; m < count; m++)
        meshes_shown += is_translucent(scene, &scene->meshes[meshes[m]]);
    many = meshes_shown > 1;
    for (size_t m = 0; m < count && !many && res == PELL_OK; m++)
        if (is_translucent(scene, &scene->meshes[meshes[m]]))
            res = has_components(a->in->ctx, &scene->meshes[meshes[m]], &many);
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

static enum pell_result add_objects(struct part_search *a)
{
    const struct pell_scene *scene = a->in->p.scene;
    uint32_t *order = pell_alloc_array(a->in->ctx, scene->num_meshes, 2 * sizeof(*order));
    enum pell_result res = PELL_OK;

    if (!order)
        return PELL_ERR_NOMEM;
    pell_scene_assemblies(scene, order, order + scene->num_meshes);
    for (size_t i = 0, end; i < scene->num_meshes && res == PELL_OK; i = end) {
        end = pell_assembly_end(scene, order, i);
        res = add_object(a, order + i, end - i);
    }
    pell_free(a->in->ctx, order);
    return res;
}

static uint32_t part_at(const struct part_search *a, uint32_t mesh, uint32_t triangle)
{
    return mesh < a->in->p.scene->num_meshes && a->first[mesh] != SIZE_MAX ? a->part[a->first[mesh] + triangle] : INDIRECT_NONE;
}

static void trace16(void *arg, int index, int worker)
{
    const struct part_search *a = arg;
    const struct pell_indirect *in = a->in;
    const struct pell_scene *scene = in->p.scene;
    const size_t first = (size_t) index * PACKET;
    _Alignas(64) int valid[PACKET];
    struct pell_ray_hit16 r;

    (void) worker;
    indirect_along_normals16(in, first, true, valid, &r);
    for (size_t i = 0; i < PACKET && first + i < in->num_samples; i++) {
        const struct pell_mesh *from = &scene->meshes[in->samples[first + i].mesh];
        const bool same = valid[i] && pell_hit16_is_object(scene, &r, (int) i, from->object);
        a->hit_part[first + i] = same ? part_at(a, r.hit.mesh[i], r.hit.triangle[i]) : INDIRECT_NONE;
    }
}

static enum pell_result join_by_chords(struct part_search *a, struct pell_pool *pool)
{
    struct pell_indirect *in = a->in;
    const size_t n = in->num_samples;

    a->hit_part = pell_alloc_array(in->ctx, n, sizeof(*a->hit_part));
    in->part = pell_alloc_array(in->ctx, n, sizeof(*in->part));
    if (!a->hit_part || !in->part)
        return PELL_ERR_NOMEM;
    pell_pool_run(pool, (int) ((n + PACKET - 1) / PACKET), trace16, a);
    if (pell_cancelled(in->ctx))
        return PELL_ERR_CANCELLED;
    for (size_t i = 0; i < n; i++) {
        in->part[i] = part_at(a, in->samples[i].mesh, in->samples[i].triangle);
        if (in->part[i] != INDIRECT_NONE && a->hit_part[i] != INDIRECT_NONE)
            pell_union_join(a->joined, in->part[i], a->hit_part[i]);
    }
    for (size_t i = 0; i < n; i++)
        if (in->part[i] != INDIRECT_NONE)
            in->part[i] = pell_union_root(a->joined, in->part[i]);
    return PELL_OK;
}

enum pell_result indirect_parts_make(struct pell_indirect *in, struct pell_pool *pool)
{
    struct pell_context *ctx = in->ctx;
    const size_t num_meshes = in->p.scene->num_meshes;
    struct part_search a = { .in = in, .first = pell_alloc_array(ctx, num_meshes, sizeof(*a.first)) };
    enum pell_result res = PELL_ERR_NOMEM;

    if (!a.first)
        return res;
    for (size_t i = 0; i < num_meshes; i++)
        a.first[i] = SIZE_MAX;
    res = add_objects(&a);
    if (res == PELL_OK && a.num_parts > 0)
        res = join_by_chords(&a, pool);
    pell_free(ctx, a.first);
    pell_free(ctx, a.part);
    pell_free(ctx, a.joined);
    pell_free(ctx, a.hit_part);
    return res;
}

/* --- Objects inside others ---------------------------------------------------------------------------------------------------- */

/* Whether most of a mesh is inside an object: the rays along its normals hit the inner side of that object first. */
static bool is_inside(const struct pell_indirect *in, const struct pell_mesh *m, int object)
{
    const struct pell_scene *scene = in->p.scene;
    _Alignas(64) int valid[16];
    struct pell_ray_hit16 r;
    int inside = 0, count = 0;

    memset(&r, 0, sizeof(r));
    for (int i = 0; i < 16; i++) {
        const uint32_t t = (uint32_t) ((uint64_t) i * m->num_triangles / 16);
        struct pell_vec3 p[3], n, at;
        pell_triangle_corners(m, t, p);
        n = vec3_normalize(pell_triangle_cross(p));
        at = vec3_mul(vec3_add(p[0], vec3_add(p[1], p[2])), 1.0f / 3.0f);
        valid[i] = vec3_dot(n, n) > 0.5f ? -1 : 0;
        count += valid[i] != 0;
        pell_ray16_set(&r.ray, i, vec3_mad(at, indirect_ray_offset(at, 0.0f), n), n, INFINITY);
        r.hit.mesh[i] = PELL_NO_HIT;
    }
    pell_rays_closest16(in->p.rays, valid, false, &r);
    for (int i = 0; i < 16; i++)
        inside += valid[i] && pell_hit16_inside(scene, &r, i, object);
    return 2 * inside > count;
}

bool indirect_contains_another(const struct pell_indirect *in, const struct indirect_sample *of)
{
    const struct pell_scene *scene = in->p.scene;
    const int object = pell_mesh_assembly(&scene->meshes[of->mesh]);
    bool holds = false;

    for (size_t i = 0; i < scene->num_meshes && !holds; i++) {
        const struct pell_mesh *m = &scene->meshes[i];
        if (m->num_triangles > 0 && (pell_mesh_assembly(m) != object || in->same[m->material] != of->medium))
            holds = is_inside(in, m, object);
    }
    return holds;
}
