/* SPDX-License-Identifier: MIT
 *
 * samples.c - Poisson disc samples of a surface by sample elimination (C. Yuksel, "Sample Elimination for Generating Poisson Disk Sample
 * Sets", Computer Graphics Forum 34(2), 2015).
 *
 * Candidates are at equal steps of area along the solid's curve through its triangles; inside a triangle the position along the curve is
 * one coordinate of the unit square, and multiples of the golden ratio are the other. Then the candidate with the largest weight, from the
 * number and distance of its neighbours, is removed repeatedly. Finally the area of every candidate is distributed to the samples around it
 * by distance, so that a sample's area reflects its isolation: sums over samples are then accurate on every scale, where equal areas would
 * vary by a percent. Candidates that face away are not neighbours: the two sides of a sheet are sampled separately.
 */
#include "methods/hierarchical/hierarchical.h"

#include "base/base.h"
#include "math/vec.h"
#include "scene/triangle.h"

#include <stdatomic.h>
#include <string.h>

#define RATIO 2 /* candidates per sample: with distributed areas, more cost time and memory without a measurable gain */

struct candidate {
    float position[3], normal[3];
    struct hierarchical_sample sample;
};

/* A candidate in the order of the neighbour search: the data that rejects most of them. */
struct entry {
    float position[3];
    uint32_t it;
    uint64_t cell;
};

/* The neighbour lists of a run of candidates, one after the other: the list of the first ends at end[0]. */
enum { RUN = 4096 };
struct run {
    uint32_t *near;
    size_t capacity;
    uint32_t end[RUN];
};

struct eliminator {
    struct pell_context *ctx;
    const struct pell_scene *scene;
    struct candidate *candidates;
    struct entry *entries; /* by bucket */
    uint32_t *bucket;      /* start of each bucket in `entries`, and the end */
    uint32_t mask, count;
    struct run *runs;
    float *weight, *area;
    uint32_t *heap, *at; /* heap of candidates, largest weight first, and the position of each in it */
    uint32_t left;       /* candidates that remain: the heap's length */
    float low[3], reach, least;
    atomic_bool failed; /* out of memory for neighbours */
};

/* --- Candidates ----------------------------------------------------------------------------------------------------------------- */

static void make_candidates(struct eliminator *e, const struct pell_solid *solid)
{
    const double step = solid->area / e->count;
    size_t t = 0;

    for (uint32_t i = 0; i < e->count && !pell_cancelled_at(e->ctx, i); i++) {
        struct candidate *c = &e->candidates[i];
        const double area = (i + 0.5) * step;
        double before, f, g = PELL_GOLDEN_SECTION * i;
        while (t + 1 < solid->num_triangles && solid->area_after[t] <= area)
            t++;
        before = t > 0 ? solid->area_after[t - 1] : 0.0;
        f = fmin(fmax((area - before) / (solid->area_after[t] - before), 0.0), 1.0);
        g -= floor(g);
        c->sample.mesh = solid->triangles[t].mesh;
        c->sample.triangle = solid->triangles[t].triangle;
        pell_triangle_point((float) f, (float) g, &c->sample.u, &c->sample.v);

        struct pell_vec3 corner[3], p;
        pell_triangle_corners(&e->scene->meshes[c->sample.mesh], c->sample.triangle, corner);
        p = vec3_mad(corner[0], c->sample.u, vec3_sub(corner[1], corner[0]));
        vec3_store(vec3_mad(p, c->sample.v, vec3_sub(corner[2], corner[0])), c->position);
        vec3_store(vec3_normalize(pell_triangle_cross(corner)), c->normal);
    }
}

/* --- Neighbours ----------------------------------------------------------------------------------------------------------------- */

/* Cells 2^21 apart along an axis share a key; the distance test separates their candidates. */
static uint64_t cell_key(int64_t x, int64_t y, int64_t z)
{
    return ((uint64_t) x & 0x1fffff) << 42 | ((uint64_t) y & 0x1fffff) << 21 | ((uint64_t) z & 0x1fffff);
}

static uint32_t bucket_of(const struct eliminator *e, uint64_t key)
{
    return (uint32_t) ((key * 0x9e3779b97f4a7c15ull) >> 32) & e->mask;
}

static void cell_of(const struct eliminator *e, const float *p, int64_t out[3])
{
    for (int k = 0; k < 3; k++)
        out[k] = (int64_t) ((p[k] - e->low[k]) / e->reach) + 1;
}

