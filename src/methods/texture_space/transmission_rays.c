/* SPDX-License-Identifier: MIT
 *
 * transmission_rays.c - rays from texels toward a light: the lit point where each ray leaves the solid, and second rays that improve the
 * result of texels known to receive transmitted light.
 */
#include "methods/texture_space/transmitted.h"

#include "visibility/light_grid.h"

#include <string.h>

enum { MAX_SEGMENTS = 16 };
#define MIN_EXIT_COSINE 0.95f /* below this cosine at the exit, a ray overestimates the distance to the face */
#define LIT_COSINE 0.15f      /* below this cosine to the light, a face counts as partly lit */
#define MAX_LENGTHENING 3.0f  /* bound on the lengthening of rays that continue from shadow */
#define MAX_THICKNESSES 4.0f  /* length of rays, relative to the thickness beyond which nothing is transmitted */

/* Starts the next segment of a ray just outside of a surface point, or just inside. */
static void start_segment(struct ts_packet *k, int i, const struct ts_shading_point *s, bool outside)
{
    struct pell_ray16 *ray = &k->rays.ray;
    const struct pell_vec3 from = vec3_mad(s->at, outside ? 3e-5f * s->max_coordinate : -(3e-5f * s->max_coordinate), s->geometric);

    ray->ox[i] = from.x;
    ray->oy[i] = from.y;
    ray->oz[i] = from.z;
    ray->dx[i] = k->light[i].x;
    ray->dy[i] = k->light[i].y;
    ray->dz[i] = k->light[i].z;
    ray->tnear[i] = 0.0f;
    ray->tfar[i] = k->remaining[i];
    ray->mask[i] = PELL_RAY_ALL;
}

/* Adds a ray of a texel; it starts inside of the solid, or outside if the face is toward the light. */
static void begin_ray(const struct ts_task *t, struct ts_packet *k, ptrdiff_t at, const struct ts_shading_point *s, struct pell_vec3 light,
                      float far)
{
    const bool outside = vec3_dot(s->geometric, light) > 0.0f; /* then d is the length of the ray itself: see ts_transmit */
    const int i = k->count++;

    k->at[i] = at;
    k->flat[i] = *s;
    k->light[i] = light;
    k->remaining[i] = fminf(far, (outside ? 1.0f : MAX_THICKNESSES) * (float) t->p->thickest);
    k->exit[i].triangle = UINT32_MAX;
    start_segment(k, i, s, outside);
}

/* Intersects rays to the light with the light grid. False: the grid has no answer, or rounds too much; trace rays instead. */
static bool query_light_grid(const struct ts_task *t, struct ts_packet *k)
{
    struct pell_ray16 *ray = &k->rays.ray;
    const struct pell_vec3 apex = vec3_load(t->p->light->position);
    float distance[16], tfar[16];
    bool known;

    if (!k->to_light || !t->p->grid)
        return false;
    for (int i = 0; i < 16; i++) {
        const struct pell_vec3 dir = vec3(apex.x - ray->ox[i], apex.y - ray->oy[i], apex.z - ray->oz[i]);
        distance[i] = sqrtf(vec3_dot(dir, dir));
        tfar[i] = ray->tfar[i];
        ray->tfar[i] = k->active[i] ? tfar[i] / distance[i] : 0.0f;
    }
    known = pell_light_grid_closest16(t->p->grid, k->active, &k->rays);
    for (int i = 0; i < 16; i++)
        ray->tfar[i] = known && k->rays.hit.mesh[i] != PELL_NO_HIT ? ray->tfar[i] * distance[i] : tfar[i];
    return known;
}

static bool is_lit(const struct ts_task *t, const struct ts_surface_point *p)
{
    const struct ts_bilinear location = ts_atlas_locate(t->p->atlas, p->triangle, p->u, p->v);
    float rgb[3];

    return ts_read(t->p->atlas, &location, t->lit, 3, rgb) && rgb[0] + rgb[1] + rgb[2] > 0.0f;
}

/* Traces each ray until it leaves the solid: at a lit point if the light is known, else for the first time. Rays blocked by another object
 * have no exit. */
