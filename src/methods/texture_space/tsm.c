/* SPDX-License-Identifier: MIT
 *
 * tsm.c - for a light, where what comes through at each texel entered: by a map of what the light sees, the paper's translucent shadow
 * map, or by a ray toward the light.
 */
#include "methods/texture_space/texture_space.h"

#include <stdatomic.h>
#include <string.h>

enum { ROWS = 16 };
#define WIDEST 1.2f  /* half the view of a light that stands among the things */
#define OBLIQUE 4.0f /* rays go this many times the thickness at which nothing comes through */

struct map_texel {
    uint32_t triangle; /* of the body; UINT32_MAX: the light sees something else */
    float u, v;
};

struct task {
    const struct ts_tsm_params *p;
    float *alpha;
    struct ts_through_texel *found; /* a row's at first_of_row */
    const int *first;               /* per row */
    int *count;                     /* per row */
    struct pell_view view;
    struct map_texel *map;
    _Atomic int64_t rays;
};

struct spot {
    struct pell_vec3 at, geometric, normal;
    float largest;
};

/* A point of a triangle. The normal is the smooth one. */
static struct spot spot_of(const struct ts_atlas *a, uint32_t t, float u, float v)
{
    const struct pell_mesh *m = &a->scene->meshes[a->triangles[t].mesh];
    const uint32_t *index = m->index + 3 * (size_t) a->triangles[t].triangle;
    struct pell_vec3 p[3], e[2], n = { 0 };
    struct spot s;

    for (int k = 0; k < 3; k++) {
        p[k] = vec3_load(m->position + 3 * (size_t) index[k]);
        n = vec3_mad(n, k == 0 ? 1.0f - u - v : k == 1 ? u : v, vec3_load(m->normal + 3 * (size_t) index[k]));
    }
    e[0] = vec3_sub(p[1], p[0]);
    e[1] = vec3_sub(p[2], p[0]);
    s.at = vec3_mad(vec3_mad(p[0], u, e[0]), v, e[1]);
    s.geometric = vec3_normalize(vec3_cross(e[0], e[1]));
    s.normal = vec3_dot(n, s.geometric) > 0.0f ? vec3_normalize(n) : s.geometric;
    s.largest = fmaxf(fabsf(s.at.x), fmaxf(fabsf(s.at.y), fabsf(s.at.z)));
    return s;
}

/* The way to the light's middle, unit; *far: how far that is. */
static struct pell_vec3 toward(const struct pell_light *light, struct pell_vec3 from, float *far)
{
    struct pell_vec3 way;

    if (light->type == PELL_LIGHT_DIRECTIONAL) {
        *far = INFINITY;
        return vec3_mul(vec3_normalize(vec3_load(light->direction)), -1.0f);
    }
    way = vec3_sub(vec3_load(light->position), from);
    *far = vec3_length(way);
    return *far > 0.0f ? vec3_mul(way, 1.0f / *far) : vec3(0.0f, 0.0f, 1.0f);
}

/* Light that enters at A, seen from texel C: its thickness and what else the blurs ask. */
static void pass_through(const struct task *t, ptrdiff_t at, const struct spot *c, uint32_t triangle, float u, float v,
                         struct pell_vec3 light, struct ts_through_texel *out, bool *is)
{
    const struct ts_atlas *a = t->p->atlas;
    const struct spot s = spot_of(a, triangle, u, v);
    const struct pell_vec3 way = vec3_sub(s.at, c->at);
    const float m = vec3_length(way), opposed = fmaxf(0.0f, -vec3_dot(s.normal, c->normal));
    const float d = m + opposed * (m * fmaxf(0.0f, -vec3_dot(c->normal, light)) - m);

