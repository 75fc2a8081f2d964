/* SPDX-License-Identifier: MIT
 *
 * translucent_shadow_map.c - entry points of the light transmitted to each texel, for one light: by a depth map from the light, the paper's
 * translucent shadow map, or by a ray toward the light.
 */
#include "methods/texture_space/transmitted.h"

#include <string.h>

enum { FACES = 4096 };        /* triangles per task */
#define MAX_HALF_VIEW 1.2f    /* tangent of half the field of view for a light among the objects */
#define MIN_AWAY_COSINE 1e-4f /* a normal whose cosine with the light is below -MIN_AWAY_COSINE faces away despite rounding errors */

struct faces {
    const struct ts_tsm_params *p;
    uint8_t *out;
};

/* A triangle has the light entirely in front of its plane or behind it. */
static uint8_t face(const struct ts_tsm_params *p, uint32_t t)
{
    const struct ts_atlas *a = p->atlas;
    const struct pell_mesh *m = &a->scene->meshes[a->triangles[t].mesh];
    const uint32_t *index = m->index + 3 * (size_t) a->triangles[t].triangle;
    const enum pell_light_type type = p->light->type;
    struct pell_vec3 at[3], light[3], n;
    float far[3];

    if (type == PELL_LIGHT_ENVIRONMENT) /* an environment is behind every face */
        return TS_FACE_AWAY;
    pell_triangle_corners(m, a->triangles[t].triangle, at);
    n = pell_triangle_cross(at);
    for (int k = 0; k < 3; k++)
        light[k] = ts_toward(p->light, at[k], n, &far[k]);
    if (!(vec3_dot(n, light[0]) < 0.0f))
        return 0;
    /* Tests the interpolated normals over the whole triangle against all directions to the light. */
    if (type == PELL_LIGHT_RECT || type == PELL_LIGHT_DISC || a->scene->materials[m->material].normal_map.texture)
        return TS_FACE_AWAY;
    for (int i = 0; i < 3; i++) {
        const struct pell_vec3 normal = vec3_load(m->normal + 3 * (size_t) index[i]);
        if (!(vec3_dot(normal, n) > 0.0f))
            return TS_FACE_AWAY;
        for (int k = 0; k < 3; k++)
            if (!(vec3_dot(normal, light[k]) < -MIN_AWAY_COSINE * vec3_length(normal)))
                return TS_FACE_AWAY;
    }
    return TS_FACE_AWAY | TS_FACE_DARK;
}

static void face_chunk(void *arg, int chunk, int worker)
{
    const struct faces *f = arg;
    const uint32_t end = f->p->atlas->num_triangles, first = (uint32_t) chunk * FACES;

    (void) worker;
    for (uint32_t t = first; t < first + FACES && t < end; t++)
        f->out[t] = face(f->p, t);
}

void ts_tsm_face(const struct ts_tsm_params *params, struct ts_tsm *tsm)
{
    struct faces f = { params, tsm->faces };

    pell_pool_run(params->services->pool, (int) ((params->atlas->num_triangles + FACES - 1) / FACES), face_chunk, &f);
}

/* --- The map --------------------------------------------------------------------------------------------------------------------- */

/* The light's view of the solid, in a square that just contains it; false: the view is degenerate. */
static bool aim(const struct ts_tsm_params *p, struct pell_view *v)
{
    struct pell_vec3 low = { INFINITY, INFINITY, INFINITY }, high = { -INFINITY, -INFINITY, -INFINITY }, middle, dir;
    float radius, distance;

    for (size_t i = 0; i < p->atlas->scene->num_meshes; i++) {
        const struct pell_mesh *m = &p->atlas->scene->meshes[i];
        for (size_t k = 0; p->atlas->first[i] != UINT32_MAX && k < m->num_vertices; k++) {
            const float *q = m->position + 3 * k;
            low = vec3(fminf(low.x, q[0]), fminf(low.y, q[1]), fminf(low.z, q[2]));
            high = vec3(fmaxf(high.x, q[0]), fmaxf(high.y, q[1]), fmaxf(high.z, q[2]));
        }
    }
    middle = vec3_mul(vec3_add(low, high), 0.5f);
    radius = 0.5f * vec3_length(vec3_sub(high, low)) * 1.0001f;
    *v = (struct pell_view) { .width = p->size, .height = p->size };
    if (!(radius > 0.0f && radius < 1e15f))
        return false;
    if (p->light->type == PELL_LIGHT_DIRECTIONAL) {
        v->orthographic = true;
        v->forward = vec3_normalize(vec3_load(p->light->direction));
        v->origin = vec3_mad(middle, -2.0f * radius, v->forward);
        v->focal_px = (float) p->size / (2.0f * radius);
    } else {
        dir = vec3_sub(middle, vec3_load(p->light->position));
        distance = vec3_length(dir);
        v->origin = vec3_load(p->light->position);
        v->forward = distance > 1e-6f * radius ? vec3_mul(dir, 1.0f / distance) : vec3(0.0f, 0.0f, -1.0f);
        v->focal_px = 0.5f * (float) p->size / tanf(distance > radius ? fminf(asinf(radius / distance), MAX_HALF_VIEW) : MAX_HALF_VIEW);
    }
    vec3_basis(v->forward, &v->right, &v->up);
    return v->focal_px > 0.0f && isfinite(v->focal_px);
}

