/* SPDX-License-Identifier: MIT
 *
 * cpu.c - the stage: patches of one object and medium, the shape at their vertices, and its effect on light.
 */
#include "render/curvature/internal.h"
#include "render/curvature/kernel.h"

#include "math/scalar.h"
#include "optics/medium/forward.h"
#include "optics/medium/opposed.h"
#include "optics/medium/small.h"
#include "scene/mesh/topology.h"
#include "shared/curvature.h"

#include <pellucid/layers.h>
#include <pellucid/profile.h>

#include <string.h>

#define GAINS PELL_CURVATURE_GAINS
#define MIN_RETURN 1e-7       /* least return of a half-space above rounding errors */
#define MAX_BEND 2.0          /* curvature times mean free path: end of the tables */
#define MIN_BEND -0.3         /* the same for concave parts */
#define MAX_CROSSED 2.0       /* limit where almost nothing is transmitted and the models differ by large factors */
#define MIN_TRANSMITTED 2e-3f /* of a half-space's return: parts that transmit more are thin */
#define MIN_THICKNESS 1e-3    /* of the averaging distance: lower limit of the thickness of slabs */
#define MAX_CELLS 256         /* largest number of cells along an object's longest side */
#define CHUNK 4096            /* vertices per task */
#define NO_PATCH UINT32_MAX
#define PROFILE_FRACTION 0.95 /* fraction of a profile inside the averaging distance of curvature */

struct pell_curvature {
    struct pell_context *ctx;
    const struct curvature_kernels *kernels;
    const struct pell_scene *scene;
    struct curvature_response *response; /* per scene material */
    uint32_t *same;                      /* per scene material: pell_scene_same_media */
    uint32_t *patch_of;                  /* per mesh, or NO_PATCH */
    struct curvature_patch *patch;
    size_t num_patches, patch_capacity;
    struct curvature_grid grid;
    struct pell_curvature_shape **value; /* per mesh with a patch: at its vertices */
    bool *coarse;                        /* per mesh: some triangle is longer than its patch's step */
};

void pell_curvature_destroy(struct pell_curvature **curvature)
{
    struct pell_curvature *k = *curvature;

    if (!k)
        return;
    for (size_t i = 0; k->value && i < k->scene->num_meshes; i++)
        pell_free(k->ctx, k->value[i]);
    pell_free(k->ctx, k->value);
    pell_free(k->ctx, k->coarse);
    pell_free(k->ctx, k->response);
    pell_free(k->ctx, k->same);
    pell_free(k->ctx, k->patch_of);
    pell_free(k->ctx, k->patch);
    pell_free(k->ctx, k->grid.node);
    pell_free(k->ctx, k);
    *curvature = NULL;
}

/* Radius that contains this fraction of the profile, mm. */
static double radius_of(const struct pell_profile *profile, double fraction)
{
    double low = -12.0, high = 12.0;

    for (int i = 0; i < 40; i++) {
        const double middle = 0.5 * (low + high);
        if (pell_profile_cdf(profile, exp(middle)) < fraction)
            low = middle;
        else
            high = middle;
    }
    return exp(low);
}