static void sort_buckets(struct eliminator *e)
{
    for (uint32_t i = 0; i < e->count && !pell_cancelled_at(e->ctx, i); i++) {
        int64_t at[3];
        cell_of(e, e->candidates[i].position, at);
        e->bucket[bucket_of(e, cell_key(at[0], at[1], at[2])) + 1]++;
    }
    for (uint32_t b = 0; b <= e->mask; b++)
        e->bucket[b + 1] += e->bucket[b];
    for (uint32_t i = e->count; i-- > 0 && !pell_cancelled_at(e->ctx, i);) {
        const float *p = e->candidates[i].position;
        int64_t at[3];
        uint64_t key;
        cell_of(e, p, at);
        key = cell_key(at[0], at[1], at[2]);
        e->entries[--e->bucket[bucket_of(e, key) + 1]] = (struct entry) { { p[0], p[1], p[2] }, i, key };
    }
    /* Starts shifted down by one bucket. */
    for (uint32_t b = 0; b <= e->mask; b++)
        e->bucket[b] = e->bucket[b + 1];
    e->bucket[e->mask + 1] = e->count;
}

static float distance2(const float *a, const float *b)
{
    float d2 = 0.0f;

    for (int k = 0; k < 3; k++)
        d2 += (a[k] - b[k]) * (a[k] - b[k]);
    return d2;
}

static bool faces(const float *a, const float *b)
{
    float facing = 0.0f;

    for (int k = 0; k < 3; k++)
        facing += a[k] * b[k];
    return facing > 0.0f;
}

/* Appends a candidate and its neighbours, within `reach` and with a similar normal, to the lists of the run. */
static enum pell_result append_neighbours(const struct eliminator *e, uint32_t it, struct run *run, size_t *count)
{
    const struct candidate *from = &e->candidates[it];
    int64_t at[3];

    cell_of(e, from->position, at);
    for (int cell = 0; cell < 27; cell++) {
        const uint64_t key = cell_key(at[0] + cell % 3 - 1, at[1] + cell / 3 % 3 - 1, at[2] + cell / 9 - 1);
        const uint32_t bucket = bucket_of(e, key);
        for (uint32_t i = e->bucket[bucket]; i < e->bucket[bucket + 1]; i++) {
            const struct entry *s = &e->entries[i];
            enum pell_result res;
            if (s->cell != key || distance2(from->position, s->position) >= e->reach * e->reach ||
                !(s->it == it || faces(from->normal, e->candidates[s->it].normal)))
                continue;
            if ((res = pell_grow(e->ctx, (void **) &run->near, *count + 1, &run->capacity, sizeof(*run->near))) != PELL_OK)
                return res;
            run->near[(*count)++] = s->it;
        }
    }
    return *count < UINT32_MAX ? PELL_OK : PELL_ERR_NOMEM;
}

static void neighbours_run(void *arg, int index, int worker)
{
    struct eliminator *e = arg;
    struct run *run = &e->runs[index];
    size_t count = 0;

    (void) worker;
    for (uint32_t i = 0; i < RUN && (uint32_t) index * RUN + i < e->count; i++) {
        if (append_neighbours(e, (uint32_t) index * RUN + i, run, &count) != PELL_OK) {
            atomic_store(&e->failed, true);
            return;
        }
        run->end[i] = (uint32_t) count;
    }
}

static int runs_of(const struct eliminator *e)
{
    return (int) ((e->count + RUN - 1) / RUN);
}

static enum pell_result find_neighbours(struct eliminator *e, struct pell_pool *pool)
{
    if (!(e->runs = pell_calloc(e->ctx, (size_t) runs_of(e), sizeof(*e->runs))))
        return PELL_ERR_NOMEM;
    pell_pool_run(pool, runs_of(e), neighbours_run, e);
    pell_free(e->ctx, e->entries);
    pell_free(e->ctx, e->bucket);
    e->entries = NULL;
    e->bucket = NULL;
    if (pell_cancelled(e->ctx))
        return PELL_ERR_CANCELLED;
    return atomic_load(&e->failed) ? PELL_ERR_NOMEM : PELL_OK;
}

/* The neighbours of a candidate, including itself. */
static const uint32_t *neighbours(const struct eliminator *e, uint32_t it, uint32_t *count)
{
    const struct run *run = &e->runs[it / RUN];
    const uint32_t first = it % RUN ? run->end[it % RUN - 1] : 0;

    *count = run->end[it % RUN] - first;
    return run->near + first;
}

