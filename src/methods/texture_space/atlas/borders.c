/* SPDX-License-Identifier: MIT
 *
 * borders.c - border texels: texels next to a chart that take their value from adjacent charts, located by continuing straight over the
 * surface.
 */
#include "methods/texture_space/atlas/internal.h"

#include "base/pool.h"

#include <string.h>

#define BORDER_WORK 1024.0 /* limit of texels tested for borders, per texel of the map */
#define NEARBY 2           /* texels */

/* Replaces a location outside of the chart by the chart's nearest texel; false: none is nearby. */
static bool take_nearest(const struct ts_atlas *a, const struct ts_bilinear *p, struct ts_border *border)
{
    const int px = (int) (p->at % a->stride), py = (int) (p->at / a->stride);
    float least = INFINITY;

    for (int y = py - NEARBY; y <= py + 1 + NEARBY; y++)
        for (int x = px - NEARBY; x <= px + 1 + NEARBY; x++) {
            const ptrdiff_t at = y * a->stride + x;
            const float dx = (float) (x - px) - p->fx, dy = (float) (y - py) - p->fy, d2 = dx * dx + dy * dy;
            if (x < 0 || y < 0 || x >= a->width || y >= a->height || a->source[at] == NONE || a->key[at] != p->key || !(d2 < least))
                continue;
            least = d2;
            border->from = (int32_t) at;
        }
    border->weight[0] = 1.0f;
    return least < INFINITY;
}

/* The border texel `at` as a mean of chart texels around its location. A missing border would be a hole in a row of taps, so locations in
 * triangles narrower than a texel, which own none, use the nearest texel. */
static bool take_border(const struct ts_atlas *a, ptrdiff_t at, const struct ts_bilinear *p, struct ts_border *border)
{
    float sum = 0.0f;

    if (p->at < 0)
        return false;
    *border = (struct ts_border) { .at = (int32_t) at, .from = p->at };
    for (int k = 0; k < 4; k++) {
        const ptrdiff_t from = p->at + k % 2 + k / 2 * a->stride;
        if (a->source[from] != NONE && a->key[from] == p->key)
            sum += border->weight[k] = (k % 2 ? p->fx : 1.0f - p->fx) * (k / 2 ? p->fy : 1.0f - p->fy);
    }
    for (int k = 0; k < 4; k++)
        border->weight[k] = sum > 1e-3f ? border->weight[k] / sum : 0.0f;
    return sum > 1e-3f || take_nearest(a, p, border);
}

/* An edge in the layout. */
struct segment {
    uint32_t half;
    float px, py, ex, ey, inverse; /* first corner; edge vector; reciprocal of its squared length */
};

static struct segment segment_of(const struct ts_atlas *a, uint32_t h)
{
    const float *c = a->corners[h / 3], *p = c + 2 * (h % 3), *q = c + 2 * ((h + 1) % 3);
    const float ex = q[0] - p[0], ey = q[1] - p[1], l2 = ex * ex + ey * ey;

    return (struct segment) { h, p[0], p[1], ex, ey, l2 > 0.0f ? 1.0f / l2 : 0.0f };
}

/* Texels and the nearest edge where a chart ends but the surface continues. */
struct nearest {
    const struct ts_atlas_build *b;
    const struct segment *edges;
    size_t num_edges;
    float *distance2;
    uint32_t *edge;          /* NONE: no edge within reach */
    struct segment *scratch; /* scratch memory for all edges, per thread */
};

enum { TILE = 16 };        /* texels a side */
#define TILE_RADIUS 10.61f /* from a tile's centre to its farthest texel's */
#define TILTED 1.001f      /* how much nearer an edge counts if the texel is in front of it */

/* Squared distance from a point to an edge; dx, dy: from its first corner. */
static inline float from_segment(const struct segment *e, float dx, float dy)
{
    float s = (dx * e->ex + dy * e->ey) * e->inverse;

    s = s > 0.0f ? s < 1.0f ? s : 1.0f : 0.0f;
    return (dx - s * e->ex) * (dx - s * e->ex) + (dy - s * e->ey) * (dy - s * e->ey);
}

