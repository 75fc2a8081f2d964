/* SPDX-License-Identifier: MIT
 *
 * cpu.c - layered on the cpu engine: what outlives a frame, and packets of pixels with their rays. The march is in kernels.c.
 */
#include "methods/layered/layered.h"

#include "base/hash.h"
#include "base/simd.h"
#include "image/color.h"
#include "math/vec.h"
#include "rays/fan.h"
#include "render/emitters.h"
#include "render/renderer.h"
#include "scene/layers.h"

#include <string.h>

PELL_SIMD_TABLES(struct layered_kernels, layered_kernels);

enum { CUTS = 8, MOST_PARTS = 1 << 24 }; /* of a large triangle's sides; parts of all of them */
enum { BAND = 4, ENVIRONMENT = 4 };      /* rows of a task; directions to an environment for each place on a lamp */

/* A place on a lamp, or how to choose one for a pixel. */
struct source {
    const struct pell_emitters *lamp; /* alone in its set */
    struct pell_emitter_sample sample;
    bool face;                  /* chosen for each pixel */
    bool even;                  /* `power` is all that there is to say */
    size_t light;               /* of the scene */
    const struct pell_fan *fan; /* the frame's; what the lamp sees, NULL: rays */
    int number, of;
    float power[3], scale;
};

struct worker {
    struct layered_packet packet;
    struct layered_lamp lamps[LAYERED_GROUP];
    int64_t pixels, rays, marches;
};

struct state {
    struct pell_renderer *r; /* borrowed */
    struct pell_context *ctx;
    struct pell_pool *pool;
    const struct layered_kernels *kernels;
    struct layered_knobs knobs;
    struct layered_work work;
    struct pell_strata **strata; /* of the scene's materials, where a mesh asks for it */
    struct layered_medium *media;
    size_t num_materials;
    float (**planes)[4]; /* of meshes */
    size_t num_meshes;
    struct pell_emitters **lamps;
    size_t num_lamps;
    struct source *sources;
    int num_sources;
    struct worker *workers;
    int most_layers, most_packs;
    float size; /* mm: of the scene */
    struct pell_pass_time times[3];
    size_t num_times;
    double fit_seconds; /* < 0: told already */
    int64_t fitted;
    /* The frame. */
    const struct pell_frame *in;
    const struct pell_frame_light *out;
    const struct pell_view *view;
    int bands;
};

/* --- Life ----------------------------------------------------------------------------------------------------------------------- */

static void layered_destroy(void *state)
{
    struct state *st = state;

    if (!st)
        return;
    for (int i = 0; st->workers && i < pell_pool_threads(st->pool); i++) {
        struct worker *w = &st->workers[i];
        pell_free(st->ctx, w->packet.uv);
        pell_free(st->ctx, w->packet.place);
        for (int k = 0; k < LAYERED_GROUP; k++)
            pell_free(st->ctx, w->lamps[k].depth);
    }
    pell_free(st->ctx, st->workers);
    pell_free(st->ctx, st->sources);
    for (size_t i = 0; i < st->num_lamps; i++)
        pell_emitters_destroy(&st->lamps[i]);
    pell_free(st->ctx, st->lamps);
    for (size_t i = 0; st->planes && i < st->num_meshes; i++)
        pell_free(st->ctx, st->planes[i]);
    pell_free(st->ctx, st->planes);
    for (size_t i = 0; st->media && i < st->num_materials; i++)
        layered_medium_finish(st->ctx, &st->media[i]);
    for (size_t i = 0; st->strata && i < st->num_materials; i++)
        pell_free(st->ctx, st->strata[i]);
    pell_free(st->ctx, st->media);
    pell_free(st->ctx, st->strata);
    pell_free(st->ctx, st);
}

static bool scatters(const struct pell_scene *scene, const struct pell_mesh *mesh)
{
    return mesh->material >= 0 && !scene->materials[mesh->material].opaque && mesh->num_triangles > 0;
}

static enum pell_result make_media(struct state *st, const struct pell_scene *scene)
{
    enum pell_result res = PELL_ERR_NOMEM;

    st->strata = pell_calloc(st->ctx, scene->num_materials + 1, sizeof(*st->strata));
    st->media = pell_calloc(st->ctx, scene->num_materials + 1, sizeof(*st->media));
    if (!st->strata || !st->media)
        goto fail;
    st->num_materials = scene->num_materials;
    for (size_t i = 0; i < scene->num_meshes; i++) {
        const struct pell_mesh *mesh = &scene->meshes[i];
        const struct pell_material *m;
        struct layered_medium *medium;
        if (!scatters(scene, mesh) || st->strata[mesh->material])
            continue;
        m = &scene->materials[mesh->material];
        medium = &st->media[mesh->material];
        st->strata[mesh->material] = pell_alloc(st->ctx, sizeof(**st->strata));
        if (!st->strata[mesh->material])
            goto fail;
        PELL_TRY(pell_strata_make(st->ctx, "layered", m, st->strata[mesh->material]));
        PELL_TRY(layered_medium_make(st->ctx, st->strata[mesh->material], m->name, st->knobs.under, medium));
        st->most_layers = medium->count > st->most_layers ? medium->count : st->most_layers;
        st->most_packs = medium->packs > st->most_packs ? medium->packs : st->most_packs;
        res = PELL_ERR_NOMEM;
    }
    return PELL_OK;

fail:
    return res;
}

/* --- Planes --------------------------------------------------------------------------------------------------------------------- */

static bool same_body(const struct pell_mesh *a, const struct pell_mesh *b)
{
    return a->object == b->object && a->material == b->material;
}

/* The smooth outward normal of a hit. */
static struct pell_vec3 normal_at(const struct pell_mesh *m, uint32_t triangle, float u, float v)
{
    const uint32_t *index = m->index + 3 * (size_t) triangle;
    struct pell_vec3 n = vec3_mul(vec3_load(m->normal + 3 * (size_t) index[0]), 1.0f - u - v);