    *is = false;
    out->at = (int32_t) at;
    out->from = ts_atlas_place(a, triangle, u, v);
    if (out->from.at < 0 || !(vec3_dot(s.geometric, light) > 0.0f) || !((double) d < t->p->thickest))
        return;
    if (out->from.key == a->key[at]) {
        const ptrdiff_t from = out->from.at, x = at % a->stride, y = at / a->stride;
        const ptrdiff_t near[2] = { from % a->stride, from / a->stride };
        const float *const length[2] = { a->length[0], a->length[1] };
        const float dx = (float) (near[0] - x) + out->from.fx, dy = (float) (near[1] - y) + out->from.fy;
        const ptrdiff_t there = a->key[from] == out->from.key ? from : at;
        const float lx = 0.5f * (length[0][at] + length[0][there]), ly = 0.5f * (length[1][at] + length[1][there]);
        const float along = (dx + 0.5f * (a->lean[at] + a->lean[there]) * dy) * lx;
        out->apart = sqrtf(along * along + dy * ly * dy * ly);
        out->round = true;
    } else {
        out->apart = m;
        out->round = false;
    }
    out->opposed = opposed;
    t->alpha[at] = expf(-d / (float) t->p->falloff);
    *is = true;
}

/* --- Rays ------------------------------------------------------------------------------------------------------------------------ */

struct packet {
    _Alignas(64) int open[16];
    struct pell_ray_hit16 rays;
    struct spot spots[16];
    struct pell_vec3 light[16];
    ptrdiff_t at[16];
    int count;
};

static void trace(struct task *t, int y, struct packet *k)
{
    const struct ts_atlas *a = t->p->atlas;

    if (k->count == 0)
        return;
    for (int i = 0; i < 16; i++) {
        k->open[i] = i < k->count ? -1 : 0;
        k->rays.hit.mesh[i] = PELL_NO_HIT;
    }
    pell_rays_closest16(pell_renderer_rays(t->p->r), k->open, true, &k->rays);
    atomic_fetch_add_explicit(&t->rays, k->count, memory_order_relaxed);
    for (int i = 0; i < k->count; i++) {
        const uint32_t mesh = k->rays.hit.mesh[i];
        bool is;
        if (mesh >= t->p->bodies->num_meshes || t->p->bodies->of_mesh[mesh] != t->p->body)
            continue;
        pass_through(t, k->at[i], &k->spots[i], a->first[mesh] + k->rays.hit.triangle[i], k->rays.hit.u[i], k->rays.hit.v[i], k->light[i],
                     &t->found[t->first[y] + t->count[y]], &is);
        t->count[y] += is;
    }
    k->count = 0;
}

static void ray_row(struct task *t, int y)
{
    const struct ts_atlas *a = t->p->atlas;
    struct packet k;

    memset(&k, 0, sizeof(k));
    for (int r = a->first_run[y]; r < a->first_run[y + 1]; r++)
        for (int x = a->runs[r].from * TS_BLOCK; x < a->runs[r].to * TS_BLOCK; x++) {
            const ptrdiff_t at = y * a->stride + x;
            struct pell_ray16 *ray = &k.rays.ray;
            const int i = k.count;
            struct spot *s = &k.spots[i];
            struct pell_vec3 from;
            float far;
            t->alpha[at] = 0.0f;
            if (a->source[at] == UINT32_MAX)
                continue;
            *s = spot_of(a, a->source[at], a->bary[0][at], a->bary[1][at]);
            k.light[i] = toward(t->p->light, s->at, &far);
            if (vec3_dot(s->geometric, k.light[i]) >= 0.0f)
                continue; /* it faces the light */
            k.at[i] = at;
            from = vec3_mad(s->at, -(3e-5f * s->largest), s->geometric);
            ray->ox[i] = from.x;
            ray->oy[i] = from.y;
            ray->oz[i] = from.z;
            ray->dx[i] = k.light[i].x;
            ray->dy[i] = k.light[i].y;
            ray->dz[i] = k.light[i].z;
            ray->tnear[i] = 0.0f;
            ray->tfar[i] = fminf(far, OBLIQUE * (float) t->p->thickest);
            ray->mask[i] = PELL_RAY_ALL;
            if (++k.count == 16)
                trace(t, y, &k);
        }
    trace(t, y, &k);
}

/* --- The map --------------------------------------------------------------------------------------------------------------------- */