/* Fills the tables over thinness. uniform_return[c]: return of a half-space under uniform light. */
static void make_thin(const struct pell_medium *medium, const struct pell_opposed *opposed, double uniform_return[3],
                      struct curvature_response *response)
{
    for (int c = 0; c < 3; c++) {
        struct pell_slab slab;
        const double all = pell_slab_make(medium, c, &slab) ? pell_slab_at(&slab, (double) INFINITY).reflected : 0.0;
        const double half_space = all > MIN_RETURN ? all : 0.0;
        struct pell_slab scattered = slab;
        const double mean = pell_half_space_angle_of(half_space, medium->eta).mean;
        const double forward = (double) pell_forward_weight(opposed->kappa[c] * opposed->depth[c]);
        uniform_return[c] = half_space * mean;
        scattered.sigma_t = scattered.sigma_t_reduced;
        for (int i = 0; i < GAINS; i++) {
            const double x = (double) i / (GAINS - 1), d = (double) response->step * fmax((1.0 - x) / fmax(x, 1e-12), MIN_THICKNESS);
            const struct pell_slab_light light = pell_slab_at(&slab, d);
            const double T = light.transmitted - forward * fmax(light.transmitted - pell_slab_at(&scattered, d).transmitted, 0.0);
            const bool thin = i > 0 && half_space > 0.0;
            response->slab[i][c] = thin ? (float) ((light.reflected + T) / half_space) : 1.0f;
            response->through[i][c] = thin ? (float) (T / half_space) : 0.0f;
            response->crossed[i][c] = thin ? (float) fmin(T / fmax(pell_opposed_slab(opposed, c, d), 1e-12), MAX_CROSSED) : 1.0f;
            response->ball[i][c] =
                thin ? (float) (pell_small_ball(medium, c, d) / uniform_return[c] + (1.0 - 1.0 / mean) * T / half_space) : 1.0f;
            response->small[i][c] = thin ? (float) pell_small_weight(medium, c, d) : 0.0f;
            response->forward[i][c] = thin ? (float) ((light.transmitted - T) / half_space) : 0.0f;
            if (response->through[i][c] + response->forward[i][c] > MIN_TRANSMITTED)
                response->max_thickness = fmaxf(response->max_thickness, (float) d);
        }
    }
}

/* Fills an entry of the table over curvature. */
static void make_bent(const struct pell_curvature_medium *m, const struct pell_opposed *opposed, int c, double curvature,
                      double uniform_return, struct curvature_bent *out)
{
    const struct pell_profile *profile = &m->profile[c];
    const double total = pell_profile_total(profile); /* 0: nothing is scattered, and nothing changes */
    const double inside = curvature != 0.0 && total > 0.0 ? pell_profile_cdf(profile, 2.0 / fabs(curvature)) : 1.0;
    double gain = pell_curvature_gain(m->medium, c, profile, curvature);

    if (curvature > 0.0 && uniform_return > 0.0 && inside > 0.0) {
        const double all = gain * inside, small = pell_small_weight(m->medium, c, 2.0 / curvature);
        gain = (all + small * (pell_small_ball(m->medium, c, 2.0 / curvature) / uniform_return - all)) / inside;
    }
    out->gain[c] = (float) gain;
    out->opposed[c] = (float) pell_opposed_gain(opposed, c, profile, curvature, gain);
    out->across[c] = total > 0.0 ? (float) ((double) out->opposed[c] * pell_opposed_across(opposed, c, curvature) / total) : 0.0f;
    out->all[c] = (float) (gain * inside);
}

static void make_response(const struct pell_curvature_medium *m, struct curvature_response *response)
{
    struct pell_opposed opposed;
    double sum = 0.0, weight = 0.0, max_sigma_t = 0.0, total[3], uniform_return[3];

    for (int c = 0; c < 3; c++) {
        total[c] = pell_profile_total(&m->profile[c]);
        if (!(total[c] > 0.0))
            continue;
        sum += total[c] * radius_of(&m->profile[c], PROFILE_FRACTION);
        weight += total[c];
        max_sigma_t = fmax(max_sigma_t, m->medium->sigma_a[c] + m->medium->sigma_s_reduced[c]);
    }
    if (!(weight > 0.0))
        return;
    response->scatters = true;
    response->step = (float) (sum / weight);
    response->limit = (float) (MAX_BEND * max_sigma_t);
    for (int c = 0; c < 3; c++)
        response->path[c] = (float) (1.0 / (m->medium->eta * (m->medium->sigma_a[c] + m->medium->sigma_s_reduced[c])));
    if (!pell_opposed_make(m->medium, &opposed))
        opposed = (struct pell_opposed) { { 0.0f } };
    make_thin(m->medium, &opposed, uniform_return, response);
    for (int i = 0; i < GAINS; i++)
        for (int c = 0; c < 3; c++) {
            const double curvature = fmax((double) response->limit * (2.0 * i / (GAINS - 1) - 1.0), MIN_BEND * max_sigma_t);
            make_bent(m, &opposed, c, curvature, uniform_return[c], &response->bent[i]);
        }
}

