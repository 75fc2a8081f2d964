/* SPDX-License-Identifier: MIT
 * light_path.c - paths from delta lights through smooth boundaries, joined to the walk inside media (Veach and Guibas 1994, Lafortune and
 * Willems 1996), for the light that no connection finds: that which was reflected inside, or crossed more than one surface, before it was
 * first scattered.
 *
 * Who finds a path is settled by its form, so that nothing is weighed and nothing counted twice. Seen from the light, the first edge
 * between two scatterings with no surface on it is where the light's path is joined to the walk; a path whose light came in by one
 * refraction alone and was scattered is the connections'. So a light's path ends where it would go on without a surface, and there is one
 * join a path. What neither finds has a smooth surface on every edge (a rough one ends a light's path): specular_manifold.c.
 *
 * Light is carried as flux. With interpolated normals a surface passes other flux than the walk's radiance says, by the ratio of cosines
 * that makes both agree (Veach 1996, "Non-symmetric Scattering in Light Transport Algorithms"). */
#include "methods/path_trace/path.h"

#include <string.h>

#define LIGHT_EVENTS 64  /* of a light's path at most; what is carried so far is some 1e-30 in solids that absorb or scatter at all */
#define LIGHT_LEAST 1e-2 /* share of the weight below which paths go on by chance */
#define JOIN_SHARE 1e-2  /* joins of less than this times the typical radiance are made by chance */

static void scattered(struct pt_walker *w, const struct pt_scatterer *at, const float power[3], float length, int solid)
{
    struct pt_light_vertex *v;

    if (w->vertices >= PT_LIGHT_VERTICES)
        return;
    v = &w->vertex[w->vertices++];
    *v = (struct pt_light_vertex) { *at, length, solid };
    memcpy(v->at.beta, power, sizeof(v->at.beta));
}

/* Passes or reflects at a smooth surface. False: the path ends. */
static bool surface(const struct pt_scene *s, const struct pt_hit *hit, struct pt_medium_stack *place, struct pt_sampler *sampler,
                    struct pt_ray *ray, float power[3], bool *refracted)
{
    const bool enter = vec3_dot(ray->w, hit->ng) < 0.0f;
    const float side = enter ? 1.0f : -1.0f;
    struct pt_shading_frame at = { vec3_mul(ray->w, -1.0f), vec3_mul(hit->ns, side), vec3_mul(hit->ng, side), enter ? 0 : 1 };
    struct pt_medium_stack before, after;
    float eta, fresnel, in, out, ratio;
    bool wrong;

    *refracted = false;
    if (!pt_cross(s, place, hit->solid, enter, &before, &after)) {
        ray->x = hit->p;
        ray->from = pt_leave(hit, ray->w);
        return true;
    }
    eta = pt_index(s, pt_top(&after)) / pt_index(s, pt_top(&before));
    if (pt_rough_find(s, hit, enter ? eta : 1.0f / eta))
        return false;
    if (!(vec3_dot(at.o, at.ns) > 0.0f))
        at.ns = at.ng;
    in = vec3_dot(at.o, at.ns) / vec3_dot(at.o, at.ng);
    *refracted = pt_smooth(&at, eta, pt_random(sampler), &ray->w, &fresnel, &wrong);
    if (wrong)
        return false;
    out = fabsf(vec3_dot(ray->w, at.ng)) / fmaxf(fabsf(vec3_dot(ray->w, at.ns)), 1e-6f);
    ratio = in * out;
    for (int c = 0; c < 3; c++)
        power[c] *= ratio;
    *place = *refracted ? after : before;
    ray->x = hit->p;
    ray->from = pt_leave(hit, ray->w);
    return true;
}

