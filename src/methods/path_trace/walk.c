/* SPDX-License-Identifier: MIT
 * walk.c - paths from the camera.
 *
 * A path keeps its throughput at boundaries (path.h) and loses the absorbed part at collisions; below `roulette` Russian roulette starts.
 * Next-event estimation is done at scattering events (next_event.c, specular_manifold.c), light paths are connected there (light_path.c),
 * and a path outside may hit lights. At the pixel's own surface a smooth boundary is split: reflection and refraction are both traced. */
#include "methods/path_trace/walk.h"

#include <string.h>

#define LOOK 16 /* surfaces and scattering events between two tests for interruption */

static void add(struct pt_walk *p, const double light[3], int scattered)
{
    double *to = !p->entered ? p->out->surface : scattered == 1 && !p->mixed ? p->out->single : p->out->multiple;

    for (int c = 0; c < 3; c++)
        to[c] += light[c];
}

/* --- Outside -------------------------------------------------------------------------------------------------------------------------- */

/* Adds the lights that the segment outside hits before `reach`. */
static void hit_lights(struct pt_walk *p, double reach)
{
    const struct pt_scene *s = p->s;
    struct pell_light_hit hit;
    const struct pell_light_sample *source = &hit.sample;
    const struct pell_vec3 from = p->last == PT_LAST_SURFACE ? p->surface : p->last == PT_LAST_EXIT ? p->exit.from.x : p->x;

    if (!(s->knobs.techniques & PT_CHANCE))
        return;
    for (int k = 0; pell_light_sampler_hit(s->light_sampler, from, p->x, p->w, reach, k, &hit); k++) {
        const double facing = source->distant ? 1.0 : -(double) vec3_dot(source->normal, p->w);
        double met = 0.0, found = 0.0, light[3];
        if (p->last == PT_LAST_SURFACE && p->looked && !source->distant) {
            met = pt_exit_density(s, &p->exit) * (double) p->density * facing / (hit.distance * hit.distance);
            found = pell_light_sampler_pdf(s->light_sampler, p->exit.from.x, source) * pt_rough_looked(s, p->counts, &p->exit, source);
        } else if (p->last == PT_LAST_SURFACE && (s->knobs.techniques & PT_LIGHTS)) {
            met = (double) p->density * (source->distant ? 1.0 : facing / (hit.distance * hit.distance));
            found = source->pdf;
        } else if (p->last == PT_LAST_EXIT) {
            met = pt_exit_density(s, &p->exit) * pt_beam(s, &p->exit, hit.distance) * facing;
            found = source->pdf * pt_exit_looked(s, &p->exit, source);
        }
        for (int c = 0; c < 3; c++)
            light[c] = (double) (p->beta[c] * hit.radiance[c]) * (found > 0.0 ? met / (met + found) : 1.0);
        add(p, light, p->scattered);
    }
}

/* Next-event estimation at a scatterer in a medium, at an opaque surface in it, or (solid < 0) at an opaque surface outside. */
void pt_scattered(struct pt_walk *p, const struct pt_scatterer *at, int solid, enum pt_connection asked)
{
    const struct pt_scene *s = p->s;
    double sum[3] = { 0.0, 0.0, 0.0 };

    p->leaving = false;
    p->tight = p->tight && p->crossed;
    p->crossed = false;
    if (p->tight && s->chains) {
        pt_specular_manifold(s, p->counts, at, &p->place, NULL, p->safe, p->sampler, sum);
        add(p, sum, p->scattered);
        memset(sum, 0, sizeof(sum));
    }
    if (solid >= 0 && (s->solid[solid].connects || s->solid[solid].near) && p->place.count == 1) {
        const float share = p->scattered <= 1 ? 1.0f : s->solid[solid].share;
        if (!s->solid[solid].connects)
            pt_connect_rough(s, p->counts, solid, at, share, &p->turn, p->sampler, sum);
        else if (asked == PT_CONNECTION_YES ||
                 (asked == PT_CONNECTION_NOT && pt_should_connect(s, solid, at->x, &p->safe, share, &p->turn, p->sampler)))
            pt_connect_lights(s, p->counts, solid, at, share, p->sampler, sum);
        add(p, sum, p->scattered);
        p->exit.from = *at;
        p->exit.solid = solid;
        p->exit.share = share;
        p->leaving = true;
    }
    if (p->vertices > 0) {
        memset(sum, 0, sizeof(sum));
        pt_connect_paths(s, p->counts, p->vertex, p->vertices, solid, at, p->sampler, sum);
        add(p, sum, 2);
    }
}

