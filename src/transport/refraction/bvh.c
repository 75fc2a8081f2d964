/* SPDX-License-Identifier: MIT
 *
 * bvh.c - the hierarchy of spheres and normal cones over a solid's triangles, and the distance of a point from them. */
#include "transport/refraction/internal.h"

#include <string.h>

#define LANES PELL_CONNECT_CHILDREN
#define LEAF PELL_CONNECT_LEAF
#define NOTHING PELL_CONNECT_NOTHING
#define MAX_BISECTIONS 6              /* maximum bisection depth of a triangle: 2^MAX_BISECTIONS is PELL_CONNECT_PIECES */
#define SLIVER_RATIO 8.0              /* longest side over height: more elongated triangles are subdivided */
#define MAX_PIECES ((size_t) 1 << 17) /* per solid, or a sixteenth of its triangles if that is more */
#define NORMAL_WEIGHT 0.125           /* relative weight of normals in splits of the hierarchy, in sizes of the solid */

void pell_connect_fill_facet(const struct pell_mesh *m, uint32_t mesh, uint32_t triangle, bool flat, struct facet *f)
{
    const uint32_t *index = m->index + 3 * (size_t) triangle;
    struct pell_dvec3 n, e1, e2;
    double length;

    memset(f, 0, sizeof(*f));
    f->corner[1][0] = f->corner[2][1] = PELL_CONNECT_PIECES;
    f->mesh = mesh;
    f->triangle = triangle;
    for (int k = 0; k < 3; k++)
        memcpy(f->p[k], m->position + 3 * (size_t) index[k], sizeof(f->p[k]));
    e1 = dvec3_sub(dvec3_load(f->p[1]), dvec3_load(f->p[0]));
    e2 = dvec3_sub(dvec3_load(f->p[2]), dvec3_load(f->p[0]));
    n = dvec3_cross(e1, e2);
    length = sqrt(dvec3_dot(n, n));
    n = length > 0.0 ? dvec3_mul(n, 1.0 / length) : (struct pell_dvec3) { 0.0, 0.0, 1.0 };
    f->planar = true;
    for (int k = 0; k < 3; k++) {
        const float *v = m->normal + 3 * (size_t) index[k];
        const struct pell_dvec3 loaded = dvec3_load(v);
        const bool none = !(dvec3_dot(loaded, loaded) > 0.25 && dvec3_dot(loaded, loaded) < 4.0);
        const struct pell_dvec3 normal = flat || none ? n : loaded, off = dvec3_sub(normal, n);
        f->n[k][0] = (float) normal.x;
        f->n[k][1] = (float) normal.y;
        f->n[k][2] = (float) normal.z;
        /* Equal within the precision of floats. */
        f->planar = f->planar && dvec3_dot(off, off) < 1e-13;
    }
}

