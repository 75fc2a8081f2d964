/* SPDX-License-Identifier: MIT
 * topology.c - welding, edges and connected parts of an object, in linear time. */
#include "scene/mesh/topology.h"

#include <string.h>

#define DIGIT 2048

struct sort {
    struct pell_context *ctx;
    const uint32_t *keys; /* the first word of each key, or a later one */
    size_t stride;
    uint32_t count;
};

/* Stable counting sort of `order` by an 11-bit digit of its items' keys; `into` gets the result. False if all digits are equal, or the work
 * was cancelled: then `order` holds all numbers, in any order. */
static bool sort_digit(const struct sort *s, int shift, const uint32_t *order, uint32_t *into)
{
    const uint32_t *keys = s->keys, count = s->count;
    const size_t stride = s->stride;
    uint32_t start[DIGIT] = { 0 }, sum = 0;

    for (uint32_t i = 0; i < count; i++) {
        if (pell_cancelled_at(s->ctx, i))
            return false;
        start[keys[stride * i] >> shift & (DIGIT - 1)]++;
    }
    if (count == 0 || start[keys[0] >> shift & (DIGIT - 1)] == count)
        return false;
    for (size_t d = 0; d < DIGIT; d++) {
        const uint32_t n = start[d];
        start[d] = sum;
        sum += n;
    }
    for (uint32_t i = 0; i < count; i++) {
        if (pell_cancelled_at(s->ctx, i))
            return false;
        into[start[keys[stride * order[i]] >> shift & (DIGIT - 1)]++] = order[i];
    }
    return true;
}

static bool less(const uint32_t *a, const uint32_t *b, size_t words)
{
    size_t i = 0;

    while (i + 1 < words && a[i] == b[i])
        i++;
    return a[i] < b[i];
}

uint32_t *pell_sort_keys(struct pell_context *ctx, const uint32_t *keys, size_t words, uint32_t *order, uint32_t *scratch, uint32_t count)
{
    for (uint32_t i = 0; i < count; i++)
        order[i] = i;
    if (count <= 128) {
        for (uint32_t i = 1; i < count; i++) {
            uint32_t k = i;
            for (; k > 0 && less(keys + words * i, keys + words * order[k - 1], words); k--)
                order[k] = order[k - 1];
            order[k] = i;
        }
        return order;
    }
    for (size_t word = words; word-- > 0;) {
        const struct sort sort = { ctx, keys + word, words, count };
        for (int shift = 0; shift < 32 && !pell_cancelled(ctx); shift += 11)
            if (sort_digit(&sort, shift, order, scratch)) {
                uint32_t *swap = order;
                order = scratch;
                scratch = swap;
            }
    }
    return order;
}

enum pell_result pell_order_by_code(struct pell_context *ctx, size_t count, uint64_t (*code_at)(const void *items, size_t index),
                                    const void *items, uint32_t **order)
{
    uint32_t *codes = pell_alloc_array(ctx, count, 2 * sizeof(*codes)), *a = pell_alloc_array(ctx, count, sizeof(*a));
    uint32_t *b = pell_alloc_array(ctx, count, sizeof(*b)), *sorted;
    enum pell_result res = PELL_ERR_NOMEM;

    *order = NULL;
    if (!codes || !a || !b)
        goto fail;
    if (count > UINT32_MAX) {
        res = pell_error(ctx, PELL_ERR_UNSUPPORTED, NULL, NULL, "%zu items are too many to be sorted", count);
        goto fail;
    }
    for (size_t i = 0; i < count && !pell_cancelled_at(ctx, i); i++) {
        const uint64_t code = code_at(items, i);
        codes[2 * i] = (uint32_t) (code >> 32);
        codes[2 * i + 1] = (uint32_t) code;
    }
    if (pell_cancelled(ctx)) {
        res = PELL_ERR_CANCELLED;
        goto fail;
    }
    sorted = pell_sort_keys(ctx, codes, 2, a, b, (uint32_t) count);
    res = pell_cancelled(ctx) ? PELL_ERR_CANCELLED : PELL_OK;
    if (res == PELL_OK) {
        *order = sorted;
        *(sorted == a ? &a : &b) = NULL;
    }

fail:
    pell_free(ctx, codes);
    pell_free(ctx, a);
    pell_free(ctx, b);
    return res;
}

/* Checks for cancellation between steps: an object of many millions of triangles takes seconds. */
static enum pell_result not_cancelled(struct pell_context *ctx)
{
    return pell_cancelled(ctx) ? PELL_ERR_CANCELLED : PELL_OK;
}