/* Reflects at the substrate below layers. */
static void reflect_floor(struct pt_walk *p, const struct pt_free_path *path)
{
    struct pt_scatterer at = { path->x, p->w, .n = path->n, .bounces = p->bounces };

    p->mixed = true;
    for (int c = 0; c < 3; c++)
        at.beta[c] = p->beta[c] *= path->albedo[c];
    p->safe = 0.0f;
    p->last = PT_LAST_NONE;
    pt_scattered(p, &at, pt_top(&p->place), PT_CONNECTION_NOT);
    p->w = pt_scatter_sample(&at, p->sampler, NULL);
    p->x = p->from = at.x;
}

static void reflect_opaque(struct pt_walk *p, const struct pt_hit *hit)
{
    const struct pt_scene *s = p->s;
    const int solid = pt_top(&p->place);
    float albedo[3];
    const struct pell_vec3 n = pt_leave_opaque(s, hit, p->w, p->sampler, albedo);
    struct pt_scatterer at = { vec3_mad(hit->p, hit->unit, n), p->w, .n = n };

    p->mixed = true;
    at.bounces = p->bounces;
    for (int c = 0; c < 3; c++)
        at.beta[c] = p->beta[c] *= albedo[c];
    p->safe = 0.0f;
    p->last = PT_LAST_NONE;
    if (solid < 0 && (s->knobs.techniques & PT_LIGHTS)) {
        double sum[3] = { 0.0, 0.0, 0.0 };
        pt_next_event(s, p->counts, hit, &at, 1, false, p->sampler, sum);
        add(p, sum, p->scattered);
    }
    pt_scattered(p, &at, solid, PT_CONNECTION_NOT);
    p->w = pt_scatter_sample(&at, p->sampler, NULL);
    p->x = hit->p;
    p->from = at.x;
    if (solid < 0) {
        p->last = PT_LAST_SURFACE;
        p->density = fmaxf(vec3_dot(p->w, n), 0.0f) / PELL_PI_F;
        p->surface = hit->p;
        p->looked = false;
    }
}

/* --- Boundaries ------------------------------------------------------------------------------------------------------------------- */

struct boundary {
    struct pt_shading_frame at;
    struct pt_medium_stack before, after;
    const struct pt_rough *rough;
    float eta; /* after / before */
    bool enter, flat;
};

/* False: the boundary is ignored. */
static bool look(const struct pt_walk *p, const struct pt_hit *hit, struct boundary *b)
{
    const float side = vec3_dot(p->w, hit->ng) < 0.0f ? 1.0f : -1.0f;
    const bool closed = p->s->solid[hit->solid].closed; /* seen through the hole of an open surface */
    float outward;

    b->enter = side > 0.0f;
    if (!pt_cross(p->s, &p->place, hit->solid, b->enter, &b->before, &b->after)) {
        p->counts->crossed += closed;
        return false;
    }
    p->counts->crossed += closed && !b->enter && b->before.count != p->place.count;
    b->eta = pt_index(p->s, pt_top(&b->after)) / pt_index(p->s, pt_top(&b->before));
    outward = b->enter ? b->eta : 1.0f / b->eta;
    b->rough = pt_rough_find(p->s, hit, outward);
    b->at = (struct pt_shading_frame) { vec3_mul(p->w, -1.0f), vec3_mul(hit->ns, side), vec3_mul(hit->ng, side), b->enter ? 0 : 1 };
    b->flat = !(vec3_dot(b->at.o, b->at.ns) > 1e-4f);
    if (b->flat)
        b->at.ns = b->at.ng;
    return true;
}