void pt_light_path(const struct pt_scene *s, struct pt_walker *w, struct pt_sampler *sampler)
{
    struct pt_medium_stack place = { 0 };
    struct pell_light_ray light;
    struct pt_ray ray;
    double u[5];
    float power[3], before[3], least, safe = 0.0f;
    int surfaces = 0; /* since the light, or the last scattering */
    int bounces = 0;
    bool first = true, entered_once = false, beam;

    w->vertices = 0;
    for (int k = 0; k < 5; k++)
        u[k] = (double) pt_random(sampler);
    if (!pell_light_sampler_emit(s->light_sampler, s->centre, s->radius, u, &light) || !light.sample.delta)
        return;
    ray = (struct pt_ray) { light.origin, light.origin, light.direction };
    for (int c = 0; c < 3; c++)
        power[c] = (float) light.weight[c];
    least = (float) LIGHT_LEAST * fmaxf(power[0], fmaxf(power[1], power[2]));
    for (int event = 0; event < LIGHT_EVENTS && w->vertices < PT_LIGHT_VERTICES &&
                        pt_roulette(power, fmaxf(power[0], fmaxf(power[1], power[2])), least, sampler);
         event++) {
        const int solid = pt_top(&place);
        struct pt_scatterer at = { .w = ray.w };
        struct pt_free_path free_path = { .met = false };
        bool refracted;
        if (solid < 0) {
            free_path.met = pt_intersect(s, &w->counts, ray.from, ray.w, INFINITY, PELL_RAY_ALL, &free_path.hit);
            if (!free_path.met || (!first && !pt_may_bounce(s, ++bounces)))
                return;
            if (first)
                for (int c = 0; c < 3; c++)
                    power[c] *= (float) pell_light_sampler_range(s->light_sampler, light.sample.source, (double) free_path.hit.t);
            first = false;
        } else {
            memcpy(before, power, sizeof(before));
            pt_sample_distance(s, &w->counts, solid, &ray, power, &safe, sampler, &free_path);
        }
        at.bounces = bounces;
        /* All of the beam in a solid of one medium, wherever this flight ended. */
        beam = solid >= 0 && s->solid[solid].medium.homogeneous && surfaces > 0 && !free_path.lost &&
               !(entered_once && s->solid[solid].connects);
        if (beam) {
            struct pt_hit hit = free_path.hit;
            if (free_path.met || pt_intersect(s, &w->counts, ray.from, ray.w, INFINITY, PELL_RAY_ALL, &hit)) {
                at.x = ray.x;
                at.medium = &s->solid[solid].medium.layer[0];
                scattered(w, &at, before, free_path.met ? free_path.length : hit.t, solid);
            }
        }
        if (free_path.lost) {
            place.count = 0;
            ray.x = ray.from = free_path.x;
            surfaces++;
            continue;
        }
        if (free_path.met && free_path.hit.solid >= 0) {
            if (!surface(s, &free_path.hit, &place, sampler, &ray, power, &refracted))
                return;
            entered_once = surfaces == 0 && refracted && w->vertices == 0;
            surfaces++;
            safe = 0.0f;
            continue;
        }
        /* Scattered: by the medium, or by something opaque. */
        if (surfaces == 0 || (entered_once && solid >= 0 && s->solid[solid].connects))
            return;
        at.x = free_path.x;
        at.medium = free_path.medium;
        if (free_path.met) {
            float albedo[3];
            at.medium = NULL;
            at.n = vec3_dot(ray.w, free_path.hit.ng) > 0.0f ? vec3_mul(free_path.hit.ng, -1.0f) : free_path.hit.ng;
            at.x = pt_leave(&free_path.hit, at.n);
            pt_albedo(s, &free_path.hit, albedo);
            for (int c = 0; c < 3; c++)
                power[c] *= albedo[c];
            scattered(w, &at, power, 0.0f, solid);
            ray.w = pt_scatter_sample(&at, sampler, NULL);
            safe = 0.0f;
        } else {
            if (!(power[0] + power[1] + power[2] > 0.0f))
                return;
            if (!beam)
                scattered(w, &at, power, 0.0f, solid);
            pt_phase_sample(free_path.medium, ray.w, sampler, power, &ray.w);
        }
        ray.x = ray.from = at.x;
        surfaces = 0;
        entered_once = false;
    }
}

/* A place of a beam: half of them as light scatters along it, half by the angle under which the scatterer sees it (Kulla and Fajardo 2012,
 * "Importance Sampling Techniques for Path Tracing in Participating Media"), so that what is nearer is as much likelier as it gives more
 * light. Writes the power that is scattered there, over the density of having chosen it. */
