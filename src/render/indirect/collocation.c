/* SPDX-License-Identifier: MIT
 * collocation.c - see collocation.h. Starts from samples that are at least MIN_SPACING apart, then moves each point to the centroid of the
 * samples nearest to it by position and normal (S. P. Lloyd, "Least squares quantization in PCM", IEEE Trans. Inf. Theory 28(2), 1982). */
#include "render/indirect/collocation.h"

#include "base/base.h"
#include "scene/mesh/topology.h"

#include <math.h>
#include <string.h>

enum { SAMPLES = 256, ITERATIONS = 3 };
#define MASK ((size_t) 2 * COLLOCATION_MAX - 1) /* mask of bucket indices */
#define CLUSTER_SPACING 3.0f                    /* distance of clusters, in steps */
#define MIN_SPACING 0.85f                       /* least distance of two initial points, in steps */
#define MIN_FACING 0.3f                         /* least cosine between the normals of a point and its samples */
#define NORMAL_WEIGHT 0.7f                      /* steps; distance to which a difference of the normals of length 1 is equivalent */

static uint32_t bucket_of(const int32_t cell[3])
{
    const uint64_t key = ((uint64_t) (uint32_t) cell[0] * 0x9e3779b97f4a7c15ull) ^ ((uint64_t) (uint32_t) cell[1] * 0xc2b2ae3d27d4eb4full) ^
                         ((uint64_t) (uint32_t) cell[2] * 0x165667b19e3779f9ull);
    return (uint32_t) (key >> 32) & MASK;
}

static void cell_of(float size, struct pell_vec3 p, int32_t cell[3])
{
    const float x[3] = { p.x, p.y, p.z };

    for (int k = 0; k < 3; k++)
        cell[k] = (int32_t) fminf(fmaxf(floorf(x[k] / size), -1e9f), 1e9f);
}

static void insert_point(struct collocation_points *s, uint32_t i)
{
    struct collocation_point *p = &s->point[i];
    uint32_t b;

    cell_of(s->step, p->position, p->cell);
    b = bucket_of(p->cell);
    p->next = s->bucket[b];
    s->bucket[b] = i;
}

/* Returns the nearest point by position and normal, or COLLOCATION_NONE. *nearest_facing2: the least squared distance of a point that
 * faces the same way. */
static uint32_t nearest(const struct collocation_points *s, struct pell_vec3 at, struct pell_vec3 normal, float *nearest_facing2)
{
    int32_t middle[3], cell[3];
    uint32_t best = COLLOCATION_NONE;
    float least = INFINITY;

    *nearest_facing2 = INFINITY;
    cell_of(s->step, at, middle);
    for (int n = 0; n < 27; n++) {
        cell[0] = middle[0] + n % 3 - 1;
        cell[1] = middle[1] + n / 3 % 3 - 1;
        cell[2] = middle[2] + n / 9 - 1;
        for (uint32_t i = s->bucket[bucket_of(cell)]; i != COLLOCATION_NONE; i = s->point[i].next) {
            const struct collocation_point *p = &s->point[i];
            const struct pell_vec3 d = vec3_sub(p->position, at);
            const float d2 = vec3_dot(d, d), facing = vec3_dot(p->normal, normal);
            const float distance2 = d2 + 2.0f * NORMAL_WEIGHT * NORMAL_WEIGHT * s->step * s->step * (1.0f - facing);
            if (memcmp(p->cell, cell, sizeof(cell)) != 0)
                continue;
            if (facing > MIN_FACING)
                *nearest_facing2 = fminf(*nearest_facing2, d2);
            if (distance2 < least) {
                least = distance2;
                best = i;
            }
        }
    }
    return best;
}

static void find_chunk(void *arg, int chunk, int worker)
{
    struct collocation_points *s = arg;
    const size_t first = (size_t) chunk * SAMPLES;
    float nearest_facing2;

    (void) worker;
    for (size_t i = first; i < first + SAMPLES && i < s->num_samples; i++)
        s->point_of[i] = nearest(s, vec3_load(s->sample[i].position), vec3_load(s->sample[i].normal), &nearest_facing2);
}

/* Assigns each sample to a point, moves points to the centroids of their samples, and drops points without samples. Returns false if
 * cancelled. */
