/* SPDX-License-Identifier: MIT
 * plane_fit.c - the points that represent the surface of each solid when planes are fitted to it. The fit is in plane_grid.c. */
#include "methods/layered/state.h"

#include "scene/triangle.h"

#include <string.h>

enum { MAX_CUTS = 8, MAX_PARTS = 1 << 24 }; /* parts of a large triangle's side; parts of all triangles */

/* Number of parts per side that makes the parts of a triangle small relative to the neighbourhood. */
static int cuts_of(const struct pell_vec3 at[3], float radius)
{
    float longest = 0.0f;

    for (int k = 0; k < 3; k++)
        longest = fmaxf(longest, vec3_length(vec3_sub(at[(k + 1) % 3], at[k])));
    longest *= 2.0f / radius;
    return longest > 1.0f ? longest < (float) MAX_CUTS ? (int) ceilf(longest) : MAX_CUTS : 1;
}

static size_t count_parts(const struct pell_context *ctx, const struct pell_mesh *mesh, float radius)
{
    size_t count = 0;

    for (uint32_t t = 0; t < mesh->num_triangles && !pell_cancelled_at(ctx, t); t++) {
        struct pell_vec3 at[3];
        int cuts;
        pell_triangle_corners(mesh, t, at);
        cuts = cuts_of(at, radius);
        count += cuts > 1 ? (size_t) (cuts * cuts) : 0;
    }
    return count;
}

/* The centroids of the parts of a triangle, with equal fractions of its weight. */
static void add_parts(const struct pell_mesh *mesh, uint32_t triangle, const struct pell_vec3 at[3], int cuts, float weight,
                      struct layered_cloud *cloud)
{
    for (int i = 0; i < cuts; i++)
        for (int j = 0; j < 2 * (cuts - i) - 1; j++) {
            const float u = ((float) (j / 2) + (j & 1 ? 2.0f / 3.0f : 1.0f / 3.0f)) / (float) cuts;
            const float v = ((float) i + (j & 1 ? 2.0f / 3.0f : 1.0f / 3.0f)) / (float) cuts;
            const struct pell_vec3 p = vec3_mad(vec3_mad(vec3_mul(at[0], 1.0f - u - v), u, at[1]), v, at[2]);
            vec3_store(p, cloud->position + 3 * cloud->count);
            vec3_store(layered_normal_at(mesh, triangle, u, v), cloud->normal + 3 * cloud->count);
            cloud->weight[cloud->count++] = fmaxf(weight / (float) (cuts * cuts), 1e-20f);
        }
}

/* A vertex represents its share of the adjacent triangles. Triangles that are large relative to the neighbourhood are represented by the
 * centroids of their parts instead, so that a coarse mesh gets the same planes as a fine one. */
static void weigh(const struct pell_mesh *mesh, size_t first, bool parts, struct layered_cloud *cloud)
{
    float *weight = cloud->weight + first;

    for (uint32_t i = 0; i < mesh->num_vertices; i++)
        weight[i] = 0.0f;
    for (uint32_t t = 0; t < mesh->num_triangles && !pell_cancelled_at(cloud->ctx, t); t++) {
        struct pell_vec3 at[3];
        float twice_area;
        int cuts;
        pell_triangle_corners(mesh, t, at);
        twice_area = vec3_length(pell_triangle_cross(at));
        cuts = parts ? cuts_of(at, cloud->radius) : 1;
        if (cuts > 1)
            add_parts(mesh, t, at, cuts, twice_area, cloud);
        for (int k = 0; k < 3 && cuts == 1; k++)
            weight[mesh->index[3 * (size_t) t + (size_t) k]] += twice_area * (1.0f / 3.0f);
    }
    for (uint32_t i = 0; i < mesh->num_vertices; i++)
        weight[i] = weight[i] > 1e-20f && weight[i] < 1e20f ? weight[i] : 1e-20f; /* vertices without a triangle, or with large ones only */
}

/* Vertices of all meshes of the solid, and the points that represent it. */
static void fill_cloud(const struct layered_state *st, const struct pell_scene *scene, size_t first, bool parts,
                       struct layered_cloud *cloud)
{
    size_t at = 0;

    cloud->count = cloud->fitted;
    for (size_t i = first; i < scene->num_meshes; i++) {
        const struct pell_mesh *m = &scene->meshes[i];
        if (!layered_same_solid(m, &scene->meshes[first]))
            continue;
        memcpy(cloud->position + 3 * at, m->position, 3 * (size_t) m->num_vertices * sizeof(float));
        memcpy(cloud->normal + 3 * at, m->normal, 3 * (size_t) m->num_vertices * sizeof(float));
        for (size_t k = 0; k < m->num_vertices; k++)
            cloud->weight[at + k] = 1.0f;
        if (st->knobs.planes == LAYERED_BY_AREA)
            weigh(m, at, parts, cloud);
        at += m->num_vertices;
    }
}