struct responses {
    const struct pell_context *ctx;
    const struct pell_curvature_medium *media;
    struct curvature_response *response;
    size_t *first; /* per material: the first material with the same medium */
};

/* Equal media share their profile (resources.c). */
static bool is_same(const struct pell_curvature_medium *a, const struct pell_curvature_medium *b)
{
    return a->profile == b->profile && memcmp(a->medium, b->medium, sizeof(*a->medium)) == 0;
}

static void response_of(void *arg, int index, int worker)
{
    const struct responses *t = arg;

    (void) worker;
    if (t->media[index].medium && t->first[index] == (size_t) index && !pell_cancelled(t->ctx))
        make_response(&t->media[index], &t->response[index]);
}

/* Computes the tables of all materials, once for equal media. */
static enum pell_result make_responses(struct pell_curvature *k, struct pell_pool *pool, const struct pell_curvature_medium *media)
{
    const size_t count = k->scene->num_materials;
    struct responses t = { k->ctx, media, k->response, pell_alloc_array(k->ctx, count, 2 * sizeof(*t.first)) };
    size_t *different = t.first ? t.first + count : NULL, num_different = 0;

    if (!t.first)
        return PELL_ERR_NOMEM;
    for (size_t i = 0; i < count; i++) {
        size_t j = 0;
        t.first[i] = i;
        if (!media[i].medium || pell_cancelled_at(k->ctx, i))
            continue;
        while (j < num_different && !is_same(&media[different[j]], &media[i]))
            j++;
        if (j < num_different)
            t.first[i] = different[j];
        else
            different[num_different++] = i;
    }
    pell_pool_run(pool, (int) count, response_of, &t);
    for (size_t i = 0; i < count; i++)
        if (t.first[i] != i)
            k->response[i] = k->response[t.first[i]];
    pell_free(k->ctx, t.first);
    return PELL_OK;
}

/* Creates the patches of an object, and assigns its meshes. */
static enum pell_result make_patches(struct pell_curvature *k, const uint32_t *meshes, size_t count, size_t *first)
{
    const struct pell_scene *scene = k->scene;
    struct pell_vec3 low = vec3(INFINITY, INFINITY, INFINITY), high = vec3(-INFINITY, -INFINITY, -INFINITY);
    float size;

    *first = k->num_patches;
    for (size_t i = 0; i < count; i++)
        for (size_t v = 0; v < scene->meshes[meshes[i]].num_vertices && !pell_cancelled_at(k->ctx, v); v++) {
            const struct pell_vec3 p = vec3_load(scene->meshes[meshes[i]].position + 3 * v);
            low = vec3(fminf(low.x, p.x), fminf(low.y, p.y), fminf(low.z, p.z));
            high = vec3(fmaxf(high.x, p.x), fmaxf(high.y, p.y), fmaxf(high.z, p.z));
        }
    size = fmaxf(fmaxf(high.x - low.x, high.y - low.y), high.z - low.z);
    for (size_t i = 0; i < count && size > 0.0f; i++) {
        const uint32_t medium = k->same[scene->meshes[meshes[i]].material];
        size_t at = *first;
        if (!k->response[medium].scatters)
            continue;
        while (at < k->num_patches && k->patch[at].medium != medium)
            at++;
        if (at == k->num_patches) {
            if (pell_grow(k->ctx, (void **) &k->patch, at + 1, &k->patch_capacity, sizeof(*k->patch)) != PELL_OK)
                return PELL_ERR_NOMEM;
            k->patch[k->num_patches++] = (struct curvature_patch) {
                .medium = medium,
                .low = low,
                .step = fmaxf(k->response[medium].step, size / MAX_CELLS),
                .max_thickness = k->response[medium].max_thickness,
            };
        }
        k->patch_of[meshes[i]] = (uint32_t) at;
    }
    return PELL_OK;
}