/* The same from a tile's centre; INFINITY if it exceeds `most` or is not finite. */
static inline float from_tile(const struct segment *e, int x0, int y0, float most)
{
    const float dx = (float) x0 + 0.5f * TILE - e->px, dy = (float) y0 + 0.5f * TILE - e->py;

    return dx < fminf(e->ex, 0.0f) - most || dx > fmaxf(e->ex, 0.0f) + most ? INFINITY : sqrtf(from_segment(e, dx, dy));
}

static void near_edge(const struct nearest *n, const struct segment *e, int x0, int y0)
{
    const struct ts_atlas *a = n->b->a;
    const float reach = (float) n->b->p->border;

    for (int y = y0; y < y0 + TILE && y < a->height; y++)
        for (int x = x0; x < x0 + TILE; x++) {
            const ptrdiff_t at = y * a->stride + x;
            const float dx = (float) x + 0.5f - e->px, dy = (float) y + 0.5f - e->py;
            float d2;

            if (a->source[at] != NONE || (n->b->buried && n->b->buried[at]))
                continue;
            d2 = from_segment(e, dx, dy);
            if (d2 >= reach * reach)
                continue;
            /* The one of the two edges at a corner that the texel is more in front of. */
            d2 -= 1e-3f * (dx * e->ey - dy * e->ex) * (dx * e->ey - dy * e->ex) * e->inverse;
            if (d2 < n->distance2[at]) {
                n->distance2[at] = d2;
                n->edge[at] = e->half;
            }
        }
}

/* Culls edges: most edges within reach of a tile are farther from all its texels than the nearest one. */
static void near_tile(const struct nearest *n, int x0, int y0)
{
    const float reach = (float) n->b->p->border + TILE_RADIUS;
    float least = reach, most;

    for (size_t i = 0; i < n->num_edges; i++)
        least = fminf(least, from_tile(&n->edges[i], x0, y0, least));
    most = fminf(TILTED * (least + TILE_RADIUS) + TILE_RADIUS, reach);
    for (size_t i = 0; i < n->num_edges && least < reach; i++)
        if (from_tile(&n->edges[i], x0, y0, most) <= most)
            near_edge(n, &n->edges[i], x0, y0);
}

static void near_rows(void *arg, int index, int worker)
{
    const struct nearest *n = arg;
    const struct ts_atlas *a = n->b->a;
    const int y0 = index * TILE, y1 = y0 + TILE < a->height ? y0 + TILE : a->height;
    const float reach = (float) n->b->p->border;
    struct segment *edges = n->scratch + (size_t) worker * n->num_edges;
    struct nearest band = *n;

    for (ptrdiff_t at = y0 * a->stride; at < y1 * a->stride; at++) {
        n->distance2[at] = reach * reach;
        n->edge[at] = NONE;
    }
    band.edges = edges;
    band.num_edges = 0;
    for (size_t i = 0; i < n->num_edges; i++) {
        const struct segment *e = &n->edges[i];
        const float top = fminf(e->py, e->py + e->ey), bottom = fmaxf(e->py, e->py + e->ey);
        if (top - reach < (float) y1 && bottom + reach > (float) y0)
            edges[band.num_edges++] = n->edges[i];
    }
    for (int x0 = 0; x0 < a->width && !pell_cancelled(n->b->ctx); x0 += TILE)
        near_tile(&band, x0, y0);
}

