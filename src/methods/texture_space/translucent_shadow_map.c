/* SPDX-License-Identifier: MIT
 *
 * translucent_shadow_map.c - for a light, where the light transmitted to each texel entered: by a map of what the light sees, the paper's
 * translucent shadow map, or by a ray toward the light.
 */
#include "methods/texture_space/texture_space.h"

#include "visibility/light_grid.h"

#include <stdatomic.h>
#include <string.h>

enum { CHUNK = 1024, FACES = 4096, PARTS_MOST = 16 };
#define WIDEST 1.2f   /* half the view of a light that stands among the objects */
#define AWAY 4.0f     /* a face is that of a slab in full where the light is 1/AWAY rad behind it */
#define ASKEW 0.95f   /* a way that meets a face at a smaller cosine is no measure of the distance from it */
#define GRAZING 0.15f /* a face that light meets at a smaller cosine is lit in part */
#define DARK 1e-4f    /* a normal whose cosine against the light is under -DARK faces away whatever rounding does */
#define OBLIQUE 4.0f  /* rays go this many times the thickness at which nothing is transmitted */

struct map_texel {
    uint32_t triangle; /* of the solid; UINT32_MAX: the light sees something else */
    float u, v;
};

struct task {
    const struct ts_tsm_params *p;
    float *alpha;
    const uint8_t *faces;
    struct ts_transmitted_texel *found; /* of TS_TILE rows at first[row / TS_TILE] */
    const int *first;                   /* per TS_TILE rows */
    int *count;
    const float *const *lit; /* what enters of this light alone; NULL: not known yet */
    size_t known;            /* texels that were found before it was */
    struct pell_view view;
    struct map_texel *map;
    _Atomic int64_t rays;
};

struct spot {
    struct pell_vec3 at, geometric, normal;
    float largest;
};

/* A point of a triangle, whose normal is the triangle's. */
static struct spot flat_spot(const struct ts_atlas *a, uint32_t t, float u, float v)
{
    struct spot s;

    ts_point_of(a, t, u, v, &s.at, &s.geometric, &s.largest);
    s.normal = s.geometric;
    return s;
}

/* The normal is the smooth one. */
static struct spot spot_of(const struct ts_atlas *a, uint32_t t, float u, float v)
{
    const struct pell_mesh *m = &a->scene->meshes[a->triangles[t].mesh];
    const uint32_t *index = m->index + 3 * (size_t) a->triangles[t].triangle;
    struct spot s = flat_spot(a, t, u, v);
    struct pell_vec3 n = { 0 };

    for (int k = 0; k < 3; k++)
        n = vec3_mad(n, k == 0 ? 1.0f - u - v : k == 1 ? u : v, vec3_load(m->normal + 3 * (size_t) index[k]));
    if (vec3_dot(n, s.geometric) > 0.0f)
        s.normal = vec3_normalize(n);
    return s;
}

