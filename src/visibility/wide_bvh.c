/* SPDX-License-Identifier: MIT
 *
 * wide_bvh.c - a BVH for shaders: top-down, the range with the largest surface is split by the binned surface area heuristic until there
 * are four (I. Wald, "On fast Construction of SAH-based Bounding Volume Hierarchies", 2007). A split that would make the tree deeper than
 * PELL_WIDE_LEVELS is replaced by one into equal parts.
 */
#include "visibility/wide_bvh.h"

#include "visibility/rays.h"

#include <string.h>

enum { WIDE = 4, BINS = 16 };
#define MAX_TRIANGLES ((size_t) 1 << 28)

struct box {
    float low[3], high[3];
};

static const struct box no_box = { { INFINITY, INFINITY, INFINITY }, { -INFINITY, -INFINITY, -INFINITY } };

/* A triangle during construction. */
struct part {
    struct box box;
    uint32_t mesh, triangle;
};

struct range {
    size_t first, count;
    struct box box;
};

struct build {
    struct pell_context *ctx;
    const struct pell_scene *scene;
    struct part *parts;
    struct pell_wide_bvh *bvh;
    size_t capacity; /* nodes */
    float pad;       /* mm: padding of boxes, so that flat ones have a volume and rounding errors of rays are covered */
};

static void add_point(struct box *b, const float *p)
{
    for (int k = 0; k < 3; k++) {
        b->low[k] = p[k] < b->low[k] ? p[k] : b->low[k];
        b->high[k] = p[k] > b->high[k] ? p[k] : b->high[k];
    }
}

static void add_box(struct box *b, const struct box *more)
{
    add_point(b, more->low);
    add_point(b, more->high);
}

static double area(const struct box *b)
{
    const double x = (double) b->high[0] - (double) b->low[0], y = (double) b->high[1] - (double) b->low[1],
                 z = (double) b->high[2] - (double) b->low[2];

    return x >= 0.0 ? x * y + y * z + z * x : 0.0;
}

/* Twice the centre along an axis. */
static float middle(const struct part *p, int axis)
{
    return p->box.low[axis] + p->box.high[axis];
}

static struct box bound(const struct part *parts, size_t count)
{
    struct box b = no_box;

    for (size_t i = 0; i < count; i++)
        add_box(&b, &parts[i].box);
    return b;
}

/* --- Splitting ------------------------------------------------------------------------------------------------------------------- */

struct bins {
    struct box box[BINS];
    size_t count[BINS];
};

static int bin_of(const struct part *p, int axis, float low, float scale)
{
    const float at = (middle(p, axis) - low) * scale;

    return at < BINS - 1 ? (int) at : BINS - 1;
}

/* The cheapest boundary between bins: bins up to it go to the first half. -1: all triangles are in one bin. */
static int best_border(const struct bins *bins, double *cost)
{
    double right_cost[BINS];
    struct box b = no_box;
    size_t count = 0;
    int best = -1;

    for (int i = BINS - 1; i > 0; i--) {
        add_box(&b, &bins->box[i]);
        count += bins->count[i];
        right_cost[i] = count > 0 ? area(&b) * (double) count : -1.0;
    }
    b = no_box;
    count = 0;
    for (int i = 0; i + 1 < BINS; i++) {
        double c;
        add_box(&b, &bins->box[i]);
        count += bins->count[i];
        if (count == 0 || right_cost[i + 1] < 0.0)
            continue;
        c = area(&b) * (double) count + right_cost[i + 1];
        if (best < 0 || c < *cost) {
            *cost = c;
            best = i;
        }
    }
    return best;
}

/* Partitions the range; returns the size of its first part. */
static size_t split(struct part *parts, size_t count)
{
    struct box middles = no_box;
    double best = INFINITY;
    int axis = -1, border = 0;
    float low = 0.0f, scale = 0.0f;
    size_t i = 0, j = count;

    for (size_t k = 0; k < count; k++) {
        const float p[3] = { middle(&parts[k], 0), middle(&parts[k], 1), middle(&parts[k], 2) };
        add_point(&middles, p);
    }
    for (int a = 0; a < 3; a++) {
        const float extent = middles.high[a] - middles.low[a], s = (float) BINS / extent;
        struct bins bins;
        double cost = INFINITY;
        int at;
        if (!(extent > 0.0f && s < 1e30f))
            continue;
        memset(bins.count, 0, sizeof(bins.count));
        for (int k = 0; k < BINS; k++)
            bins.box[k] = no_box;
        for (size_t k = 0; k < count; k++) {
            const int bin = bin_of(&parts[k], a, middles.low[a], s);
            add_box(&bins.box[bin], &parts[k].box);
            bins.count[bin]++;
        }
        at = best_border(&bins, &cost);
        if (at >= 0 && cost < best) {
            best = cost;
            axis = a;
            border = at;
            low = middles.low[a];
            scale = s;
        }
    }
    if (axis < 0)
        return count / 2;
    while (i < j) {
        struct part t;
        if (bin_of(&parts[i], axis, low, scale) <= border) {
            i++;
            continue;
        }
        t = parts[i];
        parts[i] = parts[--j];
        parts[j] = t;
    }
    return i;
}