void ts_atlas_measure_far(const struct ts_atlas *a, uint8_t *far)
{
    const ptrdiff_t step[2][4] = { { -1, -a->stride - 1, -a->stride, -a->stride + 1 }, { 1, a->stride + 1, a->stride, a->stride - 1 } };

    for (size_t i = 0; i < a->size; i++)
        far[i] = TS_FAR - 1;
    far += TS_MARGIN;
    for (int back = 0; back < 2; back++)
        for (int j = 0; j < a->height; j++) {
            const int y = back ? a->height - 1 - j : j, around = back ? y < a->height - 1 ? 4 : 1 : y > 0 ? 4 : 1;
            for (int i = 0; i < a->width; i++) {
                const ptrdiff_t at = y * a->stride + (back ? a->width - 1 - i : i);
                int least = far[at];
                for (int k = 0; k < around; k++)
                    least = far[at + step[back][k]] + 1 < least ? far[at + step[back][k]] + 1 : least;
                far[at] = a->source[at] != NONE ? 0 : (uint8_t) least;
            }
        }
}

static void add_source(struct ts_source *list, int32_t *count, ptrdiff_t at, float weight)
{
    for (int32_t i = 0; i < *count; i++)
        if (list[i].at == at) {
            list[i].weight += weight;
            return;
        }
    list[(*count)++] = (struct ts_source) { (int32_t) at, weight };
}

/* Next to a seam, some of the four texels around a location are border texels themselves. Their own sources are across the seam; ignoring
 * them would move the location inward by up to half a texel. */
enum pell_result ts_atlas_fix_seams(struct ts_atlas_build *b)
{
    struct ts_atlas *a = b->a;
    int32_t *border_at = pell_alloc_array(b->ctx, a->size, sizeof(*border_at));
    size_t count = 0, room = 0;
    enum pell_result res = PELL_ERR_NOMEM;

    if (!border_at)
        return PELL_ERR_NOMEM;
    memset(border_at, 0xff, a->size * sizeof(*border_at));
    for (size_t i = 0; i < a->num_borders; i++)
        border_at[a->borders[i].at] = (int32_t) i;
    for (size_t i = 0; i < a->num_borders; i++) {
        struct ts_border *border = &a->borders[i];
        const struct ts_bilinear *p = &b->border_source[i];
        struct ts_source list[4 + 3 * 4];
        int32_t sources = 0;
        bool mixed = false;
        float sum = 0.0f;
        void *array = a->sources;
        for (int k = 0; k < 4; k++) {
            const ptrdiff_t from = p->at + k % 2 + k / 2 * a->stride;
            const float w = (k % 2 ? p->fx : 1.0f - p->fx) * (k / 2 ? p->fy : 1.0f - p->fy);
            if (!(w > 0.0f) || a->key[from] != p->key)
                continue;
            if (a->source[from] != NONE) {
                add_source(list, &sources, from, w);
                sum += w;
                continue;
            }
            if (sources > 12 || border_at[from] < 0)
                continue;
            for (int l = 0; l < 4; l++)
                if (a->borders[border_at[from]].weight[l] > 0.0f)
                    add_source(list, &sources, a->borders[border_at[from]].from + l % 2 + l / 2 * a->stride,
                               w * a->borders[border_at[from]].weight[l]);
            sum += w;
            mixed = true;
        }
        if (!mixed && border->weight[0] > 0.0f && border->weight[1] > 0.0f && border->weight[2] > 0.0f && border->weight[3] > 0.0f)
            continue;
        if (!(sum > 1e-3f)) {
            sources = 0;
            sum = 1.0f;
            for (int l = 0; l < 4; l++)
                if (border->weight[l] > 0.0f)
                    add_source(list, &sources, border->from + l % 2 + l / 2 * a->stride, border->weight[l]);
        }
        while (room < count + (size_t) sources) {
            PELL_TRY(pell_grow(b->ctx, &array, room, &room, sizeof(*a->sources)));
            a->sources = array;
        }
        border->first = (int32_t) count;
        border->sources = sources;
        for (int32_t k = 0; k < sources; k++)
            a->sources[count++] = (struct ts_source) { list[k].at, list[k].weight / sum };
    }
    res = PELL_OK;

fail:
    pell_free(b->ctx, border_at);
    return res;
}