static bool gather_samples(struct collocation_points *s, bool move)
{
    uint32_t kept = 0;

    pell_pool_run(s->pool, (int) ((s->num_samples + SAMPLES - 1) / SAMPLES), find_chunk, s);
    if (pell_cancelled(s->ctx))
        return false; /* not every sample was assigned */
    for (uint32_t i = 0; i < s->count; i++)
        s->point[i].area = s->point[i].curvature = 0.0f;
    for (size_t i = 0; i < s->num_samples; i++) {
        const struct pell_surface_sample *p = &s->sample[i];
        if (s->point_of[i] == COLLOCATION_NONE)
            continue;
        s->point[s->point_of[i]].area += p->area;
        s->point[s->point_of[i]].curvature += p->area * p->curvature;
    }
    for (uint32_t i = 0; i < s->count; i++)
        if (s->point[i].area > 0.0f)
            s->point[i].curvature /= s->point[i].area;
    if (!move)
        return true;
    for (uint32_t i = 0; i < s->count; i++)
        s->point[i].position = s->point[i].normal = vec3(0.0f, 0.0f, 0.0f);
    for (size_t i = 0; i < s->num_samples; i++) {
        const struct pell_surface_sample *p = &s->sample[i];
        if (s->point_of[i] == COLLOCATION_NONE)
            continue;
        struct collocation_point *q = &s->point[s->point_of[i]];
        q->position = vec3_mad(q->position, p->area / q->area, vec3_load(p->position));
        q->normal = vec3_mad(q->normal, p->area, vec3_load(p->normal));
    }
    memset(s->bucket, 0xff, (MASK + 1) * sizeof(*s->bucket));
    for (uint32_t i = 0; i < s->count; i++) {
        if (!(s->point[i].area > 0.0f))
            continue;
        s->point[kept] = s->point[i];
        s->point[kept].normal = vec3_normalize(s->point[kept].normal);
        insert_point(s, kept++);
    }
    s->count = kept;
    return true;
}

/* Moves each point to its sample nearest to the centroid, so that it is on a surface, and on one surface only. */
static void snap_to_samples(struct collocation_points *s)
{
    for (uint32_t i = 0; i < s->count; i++)
        s->point[i].distance2 = INFINITY;
    for (size_t i = 0; i < s->num_samples; i++) {
        struct collocation_point *p = s->point_of[i] == COLLOCATION_NONE ? NULL : &s->point[s->point_of[i]];
        if (p) {
            const struct pell_vec3 d = vec3_sub(vec3_load(s->sample[i].position), p->position);
            const float distance2 = vec3_dot(d, d) + s->step * s->step * (1.0f - vec3_dot(p->normal, vec3_load(s->sample[i].normal)));
            if (distance2 < p->distance2) {
                p->distance2 = distance2;
                p->nearest = (uint32_t) i;
            }
        }
    }
    for (uint32_t i = 0; i < s->count; i++) {
        struct collocation_point *p = &s->point[i];
        if (p->distance2 < INFINITY) {
            p->position = vec3_load(s->sample[p->nearest].position);
            p->normal = vec3_load(s->sample[p->nearest].normal);
        }
    }
}

/* Chooses points `step` mm apart. */
static enum pell_result choose(struct collocation_points *s, float step)
{
    const float apart2 = MIN_SPACING * MIN_SPACING * step * step;
    float nearest_facing2;

    s->step = step;
    memset(s->bucket, 0xff, (MASK + 1) * sizeof(*s->bucket));
    s->count = 0;
    for (size_t i = 0; i < s->num_samples && s->count < COLLOCATION_MAX; i++) {
        const struct pell_surface_sample *p = &s->sample[i];
        const struct pell_vec3 at = vec3_load(p->position), normal = vec3_load(p->normal);
        nearest(s, at, normal, &nearest_facing2);
        if (nearest_facing2 < apart2)
            continue;
        s->point[s->count] = (struct collocation_point) { .position = at, .normal = normal };
        insert_point(s, s->count++);
    }
    for (int iteration = 0; iteration <= ITERATIONS; iteration++)
        if (!gather_samples(s, iteration < ITERATIONS))
            return PELL_ERR_CANCELLED;
    return PELL_OK;
}

/* Index of a point's cell along a space-filling Z curve (G. M. Morton 1966). */
static uint64_t morton_code(const void *items, size_t index)
{
    const struct collocation_point *p = (const struct collocation_point *) items + index;
    uint64_t code = 0;

    for (int bit = 20; bit >= 0; bit--)
        for (int k = 0; k < 3; k++)
            code = code << 1 | ((uint32_t) (p->cell[k] + (1 << 20)) >> bit & 1u);
    return code;
}

/* Assigns points to clusters, which are themselves found like points, but farther apart. Nearby clusters get adjacent indices, so that
 * the points and clusters in one row of the equation form few contiguous runs. */
static enum pell_result choose_clusters(struct collocation_points *s, uint32_t *cluster_of)
{
    struct pell_surface_sample *lit = pell_calloc(s->ctx, s->count, sizeof(*lit));
    struct collocation_points coarse = { .ctx = NULL };
    uint32_t *order = NULL, *rank = NULL;
    enum pell_result res = PELL_ERR_NOMEM;

