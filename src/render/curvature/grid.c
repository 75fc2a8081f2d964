/* SPDX-License-Identifier: MIT
 *
 * grid.c - area, curvature and thinness of an object's surface, summed over a sparse grid with nodes only near the surface.
 */
#include "render/curvature/internal.h"

#include "scene/mesh/topology.h"
#include "shared/curvature.h"
#include "visibility/buried.h"

#include <string.h>

#define PIECES_MOST 512 /* along a side of a triangle */
#define PIECES_BATCH 4096
#define PIECE 0.5f               /* of a cell: longer edges and triangles are split */
#define SIDE PELL_CURVATURE_SIDE /* MAX_CELLS of cpu.c: an object needs at most a quarter of the nodes along an axis */
#define MIN_CAPACITY 4096
#define CREASE (PELL_PI / 3.0) /* as for normals that are missing in a file */
#define SEAM_OFFSET 0.1f       /* of a cell: distance from a crease at which its faces are tested, */
#define SEAM_INSIDE 0.25f      /* at most this fraction of the way to a face's opposite corner */

static uint64_t key_of(size_t patch_index, const int at[3])
{
    return 1u + (((uint64_t) patch_index * SIDE + (uint64_t) at[0]) * SIDE + (uint64_t) at[1]) * SIDE + (uint64_t) at[2];
}

static struct curvature_node *find(struct curvature_node *node, size_t capacity, uint64_t key)
{
    /* Multiplicative hashing with the golden section. */
    size_t i = (size_t) (key * 0x9e3779b97f4a7c15u >> 20) & (capacity - 1);

    while (node[i].key && node[i].key != key)
        i = (i + 1) & (capacity - 1);
    return &node[i];
}

static enum pell_result grow(struct curvature_grid *g)
{
    const size_t capacity = g->capacity ? 2 * g->capacity : MIN_CAPACITY;
    struct curvature_node *node = pell_calloc(g->ctx, capacity, sizeof(*node));

    if (!node)
        return PELL_ERR_NOMEM;
    for (size_t i = 0; i < g->capacity; i++)
        if (g->node[i].key)
            *find(node, capacity, g->node[i].key) = g->node[i];
    pell_free(g->ctx, g->node);
    g->node = node;
    g->capacity = capacity;
    return PELL_OK;
}

/* The node below a point, and the fraction to the next. */
static void locate(const struct curvature_patch *patch, struct pell_vec3 p, int at[3], float fraction[3])
{
    const float x[3] = { (p.x - patch->low.x) / patch->step, (p.y - patch->low.y) / patch->step, (p.z - patch->low.z) / patch->step };

    for (int k = 0; k < 3; k++) {
        const float f = fminf(fmaxf(x[k], 0.0f), SIDE - 2.0f);
        at[k] = (int) f;
        fraction[k] = f - (float) at[k];
    }
}

enum pell_result curvature_grid_add(struct curvature_grid *g, const struct curvature_patch *patch, size_t patch_index, struct pell_vec3 p,
                                    const struct curvature_sum *piece)
{
    int base[3];
    float fraction[3];

    locate(patch, p, base, fraction);
    while (2 * (g->count + 8) > g->capacity)
        if (grow(g) != PELL_OK)
            return PELL_ERR_NOMEM;
    for (int i = 0; i < 8; i++) {
        const int at[3] = { base[0] + (i & 1), base[1] + (i >> 1 & 1), base[2] + (i >> 2) };
        const double w = (double) (i & 1 ? fraction[0] : 1.0f - fraction[0]) * (double) (i & 2 ? fraction[1] : 1.0f - fraction[1]) *
                         (double) (i & 4 ? fraction[2] : 1.0f - fraction[2]);
        const uint64_t key = key_of(patch_index, at);
        struct curvature_node *n;
        if (!(w > 0.0))
            continue;
        n = find(g->node, g->capacity, key);
        g->count += n->key == 0;
        n->key = key;
        n->sum.area += w * piece->area;
        n->sum.turn += w * piece->turn;
        n->sum.thin += w * piece->thin;
    }
    return PELL_OK;
}

