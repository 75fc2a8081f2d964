/* SPDX-License-Identifier: MIT
 * places.c - see places.h. Samples at least PICK apart come first; each then moves to the middle of the samples that are nearest to it, by
 * position and normal (S. P. Lloyd, "Least squares quantization in PCM", IEEE Trans. Inf. Theory 28(2), 1982). */
#include "render/indirect/places.h"

#include "base/base.h"
#include "scene/mesh/topology.h"

#include <math.h>
#include <string.h>

enum { SAMPLES = 256, ROUNDS = 3 };
#define MASK ((size_t) 2 * PLACES_MOST - 1) /* of buckets */
#define CLUSTER 3.0f                        /* distances of places that clusters are apart */
#define PICK 0.85f                          /* of the distance: no two places are nearer at first */
#define FACING 0.3f                         /* least cosine of the normals that one place stands for */
#define TURN 0.7f                           /* distances that turning a normal by its length counts as */

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

static void put(struct places *s, uint32_t i)
{
    struct place *p = &s->place[i];
    uint32_t b;

    cell_of(s->step, p->position, p->cell);
    b = bucket_of(p->cell);
    p->next = s->bucket[b];
    s->bucket[b] = i;
}

/* The nearest place by position and normal, or PLACES_NONE; `within`: the nearest square distance of one that faces the same way. */
static uint32_t nearest(const struct places *s, struct pell_vec3 at, struct pell_vec3 normal, float *within)
{
    int32_t middle[3], cell[3];
    uint32_t best = PLACES_NONE;
    float least = INFINITY;

    *within = INFINITY;
    cell_of(s->step, at, middle);
    for (int n = 0; n < 27; n++) {
        cell[0] = middle[0] + n % 3 - 1;
        cell[1] = middle[1] + n / 3 % 3 - 1;
        cell[2] = middle[2] + n / 9 - 1;
        for (uint32_t i = s->bucket[bucket_of(cell)]; i != PLACES_NONE; i = s->place[i].next) {
            const struct place *p = &s->place[i];
            const struct pell_vec3 d = vec3_sub(p->position, at);
            const float d2 = vec3_dot(d, d), facing = vec3_dot(p->normal, normal);
            const float far = d2 + 2.0f * TURN * TURN * s->step * s->step * (1.0f - facing);
            if (memcmp(p->cell, cell, sizeof(cell)) != 0)
                continue;
            if (facing > FACING)
                *within = fminf(*within, d2);
            if (far < least) {
                least = far;
                best = i;
            }
        }
    }
    return best;
}

static void find_chunk(void *arg, int chunk, int worker)
{
    struct places *s = arg;
    const size_t first = (size_t) chunk * SAMPLES;
    float within;

    (void) worker;
    for (size_t i = first; i < first + SAMPLES && i < s->num_samples; i++)
        s->of[i] = nearest(s, vec3_load(s->sample[i].position), vec3_load(s->sample[i].normal), &within);
}

/* Each sample to its place, and places to the middle of theirs; those without one go. False: cancelled. */
static bool gather_samples(struct places *s, bool move)
{
    uint32_t kept = 0;

    pell_pool_run(s->pool, (int) ((s->num_samples + SAMPLES - 1) / SAMPLES), find_chunk, s);
    if (pell_cancelled(s->ctx))
        return false; /* not every sample has one */
    for (uint32_t i = 0; i < s->count; i++)
        s->place[i].area = s->place[i].curvature = 0.0f;
    for (size_t i = 0; i < s->num_samples; i++) {
        const struct pell_lit_place *p = &s->sample[i];
        if (s->of[i] == PLACES_NONE)
            continue;
        s->place[s->of[i]].area += p->area;
        s->place[s->of[i]].curvature += p->area * p->curvature;
    }
    for (uint32_t i = 0; i < s->count; i++)
        if (s->place[i].area > 0.0f)
            s->place[i].curvature /= s->place[i].area;
    if (!move)
        return true;
    for (uint32_t i = 0; i < s->count; i++)
        s->place[i].position = s->place[i].normal = vec3(0.0f, 0.0f, 0.0f);
    for (size_t i = 0; i < s->num_samples; i++) {
        const struct pell_lit_place *p = &s->sample[i];
        if (s->of[i] == PLACES_NONE)
            continue;
        struct place *q = &s->place[s->of[i]];
        q->position = vec3_mad(q->position, p->area / q->area, vec3_load(p->position));
        q->normal = vec3_mad(q->normal, p->area, vec3_load(p->normal));
    }
    memset(s->bucket, 0xff, (MASK + 1) * sizeof(*s->bucket));
    for (uint32_t i = 0; i < s->count; i++) {
        if (!(s->place[i].area > 0.0f))
            continue;
        s->place[kept] = s->place[i];
        s->place[kept].normal = vec3_normalize(s->place[kept].normal);
        put(s, kept++);
    }
    s->count = kept;
    return true;
}