    n = vec3_mad(n, u, vec3_load(m->normal + 3 * (size_t) index[1]));
    return vec3_normalize(vec3_mad(n, v, vec3_load(m->normal + 3 * (size_t) index[2])));
}

static void corners_of(const struct pell_mesh *mesh, uint32_t triangle, struct pell_vec3 at[3])
{
    for (int k = 0; k < 3; k++)
        at[k] = vec3_load(mesh->position + 3 * (size_t) mesh->index[3 * (size_t) triangle + (size_t) k]);
}

/* In how many parts the sides of a triangle are cut, so that those are small beside the neighbourhood. */
static int cuts_of(const struct pell_vec3 at[3], float radius)
{
    float longest = 0.0f;

    for (int k = 0; k < 3; k++)
        longest = fmaxf(longest, vec3_length(vec3_sub(at[(k + 1) % 3], at[k])));
    longest *= 2.0f / radius;
    return longest > 1.0f ? longest < (float) CUTS ? (int) ceilf(longest) : CUTS : 1;
}

static size_t count_parts(const struct pell_mesh *mesh, float radius)
{
    size_t count = 0;

    for (uint32_t t = 0; t < mesh->num_triangles; t++) {
        struct pell_vec3 at[3];
        int cuts;
        corners_of(mesh, t, at);
        cuts = cuts_of(at, radius);
        count += cuts > 1 ? (size_t) (cuts * cuts) : 0;
    }
    return count;
}

/* The middles of the parts of a triangle, each for its area. */
static void add_parts(const struct pell_mesh *mesh, uint32_t triangle, const struct pell_vec3 at[3], int cuts, float area,
                      struct layered_cloud *cloud)
{
    for (int i = 0; i < cuts; i++)
        for (int j = 0; j < 2 * (cuts - i) - 1; j++) {
            const float u = ((float) (j / 2) + (j & 1 ? 2.0f / 3.0f : 1.0f / 3.0f)) / (float) cuts;
            const float v = ((float) i + (j & 1 ? 2.0f / 3.0f : 1.0f / 3.0f)) / (float) cuts;
            const struct pell_vec3 p = vec3_mad(vec3_mad(vec3_mul(at[0], 1.0f - u - v), u, at[1]), v, at[2]);
            vec3_store(p, cloud->position + 3 * cloud->count);
            vec3_store(normal_at(mesh, triangle, u, v), cloud->normal + 3 * cloud->count);
            cloud->weight[cloud->count++] = fmaxf(area / (float) (cuts * cuts), 1e-20f);
        }
}

/* Each vertex stands for a part of the triangles around it; triangles that are large beside the neighbourhood stand for themselves, in
 * parts, so that planes of a coarse mesh are those of a fine one. */
static void weigh(const struct pell_mesh *mesh, size_t first, bool parts, struct layered_cloud *cloud)
{
    float *weight = cloud->weight + first;

    for (uint32_t i = 0; i < mesh->num_vertices; i++)
        weight[i] = 0.0f;
    for (uint32_t t = 0; t < mesh->num_triangles; t++) {
        struct pell_vec3 at[3];
        float area;
        int cuts;
        corners_of(mesh, t, at);
        area = vec3_length(vec3_cross(vec3_sub(at[1], at[0]), vec3_sub(at[2], at[0])));
        cuts = parts ? cuts_of(at, cloud->radius) : 1;
        if (cuts > 1)
            add_parts(mesh, t, at, cuts, area, cloud);
        for (int k = 0; k < 3 && cuts == 1; k++)
            weight[mesh->index[3 * (size_t) t + (size_t) k]] += area * (1.0f / 3.0f);
    }
    for (uint32_t i = 0; i < mesh->num_vertices; i++)
        weight[i] = weight[i] > 1e-20f && weight[i] < 1e20f ? weight[i] : 1e-20f; /* of no triangle, or of large ones alone */
}

/* All meshes of one body, of which `first` is the first. */
static enum pell_result fit_body(struct state *st, const struct pell_scene *scene, size_t first)
{
    const struct pell_mesh *body = &scene->meshes[first];
    struct layered_cloud cloud = { .ctx = st->ctx, .pool = st->pool };
    const float sigma = st->media[body->material].first;
    float(*plane)[4] = NULL;
    enum pell_result res = PELL_ERR_NOMEM;
    size_t at = 0, most = 0, parts = 0;

    cloud.radius = sigma > 0.0f ? -logf(st->knobs.epsilon) / sigma : INFINITY;
    cloud.radius = cloud.radius < st->size ? cloud.radius : st->size;
    for (size_t i = first; i < scene->num_meshes; i++) {
        cloud.fitted += same_body(&scene->meshes[i], body) ? scene->meshes[i].num_vertices : 0;
        if (same_body(&scene->meshes[i], body) && st->knobs.planes == LAYERED_BY_AREA && cloud.radius > 0.0f)
            parts += count_parts(&scene->meshes[i], cloud.radius);
    }
    parts = parts <= MOST_PARTS ? parts : 0;
    most = cloud.fitted + parts;
    if (most > UINT32_MAX)
        return pell_error(st->ctx, PELL_ERR_UNSUPPORTED, body->name, NULL, "layered: an object of %zu vertices", cloud.fitted);
    cloud.position = pell_alloc_array(st->ctx, most + 1, 3 * sizeof(float));
    cloud.normal = pell_alloc_array(st->ctx, most + 1, 3 * sizeof(float));
    cloud.weight = pell_alloc_array(st->ctx, most + 1, sizeof(float));
    plane = pell_alloc_array(st->ctx, cloud.fitted + 1, sizeof(*plane));
    if (!cloud.position || !cloud.normal || !cloud.weight || !plane)
        goto fail;
    cloud.count = cloud.fitted;
    for (size_t i = first; i < scene->num_meshes; i++) {
        const struct pell_mesh *m = &scene->meshes[i];
        if (!same_body(m, body))
            continue;
        memcpy(cloud.position + 3 * at, m->position, 3 * (size_t) m->num_vertices * sizeof(float));
        memcpy(cloud.normal + 3 * at, m->normal, 3 * (size_t) m->num_vertices * sizeof(float));
        for (size_t k = 0; k < m->num_vertices; k++)
            cloud.weight[at + k] = 1.0f;
        if (st->knobs.planes == LAYERED_BY_AREA)
            weigh(m, at, parts > 0, &cloud);
        at += m->num_vertices;
    }
    if (st->knobs.planes == LAYERED_TANGENT) {
        for (size_t i = 0; i < cloud.fitted; i++) {
            memcpy(plane[i], cloud.normal + 3 * i, 3 * sizeof(float));
            plane[i][3] = 0.0f;
        }
    } else {
        PELL_TRY(layered_planes_fit(&cloud, plane));
        res = PELL_ERR_NOMEM;
    }
    at = 0;
    for (size_t i = first; i < scene->num_meshes; i++) {
        const struct pell_mesh *m = &scene->meshes[i];
        if (!same_body(m, body))
            continue;
        st->planes[i] = pell_alloc_array(st->ctx, (size_t) m->num_vertices + 1, sizeof(*plane));
        if (!st->planes[i])
            goto fail;
        memcpy(st->planes[i], plane + at, (size_t) m->num_vertices * sizeof(*plane));
        at += m->num_vertices;
    }
    st->fitted += (int64_t) cloud.fitted;
    res = PELL_OK;

fail:
    pell_free(st->ctx, plane);
    pell_free(st->ctx, cloud.weight);
    pell_free(st->ctx, cloud.normal);
    pell_free(st->ctx, cloud.position);
    return res;
}