struct pell_curvature_shape curvature_grid_at(const struct curvature_grid *g, const struct curvature_patch *patch, size_t patch_index,
                                              struct pell_vec3 p)
{
    struct curvature_sum sum = { 0.0, 0.0, 0.0 };
    int base[3];
    float fraction[3];

    locate(patch, p, base, fraction);
    for (int i = 0; i < 8 && g->capacity; i++) {
        const int at[3] = { base[0] + (i & 1), base[1] + (i >> 1 & 1), base[2] + (i >> 2) };
        const double w = (double) (i & 1 ? fraction[0] : 1.0f - fraction[0]) * (double) (i & 2 ? fraction[1] : 1.0f - fraction[1]) *
                         (double) (i & 4 ? fraction[2] : 1.0f - fraction[2]);
        const struct curvature_node *n = find(g->node, g->capacity, key_of(patch_index, at));
        sum.area += w * n->sum.area;
        sum.turn += w * n->sum.turn;
        sum.thin += w * n->sum.thin;
    }
    if (!(sum.area > 0.0))
        return (struct pell_curvature_shape) { 0.0f, 0.0f };
    return (struct pell_curvature_shape) { (float) (0.5 * sum.turn / sum.area), (float) (sum.thin / sum.area) };
}

void curvature_grid_write(const struct curvature_grid *g, uint32_t *out)
{
    const uint32_t mask = (uint32_t) g->capacity - 1;

    memset(out, 0, g->capacity * PELL_CURVATURE_NODE * sizeof(*out));
    for (size_t i = 0; i < g->capacity; i++) {
        const uint64_t key = g->node[i].key - 1;
        const uint32_t patch = (uint32_t) (key / ((uint64_t) SIDE * SIDE * SIDE)),
                       node_index = (uint32_t) (key % ((uint64_t) SIDE * SIDE * SIDE));
        const float sums[3] = { (float) g->node[i].sum.area, (float) g->node[i].sum.turn, (float) g->node[i].sum.thin };
        uint32_t slot = pell_curvature_slot(patch, node_index) & mask;
        if (g->node[i].key == 0)
            continue;
        while (out[PELL_CURVATURE_NODE * (size_t) slot])
            slot = (slot + 1) & mask;
        out[PELL_CURVATURE_NODE * (size_t) slot] = patch + 1;
        out[PELL_CURVATURE_NODE * (size_t) slot + 1] = node_index;
        memcpy(out + PELL_CURVATURE_NODE * (size_t) slot + 2, sums, sizeof(sums));
    }
}

/* --- Contributions of an object ------------------------------------------------------------------------------------------------------- */

/* Batch of pieces of triangles whose thinness is to be found. */
struct batch {
    struct curvature_grid *grid;
    const struct curvature_patch *patch;
    size_t patch_index;
    const struct curvature_object *object;
    struct curvature_piece *piece; /* PIECES_BATCH */
    size_t count;
};

static enum pell_result add_pieces(struct batch *b)
{
    if (b->object->rays)
        curvature_find_thin(b->object, b->patch, b->piece, b->count);
    for (size_t i = 0; i < b->count; i++) {
        const struct curvature_piece *p = &b->piece[i];
        const struct curvature_sum sum = { .area = p->area, .thin = p->area * (double) p->thinness };
        if (curvature_grid_add(b->grid, b->patch, b->patch_index, p->at, &sum) != PELL_OK)
            return PELL_ERR_NOMEM;
    }
    b->count = 0;
    return pell_cancelled(b->grid->ctx) ? PELL_ERR_CANCELLED : PELL_OK;
}

static enum pell_result add_triangle(struct batch *batch, const struct pell_vec3 p[3])
{
    const struct pell_vec3 a = vec3_sub(p[1], p[0]), b = vec3_sub(p[2], p[0]), cross = vec3_cross(a, b);
    const double area = 0.5 * (double) vec3_length(cross);
    const float longest = fmaxf(fmaxf(vec3_length(a), vec3_length(b)), vec3_length(vec3_sub(b, a)));
    const int n = (int) fminf(fmaxf(ceilf(longest / (PIECE * batch->patch->step)), 1.0f), PIECES_MOST);
    const float third = 1.0f / (3.0f * (float) n);
    enum pell_result res;