    if (!lit)
        goto fail;
    for (uint32_t i = 0; i < s->count; i++) {
        lit[i].area = s->point[i].area;
        vec3_store(s->point[i].position, lit[i].position);
        vec3_store(s->point[i].normal, lit[i].normal);
    }
    PELL_TRY(indirect_collocation_create(s->ctx, s->pool, lit, s->count, &coarse));
    PELL_TRY(choose(&coarse, CLUSTER_SPACING * s->step));
    PELL_TRY(pell_order_by_code(s->ctx, coarse.count, morton_code, coarse.point, &order));
    res = PELL_ERR_NOMEM;
    if (!(rank = pell_alloc_array(s->ctx, coarse.count, sizeof(*rank))))
        goto fail;
    for (uint32_t k = 0; k < coarse.count; k++)
        rank[order[k]] = k;
    s->num_clusters = coarse.count;
    for (uint32_t i = 0; i < s->count; i++)
        cluster_of[i] = coarse.point_of[i] != COLLOCATION_NONE ? rank[coarse.point_of[i]] : s->num_clusters++;
    res = PELL_OK;

fail:
    indirect_collocation_finish(&coarse);
    pell_free(s->ctx, lit);
    pell_free(s->ctx, order);
    pell_free(s->ctx, rank);
    return res;
}

/* Reorders the points so that those of a cluster are contiguous. */
static enum pell_result make_clusters(struct collocation_points *s)
{
    uint32_t next = 0, *cluster_of = pell_alloc_array(s->ctx, s->count, 2 * sizeof(*cluster_of));
    uint32_t *moved = cluster_of ? cluster_of + s->count : NULL;
    struct collocation_point *old = s->point;
    enum pell_result res = PELL_ERR_NOMEM;

    if (!cluster_of)
        return res;
    PELL_TRY(choose_clusters(s, cluster_of));
    memset(s->cluster, 0, s->num_clusters * sizeof(*s->cluster));
    for (uint32_t i = 0; i < s->count; i++) {
        struct cluster *c = &s->cluster[cluster_of[i]];
        const struct collocation_point *p = &s->point[i];
        c->end++;
        c->area += p->area;
        c->curvature += p->area * p->curvature;
        c->position = vec3_mad(c->position, p->area, p->position);
        c->normal = vec3_mad(c->normal, p->area, p->normal);
    }
    for (uint32_t k = 0; k < s->num_clusters; k++) {
        struct cluster *c = &s->cluster[k];
        const float weight = c->area > 0.0f ? 1.0f / c->area : 0.0f;
        c->curvature *= weight;
        c->position = vec3_mul(c->position, weight);
        c->normal = vec3_mul(c->normal, weight);
        c->first = next;
        next += c->end;
        c->end = c->first;
    }
    for (uint32_t i = 0; i < s->count; i++) {
        struct cluster *c = &s->cluster[cluster_of[i]];
        c->radius = fmaxf(c->radius, vec3_length(vec3_sub(old[i].position, c->position)));
        s->sorted[c->end] = old[i];
        s->sorted[c->end].cluster = cluster_of[i];
        moved[i] = c->end++;
    }
    for (size_t i = 0; i < s->num_samples; i++)
        if (s->point_of[i] != COLLOCATION_NONE)
            s->point_of[i] = moved[s->point_of[i]];
    s->point = s->sorted;
    s->sorted = old;

fail:
    pell_free(s->ctx, cluster_of);
    return res;
}

enum pell_result indirect_collocation_choose(struct collocation_points *s, float step)
{
    enum pell_result res = choose(s, step);

    if (res != PELL_OK)
        return res;
    snap_to_samples(s);
    return make_clusters(s);
}

enum pell_result indirect_collocation_create(struct pell_context *ctx, struct pell_pool *pool, const struct pell_surface_sample *samples,
                                             size_t num_samples, struct collocation_points *out)
{
    *out = (struct collocation_points) { .ctx = ctx, .pool = pool, .sample = samples, .num_samples = num_samples };
    out->point = pell_alloc_array(ctx, COLLOCATION_MAX, sizeof(*out->point));
    out->sorted = pell_alloc_array(ctx, COLLOCATION_MAX, sizeof(*out->sorted));
    out->cluster = pell_alloc_array(ctx, COLLOCATION_MAX, 2 * sizeof(*out->cluster)); /* chosen clusters, and one for each point that is
                                                                                       * near none of them */
    out->bucket = pell_alloc_array(ctx, MASK + 1, sizeof(*out->bucket));
    out->point_of = pell_alloc_array(ctx, num_samples, sizeof(*out->point_of));
    if (out->point && out->sorted && out->cluster && out->bucket && out->point_of)
        return PELL_OK;
    indirect_collocation_finish(out);
    return PELL_ERR_NOMEM;
}

void indirect_collocation_finish(struct collocation_points *p)
{
    if (!p->ctx)
        return;
    pell_free(p->ctx, p->point);
    pell_free(p->ctx, p->sorted);
    pell_free(p->ctx, p->cluster);
    pell_free(p->ctx, p->bucket);
    pell_free(p->ctx, p->point_of);
    *p = (struct collocation_points) { .point = NULL };
}
