/* SPDX-License-Identifier: MIT
 *
 * near.c - the samples around each knot, and their weights. A sample counts where it is on the same material and side and faces much the
 * same way; it weighs less with its distance and its height over the knot's plane.
 */
#include "render/indirect/internal.h"

#include <limits.h>
#include <string.h>

#define ANY INT_MIN /* object */
#define REACH 2.6f  /* of the spacing: how far samples are looked for, at first */
#define TRIES 4     /* the reach is doubled so often at most, until there is a sample */
#define FACING 0.3f /* least cosine between the normals */
#define CHUNK 1024  /* knots of a task */
#define LEAF 8      /* samples of a leaf of the tree */

/* A k-d tree in an array: samples[order[...]], the middle one of a range splits it (Bentley 1975). */
struct search {
    struct pell_indirect *in;
    const struct indirect_spacing *spacing;
    uint32_t *order;
    uint8_t *axis; /* of the range whose middle it is */
    bool back;
};

static float along(struct pell_vec3 p, int axis)
{
    return axis == 0 ? p.x : axis == 1 ? p.y : p.z;
}

/* Puts the sample of rank `middle` of [low, high) in its place, smaller ones before it; equal ones by their numbers. */
static void split(const struct pell_indirect *in, uint32_t *order, uint32_t low, uint32_t high, uint32_t middle, int axis)
{
    while (high - low > 1) {
        const uint32_t pivot = order[low + (high - low) / 2];
        const float at = along(in->samples[pivot].position, axis);
        uint32_t i = low, j = high - 1;
        for (;;) {
            while (along(in->samples[order[i]].position, axis) < at ||
                   (along(in->samples[order[i]].position, axis) == at && order[i] < pivot))
                i++;
            while (along(in->samples[order[j]].position, axis) > at ||
                   (along(in->samples[order[j]].position, axis) == at && order[j] > pivot))
                j--;
            if (i >= j)
                break;
            const uint32_t swap = order[i];
            order[i] = order[j];
            order[j] = swap;
        }
        /* The pivot is at i. */
        if (i == middle)
            return;
        if (i < middle)
            low = i + 1;
        else
            high = i;
    }
}

static void build(struct search *s, uint32_t low, uint32_t high)
{
    while (high - low > LEAF && !pell_cancelled(s->in->ctx)) {
        const uint32_t middle = low + (high - low) / 2;
        struct pell_vec3 least = vec3(INFINITY, INFINITY, INFINITY), most = vec3(-INFINITY, -INFINITY, -INFINITY), d;
        for (uint32_t i = low; i < high; i++) {
            const struct pell_vec3 p = s->in->samples[s->order[i]].position;
            least = vec3(fminf(least.x, p.x), fminf(least.y, p.y), fminf(least.z, p.z));
            most = vec3(fmaxf(most.x, p.x), fmaxf(most.y, p.y), fmaxf(most.z, p.z));
        }
        d = vec3_sub(most, least);
        s->axis[middle] = d.x >= d.y && d.x >= d.z ? 0 : d.y >= d.z ? 1 : 2;
        split(s->in, s->order, low, high, middle, s->axis[middle]);
        build(s, low, middle);
        low = middle + 1;
    }
}

/* What is looked for, and the best of it so far, heaviest first. */
struct query {
    struct pell_vec3 position, normal;
    uint32_t material;
    int object; /* or ANY */
    bool back;
    float reach, spacing;
    struct indirect_near found;
    int count;
};

static void consider(const struct pell_indirect *in, uint32_t number, struct query *q)
{
    const struct indirect_sample *s = &in->samples[number];
    const struct pell_vec3 d = vec3_sub(s->position, q->position);
    const float d2 = vec3_dot(d, d), facing = vec3_dot(s->smooth, q->normal), height = vec3_dot(d, q->normal) / q->spacing;
    float w = 1.0f - d2 / (q->reach * q->reach);
    int at;

    if (!(w > 0.0f) || !(facing > FACING) || s->material != q->material || s->back != q->back)
        return;
    if (q->object != ANY && in->p.scene->meshes[s->mesh].object != q->object)
        return;
    w = w * w * facing * facing / (1.0f + 4.0f * height * height);
    at = q->count < INDIRECT_NEAR ? q->count++ : INDIRECT_NEAR - 1;
    if (at == INDIRECT_NEAR - 1 && q->found.weight[at] >= w)
        return;
    for (; at > 0 && q->found.weight[at - 1] < w; at--) {
        q->found.sample[at] = q->found.sample[at - 1];
        q->found.weight[at] = q->found.weight[at - 1];
    }
    q->found.sample[at] = number;
    q->found.weight[at] = w;
}