static void bound(const struct facet *f, size_t count, struct pell_connect_node *node, int lane)
{
    float low[3] = { INFINITY, INFINITY, INFINITY }, high[3] = { -INFINITY, -INFINITY, -INFINITY }, largest = 0.0f;
    struct pell_dvec3 centre, sum = { 0.0, 0.0, 0.0 }, axis;
    double radius = 0.0, cosine = 1.0, length;

    for (size_t i = 0; i < count; i++) {
        const struct piece piece = facet_piece(&f[i]);
        for (int k = 0; k < 3; k++) {
            const struct pell_dvec3 at = facet_corner(f[i].p, piece.uv[k]);
            const float p[3] = { (float) at.x, (float) at.y, (float) at.z };
            for (int j = 0; j < 3; j++) {
                low[j] = SMALLER(low[j], p[j]);
                high[j] = LARGER(high[j], p[j]);
                largest = LARGER(largest, fabsf(p[j]));
            }
            sum = dvec3_mad(sum, 1.0, facet_corner(f[i].n, piece.uv[k]));
        }
    }
    node->x[lane] = 0.5f * (low[0] + high[0]);
    node->y[lane] = 0.5f * (low[1] + high[1]);
    node->z[lane] = 0.5f * (low[2] + high[2]);
    centre = (struct pell_dvec3) { (double) node->x[lane], (double) node->y[lane], (double) node->z[lane] };
    length = sqrt(dvec3_dot(sum, sum));
    axis = length > 0.0 ? dvec3_mul(sum, 1.0 / length) : (struct pell_dvec3) { 0.0, 0.0, 1.0 };
    for (size_t i = 0; i < count; i++) {
        const struct piece piece = facet_piece(&f[i]);
        for (int k = 0; k < 3; k++) {
            const struct pell_dvec3 d = dvec3_sub(facet_corner(f[i].p, piece.uv[k]), centre);
            const struct pell_dvec3 n = facet_corner(f[i].n, piece.uv[k]);
            const double l = sqrt(dvec3_dot(n, n));
            const double r = dvec3_dot(d, d), along = l > 0.0 ? dvec3_dot(axis, n) / l : -1.0;
            radius = LARGER(radius, r);
            cosine = SMALLER(cosine, along);
        }
    }
    /* Margin for rounding errors, here and in queries. */
    node->radius[lane] = (float) (sqrt(radius) * (1.0 + 1e-5)) + 1e-6f * largest;
    node->ax[lane] = (float) axis.x;
    node->ay[lane] = (float) axis.y;
    node->az[lane] = (float) axis.z;
    node->cosine[lane] = length > 0.0 && cosine > 0.02 ? (float) cosine : -1.0f;
    node->sine[lane] = node->cosine[lane] > 0.0f ? sqrtf(fmaxf(0.0f, 1.0f - node->cosine[lane] * node->cosine[lane])) : 0.0f;
}

/* One of six coordinates: position, then normal times `weight`. */
static float key(const struct facet *f, int dimension, float weight)
{
    const float(*const corner)[3] = dimension < 3 ? f->p : f->n;
    const float u = (float) (f->corner[0][0] + f->corner[1][0] + f->corner[2][0]) * (1.0f / PELL_CONNECT_PIECES);
    const float v = (float) (f->corner[0][1] + f->corner[1][1] + f->corner[2][1]) * (1.0f / PELL_CONNECT_PIECES);
    const int j = dimension % 3;

    return (dimension < 3 ? 1.0f : weight) * ((3.0f - u - v) * corner[0][j] + u * corner[1][j] + v * corner[2][j]);
}

/* Quickselect: the first half gets keys up to those of the second. Stops early on adversarial orders and on cancellation: any split is
 * valid. */
static void halve(const struct pell_context *ctx, struct facet *f, size_t count, size_t half, int dimension, float weight)
{
    size_t first = 0, last = count - 1, swaps = 0;

    for (int pass = 0; first < last && pass < 96 && !pell_cancelled(ctx); pass++) {
        const float pivot = key(&f[first + (last - first) / 2], dimension, weight);
        size_t i = first, j = last;
        for (;;) {
            struct facet t;
            while (key(&f[i], dimension, weight) < pivot)
                i++;
            while (pivot < key(&f[j], dimension, weight))
                j--;
            if (i >= j || pell_cancelled_at(ctx, swaps++))
                break;
            t = f[i];
            f[i++] = f[j];
            f[j--] = t;
        }
        /* [first, j] are at most the pivot, [j + 1, last] at least. */
        if (i == j && key(&f[j], dimension, weight) > pivot)
            j--;
        if (half <= j)
            last = j;
        else
            first = j + 1;
    }
}

/* Splits off the first `first` of them along the widest dimension. */
static void split(const struct pell_context *ctx, struct facet *f, size_t count, size_t first, float weight)
{
    float low[6], high[6];
    int widest = 0;

    for (int d = 0; d < 6; d++) {
        low[d] = INFINITY;
        high[d] = -INFINITY;
        for (size_t i = 0; i < count && !pell_cancelled_at(ctx, i); i++) {
            const float k = key(&f[i], d, weight);
            low[d] = SMALLER(low[d], k);
            high[d] = LARGER(high[d], k);
        }
        if (high[d] - low[d] > high[widest] - low[widest])
            widest = d;
    }
    halve(ctx, f, count, first, widest, weight);
}

