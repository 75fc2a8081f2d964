/* SPDX-License-Identifier: MIT
 * light_path.c - paths from delta lights through smooth boundaries, connected to camera paths inside media (bidirectional path tracing;
 * Veach and Guibas 1994, Lafortune and Willems 1996), for the light that no refractive connection finds: light that was reflected inside,
 * or crossed more than one surface, before it first scattered.
 *
 * Each path has exactly one technique that finds it, determined by its form, so no MIS weights are needed. Counted from the light, the
 * first edge between two scattering events with no surface on it is where the light path is connected to the camera path; paths whose light
 * entered by a single refraction and then scattered belong to the refractive connections. A light path therefore ends where it would
 * continue without a surface, and there is one connection per path. What neither technique finds has a smooth surface on every edge (a
 * rough one ends a light path): specular_manifold.c.
 *
 * At the first surfaces from the light a path is split into its transmitted and reflected part; if reflected light hits other surfaces, as
 * in folds, additional light rays are traced for it alone (pt_scene.light_rays). With random selection 1 path in 25 would be reflected,
 * with all of its light: such a path near a camera path would be a firefly.
 *
 * Light is carried as flux. With interpolated normals a surface transmits a different flux than the camera path's radiance implies; the
 * ratio of cosines makes both agree (Veach 1996, "Non-symmetric Scattering in Light Transport Algorithms"). */
#include "methods/path_trace/path.h"

#include <string.h>

#define MAX_LIGHT_EVENTS 64 /* upper bound per light path; by then the throughput is about 1e-30 in solids that absorb or scatter at all */
#define MAX_PENDING 4       /* stack of reflected paths that still have to be traced */
#define ROULETTE_FRACTION 1e-2 /* relative throughput below which Russian roulette starts */
#define JOIN_FRACTION 1e-2     /* relative to the typical radiance: weaker connections are subject to Russian roulette */

/* State of a path. */
struct light_path {
    struct pt_medium_stack stack;
    struct pt_ray ray;
    float power[3], safe;
    int events, bounces;
    int surfaces; /* number since the light, or the last scattering event */
    bool first, entered_once, scattered;
    bool mirrored; /* only light reflected by surfaces before its first scattering event counts */
};

/* The pending paths of one light ray. */
struct light_paths {
    int count;
    struct light_path path[MAX_PENDING + 1];
};

static void store_vertex(struct pt_walker *w, const struct pt_scatterer *at, const float power[3], float length, int solid)
{
    struct pt_light_vertex *v;

    if (w->vertices >= PT_LIGHT_VERTICES)
        return;
    v = &w->vertex[w->vertices++];
    *v = (struct pt_light_vertex) { *at, length, solid };
    memcpy(v->at.beta, power, sizeof(v->at.beta));
}

/* Refracts or reflects at a smooth surface by the random number u. False: the path ends. *fresnel: probability of reflection. */
static bool surface(const struct pt_scene *s, const struct pt_hit *hit, float u, struct light_path *p, bool *refracted, float *fresnel)
{
    struct pt_ray *ray = &p->ray;
    const bool enter = vec3_dot(ray->w, hit->ng) < 0.0f;
    const float side = enter ? 1.0f : -1.0f;
    struct pt_shading_frame at = { vec3_mul(ray->w, -1.0f), vec3_mul(hit->ns, side), vec3_mul(hit->ng, side), enter ? 0 : 1 };
    struct pt_medium_stack before, after;
    float eta, in, out, ratio;
    bool wrong;

    *refracted = false;
    *fresnel = 0.0f;
    if (!pt_cross(s, &p->stack, hit->solid, enter, &before, &after)) {
        ray->x = hit->p;
        ray->from = pt_offset_origin(hit, ray->w);
        return true;
    }
    eta = pt_index(s, pt_top(&after)) / pt_index(s, pt_top(&before));
    if (pt_rough_find(s, hit, enter ? eta : 1.0f / eta))
        return false;
    if (!(vec3_dot(at.o, at.ns) > 0.0f))
        at.ns = at.ng;
    in = vec3_dot(at.o, at.ns) / vec3_dot(at.o, at.ng);
    *refracted = pt_smooth(&at, eta, u, &ray->w, fresnel, &wrong);
    if (wrong)
        return false;
    out = fabsf(vec3_dot(ray->w, at.ng)) / fmaxf(fabsf(vec3_dot(ray->w, at.ns)), 1e-6f);
    ratio = in * out;
    for (int c = 0; c < 3; c++)
        p->power[c] *= ratio;
    if (*refracted)
        pt_tint(s, hit, enter, p->power);
    p->stack = *refracted ? after : before;
    ray->x = hit->p;
    ray->from = pt_offset_origin(hit, ray->w);
    return true;
}

