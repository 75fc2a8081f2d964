/* SPDX-License-Identifier: MIT
 *
 * samples.c - places of samples, no two near one another: sample elimination (C. Yuksel, "Sample Elimination for Generating Poisson Disk
 * Sample Sets", Computer Graphics Forum 34(2), 2015).
 *
 * Candidates lie along the solid's curve through its triangles at equal steps of area; inside a triangle the place along the curve is one
 * coordinate of the unit square, and multiples of the golden section are the other. Then the candidate with the most, and nearest,
 * neighbours goes, again and again. Last, every candidate's equal share of the surface goes to the samples around it, by distance, so that
 * each sample's area is as large as it is alone: sums over samples are right on every scale, where plain counts differ by a percent from
 * place to place. What faces away is no neighbour: the two sides of a sheet are sampled each for itself.
 */
#include "methods/hierarchical/hierarchical.h"

#include "base/base.h"
#include "math/vec.h"

#include <string.h>

#define RATIO 2 /* candidates a sample: with areas shared out, more take time and memory and change no figure */

struct candidate {
    float position[3], normal[3];
    struct hierarchical_place place;
};

struct eliminator {
    const struct pell_scene *scene;
    struct candidate *candidates;
    uint64_t *cell;   /* of each */
    uint32_t *order;  /* candidates by bucket */
    uint32_t *bucket; /* start of each in order, and one more */
    uint32_t mask;
    float *weight, *area;
    uint32_t *heap, *at; /* heap of candidates, heaviest first, and where each is in it */
    uint32_t left;
    float low[3], reach, least;
};

/* --- Candidates ----------------------------------------------------------------------------------------------------------------- */

static void place_candidates(struct eliminator *e, const struct pell_solid *solid, uint32_t count)
{
    const double step = solid->area / count;
    size_t t = 0;

    for (uint32_t i = 0; i < count; i++) {
        struct candidate *c = &e->candidates[i];
        const double area = (i + 0.5) * step;
        double before, f, g = PELL_GOLDEN_SECTION * i;
        while (t + 1 < solid->num_triangles && solid->area_after[t] <= area)
            t++;
        before = t > 0 ? solid->area_after[t - 1] : 0.0;
        f = fmin(fmax((area - before) / (solid->area_after[t] - before), 0.0), 1.0);
        g -= floor(g);
        c->place.mesh = solid->triangles[t].mesh;
        c->place.triangle = solid->triangles[t].triangle;
        pell_triangle_point((float) f, (float) g, &c->place.u, &c->place.v);

        const struct pell_mesh *mesh = &e->scene->meshes[c->place.mesh];
        const uint32_t *index = mesh->index + 3 * (size_t) c->place.triangle;
        const struct pell_vec3 p = vec3_load(mesh->position + 3 * (size_t) index[0]);
        const struct pell_vec3 u = vec3_sub(vec3_load(mesh->position + 3 * (size_t) index[1]), p);
        const struct pell_vec3 v = vec3_sub(vec3_load(mesh->position + 3 * (size_t) index[2]), p);
        vec3_store(vec3_mad(vec3_mad(p, c->place.u, u), c->place.v, v), c->position);
        vec3_store(vec3_normalize(vec3_cross(u, v)), c->normal);
    }
}

/* --- Neighbours ----------------------------------------------------------------------------------------------------------------- */

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

static void sort_buckets(struct eliminator *e, uint32_t count)
{
    for (uint32_t i = 0; i < count; i++) {
        int64_t at[3];
        cell_of(e, e->candidates[i].position, at);
        e->cell[i] = cell_key(at[0], at[1], at[2]);
        e->bucket[bucket_of(e, e->cell[i]) + 1]++;
    }
    for (uint32_t b = 0; b <= e->mask; b++)
        e->bucket[b + 1] += e->bucket[b];
    for (uint32_t i = count; i-- > 0;)
        e->order[--e->bucket[bucket_of(e, e->cell[i]) + 1]] = i;
    /* Starts moved down by one bucket. */
    for (uint32_t b = 0; b <= e->mask; b++)
        e->bucket[b] = e->bucket[b + 1];
    e->bucket[e->mask + 1] = count;
}

/* A candidate that is no farther than `reach` and faces the same way, or the candidate itself. */
struct neighbour {
    uint32_t it;
    float d2;
};

/* A walk over the neighbours of a candidate, through the 27 cells around it. */
struct walk {
    const struct eliminator *e;
    const struct candidate *from;
    int64_t at[3];
    uint64_t key;
    int cell;
    uint32_t i, end;
    bool left; /* those alone that have not been eliminated */
};