/* Capacity of a child: a power of the branching factor, so that all nodes but the last ones are full. */
static size_t capacity(size_t count)
{
    size_t c = 1;

    while (c * LANES < count)
        c *= LANES;
    return c;
}

static size_t count_nodes(size_t facets)
{
    const size_t c = capacity(facets), full = (facets - 1) / c, rest = facets - full * c;

    return 1 + (c > 1 ? full * count_nodes(c) + (rest > 1 ? count_nodes(rest) : 0) : 0);
}

static void divide(const struct pell_context *ctx, struct facet *f, size_t count, size_t parts, size_t c, float weight)
{
    const size_t half = parts / 2;

    if (parts < 2)
        return;
    split(ctx, f, count, half * c, weight);
    divide(ctx, f, half * c, half, c, weight);
    divide(ctx, f + half * c, count - half * c, parts - half, c, weight);
}

/* Creates a node over `count` facets from `first` on; returns its index. Depth: log of count to base 16. On cancellation children are left
 * out. */
static uint32_t build(const struct pell_context *ctx, struct tree *t, size_t first, size_t count, float weight)
{
    const uint32_t number = (uint32_t) t->num_nodes++;
    struct pell_connect_node *node = &t->nodes[number];
    const size_t c = capacity(count);

    memset(node, 0, sizeof(*node));
    if (c > 1)
        divide(ctx, t->facets + first, count, (count + c - 1) / c, c, weight);
    for (size_t i = 0; i < LANES; i++) {
        const size_t start = i * c, n = start >= count ? 0 : count - start < c ? count - start : c;
        if (n == 0 || (n > 1 && pell_cancelled(ctx))) {
            node->child[i] = NOTHING;
            node->radius[i] = 0.0f;
            continue;
        }
        bound(t->facets + first + start, n, node, (int) i);
        node->child[i] = n == 1 ? LEAF + (uint32_t) (first + start) : build(ctx, t, first + start, n, weight);
    }
    return number;
}

/* --- Slivers ------------------------------------------------------------------------------------------------------------------ */

/* Number of bisections after which a triangle's pieces are no slivers; 0 for planar ones, whose solution needs no search. */
static int bisections_of(const struct facet *f)
{
    const struct pell_dvec3 a = dvec3_load(f->p[0]), e = dvec3_sub(dvec3_load(f->p[1]), a), g = dvec3_sub(dvec3_load(f->p[2]), a),
                            h = dvec3_sub(g, e), n = dvec3_cross(e, g);
    const double longest2 = fmax(fmax(dvec3_dot(e, e), dvec3_dot(g, g)), dvec3_dot(h, h)), area2 = sqrt(dvec3_dot(n, n));
    int depth = 0;

    if (longest2 > SLIVER_RATIO * area2)
        while (!f->planar && depth < MAX_BISECTIONS && longest2 > ldexp(PELL_CONNECT_SLIVER * area2, depth))
            depth++;
    return depth;
}

static int longest_side(const struct facet *f)
{
    const struct piece piece = facet_piece(f);
    double longest2 = -1.0;
    int at = 0;

    for (int k = 0; k < 3; k++) {
        const struct pell_dvec3 d = dvec3_sub(facet_corner(f->p, piece.uv[(k + 1) % 3]), facet_corner(f->p, piece.uv[k]));
        if (dvec3_dot(d, d) > longest2) {
            longest2 = dvec3_dot(d, d);
            at = k;
        }
    }
    return at;
}

/* Bisects t->facets[at] this often; the pieces except one are appended. */
static void cut(struct tree *t, size_t at, int times)
{
    const size_t other = t->num_facets;
    struct facet *f = &t->facets[at], *g = &t->facets[other];
    int side, next;

    if (times <= 0)
        return;
    side = longest_side(f);
    next = (side + 1) % 3;
    *g = *f;
    for (int k = 0; k < 2; k++)
        f->corner[next][k] = g->corner[side][k] = (uint8_t) ((f->corner[side][k] + f->corner[next][k]) / 2);
    t->num_facets++;
    cut(t, at, times - 1);
    cut(t, other, times - 1);
}