static void trace_to_exit(struct ts_task *t, struct ts_packet *k)
{
    const struct ts_atlas *a = t->p->atlas;
    bool any = k->count > 0;
    int rays = 0;

    for (int i = 0; i < 16; i++)
        k->active[i] = i < k->count ? -1 : 0;
    for (int step = 0; any && step < MAX_SEGMENTS; step++) {
        any = false;
        for (int i = 0; i < 16; i++)
            k->rays.hit.mesh[i] = PELL_NO_HIT;
        if (!query_light_grid(t, k))
            pell_rays_closest16(t->p->services->rays, k->active, step == 0, &k->rays);
        for (int i = 0; i < k->count; i++) {
            const struct pell_vec3 face = vec3(k->rays.hit.ngx[i], k->rays.hit.ngy[i], k->rays.hit.ngz[i]);
            const uint32_t mesh = k->rays.hit.mesh[i];
            struct ts_surface_point hit;
            struct ts_shading_point s;
            bool is_exit;
            if (!k->active[i])
                continue;
            rays++;
            k->active[i] = 0;
            if (mesh == PELL_NO_HIT)
                continue;
            if (mesh >= t->p->solids->num_meshes || t->p->solids->of_mesh[mesh] != t->p->solid) {
                k->exit[i].triangle = UINT32_MAX;
                continue;
            }
            hit = (struct ts_surface_point) { a->first[mesh] + k->rays.hit.triangle[i], k->rays.hit.u[i], k->rays.hit.v[i] };
            is_exit = vec3_dot(face, k->light[i]) > 0.0f;
            if (is_exit)
                k->exit[i] = hit;
            k->remaining[i] -= k->rays.ray.tfar[i];
            if ((is_exit && (!t->lit || is_lit(t, &k->exit[i]))) || !(k->remaining[i] > 0.0f))
                continue;
            k->active[i] = -1;
            any = true;
            s = ts_flat_point(a, hit);
            start_segment(k, i, &s, is_exit);
        }
    }
    atomic_fetch_add_explicit(&t->rays, rays, memory_order_relaxed);
}

/* The texel that a lane's ray started from. */
static struct ts_shading_point shading_point_of_lane(const struct ts_task *t, const struct ts_packet *k, int lane)
{
    return ts_smooth_point(t->p->atlas, ts_point_at(t->p->atlas, k->at[lane]), k->flat[lane]);
}

void ts_trace(struct ts_task *t, int tile, struct ts_packet *k)
{
    trace_to_exit(t, k);
    for (int i = 0; i < k->count; i++) {
        struct ts_shading_point c;
        if (k->exit[i].triangle == UINT32_MAX)
            continue;
        c = shading_point_of_lane(t, k, i);
        t->count[tile] += ts_transmit(t, k->at[i], &c, k->exit[i], k->light[i], k->light[i], &t->found[t->first[tile] + t->count[tile]]);
    }
    k->count = 0;
}

void ts_ray_texels(struct ts_task *t, ptrdiff_t first, int tile, const uint8_t *texels, int count, struct ts_packet *k)
{
    const struct ts_atlas *a = t->p->atlas;

    for (int i = 0; i < count; i++) {
        const ptrdiff_t at = first + texels[i] / TS_BLOCK * a->stride + texels[i] % TS_BLOCK;
        struct pell_vec3 light;
        struct ts_shading_point s;
        float far;
        if (!ts_needs_ray(t, at))
            continue;
        s = ts_flat_point(a, ts_point_at(a, at));
        light = ts_toward(t->p->light, s.at, s.geometric, &far);
        begin_ray(t, k, at, &s, light, far);
        if (k->count == 16)
            ts_trace(t, tile, k);
    }
}

/* A second ray for some of the texels that are known to receive transmitted light. */
struct second_ray {
    bool (*applies)(const struct ts_task *t, const struct ts_transmitted_texel *c);
    struct pell_vec3 (*dir)(const struct ts_task *t, const struct ts_transmitted_texel *c, const struct ts_shading_point *s, float *far);
    void (*end)(struct ts_task *t, const struct ts_packet *k, int lane, struct ts_transmitted_texel *out);
    bool to_light;
};