/* Numbers the different positions in order of first appearance. */
static enum pell_result weld(struct pell_topology *t, const struct pell_scene *scene)
{
    uint32_t *keys = pell_alloc_array(t->ctx, (size_t) t->num_vertices, 3 * sizeof(*keys));
    uint32_t *order = pell_alloc_array(t->ctx, (size_t) t->num_vertices, sizeof(*order));
    uint32_t *scratch = pell_alloc_array(t->ctx, (size_t) t->num_vertices, sizeof(*scratch)), *sorted;
    enum pell_result res = PELL_ERR_NOMEM;

    if (!keys || !order || !scratch)
        goto fail;
    for (size_t m = 0; m < t->num_meshes; m++) {
        const struct pell_mesh *mesh = &scene->meshes[t->mesh[m]];
        uint32_t *to = keys + 3 * (size_t) t->first_vertex[m];
        for (size_t i = 0; i < 3 * (size_t) mesh->num_vertices && !pell_cancelled_at(t->ctx, i); i++) {
            const float f = mesh->position[i] + 0.0f; /* -0 becomes 0 */
            memcpy(&to[i], &f, sizeof(f));
        }
    }
    PELL_TRY(not_cancelled(t->ctx));
    sorted = pell_sort_keys(t->ctx, keys, 3, order, scratch, t->num_vertices);
    PELL_TRY(not_cancelled(t->ctx));

    /* The sort is stable: the first of a run is its first vertex. It represents all of them, then gets its index. */
    for (uint32_t i = 0, first = 0; i < t->num_vertices; i++) {
        if (pell_cancelled_at(t->ctx, i)) {
            res = PELL_ERR_CANCELLED;
            goto fail;
        }
        if (i == 0 || memcmp(keys + 3 * (size_t) sorted[i], keys + 3 * (size_t) first, 3 * sizeof(*keys)) != 0)
            first = sorted[i];
        t->weld[sorted[i]] = first;
    }
    t->num_positions = 0;
    for (uint32_t i = 0; i < t->num_vertices; i++)
        t->weld[i] = t->weld[i] == i ? t->num_positions++ : t->weld[t->weld[i]];
    res = PELL_OK;

fail:
    pell_free(t->ctx, keys);
    pell_free(t->ctx, order);
    pell_free(t->ctx, scratch);
    return res;
}

static void fill_triangles(struct pell_topology *t, const struct pell_scene *scene)
{
    const double unit = t->scale > 0.0 ? 1.0 / t->scale : 1.0;

    for (size_t m = 0; m < t->num_meshes; m++) {
        const struct pell_mesh *mesh = &scene->meshes[t->mesh[m]];
        for (uint32_t i = 0; i < mesh->num_triangles && !pell_cancelled_at(t->ctx, i); i++) {
            const size_t tri = (size_t) t->first_triangle[m] + i;
            const float *p[3];
            uint32_t *c = t->corner + 3 * tri;
            double a[3], b[3], n[3];
            bool flat;

            for (int k = 0; k < 3; k++) {
                const uint32_t v = mesh->index[3 * (size_t) i + k];
                p[k] = mesh->position + 3 * (size_t) v;
                c[k] = t->weld[t->first_vertex[m] + v];
            }
            for (int k = 0; k < 3; k++) {
                a[k] = unit * ((double) p[1][k] - p[0][k]);
                b[k] = unit * ((double) p[2][k] - p[0][k]);
            }
            n[0] = a[1] * b[2] - a[2] * b[1];
            n[1] = a[2] * b[0] - a[0] * b[2];
            n[2] = a[0] * b[1] - a[1] * b[0];
            flat = c[0] == c[1] || c[1] == c[2] || c[2] == c[0] || !(n[0] * n[0] + n[1] * n[1] + n[2] * n[2] > 1e-36);
            for (int k = 0; k < 3; k++)
                t->face[3 * tri + k] = flat ? 0.0f : (float) n[k];
            t->num_degenerate += flat;
        }
    }
}

static bool degenerate(const struct pell_topology *t, uint32_t triangle)
{
    const float *n = t->face + 3 * (size_t) triangle;
    return n[0] == 0.0f && n[1] == 0.0f && n[2] == 0.0f;
}

static uint32_t low_end(const struct pell_topology *t, uint32_t half)
{
    const uint32_t a = pell_half_start(t, half), b = pell_half_end(t, half);
    return a < b ? a : b;
}