static size_t square_of(const struct ts_atlas *a, const struct ts_border *b)
{
    return (size_t) (b->at / a->stride / TS_BLOCK) * (size_t) a->blocks + (size_t) (b->at % a->stride / TS_BLOCK);
}

static struct ts_fill fill_of(const struct ts_border *b)
{
    const float *w = b->weight;

    return (struct ts_fill) {
        .at = b->at,
        .from = b->sources > 0 ? b->first : b->from,
        .x = (uint16_t) ((w[1] + w[3]) * TS_WHOLE + 0.5f),
        .y = (uint16_t) ((w[2] + w[3]) * TS_WHOLE + 0.5f),
        .far = (uint8_t) b->far,
        .sources = (uint8_t) b->sources,
    };
}

/* Sorted by squares, so that neighbours are read together, and within a square by distance. */
enum pell_result ts_atlas_sort_borders(struct ts_atlas_build *b, const uint8_t *far)
{
    struct ts_atlas *a = b->a;
    const size_t squares = (size_t) a->blocks * (size_t) ((a->height + TS_BLOCK - 1) / TS_BLOCK);
    struct ts_border *sorted = pell_alloc_array(b->ctx, a->num_borders + 1, sizeof(*sorted)), *other = a->borders;
    size_t next[TS_FAR] = { 0 };

    a->first_border = pell_calloc(b->ctx, squares + 2, sizeof(*a->first_border));
    a->first_with_sources = pell_alloc_array(b->ctx, squares + 1, sizeof(*a->first_with_sources));
    a->fills = pell_calloc(b->ctx, a->num_borders + TS_PREFETCH, sizeof(*a->fills));
    if (!sorted || !a->first_border || !a->first_with_sources || !a->fills) {
        pell_free(b->ctx, sorted);
        return PELL_ERR_NOMEM;
    }
    for (size_t i = 0; i < a->num_borders; i++) {
        other[i].far = far[other[i].at];
        a->within[other[i].far]++;
        a->first_border[square_of(a, &other[i]) + 2]++;
    }
    for (int k = 1; k < TS_FAR; k++) {
        next[k] = a->within[k - 1];
        a->within[k] += a->within[k - 1];
    }
    for (size_t i = 0; i < a->num_borders; i++)
        sorted[next[other[i].far]++] = other[i];
    a->num_squares = squares;
    for (size_t i = 2; i < squares + 2; i++)
        a->first_border[i] += a->first_border[i - 1];
    for (int with_sources = 0; with_sources < 2; with_sources++) {
        for (size_t i = 0; i < a->num_borders; i++)
            if ((sorted[i].sources > 0) == with_sources)
                a->fills[a->first_border[square_of(a, &sorted[i]) + 1]++] = fill_of(&sorted[i]);
        for (size_t i = 0; i < squares && !with_sources; i++)
            a->first_with_sources[i] = a->first_border[i + 1];
    }
    pell_free(b->ctx, sorted);
    pell_free(b->ctx, a->borders);
    a->borders = NULL;
    return PELL_OK;
}

/* Texels next to charts, each with its nearest edge. */
struct edge_search {
    struct ts_atlas_build *b;
    const uint32_t *edge;
    size_t *first; /* per row: index of its first border */
    int *count;    /* per row: number of borders; rows are independent, because only chart texels are read */
};