static void go_on(struct pt_walk *p, const struct pt_hit *hit, const struct boundary *b, bool transmitted)
{
    if (transmitted)
        pt_tint(p->s, hit, !b->enter, p->beta); /* light travels in the opposite direction */
    p->place = transmitted ? b->after : b->before;
    p->x = hit->p;
    p->from = pt_leave(hit, p->w);
    p->safe = 0.0f;
    p->crossed = true;
}

static void rough_boundary(struct pt_walk *p, const struct pt_hit *hit, const struct boundary *b, float length)
{
    const struct pt_scene *s = p->s;
    const int open = b->before.count == 0 ? 1 : b->after.count == 0 ? -1 : 0;
    const bool looked = p->leaving && open < 0 && b->before.count == 1; /* for lights except the environment, from the scattering event */
    struct pt_scatterer at = {
        hit->p, p->w, NULL, b->at.ng, b->rough, &b->at, hit->unit, { p->beta[0], p->beta[1], p->beta[2] }, p->bounces, { 1.0f, 1.0f, 1.0f }
    };
    bool transmitted;

    pt_tint(s, hit, !b->enter, at.tint);
    if (open != 0 && (s->knobs.techniques & PT_LIGHTS)) {
        double sum[3] = { 0.0, 0.0, 0.0 };
        pt_next_event(s, p->counts, hit, &at, open, looked, p->sampler, sum);
        add(p, sum, p->scattered);
    }
    if (s->chains) {
        double sum[3] = { 0.0, 0.0, 0.0 };
        pt_specular_manifold(s, p->counts, &at, &b->before, &b->after, 0.0f, p->sampler, sum);
        add(p, sum, p->scattered);
    }
    p->tight = true; /* a light path ends at rough surfaces */
    p->w = pt_rough_sample(b->rough, &b->at, p->sampler, &transmitted);
    p->last = PT_LAST_NONE;
    if ((transmitted ? b->after : b->before).count == 0) {
        p->last = PT_LAST_SURFACE;
        p->density = pt_rough_density(b->rough, &b->at, p->w);
        p->surface = hit->p;
        p->looked = looked && transmitted;
        if (p->looked) {
            p->exit.hit = *hit;
            p->exit.w = at.w;
            p->exit.length = length;
            p->exit.transmit = 1.0f;
        }
    }
    go_on(p, hit, b, transmitted);
}

static void smooth_boundary(struct pt_walk *p, const struct pt_hit *hit, const struct boundary *b, float u, float length)
{
    const struct pell_vec3 came = p->w;
    const bool leaving = p->leaving && b->after.count == 0 && b->before.count == 1 && !b->flat;
    float fresnel;
    bool wrong, transmitted = pt_smooth(&b->at, b->eta, u, &p->w, &fresnel, &wrong);

    p->last = PT_LAST_NONE;
    if (leaving && transmitted && !wrong) {
        p->last = PT_LAST_EXIT;
        p->exit.hit = *hit;
        p->exit.w = came;
        p->exit.length = length;
        p->exit.transmit = 1.0f - fresnel;
    }
    go_on(p, hit, b, transmitted);
}

static void hit_solid(struct pt_walk *p, const struct pt_hit *hit, float length)
{
    struct boundary b;

    if (!look(p, hit, &b)) {
        p->x = hit->p;
        p->from = pt_leave(hit, p->w);
        p->safe = 0.0f;
        p->crossed = true;
        p->leaving = false;
        return;
    }
    if (b.rough)
        rough_boundary(p, hit, &b, length);
    else
        smooth_boundary(p, hit, &b, pt_random(p->sampler), length);
    p->leaving = false;
}

