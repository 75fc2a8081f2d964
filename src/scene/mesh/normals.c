/* SPDX-License-Identifier: MIT
 * normals.c - vertex normals where a file has none: face normals weighted by area and angle over equal positions.
 *
 * The corners around a position are grouped: two faces that share an edge are in one group if they meet at less than 60 degrees.
 * A cube keeps its flat faces, a scan or a sphere becomes smooth, however the file splits or shares its vertices. Flat meshes
 * (pell_mesh.flat) have a crease at every edge. */
#include "scene/mesh/topology.h"

#include <string.h>

#define COS_CREASE 0.5f
#define COS_SAME 0.9999f  /* 0.8 degrees */
#define COS_BENT 0.9994f  /* 2 degrees */
#define COS_FACETS 0.906f /* 25 degrees */
#define FACETED 0.9       /* fraction of an object's triangles that have their own normals */
#define FEWEST_ROUND 60   /* edges; most low polyhedra are meant to have flat faces */
#define COPY 0x80000000u  /* marks the index of a copy among vertex indices, which are below 2^31 */

struct normals {
    struct pell_scene *scene;
    const struct pell_topology *t;
    uint32_t *group; /* per corner (half-edge that starts there): union-find, then the group's id; UINT32_MAX: degenerate triangle */
    uint32_t num_groups;
    float *sum; /* xyz per group, unit after `add_up` */
    bool *flat; /* per triangle: pell_mesh.flat; NULL: none is */
};

static struct pell_vec3 unit_normal(const struct pell_topology *t, uint32_t triangle)
{
    return vec3_normalize(vec3_load(t->face + 3 * (size_t) triangle));
}

/* `a` and `b`: half-edges of an edge's two triangles. */
static bool smooth(const struct normals *n, uint32_t a, uint32_t b)
{
    const bool flat = n->flat && (n->flat[a / 3] || n->flat[b / 3]);

    return vec3_dot(unit_normal(n->t, a / 3), unit_normal(n->t, b / 3)) > (flat ? COS_SAME : COS_CREASE);
}

static enum pell_result mark_flat(struct normals *n)
{
    const struct pell_topology *t = n->t;
    bool any = false;

    for (size_t m = 0; m < t->num_meshes; m++)
        any |= n->scene->meshes[t->mesh[m]].flat;
    if (!any)
        return PELL_OK;
    n->flat = pell_calloc(n->scene->ctx, t->num_triangles, sizeof(*n->flat));
    if (!n->flat)
        return PELL_ERR_NOMEM;
    for (size_t m = 0; m < t->num_meshes; m++)
        memset(n->flat + t->first_triangle[m], n->scene->meshes[t->mesh[m]].flat, t->first_triangle[m + 1] - t->first_triangle[m]);
    return PELL_OK;
}

static void find_groups(struct normals *n)
{
    const struct pell_topology *t = n->t;
    uint32_t edges = 0;

    for (uint32_t i = 0; i < 3 * t->num_triangles && !pell_cancelled_at(n->scene->ctx, i); i++)
        n->group[i] = t->part[i / 3] == UINT32_MAX ? UINT32_MAX : i;
    for (uint32_t e = 0, end; e < t->num_halves; e = end) {
        end = pell_topology_edge(t, e);
        if (pell_cancelled_at(n->scene->ctx, edges++))
            return;
        for (uint32_t i = e; i + 1 < end; i++) {
            const uint32_t a = t->half[i], b = t->half[i + 1];
            if (pell_half_start(t, a) == pell_half_start(t, b) || !smooth(n, a, b))
                continue;
            pell_union_join(n->group, a, pell_half_next(b));
            pell_union_join(n->group, pell_half_next(a), b);
        }
    }
    /* Roots have the lowest number of their group. */
    for (uint32_t i = 0; i < 3 * t->num_triangles && !pell_cancelled_at(n->scene->ctx, i); i++)
        if (n->group[i] != UINT32_MAX)
            n->group[i] = pell_union_root(n->group, i);
    n->num_groups = 0;
    for (uint32_t i = 0; i < 3 * t->num_triangles && !pell_cancelled_at(n->scene->ctx, i); i++)
        if (n->group[i] != UINT32_MAX)
            n->group[i] = n->group[i] == i ? n->num_groups++ : n->group[n->group[i]];
}