/* Up to four non-empty ranges; false: some has too many triangles for the levels below. */
static bool divide(struct build *b, const struct range *range, size_t most, struct range ranges[WIDE], int *count)
{
    *count = 1;
    ranges[0] = *range;
    while (*count < WIDE) {
        struct range *widest = NULL, *r;
        double largest = -1.0;
        size_t first;
        for (int i = 0; i < *count; i++)
            if (ranges[i].count > PELL_WIDE_LEAF_MOST && area(&ranges[i].box) > largest) {
                widest = &ranges[i];
                largest = area(&ranges[i].box);
            }
        if (!widest)
            break;
        first = split(b->parts + widest->first, widest->count);
        r = &ranges[(*count)++];
        *r =
            (struct range) { widest->first + first, widest->count - first, bound(b->parts + widest->first + first, widest->count - first) };
        widest->count = first;
        widest->box = bound(b->parts + widest->first, first);
    }
    for (int i = 0; i < *count; i++)
        if (ranges[i].count > most)
            return false;
    return true;
}

static void divide_equally(const struct build *b, const struct range *range, struct range ranges[WIDE], int *count)
{
    *count = WIDE;
    for (size_t i = 0; i < WIDE; i++) {
        const size_t from = range->count * i / WIDE, to = range->count * (i + 1) / WIDE;
        ranges[i] = (struct range) { range->first + from, to - from, bound(b->parts + range->first + from, to - from) };
    }
}

/* --- Nodes ----------------------------------------------------------------------------------------------------------------------- */

/* Maximum number of triangles below a node of the level; the root has level 0. */
static size_t room_below(int level)
{
    size_t room = PELL_WIDE_LEAF_MOST;

    for (int i = level; i < PELL_WIDE_LEVELS - 1 && room < MAX_TRIANGLES; i++)
        room *= WIDE;
    return room;
}

static void fill_box(const struct build *b, uint32_t *node, int child, const struct box *box)
{
    for (int k = 0; k < 3; k++) {
        const float low = box->low[k] - b->pad, high = box->high[k] + b->pad;
        memcpy(&node[8 * k + child], &low, sizeof(low));
        memcpy(&node[8 * k + 4 + child], &high, sizeof(high));
    }
}

static enum pell_result add_node(struct build *b, const struct range *range, int level, uint32_t *index)
{
    struct pell_wide_bvh *bvh = b->bvh;
    uint32_t children[WIDE] = { PELL_WIDE_NONE, PELL_WIDE_NONE, PELL_WIDE_NONE, PELL_WIDE_NONE };
    struct range ranges[WIDE];
    size_t at = bvh->num_nodes;
    enum pell_result res;
    uint32_t *node;
    int count;

    if (pell_cancelled(b->ctx))
        return PELL_ERR_CANCELLED;
    PELL_TRY(pell_grow(b->ctx, (void **) &bvh->nodes, bvh->num_nodes, &b->capacity, PELL_WIDE_NODE * sizeof(*bvh->nodes)));
    bvh->num_nodes++;
    *index = (uint32_t) at;
    if (!divide(b, range, room_below(level + 1), ranges, &count))
        divide_equally(b, range, ranges, &count);
    for (int i = 0; i < count; i++) {
        if (ranges[i].count <= PELL_WIDE_LEAF_MOST)
            children[i] = PELL_WIDE_LEAF | (uint32_t) (ranges[i].first * 4 + ranges[i].count - 1);
        else
            PELL_TRY(add_node(b, &ranges[i], level + 1, &children[i]));
    }
    node = bvh->nodes + at * PELL_WIDE_NODE;
    memset(node, 0, PELL_WIDE_NODE * sizeof(*node));
    for (int i = 0; i < WIDE; i++)
        fill_box(b, node, i, i < count ? &ranges[i].box : &no_box);
    memcpy(node + 24, children, sizeof(children));
    return PELL_OK;

fail:
    return res;
}