static uint32_t high_end(const struct pell_topology *t, uint32_t half)
{
    const uint32_t a = pell_half_start(t, half), b = pell_half_end(t, half);
    return a < b ? b : a;
}

/* Two stable counting sorts, by the higher and then the lower end. */
static enum pell_result sort_halves(struct pell_topology *t)
{
    const size_t buckets = (size_t) t->num_positions + 1;
    uint32_t *start = pell_calloc(t->ctx, buckets, sizeof(*start));
    uint32_t *by_high = pell_alloc_array(t->ctx, 3 * (size_t) t->num_triangles, sizeof(*by_high));
    enum pell_result res = PELL_ERR_NOMEM;

    if (!start || !by_high)
        goto fail;
    t->num_halves = 0;
    for (uint32_t i = 0; i < t->num_triangles && !pell_cancelled_at(t->ctx, i); i++)
        for (uint32_t k = 0; k < 3 && !degenerate(t, i); k++, t->num_halves++)
            start[high_end(t, 3 * i + k) + 1]++;
    PELL_TRY(not_cancelled(t->ctx));
    for (size_t i = 1; i < buckets; i++)
        start[i] += start[i - 1];
    for (uint32_t i = 0; i < t->num_triangles && !pell_cancelled_at(t->ctx, i); i++)
        for (uint32_t k = 0; k < 3 && !degenerate(t, i); k++)
            by_high[start[high_end(t, 3 * i + k)]++] = 3 * i + k;
    PELL_TRY(not_cancelled(t->ctx));

    memset(start, 0, buckets * sizeof(*start));
    for (uint32_t i = 0; i < t->num_halves && !pell_cancelled_at(t->ctx, i); i++)
        start[low_end(t, by_high[i]) + 1]++;
    PELL_TRY(not_cancelled(t->ctx));
    for (size_t i = 1; i < buckets; i++)
        start[i] += start[i - 1];
    for (uint32_t i = 0; i < t->num_halves && !pell_cancelled_at(t->ctx, i); i++)
        t->half[start[low_end(t, by_high[i])]++] = by_high[i];
    res = PELL_OK;

fail:
    pell_free(t->ctx, start);
    pell_free(t->ctx, by_high);
    return res;
}

uint32_t pell_topology_edge(const struct pell_topology *t, uint32_t first)
{
    const uint32_t low = low_end(t, t->half[first]), high = high_end(t, t->half[first]);
    uint32_t end = first + 1;

    while (end < t->num_halves && low_end(t, t->half[end]) == low && high_end(t, t->half[end]) == high)
        end++;
    return end;
}

uint32_t pell_union_root(uint32_t *parent, uint32_t i)
{
    while (parent[i] != i) {
        parent[i] = parent[parent[i]];
        i = parent[i];
    }
    return i;
}

void pell_union_join(uint32_t *parent, uint32_t a, uint32_t b)
{
    a = pell_union_root(parent, a);
    b = pell_union_root(parent, b);
    parent[a < b ? b : a] = a < b ? a : b;
}

static void find_parts(struct pell_topology *t)
{
    uint32_t edges = 0;

    t->num_parts = 0;
    for (uint32_t i = 0; i < t->num_triangles; i++)
        t->part[i] = i;
    for (uint32_t e = 0, end; e < t->num_halves; e = end) {
        end = pell_topology_edge(t, e);
        if (pell_cancelled_at(t->ctx, edges++))
            return;
        for (uint32_t i = e + 1; i < end; i++)
            pell_union_join(t->part, t->half[e] / 3, t->half[i] / 3);
    }
    for (uint32_t i = 0; i < t->num_triangles && !pell_cancelled_at(t->ctx, i); i++)
        t->part[i] = pell_union_root(t->part, i);
    for (uint32_t i = 0; i < t->num_triangles && !pell_cancelled_at(t->ctx, i); i++) {
        if (degenerate(t, i))
            t->part[i] = UINT32_MAX;
        else
            t->part[i] = t->part[i] == i ? t->num_parts++ : t->part[t->part[i]];
    }
}