static struct pell_vec3 beam_place(const struct pt_light_vertex *v, struct pell_vec3 x, struct pt_sampler *own, float power[3])
{
    const struct pt_coefficients *m = v->at.medium;
    const struct pell_vec3 off = vec3_sub(x, v->at.x);
    const double length = (double) v->length, along = (double) vec3_dot(off, v->at.w), pick = pt_fine(own), u = pt_fine(own);
    const struct pell_vec3 beside = vec3_mad(off, (float) -along, v->at.w);
    const double apart = fmax((double) vec3_length(beside), 1e-6 * length);
    const double from = atan(-along / apart), to = atan((length - along) / apart);
    const double sum = (double) (v->at.beta[0] + v->at.beta[1] + v->at.beta[2]);
    double t, density;

    if (pick < 0.5) {
        t = along + apart * tan(from + (to - from) * u);
    } else {
        const double sigma = (double) m->sigma_t[pt_sample_channel(v->at.beta, (float) (2.0 * pick - 1.0))];
        t = sigma * length > 1e-6 ? -log(1.0 - u * (1.0 - exp(-sigma * length))) / sigma : u * length;
    }
    t = fmin(fmax(t, 0.0), length);
    density = 0.5 * apart / ((to - from) * (apart * apart + (t - along) * (t - along)));
    for (int c = 0; c < 3; c++) {
        const double sigma = (double) m->sigma_t[c], share = (double) v->at.beta[c] / sum;
        density += 0.5 * share * (sigma * length > 1e-6 ? sigma * exp(-sigma * t) / (1.0 - exp(-sigma * length)) : 1.0 / length);
    }
    for (int c = 0; c < 3; c++)
        power[c] = (float) ((double) (v->at.beta[c] * m->sigma_s[c]) * exp(-(double) m->sigma_t[c] * t) / density);
    return vec3_mad(v->at.x, (float) t, v->at.w);
}

void pt_connect_paths(const struct pt_scene *s, struct pt_counts *counts, const struct pt_light_vertex *vertex, int count, int solid,
                      const struct pt_scatterer *at, const struct pt_sampler *sampler, double sum[3])
{
    struct pt_sampler own = { .state = pt_mix(sampler->state ^ 0x14057b7ef767814fu), .at = PT_QUASI_RANDOM_NUMBERS };
    const double n = (double) pt_index(s, solid), least = JOIN_SHARE * s->typical;

    for (int i = 0; i < count; i++) {
        const struct pt_light_vertex *v = &vertex[i];
        struct pell_vec3 to, way;
        float here[3], there[3], passed[3], light[3], power[3] = { v->at.beta[0], v->at.beta[1], v->at.beta[2] };
        float square, distance, most = 0.0f, chance = 1.0f;
        if (v->solid != solid)
            continue;
        to = vec3_sub(v->length > 0.0f ? beam_place(v, at->x, &own, power) : v->at.x, at->x);
        square = vec3_dot(to, to);
        distance = sqrtf(square);
        if (!(distance > 2.0f * s->unit))
            continue;
        way = vec3_mul(to, 1.0f / distance);
        pt_scatter_values(at, way, here);
        pt_scatter_values(&v->at, vec3_mul(way, -1.0f), there);
        pt_transmittance(s, solid, at->x, way, distance, &own, passed);
        for (int c = 0; c < 3; c++) {
            light[c] = at->beta[c] * here[c] * passed[c] * there[c] * power[c] / (square * (float) (n * n));
            most = fmaxf(most, light[c]);
        }
        if (!(most > 0.0f))
            continue;
        if ((double) most < least) {
            chance = (float) ((double) most / least);
            if (pt_fine(&own) >= (double) chance)
                continue;
        }
        if (!pt_may_bounce(s, at->bounces + v->at.bounces + (solid < 0)) ||
            !pt_unoccluded(s, counts, at->x, way, distance * (1.0f - 1e-5f), PELL_RAY_ALL))
            continue;
        for (int c = 0; c < 3; c++)
            sum[c] += (double) (light[c] / chance);
    }
}