static enum pell_result fit_planes(struct state *st, const struct pell_scene *scene)
{
    const double start = pell_seconds();
    enum pell_result res = PELL_ERR_NOMEM;

    st->planes = pell_calloc(st->ctx, scene->num_meshes + 1, sizeof(*st->planes));
    if (!st->planes)
        goto fail;
    st->num_meshes = scene->num_meshes;
    for (size_t i = 0; i < scene->num_meshes; i++)
        if (scatters(scene, &scene->meshes[i]) && !st->planes[i])
            PELL_TRY(fit_body(st, scene, i));
    st->fit_seconds = pell_seconds() - start;
    return PELL_OK;

fail:
    return res;
}

/* --- Lamps ---------------------------------------------------------------------------------------------------------------------- */

static double fraction(double x)
{
    return x - floor(x);
}

/* Points of the unit square that are spread well for any number of them (M. Roberts 2018, "The Unreasonable Effectiveness of Quasirandom
 * Sequences"); the first is the middle. */
static void spread(double number, double u[3])
{
    u[0] = fraction(0.5 + number * 0.8191725133961645);
    u[1] = fraction(0.5 + number * 0.6710436067037893);
    u[2] = fraction(0.5 + number * 0.5497004779019703);
}

static void add_lamp(struct state *st, const struct pell_scene *scene, size_t index, const struct pell_emitters *lamp, int each)
{
    const struct pell_light *light = &scene->lights[index];
    const bool sky = light->type == PELL_LIGHT_ENVIRONMENT;
    const bool face = light->type == PELL_LIGHT_RECT || light->type == PELL_LIGHT_DISC;
    const int count = sky ? ENVIRONMENT * each : face ? each : 1;

    for (int i = 0; i < count && pell_emitters_count(lamp) > 0; i++) {
        struct source *s = &st->sources[st->num_sources];
        const struct pell_vec3 nowhere = { 0 };
        double u[3];
        spread((double) i, u);
        *s = (struct source){ .lamp = lamp, .face = face && each > 1, .number = i, .of = count, .scale = 1.0f, .light = index };
        if (!pell_emitters_sample(lamp, nowhere, u, &s->sample))
            continue;
        s->even = !light->image && (s->sample.away || (light->type == PELL_LIGHT_POINT && !(light->range > 0.0f)));
        if (sky) {
            s->even = true;
            s->scale = (float) fmin(1.0 / (s->sample.pdf * count), 1e12);
        } else if (face) {
            s->scale = (float) (1.0 / (s->sample.pdf * count));
        }
        if (s->even)
            pell_emitters_power_at(lamp, &s->sample, nowhere, s->power);
        st->num_sources++;
    }
}

static enum pell_result make_lamps(struct state *st, const struct pell_scene *scene)
{
    const int each = st->knobs.lamps;
    struct pell_scene alone = *scene;
    enum pell_result res = PELL_ERR_NOMEM;

    st->lamps = pell_calloc(st->ctx, scene->num_lights + 1, sizeof(*st->lamps));
    st->sources = pell_calloc(st->ctx, scene->num_lights * ENVIRONMENT + 1, (size_t) each * sizeof(*st->sources));
    if (!st->lamps || !st->sources)
        goto fail;
    for (size_t i = 0; i < scene->num_lights; i++) {
        alone.lights = scene->lights + i;
        alone.num_lights = 1;
        PELL_TRY(pell_emitters_create(st->ctx, &alone, &st->lamps[i]));
        st->num_lamps = i + 1;
        add_lamp(st, scene, i, st->lamps[i], each);
    }
    return PELL_OK;

fail:
    return res;
}

static enum pell_result make_workers(struct state *st)
{
    const int threads = pell_pool_threads(st->pool);

    st->workers = pell_calloc(st->ctx, (size_t) threads, sizeof(*st->workers));
    if (!st->workers)
        return PELL_ERR_NOMEM;
    for (int i = 0; i < threads; i++) {
        struct worker *w = &st->workers[i];
        w->packet.uv = pell_calloc(st->ctx, (size_t) st->most_packs + 1, 6 * LAYERED_LANES * sizeof(float));
        w->packet.place = pell_calloc(st->ctx, (size_t) st->most_packs + 1, sizeof(*w->packet.place));
        if (!w->packet.uv || !w->packet.place)
            return PELL_ERR_NOMEM;
        for (int k = 0; k < LAYERED_GROUP; k++) {
            w->lamps[k].depth = pell_calloc(st->ctx, (size_t) (LAYERED_NODES * st->most_layers + 1), LAYERED_LANES * sizeof(float));
            if (!w->lamps[k].depth)
                return PELL_ERR_NOMEM;
        }
    }
    return PELL_OK;
}