static struct walk walk_around(const struct eliminator *e, uint32_t it, bool left)
{
    struct walk w = { .e = e, .from = &e->candidates[it], .left = left };

    cell_of(e, w.from->position, w.at);
    return w;
}

static bool walk_on(struct walk *w, struct neighbour *out)
{
    const struct eliminator *e = w->e;

    for (;;) {
        while (w->i < w->end) {
            const uint32_t other = e->order[w->i++];
            const struct candidate *o = &e->candidates[other];
            float d2 = 0.0f, facing = 0.0f;
            if (e->cell[other] != w->key || (w->left && e->at[other] >= e->left))
                continue;
            for (int k = 0; k < 3; k++) {
                d2 += (w->from->position[k] - o->position[k]) * (w->from->position[k] - o->position[k]);
                facing += w->from->normal[k] * o->normal[k];
            }
            if (d2 >= e->reach * e->reach || !(facing > 0.0f || o == w->from))
                continue;
            *out = (struct neighbour) { other, d2 };
            return true;
        }
        if (w->cell == 27)
            return false;
        w->key = cell_key(w->at[0] + w->cell % 3 - 1, w->at[1] + w->cell / 3 % 3 - 1, w->at[2] + w->cell / 9 - 1);
        w->cell++;
        w->i = e->bucket[bucket_of(e, w->key)];
        w->end = e->bucket[bucket_of(e, w->key) + 1];
    }
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

/* What a neighbour weighs. */
static float weigh(const struct eliminator *e, float d2)
{
    const float d = sqrtf(d2);
    float w = 1.0f - (d > e->least ? d : e->least) / e->reach;

    w *= w;
    w *= w;
    return w * w;
}

/* Sums the weight of a candidate's neighbours, or takes it off each of them that is still there. */
static void visit(struct eliminator *e, uint32_t it, bool remove)
{
    struct walk walk = walk_around(e, it, remove);
    struct neighbour near;
    float sum = 0.0f;

    while (walk_on(&walk, &near)) {
        float w;
        if (near.it == it)
            continue;
        w = weigh(e, near.d2);
        sum += w;
        if (remove && w > 0.0f) {
            e->weight[near.it] -= w;
            sink(e, e->at[near.it]);
        }
    }
    if (!remove)
        e->weight[it] = sum;
}

struct weigh_task {
    struct eliminator *e;
    uint32_t count;
};

/* --- Areas ---------------------------------------------------------------------------------------------------------------------- */

/* Sums over what is left (or, of a sample, over all candidates) how near it is: each divided by what `by` says of the other. */
static double nearness(const struct eliminator *e, uint32_t it, bool of_samples, const float *by)
{
    struct walk walk = walk_around(e, it, of_samples);
    struct neighbour near;
    double sum = 0.0;

    while (walk_on(&walk, &near)) {
        const float t = 1.0f - near.d2 / (e->reach * e->reach);
        if (t > 0.0f && (!by || by[near.it] > 0.0f))
            sum += (double) (t * t * t * t) / (by ? (double) by[near.it] : 1.0);
    }
    return sum;
}

enum { WEIGH = 4096 };

/* In turn: what is around each candidate, then what each sample gets of those around it. */
static void area_chunk(void *arg, int index, int worker)
{
    const struct weigh_task *t = arg;
    struct eliminator *e = t->e;

    (void) worker;
    for (uint32_t i = (uint32_t) index * WEIGH; i < ((uint32_t) index + 1) * WEIGH && i < t->count; i++) {
        if (!e->area)
            e->weight[i] = (float) nearness(e, i, true, NULL);
        else if (e->at[i] < e->left)
            e->area[i] = (float) nearness(e, i, false, e->weight);
    }
}

static void weigh_chunk(void *arg, int index, int worker)
{
    const struct weigh_task *t = arg;

    (void) worker;
    for (uint32_t i = (uint32_t) index * WEIGH; i < ((uint32_t) index + 1) * WEIGH && i < t->count; i++)
        visit(t->e, i, false);
}

static enum pell_result eliminate(struct pell_context *ctx, struct pell_pool *pool, struct eliminator *e, uint32_t count, uint32_t keep)
{
    struct weigh_task task = { e, count };

    pell_pool_run(pool, (int) ((count + WEIGH - 1) / WEIGH), weigh_chunk, &task);
    if (pell_cancelled(ctx))
        return PELL_ERR_CANCELLED;
    e->left = count;
    for (uint32_t i = 0; i < count; i++)
        e->heap[i] = e->at[i] = i;
    for (uint32_t i = count / 2; i-- > 0;)
        sink(e, i);
    while (e->left > keep) {
        const uint32_t it = e->heap[0], last = e->heap[--e->left];
        e->heap[e->left] = it;
        e->at[it] = e->left;
        e->heap[0] = last;
        e->at[last] = 0;
        sink(e, 0);
        visit(e, it, true);
        if ((e->left & 0xffff) == 0 && pell_cancelled(ctx))
            return PELL_ERR_CANCELLED;
    }
    return PELL_OK;
}

/* The areas of samples sum to `total`. */
static enum pell_result share_areas(struct pell_context *ctx, struct pell_pool *pool, struct eliminator *e, uint32_t count, double total)
{
    struct weigh_task task = { e, count };
    const int chunks = (int) ((count + WEIGH - 1) / WEIGH);
    double sum = 0.0;

    pell_pool_run(pool, chunks, area_chunk, &task);
    e->area = pell_calloc(ctx, count, sizeof(*e->area));
    if (!e->area)
        return PELL_ERR_NOMEM;
    pell_pool_run(pool, chunks, area_chunk, &task);
    if (pell_cancelled(ctx))
        return PELL_ERR_CANCELLED;
    for (uint32_t i = 0; i < count; i++)
        sum += (double) e->area[i];
    for (uint32_t i = 0; i < count; i++)
        e->area[i] = (float) ((double) e->area[i] * total / sum);
    return PELL_OK;
}

/* --- All of it -------------------------------------------------------------------------------------------------------------------- */

enum pell_result hierarchical_places_make(struct pell_context *ctx, struct pell_pool *pool, const struct pell_scene *scene,
                                          const struct pell_solid *solid, size_t count, struct hierarchical_place **out)
{
    const size_t many = count * RATIO;
    const double radius = sqrt(solid->area / (2.0 * sqrt(3.0) * (double) count)); /* of the densest packing of discs */
    struct eliminator e = { .scene = scene, .mask = 1023 };
    struct hierarchical_place *places = NULL;
    size_t kept = 0;
    enum pell_result res = PELL_ERR_NOMEM;

    *out = NULL;
    while (e.mask < many / 2 && e.mask < 0x3fffffff)
        e.mask = 2 * e.mask + 1;
    e.candidates = pell_alloc_array(ctx, many, sizeof(*e.candidates));
    e.cell = pell_alloc_array(ctx, many, sizeof(*e.cell));
    e.order = pell_alloc_array(ctx, many, sizeof(*e.order));
    e.bucket = pell_calloc(ctx, (size_t) e.mask + 2, sizeof(*e.bucket));
    e.weight = pell_alloc_array(ctx, many, sizeof(*e.weight));
    e.heap = pell_alloc_array(ctx, many, sizeof(*e.heap));
    e.at = pell_alloc_array(ctx, many, sizeof(*e.at));
    places = pell_alloc_array(ctx, count, sizeof(*places));
    if (!e.candidates || !e.cell || !e.order || !e.bucket || !e.weight || !e.heap || !e.at || !places)
        goto fail;
    /* Cells number 2^21 a side at most. */
    e.reach = (float) fmax(2.0 * radius, 1e-30);
    e.low[0] = e.low[1] = e.low[2] = INFINITY;
    place_candidates(&e, solid, (uint32_t) many);
    for (size_t i = 0; i < many; i++)
        for (int k = 0; k < 3; k++)
            e.low[k] = fminf(e.low[k], e.candidates[i].position[k]);
    e.least = (float) (2.0 * radius * 0.65 * (1.0 - pow((double) count / (double) many, 1.5)));
    sort_buckets(&e, (uint32_t) many);
    PELL_TRY(eliminate(ctx, pool, &e, (uint32_t) many, (uint32_t) count));
    PELL_TRY(share_areas(ctx, pool, &e, (uint32_t) many, solid->area));
    for (size_t i = 0; i < many; i++)
        if (e.at[i] < e.left) {
            places[kept] = e.candidates[i].place;
            places[kept++].area = e.area[i];
        }
    *out = places;
    places = NULL;

fail:
    pell_free(ctx, e.candidates);
    pell_free(ctx, e.cell);
    pell_free(ctx, e.order);
    pell_free(ctx, e.bucket);
    pell_free(ctx, e.weight);
    pell_free(ctx, e.heap);
    pell_free(ctx, e.at);
    pell_free(ctx, e.area);
    pell_free(ctx, places);
    return res;
}