static void fill(const struct pell_connector *c, const struct pell_solid *solid, size_t i, struct facet *f)
{
    const uint32_t mesh = solid->triangles[i].mesh;

    pell_connect_fill_facet(&c->scene->meshes[mesh], mesh, solid->triangles[i].triangle, c->flat, f);
}

/* Limit of the bisections of slivers, which bounds the number of pieces; *pieces: their total. */
static int plan_pieces(const struct pell_connector *c, const struct pell_solid *solid, size_t *pieces)
{
    const size_t n = solid->num_triangles, most = n + n / 16 < MAX_PIECES ? MAX_PIECES : n + n / 16 < LEAF ? n + n / 16 : LEAF - 1;
    size_t wanted[MAX_BISECTIONS + 1] = { 0 };
    int depth = 0;

    for (size_t i = 0; i < n && !pell_cancelled_at(c->ctx, i); i++) {
        struct facet f;
        fill(c, solid, i, &f);
        wanted[bisections_of(&f)]++;
    }
    *pieces = n;
    for (int d = 1; d <= MAX_BISECTIONS; d++) { /* each triangle with more than d - 1 bisections doubles its 2^(d - 1) pieces */
        size_t more = 0;
        for (int k = d; k <= MAX_BISECTIONS; k++)
            more += wanted[k] << (d - 1);
        if (more == 0 || *pieces + more > most)
            break;
        *pieces += more;
        depth = d;
    }
    return depth;
}

enum pell_result pell_connect_build_tree(struct pell_connector *c, size_t number)
{
    const struct pell_solid *solid = &c->solids->solids[number];
    struct tree *t = &c->trees[number];
    float low[3] = { INFINITY, INFINITY, INFINITY }, high[3] = { -INFINITY, -INFINITY, -INFINITY }, size = 0.0f, largest = 0.0f;
    size_t pieces;
    int depth;

    if (solid->num_triangles == 0)
        return PELL_OK;
    if (solid->num_triangles >= LEAF)
        return pell_error(c->ctx, PELL_ERR_UNSUPPORTED, c->scene->path, NULL, "%zu triangles are too many", solid->num_triangles);
    depth = plan_pieces(c, solid, &pieces);
    if (pell_cancelled(c->ctx))
        return PELL_ERR_CANCELLED;
    t->facets = pell_alloc_array(c->ctx, pieces, sizeof(*t->facets));
    if (!t->facets)
        return PELL_ERR_NOMEM;
    t->num_facets = solid->num_triangles;
    for (size_t i = 0; i < solid->num_triangles; i++) {
        struct facet *f = &t->facets[i];
        fill(c, solid, i, f);
        if (pell_cancelled_at(c->ctx, i))
            return PELL_ERR_CANCELLED;
        for (int k = 0; k < 3; k++)
            for (int j = 0; j < 3; j++) {
                low[j] = fminf(low[j], f->p[k][j]);
                high[j] = fmaxf(high[j], f->p[k][j]);
            }
        if (depth > 0) {
            const int times = bisections_of(f);
            cut(t, i, times < depth ? times : depth);
        }
    }
    for (int j = 0; j < 3; j++) {
        size = fmaxf(size, high[j] - low[j]);
        largest = fmaxf(largest, fmaxf(fabsf(low[j]), fabsf(high[j])));
    }
    t->rounding = 1e-6 * (double) largest;
    t->nodes = pell_alloc_array(c->ctx, count_nodes(t->num_facets), sizeof(*t->nodes));
    if (!t->nodes)
        return PELL_ERR_NOMEM;
    build(c->ctx, t, 0, t->num_facets, (float) NORMAL_WEIGHT * size);
    return pell_cancelled(c->ctx) ? PELL_ERR_CANCELLED : PELL_OK;
}