/* --- Triangles ------------------------------------------------------------------------------------------------------------------- */

static size_t list_parts(struct build *b, size_t count)
{
    size_t n = 0;
    bool cut;

    for (size_t i = 0; i < b->scene->num_meshes; i++) {
        const struct pell_mesh *m = &b->scene->meshes[i];
        if (!pell_rays_show(b->scene, m, &cut))
            continue;
        b->bvh->cut |= cut;
        if (!b->parts) {
            n += m->num_triangles;
            continue;
        }
        for (uint32_t t = 0; t < m->num_triangles && n < count; t++) {
            struct part *p = &b->parts[n++];
            *p = (struct part) { no_box, (uint32_t) i, t };
            for (int k = 0; k < 3; k++)
                add_point(&p->box, m->position + 3 * (size_t) m->index[3 * (size_t) t + (size_t) k]);
        }
    }
    return n;
}

static void fill_triangle(const struct build *b, const struct part *p, uint32_t *to)
{
    const struct pell_mesh *m = &b->scene->meshes[p->mesh];
    const struct pell_material *material = &b->scene->materials[m->material];
    const uint32_t mask = m->light_shell ? PELL_RAY_LIGHT_SHELL : material->opaque ? PELL_RAY_OPAQUE : PELL_RAY_TRANSLUCENT;

    for (size_t k = 0; k < 3; k++)
        memcpy(to + 4 * k, m->position + 3 * (size_t) m->index[3 * (size_t) p->triangle + k], 3 * sizeof(float));
    to[3] = p->mesh;
    to[7] = p->triangle;
    to[11] = mask | (pell_rays_single_sided(b->scene, m) ? PELL_WIDE_SINGLE_SIDED : 0);
}

static enum pell_result fill(struct build *b)
{
    struct pell_wide_bvh *bvh = b->bvh;
    struct range all = { 0, list_parts(b, 0), no_box };
    uint32_t root;
    enum pell_result res = PELL_ERR_NOMEM;

    if (all.count > MAX_TRIANGLES)
        return pell_error(b->ctx, PELL_ERR_UNSUPPORTED, b->scene->path, "use --engine cpu", "%zu triangles, shaders see at most %zu",
                          all.count, MAX_TRIANGLES);
    b->parts = pell_alloc_array(b->ctx, all.count + 1, sizeof(*b->parts));
    bvh->triangles = pell_calloc(b->ctx, all.count + 1, PELL_WIDE_TRIANGLE * sizeof(*bvh->triangles));
    if (!b->parts || !bvh->triangles)
        goto fail;
    list_parts(b, all.count);
    all.box = bound(b->parts, all.count);
    for (int k = 0; k < 3; k++) {
        b->pad = all.count > 0 ? fmaxf(b->pad, 1e-6f * fmaxf(fabsf(all.box.low[k]), fabsf(all.box.high[k]))) : 0.0f;
        b->pad = fmaxf(b->pad, 1e-25f);
    }
    PELL_TRY(add_node(b, &all, 0, &root));
    for (size_t i = 0; i < all.count; i++)
        fill_triangle(b, &b->parts[i], bvh->triangles + i * PELL_WIDE_TRIANGLE);
    bvh->num_triangles = all.count;
    return PELL_OK;

fail:
    return res;
}

enum pell_result pell_wide_bvh_create(struct pell_context *ctx, const struct pell_scene *scene, struct pell_wide_bvh **out)
{
    struct build b = { .ctx = ctx, .scene = scene, .bvh = pell_zalloc(ctx, sizeof(*b.bvh)) };
    enum pell_result res;

    *out = NULL;
    if (!b.bvh)
        return PELL_ERR_NOMEM;
    b.bvh->ctx = ctx;
    res = fill(&b);
    pell_free(ctx, b.parts);
    if (res == PELL_OK)
        *out = b.bvh;
    else
        pell_wide_bvh_destroy(&b.bvh);
    return res;
}

void pell_wide_bvh_destroy(struct pell_wide_bvh **bvh)
{
    struct pell_wide_bvh *b = *bvh;

    if (!b)
        return;
    *bvh = NULL;
    pell_free(b->ctx, b->nodes);
    pell_free(b->ctx, b->triangles);
    pell_free(b->ctx, b);
}
