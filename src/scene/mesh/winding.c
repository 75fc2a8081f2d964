/* SPDX-License-Identifier: MIT
 * winding.c - makes the orientation of triangles consistent with their neighbours, and surfaces face outward, where files are wrong. */
#include "scene/mesh/topology.h"

#include "math/vec.h"

#include <string.h>

#define GAP 1e-3 /* largest length of the vector sum of a nearly closed surface's faces, as a fraction of its area */

/* --- Triangles among their neighbours ------------------------------------------------------------------------------------------------ */

/* Sets of triangles connected by edges that exactly two triangles share. */
struct sets {
    uint32_t *parent;
    bool *odd;     /* orientation opposite to the parent */
    bool *twisted; /* for roots: a one-sided surface such as a Moebius strip */
    double *score; /* for roots: the weight in favour of their own orientation */
};

static uint32_t find_root(const struct sets *s, uint32_t i, bool *odd)
{
    uint32_t root = i;
    bool all = false;

    for (; s->parent[root] != root; root = s->parent[root])
        all ^= s->odd[root];
    *odd = all;
    while (i != root) {
        const uint32_t next = s->parent[i];
        const bool own = s->odd[i];
        s->parent[i] = root;
        s->odd[i] = all;
        all ^= own;
        i = next;
    }
    return root;
}

static void join(const struct sets *s, uint32_t a, uint32_t b, bool against)
{
    bool odd_a, odd_b;
    const uint32_t root_a = find_root(s, a, &odd_a), root_b = find_root(s, b, &odd_b);
    const uint32_t low = root_a < root_b ? root_a : root_b, high = root_a < root_b ? root_b : root_a;
    const bool differ = odd_a ^ odd_b ^ against;

    if (low == high) {
        s->twisted[low] |= differ;
        return;
    }
    s->parent[high] = low;
    s->odd[high] = differ;
    s->twisted[low] |= s->twisted[high];
}

/* Agreement of a triangle with the file's normals, summed over corners; 0 without normals. */
static double agreement_of(const struct pell_mesh *mesh, const float *face, const uint32_t *corner)
{
    double sum = 0.0;

    for (int k = 0; k < 3; k++)
        sum += (double) vec3_dot(vec3_load(face), vec3_load(mesh->normal + 3 * (size_t) corner[k]));
    return sum;
}

/* The same, or the triangle's area without normals. */
static double score_of(const struct pell_mesh *mesh, const float *face, const uint32_t *corner)
{
    for (int k = 0; k < 3; k++) {
        const struct pell_vec3 normal = vec3_load(mesh->normal + 3 * (size_t) corner[k]);
        if (vec3_dot(normal, normal) > 0.0f)
            return agreement_of(mesh, face, corner);
    }
    return 3.0 * (double) vec3_length(vec3_load(face));
}

static void flip_triangle(uint32_t *corner)
{
    const uint32_t swap = corner[1];

    corner[1] = corner[2];
    corner[2] = swap;
}

static void flip_normal(struct pell_mesh *mesh, uint32_t vertex)
{
    for (size_t c = 0; c < 3; c++)
        mesh->normal[3 * (size_t) vertex + c] *= -1.0f;
    if (mesh->tangent)
        mesh->tangent[4 * (size_t) vertex + 3] *= -1.0f;
}

/* Flips the marked triangles of a mesh. Normals that agreed with the wrong winding are wrong, too, unless another triangle uses them.
 * `wrong`: per vertex of the mesh, false. */
static void flip_marked(struct pell_mesh *mesh, const float *face, const bool *flip, bool *wrong)
{
    for (size_t i = 0; i < mesh->num_triangles; i++)
        if (flip[i] && agreement_of(mesh, face + 3 * i, mesh->index + 3 * i) > 0.0)
            for (size_t k = 0; k < 3; k++)
                wrong[mesh->index[3 * i + k]] = true;
    for (size_t i = 0; i < mesh->num_triangles; i++) {
        for (size_t k = 0; k < 3 && !flip[i]; k++)
            wrong[mesh->index[3 * i + k]] = false;
        if (flip[i])
            flip_triangle(mesh->index + 3 * i);
    }
    for (uint32_t v = 0; v < mesh->num_vertices; v++)
        if (wrong[v])
            flip_normal(mesh, v);
}

static bool any_flipped_edge(const struct pell_topology *t)
{
    for (uint32_t e = 0, end; e < t->num_halves && !pell_cancelled_at(t->ctx, e); e = end) {
        end = pell_topology_edge(t, e);
        if (end - e == 2 && pell_half_start(t, t->half[e]) == pell_half_start(t, t->half[e + 1]))
            return true;
    }
    return false;
}