static struct spot spot_at(const struct ts_atlas *a, ptrdiff_t at)
{
    return spot_of(a, a->source[at], a->bary[0][at], a->bary[1][at]);
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

struct faces {
    const struct ts_tsm_params *p;
    uint8_t *out;
};

/* For a triangle in a plane the light is behind all of it or none. */
static uint8_t face(const struct ts_tsm_params *p, uint32_t t)
{
    const struct ts_atlas *a = p->atlas;
    const struct pell_mesh *m = &a->scene->meshes[a->triangles[t].mesh];
    const uint32_t *index = m->index + 3 * (size_t) a->triangles[t].triangle;
    const enum pell_light_type type = p->light->type;
    struct pell_vec3 at[3], light[3], n;
    float far[3];

    for (int k = 0; k < 3; k++) {
        at[k] = vec3_load(m->position + 3 * (size_t) index[k]);
        light[k] = toward(p->light, at[k], &far[k]);
    }
    n = vec3_cross(vec3_sub(at[1], at[0]), vec3_sub(at[2], at[0]));
    if (!(vec3_dot(n, light[0]) < 0.0f))
        return 0;
    /* Wherever in the triangle: the interpolated normal against any of the ways. */
    if (type == PELL_LIGHT_RECT || type == PELL_LIGHT_DISC || a->scene->materials[m->material].normal_map.texture)
        return TS_FACE_AWAY;
    for (int i = 0; i < 3; i++) {
        const struct pell_vec3 normal = vec3_load(m->normal + 3 * (size_t) index[i]);
        if (!(vec3_dot(normal, n) > 0.0f))
            return TS_FACE_AWAY;
        for (int k = 0; k < 3; k++)
            if (!(vec3_dot(normal, light[k]) < -DARK * vec3_length(normal)))
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

/* Thickness between two faces m apart, seen from C along the unit way. */
static float thickness_of(const struct task *t, const struct spot *a, const struct spot *c, struct pell_vec3 way, float m, float *opposed)
{
    const float away = fmaxf(-vec3_dot(c->normal, way), 0.0f);

    *opposed = fmaxf(0.0f, -vec3_dot(a->normal, c->normal));
    if (t->p->printed) /* section 5.2: m lerped to m cos by the normals' cosine */
        return m + *opposed * (m * away - m);
    /* Two faces of a slab look opposite ways, one at the light and one away from it. */
    *opposed *= fminf(away * AWAY, 1.0f);
    /* On a slab both cosines are the same; on an edge the flatter face tells less of the thickness. */
    return m + *opposed * (m * fminf(fmaxf(away, vec3_dot(a->normal, way)), 1.0f) - m);
}

/* Light that enters at A, seen from texel C along the unit `way`: its thickness and what else the blurs ask. */
static void pass_through(const struct task *t, ptrdiff_t at, const struct spot *c, uint32_t triangle, float u, float v,
                         struct pell_vec3 way, struct pell_vec3 light, struct ts_transmitted_texel *out, bool *is)
{
    const struct ts_atlas *a = t->p->atlas;
    const struct spot s = spot_of(a, triangle, u, v);
    const float m = vec3_length(vec3_sub(s.at, c->at));
    float opposed;
    const float d = thickness_of(t, &s, c, way, m, &opposed);

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
        const float along = (dx + 0.5f * (a->skew[at] + a->skew[there]) * dy) * lx;
        out->apart = sqrtf(along * along + dy * ly * dy * ly);
        out->round = true;
    } else {
        out->apart = m;
        out->round = false;
    }
    out->part = 0.0f;
    out->opposed = opposed;
    out->normal = s.normal;
    out->cosine = vec3_dot(s.normal, way);
    out->m = m;
    t->alpha[at] = expf(-d / (float) t->p->falloff);
    *is = true;
}

/* --- Rays ------------------------------------------------------------------------------------------------------------------------ */

/* Ways from texels to the light, 16 at a time. */
struct packet {
    _Alignas(64) int open[16];
    struct pell_ray_hit16 rays;
    struct pell_vec3 light[16];
    float left[16]; /* mm to go at most */
    bool to_light;
    ptrdiff_t at[16];
    uint32_t triangle[16]; /* where the way has left the solid; UINT32_MAX: nowhere yet */
    float u[16], v[16];
    size_t known[16]; /* a way that goes on: which of the list it is */
    int count;
};

/* The next part of a way begins just outside of a point of the surface, or just inside. */
static void set_out(struct packet *k, int i, const struct spot *s, bool outside)
{
    struct pell_ray16 *ray = &k->rays.ray;
    const struct pell_vec3 from = vec3_mad(s->at, outside ? 3e-5f * s->largest : -(3e-5f * s->largest), s->geometric);

    ray->ox[i] = from.x;
    ray->oy[i] = from.y;
    ray->oz[i] = from.z;
    ray->dx[i] = k->light[i].x;
    ray->dy[i] = k->light[i].y;
    ray->dz[i] = k->light[i].z;
    ray->tnear[i] = 0.0f;
    ray->tfar[i] = k->left[i];
    ray->mask[i] = PELL_RAY_ALL;
}

/* A way of a texel that is about to go inside, or that is outside. */
static void begin(const struct task *t, struct packet *k, ptrdiff_t at, const struct spot *s, struct pell_vec3 light, float far)
{
    const bool outside = vec3_dot(s->geometric, light) > 0.0f; /* where d is the way itself: see pass_through */
    const int i = k->count++;

    k->at[i] = at;
    k->light[i] = light;
    k->left[i] = fminf(far, (outside ? 1.0f : OBLIQUE) * (float) t->p->thickest);
    k->triangle[i] = UINT32_MAX;
    set_out(k, i, s, outside);
}

/* What the light grid says of ways to the light. False: it doesn't know, or rounds too much: ask the rays. */
static bool ask_grid(const struct task *t, struct packet *k)
{
    struct pell_ray16 *ray = &k->rays.ray;
    const struct pell_vec3 apex = vec3_load(t->p->light->position);
    float whole[16], tfar[16];
    bool known;

    if (!k->to_light || !t->p->grid)
        return false;
    for (int i = 0; i < 16; i++) {
        const struct pell_vec3 way = vec3(apex.x - ray->ox[i], apex.y - ray->oy[i], apex.z - ray->oz[i]);
        whole[i] = sqrtf(vec3_dot(way, way));
        tfar[i] = ray->tfar[i];
        ray->tfar[i] = k->open[i] ? tfar[i] / whole[i] : 0.0f;
    }
    known = pell_light_grid_closest16(t->p->grid, k->open, &k->rays);
    for (int i = 0; i < 16; i++)
        ray->tfar[i] = known && k->rays.hit.mesh[i] != PELL_NO_HIT ? ray->tfar[i] * whole[i] : tfar[i];
    return known;
}

static bool is_lit(const struct task *t, uint32_t triangle, float u, float v)
{
    const struct ts_place place = ts_atlas_place(t->p->atlas, triangle, u, v);
    float rgb[3];

    return ts_read(t->p->atlas, &place, t->lit, 3, rgb) && rgb[0] + rgb[1] + rgb[2] > 0.0f;
}

/* Follows the ways, each to where it leaves the solid: for good or into light where the light is known, else for the first time. Those that
 * another object is in end nowhere. */
static void follow(struct task *t, struct packet *k)
{
    const struct ts_atlas *a = t->p->atlas;
    bool any = k->count > 0;
    int rays = 0;

    for (int i = 0; i < 16; i++)
        k->open[i] = i < k->count ? -1 : 0;
    for (int step = 0; any && step < PARTS_MOST; step++) {
        any = false;
        for (int i = 0; i < 16; i++)
            k->rays.hit.mesh[i] = PELL_NO_HIT;
        if (!ask_grid(t, k))
            pell_rays_closest16(t->p->services->rays, k->open, step == 0, &k->rays);
        for (int i = 0; i < k->count; i++) {
            const uint32_t mesh = k->rays.hit.mesh[i];
            struct spot s;
            uint32_t triangle;
            bool leaves;
            if (!k->open[i])
                continue;
            rays++;
            k->open[i] = 0;
            if (mesh == PELL_NO_HIT)
                continue;
            if (mesh >= t->p->solids->num_meshes || t->p->solids->of_mesh[mesh] != t->p->solid) {
                k->triangle[i] = UINT32_MAX;
                continue;
            }
            triangle = a->first[mesh] + k->rays.hit.triangle[i];
            s = flat_spot(a, triangle, k->rays.hit.u[i], k->rays.hit.v[i]);
            leaves = vec3_dot(s.geometric, k->light[i]) > 0.0f;
            if (leaves) {
                k->triangle[i] = triangle;
                k->u[i] = k->rays.hit.u[i];
                k->v[i] = k->rays.hit.v[i];
            }
            k->left[i] -= k->rays.ray.tfar[i];
            if ((leaves && (!t->lit || is_lit(t, triangle, k->u[i], k->v[i]))) || !(k->left[i] > 0.0f))
                continue;
            k->open[i] = -1;
            any = true;
            set_out(k, i, &s, leaves);
        }
    }
    atomic_fetch_add_explicit(&t->rays, rays, memory_order_relaxed);
}

static void trace(struct task *t, int tile, struct packet *k)
{
    follow(t, k);
    for (int i = 0; i < k->count; i++) {
        struct spot c;
        bool is;
        if (k->triangle[i] == UINT32_MAX)
            continue;
        c = spot_at(t->p->atlas, k->at[i]);
        pass_through(t, k->at[i], &c, k->triangle[i], k->u[i], k->v[i], k->light[i], k->light[i],
                     &t->found[t->first[tile] + t->count[tile]], &is);
        t->count[tile] += is;
    }
    k->count = 0;
}

/* Texels that face away from the light; with the light known those that face it in the dark, which are among all where it will not be. */
static bool asks(const struct task *t, ptrdiff_t at)
{
    const bool away = t->faces[t->p->atlas->source[at]] & TS_FACE_AWAY;

    return t->p->at_once ? true : t->lit ? !away && !(t->lit[0][at] + t->lit[1][at] + t->lit[2][at] > 0.0f) : away;
}

static void ray_texels(struct task *t, ptrdiff_t first, int tile, const uint8_t *texels, int count, struct packet *k)
{
    const struct ts_atlas *a = t->p->atlas;

    for (int i = 0; i < count; i++) {
        const ptrdiff_t at = first + texels[i] / TS_BLOCK * a->stride + texels[i] % TS_BLOCK;
        struct pell_vec3 light;
        struct spot s;
        float far;
        if (!asks(t, at))
            continue;
        s = flat_spot(a, a->source[at], a->bary[0][at], a->bary[1][at]);
        light = toward(t->p->light, s.at, &far);
        begin(t, k, at, &s, light, far);
        if (k->count == 16)
            trace(t, tile, k);
    }
}

/* A second ray of some texels that are known to have transmitted light. */
struct second {
    bool (*wants)(const struct task *t, const struct ts_transmitted_texel *c);
    struct pell_vec3 (*way)(const struct task *t, const struct ts_transmitted_texel *c, const struct spot *s, float *far);
    void (*end)(struct task *t, const struct packet *k, int lane, struct ts_transmitted_texel *out);
    bool to_light;
};

static void ask_again(struct task *t, int chunk, const struct second *second)
{
    const struct ts_atlas *a = t->p->atlas;
    const size_t end = (size_t) (chunk + 1) * CHUNK < t->known ? (size_t) (chunk + 1) * CHUNK : t->known;
    struct packet k;

    memset(&k, 0, sizeof(k));
    k.to_light = second->to_light;
    for (size_t n = (size_t) chunk * CHUNK;; n++) {
        const struct ts_transmitted_texel *c = n < end ? &t->found[n] : NULL;
        if (c && second->wants(t, c)) {
            const struct spot s = flat_spot(a, a->source[c->at], a->bary[0][c->at], a->bary[1][c->at]);
            float far;
            const struct pell_vec3 way = second->way(t, c, &s, &far);
            k.known[k.count] = n;
            begin(t, &k, c->at, &s, way, far);
        }
        if (k.count == 16 || (!c && k.count > 0)) {
            follow(t, &k);
            for (int i = 0; i < k.count; i++)
                second->end(t, &k, i, &t->found[k.known[i]]);
            k.count = 0;
        }
        if (!c)
            return;
    }
}

/* Ways whose end is in the dark go on from there. */
static bool ends_in_the_dark(const struct task *t, const struct ts_transmitted_texel *c)
{
    float rgb[3];

    return !(ts_read(t->p->atlas, &c->from, t->lit, 3, rgb) && rgb[0] + rgb[1] + rgb[2] > 0.0f);
}

static struct pell_vec3 to_light(const struct task *t, const struct ts_transmitted_texel *c, const struct spot *s, float *far)
{
    (void) c;
    return toward(t->p->light, s->at, far);
}

static void end_in_light(struct task *t, const struct packet *k, int lane, struct ts_transmitted_texel *out)
{
    const struct spot c = spot_at(t->p->atlas, k->at[lane]);
    bool is = false;

    if (k->triangle[lane] != UINT32_MAX)
        pass_through(t, k->at[lane], &c, k->triangle[lane], k->u[lane], k->v[lane], k->light[lane], k->light[lane], out, &is);
    if (is)
        return;
    t->alpha[k->at[lane]] = 0.0f;
    out->at = (int32_t) k->at[lane];
}

static void go_on(void *arg, int chunk, int worker)
{
    static const struct second further = { ends_in_the_dark, to_light, end_in_light, true };

    (void) worker;
    ask_again(arg, chunk, &further);
}

/* What the light's way tells of the nearest face that is lit, a way at right angles to that face tells better. */
static bool meets_askew(const struct task *t, const struct ts_transmitted_texel *c)
{
    return t->alpha[c->at] > 0.0f && c->cosine < ASKEW;
}

static struct pell_vec3 to_face(const struct task *t, const struct ts_transmitted_texel *c, const struct spot *s, float *far)
{
    (void) t;
    (void) s;
    *far = c->m;
    return c->normal;
}

/* The less that end is lit the more the first one counts: at the edge of the light one goes over into the other. */
static void end_at_face(struct task *t, const struct packet *k, int lane, struct ts_transmitted_texel *out)
{
    const float before = t->alpha[out->at];
    struct ts_transmitted_texel other = *out;
    struct pell_vec3 light;
    struct spot c;
    float far, f;
    bool is;

    if (k->triangle[lane] == UINT32_MAX || !is_lit(t, k->triangle[lane], k->u[lane], k->v[lane]))
        return;
    c = spot_at(t->p->atlas, k->at[lane]);
    light = toward(t->p->light, c.at, &far);
    pass_through(t, k->at[lane], &c, k->triangle[lane], k->u[lane], k->v[lane], k->light[lane], light, &other, &is);
    if (!is)
        return;
    f = fminf(fmaxf(vec3_dot(other.normal, light) * (1.0f / GRAZING), 0.0f), 1.0f);
    f *= f * (3.0f - 2.0f * f);
    other.also = out->from;
    other.part = 1.0f - f;
    other.m = out->m + f * (other.m - out->m);
    other.apart = out->apart + f * (other.apart - out->apart);
    other.opposed = out->opposed + f * (other.opposed - out->opposed);
    t->alpha[out->at] = before + f * (t->alpha[out->at] - before);
    *out = other;
}

static void approach(void *arg, int chunk, int worker)
{
    static const struct second shorter = { meets_askew, to_face, end_at_face, false };

    (void) worker;
    ask_again(arg, chunk, &shorter);
}

/* --- The map --------------------------------------------------------------------------------------------------------------------- */

/* What the light sees of the solid, in a square that just holds it; false where that shows nothing. */
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
    *v = (struct pell_view) { .width = p->size, .height = p->size };
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
            pell_ray16_set(&hit.ray, i, start, direction, INFINITY);
            hit.hit.mesh[i] = PELL_NO_HIT;
        }
        pell_rays_closest16(t->p->services->rays, open, true, &hit);
        for (int i = 0; i < 16 && x + i < t->view.width; i++) {
            const uint32_t mesh = hit.hit.mesh[i];
            struct map_texel *out = &t->map[(size_t) y * (size_t) t->view.width + (size_t) (x + i)];
            *out = (struct map_texel) { .triangle = UINT32_MAX };
            if (mesh < t->p->solids->num_meshes && t->p->solids->of_mesh[mesh] == t->p->solid)
                *out = (struct map_texel) { a->first[mesh] + hit.hit.triangle[i], hit.hit.u[i], hit.hit.v[i] };
        }
    }
    atomic_fetch_add_explicit(&t->rays, t->view.width, memory_order_relaxed);
}