static enum pell_result make_object(struct pell_curvature *k, struct pell_pool *pool, const struct pell_rays *rays, const uint32_t *meshes,
                                    size_t count)
{
    struct pell_topology t;
    const struct curvature_object object = { pool, rays, k->scene, &t, k->same, pell_mesh_assembly(&k->scene->meshes[meshes[0]]) };
    size_t first;
    enum pell_result res;

    if (pell_cancelled(k->ctx))
        return PELL_ERR_CANCELLED;
    res = make_patches(k, meshes, count, &first);
    if (res != PELL_OK || first == k->num_patches)
        return res;
    PELL_TRY(pell_topology_make(&t, k->scene, meshes, count));
    for (size_t i = first; i < k->num_patches && res == PELL_OK; i++)
        res = curvature_measure(&k->grid, &k->patch[i], i, &object);
    pell_topology_finish(&t);

fail:
    return res;
}

static enum pell_result make_objects(struct pell_curvature *k, struct pell_pool *pool, const struct pell_rays *rays)
{
    const size_t count = k->scene->num_meshes;
    uint32_t *order = pell_alloc_array(k->ctx, count, 2 * sizeof(*order));
    enum pell_result res = PELL_ERR_NOMEM;

    if (!order)
        goto fail;
    pell_scene_assemblies(k->scene, order, order + count);
    for (size_t i = 0, end; i < count; i = end) {
        end = pell_assembly_end(k->scene, order, i);
        PELL_TRY(make_object(k, pool, rays, order + i, end - i));
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

/* The longest side of a triangle. */
static float longest_side(const struct pell_mesh *mesh, uint32_t triangle)
{
    const uint32_t *index = mesh->index + 3 * (size_t) triangle;
    struct pell_vec3 p[3];

    for (int i = 0; i < 3; i++)
        p[i] = vec3_load(mesh->position + 3 * (size_t) index[i]);
    return larger(larger(vec3_length(vec3_sub(p[1], p[0])), vec3_length(vec3_sub(p[2], p[0]))), vec3_length(vec3_sub(p[2], p[1])));
}

/* Whether some triangle is longer than the step; otherwise pixels can interpolate vertices. */
static bool is_coarse(const struct pell_context *ctx, const struct pell_mesh *mesh, float step)
{
    for (uint32_t i = 0; i < mesh->num_triangles; i++)
        if (longest_side(mesh, i) > step || pell_cancelled_at(ctx, i))
            return true;
    return false;
}

enum pell_result pell_curvature_create(struct pell_context *ctx, struct pell_pool *pool, const struct pell_scene *scene,
                                       const struct pell_rays *rays, const struct pell_curvature_medium *media, struct pell_curvature **out)
{
    struct pell_curvature *k = pell_zalloc(ctx, sizeof(*k));
    enum pell_result res = PELL_ERR_NOMEM;

    *out = k;
    if (!k)
        return PELL_ERR_NOMEM;
    k->ctx = k->grid.ctx = ctx;
    k->scene = scene;
    k->kernels = curvature_kernels_tables[pell_simd_best()];
    k->response = pell_calloc(ctx, scene->num_materials, sizeof(*k->response));
    k->same = pell_alloc_array(ctx, scene->num_materials, sizeof(*k->same));
    k->patch_of = pell_alloc_array(ctx, scene->num_meshes, sizeof(*k->patch_of));
    k->value = pell_calloc(ctx, scene->num_meshes, sizeof(*k->value));
    k->coarse = pell_calloc(ctx, scene->num_meshes, sizeof(*k->coarse));
    if (!k->response || !k->same || !k->patch_of || !k->value || !k->coarse)
        goto fail;
    pell_scene_same_media(scene, k->same);
    for (size_t i = 0; i < scene->num_meshes; i++)
        k->patch_of[i] = NO_PATCH;
    PELL_TRY(make_responses(k, pool, media));
    PELL_TRY(make_objects(k, pool, rays));
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
        k->coarse[i] = is_coarse(ctx, &scene->meshes[i], k->patch[k->patch_of[i]].step);
    }
    res = pell_cancelled(ctx) ? PELL_ERR_CANCELLED : PELL_OK;

fail:
    if (res != PELL_OK)
        pell_curvature_destroy(out);
    return res;
}

struct pell_curvature_shape pell_curvature_at(const struct pell_curvature *k, uint32_t mesh_index, uint32_t triangle, float u, float v)
{
    const struct pell_mesh *mesh = &k->scene->meshes[mesh_index < k->scene->num_meshes ? mesh_index : 0];
    const struct pell_curvature_shape *value;
    const uint32_t *index;
    uint32_t patch;
    struct pell_curvature_shape shape = { 0.0f, 0.0f };

