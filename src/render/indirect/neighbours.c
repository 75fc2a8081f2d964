/* SPDX-License-Identifier: MIT
 *
 * neighbours.c - the samples around each knot, and their weights. A sample counts if it is on the same medium and side and has a similar
 * normal; its weight falls with its distance and with its height over the knot's plane. Samples are placed at random, and at an edge all
 * are on one side: the weights are corrected linearly, so that a quantity with a slope over the surface is interpolated correctly at the
 * knot.
 */
#include "render/indirect/internal.h"
#include "render/indirect/slope.h"

#include "scene/mesh/topology.h"

#include <string.h>

#define REACH 2.6f      /* initial search radius, in spacings */
#define MAX_TRIES 4     /* largest number of times that the radius is doubled until there is a sample */
#define TRIES_INSIDE 2  /* the same for points inside of another part of the object, which nobody sees */
#define MIN_FACING 0.3f /* least cosine between the normals */
#define MAX_SLOPE 0.9f  /* largest relative change of a weight by the correction */
#define CHUNK 1024      /* knots per task */
#define LEAF 8          /* samples per leaf of the tree */

/* k-d trees in an array, one for the samples of each key: samples[order[...]]; the median of a range splits it (Bentley 1975). */
struct kd_trees {
    uint32_t *order, *key; /* two words per sample, in order: the key that grouped samples share */
    uint8_t *axis;         /* split axis of the range that has this median */
    size_t count;
};

/* How samples are grouped: by medium and side, and for translucent objects also by object. */
enum grouping { BY_MEDIUM, BY_OBJECT, GROUPINGS };

struct search {
    struct pell_indirect *in;
    const struct indirect_spacing *spacing;
    struct kd_trees kd_trees[GROUPINGS];
    bool back;
};

static float coordinate(struct pell_vec3 p, int axis)
{
    return axis == 0 ? p.x : axis == 1 ? p.y : p.z;
}

/* Quickselect: moves the sample of rank `middle` of [low, high) to its place, with smaller ones before it; ties are ordered by index. */
static void split(const struct pell_indirect *in, uint32_t *order, uint32_t low, uint32_t high, uint32_t middle, int axis)
{
    while (high - low > 1) {
        const uint32_t pivot = order[low + (high - low) / 2];
        const float at = coordinate(in->samples[pivot].position, axis);
        uint32_t i = low, j = high - 1;
        for (;;) {
            while (coordinate(in->samples[order[i]].position, axis) < at ||
                   (coordinate(in->samples[order[i]].position, axis) == at && order[i] < pivot))
                i++;
            while (coordinate(in->samples[order[j]].position, axis) > at ||
                   (coordinate(in->samples[order[j]].position, axis) == at && order[j] > pivot))
                j--;
            if (i >= j)
                break;
            const uint32_t swap = order[i];
            order[i] = order[j];
            order[j] = swap;
        }
        if (i == middle)
            return;
        if (i < middle)
            low = i + 1;
        else
            high = i;
    }
}

static void build(const struct pell_indirect *in, const struct kd_trees *t, uint32_t low, uint32_t high)
{
    while (high - low > LEAF && !pell_cancelled(in->ctx)) {
        const uint32_t middle = low + (high - low) / 2;
        struct pell_vec3 least = vec3(INFINITY, INFINITY, INFINITY), most = vec3(-INFINITY, -INFINITY, -INFINITY), d;
        for (uint32_t i = low; i < high; i++) {
            const struct pell_vec3 p = in->samples[t->order[i]].position;
            least = vec3(fminf(least.x, p.x), fminf(least.y, p.y), fminf(least.z, p.z));
            most = vec3(fmaxf(most.x, p.x), fmaxf(most.y, p.y), fmaxf(most.z, p.z));
        }
        d = vec3_sub(most, least);
        t->axis[middle] = d.x >= d.y && d.x >= d.z ? 0 : d.y >= d.z ? 1 : 2;
        split(in, t->order, low, high, middle, t->axis[middle]);
        build(in, t, low, middle);
        low = middle + 1;
    }
}

static void set_key(enum grouping which, uint32_t medium, bool back, int object, uint32_t key[2])
{
    key[0] = 2 * medium + (back ? 1 : 0);
    key[1] = which == BY_OBJECT ? (uint32_t) object : 0;
}

static int compare_keys(const uint32_t a[2], const uint32_t b[2])
{
    return a[0] != b[0] ? (a[0] < b[0] ? -1 : 1) : a[1] != b[1] ? (a[1] < b[1] ? -1 : 1) : 0;
}

static enum pell_result make_trees(const struct pell_indirect *in, enum grouping which, struct kd_trees *t)
{
    const size_t n = in->num_samples;
    uint32_t *key = pell_alloc_array(in->ctx, n, 3 * sizeof(*key)), *sorted;
    enum pell_result res = PELL_ERR_NOMEM;