static void look_up(struct task *t, ptrdiff_t at, int tile)
{
    const struct pell_view *v = &t->view;
    const struct spot s = spot_at(t->p->atlas, at);
    const struct pell_vec3 to = vec3_sub(s.at, v->origin);
    const float depth = v->orthographic ? 1.0f : vec3_dot(to, v->forward);
    const struct map_texel *m;
    struct pell_vec3 light;
    struct spot other;
    float far, px, py;
    bool is;

    if (!(depth > 0.0f))
        return;
    px = floorf(vec3_dot(to, v->right) / depth * v->focal_px + 0.5f * (float) v->width);
    py = floorf(0.5f * (float) v->height - vec3_dot(to, v->up) / depth * v->focal_px);
    if (!(px >= 0.0f && py >= 0.0f && px < (float) v->width && py < (float) v->height))
        return;
    m = &t->map[(size_t) py * (size_t) v->width + (size_t) px];
    if (m->triangle == UINT32_MAX)
        return;
    light = toward(t->p->light, s.at, &far);
    other = spot_of(t->p->atlas, m->triangle, m->u, m->v);
    /* What the light sees may be this surface itself, a pixel off. */
    if (vec3_dot(vec3_sub(other.at, s.at), light) < 1.5f * depth / v->focal_px)
        return;
    pass_through(t, at, &s, m->triangle, m->u, m->v, light, light, &t->found[t->first[tile] + t->count[tile]], &is);
    t->count[tile] += is;
}