static enum pell_result layered_create(struct pell_renderer *r, const struct pell_frame *shape, const void *knobs, void **state)
{
    struct pell_context *ctx = pell_renderer_context(r);
    const struct pell_scene *scene = pell_renderer_scene(r);
    struct state *st = pell_zalloc(ctx, sizeof(*st));
    const struct layered_knobs *k = knobs;
    enum pell_result res;

    *state = st;
    if (!st)
        return PELL_ERR_NOMEM;
    st->r = r;
    st->ctx = ctx;
    st->pool = pell_renderer_pool(r);
    st->kernels = layered_kernels_tables[pell_simd_best()];
    st->knobs = *k;
    st->work = (struct layered_work){
        .samples = k->samples,
        .exponential = k->march == LAYERED_EXPONENTIAL,
        .refracts = k->refraction == LAYERED_PLANAR,
        .absolute = k->path == LAYERED_PLANES && k->refraction == LAYERED_NONE,
        .rest = k->as != LAYERED_PAPER,
        .node = { 0.004f, 0.04f, 0.16f, 0.45f, 0.99f },
    };
    st->size = vec3_length(vec3_sub(vec3_load(scene->bounds_max), vec3_load(scene->bounds_min)));
    st->size = st->size > 0.0f && st->size < 1e12f ? st->size : 1.0f;
    st->bands = (shape->height + BAND - 1) / BAND;
    PELL_TRY(make_media(st, scene));
    PELL_TRY(fit_planes(st, scene));
    PELL_TRY(make_lamps(st, scene));
    PELL_TRY(make_workers(st));
    return PELL_OK;

fail:
    return res;
}

/* --- Rays of a packet ----------------------------------------------------------------------------------------------------------- */

struct rays {
    struct pell_ray_hit16 r;
    _Alignas(64) int valid[16];
    int count;
};

static void aim(struct rays *rays, int i, struct pell_vec3 from, struct pell_vec3 way, float near, float far)
{
    struct pell_ray16 *r = &rays->r.ray;

    r->ox[i] = from.x;
    r->oy[i] = from.y;
    r->oz[i] = from.z;
    r->dx[i] = way.x;
    r->dy[i] = way.y;
    r->dz[i] = way.z;
    r->tnear[i] = near;
    r->tfar[i] = far;
    r->mask[i] = PELL_RAY_ALL;
    rays->valid[i] = -1;
    rays->count++;
}

static void clear(struct rays *rays)
{
    memset(rays, 0, sizeof(*rays));
    for (int i = 0; i < 16; i++)
        rays->r.hit.mesh[i] = PELL_NO_HIT;
}

/* `rows`: float [3][LAYERED_LANES]. */
static struct pell_vec3 lane3(const void *rows, int i)
{
    const float *a = rows;

    return vec3(a[i], a[LAYERED_LANES + i], a[2 * LAYERED_LANES + i]);
}

static float rounding(const struct layered_packet *p, int i)
{
    return LAYERED_ROUNDING * fmaxf(fmaxf(fabsf(p->p[0][i]), fabsf(p->p[1][i])), fmaxf(fabsf(p->p[2][i]), 1e-3f));
}

static void map_uv(const struct pell_texture_map *map, const struct pell_mesh *mesh, uint32_t vertex, float out[2])
{
    const float *uv = mesh->uv[map->uv], *m = map->matrix;
    const float u = uv ? uv[2 * (size_t) vertex] : 0.0f, v = uv ? uv[2 * (size_t) vertex + 1] : 0.0f;

    out[0] = m[0] * u + m[1] * v + m[2];
    out[1] = m[3] * u + m[4] * v + m[5];
}

/* Maps seen from the far surface: they run on from where the ray leaves. */
static void place_far(const struct layered_medium *m, struct layered_packet *p, int i, const struct pell_mesh *mesh, uint32_t triangle,
                      float u, float v)
{
    const uint32_t *index = mesh->index + 3 * (size_t) triangle;
    const struct pell_vec3 a = vec3_load(mesh->position + 3 * (size_t) index[0]);
    const struct pell_vec3 e1 = vec3_sub(vec3_load(mesh->position + 3 * (size_t) index[1]), a);
    const struct pell_vec3 e2 = vec3_sub(vec3_load(mesh->position + 3 * (size_t) index[2]), a), n = vec3_cross(e1, e2);
    const float square = vec3_dot(n, n), area = square > 1e-30f ? 1.0f / square : 0.0f;
    const struct pell_vec3 g1 = vec3_mul(vec3_cross(e2, n), area), g2 = vec3_mul(vec3_cross(n, e1), area), w = lane3(p->w, i);
    const float d1 = vec3_dot(g1, w), d2 = vec3_dot(g2, w);

    for (int k = 0; k < m->packs; k++) {
        struct layered_place *o = &p->place[k];
        float c[3][2];
        for (int q = 0; q < 3; q++)
            map_uv(m->pack[k].map, mesh, index[q], c[q]);
        o->du[1][i] = (c[1][0] - c[0][0]) * d1 + (c[2][0] - c[0][0]) * d2;
        o->dv[1][i] = (c[1][1] - c[0][1]) * d1 + (c[2][1] - c[0][1]) * d2;
        o->u[1][i] = (1.0f - u - v) * c[0][0] + u * c[1][0] + v * c[2][0] - p->exit[i] * o->du[1][i];
        o->v[1][i] = (1.0f - u - v) * c[0][1] + u * c[1][1] + v * c[2][1] - p->exit[i] * o->dv[1][i];
    }
}

