/* SPDX-License-Identifier: MIT
 *
 * cpu.c - the stage: patches of one object and material, the curvature at their vertices, and the gain that follows from it.
 */
#include "render/curvature/internal.h"

#include "scene/mesh/topology.h"

#include <pellucid/profile.h>

#include <string.h>

#define GAINS 257      /* of a material's table: over curvatures from -limit to limit */
#define CELLS_MOST 256 /* along an object's longest side */
#define CHUNK 4096     /* vertices of a task */
#define NO_PATCH UINT32_MAX
#define SHIFT_MOST 0.3f /* so that no light from straight above turns negative */
#define SHARE 0.95      /* of a profile: what lies inside the distance over which curvature is averaged */

struct curvature_law {
    bool there;
    float step;    /* mm: the distance of averaging */
    float limit;   /* 1/mm */
    float path[3]; /* mean free path over index, mm */
    float gain[GAINS][3];
};

struct pell_curvature {
    struct pell_context *ctx;
    const struct pell_scene *scene;
    struct curvature_law *law; /* per scene material */
    uint32_t *patch_of;        /* per mesh, or NO_PATCH */
    struct curvature_patch *patch;
    size_t num_patches, room_patches;
    struct curvature_grid grid;
    float **value; /* per mesh with a patch: the curvature at its vertices */
};

void pell_curvature_destroy(struct pell_curvature **curvature)
{
    struct pell_curvature *k = *curvature;

    if (!k)
        return;
    for (size_t i = 0; k->value && i < k->scene->num_meshes; i++)
        pell_free(k->ctx, k->value[i]);
    pell_free(k->ctx, k->value);
    pell_free(k->ctx, k->law);
    pell_free(k->ctx, k->patch_of);
    pell_free(k->ctx, k->patch);
    pell_free(k->ctx, k->grid.node);
    pell_free(k->ctx, k);
    *curvature = NULL;
}

/* Radius inside which there is this share of the profile, mm. */
static double radius_of(const struct pell_profile *profile, double share)
{
    double low = -12.0, high = 12.0;

    for (int i = 0; i < 40; i++) {
        const double middle = 0.5 * (low + high);
        if (pell_profile_cdf(profile, exp(middle)) < share)
            low = middle;
        else
            high = middle;
    }
    return exp(low);
}

static void make_law(const struct pell_curvature_medium *m, struct curvature_law *law)
{
    double sum = 0.0, weight = 0.0, thickest = 0.0;

    for (int c = 0; c < 3; c++) {
        const double total = pell_profile_total(&m->profile[c]);
        if (!(total > 0.0))
            continue;
        sum += total * radius_of(&m->profile[c], SHARE);
        weight += total;
        thickest = fmax(thickest, m->medium->sigma_a[c] + m->medium->sigma_s_reduced[c]);
    }
    if (!(weight > 0.0))
        return;
    law->there = true;
    law->step = (float) (sum / weight);
    law->limit = (float) (0.3 * thickest);
    for (int c = 0; c < 3; c++)
        law->path[c] = (float) (1.0 / (m->medium->eta * (m->medium->sigma_a[c] + m->medium->sigma_s_reduced[c])));
    for (int i = 0; i < GAINS; i++)
        for (int c = 0; c < 3; c++)
            law->gain[i][c] =
                (float) pell_curvature_gain(m->medium, c, &m->profile[c], (double) law->limit * (2.0 * i / (GAINS - 1) - 1.0));
}

/* The patches of an object, its meshes sorted into them. */
static enum pell_result make_patches(struct pell_curvature *k, const uint32_t *meshes, size_t count, size_t *first)
{
    const struct pell_scene *scene = k->scene;
    struct pell_vec3 low = vec3(INFINITY, INFINITY, INFINITY), high = vec3(-INFINITY, -INFINITY, -INFINITY);
    float size;