/* --- Distance to the surface -------------------------------------------------------------------------------------------------- */

/* Squared distance from x to a triangle: to its plane, an edge or a corner, whichever x projects to (C. Ericson, "Real-Time Collision
 * Detection", 2005, section 5.1.5). */
static double distance2_to_facet(const struct facet *f, struct pell_dvec3 x)
{
    const struct pell_dvec3 a = dvec3_load(f->p[0]), ab = dvec3_sub(dvec3_load(f->p[1]), a), ac = dvec3_sub(dvec3_load(f->p[2]), a),
                            ax = dvec3_sub(x, a);
    const double d1 = dvec3_dot(ab, ax), d2 = dvec3_dot(ac, ax), bb = dvec3_dot(ab, ab), bc = dvec3_dot(ab, ac), cc = dvec3_dot(ac, ac);
    const double d3 = d1 - bb, d4 = d2 - bc, d5 = d1 - bc, d6 = d2 - cc, xx = dvec3_dot(ax, ax);
    double va, vb, vc;
    struct pell_dvec3 n;

    if (d1 <= 0.0 && d2 <= 0.0)
        return xx;
    if (d3 >= 0.0 && d4 <= d3)
        return xx - 2.0 * d1 + bb;
    vc = d1 * d4 - d3 * d2;
    if (vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0)
        return xx - d1 * d1 / bb;
    if (d6 >= 0.0 && d5 <= d6)
        return xx - 2.0 * d2 + cc;
    vb = d5 * d2 - d1 * d6;
    if (vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0)
        return xx - d2 * d2 / cc;
    va = d3 * d6 - d5 * d4;
    if (va <= 0.0 && d4 - d3 >= 0.0 && d5 - d6 >= 0.0) {
        const struct pell_dvec3 edge = dvec3_sub(ac, ab), bx = dvec3_sub(ax, ab);
        const double along = dvec3_dot(edge, bx);
        return dvec3_dot(bx, bx) - along * along / dvec3_dot(edge, edge);
    }
    n = dvec3_cross(ab, ac);
    return dvec3_dot(n, ax) * dvec3_dot(n, ax) / dvec3_dot(n, n);
}

double pell_connector_distance(const struct pell_connector *connector, int solid, struct pell_vec3 x, double most)
{
    const struct tree *t;
    const struct pell_dvec3 from = dvec3_widen(x);
    uint32_t stack[PELL_CONNECT_STACK];
    double best = most * most;
    int count = 0;

    if (solid < 0 || (size_t) solid >= connector->solids->count || connector->trees[solid].num_facets == 0 || !(most > 0.0) ||
        !is_point(from))
        return most;
    t = &connector->trees[solid];
    stack[count++] = 0;
    while (count > 0) {
        const struct pell_connect_node *node = &t->nodes[stack[--count]];
        const float reach = best < INFINITY ? (float) sqrt(best) * (1.0f + 1e-6f) : INFINITY;
        float near[LANES];
        int order[LANES], n = 0;
        for (int i = 0; i < LANES; i++) {
            const float dx = x.x - node->x[i], dy = x.y - node->y[i], dz = x.z - node->z[i];
            near[i] = sqrtf(dx * dx + dy * dy + dz * dz) - node->radius[i];
        }
        for (int i = 0; i < LANES; i++) {
            int at = n;
            if (node->child[i] == NOTHING || near[i] > reach)
                continue;
            if (node->child[i] >= LEAF) {
                const double d = distance2_to_facet(&t->facets[node->child[i] - LEAF], from);
                best = SMALLER(d, best);
                continue;
            }
            for (; at > 0 && near[order[at - 1]] < near[i]; at--)
                order[at] = order[at - 1];
            order[at] = i;
            n++;
        }
        for (int i = 0; i < n; i++) /* the nearest is popped first */
            stack[count++] = node->child[order[i]];
    }
    return sqrt(LARGER(best, 0.0));
}