/* What the light sees of the body, in a square that just holds it; false where that shows nothing. */
static bool aim(const struct ts_tsm_params *p, struct pell_view *v)
{
    struct pell_vec3 low = { INFINITY, INFINITY, INFINITY }, high = { -INFINITY, -INFINITY, -INFINITY }, middle, way;
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
    *v = (struct pell_view){ .width = p->size, .height = p->size };
    if (!(radius > 0.0f && radius < 1e15f))
        return false;
    if (p->light->type == PELL_LIGHT_DIRECTIONAL) {
        v->orthographic = true;
        v->forward = vec3_normalize(vec3_load(p->light->direction));
        v->origin = vec3_mad(middle, -2.0f * radius, v->forward);
        v->focal_px = (float) p->size / (2.0f * radius);
    } else {
        way = vec3_sub(middle, vec3_load(p->light->position));
        distance = vec3_length(way);
        v->origin = vec3_load(p->light->position);
        v->forward = distance > 1e-6f * radius ? vec3_mul(way, 1.0f / distance) : vec3(0.0f, 0.0f, -1.0f);
        v->focal_px = 0.5f * (float) p->size / tanf(distance > radius ? fminf(asinf(radius / distance), WIDEST) : WIDEST);
    }
    vec3_basis(v->forward, &v->right, &v->up);
    return v->focal_px > 0.0f && isfinite(v->focal_px);
}

static void map_row(void *arg, int y, int worker)
{
    struct task *t = arg;
    const struct ts_atlas *a = t->p->atlas;
    _Alignas(64) int open[16];
    struct pell_ray_hit16 hit;

    (void) worker;
    for (int x = 0; x < t->view.width; x += 16) {
        memset(&hit, 0, sizeof(hit));
        for (int i = 0; i < 16; i++) {
            struct pell_vec3 start, direction;
            pell_view_ray(&t->view, (float) (x + i), (float) y, &start, &direction);
            open[i] = x + i < t->view.width ? -1 : 0;
            hit.ray.ox[i] = start.x;
            hit.ray.oy[i] = start.y;
            hit.ray.oz[i] = start.z;
            hit.ray.dx[i] = direction.x;
            hit.ray.dy[i] = direction.y;
            hit.ray.dz[i] = direction.z;
            hit.ray.tfar[i] = INFINITY;
            hit.ray.mask[i] = PELL_RAY_ALL;
            hit.hit.mesh[i] = PELL_NO_HIT;
        }
        pell_rays_closest16(pell_renderer_rays(t->p->r), open, true, &hit);
        for (int i = 0; i < 16 && x + i < t->view.width; i++) {
            const uint32_t mesh = hit.hit.mesh[i];
            struct map_texel *out = &t->map[(size_t) y * (size_t) t->view.width + (size_t) (x + i)];
            *out = (struct map_texel){ .triangle = UINT32_MAX };
            if (mesh < t->p->bodies->num_meshes && t->p->bodies->of_mesh[mesh] == t->p->body)
                *out = (struct map_texel){ a->first[mesh] + hit.hit.triangle[i], hit.hit.u[i], hit.hit.v[i] };
        }
    }
    atomic_fetch_add_explicit(&t->rays, t->view.width, memory_order_relaxed);
}

static void look_up_row(struct task *t, int y)
{
    const struct ts_atlas *a = t->p->atlas;
    const struct pell_view *v = &t->view;

    for (int r = a->first_run[y]; r < a->first_run[y + 1]; r++)
        for (int x = a->runs[r].from * TS_BLOCK; x < a->runs[r].to * TS_BLOCK; x++) {
            const ptrdiff_t at = y * a->stride + x;
            const struct map_texel *m;
            struct pell_vec3 light, to;
            struct spot s, other;
            float far, depth, px, py;
            bool is;
            t->alpha[at] = 0.0f;
            if (a->source[at] == UINT32_MAX)
                continue;
            s = spot_of(a, a->source[at], a->bary[0][at], a->bary[1][at]);
            light = toward(t->p->light, s.at, &far);
            if (vec3_dot(s.geometric, light) >= 0.0f)
                continue;
            to = vec3_sub(s.at, v->origin);
            depth = v->orthographic ? 1.0f : vec3_dot(to, v->forward);
            if (!(depth > 0.0f))
                continue;
            px = floorf(vec3_dot(to, v->right) / depth * v->focal_px + 0.5f * (float) v->width);
            py = floorf(0.5f * (float) v->height - vec3_dot(to, v->up) / depth * v->focal_px);
            if (!(px >= 0.0f && py >= 0.0f && px < (float) v->width && py < (float) v->height))
                continue;
            m = &t->map[(size_t) py * (size_t) v->width + (size_t) px];
            if (m->triangle == UINT32_MAX)
                continue;
            other = spot_of(a, m->triangle, m->u, m->v);
            /* What the light sees may be this surface itself, a pixel off. */
            if (vec3_dot(vec3_sub(other.at, s.at), light) < 1.5f * depth / v->focal_px)
                continue;
            pass_through(t, at, &s, m->triangle, m->u, m->v, light, &t->found[t->first[y] + t->count[y]], &is);
            t->count[y] += is;
        }
}