/* Where the eye's rays leave the solid: marches end there, and in thin parts layers count from there, too. */
static void find_exits(const struct state *st, const struct layered_medium *m, const uint32_t *mesh, struct worker *w)
{
    const struct pell_scene *scene = pell_renderer_scene(st->r);
    struct layered_packet *p = &w->packet;
    const bool two = st->knobs.path != LAYERED_PLANES;
    struct rays rays;

    st->kernels->leave(p, st->size, &rays.r.ray, rays.valid);
    for (int i = 0; i < LAYERED_LANES; i++)
        rays.r.hit.mesh[i] = PELL_NO_HIT;
    pell_rays_closest16(pell_renderer_rays(st->r), rays.valid, true, &rays.r);
    w->rays += p->count;
    for (int i = 0; i < p->count; i++) {
        const struct pell_hit16 *h = &rays.r.hit;
        const struct pell_vec3 way = lane3(p->w, i);
        float facing;
        p->length[i] = fminf(p->length[i], 4.0f * st->size);
        if (h->mesh[i] == PELL_NO_HIT)
            continue;
        facing = h->ngx[i] * way.x + h->ngy[i] * way.y + h->ngz[i] * way.z;
        p->ends_deep[i] = -(p->length[i] < rays.r.ray.tfar[i]);
        if (facing > 0.0f && two && same_body(&scene->meshes[h->mesh[i]], &scene->meshes[mesh[i]])) {
            struct pell_vec3 n = normal_at(&scene->meshes[h->mesh[i]], h->triangle[i], h->u[i], h->v[i]);
            float rate = vec3_dot(n, way), end = fminf(p->length[i], rays.r.ray.tfar[i]);
            if (!(rate > LAYERED_GRAZING))
                rate = LAYERED_GRAZING;
            if ((rays.r.ray.tfar[i] - end) * rate < end * p->rate[i]) {
                p->exit[i] = rays.r.ray.tfar[i];
                p->exit_rate[i] = rate;
                p->exit_normal[0][i] = n.x;
                p->exit_normal[1][i] = n.y;
                p->exit_normal[2][i] = n.z;
                p->thin = true;
                place_far(m, p, i, &scene->meshes[h->mesh[i]], h->triangle[i], h->u[i], h->v[i]);
            }
        }
        p->length[i] = fminf(p->length[i], rays.r.ray.tfar[i]);
    }
}

/* --- Lamps of a packet ---------------------------------------------------------------------------------------------------------- */

static struct pell_vec3 toward(const struct layered_lamp *lamp, int i, struct pell_vec3 from, float *distance)
{
    struct pell_vec3 d = lane3(lamp->to, i);

    *distance = INFINITY;
    if (lamp->away)
        return d;
    d = vec3_sub(d, from);
    *distance = fmaxf(vec3_length(d), 1e-6f);
    return vec3_mul(d, 1.0f / *distance);
}

/* What the source sends to each pixel. False: nothing. */
static bool set_power(const struct state *st, const struct source *s, const struct layered_packet *p, struct layered_lamp *lamp)
{
    const int sample = pell_renderer_sample(st->r);
    bool some = false;

    lamp->away = s->sample.away;
    for (int i = 0; i < p->count; i++) {
        struct pell_emitter_sample one = s->sample;
        float power[3] = { s->power[0], s->power[1], s->power[2] }, scale = s->scale;
        if (s->face) {
            const uint32_t hash = pell_hash((uint32_t) p->at[i] ^ pell_hash(pell_renderer_seed(st->r)));
            double u[3];
            spread((double) s->number + (double) sample * s->of + (double) (hash >> 8) * (1.0 / 64.0), u);
            if (!pell_emitters_sample(s->lamp, lane3(p->p, i), u, &one))
                scale = 0.0f;
        }
        if (!s->even)
            pell_emitters_power_at(s->lamp, &one, lane3(p->p, i), power);
        if (!one.away && !one.delta) {
            const struct pell_vec3 d = vec3_normalize(vec3_sub(lane3(p->p, i), one.at));
            scale *= fmaxf(0.0f, vec3_dot(one.normal, d));
        }
        for (int c = 0; c < 3; c++) {
            const float value = power[c] * scale;
            lamp->power[c][i] = value > 0.0f ? value < 1e25f ? value : 1e25f : 0.0f;
            some = some || lamp->power[c][i] > 0.0f;
        }
        lamp->to[0][i] = one.away ? one.toward.x : one.at.x;
        lamp->to[1][i] = one.away ? one.toward.y : one.at.y;
        lamp->to[2][i] = one.away ? one.toward.z : one.at.z;
    }
    return some;
}

/* How much of a lane's path goes by planes, and whether the lamp sees P. */
static void set_planes(const struct state *st, const struct source *s, const struct layered_packet *p, struct worker *w,
                       struct layered_lamp *lamp)
{
    _Alignas(64) int32_t visible[LAYERED_LANES];
    struct rays rays;
    const int count = st->kernels->see(p, st->knobs.path, st->knobs.shadows, lamp, &rays.r.ray, rays.valid);

    if (count == 0)
        return;
    w->rays += count;
    if (!s->fan || !pell_fan_visible16(s->fan, rays.valid, rays.r.ray.ox, rays.r.ray.oy, rays.r.ray.oz, visible)) {
        pell_rays_occluded16(pell_renderer_rays(st->r), rays.valid, true, &rays.r.ray);
        for (int i = 0; i < p->count; i++)
            visible[i] = rays.r.ray.tfar[i] < 0.0f ? 0 : -1;
    }
    for (int i = 0; i < p->count; i++)
        if (rays.valid[i] && !visible[i])
            lamp->seen[i] = 0.0f;
}

/* One node of the lanes that ask for some: places of the march, and where light comes into the solid on its way there. */
struct node {
    struct rays rays;
    struct pell_vec3 at[16], way[16], k[16], n[16];
    bool asked[16], there[16]; /* there: the ray left the solid */
};

