/* SPDX-License-Identifier: MIT
 *
 * thicken.c - gives open surfaces a thickness: a copy of the surface, moved inward along the normals and turned, and a rim between both.
 * Vertices at one position move together, so creases and seams stay closed.
 */
#include "scene/mesh/topology.h"

#include <string.h>

/* Per half-edge: whether its edge has no other triangle. */
static bool *find_border(const struct pell_topology *t)
{
    bool *border = pell_calloc(t->ctx, t->num_triangles, 3 * sizeof(*border));

    for (uint32_t e = 0, end, edges = 0; border && e < t->num_halves && !pell_cancelled_at(t->ctx, edges++); e = end) {
        end = pell_topology_edge(t, e);
        border[t->half[e]] = end - e == 1;
    }
    return border;
}

/* Per position: the unit normal, weighted by the areas of its triangles. */
static float *normals_of_positions(const struct pell_topology *t)
{
    float *sum = pell_calloc(t->ctx, t->num_positions, 3 * sizeof(*sum));

    for (uint32_t h = 0; sum && h < 3 * t->num_triangles && !pell_cancelled_at(t->ctx, h); h++)
        for (int c = 0; c < 3; c++)
            sum[3 * (size_t) t->corner[h] + c] += t->face[3 * (size_t) (h / 3) + c];
    for (size_t i = 0; sum && i < t->num_positions; i++) {
        const float largest = vec3_max_abs(vec3_load(sum + 3 * i));
        vec3_store(largest > 1e-30f ? vec3_normalize(vec3_mul(vec3_load(sum + 3 * i), 1.0f / largest)) : vec3(0, 0, 0), sum + 3 * i);
    }
    return sum;
}

static uint32_t count_border(const bool *border, uint32_t triangles)
{
    uint32_t count = 0;

    for (size_t h = 0; h < 3 * (size_t) triangles; h++)
        count += border[h];
    return count;
}

static struct pell_vec3 position_of(const struct pell_mesh *mesh, uint32_t vertex)
{
    return vec3_load(mesh->position + 3 * (size_t) vertex);
}

/* Writes the turned copy, and for each of the border's half-edges two triangles on vertices of their own. `count`: vertices before. */
static void write_shell(struct pell_mesh *mesh, uint32_t num_border, uint32_t count, uint32_t triangles, bool has_normals)
{
    uint32_t *out = mesh->index + 3 * (size_t) triangles;

    for (uint32_t i = 0; i < triangles; i++, out += 3) {
        const uint32_t *in = mesh->index + 3 * (size_t) i;
        out[0] = in[0] + count;
        out[1] = in[2] + count;
        out[2] = in[1] + count;
    }
    for (uint32_t b = 0; b < num_border; b++, out += 6) {
        const uint32_t v = 2 * count + 4 * b; /* start, end, and below them */
        const struct pell_vec3 along = vec3_sub(position_of(mesh, v), position_of(mesh, v + 1));
        const struct pell_vec3 down = vec3_sub(position_of(mesh, v + 2), position_of(mesh, v + 1));
        const uint32_t quad[6] = { v + 1, v, v + 2, v + 1, v + 2, v + 3 };
        memcpy(out, quad, sizeof(quad));
        for (uint32_t k = 0; k < 4; k++)
            vec3_store(has_normals ? vec3_normalize(vec3_cross(along, down)) : vec3(0, 0, 0), mesh->normal + 3 * (size_t) (v + k));
    }
}

/* `border`: per half-edge of the mesh. */
static enum pell_result thicken_mesh(struct pell_scene *scene, const struct pell_topology *t, size_t m, const float *normal,
                                     const bool *border)
{
    struct pell_context *ctx = scene->ctx;
    struct pell_mesh *mesh = &scene->meshes[t->mesh[m]];
    const uint32_t count = mesh->num_vertices, triangles = mesh->num_triangles, num_border = count_border(border, triangles);
    const uint64_t more = (uint64_t) count + 4 * (uint64_t) num_border, all = 2 * ((uint64_t) triangles + num_border);
    const int64_t most = pell_context_limits(ctx)->triangles;
    const float thickness = mesh->thicken;
    uint32_t *from, *index, at;
    bool has_normals = false;
    enum pell_result res = PELL_ERR_NOMEM;

    if (more + count > UINT32_MAX / 2 || all > UINT32_MAX / 6 || scene->total_triangles + (int64_t) (all - triangles) > most)
        return pell_error(ctx, PELL_ERR_UNSUPPORTED, mesh->name, PELL_RAISE_LIMIT("triangles"),
                          "has %llu triangles with a thickness; %lld are allowed", (unsigned long long) all, (long long) most);
    from = pell_alloc_array(ctx, (size_t) more, sizeof(*from));
    index = pell_alloc_array(ctx, (size_t) all, 3 * sizeof(*index));
    if (!from || !index)
        goto fail;
    for (uint32_t i = 0; i < count; i++)
        from[i] = i;
    at = count;
    for (uint32_t h = 0; h < 3 * triangles; h++) {
        if (!border[h])
            continue;
        from[at] = from[at + 2] = mesh->index[h];
        from[at + 1] = from[at + 3] = mesh->index[pell_half_next(h)];
        at += 4;
    }
    PELL_TRY(pell_mesh_duplicate(scene, t->mesh[m], from, (uint32_t) more));
    mesh = &scene->meshes[t->mesh[m]];
    for (uint32_t i = 0; i < (uint32_t) more; i++) {
        const bool below = i < count || (i - count) % 4 >= 2;
        float *p = mesh->position + 3 * ((size_t) count + i), *n = mesh->normal + 3 * ((size_t) count + i);
        has_normals |= n[0] != 0.0f || n[1] != 0.0f || n[2] != 0.0f;
        if (below)
            vec3_store(vec3_mad(vec3_load(p), -thickness, vec3_load(normal + 3 * (size_t) t->weld[t->first_vertex[m] + from[i]])), p);
        if (i < count)
            vec3_store(vec3_mul(vec3_load(n), -1.0f), n);
        if (i < count && mesh->tangent)
            mesh->tangent[4 * ((size_t) count + i) + 3] *= -1.0f;
    }
    memcpy(index, mesh->index, 3 * (size_t) triangles * sizeof(*index));
    pell_free(ctx, mesh->index);
    mesh->index = index;
    mesh->num_triangles = (uint32_t) all;
    scene->total_triangles += (int64_t) (all - triangles);
    index = NULL;
    write_shell(mesh, num_border, count, triangles, has_normals);

fail:
    pell_free(ctx, index);
    pell_free(ctx, from);
    return res;
}

enum pell_result pell_thicken(struct pell_scene *scene, const struct pell_topology *t)
{
    float *normal = normals_of_positions(t);
    bool *border = find_border(t);
    enum pell_result res = normal && border ? PELL_OK : PELL_ERR_NOMEM;

    for (size_t m = 0; m < t->num_meshes && res == PELL_OK; m++)
        if (scene->meshes[t->mesh[m]].thicken > 0.0f && scene->meshes[t->mesh[m]].num_triangles > 0)
            res = thicken_mesh(scene, t, m, normal, border + 3 * (size_t) t->first_triangle[m]);
    pell_free(scene->ctx, border);
    pell_free(scene->ctx, normal);
    return res == PELL_OK && pell_cancelled(scene->ctx) ? PELL_ERR_CANCELLED : res;
}