/* --- The heap --------------------------------------------------------------------------------------------------------------------- */

static bool heavier(const struct eliminator *e, uint32_t a, uint32_t b)
{
    return e->weight[a] != e->weight[b] ? e->weight[a] > e->weight[b] : a < b;
}

static void sink(struct eliminator *e, uint32_t i)
{
    const uint32_t it = e->heap[i];

    for (;;) {
        uint32_t child = 2 * i + 1;
        if (child >= e->left)
            break;
        if (child + 1 < e->left && heavier(e, e->heap[child + 1], e->heap[child]))
            child++;
        if (!heavier(e, e->heap[child], it))
            break;
        e->heap[i] = e->heap[child];
        e->at[e->heap[i]] = i;
        i = child;
    }
    e->heap[i] = it;
    e->at[it] = i;
}

/* Weight of a neighbour at this squared distance. */
static float neighbour_weight(const struct eliminator *e, float d2)
{
    const float d = sqrtf(d2);
    float w = 1.0f - (d > e->least ? d : e->least) / e->reach;

    w *= w;
    w *= w;
    return w * w;
}

/* Sums the weight of a candidate's neighbours, or subtracts it from each of them that remains. */
static void visit(struct eliminator *e, uint32_t it, bool remove)
{
    uint32_t count;
    const uint32_t *near = neighbours(e, it, &count);
    float sum = 0.0f;

    for (uint32_t i = 0; i < count; i++) {
        float w;
        if (near[i] == it || (remove && e->at[near[i]] >= e->left))
            continue;
        w = neighbour_weight(e, distance2(e->candidates[it].position, e->candidates[near[i]].position));
        sum += w;
        if (remove && w > 0.0f) {
            e->weight[near[i]] -= w;
            sink(e, e->at[near[i]]);
        }
    }
    if (!remove)
        e->weight[it] = sum;
}

/* --- Areas ---------------------------------------------------------------------------------------------------------------------- */

/* Sums the nearness of the remaining candidates (or, for a sample, of all candidates), each divided by the other's `by`. */
static double nearness(const struct eliminator *e, uint32_t it, bool of_samples, const float *by)
{
    uint32_t count;
    const uint32_t *near = neighbours(e, it, &count);
    double sum = 0.0;

    for (uint32_t i = 0; i < count; i++) {
        const float t = 1.0f - distance2(e->candidates[it].position, e->candidates[near[i]].position) / (e->reach * e->reach);
        if (t > 0.0f && !(of_samples && e->at[near[i]] >= e->left) && (!by || by[near[i]] > 0.0f))
            sum += (double) (t * t * t * t) / (by ? (double) by[near[i]] : 1.0);
    }
    return sum;
}

/* First the sums around each candidate, then the area that each sample receives from the candidates around it. */
static void area_run(void *arg, int index, int worker)
{
    struct eliminator *e = arg;

    (void) worker;
    for (uint32_t i = (uint32_t) index * RUN; i < ((uint32_t) index + 1) * RUN && i < e->count; i++) {
        if (!e->area)
            e->weight[i] = (float) nearness(e, i, true, NULL);
        else if (e->at[i] < e->left)
            e->area[i] = (float) nearness(e, i, false, e->weight);
    }
}

static void weigh_run(void *arg, int index, int worker)
{
    struct eliminator *e = arg;

    (void) worker;
    for (uint32_t i = (uint32_t) index * RUN; i < ((uint32_t) index + 1) * RUN && i < e->count; i++)
        visit(e, i, false);
}

static enum pell_result eliminate(struct eliminator *e, struct pell_pool *pool, uint32_t keep)
{
    pell_pool_run(pool, runs_of(e), weigh_run, e);
    if (pell_cancelled(e->ctx))
        return PELL_ERR_CANCELLED;
    e->left = e->count;
    for (uint32_t i = 0; i < e->count; i++)
        e->heap[i] = e->at[i] = i;
    for (uint32_t i = e->count / 2; i-- > 0 && !pell_cancelled_at(e->ctx, i);)
        sink(e, i);
    while (e->left > keep) {
        const uint32_t it = e->heap[0], last = e->heap[--e->left];
        e->heap[e->left] = it;
        e->at[it] = e->left;
        e->heap[0] = last;
        e->at[last] = 0;
        sink(e, 0);
        visit(e, it, true);
        if (e->left % 4096 == 0 && pell_cancelled(e->ctx))
            return PELL_ERR_CANCELLED;
    }
    return PELL_OK;
}