    /* Centroids of n^2 congruent triangles: first those oriented like the whole, then those between. */
    for (int i = 0; i < n; i++)
        for (int j = 0; j < 2 * (n - i) - 1; j++) {
            const float u = (float) (3 * i + 1 + (j & 1)) * third, v = (float) (3 * (j / 2) + 1 + (j & 1)) * third;
            batch->piece[batch->count++] = (struct curvature_piece) {
                .at = vec3_mad(vec3_mad(p[0], u, a), v, b),
                .normal = vec3_normalize(cross),
                .area = area / ((double) n * n),
            };
            if (batch->count == PIECES_BATCH && (res = add_pieces(batch)) != PELL_OK)
                return res;
        }
    return PELL_OK;
}

/* Dihedral angle at an edge between two faces, positive where it is convex; `along`: as the first face passes it. */
static double dihedral(const float *first, const float *second, struct pell_vec3 along)
{
    const struct pell_dvec3 a = dvec3_normalize(dvec3_load(first)), b = dvec3_normalize(dvec3_load(second));
    const struct pell_dvec3 d = dvec3_normalize(dvec3_widen(along));

    return atan2(dvec3_dot(dvec3_cross(a, b), d), dvec3_dot(a, b));
}

/* An edge between two consistently oriented faces. */
struct edge {
    struct pell_vec3 from, along;
    uint32_t half[2]; /* of the faces */
    double angle;
};

/* Where parts of an object touch, the faces between them are inside of it, and their edges are no curvature of its surface. Finds the
 * points of a crease next to which a face is inside; count: at most half a packet. `position`: of the topology. */
static void find_seams(const struct curvature_object *object, const float *const *position, const struct edge *e, float offset,
                       const struct pell_vec3 *at, int count, bool *seam)
{
    const struct pell_topology *t = object->topology;
    struct pell_buried_query query[PELL_PACKET];
    bool buried[PELL_PACKET];

    for (int face = 0; face < 2; face++) {
        const uint32_t half = e->half[face];
        const struct pell_vec3 normal = vec3_normalize(vec3_load(t->face + 3 * (size_t) (half / 3))),
                               opposite = vec3_load(position[pell_half_end(t, pell_half_next(half))]);
        for (int i = 0; i < count; i++) {
            const struct pell_vec3 to = vec3_sub(opposite, at[i]);
            const float fraction = fminf(offset / fmaxf(vec3_length(to), 1e-30f), SEAM_INSIDE);
            query[2 * i + face] =
                (struct pell_buried_query) { vec3_mad(at[i], fraction, to), normal, CURVATURE_OFFSET * vec3_max_abs(at[i]), object->id };
        }
    }
    pell_buried16(object->scene, object->rays, query, 2 * count, buried);
    for (int i = 0; i < count; i++)
        seam[i] = buried[2 * i] || buried[2 * i + 1];
}

static enum pell_result add_edge(struct curvature_grid *g, const struct curvature_patch *patch, size_t patch_index,
                                 const struct curvature_object *object, const float *const *position, const struct edge *e)
{
    const float length = vec3_length(e->along);
    const int n = (int) fminf(fmaxf(ceilf(length / (PIECE * patch->step)), 1.0f), PIECES_MOST);
    const struct curvature_sum piece = { .turn = (double) length * e->angle / n };
    const bool crease = object->rays && e->angle > CREASE;

    for (int first = 0; first < n; first += PELL_PACKET / 2) {
        const int count = n - first < PELL_PACKET / 2 ? n - first : PELL_PACKET / 2;
        struct pell_vec3 at[PELL_PACKET / 2];
        bool seam[PELL_PACKET / 2] = { false };
        for (int i = 0; i < count; i++)
            at[i] = vec3_mad(e->from, ((float) (first + i) + 0.5f) / (float) n, e->along);
        if (crease)
            find_seams(object, position, e, SEAM_OFFSET * patch->step, at, count, seam);
        for (int i = 0; i < count; i++)
            if (!seam[i] && curvature_grid_add(g, patch, patch_index, at[i], &piece) != PELL_OK)
                return PELL_ERR_NOMEM;
    }
    return PELL_OK;
}