/* Adds each face's cross product (which carries its area) times the angle of the corner to the corner's group. */
static void add_up(struct normals *n)
{
    const struct pell_topology *t = n->t;
    const float unit = t->scale > 0.0 ? (float) (1.0 / t->scale) : 1.0f;

    for (size_t m = 0; m < t->num_meshes; m++) {
        const struct pell_mesh *mesh = &n->scene->meshes[t->mesh[m]];
        for (uint32_t i = 0; i < mesh->num_triangles; i++) {
            const size_t tri = (size_t) t->first_triangle[m] + i;
            struct pell_vec3 p[3];
            if (pell_cancelled_at(n->scene->ctx, i))
                return;
            for (int k = 0; k < 3; k++)
                p[k] = vec3_mul(vec3_load(mesh->position + 3 * (size_t) mesh->index[3 * (size_t) i + k]), unit);
            for (int k = 0; k < 3 && n->group[3 * tri] != UINT32_MAX; k++) {
                const struct pell_vec3 a = vec3_sub(p[(k + 1) % 3], p[k]), b = vec3_sub(p[(k + 2) % 3], p[k]);
                const float angle = atan2f(vec3_length(vec3_cross(a, b)), vec3_dot(a, b));
                float *sum = n->sum + 3 * (size_t) n->group[3 * tri + k];
                for (int c = 0; c < 3; c++)
                    sum[c] += angle * t->face[3 * tri + c];
            }
        }
    }
    for (uint32_t g = 0; g < n->num_groups && !pell_cancelled_at(n->scene->ctx, g); g++) {
        /* Long, thin objects have tiny cross products: scale them to one before squaring. */
        float *s = n->sum + 3 * (size_t) g;
        const float largest = vec3_max_abs(vec3_load(s));
        vec3_store(largest > 1e-30f ? vec3_normalize(vec3_mul(vec3_load(s), 1.0f / largest)) : vec3(0, 0, 1), s);
    }
}

/* The corners in the order of their groups: a counting sort. */
static enum pell_result sort_corners(struct normals *n, uint32_t **sorted, uint32_t *count)
{
    struct pell_context *ctx = n->scene->ctx;
    const uint32_t corners = 3 * n->t->num_triangles;
    uint32_t *start = pell_calloc(ctx, (size_t) n->num_groups + 1, sizeof(*start));

    *count = 0;
    *sorted = pell_alloc_array(ctx, corners, sizeof(**sorted));
    if (!start || !*sorted) {
        pell_free(ctx, start);
        return PELL_ERR_NOMEM;
    }
    for (uint32_t i = 0; i < corners && !pell_cancelled_at(ctx, i); i++)
        if (n->group[i] != UINT32_MAX) {
            start[n->group[i] + 1]++;
            ++*count;
        }
    for (uint32_t g = 0; g < n->num_groups; g++)
        start[g + 1] += start[g];
    for (uint32_t i = 0; i < corners && !pell_cancelled_at(ctx, i); i++)
        if (n->group[i] != UINT32_MAX)
            (*sorted)[start[n->group[i]]++] = i;
    pell_free(ctx, start);
    return pell_cancelled(ctx) ? PELL_ERR_CANCELLED : PELL_OK;
}

/* Restores the indices before copies were numbered. */
static void restore_indices(struct normals *n, const uint32_t *from)
{
    const struct pell_topology *t = n->t;

    for (size_t m = 0; m < t->num_meshes; m++) {
        struct pell_mesh *mesh = &n->scene->meshes[t->mesh[m]];
        for (size_t i = 0; i < 3 * (size_t) mesh->num_triangles; i++)
            if (mesh->index[i] & COPY)
                mesh->index[i] = from[mesh->index[i] & ~COPY];
    }
}