/* Normalises the areas of samples to sum to `total`. */
static enum pell_result distribute_areas(struct eliminator *e, struct pell_pool *pool, double total)
{
    double sum = 0.0;

    pell_pool_run(pool, runs_of(e), area_run, e);
    e->area = pell_calloc(e->ctx, e->count, sizeof(*e->area));
    if (!e->area)
        return PELL_ERR_NOMEM;
    pell_pool_run(pool, runs_of(e), area_run, e);
    if (pell_cancelled(e->ctx))
        return PELL_ERR_CANCELLED;
    for (uint32_t i = 0; i < e->count; i++)
        sum += (double) e->area[i];
    for (uint32_t i = 0; i < e->count; i++)
        e->area[i] = (float) ((double) e->area[i] * total / sum);
    return PELL_OK;
}

/* --- All of it -------------------------------------------------------------------------------------------------------------------- */

enum pell_result hierarchical_samples_make(struct pell_context *ctx, struct pell_pool *pool, const struct pell_scene *scene,
                                           const struct pell_solid *solid, size_t count, struct hierarchical_sample **out)
{
    const size_t num_candidates = count * RATIO;
    const double radius = sqrt(solid->area / (2.0 * sqrt(3.0) * (double) count)); /* of the densest packing of discs */
    struct eliminator e = { .ctx = ctx, .scene = scene, .mask = 1023, .count = (uint32_t) num_candidates };
    struct hierarchical_sample *samples = NULL;
    size_t kept = 0;
    enum pell_result res = PELL_ERR_NOMEM;

    *out = NULL;
    while (e.mask < num_candidates / 2 && e.mask < 0x3fffffff)
        e.mask = 2 * e.mask + 1;
    e.candidates = pell_alloc_array(ctx, num_candidates, sizeof(*e.candidates));
    e.entries = pell_alloc_array(ctx, num_candidates, sizeof(*e.entries));
    e.bucket = pell_calloc(ctx, (size_t) e.mask + 2, sizeof(*e.bucket));
    e.weight = pell_alloc_array(ctx, num_candidates, sizeof(*e.weight));
    e.heap = pell_alloc_array(ctx, num_candidates, sizeof(*e.heap));
    e.at = pell_alloc_array(ctx, num_candidates, sizeof(*e.at));
    samples = pell_alloc_array(ctx, count, sizeof(*samples));
    if (!e.candidates || !e.entries || !e.bucket || !e.weight || !e.heap || !e.at || !samples)
        goto fail;
    e.reach = (float) fmax(2.0 * radius, 1e-30);
    e.low[0] = e.low[1] = e.low[2] = INFINITY;
    make_candidates(&e, solid);
    for (size_t i = 0; i < num_candidates && !pell_cancelled_at(ctx, i); i++)
        for (int k = 0; k < 3; k++)
            e.low[k] = fminf(e.low[k], e.candidates[i].position[k]);
    e.least = (float) (2.0 * radius * 0.65 * (1.0 - pow((double) count / (double) num_candidates, 1.5)));
    if (pell_cancelled(ctx)) {
        res = PELL_ERR_CANCELLED;
        goto fail;
    }
    sort_buckets(&e);
    if (pell_cancelled(ctx)) {
        res = PELL_ERR_CANCELLED;
        goto fail;
    }
    PELL_TRY(find_neighbours(&e, pool));
    PELL_TRY(eliminate(&e, pool, (uint32_t) count));
    PELL_TRY(distribute_areas(&e, pool, solid->area));
    for (size_t i = 0; i < num_candidates; i++)
        if (e.at[i] < e.left) {
            samples[kept] = e.candidates[i].sample;
            samples[kept++].area = e.area[i];
        }
    *out = samples;
    samples = NULL;

fail:
    for (int i = 0; e.runs && i < runs_of(&e); i++)
        pell_free(ctx, e.runs[i].near);
    pell_free(ctx, e.runs);
    pell_free(ctx, e.candidates);
    pell_free(ctx, e.entries);
    pell_free(ctx, e.bucket);
    pell_free(ctx, e.weight);
    pell_free(ctx, e.heap);
    pell_free(ctx, e.at);
    pell_free(ctx, e.area);
    pell_free(ctx, samples);
    return res;
}