static void measure_extent(struct pell_topology *t, const struct pell_scene *scene)
{
    double min[3] = { INFINITY, INFINITY, INFINITY }, max[3] = { -INFINITY, -INFINITY, -INFINITY };

    for (size_t m = 0; m < t->num_meshes; m++) {
        const struct pell_mesh *mesh = &scene->meshes[t->mesh[m]];
        for (size_t i = 0; i < 3 * (size_t) mesh->num_vertices && !pell_cancelled_at(t->ctx, i); i++) {
            const double x = mesh->position[i];
            min[i % 3] = x < min[i % 3] ? x : min[i % 3];
            max[i % 3] = x > max[i % 3] ? x : max[i % 3];
        }
    }
    t->scale = 0.0;
    for (int c = 0; c < 3; c++)
        t->scale = fmax(t->scale, max[c] - min[c]);
}

enum pell_result pell_topology_make(struct pell_topology *t, const struct pell_scene *scene, const uint32_t *meshes, size_t num_meshes)
{
    enum pell_result res = PELL_ERR_NOMEM;
    uint64_t vertices = 0, triangles = 0;

    memset(t, 0, sizeof(*t));
    t->ctx = scene->ctx;
    t->mesh = meshes;
    t->num_meshes = num_meshes;
    t->first_vertex = pell_alloc_array(t->ctx, num_meshes + 1, sizeof(*t->first_vertex));
    t->first_triangle = pell_alloc_array(t->ctx, num_meshes + 1, sizeof(*t->first_triangle));
    if (!t->first_vertex || !t->first_triangle)
        goto fail;
    for (size_t m = 0; m <= num_meshes; m++) {
        t->first_vertex[m] = (uint32_t) vertices;
        t->first_triangle[m] = (uint32_t) triangles;
        if (m < num_meshes) {
            vertices += scene->meshes[meshes[m]].num_vertices;
            triangles += scene->meshes[meshes[m]].num_triangles;
        }
        if (vertices > INT32_MAX || triangles > INT32_MAX / 3) {
            res = pell_error(t->ctx, PELL_ERR_UNSUPPORTED, scene->path, NULL, "an object of %llu vertices and %llu triangles is too large",
                             (unsigned long long) vertices, (unsigned long long) triangles);
            goto fail;
        }
    }
    t->num_vertices = (uint32_t) vertices;
    t->num_triangles = (uint32_t) triangles;
    t->weld = pell_alloc_array(t->ctx, vertices, sizeof(*t->weld));
    t->corner = pell_alloc_array(t->ctx, triangles, 3 * sizeof(*t->corner));
    t->face = pell_alloc_array(t->ctx, triangles, 3 * sizeof(*t->face));
    t->half = pell_alloc_array(t->ctx, triangles, 3 * sizeof(*t->half));
    t->part = pell_alloc_array(t->ctx, triangles, sizeof(*t->part));
    if (!t->weld || !t->corner || !t->face || !t->half || !t->part)
        goto fail;
    measure_extent(t, scene);
    PELL_TRY(weld(t, scene));
    PELL_TRY(not_cancelled(t->ctx));
    fill_triangles(t, scene);
    PELL_TRY(not_cancelled(t->ctx));
    PELL_TRY(sort_halves(t));
    PELL_TRY(not_cancelled(t->ctx));
    find_parts(t);
    PELL_TRY(not_cancelled(t->ctx));
    return PELL_OK;

fail:
    pell_topology_finish(t);
    return res;
}

void pell_topology_finish(struct pell_topology *t)
{
    if (!t->ctx)
        return;
    pell_free(t->ctx, t->first_vertex);
    pell_free(t->ctx, t->first_triangle);
    pell_free(t->ctx, t->weld);
    pell_free(t->ctx, t->corner);
    pell_free(t->ctx, t->face);
    pell_free(t->ctx, t->half);
    pell_free(t->ctx, t->part);
    memset(t, 0, sizeof(*t));
}

/* Whether the half-edges from `first` to `end`, those of an edge, are as many in both directions. */
static bool is_balanced(const struct pell_topology *t, uint32_t first, uint32_t end)
{
    int64_t balance = 0;

    for (uint32_t i = first; i < end; i++)
        balance += pell_half_start(t, t->half[i]) < pell_half_end(t, t->half[i]) ? 1 : -1;
    return balance == 0;
}

