/* SPDX-License-Identifier: MIT
 *
 * repeated.c - duplicate triangles: those that coincide with another of their mesh, with the same winding, texture coordinates and colours.
 * Modelling tools leave them behind. A ray hits all of them at once, and an edge that they share seems to have more than two triangles.
 *
 * Such triangles have the same three positions in the same cyclic order, so the half-edges from their lowest position belong to one edge,
 * and are adjacent in the sorted list. In the list of one edge, the third corner distinguishes them.
 */
#include "scene/mesh/topology.h"

#include <string.h>

/* The half-edge of a triangle that starts at its lowest position. */
static bool is_first(const struct pell_topology *t, uint32_t half)
{
    const uint32_t next = pell_half_next(half), start = t->corner[half];

    return start < t->corner[next] && start < t->corner[pell_half_next(next)];
}

static uint32_t third(const struct pell_topology *t, uint32_t half)
{
    return t->corner[pell_half_next(pell_half_next(half))];
}

static size_t mesh_of(const struct pell_topology *t, uint32_t triangle)
{
    size_t low = 0, high = t->num_meshes;

    while (high - low > 1) {
        const size_t middle = (low + high) / 2;
        *(t->first_triangle[middle] <= triangle ? &low : &high) = middle;
    }
    return low;
}

/* Whether two triangles with the same corners, starting at these half-edges, belong to one mesh and look the same. */
static bool alike(const struct pell_topology *t, const struct pell_scene *scene, uint32_t a, uint32_t b)
{
    const size_t m = mesh_of(t, a / 3);
    const struct pell_mesh *mesh = &scene->meshes[t->mesh[m]];
    const size_t first = 3 * (size_t) t->first_triangle[m];

    if (mesh_of(t, b / 3) != m)
        return false;
    for (int k = 0; k < 3; k++, a = pell_half_next(a), b = pell_half_next(b)) {
        const size_t v = mesh->index[a - first], w = mesh->index[b - first];
        if (v != w && mesh->color && memcmp(mesh->color + 4 * v, mesh->color + 4 * w, 4 * sizeof(float)) != 0)
            return false;
        for (int u = 0; u < PELL_UV_SETS && v != w; u++)
            if (mesh->uv[u] && memcmp(mesh->uv[u] + 2 * v, mesh->uv[u] + 2 * w, 2 * sizeof(float)) != 0)
                return false;
    }
    return true;
}

static void drop_marked(struct pell_scene *scene, const struct pell_topology *t, const bool *repeats)
{
    for (size_t m = 0; m < t->num_meshes; m++) {
        struct pell_mesh *mesh = &scene->meshes[t->mesh[m]];
        uint32_t kept = 0;
        for (uint32_t i = 0; i < mesh->num_triangles; i++)
            if (!repeats[t->first_triangle[m] + i])
                memmove(mesh->index + 3 * (size_t) kept++, mesh->index + 3 * (size_t) i, 3 * sizeof(*mesh->index));
        mesh->num_triangles = kept;
    }
}

enum pell_result pell_drop_repeated(struct pell_scene *scene, const struct pell_topology *t, uint32_t *dropped)
{
    /* by third corner: 1 + position in the list of the last triangle */
    uint32_t *seen = pell_calloc(t->ctx, t->num_positions, sizeof(*seen));
    bool *repeats = pell_calloc(t->ctx, t->num_triangles, sizeof(*repeats));
    enum pell_result res = PELL_ERR_NOMEM;

    *dropped = 0;
    if (!seen || !repeats)
        goto fail;
    for (uint32_t e = 0, end, edges = 0; e < t->num_halves && !pell_cancelled_at(t->ctx, edges++); e = end) {
        end = pell_topology_edge(t, e);
        for (uint32_t i = e; i < end; i++) {
            const uint32_t half = t->half[i];
            uint32_t *last;
            if (!is_first(t, half))
                continue;
            last = &seen[third(t, half)];
            if (*last > e && alike(t, scene, t->half[*last - 1], half)) {
                repeats[half / 3] = true;
                ++*dropped;
            } else {
                *last = i + 1;
            }
        }
    }
    res = pell_cancelled(t->ctx) ? PELL_ERR_CANCELLED : PELL_OK;
    if (res == PELL_OK && *dropped)
        drop_marked(scene, t, repeats);

fail:
    pell_free(t->ctx, seen);
    pell_free(t->ctx, repeats);
    return res;
}