static void look(const struct search *s, uint32_t low, uint32_t high, struct query *q)
{
    while (high - low > LEAF) {
        const uint32_t middle = low + (high - low) / 2;
        const int axis = s->axis[middle];
        const float d = along(q->position, axis) - along(s->in->samples[s->order[middle]].position, axis);
        if (fabsf(d) < q->reach) {
            look(s, low, middle, q);
            consider(s->in, s->order[middle], q);
            low = middle + 1;
        } else if (d > 0.0f) {
            low = middle + 1;
        } else {
            high = middle;
        }
    }
    for (; low < high; low++)
        consider(s->in, s->order[low], q);
}

static void try_near(const struct search *s, struct query *q)
{
    q->reach = REACH * q->spacing;
    for (int i = 0; i < TRIES && q->count == 0; i++) {
        memset(&q->found, 0, sizeof(q->found));
        look(s, 0, (uint32_t) s->in->num_samples, q);
        q->reach *= 2.0f;
    }
}

/* What lies in or close to a translucent object may be in quite another light inside: it counts for those alone that are too small to have
 * samples. */
static void find_near(const struct search *s, struct query *q)
{
    float sum = 0.0f;

    try_near(s, q);
    if (q->count == 0 && q->object != ANY) {
        q->object = ANY;
        try_near(s, q);
    }
    for (int i = 0; i < q->count; i++)
        sum += q->found.weight[i];
    for (int i = 0; i < q->count; i++)
        q->found.weight[i] /= sum;
}

/* Knots of one mesh, `first` to `end` of its vertices, or of those that cells have. */
static void find_knot(const struct search *s, uint32_t mesh, struct indirect_place place, uint32_t knot)
{
    const struct pell_scene *scene = s->in->p.scene;
    const int material = scene->meshes[mesh].material;
    struct query q = {
        .position = place.position,
        .normal = vec3_mul(vec3_normalize(place.normal), s->back ? -1.0f : 1.0f),
        .material = (uint32_t) material,
        .object = scene->materials[material].opaque ? ANY : scene->meshes[mesh].object,
        .back = s->back,
        .spacing = indirect_spacing_at(s->spacing, place.position),
    };

    if (s->back && !scene->materials[material].opaque)
        return;
    find_near(s, &q);
    s->in->near[indirect_value_of(s->in, mesh, knot, s->back)] = q.found;
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
        struct indirect_place place;
        if (k >= in->num_mesh_knots) {
            const struct indirect_knot *e = &in->extra[k - in->num_mesh_knots];
            find_knot(s, e->mesh, indirect_place_at(&scene->meshes[e->mesh], e->triangle, e->u, e->v), (uint32_t) k);
            continue;
        }
        while (k >= (size_t) in->meshes[mesh].first_knot + scene->meshes[mesh].num_vertices)
            mesh++;
        if (!indirect_shown(scene, &scene->meshes[mesh]))
            continue;
        place.position = vec3_load(scene->meshes[mesh].position + 3 * (k - in->meshes[mesh].first_knot));
        place.normal = vec3_load(scene->meshes[mesh].normal + 3 * (k - in->meshes[mesh].first_knot));
        find_knot(s, (uint32_t) mesh, place, (uint32_t) k);
    }
}

enum pell_result indirect_near_make(struct pell_indirect *in, struct pell_pool *pool, const struct indirect_spacing *spacing)
{
    struct search s = { .in = in, .spacing = spacing };
    enum pell_result res = PELL_ERR_NOMEM;

    s.order = pell_alloc_array(in->ctx, in->num_samples, sizeof(*s.order));
    s.axis = pell_calloc(in->ctx, in->num_samples, sizeof(*s.axis));
    in->near = pell_calloc(in->ctx, in->num_values, sizeof(*in->near));
    if (!s.order || !s.axis || !in->near)
        goto fail;
    for (size_t i = 0; i < in->num_samples; i++)
        s.order[i] = (uint32_t) i;
    build(&s, 0, (uint32_t) in->num_samples);
    for (int side = 0; side < 2; side++) {
        s.back = side == 1;
        pell_pool_run(pool, (int) ((in->num_knots + CHUNK - 1) / CHUNK), near_chunk, &s);
    }
    res = pell_cancelled(in->ctx) ? PELL_ERR_CANCELLED : PELL_OK;

fail:
    pell_free(in->ctx, s.order);
    pell_free(in->ctx, s.axis);
    return res;
}