void pell_topology_parts(const struct pell_topology *t, const struct pell_scene *scene, struct pell_part *parts)
{
    for (uint32_t i = 0; i < t->num_parts; i++) {
        parts[i] = (struct pell_part) { .closed = true };
        for (int c = 0; c < 3; c++) {
            parts[i].min[c] = INFINITY;
            parts[i].max[c] = -INFINITY;
        }
    }
    for (size_t m = 0; m < t->num_meshes; m++) {
        const struct pell_mesh *mesh = &scene->meshes[t->mesh[m]];
        for (uint32_t i = 0; i < mesh->num_triangles && !pell_cancelled_at(t->ctx, i); i++) {
            const uint32_t number = t->part[t->first_triangle[m] + i];
            struct pell_part *part = parts + number;
            for (int k = 0; number != UINT32_MAX && k < 3; k++) {
                const float *p = mesh->position + 3 * (size_t) mesh->index[3 * (size_t) i + k];
                for (int c = 0; c < 3; c++) {
                    part->min[c] = p[c] < part->min[c] ? p[c] : part->min[c];
                    part->max[c] = p[c] > part->max[c] ? p[c] : part->max[c];
                }
            }
        }
    }
    /* Divergence theorem; the tetrahedra share a corner of the part's box, so that parts far from the origin lose no precision. */
    for (size_t m = 0; m < t->num_meshes; m++) {
        const struct pell_mesh *mesh = &scene->meshes[t->mesh[m]];
        for (uint32_t i = 0; i < mesh->num_triangles && !pell_cancelled_at(t->ctx, i); i++) {
            const uint32_t number = t->part[t->first_triangle[m] + i];
            double p[3][3];
            if (number == UINT32_MAX)
                continue;
            for (int k = 0; k < 3; k++)
                for (int c = 0; c < 3; c++)
                    p[k][c] = mesh->position[3 * (size_t) mesh->index[3 * (size_t) i + k] + c] - parts[number].min[c];
            parts[number].volume += (p[0][0] * (p[1][1] * p[2][2] - p[1][2] * p[2][1]) + p[0][1] * (p[1][2] * p[2][0] - p[1][0] * p[2][2]) +
                                     p[0][2] * (p[1][0] * p[2][1] - p[1][1] * p[2][0])) /
                                    6.0;
        }
    }
    for (uint32_t e = 0, end, edges = 0; e < t->num_halves && !pell_cancelled_at(t->ctx, edges++); e = end) {
        end = pell_topology_edge(t, e);
        if (!is_balanced(t, e, end))
            parts[t->part[t->half[e] / 3]].closed = false;
    }
}

struct pell_edge_counts pell_topology_count_edges(const struct pell_topology *t)
{
    struct pell_edge_counts n = { 0 };

    for (uint32_t e = 0, end, edges = 0; e < t->num_halves && !pell_cancelled_at(t->ctx, edges++); e = end) {
        end = pell_topology_edge(t, e);
        n.boundary += end - e == 1;
        n.nonmanifold += end - e > 2;
        n.flipped += end - e == 2 && pell_half_start(t, t->half[e]) == pell_half_start(t, t->half[e + 1]);
        n.unbalanced += !is_balanced(t, e, end);
    }
    return n;
}

static int object_of(const struct pell_mesh *mesh)
{
    return mesh->object;
}

static void sort_meshes(const struct pell_scene *scene, int (*id)(const struct pell_mesh *), uint32_t *order, uint32_t *scratch)
{
    const uint32_t count = (uint32_t) scene->num_meshes;

    for (uint32_t i = 0; i < count; i++)
        order[i] = i;
    /* Merge sort from the bottom, stable. */
    for (uint32_t width = 1; width < count; width *= 2) {
        for (uint32_t low = 0; low < count; low += 2 * width) {
            const uint32_t middle = low + width < count ? low + width : count, high = middle + width < count ? middle + width : count;
            uint32_t a = low, b = middle;
            for (uint32_t i = low; i < high; i++)
                scratch[i] =
                    b >= high || (a < middle && id(&scene->meshes[order[a]]) <= id(&scene->meshes[order[b]])) ? order[a++] : order[b++];
        }
        memcpy(order, scratch, count * sizeof(*order));
    }
}

void pell_scene_objects(const struct pell_scene *scene, uint32_t *order, uint32_t *scratch)
{
    sort_meshes(scene, object_of, order, scratch);
}

void pell_scene_assemblies(const struct pell_scene *scene, uint32_t *order, uint32_t *scratch)
{
    sort_meshes(scene, pell_mesh_assembly, order, scratch);
}

size_t pell_assembly_end(const struct pell_scene *scene, const uint32_t *order, size_t first)
{
    size_t end = first + 1;

    while (end < scene->num_meshes && pell_mesh_assembly(&scene->meshes[order[end]]) == pell_mesh_assembly(&scene->meshes[order[first]]))
        end++;
    return end;
}
