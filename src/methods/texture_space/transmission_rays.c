/* SPDX-License-Identifier: MIT
 *
 * transmission_rays.c - rays from texels toward a light: the lit point where each ray leaves the solid, and second rays that improve the
 * result of texels known to receive transmitted light.
 */
#include "methods/texture_space/transmitted.h"

#include "visibility/light_grid.h"

#include <string.h>

enum { PARTS_MOST = 16 };
#define ASKEW 0.95f   /* below this cosine at the exit, a ray overestimates the distance to the face */
#define GRAZING 0.15f /* below this cosine to the light, a face counts as partly lit */
#define FARTHER 3.0f  /* bound on the lengthening of rays that continue from shadow */
#define OBLIQUE 4.0f  /* length of rays, relative to the thickness beyond which nothing is transmitted */

/* Starts the next segment of a ray just outside of a surface point, or just inside. */
static void set_out(struct ts_packet *k, int i, const struct ts_spot *s, bool outside)
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

/* Adds a ray of a texel; it starts inside of the solid, or outside if the face is toward the light. */
static void begin(const struct ts_task *t, struct ts_packet *k, ptrdiff_t at, const struct ts_spot *s, struct pell_vec3 light, float far)
{
    const bool outside = vec3_dot(s->geometric, light) > 0.0f; /* then d is the length of the ray itself: see ts_transmit */
    const int i = k->count++;

    k->at[i] = at;
    k->flat[i] = *s;
    k->light[i] = light;
    k->left[i] = fminf(far, (outside ? 1.0f : OBLIQUE) * (float) t->p->thickest);
    k->exit[i].triangle = UINT32_MAX;
    set_out(k, i, s, outside);
}

/* Intersects rays to the light with the light grid. False: the grid has no answer, or rounds too much; trace rays instead. */
static bool ask_grid(const struct ts_task *t, struct ts_packet *k)
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

static bool is_lit(const struct ts_task *t, const struct ts_surface_point *p)
{
    const struct ts_place place = ts_atlas_place(t->p->atlas, p->triangle, p->u, p->v);
    float rgb[3];

    return ts_read(t->p->atlas, &place, t->lit, 3, rgb) && rgb[0] + rgb[1] + rgb[2] > 0.0f;
}

/* Traces each ray until it leaves the solid: at a lit point if the light is known, else for the first time. Rays blocked by another object
 * have no exit. */
static void follow(struct ts_task *t, struct ts_packet *k)
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
            const struct pell_vec3 face = vec3(k->rays.hit.ngx[i], k->rays.hit.ngy[i], k->rays.hit.ngz[i]);
            const uint32_t mesh = k->rays.hit.mesh[i];
            struct ts_surface_point hit;
            struct ts_spot s;
            bool leaves;
            if (!k->open[i])
                continue;
            rays++;
            k->open[i] = 0;
            if (mesh == PELL_NO_HIT)
                continue;
            if (mesh >= t->p->solids->num_meshes || t->p->solids->of_mesh[mesh] != t->p->solid) {
                k->exit[i].triangle = UINT32_MAX;
                continue;
            }
            hit = (struct ts_surface_point) { a->first[mesh] + k->rays.hit.triangle[i], k->rays.hit.u[i], k->rays.hit.v[i] };
            leaves = vec3_dot(face, k->light[i]) > 0.0f;
            if (leaves)
                k->exit[i] = hit;
            k->left[i] -= k->rays.ray.tfar[i];
            if ((leaves && (!t->lit || is_lit(t, &k->exit[i]))) || !(k->left[i] > 0.0f))
                continue;
            k->open[i] = -1;
            any = true;
            s = ts_flat_spot(a, hit);
            set_out(k, i, &s, leaves);
        }
    }
    atomic_fetch_add_explicit(&t->rays, rays, memory_order_relaxed);
}

/* The texel that a lane's ray started from. */
static struct ts_spot spot_of_lane(const struct ts_task *t, const struct ts_packet *k, int lane)
{
    return ts_smooth_spot(t->p->atlas, ts_point_at(t->p->atlas, k->at[lane]), k->flat[lane]);
}

void ts_trace(struct ts_task *t, int tile, struct ts_packet *k)
{
    follow(t, k);
    for (int i = 0; i < k->count; i++) {
        struct ts_spot c;
        if (k->exit[i].triangle == UINT32_MAX)
            continue;
        c = spot_of_lane(t, k, i);
        t->count[tile] +=
            ts_pass_through(t, k->at[i], &c, k->exit[i], k->light[i], k->light[i], &t->found[t->first[tile] + t->count[tile]]);
    }
    k->count = 0;
}