/* Meshes without normals: one vertex per group; the first group keeps the vertex, the others get copies at the mesh's end. `wanted` marks
 * the object's meshes. */
static enum pell_result assign(struct normals *n, const bool *wanted)
{
    const struct pell_topology *t = n->t;
    struct pell_context *ctx = n->scene->ctx;
    uint32_t *sorted = NULL, *stamp = NULL, *slot = NULL, *from = NULL, *mesh_of = NULL, count = 0;
    uint32_t copies = 0, *first_copy = NULL;
    float *normal = NULL;
    enum pell_result res = PELL_ERR_NOMEM;

    stamp = pell_calloc(ctx, t->num_vertices, sizeof(*stamp)); /* group + 1 in which the vertex was last seen; 0: never */
    slot = pell_alloc_array(ctx, t->num_vertices, sizeof(*slot));
    mesh_of = pell_alloc_array(ctx, t->num_triangles, sizeof(*mesh_of));
    first_copy = pell_calloc(ctx, t->num_meshes + 1, sizeof(*first_copy));
    if (!stamp || !slot || !mesh_of || !first_copy)
        goto fail;
    PELL_TRY(sort_corners(n, &sorted, &count));
    for (size_t m = 0; m < t->num_meshes; m++)
        for (uint32_t i = t->first_triangle[m]; i < t->first_triangle[m + 1] && !pell_cancelled_at(ctx, i); i++)
            mesh_of[i] = (uint32_t) m;

    if (pell_cancelled(ctx)) {
        res = PELL_ERR_CANCELLED;
        goto fail;
    }
    /* First pass: count the copies of each mesh. */
    for (uint32_t i = 0; i < count && !pell_cancelled_at(ctx, i); i++) {
        const uint32_t m = mesh_of[sorted[i] / 3], group = n->group[sorted[i]];
        const struct pell_mesh *mesh = &n->scene->meshes[t->mesh[m]];
        const uint32_t v = t->first_vertex[m] + mesh->index[sorted[i] - 3 * t->first_triangle[m]];
        if (!wanted[m] || stamp[v] == group + 1)
            continue;
        first_copy[m + 1] += stamp[v] != 0;
        stamp[v] = group + 1;
    }
    for (size_t m = 0; m < t->num_meshes; m++)
        first_copy[m + 1] += first_copy[m];
    copies = first_copy[t->num_meshes];
    from = pell_alloc_array(ctx, copies, sizeof(*from));
    normal = pell_alloc_array(ctx, copies, 3 * sizeof(*normal));
    if (!from || !normal) {
        res = PELL_ERR_NOMEM;
        goto fail;
    }
    if (pell_cancelled(ctx)) {
        res = PELL_ERR_CANCELLED;
        goto fail;
    }
    memset(stamp, 0, t->num_vertices * sizeof(*stamp));