static void map_row(void *arg, int y, int worker)
{
    struct ts_task *t = arg;
    const struct ts_atlas *a = t->p->atlas;
    _Alignas(64) int active[16];
    struct pell_ray_hit16 hit;

    (void) worker;
    for (int x = 0; x < t->view.width; x += 16) {
        pell_view_closest16(&t->view, t->p->services->rays, x, t->view.width, y, PELL_RAY_ALL, active, &hit);
        for (int i = 0; i < 16 && x + i < t->view.width; i++) {
            const uint32_t mesh = hit.hit.mesh[i];
            struct ts_surface_point *out = &t->map[(size_t) y * (size_t) t->view.width + (size_t) (x + i)];
            *out = (struct ts_surface_point) { .triangle = UINT32_MAX };
            if (mesh < t->p->solids->num_meshes && t->p->solids->of_mesh[mesh] == t->p->solid)
                *out = (struct ts_surface_point) { a->first[mesh] + hit.hit.triangle[i], hit.hit.u[i], hit.hit.v[i] };
        }
    }
    atomic_fetch_add_explicit(&t->rays, t->view.width, memory_order_relaxed);
}

static void look_up(struct ts_task *t, ptrdiff_t at, int tile)
{
    const struct pell_view *v = &t->view;
    const struct ts_shading_point s = ts_shading_point_at(t->p->atlas, at);
    const struct pell_vec3 to = vec3_sub(s.at, v->origin);
    const float depth = v->orthographic ? 1.0f : vec3_dot(to, v->forward);
    const struct ts_surface_point *m;
    struct pell_vec3 light;
    struct ts_shading_point other;
    float far, px, py;

    if (!(depth > 0.0f))
        return;
    px = floorf(vec3_dot(to, v->right) / depth * v->focal_px + 0.5f * (float) v->width);
    py = floorf(0.5f * (float) v->height - vec3_dot(to, v->up) / depth * v->focal_px);
    if (!(px >= 0.0f && py >= 0.0f && px < (float) v->width && py < (float) v->height))
        return;
    m = &t->map[(size_t) py * (size_t) v->width + (size_t) px];
    if (m->triangle == UINT32_MAX)
        return;
    light = ts_toward(t->p->light, s.at, s.geometric, &far);
    other = ts_shading_point_of(t->p->atlas, *m);
    /* The visible surface may be this one, off by a pixel. */
    if (vec3_dot(vec3_sub(other.at, s.at), light) < 1.5f * depth / v->focal_px)
        return;
    t->count[tile] += ts_transmit(t, at, &s, *m, light, light, &t->found[t->first[tile] + t->count[tile]]);
}

static void run_tile(void *arg, int tile, int worker)
{
    struct ts_task *t = arg;
    const struct ts_atlas *a = t->p->atlas;
    uint8_t texels[TS_TILE * TS_BLOCK];
    struct ts_packet k;

    (void) worker;
    memset(&k, 0, sizeof(k));
    k.to_light = true;
    t->count[tile] = 0;
    for (int y = tile * TS_TILE; !t->lit && y < (tile + 1) * TS_TILE && y < a->height; y++)
        for (int r = a->first_run[y]; r < a->first_run[y + 1]; r++)
            memset(t->alpha + y * a->stride + a->runs[r].from * TS_BLOCK, 0,
                   (size_t) (a->runs[r].to - a->runs[r].from) * TS_BLOCK * sizeof(float));
    for (int block = 0; block < a->blocks; block++) {
        const ptrdiff_t first = tile * TS_TILE * a->stride + block * TS_BLOCK;
        const int count = ts_block_texels(a, tile * TS_TILE, block, texels);
        for (int i = 0; t->map && i < count; i++) {
            const ptrdiff_t at = first + texels[i] / TS_BLOCK * a->stride + texels[i] % TS_BLOCK;
            if (ts_needs_ray(t, at))
                look_up(t, at, tile);
        }
        if (!t->map)
            ts_ray_texels(t, first, tile, texels, count, &k);
    }
    ts_trace(t, tile, &k);
}

/* Appends the texels that tiles have found to the `kept` texels of the list. */
static void gather_found(struct ts_tsm *out, int tiles, size_t kept)
{
    out->count = kept;
    for (int y = 0; y < tiles; y++) {
        memmove(out->texels + out->count, out->texels + out->first[y], (size_t) out->count_of[y] * sizeof(*out->texels));
        out->count += (size_t) out->count_of[y];
    }
}