/* Places to the sample of theirs that is nearest to their middle: a surface is there, and not two of them. */
static void snap(struct places *s)
{
    for (uint32_t i = 0; i < s->count; i++)
        s->place[i].far = INFINITY;
    for (size_t i = 0; i < s->num_samples; i++) {
        struct place *p = s->of[i] == PLACES_NONE ? NULL : &s->place[s->of[i]];
        if (p) {
            const struct pell_vec3 d = vec3_sub(vec3_load(s->sample[i].position), p->position);
            const float far = vec3_dot(d, d) + s->step * s->step * (1.0f - vec3_dot(p->normal, vec3_load(s->sample[i].normal)));
            if (far < p->far) {
                p->far = far;
                p->nearest = (uint32_t) i;
            }
        }
    }
    for (uint32_t i = 0; i < s->count; i++) {
        struct place *p = &s->place[i];
        if (p->far < INFINITY) {
            p->position = vec3_load(s->sample[p->nearest].position);
            p->normal = vec3_load(s->sample[p->nearest].normal);
        }
    }
}

/* Chooses places, `step` apart. */
static enum pell_result choose(struct places *s, float step)
{
    const float apart2 = PICK * PICK * step * step;
    float within;

    s->step = step;
    memset(s->bucket, 0xff, (MASK + 1) * sizeof(*s->bucket));
    s->count = 0;
    for (size_t i = 0; i < s->num_samples && s->count < PLACES_MOST; i++) {
        const struct pell_lit_place *p = &s->sample[i];
        const struct pell_vec3 at = vec3_load(p->position), normal = vec3_load(p->normal);
        nearest(s, at, normal, &within);
        if (within < apart2)
            continue;
        s->place[s->count] = (struct place) { .position = at, .normal = normal };
        put(s, s->count++);
    }
    for (int round = 0; round <= ROUNDS; round++)
        if (!gather_samples(s, round < ROUNDS))
            return PELL_ERR_CANCELLED;
    return PELL_OK;
}

/* Cells along a curve that fills space, Z upon Z (G. M. Morton 1966). */
static uint64_t code_of(const void *items, size_t index)
{
    const struct place *p = (const struct place *) items + index;
    uint64_t code = 0;

    for (int bit = 20; bit >= 0; bit--)
        for (int k = 0; k < 3; k++)
            code = code << 1 | ((uint32_t) (p->cell[k] + (1 << 20)) >> bit & 1u);
    return code;
}

/* Which cluster each place is of: places of places, farther apart. Those that are near each other follow each other, so that what a place
 * sees as clusters and as places comes in few runs. */
static enum pell_result choose_clusters(struct places *s, uint32_t *of)
{
    struct pell_lit_place *place = pell_calloc(s->ctx, s->count, sizeof(*place));
    struct places wide = { .ctx = NULL };
    uint32_t *order = NULL, *number = NULL;
    enum pell_result res = PELL_ERR_NOMEM;