/* --- Splitting ------------------------------------------------------------------------------------------------------------------------
 *
 * A flight in a smooth solid that passes the bound of the grid and may reach the boundary behind it leaves there with the probability
 *
 *     out_c = exp(-sigma_t,c (t - bound)) (1 - F),    t the distance of the boundary, F the Fresnel reflectance
 *
 * in channel c. The leaving part is traced at once, with that fraction of the throughput; the path continues with the rest, conditioned not
 * to leave: the densities of its collisions, and of being reflected, are divided by 1 - out_c (with the balance heuristic over channels, as
 * in distance_sampling.c). A path that ended at its first exit would sample the surface there only; this one samples many exits, and its
 * throughput decreases gradually. The decision to split is made before the length of the flight is known: for boundaries within `further`
 * of the bound. */

#define LEAVES 0.02f                  /* smallest probability to leave for which a flight is split */
#define LEAST_STAY 1e-6f              /* lower bound of the probability to stay, a divisor */
#define PART 0.3f                     /* minimum weight of a leaving part that hits another surface */
#define PART_SALT 0x9fb21c651e98df25u /* of its random numbers */

/* Follows the leaving part: adds the lights it hits; if it hits a surface, it is subject to Russian roulette and continues after the
 * current path is complete, or at once if the queue is full. */
static void leave(const struct pt_walk *p, const struct pt_hit *hit, const struct boundary *b, const float beta[3])
{
    struct pt_branches *to = p->branches;
    struct pt_sampler sampler = pt_own_numbers(p->sampler, PART_SALT);
    struct pt_walk q = *p;
    struct pt_hit next;
    bool met;

    q.sampler = &sampler;
    for (int c = 0; c < 3; c++)
        q.beta[c] = beta[c];
    smooth_boundary(&q, hit, b, 1.0f, hit->t);
    q.leaving = false;
    if (q.events++ >= p->s->knobs.events) {
        pt_cut(q.counts, q.beta);
        return;
    }
    met = pt_intersect(p->s, q.counts, q.from, q.w, INFINITY, PELL_RAY_ALL, &next);
    hit_lights(&q, met ? (double) next.t : INFINITY);
    if (!met || !pt_may_bounce(p->s, ++q.bounces) ||
        !pt_roulette(q.beta, (q.beta[0] + q.beta[1] + q.beta[2]) * (1.0f / 3.0f), PART, &sampler) || !pt_met(&q, &next, next.t))
        return;
    if (to->count == PT_BRANCHES) {
        q.branches = NULL;
        while (pt_walk_on(&q))
            continue;
        return;
    }
    q.sampler = p->sampler;
    to->walk[to->count] = q;
    to->sampler[to->count++] = sampler;
}

enum pt_split pt_split(struct pt_walk *p, struct pt_flight *f)
{
    const struct pt_scene *s = p->s;
    const int solid = pt_top(&p->place);
    const struct pt_coefficients *m = &s->solid[solid].medium.layer[0];
    const int64_t crossed = p->counts->crossed;
    struct boundary b;
    float fresnel, cos_t, passed[3], arrived[3], out[3], outside[3], sum = 0.0f, density = 0.0f, u, near, most = 0.0f;