static void trace_node(const struct state *st, const struct layered_packet *p, const uint32_t *mesh, struct node *n, struct worker *w)
{
    const struct pell_scene *scene = pell_renderer_scene(st->r);

    clear(&n->rays);
    for (int i = 0; i < p->count; i++)
        if (n->asked[i])
            aim(&n->rays, i, n->at[i], n->way[i], rounding(p, i), INFINITY);
    pell_rays_closest16(pell_renderer_rays(st->r), n->rays.valid, true, &n->rays.r);
    w->rays += n->rays.count;
    for (int i = 0; i < p->count; i++) {
        const struct pell_hit16 *h = &n->rays.r.hit;
        const struct pell_vec3 g = vec3(h->ngx[i], h->ngy[i], h->ngz[i]);
        n->there[i] = n->asked[i] && h->mesh[i] != PELL_NO_HIT && vec3_dot(g, n->way[i]) > 0.0f &&
                      same_body(&scene->meshes[h->mesh[i]], &scene->meshes[mesh[i]]);
        if (!n->there[i])
            continue;
        n->k[i] = vec3_mad(n->at[i], n->rays.r.ray.tfar[i], n->way[i]);
        n->n[i] = normal_at(&scene->meshes[h->mesh[i]], h->triangle[i], h->u[i], h->v[i]);
        if (!(vec3_dot(n->n[i], n->way[i]) > 0.0f))
            n->n[i] = vec3_normalize(g);
    }
}

/* Light bends where it came in: along the ray that it takes from there to M, as if that were found from M. */
static void bend_node(const struct layered_packet *p, const struct layered_lamp *lamp, float eta, struct node *n)
{
    for (int i = 0; i < p->count; i++) {
        float distance, co, ci;
        struct pell_vec3 to;
        if (!n->there[i])
            continue;
        to = toward(lamp, i, n->k[i], &distance);
        co = vec3_dot(n->n[i], to);
        if (!(co > 0.0f))
            continue;
        ci = sqrtf(1.0f - (1.0f - co * co) / (eta * eta));
        n->way[i] = vec3_mad(vec3_mul(to, 1.0f / eta), ci - co / eta, n->n[i]);
    }
}

/* Behind a sheet that has no other side light comes in where its layers end. */
static void open_sheet(const struct layered_medium *m, const struct layered_packet *p, const struct layered_lamp *lamp,
                       const struct node *n, float deepest, float t, int i, float *km, float *beam)
{
    const float under = -vec3_dot(lane3(p->n, i), n->way[i]), depth = t * p->length[i] * p->rate[i];
    float distance;

    *km = 0.0f;
    *beam = 0.0f;
    if (m->bottomless || n->rays.r.hit.mesh[i] != PELL_NO_HIT || !(under > 0.0f))
        return;
    *km = fmaxf(deepest - depth, 0.0f) / fmaxf(under, LAYERED_GRAZING);
    toward(lamp, i, vec3_mad(n->at[i], *km, n->way[i]), &distance);
    *beam = lamp->away ? 1.0f : 1.0f / fmaxf(distance * distance, 1e-6f);
}

static void cast_shadows(const struct state *st, const struct layered_packet *p, struct layered_lamp *lamp, const struct node *n, int node,
                         struct worker *w)
{
    struct rays rays;

    clear(&rays);
    for (int i = 0; i < p->count; i++) {
        struct pell_vec3 from = n->k[i], to;
        float distance;
        if (!n->asked[i] || !(lamp->beam[node][i] > 0.0f))
            continue;
        if (!n->there[i])
            from = vec3_mad(n->at[i], lamp->km[node][i], n->way[i]);
        to = toward(lamp, i, from, &distance);
        aim(&rays, i, from, to, 2.0f * rounding(p, i), lamp->away ? INFINITY : 0.9999f * distance);
    }
    if (rays.count == 0)
        return;
    pell_rays_occluded16(pell_renderer_rays(st->r), rays.valid, true, &rays.r.ray);
    w->rays += rays.count;
    for (int i = 0; i < p->count; i++)
        if (rays.valid[i] && rays.r.ray.tfar[i] < 0.0f)
            lamp->beam[node][i] = 0.0f;
}

static void depths_of(const struct state *st, int material, const struct pell_mesh *mesh, uint32_t triangle, float u, float v, float *depth)
{
    const struct layered_medium *m = &st->media[material];

    pell_strata_depths(st->strata[material], mesh, triangle, u, v, depth);
    for (int j = 0; j < m->count; j++)
        depth[j] = fminf(j + 1 == m->count && m->bottomless ? LAYERED_FAR : depth[j], LAYERED_FAR);
}

static void set_node(const struct state *st, const struct layered_medium *m, const struct layered_packet *p, struct layered_lamp *lamp,
                     const uint32_t *mesh, const uint32_t *triangle, int node, struct worker *w)
{
    const struct pell_scene *scene = pell_renderer_scene(st->r);
    const int material = scene->meshes[mesh[0]].material;
    const float t = st->work.node[node], eta = st->work.refracts ? m->eta : 1.0f;
    struct node n;

    for (int i = 0; i < p->count; i++) {
        float distance;
        n.asked[i] = lamp->planes[i] < 1.0f && lamp->power[0][i] + lamp->power[1][i] + lamp->power[2][i] > 0.0f;
        n.at[i] = vec3_mad(lane3(p->p, i), t * p->length[i], lane3(p->w, i));
        n.way[i] = toward(lamp, i, n.at[i], &distance);
    }
    trace_node(st, p, mesh, &n, w);
    if (eta != 1.0f) {
        bend_node(p, lamp, eta, &n);
        trace_node(st, p, mesh, &n, w);
    }
    for (int i = 0; i < LAYERED_LANES; i++) {
        const struct pell_hit16 *h = &n.rays.r.hit;
        float depth[PELL_LAYERS_MOST], distance, co;
        lamp->km[node][i] = lamp->beam[node][i] = 0.0f;
        lamp->cosine[node][i] = 1.0f;
        for (int k = 0; k < 3; k++)
            lamp->way[node][k][i] = k == 0;
        for (int j = 0; j < m->count; j++)
            lamp->depth[(node * m->count + j) * LAYERED_LANES + i] = m->layer[j].depth;
        if (i >= p->count || !n.asked[i])
            continue;
        lamp->way[node][0][i] = n.way[i].x;
        lamp->way[node][1][i] = n.way[i].y;
        lamp->way[node][2][i] = n.way[i].z;
        if (n.there[i]) {
            const struct pell_vec3 to = toward(lamp, i, n.k[i], &distance);
            co = vec3_dot(n.n[i], to);
            lamp->km[node][i] = n.rays.r.ray.tfar[i];
            lamp->cosine[node][i] = fmaxf(vec3_dot(n.n[i], n.way[i]), LAYERED_GRAZING);
            if (co > 0.0f) {
                const float ci = sqrtf(1.0f - (1.0f - co * co) / (eta * eta));
                lamp->beam[node][i] = eta == 1.0f ? 1.0f : (float) (1.0 - pell_fresnel((double) eta, (double) fminf(co, 1.0f))) * co / ci;
                lamp->beam[node][i] *= lamp->away ? 1.0f : 1.0f / fmaxf(distance * distance, 1e-6f);
            }
            if (m->packs > 0)
                depths_of(st, material, &scene->meshes[h->mesh[i]], h->triangle[i], h->u[i], h->v[i], depth);
        } else {
            if (m->packs > 0)
                depths_of(st, material, &scene->meshes[mesh[i]], triangle[i], p->u[i], p->v[i], depth);
            open_sheet(m, p, lamp, &n, m->packs > 0 ? depth[m->count - 1] : m->deepest, t, i, &lamp->km[node][i], &lamp->beam[node][i]);
            lamp->cosine[node][i] = 1e6f;
        }
        for (int j = 0; j < m->count && m->packs > 0; j++)
            lamp->depth[(node * m->count + j) * LAYERED_LANES + i] = depth[j];
    }
    if (st->knobs.shadows)
        cast_shadows(st, p, lamp, &n, node, w);
}