    *first = k->num_patches;
    for (size_t i = 0; i < count; i++)
        for (size_t v = 0; v < scene->meshes[meshes[i]].num_vertices; v++) {
            const struct pell_vec3 p = vec3_load(scene->meshes[meshes[i]].position + 3 * v);
            low = vec3(fminf(low.x, p.x), fminf(low.y, p.y), fminf(low.z, p.z));
            high = vec3(fmaxf(high.x, p.x), fmaxf(high.y, p.y), fmaxf(high.z, p.z));
        }
    size = fmaxf(fmaxf(high.x - low.x, high.y - low.y), high.z - low.z);
    for (size_t i = 0; i < count && size > 0.0f; i++) {
        const uint32_t material = (uint32_t) scene->meshes[meshes[i]].material;
        size_t at = *first;
        if (!k->law[material].there)
            continue;
        while (at < k->num_patches && k->patch[at].material != material)
            at++;
        if (at == k->num_patches) {
            if (pell_grow(k->ctx, (void **) &k->patch, at + 1, &k->room_patches, sizeof(*k->patch)) != PELL_OK)
                return PELL_ERR_NOMEM;
            k->patch[k->num_patches++] = (struct curvature_patch) { material, low, fmaxf(k->law[material].step, size / CELLS_MOST) };
        }
        k->patch_of[meshes[i]] = (uint32_t) at;
    }
    return PELL_OK;
}

static enum pell_result make_object(struct pell_curvature *k, const uint32_t *meshes, size_t count)
{
    struct pell_topology t;
    size_t first;
    enum pell_result res;

    if (pell_cancelled(k->ctx))
        return PELL_ERR_CANCELLED;
    res = make_patches(k, meshes, count, &first);
    if (res != PELL_OK || first == k->num_patches)
        return res;
    PELL_TRY(pell_topology_make(&t, k->scene, meshes, count));
    for (size_t i = first; i < k->num_patches && res == PELL_OK; i++)
        res = curvature_measure(&k->grid, &k->patch[i], i, k->scene, &t);
    pell_topology_finish(&t);

fail:
    return res;
}

static enum pell_result make_objects(struct pell_curvature *k)
{
    const size_t count = k->scene->num_meshes;
    uint32_t *order = pell_alloc_array(k->ctx, count, 2 * sizeof(*order));
    enum pell_result res = PELL_ERR_NOMEM;

    if (!order)
        goto fail;
    pell_scene_objects(k->scene, order, order + count);
    for (size_t i = 0, end; i < count; i = end) {
        for (end = i + 1; end < count && k->scene->meshes[order[end]].object == k->scene->meshes[order[i]].object; end++)
            ;
        PELL_TRY(make_object(k, order + i, end - i));
    }
    res = PELL_OK;

fail:
    pell_free(k->ctx, order);
    return res;
}

struct vertices {
    struct pell_curvature *k;
    size_t mesh;
};

static void vertex_chunk(void *arg, int index, int worker)
{
    const struct vertices *job = arg;
    const struct pell_mesh *mesh = &job->k->scene->meshes[job->mesh];
    const uint32_t patch = job->k->patch_of[job->mesh];
    const uint32_t first = (uint32_t) index * CHUNK;

    (void) worker;
    for (uint32_t v = first; v < mesh->num_vertices && v - first < CHUNK; v++)
        job->k->value[job->mesh][v] =
            curvature_grid_at(&job->k->grid, &job->k->patch[patch], patch, vec3_load(mesh->position + 3 * (size_t) v));
}