/* Reflects or refracts at random; light from outside that has not scattered continues with its transmitted part, and the reflected one is
 * pushed. */
static bool interact(const struct pt_scene *s, const struct pt_hit *hit, struct light_path *p, struct light_paths *others,
                     struct pt_sampler *sampler)
{
    const bool both = p->stack.count == 0 && !p->scattered && others->count < MAX_PENDING;
    const int surfaces = p->surfaces++;
    struct light_path other = *p;
    const float fraction = surfaces == 0 && p->bounces == 0 ? 1.0f / (float) s->light_rays : 1.0f;
    bool refracted;
    float fresnel;

    p->safe = other.safe = 0.0f;
    other.entered_once = false;
    if (both && surface(s, hit, -1.0f, &other, &refracted, &fresnel) && fresnel > 0.0f) {
        for (int c = 0; c < 3; c++)
            other.power[c] *= fresnel * fraction;
        other.mirrored = false;
        others->path[others->count++] = other;
    }
    if (p->mirrored || !surface(s, hit, both ? 1.0f : pt_random(sampler), p, &refracted, &fresnel) || (both && fresnel >= 1.0f))
        return false;
    for (int c = 0; both && c < 3; c++)
        p->power[c] *= 1.0f - fresnel;
    p->entered_once = surfaces == 0 && refracted && !p->scattered;
    return true;
}

/* One flight, and the event at its end. False: the path ends. */
static bool step(const struct pt_scene *s, struct pt_walker *w, struct light_path *p, struct light_paths *others, int source,
                 struct pt_sampler *sampler)
{
    const int solid = pt_top(&p->stack);
    const bool connected = p->entered_once && solid >= 0 && s->solid[solid].connects;
    struct pt_scatterer at = { .w = p->ray.w };
    struct pt_free_path free_path = { .has_hit = false };
    float before[3] = { p->power[0], p->power[1], p->power[2] };
    bool beam;