/* --- A packet ------------------------------------------------------------------------------------------------------------------- */

/* Lanes `first` to `last` are of one triangle. */
static void read_triangle(const struct layered_medium *m, const struct pell_mesh *from, const float (*plane)[4], uint32_t triangle,
                          struct layered_packet *p, int first, int last)
{
#define FILL(row, value)                                                                                                                   \
    do {                                                                                                                                   \
        const float one = (value);                                                                                                         \
        for (int i = first; i <= last; i++)                                                                                                \
            (row)[i] = one;                                                                                                                \
    } while (0)
    for (int c = 0; c < 3; c++) {
        const size_t v = from->index[3 * (size_t) triangle + (size_t) c];
        for (int k = 0; k < 3; k++) {
            FILL(p->corner[c][k], from->position[3 * v + (size_t) k]);
            FILL(p->normal[c][k], from->normal[3 * v + (size_t) k]);
            FILL(p->plane[c][k], plane[v][k]);
        }
        FILL(p->plane[c][3], plane[v][3]);
        for (int k = 0; k < m->packs; k++) {
            float uv[2];
            map_uv(m->pack[k].map, from, (uint32_t) v, uv);
            for (int d = 0; d < 2; d++)
                FILL(p->uv + (ptrdiff_t) ((k * 3 + c) * 2 + d) * LAYERED_LANES, uv[d]);
        }
    }
#undef FILL
}

/* Reads 16 pixels; lanes without one are the first. */
static void read_packet(const struct state *st, const struct layered_medium *m, const int32_t *at, int count, struct layered_packet *p,
                        uint32_t mesh[16], uint32_t triangle[16])
{
    const struct pell_scene *scene = pell_renderer_scene(st->r);
    const struct pell_frame *in = st->in;
    const struct pell_vec3 eye = st->view->origin, forward = st->view->forward;

    p->count = count;
    for (int i = 0; i < LAYERED_LANES; i++) {
        const int32_t pixel = at[i < count ? i : 0];
        mesh[i] = in->mesh[pixel];
        triangle[i] = in->triangle[pixel];
        p->at[i] = pixel;
        p->u[i] = in->barycentric[0][pixel];
        p->v[i] = in->barycentric[1][pixel];
    }
    for (int i = 0, last; i < LAYERED_LANES; i = last + 1) {
        for (last = i; last + 1 < LAYERED_LANES && mesh[last + 1] == mesh[i] && triangle[last + 1] == triangle[i];)
            last++;
        read_triangle(m, &scene->meshes[mesh[i]], (const float(*)[4]) st->planes[mesh[i]], triangle[i], p, i, last);
    }
    for (int i = 0; i < LAYERED_LANES; i++) {
        const float u = p->u[i], v = p->v[i], w = 1.0f - u - v;
        const float x = eye.x - (w * p->corner[0][0][i] + u * p->corner[1][0][i] + v * p->corner[2][0][i]);
        const float y = eye.y - (w * p->corner[0][1][i] + u * p->corner[1][1][i] + v * p->corner[2][1][i]);
        const float z = eye.z - (w * p->corner[0][2][i] + u * p->corner[1][2][i] + v * p->corner[2][2][i]);
        const float far = -(x * forward.x + y * forward.y + z * forward.z), per = 1.0f / fmaxf(sqrtf(x * x + y * y + z * z), 1e-20f);
        p->spacing[i] = (in->orthographic ? 1.0f : far) / in->focal_px;
        p->eye[0][i] = in->orthographic ? -forward.x : per * x;
        p->eye[1][i] = in->orthographic ? -forward.y : per * y;
        p->eye[2][i] = in->orthographic ? -forward.z : per * z;
    }
}

/* The base colour below the deepest layer, where the march would end. */
static void set_colors(const struct pell_material *m, const struct pell_scene *scene, struct layered_packet *p, const uint32_t *mesh,
                       const uint32_t *triangle)
{
    p->shows_bottom = true;
    for (int i = 0; i < p->count; i++) {
        float rgba[4] = { 1.0f, 1.0f, 1.0f, 1.0f };
        const struct pell_texture *t = m->base_color_map.texture;
        if (t && t->image.pixels) {
            const uint32_t *index = scene->meshes[mesh[i]].index + 3 * (size_t) triangle[i];
            float uv[3][2];
            for (int c = 0; c < 3; c++)
                map_uv(&m->base_color_map, &scene->meshes[mesh[i]], index[c], uv[c]);
            pell_image_sample(&t->image, t->wrap_u, t->wrap_v, t->nearest,
                              uv[0][0] + p->u[i] * (uv[1][0] - uv[0][0]) + p->v[i] * (uv[2][0] - uv[0][0]),
                              uv[0][1] + p->u[i] * (uv[1][1] - uv[0][1]) + p->v[i] * (uv[2][1] - uv[0][1]), rgba);
        }
        for (int c = 0; c < 3; c++) {
            const float value = m->base_color[c] * rgba[c];
            p->color[c][i] = value > 0.0f ? fminf(value, 1.0f) * (1.0f / PELL_PI_F) : 0.0f;
        }
    }
}