    if (!f->found || p->place.count != 1 || f->hit.solid != solid || !(f->hit.t <= f->bound + s->solid[solid].further))
        return PT_SPLIT_NOT;
    if (!look(p, &f->hit, &b) || b.enter || b.after.count > 0 || b.rough || b.flat) {
        p->counts->crossed = crossed;
        return PT_SPLIT_NOT;
    }
    fresnel = pt_fresnel(b.eta, vec3_dot(b.at.o, b.at.ns), &cos_t);
    near = fmaxf(f->hit.t - f->bound, 0.0f);
    for (int c = 0; c < 3; c++) {
        passed[c] = pt_exp(-m->sigma_t[c] * f->bound);
        arrived[c] = pt_exp(-m->sigma_t[c] * near);
        out[c] = arrived[c] * (1.0f - fresnel);
        most = fmaxf(most, out[c]);
        sum += p->beta[c];
        density += p->beta[c] * passed[c];
    }
    if (most < LEAVES || !(density > 0.0f))
        return PT_SPLIT_NOT;
    for (int c = 0; c < 3; c++) {
        outside[c] = p->beta[c] * passed[c] * out[c] * (sum / density);
        f->over[c] = 1.0f / fmaxf(1.0f - out[c], LEAST_STAY);
    }
    leave(p, &f->hit, &b, outside);
    /* Maps the rest of the flight beyond the bound to [0, 1), for the part that stays: below 1 - arrived it collides. */
    u = (1.0f - pt_exp(-m->sigma_t[f->channel] * fmaxf(f->length - f->bound, 0.0f))) * (1.0f - out[f->channel]);
    if (u < 1.0f - arrived[f->channel] || !(fresnel > 0.0f)) {
        f->met = false;
        f->length = f->bound - pt_log(fmaxf(1.0f - u, 1e-30f)) * m->mean_free_path[f->channel];
        f->length = fminf(f->length, f->hit.t);
        return PT_SPLIT_COLLIDES;
    }
    density = 0.0f;
    for (int c = 0; c < 3; c++) {
        passed[c] *= arrived[c];
        density += p->beta[c] * passed[c] * f->over[c];
    }
    for (int c = 0; c < 3; c++)
        p->beta[c] = density > 0.0f ? p->beta[c] * passed[c] * (sum / density) : 0.0f;
    smooth_boundary(p, &f->hit, &b, -1.0f, f->hit.t);
    p->leaving = false;
    return PT_SPLIT_REFLECTS;
}

bool pt_next_branch(struct pt_walk *p)
{
    struct pt_branches *from = p->branches;
    struct pt_sampler *sampler = p->sampler;

    if (from == NULL || from->count == 0)
        return false;
    *sampler = from->sampler[--from->count];
    *p = from->walk[from->count];
    return true;
}

/* --- Steps of a path ----------------------------------------------------------------------------------------------------------------- */

static bool roulette(struct pt_walk *p)
{
    return pt_roulette(p->beta, (p->beta[0] + p->beta[1] + p->beta[2]) * (1.0f / 3.0f), p->s->knobs.roulette, p->sampler);
}

bool pt_met(struct pt_walk *p, const struct pt_hit *hit, float length)
{
    if (hit->solid >= 0)
        hit_solid(p, hit, length);
    else
        reflect_opaque(p, hit);
    return roulette(p);
}

void pt_left(struct pt_walk *p, struct pell_vec3 x)
{
    p->counts->lost++;
    p->x = p->from = x;
    p->place.count = 0;
    p->last = PT_LAST_NONE;
    p->leaving = false;
    p->crossed = true;
}

void pt_cut(struct pt_counts *counts, const float beta[3])
{
    counts->cut++;
    counts->cut_weight += (double) (beta[0] + beta[1] + beta[2]) / 3.0;
}

bool pt_walk_on(struct pt_walk *p)
{
    const struct pt_scene *s = p->s;
    const int solid = pt_top(&p->place);
    const struct pt_ray ray = { p->x, p->from, p->w };
    struct pt_free_path free_path;

    if (p->events % LOOK == 0 && pt_stopped(s))
        return false;
    if (p->events++ >= s->knobs.events) {
        pt_cut(p->counts, p->beta);
        return false;
    }
    if (solid < 0) {
        struct pt_hit hit;
        const bool met = pt_intersect(s, p->counts, p->from, p->w, INFINITY, PELL_RAY_ALL, &hit);
        hit_lights(p, met ? (double) hit.t : INFINITY);
        return met && pt_may_bounce(s, ++p->bounces) && pt_met(p, &hit, hit.t);
    }
    if (p->branches && s->solid[solid].further > 0.0f) {
        struct pt_flight flight = { .further = s->solid[solid].further };
        pt_fly(s, p->counts, solid, &ray, p->beta, &p->safe, p->sampler, &flight);
        if (pt_split(p, &flight) == PT_SPLIT_REFLECTS)
            return roulette(p);
        pt_land(s, solid, &ray, &flight, p->beta, &free_path);
    } else {
        pt_sample_distance(s, p->counts, solid, &ray, p->beta, &p->safe, p->sampler, &free_path);
    }
    if (free_path.met)
        return pt_met(p, &free_path.hit, free_path.length);
    if (free_path.lost) {
        pt_left(p, free_path.x);
        return true;
    }
    if (free_path.floor) {
        reflect_floor(p, &free_path);
        return roulette(p);
    }
    p->counts->scatterings++;
    p->scattered++;
    p->x = p->from = free_path.x;
    if (!(p->beta[0] + p->beta[1] + p->beta[2] > 0.0f))
        return false;
    const struct pt_scatterer at = { free_path.x, p->w, free_path.medium, .beta = { p->beta[0], p->beta[1], p->beta[2] },
                                     .bounces = p->bounces };
    pt_scattered(p, &at, solid, PT_CONNECTION_NOT);
    pt_phase_sample(free_path.medium, p->w, p->sampler, p->beta, &p->w);
    return roulette(p);
}