    if (solid < 0) {
        free_path.has_hit = pt_intersect(s, &w->counts, p->ray.from, p->ray.w, INFINITY, PELL_RAY_ALL, &free_path.hit);
        if (!free_path.has_hit || (!p->first && !pt_bounce_allowed(s, ++p->bounces)))
            return false;
        if (p->first)
            for (int c = 0; c < 3; c++)
                p->power[c] *= (float) pell_light_sampler_range(s->light_sampler, source, (double) free_path.hit.t);
        p->first = false;
    } else {
        pt_sample_distance(s, &w->counts, solid, &p->ray, p->power, &p->safe, sampler, &free_path);
    }
    at.bounces = p->bounces;
    /* Stores the whole beam in a homogeneous solid, wherever this flight ended. */
    beam = solid >= 0 && s->solid[solid].medium.homogeneous && p->surfaces > 0 && !free_path.lost && !connected;
    if (beam) {
        struct pt_hit hit = free_path.hit;
        if (free_path.has_hit || pt_intersect(s, &w->counts, p->ray.from, p->ray.w, INFINITY, PELL_RAY_ALL, &hit)) {
            at.x = p->ray.x;
            at.medium = &s->solid[solid].medium.layer[0];
            store_vertex(w, &at, before, free_path.has_hit ? free_path.length : hit.t, solid);
        }
    }
    if (free_path.lost) {
        p->stack.count = 0;
        p->ray.x = p->ray.from = free_path.x;
        p->surfaces++;
        return true;
    }
    if (free_path.has_hit && free_path.hit.solid >= 0)
        return interact(s, &free_path.hit, p, others, sampler);
    /* Stores a scattering event in the medium, or at an opaque surface. */
    if (p->surfaces == 0 || connected)
        return false;
    at.x = free_path.x;
    at.medium = free_path.medium;
    if (free_path.has_hit || free_path.floor) {
        float albedo[3];
        at.medium = NULL;
        if (free_path.has_hit) {
            at.n = pt_scatter_opaque(s, &free_path.hit, p->ray.w, sampler, albedo);
            at.x = pt_offset_origin(&free_path.hit, at.n);
        } else {
            at.n = free_path.n;
            memcpy(albedo, free_path.albedo, sizeof(albedo));
        }
        for (int c = 0; c < 3; c++)
            p->power[c] *= albedo[c];
        store_vertex(w, &at, p->power, 0.0f, solid);
        p->ray.w = pt_scatter_sample(&at, sampler, NULL);
        p->safe = 0.0f;
    } else {
        if (!(p->power[0] + p->power[1] + p->power[2] > 0.0f))
            return false;
        if (!beam)
            store_vertex(w, &at, p->power, 0.0f, solid);
        pt_phase_sample(free_path.medium, p->ray.w, sampler, p->power, &p->ray.w);
    }
    p->ray.x = p->ray.from = at.x;
    p->surfaces = 0;
    p->entered_once = false;
    p->scattered = true;
    return true;
}

/* `mirrored`: only light reflected by its first surface. */
static void one_ray(const struct pt_scene *s, struct pt_walker *w, bool mirrored, struct pt_sampler *sampler)
{
    struct light_paths paths = { .count = 1 };
    struct pell_light_ray light;
    double u[5];
    float least;

    for (int k = 0; k < 5; k++)
        u[k] = (double) pt_random(sampler);
    if (!pell_light_sampler_emit(s->light_sampler, s->centre, s->radius, u, &light) || !light.sample.delta)
        return;
    paths.path[0] = (struct light_path) {
        .ray = { light.origin, light.origin, light.direction },
        .power = { (float) light.weight[0], (float) light.weight[1], (float) light.weight[2] },
        .first = true,
        .mirrored = mirrored,
    };
    least = (float) ROULETTE_FRACTION * fmaxf((float) light.weight[0], fmaxf((float) light.weight[1], (float) light.weight[2]));
    while (paths.count > 0) {
        struct light_path p = paths.path[--paths.count];
        while (p.events++ < MAX_LIGHT_EVENTS && w->vertices < PT_LIGHT_VERTICES &&
               pt_roulette(p.power, fmaxf(p.power[0], fmaxf(p.power[1], p.power[2])), least, sampler) &&
               step(s, w, &p, &paths, light.sample.source, sampler))
            continue;
    }
}

void pt_light_path(const struct pt_scene *s, struct pt_walker *w, struct pt_sampler *sampler)
{
    w->vertices = 0;
    for (int i = 0; i < s->light_rays; i++)
        one_ray(s, w, i > 0, sampler);
}

/* Samples a point of a beam: half of the samples in proportion to the scattered light, half equi-angularly as seen from the scatterer
 * (Kulla and Fajardo 2012, "Importance Sampling Techniques for Path Tracing in Participating Media"), in proportion to the contribution of
 * nearby points. Writes the scattered power over the sampling density. */