/* One-texel steps along x and y of a triangle, transported along a path to another triangle and expressed in its barycentrics. */
static struct ts_orientation orientation_of(const struct ts_atlas *a, uint32_t t, const struct ts_flat *f, struct pell_vec3 dir,
                                            uint32_t to, struct pell_vec3 there)
{
    struct ts_orientation orientation = { .triangle = to };
    struct pell_vec3 p[3], q[3], along[2], across[2];
    double gram[3], det;

    corner_points(a, t, p);
    corner_points(a, to, q);
    along[0] = vec3_normalize(dir);
    along[1] = vec3_normalize(there);
    across[0] = vec3_cross(vec3_normalize(pell_triangle_cross(p)), along[0]);
    across[1] = vec3_cross(vec3_normalize(pell_triangle_cross(q)), along[1]);
    for (int k = 0; k < 2; k++) {
        p[k + 1] = vec3_sub(p[k + 1], p[0]);
        q[k + 1] = vec3_sub(q[k + 1], q[0]);
    }
    gram[0] = (double) vec3_dot(q[1], q[1]);
    gram[1] = (double) vec3_dot(q[1], q[2]);
    gram[2] = (double) vec3_dot(q[2], q[2]);
    det = gram[0] * gram[2] - gram[1] * gram[1];
    for (int i = 0; i < 2; i++) {
        const struct pell_vec3 step = vec3_mad(vec3_mul(p[1], (float) f->u[1 + i]), (float) f->v[1 + i], p[2]);
        const struct pell_vec3 moved = vec3_mad(vec3_mul(along[1], vec3_dot(step, along[0])), vec3_dot(step, across[0]), across[1]);
        const double r0 = (double) vec3_dot(moved, q[1]), r1 = (double) vec3_dot(moved, q[2]);
        orientation.u[i] = det > 0.0 ? (float) ((r0 * gram[2] - r1 * gram[1]) / det) : 0.0f;
        orientation.v[i] = det > 0.0 ? (float) ((r1 * gram[0] - r0 * gram[1]) / det) : 0.0f;
    }
    return orientation;
}

/* Locates a border texel by continuing over the surface beyond its edge. */
static bool cross_edge(struct ts_atlas_build *b, uint32_t h, int x, int y, struct ts_border *border, struct ts_bilinear *location,
                       struct ts_orientation *orientation)
{
    struct ts_atlas *a = b->a;
    const ptrdiff_t at = y * a->stride + x;
    const uint32_t t = h / 3;
    const float *c = a->corners[t], *e0 = c + 2 * (h % 3), *e1 = c + 2 * ((h + 1) % 3);
    const float ex = e1[0] - e0[0], ey = e1[1] - e0[1], l2 = ex * ex + ey * ey;
    float s = l2 > 0.0f ? (((float) x + 0.5f - e0[0]) * ex + ((float) y + 0.5f - e0[1]) * ey) / l2 : 0.5f;
    double inner[3] = { 1e-3 / 3.0, 1e-3 / 3.0, 1e-3 / 3.0 }, from[2], dir[2]; /* slightly inside */
    struct pell_vec3 p[3], straight, there;
    struct ts_metric m;
    struct ts_flat f;
    uint32_t to = t;

    if (!flatten(c, &f))
        return false;
    s = fminf(fmaxf(s, 0.0f), 1.0f);
    inner[h % 3] += (1.0 - 1e-3) * (1.0 - (double) s);
    inner[(h + 1) % 3] += (1.0 - 1e-3) * (double) s;
    from[0] = inner[1];
    from[1] = inner[2];
    dir[0] = f.u[0] + f.u[1] * (x + 0.5) + f.u[2] * (y + 0.5) - from[0];
    dir[1] = f.v[0] + f.v[1] * (x + 0.5) + f.v[2] * (y + 0.5) - from[1];
    corner_points(a, t, p);
    m = ts_atlas_metric_of(a, t, &f);
    straight = there = vec3_add(vec3_mul(vec3_sub(p[1], p[0]), (float) dir[0]), vec3_mul(vec3_sub(p[2], p[0]), (float) dir[1]));
    if (!ts_atlas_walk(b, &to, from, &there))
        return false;
    *location = ts_atlas_locate(a, to, (float) from[0], (float) from[1]);
    if (!take_border(a, at, location, border))
        return false;
    b->texel_position[at] = position_of(a, to, (float) from[0], (float) from[1]);
    a->key[at] = (float) a->chart[t];
    *orientation = orientation_of(a, t, &f, straight, to, there);
    orientation->at = (int32_t) at;
    ts_atlas_set_metric(a, at, &m);
    return true;
}