/* Marks the triangles to flip: of each set the orientation with less weight. Returns how many. */
static uint32_t mark_flips(const struct pell_scene *scene, const struct pell_topology *t, const struct sets *s, bool *flip)
{
    uint32_t count = 0;
    bool odd;

    for (uint32_t i = 0; i < t->num_triangles; i++)
        s->parent[i] = i;
    for (uint32_t e = 0, end; e < t->num_halves && !pell_cancelled_at(t->ctx, e); e = end) {
        end = pell_topology_edge(t, e);
        if (end - e == 2)
            join(s, t->half[e] / 3, t->half[e + 1] / 3, pell_half_start(t, t->half[e]) == pell_half_start(t, t->half[e + 1]));
    }
    for (size_t m = 0; m < t->num_meshes; m++) {
        const struct pell_mesh *mesh = &scene->meshes[t->mesh[m]];
        for (uint32_t i = 0; i < mesh->num_triangles && !pell_cancelled_at(t->ctx, i); i++) {
            const uint32_t triangle = t->first_triangle[m] + i, root = find_root(s, triangle, &odd);
            s->score[root] += (odd ? -1.0 : 1.0) * score_of(mesh, t->face + 3 * (size_t) triangle, mesh->index + 3 * (size_t) i);
        }
    }
    for (uint32_t i = 0; i < t->num_triangles && !pell_cancelled_at(t->ctx, i); i++) {
        const uint32_t root = find_root(s, i, &odd);
        flip[i] = !s->twisted[root] && odd == (s->score[root] >= 0.0);
        count += flip[i];
    }
    return count;
}

static enum pell_result make_winding_consistent(struct pell_scene *scene, const struct pell_topology *t, const char *where, bool *any)
{
    struct pell_context *ctx = scene->ctx;
    const size_t n = t->num_triangles;
    struct sets s = { 0 };
    bool *flip = NULL, *wrong = NULL;
    uint32_t count;
    enum pell_result res = PELL_ERR_NOMEM;

    *any = false;
    if (!any_flipped_edge(t))
        return pell_cancelled(ctx) ? PELL_ERR_CANCELLED : PELL_OK;
    s.parent = pell_alloc_array(ctx, n, sizeof(*s.parent));
    s.odd = pell_calloc(ctx, n, sizeof(*s.odd));
    s.twisted = pell_calloc(ctx, n, sizeof(*s.twisted));
    s.score = pell_calloc(ctx, n, sizeof(*s.score));
    flip = pell_calloc(ctx, n, sizeof(*flip));
    wrong = pell_calloc(ctx, t->num_vertices, sizeof(*wrong));
    if (!s.parent || !s.odd || !s.twisted || !s.score || !flip || !wrong)
        goto fail;
    count = mark_flips(scene, t, &s, flip);
    res = pell_cancelled(ctx) ? PELL_ERR_CANCELLED : PELL_OK; /* flipping is all or nothing */
    for (size_t i = 0; i < n && res == PELL_OK; i++)
        if (s.twisted[i] && s.parent[i] == i) {
            pell_warn(ctx, where, NULL, "a surface is one-sided, like a Moebius strip: its triangles can't be oriented consistently");
            break;
        }
    if (res != PELL_OK || count == 0)
        goto fail;
    for (size_t m = 0; m < t->num_meshes; m++)
        flip_marked(&scene->meshes[t->mesh[m]], t->face + 3 * (size_t) t->first_triangle[m], flip + t->first_triangle[m],
                    wrong + t->first_vertex[m]);
    *any = true;
    pell_warn(ctx, where, NULL, "%s against the neighbours: turned", pell_counted(count, "triangle faces", "triangles face").str);

fail:
    pell_free(ctx, s.parent);
    pell_free(ctx, s.odd);
    pell_free(ctx, s.twisted);
    pell_free(ctx, s.score);
    pell_free(ctx, flip);
    pell_free(ctx, wrong);
    return res;
}

/* --- Surfaces as a whole ------------------------------------------------------------------------------------------------------------- */

static bool inside(const struct pell_part *a, const struct pell_part *b)
{
    for (int c = 0; c < 3; c++)
        if (!(a->min[c] > b->min[c] && a->max[c] < b->max[c]))
            return false;
    return true;
}