    if (mesh_index >= k->scene->num_meshes || triangle >= mesh->num_triangles || (patch = k->patch_of[mesh_index]) == NO_PATCH)
        return shape;
    index = mesh->index + 3 * (size_t) triangle;
    if (k->coarse[mesh_index] && longest_side(mesh, triangle) > k->patch[patch].step) {
        struct pell_vec3 p[3];
        for (int i = 0; i < 3; i++)
            p[i] = vec3_load(mesh->position + 3 * (size_t) index[i]);
        return curvature_grid_at(&k->grid, &k->patch[patch], patch, vec3_mad(vec3_mad(vec3_mul(p[0], 1.0f - u - v), u, p[1]), v, p[2]));
    }
    value = k->value[mesh_index];
    for (int i = 0; i < 3; i++) {
        const float w = i == 0 ? 1.0f - u - v : i == 1 ? u : v;
        shape.mean += w * value[index[i]].mean;
        shape.thinness += w * value[index[i]].thinness;
    }
    return shape;
}

/* Interpolates at 16 points of one mesh without coarse triangles. */
static void interpolate(const struct pell_mesh *mesh, const struct pell_curvature_shape *value, const struct pell_points16 *at,
                        struct curvature_shapes *s)
{
    for (int i = 0; i < 16; i++) {
        const bool valid = at->triangle[i] < mesh->num_triangles;
        const uint32_t *index = mesh->index + (valid ? 3 * (size_t) at->triangle[i] : 0);
        const struct pell_curvature_shape a = value[index[0]], b = value[index[1]], c = value[index[2]];
        const float u = at->u[i], v = at->v[i], w = 1.0f - u - v;
        s->mean[i] = valid ? w * a.mean + u * b.mean + v * c.mean : 0.0f;
        s->thinness[i] = valid ? w * a.thinness + u * b.thinness + v * c.thinness : 0.0f;
    }
}

void pell_curvature_effects_at(const struct pell_curvature *k, const struct pell_points16 *at, const int32_t *active,
                               struct pell_curvature_effects *out)
{
    struct curvature_shapes s;
    uint32_t differ = 0;