static void cross_row(void *arg, int y, int worker)
{
    const struct edge_search *edge_search = arg;
    struct ts_atlas_build *b = edge_search->b;
    size_t next = edge_search->first[y];
    (void) worker;

    for (int x = 0; x < b->a->width; x++) {
        const uint32_t h = edge_search->edge[y * b->a->stride + x];
        if (h != NONE && cross_edge(b, h, x, y, &b->a->borders[next], &b->border_source[next], &b->orientation[next]))
            next++;
    }
    edge_search->count[y] = (int) (next - edge_search->first[y]);
}

enum pell_result ts_atlas_find_borders(struct ts_atlas_build *b)
{
    struct ts_atlas *a = b->a;
    const float reach = (float) b->p->border;
    double budget = BORDER_WORK * (double) a->size;
    float *near = pell_alloc_array(b->ctx, a->size, sizeof(*near));
    uint32_t *edge = pell_alloc_array(b->ctx, a->size, sizeof(*edge));
    struct segment *edges = NULL, *scratch = NULL;
    size_t count = 0, room = 0;
    struct nearest nearest = { .b = b, .distance2 = near, .edge = edge };
    struct edge_search edge_search = { .b = b, .edge = edge };
    enum pell_result res = PELL_ERR_NOMEM;

    if (!near || !edge)
        goto fail;
    for (uint32_t h = 0; h < 3 * a->num_triangles && !pell_cancelled_at(b->ctx, h); h++) {
        const float *c = a->corners[h / 3];
        const float *p = c + 2 * (h % 3), *q = c + 2 * ((h + 1) % 3);
        if (!a->chart[h / 3] || a->twin[h] == NONE || !a->chart[a->twin[h] / 3] || ts_atlas_joined(b, h))
            continue;
        /* A layout with many long edges, as only adversarial input has, gets no borders. */
        budget -= (double) (fabsf(q[0] - p[0]) + 2.0f * reach) * (double) (fabsf(q[1] - p[1]) + 2.0f * reach);
        if (budget < 0.0)
            break;
        PELL_TRY(pell_grow(b->ctx, (void **) &edges, nearest.num_edges, &room, sizeof(*edges)));
        edges[nearest.num_edges++] = segment_of(a, h);
    }
    nearest.edges = edges;
    nearest.scratch = scratch = pell_alloc_array(b->ctx, nearest.num_edges * (size_t) pell_pool_threads(b->p->pool) + 1, sizeof(*scratch));
    res = PELL_ERR_NOMEM;
    if (!scratch)
        goto fail;
    pell_pool_run(b->p->pool, (a->height + TILE - 1) / TILE, near_rows, &nearest);
    res = PELL_ERR_CANCELLED;
    if (pell_cancelled(b->ctx))
        goto fail;
    res = PELL_ERR_NOMEM;
    edge_search.first = pell_alloc_array(b->ctx, (size_t) a->height, sizeof(*edge_search.first));
    edge_search.count = pell_calloc(b->ctx, (size_t) a->height, sizeof(*edge_search.count));
    if (!edge_search.first || !edge_search.count)
        goto fail;
    for (int y = 0; y < a->height; y++) {
        edge_search.first[y] = count;
        for (int x = 0; x < a->width; x++)
            count += edge[y * a->stride + x] != NONE;
    }
    a->borders = pell_alloc_array(b->ctx, count + 1, sizeof(*a->borders));
    b->border_source = pell_alloc_array(b->ctx, count + 1, sizeof(*b->border_source));
    b->orientation = pell_alloc_array(b->ctx, count + 1, sizeof(*b->orientation));
    a->first_orientation = pell_alloc_array(b->ctx, (size_t) a->height + 1, sizeof(*a->first_orientation));
    if (!a->borders || !b->border_source || !b->orientation || !a->first_orientation)
        goto fail;
    PELL_TRY(ts_atlas_unfold(b));
    pell_pool_run(b->p->pool, a->height, cross_row, &edge_search);
    res = PELL_ERR_CANCELLED;
    if (pell_cancelled(b->ctx))
        goto fail;
    for (int y = 0; y < a->height; y++) {
        const size_t n = (size_t) edge_search.count[y];
        memmove(a->borders + a->num_borders, a->borders + edge_search.first[y], n * sizeof(*a->borders));
        a->first_orientation[y] = a->num_borders;
        memmove(b->orientation + a->num_borders, b->orientation + edge_search.first[y], n * sizeof(*b->orientation));
        memmove(b->border_source + a->num_borders, b->border_source + edge_search.first[y], n * sizeof(*b->border_source));
        a->num_borders += n;
    }
    a->first_orientation[a->height] = a->num_borders;
    a->orientations = b->orientation;
    b->orientation = NULL;
    res = PELL_OK;

fail:
    pell_free(b->ctx, b->hinge);
    b->hinge = NULL;
    pell_free(b->ctx, b->orientation);
    b->orientation = NULL;
    pell_free(b->ctx, edge_search.first);
    pell_free(b->ctx, edge_search.count);
    pell_free(b->ctx, near);
    pell_free(b->ctx, edge);
    pell_free(b->ctx, edges);
    pell_free(b->ctx, scratch);
    return res;
}