/* --- Camera -------------------------------------------------------------------------------------------------------------------------- */

/* The surface at the pixel's point, by rays from increasing distances, because the point is on it only up to rounding errors. */
bool pt_find(const struct pt_scene *s, struct pt_counts *counts, const struct pt_point *point, struct pt_hit *hit)
{
    const struct pell_vec3 w = vec3_mul(point->toward, -1.0f);
    const float most = fabsf(point->at.x) + fabsf(point->at.y) + fabsf(point->at.z) + point->depth;

    for (float e = 2e-5f; e < 2e-2f; e *= 8.0f) {
        const float back = fminf(e * most, point->depth);
        if (pt_intersect(s, counts, vec3_mad(point->at, back, point->toward), w, 2.0f * back, PELL_RAY_TRANSLUCENT, hit) && hit->solid >= 0)
            return true;
    }
    return false;
}

int pt_begin(const struct pt_scene *s, struct pt_walker *walker, const struct pt_point *point, const struct pt_hit *hit, uint32_t sample,
             struct pt_walk walks[2], struct pt_sampler sampler[2], struct pt_light out[2])
{
    struct pt_walk p = { .s = s,
                         .counts = &walker->counts,
                         .x = hit->p,
                         .w = vec3_mul(point->toward, -1.0f),
                         .beta = { 1.0f, 1.0f, 1.0f },
                         .crossed = true,
                         .tight = true,
                         .events = 1 };
    const int64_t crossed = walker->counts.crossed;
    struct boundary b;
    int count = 0;

    walker->counts.samples++;
    walker->vertices = 0;
    if (s->light_paths) {
        struct pt_sampler light = pt_sampler_start(s->seed, point->pixel, sample, 1);
        pt_light_path(s, walker, &light);
    }
    p.vertex = walker->vertex;
    p.vertices = walker->vertices;
    if (!look(&p, hit, &b)) /* impossible: the camera is in no solid yet */
        return 0;
    walker->counts.crossed = crossed; /* a camera inside a solid crosses no surface */
    p.entered = b.before.count > 0;
    for (int reflected = 0; reflected < (b.rough ? 1 : 2); reflected++) {
        struct pt_walk *q = &walks[count];
        float fresnel, cos_t, share;
        /* Independent random numbers: the refracted path does not depend on the reflected one. */
        sampler[count] = pt_sampler_start(s->seed, point->pixel, sample, reflected ? 2 : 0);
        if (!reflected)
            p.turn = pell_unit_float(pell_hash(sampler[0].pattern ^ pell_sobol0(sample)));
        *q = p;
        q->sampler = &sampler[count];
        q->out = &out[count];
        if (b.rough) {
            rough_boundary(q, hit, &b, 0.0f);
            q->entered = q->entered || q->place.count > 0;
            return 1;
        }
        fresnel = pt_fresnel(b.eta, vec3_dot(b.at.o, b.at.ns), &cos_t);
        share = reflected ? fresnel : 1.0f - fresnel;
        if (!(share > 0.0f))
            continue;
        for (int c = 0; c < 3; c++)
            q->beta[c] = share;
        smooth_boundary(q, hit, &b, reflected ? -1.0f : 1.0f, 0.0f);
        q->entered = q->entered || !reflected;
        count++;
    }
    return count;
}