    t->count = n;
    t->order = pell_alloc_array(in->ctx, n, sizeof(*t->order));
    t->key = pell_alloc_array(in->ctx, n, 2 * sizeof(*t->key));
    t->axis = pell_calloc(in->ctx, n, sizeof(*t->axis));
    if (!key || !t->order || !t->key || !t->axis)
        goto fail;
    for (size_t i = 0; i < n; i++)
        set_key(which, in->samples[i].medium, in->samples[i].back, pell_mesh_assembly(&in->p.scene->meshes[in->samples[i].mesh]),
                key + 2 * i);
    sorted = pell_sort_keys(in->ctx, key, 2, t->order, key + 2 * n, (uint32_t) n);
    res = pell_cancelled(in->ctx) ? PELL_ERR_CANCELLED : PELL_OK;
    if (res != PELL_OK)
        goto fail;
    if (sorted != t->order)
        memcpy(t->order, sorted, n * sizeof(*sorted));
    for (size_t i = 0; i < n; i++)
        memcpy(t->key + 2 * i, key + 2 * (size_t) t->order[i], 2 * sizeof(*key));
    for (size_t i = 0, end; i < n; i = end) {
        for (end = i + 1; end < n && compare_keys(t->key + 2 * end, t->key + 2 * i) == 0; end++)
            ;
        build(in, t, (uint32_t) i, (uint32_t) end);
    }

fail:
    pell_free(in->ctx, key);
    return res;
}

/* Returns the first index whose key is not less than `key`, or with `upper`, greater. */
static uint32_t find_bound(const struct kd_trees *t, const uint32_t key[2], bool upper)
{
    size_t low = 0, high = t->count;

    while (low < high) {
        const size_t middle = low + (high - low) / 2;
        if (compare_keys(t->key + 2 * middle, key) < (upper ? 1 : 0))
            low = middle + 1;
        else
            high = middle;
    }
    return (uint32_t) low;
}

/* A query, and the best samples so far, heaviest first. */
struct query {
    const struct indirect_knot *knot; /* NULL: a vertex */
    struct pell_vec3 position, normal;
    float reach, spacing;
    struct indirect_near found;
    int count;
};

static void add_candidate(const struct pell_indirect *in, uint32_t sample_index, struct query *q)
{
    const struct indirect_sample *s = &in->samples[sample_index];
    const struct pell_vec3 d = vec3_sub(s->position, q->position);
    const float d2 = vec3_dot(d, d), facing = vec3_dot(s->smooth, q->normal), height = vec3_dot(d, q->normal) / q->spacing;
    float w = 1.0f - d2 / (q->reach * q->reach);
    int at;

    if (!(w > 0.0f) || !(facing > MIN_FACING))
        return;
    w = w * w * facing * facing / (1.0f + 4.0f * height * height);
    at = q->count < INDIRECT_NEAR ? q->count++ : INDIRECT_NEAR - 1;
    if (at == INDIRECT_NEAR - 1 && q->found.weight[at] >= w)
        return;
    for (; at > 0 && q->found.weight[at - 1] < w; at--) {
        q->found.sample[at] = q->found.sample[at - 1];
        q->found.weight[at] = q->found.weight[at - 1];
    }
    q->found.sample[at] = sample_index;
    q->found.weight[at] = w;
}

static void search_tree(const struct pell_indirect *in, const struct kd_trees *t, uint32_t low, uint32_t high, struct query *q)
{
    while (high - low > LEAF) {
        const uint32_t middle = low + (high - low) / 2;
        const int axis = t->axis[middle];
        const float d = coordinate(q->position, axis) - coordinate(in->samples[t->order[middle]].position, axis);
        if (fabsf(d) < q->reach) {
            search_tree(in, t, low, middle, q);
            add_candidate(in, t->order[middle], q);
            low = middle + 1;
        } else if (d > 0.0f) {
            low = middle + 1;
        } else {
            high = middle;
        }
    }
    for (; low < high; low++)
        add_candidate(in, t->order[low], q);
}

static void find_neighbours(const struct search *s, enum grouping which, const struct indirect_sample *key_sample, struct query *q)
{
    const struct kd_trees *t = &s->kd_trees[which];
    uint32_t key[2], low, high;

    set_key(which, key_sample->medium, key_sample->back, pell_mesh_assembly(&s->in->p.scene->meshes[key_sample->mesh]), key);
    low = find_bound(t, key, false);
    high = find_bound(t, key, true);
    q->reach = REACH * q->spacing;
    for (int i = 0; i < MAX_TRIES && low < high && q->count == 0; i++) {
        if (i == TRIES_INSIDE && q->knot && pell_rays_inner(s->in->p.rays, key_sample->mesh, q->knot->triangle, q->knot->u, q->knot->v))
            break;
        memset(&q->found, 0, sizeof(q->found));
        search_tree(s->in, t, low, high, q);
        q->reach *= 2.0f;
    }
}