void ts_atlas_measure_cell(const struct ts_atlas *a, ptrdiff_t first, struct ts_cell *c)
{
    float skew = 0.0f, count = 0.0f;

    c->least[0] = c->least[1] = c->most[0] = c->most[1] = 0.0f;
    for (ptrdiff_t at = first; at < first + TS_BLOCK; at++) {
        for (int i = 0; i < 2 && a->key[at] > 0.0f; i++) {
            c->least[i] = c->most[i] > 0.0f ? fminf(c->least[i], a->length[i][at]) : a->length[i][at];
            c->most[i] = fmaxf(c->most[i], a->length[i][at]);
        }
        skew += a->source[at] != NONE ? a->skew[at] : 0.0f;
        count += a->source[at] != NONE ? 1.0f : 0.0f;
    }
    c->skew = count > 0.0f ? skew / count : 0.0f;
}

enum pell_result ts_atlas_find_runs(struct ts_atlas_build *b, const uint8_t *far)
{
    struct ts_atlas *a = b->a;
    int count = 0;

    a->cells = pell_calloc(b->ctx, (size_t) a->blocks * (size_t) a->height + 1, sizeof(*a->cells));
    a->first_run = pell_calloc(b->ctx, (size_t) a->height + 1, sizeof(*a->first_run));
    a->runs = pell_alloc_array(b->ctx, ((size_t) a->blocks / 2 + 1) * (size_t) a->height + 1, sizeof(*a->runs));
    if (!a->cells || !a->first_run || !a->runs)
        return PELL_ERR_NOMEM;
    for (int y = 0; y < a->height; y++) {
        bool open = false;
        a->first_run[y] = count;
        for (int block = 0; block < a->blocks; block++) {
            struct ts_cell *c = &a->cells[(ptrdiff_t) y * a->blocks + block];
            const ptrdiff_t first = y * a->stride + block * TS_BLOCK;
            c->near = TS_FAR;
            for (ptrdiff_t at = first; at < first + TS_BLOCK; at++)
                c->near = a->key[at] > 0.0f && far[at] < c->near ? far[at] : c->near;
            ts_atlas_measure_cell(a, first, c);
            if (c->most[0] > 0.0f && !open)
                a->runs[count++].from = (int16_t) block;
            open = c->most[0] > 0.0f;
            if (open)
                a->runs[count - 1].to = (int16_t) (block + 1);
        }
    }
    a->first_run[a->height] = count;
    return PELL_OK;
}
