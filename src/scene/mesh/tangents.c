/* SPDX-License-Identifier: MIT
 * tangents.c - tangents for normal maps, along the u axis of a UV set.
 *
 * Each corner adds its triangle's dP/du, made perpendicular to the vertex normal and weighted by the corner's angle, to all corners of
 * equal position, normal, uv and handedness (the grouping of Mikkelsen 2008, "Simulation of Wrinkled Surfaces Revisited", section 2.4).
 * Where both handednesses meet at one vertex, it is split. v runs down and a normal map's green axis up, so the bitangent is -dP/dv. */
#include "scene/mesh/topology.h"

#include <string.h>

struct gradient {
    struct pell_vec3 tangent; /* unit, along dP/du */
    int side;                 /* 0: w = +1, 1: w = -1, -1: no gradient */
};

static struct gradient gradient_of(const struct pell_mesh *mesh, int uv, uint32_t triangle)
{
    const uint32_t *v = mesh->index + 3 * (size_t) triangle;
    double e[2][3], d[2][2], t[3], length = 0.0, det;
    struct gradient g = { .side = -1 };

    for (int k = 0; k < 2; k++) {
        for (int c = 0; c < 3; c++)
            e[k][c] = (double) mesh->position[3 * (size_t) v[k + 1] + c] - mesh->position[3 * (size_t) v[0] + c];
        for (int c = 0; c < 2; c++)
            d[k][c] = (double) mesh->uv[uv][2 * (size_t) v[k + 1] + c] - mesh->uv[uv][2 * (size_t) v[0] + c];
    }
    det = d[0][0] * d[1][1] - d[1][0] * d[0][1];
    for (int c = 0; c < 3; c++) {
        t[c] = (det < 0.0 ? -1.0 : 1.0) * (d[1][1] * e[0][c] - d[0][1] * e[1][c]);
        length += t[c] * t[c];
    }
    length = sqrt(length);
    if (det == 0.0 || !(length > 0.0) || !isfinite(length))
        return g;
    g.tangent = vec3((float) (t[0] / length), (float) (t[1] / length), (float) (t[2] / length));
    g.side = det < 0.0 ? 0 : 1;
    return g;
}

static struct pell_vec3 project(struct pell_vec3 a, struct pell_vec3 n)
{
    return vec3_normalize(vec3_mad(a, -vec3_dot(a, n), n));
}

/* For each vertex the first one that has the same position, normal and uv. */
static enum pell_result find_twins(struct pell_context *ctx, const struct pell_mesh *mesh, int uv, uint32_t *twin)
{
    const size_t count = mesh->num_vertices;
    uint32_t *keys = pell_alloc_array(ctx, count, 8 * sizeof(*keys)), *order = pell_alloc_array(ctx, count, sizeof(*order));
    uint32_t *scratch = pell_alloc_array(ctx, count, sizeof(*scratch));
    enum pell_result res = PELL_ERR_NOMEM;

    if (keys && order && scratch) {
        const uint32_t *sorted;
        for (size_t i = 0; i < count && !pell_cancelled_at(ctx, i); i++) {
            memcpy(keys + 8 * i, mesh->position + 3 * i, 3 * sizeof(float));
            memcpy(keys + 8 * i + 3, mesh->normal + 3 * i, 3 * sizeof(float));
            memcpy(keys + 8 * i + 6, mesh->uv[uv] + 2 * i, 2 * sizeof(float));
        }
        sorted = pell_sort_keys(ctx, keys, 8, order, scratch, mesh->num_vertices);
        for (size_t i = 0; i < count && !pell_cancelled_at(ctx, i); i++) {
            const bool same = i && memcmp(keys + 8 * (size_t) sorted[i], keys + 8 * (size_t) sorted[i - 1], 8 * sizeof(*keys)) == 0;
            twin[sorted[i]] = same ? twin[sorted[i - 1]] : sorted[i];
        }
        res = pell_cancelled(ctx) ? PELL_ERR_CANCELLED : PELL_OK;
    }
    pell_free(ctx, keys);
    pell_free(ctx, order);
    pell_free(ctx, scratch);
    return res;
}

static void add_up(const struct pell_context *ctx, const struct pell_mesh *mesh, int uv, const uint32_t *twin, float *sum)
{
    for (uint32_t i = 0; i < mesh->num_triangles && !pell_cancelled_at(ctx, i); i++) {
        const struct gradient g = gradient_of(mesh, uv, i);
        for (int k = 0; k < 3 && g.side >= 0; k++) {
            const uint32_t *v = mesh->index + 3 * (size_t) i;
            const struct pell_vec3 n = vec3_load(mesh->normal + 3 * (size_t) v[k]), p = vec3_load(mesh->position + 3 * (size_t) v[k]);
            const struct pell_vec3 a = project(vec3_sub(vec3_load(mesh->position + 3 * (size_t) v[(k + 1) % 3]), p), n);
            const struct pell_vec3 b = project(vec3_sub(vec3_load(mesh->position + 3 * (size_t) v[(k + 2) % 3]), p), n);
            const float angle = atan2f(vec3_length(vec3_cross(a, b)), vec3_dot(a, b));
            float *to = sum + 6 * (size_t) twin[v[k]] + 3 * g.side;
            vec3_store(vec3_mad(vec3_load(to), angle, project(g.tangent, n)), to);
        }
    }
}