static void run_rows(void *arg, int band, int worker)
{
    struct task *t = arg;

    (void) worker;
    for (int y = band * ROWS; y < (band + 1) * ROWS && y < t->p->atlas->height; y++) {
        t->count[y] = 0;
        if (t->map)
            look_up_row(t, y);
        else
            ray_row(t, y);
    }
}

enum pell_result ts_tsm_make(const struct ts_tsm_params *params, float *alpha, struct ts_tsm *out, int64_t *rays)
{
    struct pell_context *ctx = pell_renderer_context(params->r);
    struct pell_pool *pool = pell_renderer_pool(params->r);
    const struct ts_atlas *a = params->atlas;
    struct task t = { .p = params, .alpha = alpha, .found = out->texels, .first = out->first, .count = out->count_of };

    out->count = 0;
    if (params->form == TS_TSM_MAP) {
        if (!aim(params, &t.view))
            return PELL_OK;
        t.map = out->map;
        pell_pool_run(pool, params->size, map_row, &t);
    }
    pell_pool_run(pool, (a->height + ROWS - 1) / ROWS, run_rows, &t);
    for (int y = 0; y < a->height; y++) {
        memmove(out->texels + out->count, out->texels + out->first[y], (size_t) out->count_of[y] * sizeof(*out->texels));
        out->count += (size_t) out->count_of[y];
    }
    *rays += atomic_load(&t.rays);
    return pell_cancelled(ctx) ? PELL_ERR_CANCELLED : PELL_OK;
}

enum pell_result ts_tsm_allocate(struct pell_context *ctx, const struct ts_atlas *const *atlases, size_t count, int map_size,
                                 struct ts_tsm *out)
{
    size_t most = 0, rows = 0;

    for (size_t i = 0; i < count; i++) {
        most = (size_t) atlases[i]->inner > most ? (size_t) atlases[i]->inner : most;
        rows = (size_t) atlases[i]->height > rows ? (size_t) atlases[i]->height : rows;
    }
    out->texels = pell_alloc_array(ctx, most + 1, sizeof(*out->texels));
    out->first = pell_calloc(ctx, rows + 1, sizeof(*out->first));
    out->count_of = pell_calloc(ctx, rows + 1, sizeof(*out->count_of));
    if (map_size > 0)
        out->map = pell_alloc_array(ctx, (size_t) map_size * (size_t) map_size, sizeof(struct map_texel));
    return out->texels && out->first && out->count_of && (map_size == 0 || out->map) ? PELL_OK : PELL_ERR_NOMEM;
}

void ts_tsm_start(const struct ts_atlas *a, struct ts_tsm *tsm)
{
    int count = 0;

    for (int y = 0; y < a->height; y++) {
        tsm->first[y] = count;
        for (int r = a->first_run[y]; r < a->first_run[y + 1]; r++)
            for (int x = a->runs[r].from * TS_BLOCK; x < a->runs[r].to * TS_BLOCK; x++)
                count += a->source[y * a->stride + x] != UINT32_MAX;
    }
}

void ts_tsm_finish(struct pell_context *ctx, struct ts_tsm *tsm)
{
    pell_free(ctx, tsm->texels);
    pell_free(ctx, tsm->first);
    pell_free(ctx, tsm->count_of);
    pell_free(ctx, tsm->map);
    memset(tsm, 0, sizeof(*tsm));
}