/* Corrects the weights linearly so that their centroid is at the knot, as far as they stay positive. */
static void centre_weights(const struct pell_indirect *in, struct query *q)
{
    struct slope_sums sums = { .one = 0.0f };
    struct pell_vec3 t, b;
    float far2 = 0.0f, slope[2];

    vec3_basis(q->normal, &t, &b);
    for (int i = 0; i < q->count; i++) {
        const struct pell_vec3 d = vec3_sub(in->samples[q->found.sample[i]].position, q->position);
        const float x = vec3_dot(d, t), y = vec3_dot(d, b);
        slope_add(&sums, q->found.weight[i], x, y, 0.0f);
        far2 = fmaxf(far2, x * x + y * y);
    }
    slope_centre(&sums, MAX_SLOPE / sqrtf(fmaxf(far2, 1e-20f)), slope);
    for (int i = 0; i < q->count; i++) {
        const struct pell_vec3 d = vec3_sub(in->samples[q->found.sample[i]].position, q->position);
        q->found.weight[i] *= 1.0f + slope[0] * vec3_dot(d, t) + slope[1] * vec3_dot(d, b);
    }
}

/* Finds the samples of a knot. Light inside a translucent object can differ from that on other surfaces in or near it, so an object uses
 * its own samples, unless it is too small to have any. */
static void find_knot(const struct search *s, uint32_t mesh, struct indirect_point point, uint32_t knot_index)
{
    const struct pell_scene *scene = s->in->p.scene;
    const int material = scene->meshes[mesh].material;
    const struct indirect_sample key_sample = { .mesh = mesh, .medium = s->in->same[material], .back = s->back };
    struct query q = {
        .knot = knot_index < s->in->num_mesh_knots ? NULL : &s->in->extra[knot_index - s->in->num_mesh_knots],
        .position = point.position,
        .normal = vec3_mul(vec3_normalize(point.normal), s->back ? -1.0f : 1.0f),
        .spacing = indirect_spacing_at(s->spacing, point.position),
    };
    float sum = 0.0f;

    if (s->back && !scene->materials[material].opaque)
        return;
    if (!scene->materials[material].opaque)
        find_neighbours(s, BY_OBJECT, &key_sample, &q);
    if (q.count == 0)
        find_neighbours(s, BY_MEDIUM, &key_sample, &q);
    centre_weights(s->in, &q);
    for (int i = 0; i < q.count; i++)
        sum += q.found.weight[i];
    for (int i = 0; i < q.count; i++)
        q.found.weight[i] /= sum;
    s->in->near[indirect_value_of(s->in, mesh, knot_index, s->back)] = q.found;
}

static void near_chunk(void *arg, int index, int worker)
{
    const struct search *s = arg;
    const struct pell_indirect *in = s->in;
    const struct pell_scene *scene = in->p.scene;
    const size_t first = (size_t) index * CHUNK, end = first + CHUNK < in->num_knots ? first + CHUNK : in->num_knots;
    size_t mesh = 0;

    (void) worker;
    for (size_t k = first; k < end; k++) {
        struct indirect_point point;
        if (k >= in->num_mesh_knots) {
            const struct indirect_knot *e = &in->extra[k - in->num_mesh_knots];
            find_knot(s, e->mesh, indirect_point_at(&scene->meshes[e->mesh], e->triangle, e->u, e->v), (uint32_t) k);
            continue;
        }
        while (k >= (size_t) in->meshes[mesh].first_knot + scene->meshes[mesh].num_vertices)
            mesh++;
        if (!indirect_shown(scene, &scene->meshes[mesh]))
            continue;
        point.position = vec3_load(scene->meshes[mesh].position + 3 * (k - in->meshes[mesh].first_knot));
        point.normal = vec3_load(scene->meshes[mesh].normal + 3 * (k - in->meshes[mesh].first_knot));
        find_knot(s, (uint32_t) mesh, point, (uint32_t) k);
    }
}

enum pell_result indirect_near_make(struct pell_indirect *in, struct pell_pool *pool, const struct indirect_spacing *spacing)
{
    struct search s = { .in = in, .spacing = spacing };
    enum pell_result res = PELL_OK;

    if (!(in->near = pell_calloc(in->ctx, in->num_values, sizeof(*in->near))))
        return PELL_ERR_NOMEM;
    for (int i = 0; i < GROUPINGS && res == PELL_OK; i++)
        res = make_trees(in, (enum grouping) i, &s.kd_trees[i]);
    for (int side = 0; side < 2 && res == PELL_OK; side++) {
        s.back = side == 1;
        pell_pool_run(pool, (int) ((in->num_knots + CHUNK - 1) / CHUNK), near_chunk, &s);
    }
    if (res == PELL_OK && pell_cancelled(in->ctx))
        res = PELL_ERR_CANCELLED;
    for (int i = 0; i < GROUPINGS; i++) {
        pell_free(in->ctx, s.kd_trees[i].order);
        pell_free(in->ctx, s.kd_trees[i].key);
        pell_free(in->ctx, s.kd_trees[i].axis);
    }
    return res;
}