/* Whether a part encloses a point. */
static bool encloses_point(const struct pell_scene *scene, const struct pell_topology *t, uint32_t part, const float at[3])
{
    double sum = 0.0;

    for (size_t m = 0; m < t->num_meshes; m++) {
        const struct pell_mesh *mesh = &scene->meshes[t->mesh[m]];
        for (uint32_t i = 0; i < mesh->num_triangles && !pell_cancelled_at(t->ctx, i); i++)
            if (t->part[t->first_triangle[m] + i] == part)
                sum += pell_triangle_solid_angle(mesh, i, at);
    }
    return fabs(sum) > 2.0 * PELL_PI;
}

/* A corner of a part; NULL: no corner. */
static const float *corner_of(const struct pell_scene *scene, const struct pell_topology *t, uint32_t part)
{
    for (size_t m = 0; m < t->num_meshes; m++) {
        const struct pell_mesh *mesh = &scene->meshes[t->mesh[m]];
        for (uint32_t i = 0; i < mesh->num_triangles; i++)
            if (t->part[t->first_triangle[m] + i] == part)
                return mesh->position + 3 * (size_t) mesh->index[3 * (size_t) i];
    }
    return NULL;
}

/* True for a closed part that faces inward. A part inside another's box may be the wall of a cavity, which is correct. For speed on files
 * of very many parts, only the largest ones are considered as hosts. */
static void find_inverted(const struct pell_scene *scene, const struct pell_topology *t, const struct pell_part *parts, bool *inverted)
{
    enum { HOSTS = 64, TESTS_MOST = 64 }; /* hosts considered; tests whether a host encloses a point */
    int tests = 0;
    const double least = 1e-9 * t->scale * t->scale * t->scale;
    uint32_t hosts[HOSTS];
    size_t num_hosts = 0;

    for (uint32_t i = 0; i < t->num_parts; i++) {
        size_t k = num_hosts < HOSTS ? num_hosts++ : HOSTS;
        if (k == HOSTS && !(fabs(parts[i].volume) > fabs(parts[hosts[HOSTS - 1]].volume)))
            continue;
        for (k = k == HOSTS ? HOSTS - 1 : k; k > 0 && fabs(parts[hosts[k - 1]].volume) < fabs(parts[i].volume); k--)
            hosts[k] = hosts[k - 1];
        hosts[k] = i;
    }
    for (uint32_t i = 0; i < t->num_parts; i++) {
        inverted[i] = parts[i].closed && parts[i].volume < -least;
        for (size_t k = 0; k < num_hosts && inverted[i]; k++)
            inverted[i] = hosts[k] == i || !inside(&parts[i], &parts[hosts[k]]);
    }
    /* The wall of a cavity in an inside-out part faces outward, and is flipped with it. */
    for (uint32_t i = 0; i < t->num_parts; i++)
        for (size_t k = 0; k < num_hosts && !inverted[i] && parts[i].closed && parts[i].volume > least; k++)
            if (inverted[hosts[k]] && inside(&parts[i], &parts[hosts[k]]) && tests++ < TESTS_MOST) {
                const float *corner = corner_of(scene, t, i);
                inverted[i] = corner && encloses_point(scene, t, hosts[k], corner);
            }
}

/* True if the object's open parts form one surface that is closed but for seams, such as corners that were rounded differently, and faces
 * inward. The face vectors of a closed surface sum to 0, and its volume does not depend on the origin. */
static bool open_is_inverted(const struct pell_topology *t, const struct pell_part *parts)
{
    const double unit = 0.5 * t->scale * t->scale, least = 1e-9 * t->scale * t->scale * t->scale;
    double sum[3] = { 0 }, area = 0.0, volume = 0.0, rest;

    for (uint32_t i = 0; i < t->num_triangles && !pell_cancelled_at(t->ctx, i); i++) {
        const float *face = t->face + 3 * (size_t) i;
        const struct pell_part *part = t->part[i] == UINT32_MAX ? NULL : &parts[t->part[i]];
        if (!part || part->closed)
            continue;
        area += unit * (double) vec3_length(vec3_load(face));
        for (int c = 0; c < 3; c++) { /* volumes are relative to a corner of each part's box */
            sum[c] += unit * (double) face[c];
            volume += unit * (double) face[c] * (part->min[c] - parts[0].min[c]) / 3.0;
        }
    }
    for (uint32_t i = 0; i < t->num_parts; i++)
        if (!parts[i].closed)
            volume += parts[i].volume;
    rest = sqrt(sum[0] * sum[0] + sum[1] * sum[1] + sum[2] * sum[2]);
    return rest < GAP * area && volume < -(rest * t->scale + least);
}