static void trace_second_rays(struct ts_task *t, int chunk, const struct second_ray *second_ray)
{
    const struct ts_atlas *a = t->p->atlas;
    const size_t end = (size_t) (chunk + 1) * TS_CHUNK < t->known ? (size_t) (chunk + 1) * TS_CHUNK : t->known;
    struct ts_packet k;

    memset(&k, 0, sizeof(k));
    k.to_light = second_ray->to_light;
    for (size_t n = (size_t) chunk * TS_CHUNK;; n++) {
        const struct ts_transmitted_texel *c = n < end ? &t->found[n] : NULL;
        if (c && second_ray->applies(t, c)) {
            const struct ts_shading_point s = ts_flat_point(a, ts_point_at(a, c->at));
            float far;
            const struct pell_vec3 dir = second_ray->dir(t, c, &s, &far);
            k.known[k.count] = n;
            begin_ray(t, &k, c->at, &s, dir, far);
        }
        if (k.count == 16 || (!c && k.count > 0)) {
            trace_to_exit(t, &k);
            for (int i = 0; i < k.count; i++)
                second_ray->end(t, &k, i, &t->found[k.known[i]]);
            k.count = 0;
        }
        if (!c)
            return;
    }
}

/* Rays that end in shadow continue from there. */
static bool ends_in_shadow(const struct ts_task *t, const struct ts_transmitted_texel *c)
{
    float rgb[3];

    return !(ts_read(t->p->atlas, &c->from, t->lit, 3, rgb) && rgb[0] + rgb[1] + rgb[2] > 0.0f);
}

static struct pell_vec3 to_light(const struct ts_task *t, const struct ts_transmitted_texel *c, const struct ts_shading_point *s,
                                 float *far)
{
    (void) c;
    return ts_toward(t->p->light, s->at, s->geometric, far);
}

/* If no ray ends at a lit point, or only one that crosses a cavity, the first result stays: near the shadow boundary the blurred alpha is
 * that of the part between its faces, which would transmit light from far away. */
static void accept_lit_exit(struct ts_task *t, const struct ts_packet *k, int lane, struct ts_transmitted_texel *out)
{
    const struct ts_shading_point c = shading_point_of_lane(t, k, lane);
    const float alpha = t->alpha[out->at];
    struct ts_transmitted_texel other = *out;

    if (k->exit[lane].triangle == UINT32_MAX || !ts_transmit(t, k->at[lane], &c, k->exit[lane], k->light[lane], k->light[lane], &other))
        return;
    if (other.m < MAX_LENGTHENING * out->m)
        *out = other;
    else
        t->alpha[out->at] = alpha;
}

void ts_trace_beyond_shadow(void *arg, int chunk, int worker)
{
    static const struct second_ray further = { ends_in_shadow, to_light, accept_lit_exit, true };

    (void) worker;
    trace_second_rays(arg, chunk, &further);
}

/* A ray perpendicular to the nearest lit face measures its distance better than the ray toward the light. */
static bool hits_obliquely(const struct ts_task *t, const struct ts_transmitted_texel *c)
{
    return t->alpha[c->at] > 0.0f && c->cosine < MIN_EXIT_COSINE;
}

static struct pell_vec3 to_face(const struct ts_task *t, const struct ts_transmitted_texel *c, const struct ts_shading_point *s, float *far)
{
    (void) t;
    (void) s;
    *far = c->m;
    return c->normal;
}

/* The less the exit is lit, the larger the weight of the first result, for a smooth transition at the shadow boundary. */
static void accept_face_exit(struct ts_task *t, const struct ts_packet *k, int lane, struct ts_transmitted_texel *out)
{
    const float before = t->alpha[out->at];
    struct ts_transmitted_texel other = *out;
    struct pell_vec3 light;
    struct ts_shading_point c;
    float far, f;

    if (k->exit[lane].triangle == UINT32_MAX || !is_lit(t, &k->exit[lane]))
        return;
    c = shading_point_of_lane(t, k, lane);
    light = ts_toward(t->p->light, c.at, c.geometric, &far);
    if (!ts_transmit(t, k->at[lane], &c, k->exit[lane], k->light[lane], light, &other))
        return;
    f = fminf(fmaxf(vec3_dot(other.normal, light) * (1.0f / LIT_COSINE), 0.0f), 1.0f);
    f *= f * (3.0f - 2.0f * f);
    other.second = out->from;
    other.second_weight = 1.0f - f;
    other.m = out->m + f * (other.m - out->m);
    other.surface_distance = out->surface_distance + f * (other.surface_distance - out->surface_distance);
    other.opposed = out->opposed + f * (other.opposed - out->opposed);
    t->alpha[out->at] = before + f * (t->alpha[out->at] - before);
    *out = other;
}

void ts_trace_to_face(void *arg, int chunk, int worker)
{
    static const struct second_ray shorter = { hits_obliquely, to_face, accept_face_exit, false };

    (void) worker;
    trace_second_rays(arg, chunk, &shorter);
}