static struct pell_vec3 sample_beam_point(const struct pt_light_vertex *v, struct pell_vec3 x, struct pt_sampler *independent,
                                          float power[3])
{
    const struct pt_coefficients *m = v->at.medium;
    const struct pell_vec3 off = vec3_sub(x, v->at.x);
    const double length = (double) v->length, along = (double) vec3_dot(off, v->at.w), pick = pt_fine(independent),
                 u = pt_fine(independent);
    const struct pell_vec3 perpendicular = vec3_mad(off, (float) -along, v->at.w);
    const double distance = fmax((double) vec3_length(perpendicular), 1e-6 * length);
    const double from = atan(-along / distance), to = atan((length - along) / distance);
    const double sum = (double) (v->at.beta[0] + v->at.beta[1] + v->at.beta[2]);
    double t, density;

    if (pick < 0.5) {
        t = along + distance * tan(from + (to - from) * u);
    } else {
        const double sigma = (double) m->sigma_t[pt_sample_channel(v->at.beta, (float) (2.0 * pick - 1.0))];
        t = sigma * length > 1e-6 ? -log(1.0 - u * (1.0 - exp(-sigma * length))) / sigma : u * length;
    }
    t = fmin(fmax(t, 0.0), length);
    density = 0.5 * distance / ((to - from) * (distance * distance + (t - along) * (t - along)));
    for (int c = 0; c < 3; c++) {
        const double sigma = (double) m->sigma_t[c], fraction = (double) v->at.beta[c] / sum;
        density += 0.5 * fraction * (sigma * length > 1e-6 ? sigma * exp(-sigma * t) / (1.0 - exp(-sigma * length)) : 1.0 / length);
    }
    for (int c = 0; c < 3; c++)
        power[c] = (float) ((double) (v->at.beta[c] * m->sigma_s[c]) * exp(-(double) m->sigma_t[c] * t) / density);
    return vec3_mad(v->at.x, (float) t, v->at.w);
}

void pt_connect_paths(const struct pt_scene *s, struct pt_counts *counts, const struct pt_light_vertex *vertex, int count, int solid,
                      const struct pt_scatterer *at, const struct pt_sampler *sampler, double sum[3])
{
    struct pt_sampler independent = { .state = pt_mix(sampler->state ^ 0x14057b7ef767814fu), .at = PT_QUASI_RANDOM_NUMBERS };
    const double n = (double) pt_index(s, solid), least = JOIN_FRACTION * s->typical;

    for (int i = 0; i < count; i++) {
        const struct pt_light_vertex *v = &vertex[i];
        struct pell_vec3 to, dir;
        float values[3], vertex_values[3], passed[3], light[3], power[3] = { v->at.beta[0], v->at.beta[1], v->at.beta[2] };
        float square, distance, most = 0.0f, survival = 1.0f;
        if (v->solid != solid)
            continue;
        to = vec3_sub(v->length > 0.0f ? sample_beam_point(v, at->x, &independent, power) : v->at.x, at->x);
        square = vec3_dot(to, to);
        distance = sqrtf(square);
        if (!(distance > 2.0f * s->epsilon))
            continue;
        dir = vec3_mul(to, 1.0f / distance);
        pt_scatter_values(at, dir, values);
        pt_scatter_values(&v->at, vec3_mul(dir, -1.0f), vertex_values);
        pt_transmittance(s, solid, at->x, dir, distance, &independent, passed);
        for (int c = 0; c < 3; c++) {
            light[c] = at->beta[c] * values[c] * passed[c] * vertex_values[c] * power[c] / (square * (float) (n * n));
            most = fmaxf(most, light[c]);
        }
        if (!(most > 0.0f))
            continue;
        if ((double) most < least) {
            survival = (float) ((double) most / least);
            if (pt_fine(&independent) >= (double) survival)
                continue;
        }
        if (!pt_bounce_allowed(s, at->bounces + v->at.bounces + (solid < 0)) ||
            !pt_unoccluded(s, counts, at->x, dir, distance * (1.0f - 1e-5f), PELL_RAY_ALL))
            continue;
        for (int c = 0; c < 3; c++)
            sum[c] += (double) (light[c] / survival);
    }
}