void ts_ray_texels(struct ts_task *t, ptrdiff_t first, int tile, const uint8_t *texels, int count, struct ts_packet *k)
{
    const struct ts_atlas *a = t->p->atlas;

    for (int i = 0; i < count; i++) {
        const ptrdiff_t at = first + texels[i] / TS_BLOCK * a->stride + texels[i] % TS_BLOCK;
        struct pell_vec3 light;
        struct ts_spot s;
        float far;
        if (!ts_asks(t, at))
            continue;
        s = ts_flat_spot(a, ts_point_at(a, at));
        light = ts_toward(t->p->light, s.at, s.geometric, &far);
        begin(t, k, at, &s, light, far);
        if (k->count == 16)
            ts_trace(t, tile, k);
    }
}

/* A second ray for some of the texels that are known to receive transmitted light. */
struct second {
    bool (*wants)(const struct ts_task *t, const struct ts_transmitted_texel *c);
    struct pell_vec3 (*way)(const struct ts_task *t, const struct ts_transmitted_texel *c, const struct ts_spot *s, float *far);
    void (*end)(struct ts_task *t, const struct ts_packet *k, int lane, struct ts_transmitted_texel *out);
    bool to_light;
};

static void ask_again(struct ts_task *t, int chunk, const struct second *second)
{
    const struct ts_atlas *a = t->p->atlas;
    const size_t end = (size_t) (chunk + 1) * TS_CHUNK < t->known ? (size_t) (chunk + 1) * TS_CHUNK : t->known;
    struct ts_packet k;

    memset(&k, 0, sizeof(k));
    k.to_light = second->to_light;
    for (size_t n = (size_t) chunk * TS_CHUNK;; n++) {
        const struct ts_transmitted_texel *c = n < end ? &t->found[n] : NULL;
        if (c && second->wants(t, c)) {
            const struct ts_spot s = ts_flat_spot(a, ts_point_at(a, c->at));
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

/* Rays that end in shadow continue from there. */
static bool ends_in_the_dark(const struct ts_task *t, const struct ts_transmitted_texel *c)
{
    float rgb[3];

    return !(ts_read(t->p->atlas, &c->from, t->lit, 3, rgb) && rgb[0] + rgb[1] + rgb[2] > 0.0f);
}

static struct pell_vec3 to_light(const struct ts_task *t, const struct ts_transmitted_texel *c, const struct ts_spot *s, float *far)
{
    (void) c;
    return ts_toward(t->p->light, s->at, s->geometric, far);
}

/* If no ray ends at a lit point, or only one that crosses a cavity, the first result stays: near the shadow boundary the blurred alpha is
 * that of the part between its faces, which would transmit light from far away. */
static void end_in_light(struct ts_task *t, const struct ts_packet *k, int lane, struct ts_transmitted_texel *out)
{
    const struct ts_spot c = spot_of_lane(t, k, lane);
    const float alpha = t->alpha[out->at];
    struct ts_transmitted_texel other = *out;

    if (k->exit[lane].triangle == UINT32_MAX || !ts_pass_through(t, k->at[lane], &c, k->exit[lane], k->light[lane], k->light[lane], &other))
        return;
    if (other.m < FARTHER * out->m)
        *out = other;
    else
        t->alpha[out->at] = alpha;
}

void ts_go_on(void *arg, int chunk, int worker)
{
    static const struct second further = { ends_in_the_dark, to_light, end_in_light, true };

    (void) worker;
    ask_again(arg, chunk, &further);
}

/* A ray perpendicular to the nearest lit face measures its distance better than the ray toward the light. */
static bool meets_askew(const struct ts_task *t, const struct ts_transmitted_texel *c)
{
    return t->alpha[c->at] > 0.0f && c->cosine < ASKEW;
}

static struct pell_vec3 to_face(const struct ts_task *t, const struct ts_transmitted_texel *c, const struct ts_spot *s, float *far)
{
    (void) t;
    (void) s;
    *far = c->m;
    return c->normal;
}

/* The less the exit is lit, the larger the weight of the first result, for a smooth transition at the shadow boundary. */
static void end_at_face(struct ts_task *t, const struct ts_packet *k, int lane, struct ts_transmitted_texel *out)
{
    const float before = t->alpha[out->at];
    struct ts_transmitted_texel other = *out;
    struct pell_vec3 light;
    struct ts_spot c;
    float far, f;

    if (k->exit[lane].triangle == UINT32_MAX || !is_lit(t, &k->exit[lane]))
        return;
    c = spot_of_lane(t, k, lane);
    light = ts_toward(t->p->light, c.at, c.geometric, &far);
    if (!ts_pass_through(t, k->at[lane], &c, k->exit[lane], k->light[lane], light, &other))
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

void ts_approach(void *arg, int chunk, int worker)
{
    static const struct second shorter = { meets_askew, to_face, end_at_face, false };

    (void) worker;
    ask_again(arg, chunk, &shorter);
}