static void run_packet(const struct state *st, int material, const int32_t *at, int count, struct worker *w)
{
    const struct pell_scene *scene = pell_renderer_scene(st->r);
    const struct layered_medium *m = &st->media[material];
    struct layered_packet *p = &w->packet;
    uint32_t mesh[16], triangle[16];
    int waiting = 0;

    read_packet(st, m, at, count, p, mesh, triangle);
    st->kernels->start(&st->work, m, p);
    find_exits(st, m, mesh, w);
    if (m->below == PELL_BELOW_SURFACE_COLOR && !m->bottomless)
        set_colors(&scene->materials[material], scene, p, mesh, triangle);
    for (int i = 0; i < st->num_sources; i++) {
        struct layered_lamp *lamp = &w->lamps[waiting];
        if (set_power(st, &st->sources[i], p, lamp)) {
            set_planes(st, &st->sources[i], p, w, lamp);
            for (int k = 0; k < LAYERED_NODES && lamp->any_nodes; k++)
                set_node(st, m, p, lamp, mesh, triangle, k, w);
            waiting++;
        }
        if (waiting == LAYERED_GROUP || (waiting > 0 && i + 1 == st->num_sources)) {
            st->kernels->march(&st->work, m, p, w->lamps, waiting);
            w->marches += (int64_t) waiting * count;
            waiting = 0;
        }
    }
    w->pixels += count;
    for (int c = 0; c < 3; c++)
        for (int i = 0; i < count; i++) {
            const bool apart = st->out->single[0] != NULL;
            st->out->light[c][at[i]] = apart ? 0.0f : p->light[c][i];
            if (apart)
                st->out->single[c][at[i]] = p->light[c][i];
        }
}

/* Pixels of a band in squares of 4 x 4, packets of one material each. */
static void run_band(void *arg, int index, int worker)
{
    const struct state *st = arg;
    const struct pell_scene *scene = pell_renderer_scene(st->r);
    const struct pell_frame *in = st->in;
    const int y0 = in->rect.y0 + index * BAND, y1 = y0 + BAND < in->rect.y1 ? y0 + BAND : in->rect.y1;
    int32_t at[16];
    int count = 0, material = -1;

    for (int x0 = in->rect.x0; x0 < in->rect.x1; x0 += BAND) {
        if (pell_cancelled(st->ctx))
            return;
        for (int y = y0; y < y1; y++)
            for (int x = x0; x < x0 + BAND && x < in->rect.x1; x++) {
                const ptrdiff_t i = y * in->stride + x;
                const struct pell_mesh *mesh;
                if (!in->material[i])
                    continue;
                if (in->mesh[i] >= st->num_meshes || !st->planes[in->mesh[i]] ||
                    in->triangle[i] >= scene->meshes[in->mesh[i]].num_triangles) {
                    for (int c = 0; c < 3; c++) {
                        st->out->light[c][i] = 0.0f;
                        if (st->out->single[0])
                            st->out->single[c][i] = 0.0f;
                    }
                    continue;
                }
                mesh = &scene->meshes[in->mesh[i]];
                if (count == 16 || (count > 0 && mesh->material != material)) {
                    run_packet(st, material, at, count, &st->workers[worker]);
                    count = 0;
                }
                material = mesh->material;
                at[count++] = (int32_t) i;
            }
    }
    if (count > 0)
        run_packet(st, material, at, count, &st->workers[worker]);
}

static enum pell_result layered_render(void *state, const struct pell_frame *in, const struct pell_frame_light *out)
{
    struct state *st = state;
    const double start = pell_seconds();
    int64_t pixels = 0, rays = 0;

    st->in = in;
    st->out = out;
    st->view = pell_renderer_eye(st->r);
    for (int i = 0; i < st->num_sources; i++)
        st->sources[i].fan = st->sources[i].face ? NULL : pell_renderer_fan(st->r, st->sources[i].light);
    for (int i = 0; i < pell_pool_threads(st->pool); i++)
        st->workers[i].pixels = st->workers[i].rays = st->workers[i].marches = 0;
    pell_pool_run(st->pool, (in->rect.y1 - in->rect.y0 + BAND - 1) / BAND, run_band, st);
    for (int i = 0; i < pell_pool_threads(st->pool); i++) {
        pixels += st->workers[i].pixels;
        rays += st->workers[i].rays;
    }
    st->num_times = 0;
    if (st->fit_seconds >= 0.0) {
        st->times[st->num_times++] = (struct pell_pass_time){ .name = "planes", .seconds = st->fit_seconds, .bytes = st->fitted * 44 };
        st->fit_seconds = -1.0;
    }
    st->times[st->num_times++] = (struct pell_pass_time){
        .name = "layered", .seconds = pell_seconds() - start, .pixels = pixels, .bytes = pixels * 30, .rays = rays
    };
    st->in = NULL;
    st->out = NULL;
    return pell_cancelled(st->ctx) ? PELL_ERR_CANCELLED : PELL_OK;
}

static size_t layered_times(const void *state, struct pell_pass_time *times, size_t size)
{
    const struct state *st = state;

    for (size_t i = 0; i < st->num_times && i < size; i++)
        times[i] = st->times[i];
    return st->num_times < size ? st->num_times : size;
}

const struct pell_method_engine layered_cpu = {
    .create = layered_create, .render = layered_render, .destroy = layered_destroy, .times = layered_times
};