    if (!place)
        goto fail;
    for (uint32_t i = 0; i < s->count; i++) {
        place[i].area = s->place[i].area;
        vec3_store(s->place[i].position, place[i].position);
        vec3_store(s->place[i].normal, place[i].normal);
    }
    PELL_TRY(indirect_places_create(s->ctx, s->pool, place, s->count, &wide));
    PELL_TRY(choose(&wide, CLUSTER * s->step));
    PELL_TRY(pell_order_by_code(s->ctx, wide.count, code_of, wide.place, &order));
    res = PELL_ERR_NOMEM;
    if (!(number = pell_alloc_array(s->ctx, wide.count, sizeof(*number))))
        goto fail;
    for (uint32_t k = 0; k < wide.count; k++)
        number[order[k]] = k;
    s->num_clusters = wide.count;
    for (uint32_t i = 0; i < s->count; i++)
        of[i] = wide.of[i] != PLACES_NONE ? number[wide.of[i]] : s->num_clusters++;
    res = PELL_OK;

fail:
    indirect_places_finish(&wide);
    pell_free(s->ctx, place);
    pell_free(s->ctx, order);
    pell_free(s->ctx, number);
    return res;
}

/* Puts the places of each cluster beside each other. */
static enum pell_result make_clusters(struct places *s)
{
    uint32_t next = 0, *of = pell_alloc_array(s->ctx, s->count, 2 * sizeof(*of)), *moved = of ? of + s->count : NULL;
    struct place *old = s->place;
    enum pell_result res = PELL_ERR_NOMEM;

    if (!of)
        return res;
    PELL_TRY(choose_clusters(s, of));
    memset(s->cluster, 0, s->num_clusters * sizeof(*s->cluster));
    for (uint32_t i = 0; i < s->count; i++) {
        struct cluster *c = &s->cluster[of[i]];
        const struct place *p = &s->place[i];
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
        struct cluster *c = &s->cluster[of[i]];
        c->radius = fmaxf(c->radius, vec3_length(vec3_sub(old[i].position, c->position)));
        s->sorted[c->end] = old[i];
        s->sorted[c->end].cluster = of[i];
        moved[i] = c->end++;
    }
    for (size_t i = 0; i < s->num_samples; i++)
        if (s->of[i] != PLACES_NONE)
            s->of[i] = moved[s->of[i]];
    s->place = s->sorted;
    s->sorted = old;

fail:
    pell_free(s->ctx, of);
    return res;
}

enum pell_result indirect_places_choose(struct places *s, float step)
{
    enum pell_result res = choose(s, step);

    if (res != PELL_OK)
        return res;
    snap(s);
    return make_clusters(s);
}

enum pell_result indirect_places_create(struct pell_context *ctx, struct pell_pool *pool, const struct pell_lit_place *samples,
                                        size_t num_samples, struct places *out)
{
    *out = (struct places) { .ctx = ctx, .pool = pool, .sample = samples, .num_samples = num_samples };
    out->place = pell_alloc_array(ctx, PLACES_MOST, sizeof(*out->place));
    out->sorted = pell_alloc_array(ctx, PLACES_MOST, sizeof(*out->sorted));
    out->cluster = pell_alloc_array(ctx, PLACES_MOST, 2 * sizeof(*out->cluster)); /* chosen ones, and of places that none is near */
    out->bucket = pell_alloc_array(ctx, MASK + 1, sizeof(*out->bucket));
    out->of = pell_alloc_array(ctx, num_samples, sizeof(*out->of));
    if (out->place && out->sorted && out->cluster && out->bucket && out->of)
        return PELL_OK;
    indirect_places_finish(out);
    return PELL_ERR_NOMEM;
}

void indirect_places_finish(struct places *p)
{
    if (!p->ctx)
        return;
    pell_free(p->ctx, p->place);
    pell_free(p->ctx, p->sorted);
    pell_free(p->ctx, p->cluster);
    pell_free(p->ctx, p->bucket);
    pell_free(p->ctx, p->of);
    *p = (struct places) { .place = NULL };
}