enum pell_result ts_tsm_make(const struct ts_tsm_params *params, float *alpha, struct ts_tsm *out, int64_t *rays)
{
    struct pell_context *ctx = params->services->ctx;
    struct pell_pool *pool = params->services->pool;
    const int tiles = (params->atlas->height + TS_TILE - 1) / TS_TILE;
    struct ts_task t = { params, alpha, out->faces, .found = out->texels, .first = out->first, .count = out->count_of };
    int first = 0;

    out->count = 0;
    for (int y = 0; y < tiles; y++) {
        out->first[y] = first;
        first += out->num[y];
    }
    if (params->form == TS_TSM_MAP) {
        if (!aim(params, &t.view))
            return PELL_OK;
        t.map = out->map;
        pell_pool_run(pool, params->size, map_row, &t);
    }
    pell_pool_run(pool, tiles, run_tile, &t);
    gather_found(out, tiles, 0);
    *rays += atomic_load(&t.rays);
    return pell_cancelled(ctx) ? PELL_ERR_CANCELLED : PELL_OK;
}

enum pell_result ts_tsm_light(const struct ts_tsm_params *params, const float *const lit[3], float *alpha, struct ts_tsm *out,
                              int64_t *rays)
{
    struct pell_context *ctx = params->services->ctx;
    struct pell_pool *pool = params->services->pool;
    const int tiles = (params->atlas->height + TS_TILE - 1) / TS_TILE;
    const size_t known = out->count;
    struct ts_task t = {
        .p = params,
        .alpha = alpha,
        .faces = out->faces,
        .found = out->texels,
        .first = out->first,
        .count = out->count_of,
        .lit = lit,
        .known = known,
    };
    int first = (int) known;

    if (params->form == TS_TSM_MAP) {
        if (!aim(params, &t.view))
            return PELL_OK;
        t.map = out->map;
    } else {
        pell_pool_run(pool, (int) ((known + TS_CHUNK - 1) / TS_CHUNK), ts_trace_beyond_shadow, &t);
    }
    /* No texel is found twice, so the list has room for all. */
    for (int y = 0; y < tiles; y++) {
        out->first[y] = first;
        first += out->num[y] - out->count_of[y];
    }
    pell_pool_run(pool, tiles, run_tile, &t);
    gather_found(out, tiles, known);
    t.known = out->count;
    if (params->form == TS_TSM_RAY)
        pell_pool_run(pool, (int) ((t.known + TS_CHUNK - 1) / TS_CHUNK), ts_trace_to_face, &t);
    *rays += atomic_load(&t.rays);
    return pell_cancelled(ctx) ? PELL_ERR_CANCELLED : PELL_OK;
}

enum pell_result ts_tsm_allocate(struct pell_context *ctx, const struct ts_atlas *const *atlases, size_t count, int map_size,
                                 struct ts_tsm *out)
{
    size_t most = 0, tiles = 0, triangles = 0;

    for (size_t i = 0; i < count; i++) {
        most = (size_t) atlases[i]->inner > most ? (size_t) atlases[i]->inner : most;
        tiles = (size_t) atlases[i]->height > TS_TILE * tiles ? (size_t) atlases[i]->height / TS_TILE + 1 : tiles;
        triangles = atlases[i]->num_triangles > triangles ? atlases[i]->num_triangles : triangles;
    }
    out->texels = pell_alloc_array(ctx, most + 1, sizeof(*out->texels));
    out->num = pell_calloc(ctx, tiles + 1, sizeof(*out->num));
    out->first = pell_calloc(ctx, tiles + 1, sizeof(*out->first));
    out->count_of = pell_calloc(ctx, tiles + 1, sizeof(*out->count_of));
    out->faces = pell_alloc_array(ctx, triangles + 1, sizeof(*out->faces));
    if (map_size > 0)
        out->map = pell_alloc_array(ctx, (size_t) map_size * (size_t) map_size, sizeof(struct ts_surface_point));
    return out->texels && out->num && out->first && out->count_of && out->faces && (map_size == 0 || out->map) ? PELL_OK : PELL_ERR_NOMEM;
}

void ts_tsm_start(const struct ts_atlas *a, struct ts_tsm *tsm)
{
    uint8_t texels[TS_TILE * TS_BLOCK];

    for (int y = 0; y < a->height; y += TS_TILE) {
        tsm->num[y / TS_TILE] = 0;
        for (int block = 0; block < a->blocks; block++)
            tsm->num[y / TS_TILE] += ts_block_texels(a, y, block, texels);
    }
}

void ts_tsm_finish(struct pell_context *ctx, struct ts_tsm *tsm)
{
    pell_free(ctx, tsm->texels);
    pell_free(ctx, tsm->num);
    pell_free(ctx, tsm->first);
    pell_free(ctx, tsm->count_of);
    pell_free(ctx, tsm->faces);
    pell_free(ctx, tsm->map);
    memset(tsm, 0, sizeof(*tsm));
}