static void run_tile(void *arg, int tile, int worker)
{
    struct task *t = arg;
    const struct ts_atlas *a = t->p->atlas;
    uint8_t texels[TS_TILE * TS_BLOCK];
    struct packet k;

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
            if (asks(t, at))
                look_up(t, at, tile);
        }
        if (!t->map)
            ray_texels(t, first, tile, texels, count, &k);
    }
    trace(t, tile, &k);
}

/* Puts what tiles have found behind the `kept` texels of the list. */
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
    struct task t = { .p = params, .alpha = alpha, .faces = out->faces, .found = out->texels, .first = out->first, .count = out->count_of };
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
    struct task t = {
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
        pell_pool_run(pool, (int) ((known + CHUNK - 1) / CHUNK), go_on, &t);
    }
    /* No texel is found twice: behind those of the list is room for all others. */
    for (int y = 0; y < tiles; y++) {
        out->first[y] = first;
        first += out->num[y] - out->count_of[y];
    }
    pell_pool_run(pool, tiles, run_tile, &t);
    gather_found(out, tiles, known);
    t.known = out->count;
    if (params->form == TS_TSM_RAY)
        pell_pool_run(pool, (int) ((t.known + CHUNK - 1) / CHUNK), approach, &t);
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
        out->map = pell_alloc_array(ctx, (size_t) map_size * (size_t) map_size, sizeof(struct map_texel));
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