/* Returns false for edges without curvature: flat ones, borders, and edges of more than two faces. */
static bool edge_of(const struct pell_topology *t, const float *const *at, uint32_t first, uint32_t end, struct edge *out)
{
    const uint32_t a = t->half[first], b = t->half[end - 1];

    if (end - first != 2 || pell_half_start(t, a) == pell_half_start(t, b))
        return false;
    out->from = vec3_load(at[pell_half_start(t, a)]);
    out->along = vec3_sub(vec3_load(at[pell_half_end(t, a)]), out->from);
    out->angle = dihedral(t->face + 3 * (size_t) (a / 3), t->face + 3 * (size_t) (b / 3), out->along);
    out->half[0] = a;
    out->half[1] = b;
    return out->angle != 0.0;
}

/* Mean length of the edges that are no creases, weighted by their angle: the resolution of the mesh. 0 where everything is flat or
 * creased. */
static float smooth_length(const struct pell_topology *t, const float *const *at)
{
    double sum = 0.0, weight = 0.0;
    struct edge e;

    for (uint32_t i = 0, end, edges = 0; i < t->num_halves && !pell_cancelled_at(t->ctx, edges++); i = end) {
        end = pell_topology_edge(t, i);
        if (edge_of(t, at, i, end, &e) && fabs(e.angle) < CREASE) {
            const double length = (double) vec3_length(e.along), turn = length * fabs(e.angle);
            sum += turn * length;
            weight += turn;
        }
    }
    return weight > 0.0 ? (float) (sum / weight) : 0.0f;
}

enum pell_result curvature_measure(struct curvature_grid *g, struct curvature_patch *patch, size_t patch_index,
                                   const struct curvature_object *object)
{
    const struct pell_topology *t = object->topology;
    const struct pell_scene *scene = object->scene;
    const float **at = pell_alloc_array(g->ctx, t->num_positions, sizeof(*at)); /* per position: the last vertex there */
    struct batch batch = { g, patch, patch_index, object, pell_alloc(g->ctx, PIECES_BATCH * sizeof(*batch.piece)), 0 };
    enum pell_result res = PELL_ERR_NOMEM;
    struct edge e;

    if (!at || !batch.piece)
        goto fail;
    for (size_t m = 0; m < t->num_meshes; m++)
        for (uint32_t v = 0; v < scene->meshes[t->mesh[m]].num_vertices && !pell_cancelled_at(g->ctx, v); v++)
            at[t->weld[t->first_vertex[m] + v]] = scene->meshes[t->mesh[m]].position + 3 * (size_t) v;
    if (pell_cancelled(g->ctx)) { /* some positions may be missing */
        res = PELL_ERR_CANCELLED;
        goto fail;
    }
    patch->step = fmaxf(patch->step, smooth_length(t, at));
    for (uint32_t i = 0; i < t->num_triangles; i++) {
        const uint32_t *corner = t->corner + 3 * (size_t) i;
        const struct pell_vec3 p[3] = { vec3_load(at[corner[0]]), vec3_load(at[corner[1]]), vec3_load(at[corner[2]]) };
        if (pell_cancelled_at(g->ctx, i)) {
            res = PELL_ERR_CANCELLED;
            goto fail;
        }
        PELL_TRY(add_triangle(&batch, p));
    }
    PELL_TRY(add_pieces(&batch));
    for (uint32_t i = 0, end, edges = 0; i < t->num_halves && !pell_cancelled_at(g->ctx, edges++); i = end) {
        end = pell_topology_edge(t, i);
        if (edge_of(t, at, i, end, &e))
            PELL_TRY(add_edge(g, patch, patch_index, object, at, &e));
    }
    res = pell_cancelled(g->ctx) ? PELL_ERR_CANCELLED : PELL_OK;

fail:
    pell_free(g->ctx, batch.piece);
    pell_free(g->ctx, at);
    return res;
}