static void write_tangent(float *to, const float *sum, const float *normal, float w)
{
    const struct pell_vec3 n = vec3_load(normal);
    struct pell_vec3 t = project(vec3_load(sum), n), b;

    if (!(vec3_dot(t, t) > 0.5f))
        vec3_basis(n, &t, &b);
    vec3_store(t, to);
    to[3] = w;
}

/* The side of each vertex (2: none) and, if it needs both, the index of its copy, counted from 1. Returns the number of copies. */
static uint32_t find_splits(const struct pell_context *ctx, const struct pell_mesh *mesh, int uv, uint8_t *side, uint32_t *copy)
{
    uint32_t copies = 0;

    memset(side, 2, mesh->num_vertices);
    for (uint32_t i = 0; i < mesh->num_triangles && !pell_cancelled_at(ctx, i); i++) {
        const int s = gradient_of(mesh, uv, i).side;
        for (int k = 0; k < 3 && s >= 0; k++) {
            const uint32_t v = mesh->index[3 * (size_t) i + k];
            if (side[v] == 2)
                side[v] = (uint8_t) s;
            else if (side[v] != s && !copy[v])
                copy[v] = ++copies;
        }
    }
    return copies;
}

enum pell_result pell_make_tangents(struct pell_scene *scene, size_t index, int uv)
{
    struct pell_context *ctx = scene->ctx;
    struct pell_mesh *mesh = &scene->meshes[index];
    const uint32_t count = mesh->num_vertices;
    uint32_t *twin = pell_alloc_array(ctx, count, sizeof(*twin)), *copy = pell_calloc(ctx, count, sizeof(*copy)), *from = NULL, copies;
    uint8_t *side = pell_alloc(ctx, count); /* side of the vertex itself; its copy, if any, has the other */
    float *sum = pell_calloc(ctx, count, 6 * sizeof(*sum)), *tangent;
    enum pell_result res = PELL_ERR_NOMEM;

    if (!twin || !copy || !side || !sum)
        goto fail;
    PELL_TRY(find_twins(ctx, mesh, uv, twin));
    add_up(ctx, mesh, uv, twin, sum);
    copies = find_splits(ctx, mesh, uv, side, copy);
    if (pell_cancelled(ctx)) {
        res = PELL_ERR_CANCELLED;
        goto fail;
    }
    from = pell_alloc_array(ctx, copies, sizeof(*from));
    tangent = pell_alloc_array(ctx, (size_t) count + copies, 4 * sizeof(*tangent));
    if (!from || !tangent) {
        pell_free(ctx, tangent);
        res = PELL_ERR_NOMEM;
        goto fail;
    }
    for (uint32_t v = 0; v < count; v++) {
        const int s = side[v] == 1;
        const float *n = mesh->normal + 3 * (size_t) v, *both = sum + 6 * (size_t) twin[v];
        write_tangent(tangent + 4 * (size_t) v, both + 3 * s, n, s ? -1.0f : 1.0f);
        if (copy[v]) {
            from[copy[v] - 1] = v;
            write_tangent(tangent + 4 * ((size_t) count + copy[v] - 1), both + 3 * !s, n, s ? 1.0f : -1.0f);
        }
    }
    if (copies) {
        /* A triangle's gradient is the same for a vertex and its copy, so indices may change during the loop. */
        res = pell_mesh_duplicate(scene, index, from, copies);
        for (uint32_t i = 0; res == PELL_OK && i < mesh->num_triangles; i++) {
            const int s = gradient_of(mesh, uv, i).side;
            for (int k = 0; k < 3 && s >= 0; k++) {
                uint32_t *v = mesh->index + 3 * (size_t) i + k;
                if (copy[*v] && side[*v] != s)
                    *v = count + copy[*v] - 1;
            }
        }
        if (res != PELL_OK) {
            pell_free(ctx, tangent);
            goto fail;
        }
    }
    mesh->tangent = tangent;
    res = PELL_OK;

fail:
    pell_free(ctx, twin);
    pell_free(ctx, copy);
    pell_free(ctx, side);
    pell_free(ctx, sum);
    pell_free(ctx, from);
    return res;
}