    /* Second pass: assign copies and write normals. `first_copy` advances with each. */
    for (uint32_t i = 0; i < count; i++) {
        const uint32_t m = mesh_of[sorted[i] / 3], group = n->group[sorted[i]];
        struct pell_mesh *mesh = &n->scene->meshes[t->mesh[m]];
        uint32_t *index = &mesh->index[sorted[i] - 3 * t->first_triangle[m]];
        const uint32_t v = t->first_vertex[m] + *index;
        if (pell_cancelled_at(ctx, i)) {
            restore_indices(n, from);
            res = PELL_ERR_CANCELLED;
            goto fail;
        }
        if (!wanted[m])
            continue;
        if (stamp[v] == 0) {
            memcpy(mesh->normal + 3 * (size_t) *index, n->sum + 3 * (size_t) group, 3 * sizeof(float));
            slot[v] = *index;
        } else if (stamp[v] != group + 1) {
            const uint32_t copy = first_copy[m]++;
            from[copy] = *index;
            memcpy(normal + 3 * (size_t) copy, n->sum + 3 * (size_t) group, 3 * sizeof(float));
            slot[v] = COPY | copy;
        }
        stamp[v] = group + 1;
        *index = slot[v];
    }
    /* After the pass first_copy[m] is where mesh m's copies end, and m + 1's begin. */
    for (size_t m = t->num_meshes; m-- > 0;) {
        const uint32_t first = m ? first_copy[m - 1] : 0, more = first_copy[m] - first;
        struct pell_mesh *mesh = &n->scene->meshes[t->mesh[m]];
        const uint32_t old = mesh->num_vertices;
        if (!more)
            continue;
        PELL_TRY(pell_mesh_duplicate(n->scene, t->mesh[m], from + first, more));
        mesh = &n->scene->meshes[t->mesh[m]];
        memcpy(mesh->normal + 3 * (size_t) old, normal + 3 * (size_t) first, (size_t) more * 3 * sizeof(float));
        for (size_t i = 0; i < 3 * (size_t) mesh->num_triangles; i++)
            if (mesh->index[i] & COPY)
                mesh->index[i] = old + (mesh->index[i] & ~COPY) - first;
    }
    res = PELL_OK;

fail:
    pell_free(ctx, sorted);
    pell_free(ctx, stamp);
    pell_free(ctx, slot);
    pell_free(ctx, mesh_of);
    pell_free(ctx, first_copy);
    pell_free(ctx, from);
    pell_free(ctx, normal);
    return res;
}

static bool is_zero(const float *v)
{
    return v[0] == 0.0f && v[1] == 0.0f && v[2] == 0.0f;
}

/* Vertices without a normal get that of the first of their groups; those that only degenerate triangles use get an arbitrary one. */
static void fill_gaps(struct normals *n)
{
    const struct pell_topology *t = n->t;

    for (size_t m = 0; m < t->num_meshes; m++) {
        struct pell_mesh *mesh = &n->scene->meshes[t->mesh[m]];
        for (size_t i = 0; i < 3 * (size_t) mesh->num_triangles && !pell_cancelled_at(n->scene->ctx, i); i++) {
            const uint32_t group = n->group[3 * (size_t) t->first_triangle[m] + i];
            float *v = mesh->normal + 3 * (size_t) mesh->index[i];
            if (group != UINT32_MAX && is_zero(v))
                memcpy(v, n->sum + 3 * (size_t) group, 3 * sizeof(float));
        }
        for (uint32_t i = 0; i < mesh->num_vertices && !pell_cancelled_at(n->scene->ctx, i); i++)
            if (is_zero(mesh->normal + 3 * (size_t) i))
                vec3_store(vec3(0, 0, 1), mesh->normal + 3 * (size_t) i);
    }
}

/* Whether the three normals of a triangle are the face normal. */
static bool is_flat(const struct pell_scene *scene, const struct pell_topology *t, size_t m, uint32_t i)
{
    const struct pell_mesh *mesh = &scene->meshes[t->mesh[m]];
    const struct pell_vec3 face = vec3_normalize(vec3_load(t->face + 3 * ((size_t) t->first_triangle[m] + i)));
    bool flat = true;

    for (int k = 0; k < 3; k++)
        flat &= vec3_dot(face, vec3_normalize(vec3_load(mesh->normal + 3 * (size_t) mesh->index[3 * (size_t) i + k]))) > COS_SAME;
    return flat;
}