/* Per part: how well the file's normals agree with the winding, summed over corners. */
static void add_agreement(const struct pell_scene *scene, const struct pell_topology *t, double *agreement)
{
    for (size_t m = 0; m < t->num_meshes; m++) {
        const struct pell_mesh *mesh = &scene->meshes[t->mesh[m]];
        for (uint32_t i = 0; i < mesh->num_triangles && !pell_cancelled_at(t->ctx, i); i++) {
            const size_t tri = (size_t) t->first_triangle[m] + i;
            if (t->part[tri] != UINT32_MAX)
                agreement[t->part[tri]] += agreement_of(mesh, t->face + 3 * tri, mesh->index + 3 * (size_t) i);
        }
    }
}

static enum pell_result orient_outward(struct pell_scene *scene, const struct pell_topology *t, const char *where, bool *any)
{
    struct pell_context *ctx = scene->ctx;
    struct pell_part *parts = pell_alloc_array(ctx, t->num_parts, sizeof(*parts));
    bool *inverted = pell_calloc(ctx, t->num_parts, sizeof(*inverted)), *flipped = NULL;
    double *agreement = NULL;
    uint32_t count = 0;
    enum pell_result res = PELL_ERR_NOMEM;

    if (!parts || !inverted)
        goto fail;
    *any = false;
    res = PELL_OK;
    pell_topology_parts(t, scene, parts);
    if (pell_cancelled(ctx)) {
        res = PELL_ERR_CANCELLED;
        goto fail;
    }
    find_inverted(scene, t, parts, inverted);
    if (open_is_inverted(t, parts))
        for (uint32_t i = 0; i < t->num_parts; i++)
            inverted[i] |= !parts[i].closed;
    for (uint32_t i = 0; i < t->num_parts; i++)
        count += inverted[i];
    if (!count)
        goto fail;

    res = PELL_ERR_NOMEM;
    agreement = pell_calloc(ctx, t->num_parts, sizeof(*agreement));
    flipped = pell_calloc(ctx, t->num_vertices, sizeof(*flipped));
    if (!agreement || !flipped)
        goto fail;
    add_agreement(scene, t, agreement);
    if (pell_cancelled(ctx)) { /* flipping is all or nothing */
        res = PELL_ERR_CANCELLED;
        goto fail;
    }
    for (size_t m = 0; m < t->num_meshes; m++) {
        struct pell_mesh *mesh = &scene->meshes[t->mesh[m]];
        for (uint32_t i = 0; i < mesh->num_triangles; i++) {
            const size_t tri = (size_t) t->first_triangle[m] + i;
            uint32_t *v = mesh->index + 3 * (size_t) i;
            if (t->part[tri] == UINT32_MAX || !inverted[t->part[tri]])
                continue;
            /* Normals that agreed with the wrong winding are wrong, too; others were right. */
            for (int k = 0; k < 3 && agreement[t->part[tri]] > 0.0; k++) {
                if (flipped[t->first_vertex[m] + v[k]])
                    continue;
                flipped[t->first_vertex[m] + v[k]] = true;
                flip_normal(mesh, v[k]);
            }
            flip_triangle(v);
        }
    }
    *any = true;
    pell_warn(ctx, where, NULL, "%u surface%s had inverted normals and %s flipped", count, count > 1 ? "s" : "",
              count > 1 ? "were" : "was");
    res = PELL_OK;

fail:
    pell_free(ctx, parts);
    pell_free(ctx, inverted);
    pell_free(ctx, agreement);
    pell_free(ctx, flipped);
    return res;
}

enum pell_result pell_orient(struct pell_scene *scene, struct pell_topology *t, const uint32_t *meshes, size_t count, const char *where)
{
    enum pell_result (*const reorient[])(struct pell_scene *, const struct pell_topology *, const char *,
                                         bool *) = { make_winding_consistent, orient_outward };
    enum pell_result res = PELL_OK;

    for (size_t i = 0; i < PELL_COUNT(reorient) && res == PELL_OK; i++) {
        bool flipped = false;
        res = reorient[i](scene, t, where, &flipped);
        /* Flipping triangles swaps corners: half-edges and face normals must be recomputed. */
        if (res == PELL_OK && flipped) {
            pell_topology_finish(t);
            res = pell_topology_make(t, scene, meshes, count);
        }
    }
    return res;
}