    for (int i = 0; i < 16; i++)
        differ |= (at->mesh[i] ^ at->mesh[0]) | (uint32_t) ~active[i];
    if (!differ && at->mesh[0] < k->scene->num_meshes && k->value[at->mesh[0]] && !k->coarse[at->mesh[0]]) {
        interpolate(&k->scene->meshes[at->mesh[0]], k->value[at->mesh[0]], at, &s);
        for (int i = 0; i < 16; i++)
            s.response[i] = &k->response[k->scene->meshes[at->mesh[0]].material];
        k->kernels->effects(&s, out);
        return;
    }
    for (int i = 0; i < 16; i++) {
        struct pell_curvature_shape shape = { 0.0f, 0.0f };
        const bool valid = active[i] && at->mesh[i] < k->scene->num_meshes;
        if (valid)
            shape = pell_curvature_at(k, at->mesh[i], at->triangle[i], at->u[i], at->v[i]);
        s.mean[i] = shape.mean;
        s.thinness[i] = shape.thinness;
        s.response[i] = &k->response[valid ? k->scene->meshes[at->mesh[i]].material : 0];
    }
    k->kernels->effects(&s, out);
}

/* --- For a device ---------------------------------------------------------------------------------------------------------------- */

_Static_assert(sizeof(struct curvature_bent) == 12 * sizeof(float) && sizeof(struct pell_curvature_shape) == 2 * sizeof(float),
               "as stage.h says");

/* Sequential output of words; `out` NULL: they are only counted. */
struct words {
    uint32_t *out;
    size_t count;
};

static void put(struct words *w, const void *from, size_t count)
{
    if (w->out)
        memcpy(w->out + w->count, from, count * sizeof(*w->out));
    w->count += count;
}

static void put_response(struct words *w, const struct curvature_response *response)
{
    put(w, &response->step, 1);
    put(w, &response->limit, 1);
    put(w, response->path, 3);
    put(w, response->bent, GAINS * (sizeof(struct curvature_bent) / sizeof(float)));
    put(w, response->slab, sizeof(response->slab) / sizeof(float));
    put(w, response->through, sizeof(response->through) / sizeof(float));
    put(w, response->ball, sizeof(response->ball) / sizeof(float));
    put(w, response->small, sizeof(response->small) / sizeof(float));
}

/* Writes for each triangle of a mesh whether it is longer than the patch's step. */
static void put_long(struct words *w, const struct pell_mesh *mesh, float step)
{
    for (uint32_t t = 0; t < mesh->num_triangles; t++) {
        const uint32_t is_long = w->out && longest_side(mesh, t) > step;
        put(w, &is_long, 1);
    }
}

size_t pell_curvature_words(const struct pell_curvature *k, uint32_t *out)
{
    const struct pell_scene *scene = k->scene;
    struct words w = { out, PELL_CURVATURE_HEAD + PELL_CURVATURE_OF_MESH * scene->num_meshes };
    uint32_t *of_mesh = out ? out + PELL_CURVATURE_HEAD : NULL;

    if (out) {
        out[0] = (uint32_t) k->grid.capacity;
        out[1] = (uint32_t) w.count;
        curvature_grid_write(&k->grid, out + w.count);
    }
    w.count += k->grid.capacity * PELL_CURVATURE_NODE;
    for (size_t i = 0; i < scene->num_meshes; i++) {
        const struct pell_mesh *mesh = &scene->meshes[i];
        const uint32_t patch = k->patch_of[i];
        uint32_t at[PELL_CURVATURE_OF_MESH] = { PELL_CURVATURE_NONE, 0, PELL_CURVATURE_NONE, 0 };
        if (patch != NO_PATCH) {
            at[0] = (uint32_t) w.count;
            put(&w, &k->patch[patch].low, 3);
            put(&w, &k->patch[patch].step, 1);
            put(&w, &patch, 1);
            at[1] = (uint32_t) w.count;
            put(&w, k->value[i], 2 * (size_t) mesh->num_vertices);
            at[2] = k->coarse[i] ? (uint32_t) w.count : PELL_CURVATURE_NONE;
            if (k->coarse[i])
                put_long(&w, mesh, k->patch[patch].step);
            at[3] = (uint32_t) w.count; /* repeated per mesh: few meshes share a material */
            put_response(&w, &k->response[mesh->material]);
        }
        if (out)
            memcpy(of_mesh + PELL_CURVATURE_OF_MESH * i, at, sizeof(at));
    }
    return w.count;
}