bool pell_is_faceted(const struct pell_scene *scene, const struct pell_topology *t)
{
    const double most = t->num_degenerate + (1.0 - FACETED) * (double) (t->num_triangles - t->num_degenerate);
    uint32_t others = 0, edges = 0, round = 0;

    for (size_t m = 0; m < t->num_meshes; m++)
        for (uint32_t i = 0; i < scene->meshes[t->mesh[m]].num_triangles && !pell_cancelled_at(scene->ctx, i); i++) {
            others += !is_flat(scene, t, m, i);
            if (others > most)
                return false;
        }
    for (uint32_t e = 0, end; e < t->num_halves && !pell_cancelled_at(scene->ctx, edges); e = end, edges++) {
        struct pell_vec3 a, b;
        end = pell_topology_edge(t, e);
        a = unit_normal(t, t->half[e] / 3);
        b = unit_normal(t, t->half[end - 1] / 3);
        round += end - e == 2 && vec3_dot(a, b) > COS_CREASE && vec3_dot(a, b) < COS_BENT;
    }
    return round > FEWEST_ROUND && 2 * (uint64_t) round > edges;
}

bool pell_smooths_facets(const struct pell_scene *scene, const struct pell_topology *t)
{
    uint32_t bent = 0, facets = 0, edges = 0;

    for (size_t m = 0; m < t->num_meshes; m++) {
        const struct pell_mesh *mesh = &scene->meshes[t->mesh[m]];
        if (mesh->flat || mesh->num_vertices == 0 || !is_zero(mesh->normal))
            return false;
    }
    for (uint32_t e = 0, end; e < t->num_halves && !pell_cancelled_at(scene->ctx, edges++); e = end) {
        float cosine;
        end = pell_topology_edge(t, e);
        cosine = vec3_dot(unit_normal(t, t->half[e] / 3), unit_normal(t, t->half[end - 1] / 3));
        bent += cosine < COS_SAME;
        facets += cosine > COS_CREASE && cosine < COS_FACETS;
    }
    return facets >= 6 && 2 * (uint64_t) facets > bent;
}

enum pell_result pell_make_normals(struct pell_scene *scene, const struct pell_topology *t)
{
    struct normals n = { .scene = scene, .t = t };
    bool *wanted = pell_calloc(scene->ctx, t->num_meshes, sizeof(*wanted)), any_mesh = false, any_gap = false;
    enum pell_result res = PELL_ERR_NOMEM;

    if (!wanted)
        return PELL_ERR_NOMEM;
    for (size_t m = 0; m < t->num_meshes; m++) {
        const struct pell_mesh *mesh = &scene->meshes[t->mesh[m]];
        uint32_t zeros = 0;
        for (uint32_t i = 0; i < mesh->num_vertices && !pell_cancelled_at(scene->ctx, i); i++)
            zeros += is_zero(mesh->normal + 3 * (size_t) i);
        wanted[m] = zeros == mesh->num_vertices && mesh->num_vertices > 0;
        any_mesh |= wanted[m];
        any_gap |= zeros > 0;
    }
    if (!any_gap || pell_cancelled(scene->ctx)) {
        res = pell_cancelled(scene->ctx) ? PELL_ERR_CANCELLED : PELL_OK;
        goto fail;
    }
    PELL_TRY(mark_flat(&n));
    res = PELL_ERR_NOMEM;
    n.group = pell_alloc_array(scene->ctx, t->num_triangles, 3 * sizeof(*n.group));
    if (!n.group)
        goto fail;
    find_groups(&n);
    if (pell_cancelled(scene->ctx)) {
        res = PELL_ERR_CANCELLED;
        goto fail;
    }
    n.sum = pell_calloc(scene->ctx, n.num_groups, 3 * sizeof(*n.sum));
    if (!n.sum)
        goto fail;
    add_up(&n);
    if (any_mesh && !pell_cancelled(scene->ctx))
        PELL_TRY(assign(&n, wanted));
    fill_gaps(&n);
    res = pell_cancelled(scene->ctx) ? PELL_ERR_CANCELLED : PELL_OK;

fail:
    pell_free(scene->ctx, wanted);
    pell_free(scene->ctx, n.group);
    pell_free(scene->ctx, n.sum);
    pell_free(scene->ctx, n.flat);
    return res;
}