enum pell_result pell_curvature_create(struct pell_context *ctx, struct pell_pool *pool, const struct pell_scene *scene,
                                       const struct pell_curvature_medium *media, struct pell_curvature **out)
{
    struct pell_curvature *k = pell_zalloc(ctx, sizeof(*k));
    enum pell_result res = PELL_ERR_NOMEM;

    *out = k;
    if (!k)
        return PELL_ERR_NOMEM;
    k->ctx = k->grid.ctx = ctx;
    k->scene = scene;
    k->law = pell_calloc(ctx, scene->num_materials, sizeof(*k->law));
    k->patch_of = pell_alloc_array(ctx, scene->num_meshes, sizeof(*k->patch_of));
    k->value = pell_calloc(ctx, scene->num_meshes, sizeof(*k->value));
    if (!k->law || !k->patch_of || !k->value)
        goto fail;
    for (size_t i = 0; i < scene->num_meshes; i++)
        k->patch_of[i] = NO_PATCH;
    for (size_t i = 0; i < scene->num_materials; i++)
        if (media[i].medium)
            make_law(&media[i], &k->law[i]);
    PELL_TRY(make_objects(k));
    if (k->num_patches == 0) {
        pell_curvature_destroy(out);
        return PELL_OK;
    }
    for (size_t i = 0; i < scene->num_meshes; i++) {
        struct vertices job = { k, i };
        res = PELL_ERR_NOMEM;
        if (k->patch_of[i] == NO_PATCH)
            continue;
        if (!(k->value[i] = pell_alloc_array(ctx, scene->meshes[i].num_vertices, sizeof(**k->value))))
            goto fail;
        pell_pool_run(pool, (int) ((scene->meshes[i].num_vertices + CHUNK - 1) / CHUNK), vertex_chunk, &job);
    }
    res = pell_cancelled(ctx) ? PELL_ERR_CANCELLED : PELL_OK;

fail:
    if (res != PELL_OK)
        pell_curvature_destroy(out);
    return res;
}

float pell_curvature_at(const struct pell_curvature *k, uint32_t number, uint32_t triangle, float u, float v)
{
    const struct pell_mesh *mesh = &k->scene->meshes[number < k->scene->num_meshes ? number : 0];
    const uint32_t *index;
    uint32_t patch;
    struct pell_vec3 p[3];
    float longest;

    if (number >= k->scene->num_meshes || triangle >= mesh->num_triangles || (patch = k->patch_of[number]) == NO_PATCH)
        return 0.0f;
    index = mesh->index + 3 * (size_t) triangle;
    for (int i = 0; i < 3; i++)
        p[i] = vec3_load(mesh->position + 3 * (size_t) index[i]);
    longest = fmaxf(fmaxf(vec3_length(vec3_sub(p[1], p[0])), vec3_length(vec3_sub(p[2], p[0]))), vec3_length(vec3_sub(p[2], p[1])));
    if (longest > k->patch[patch].step)
        return curvature_grid_at(&k->grid, &k->patch[patch], patch, vec3_mad(vec3_mad(vec3_mul(p[0], 1.0f - u - v), u, p[1]), v, p[2]));
    return (1.0f - u - v) * k->value[number][index[0]] + u * k->value[number][index[1]] + v * k->value[number][index[2]];
}

void pell_curvature_effect_at(const struct pell_curvature *k, uint32_t mesh, uint32_t triangle, float u, float v,
                              struct pell_curvature_effect *out)
{
    const float curvature = pell_curvature_at(k, mesh, triangle, u, v);
    const int material = mesh < k->scene->num_meshes ? k->scene->meshes[mesh].material : 0;
    const struct curvature_law *law;
    float x, part;
    int i;

    *out = (struct pell_curvature_effect) { { 1.0f, 1.0f, 1.0f }, { 0.0f, 0.0f, 0.0f } };
    if (curvature == 0.0f)
        return;
    law = &k->law[material];
    x = (curvature / law->limit + 1.0f) * (0.5f * (GAINS - 1));
    x = fminf(fmaxf(x, 0.0f), GAINS - 1.001f);
    i = (int) x;
    part = x - (float) i;
    for (int c = 0; c < 3; c++) {
        out->gain[c] = law->gain[i][c] + part * (law->gain[i + 1][c] - law->gain[i][c]);
        out->shift[c] = fminf(fmaxf(curvature * law->path[c], -SHIFT_MOST), SHIFT_MOST);
    }
}