/* Planes kept from an earlier frame; the others are fitted. */
static enum pell_result find_planes(struct layered_state *st, const struct pell_scene *scene, size_t first, struct layered_cloud *cloud,
                                    float (*plane)[4])
{
    uint8_t *keep = pell_calloc(st->ctx, cloud->fitted + 1, 1);
    enum pell_result res = PELL_ERR_NOMEM;
    size_t remaining;

    if (!keep)
        return res;
    PELL_TRY(layered_cache_load(st, scene, first, cloud, plane, keep, &remaining));
    cloud->keep = keep;
    if (remaining > 0)
        PELL_TRY(layered_planes_fit(cloud, plane));
    PELL_TRY(layered_cache_store(st, scene, first, cloud, (const float(*)[4]) plane));
    st->fitted += (int64_t) remaining;

fail:
    cloud->keep = NULL;
    pell_free(st->ctx, keep);
    return res;
}

/* All meshes of one solid, whose first is `first`. */
static enum pell_result fit_solid(struct layered_state *st, const struct pell_scene *scene, size_t first)
{
    const struct pell_mesh *solid = &scene->meshes[first];
    struct layered_cloud cloud = { .ctx = st->ctx, .pool = st->pool };
    const float sigma = st->media[solid->material].first;
    float(*plane)[4] = NULL;
    enum pell_result res = PELL_ERR_NOMEM;
    size_t at = 0, most = 0, parts = 0;

    cloud.radius = sigma > 0.0f ? -logf(st->knobs.epsilon) / sigma : INFINITY;
    cloud.radius = cloud.radius < st->size ? cloud.radius : st->size;
    for (size_t i = first; i < scene->num_meshes; i++) {
        cloud.fitted += layered_same_solid(&scene->meshes[i], solid) ? scene->meshes[i].num_vertices : 0;
        if (layered_same_solid(&scene->meshes[i], solid) && st->knobs.planes == LAYERED_BY_AREA && cloud.radius > 0.0f)
            parts += count_parts(st->ctx, &scene->meshes[i], cloud.radius);
    }
    parts = parts <= MAX_PARTS ? parts : 0;
    most = cloud.fitted + parts;
    if (most > UINT32_MAX)
        return pell_error(st->ctx, PELL_ERR_UNSUPPORTED, solid->name, NULL, "layered: an object of %zu vertices", cloud.fitted);
    cloud.position = pell_alloc_array(st->ctx, most + 1, 3 * sizeof(float));
    cloud.normal = pell_alloc_array(st->ctx, most + 1, 3 * sizeof(float));
    cloud.weight = pell_alloc_array(st->ctx, most + 1, sizeof(float));
    plane = pell_alloc_array(st->ctx, cloud.fitted + 1, sizeof(*plane));
    if (!cloud.position || !cloud.normal || !cloud.weight || !plane)
        goto fail;
    fill_cloud(st, scene, first, parts > 0, &cloud);
    if (st->knobs.planes == LAYERED_TANGENT) {
        for (size_t i = 0; i < cloud.fitted; i++) {
            memcpy(plane[i], cloud.normal + 3 * i, 3 * sizeof(float));
            plane[i][3] = 0.0f;
        }
    } else {
        PELL_TRY(find_planes(st, scene, first, &cloud, plane));
        res = PELL_ERR_NOMEM;
    }
    for (size_t i = first; i < scene->num_meshes; i++) {
        const struct pell_mesh *m = &scene->meshes[i];
        if (!layered_same_solid(m, solid))
            continue;
        st->planes[i] = pell_alloc_array(st->ctx, (size_t) m->num_vertices + 1, sizeof(*plane));
        if (!st->planes[i])
            goto fail;
        memcpy(st->planes[i], plane + at, (size_t) m->num_vertices * sizeof(*plane));
        at += m->num_vertices;
    }
    res = PELL_OK;

fail:
    pell_free(st->ctx, plane);
    pell_free(st->ctx, cloud.weight);
    pell_free(st->ctx, cloud.normal);
    pell_free(st->ctx, cloud.position);
    return res;
}

enum pell_result layered_fit(struct layered_state *st, const struct pell_scene *scene)
{
    const double start = pell_seconds();
    enum pell_result res = PELL_ERR_NOMEM;

    st->planes = pell_calloc(st->ctx, scene->num_meshes + 1, sizeof(*st->planes));
    if (!st->planes)
        goto fail;
    st->num_meshes = scene->num_meshes;
    PELL_TRY(layered_cache_begin(st, scene));
    for (size_t i = 0; i < scene->num_meshes; i++)
        if (layered_scatters(scene, &scene->meshes[i]) && !st->planes[i])
            PELL_TRY(fit_solid(st, scene, i));
    st->fit_seconds = pell_seconds() - start;
    return PELL_OK;

fail:
    return res;
}
