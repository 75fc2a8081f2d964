/* SPDX-License-Identifier: MIT
 * walk.c - paths from the camera.
 *
 * A path keeps its throughput at boundaries (path.h) and loses the absorbed part at collisions; below `roulette` Russian roulette starts.
 * Next-event estimation is done at scattering events (next_event.c, specular_manifold.c), light paths are connected there (light_path.c),
 * and a path outside may hit lights. At the pixel's own surface a smooth boundary is split: reflection and refraction are both traced. */
#include "methods/path_trace/walk.h"

#include <string.h>

#define CHECK_INTERVAL 16 /* surfaces and scattering events between two tests for interruption */

static void add(struct pt_walk *p, const double light[3], int scattered)
{
    double *to = !p->entered ? p->out->surface : scattered == 1 && !p->hit_opaque ? p->out->single : p->out->multiple;

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

    if (!(s->knobs.techniques & PT_HIT_LIGHTS))
        return;
    for (int k = 0; pell_light_sampler_hit(s->light_sampler, from, p->x, p->w, reach, k, &hit); k++) {
        const double facing = source->distant ? 1.0 : -(double) vec3_dot(source->normal, p->w);
        double path_pdf = 0.0, light_pdf = 0.0, light[3];
        if (p->last == PT_LAST_SURFACE && p->nee_done && !source->distant) {
            path_pdf = pt_exit_density(s, &p->exit) * (double) p->density * facing / (hit.distance * hit.distance);
            light_pdf =
                pell_light_sampler_pdf(s->light_sampler, p->exit.from.x, source) * pt_rough_nee_density(s, p->counts, &p->exit, source);
        } else if (p->last == PT_LAST_SURFACE && (s->knobs.techniques & PT_LIGHT_SAMPLES)) {
            path_pdf = (double) p->density * (source->distant ? 1.0 : facing / (hit.distance * hit.distance));
            light_pdf = source->pdf;
        } else if (p->last == PT_LAST_EXIT) {
            path_pdf = pt_exit_density(s, &p->exit) * pt_beam(s, &p->exit, hit.distance) * facing;
            light_pdf = source->pdf * pt_exit_nee_probability(s, &p->exit, source);
        }
        for (int c = 0; c < 3; c++)
            light[c] = (double) (p->beta[c] * hit.radiance[c]) * (light_pdf > 0.0 ? path_pdf / (path_pdf + light_pdf) : 1.0);
        add(p, light, p->scattered);
    }
}

/* Next-event estimation at a scatterer in a medium, at an opaque surface in it, or (solid < 0) at an opaque surface outside. */
void pt_scattering_event(struct pt_walk *p, const struct pt_scatterer *at, int solid, enum pt_connection decision)
{
    const struct pt_scene *s = p->s;
    double sum[3] = { 0.0, 0.0, 0.0 };

    p->leaving = false;
    p->all_specular = p->all_specular && p->crossed;
    p->crossed = false;
    if (p->all_specular && s->chains) {
        pt_specular_manifold(s, p->counts, at, &p->stack, NULL, p->safe, p->sampler, sum);
        add(p, sum, p->scattered);
        memset(sum, 0, sizeof(sum));
    }
    if (solid >= 0 && (s->solid[solid].connects || s->solid[solid].connects_rough) && p->stack.count == 1) {
        const float fraction = p->scattered <= 1 ? 1.0f : s->solid[solid].fraction;
        if (!s->solid[solid].connects)
            pt_connect_rough(s, p->counts, solid, at, fraction, &p->selection, p->sampler, sum);
        else if (decision == PT_CONNECTION_YES ||
                 (decision == PT_CONNECTION_UNDECIDED && pt_should_connect(s, solid, at->x, &p->safe, fraction, &p->selection, p->sampler)))
            pt_connect_lights(s, p->counts, solid, at, fraction, p->sampler, sum);
        add(p, sum, p->scattered);
        p->exit.from = *at;
        p->exit.solid = solid;
        p->exit.fraction = fraction;
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

    p->hit_opaque = true;
    for (int c = 0; c < 3; c++)
        at.beta[c] = p->beta[c] *= path->albedo[c];
    p->safe = 0.0f;
    p->last = PT_LAST_NONE;
    pt_scattering_event(p, &at, pt_top(&p->stack), PT_CONNECTION_UNDECIDED);
    p->w = pt_scatter_sample(&at, p->sampler, NULL);
    p->x = p->from = at.x;
}

static void reflect_opaque(struct pt_walk *p, const struct pt_hit *hit)
{
    const struct pt_scene *s = p->s;
    const int solid = pt_top(&p->stack);
    float albedo[3];
    const struct pell_vec3 n = pt_scatter_opaque(s, hit, p->w, p->sampler, albedo);
    struct pt_scatterer at = { vec3_mad(hit->p, hit->epsilon, n), p->w, .n = n };

    p->hit_opaque = true;
    at.bounces = p->bounces;
    for (int c = 0; c < 3; c++)
        at.beta[c] = p->beta[c] *= albedo[c];
    p->safe = 0.0f;
    p->last = PT_LAST_NONE;
    if (solid < 0 && (s->knobs.techniques & PT_LIGHT_SAMPLES)) {
        double sum[3] = { 0.0, 0.0, 0.0 };
        pt_next_event(s, p->counts, hit, &at, 1, false, p->sampler, sum);
        add(p, sum, p->scattered);
    }
    pt_scattering_event(p, &at, solid, PT_CONNECTION_UNDECIDED);
    p->w = pt_scatter_sample(&at, p->sampler, NULL);
    p->x = hit->p;
    p->from = at.x;
    if (solid < 0) {
        p->last = PT_LAST_SURFACE;
        p->density = fmaxf(vec3_dot(p->w, n), 0.0f) / PELL_PI_F;
        p->surface = hit->p;
        p->nee_done = false;
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
static bool prepare_boundary(const struct pt_walk *p, const struct pt_hit *hit, struct boundary *b)
{
    const float side = vec3_dot(p->w, hit->ng) < 0.0f ? 1.0f : -1.0f;
    const bool closed = p->s->solid[hit->solid].closed; /* only closed surfaces are hit in order */
    float outward;

    b->enter = side > 0.0f;
    if (!pt_cross(p->s, &p->stack, hit->solid, b->enter, &b->before, &b->after)) {
        p->counts->crossed += closed;
        return false;
    }
    p->counts->crossed += closed && !b->enter && b->before.count != p->stack.count;
    b->eta = pt_index(p->s, pt_top(&b->after)) / pt_index(p->s, pt_top(&b->before));
    outward = b->enter ? b->eta : 1.0f / b->eta;
    b->rough = pt_rough_find(p->s, hit, outward);
    b->at = (struct pt_shading_frame) { vec3_mul(p->w, -1.0f), vec3_mul(hit->ns, side), vec3_mul(hit->ng, side), b->enter ? 0 : 1 };
    b->flat = !(vec3_dot(b->at.o, b->at.ns) > 1e-4f);
    if (b->flat)
        b->at.ns = b->at.ng;
    return true;
}

static void continue_path(struct pt_walk *p, const struct pt_hit *hit, const struct boundary *b, bool transmitted)
{
    if (transmitted)
        pt_tint(p->s, hit, !b->enter, p->beta); /* light travels in the opposite direction */
    p->stack = transmitted ? b->after : b->before;
    p->x = hit->p;
    p->from = pt_offset_origin(hit, p->w);
    p->safe = 0.0f;
    p->crossed = true;
}

static void rough_boundary(struct pt_walk *p, const struct pt_hit *hit, const struct boundary *b, float length)
{
    const struct pt_scene *s = p->s;
    const int outer_side = b->before.count == 0 ? 1 : b->after.count == 0 ? -1 : 0;
    const bool nee_done =
        p->leaving && outer_side < 0 && b->before.count == 1; /* for lights except the environment, from the scattering event */
    struct pt_scatterer at = {
        .x = hit->p,
        .w = p->w,
        .n = b->at.ng,
        .rough = b->rough,
        .facing = &b->at,
        .off = hit->epsilon,
        .beta = { p->beta[0], p->beta[1], p->beta[2] },
        .bounces = p->bounces,
        .tint = { 1.0f, 1.0f, 1.0f },
    };
    bool transmitted;

    pt_tint(s, hit, !b->enter, at.tint);
    if (outer_side != 0 && (s->knobs.techniques & PT_LIGHT_SAMPLES)) {
        double sum[3] = { 0.0, 0.0, 0.0 };
        pt_next_event(s, p->counts, hit, &at, outer_side, nee_done, p->sampler, sum);
        add(p, sum, p->scattered);
    }
    if (s->chains) {
        double sum[3] = { 0.0, 0.0, 0.0 };
        pt_specular_manifold(s, p->counts, &at, &b->before, &b->after, 0.0f, p->sampler, sum);
        add(p, sum, p->scattered);
    }
    p->all_specular = true; /* a light path ends at rough surfaces */
    p->w = pt_rough_sample(b->rough, &b->at, p->sampler, &transmitted);
    p->last = PT_LAST_NONE;
    if ((transmitted ? b->after : b->before).count == 0) {
        p->last = PT_LAST_SURFACE;
        p->density = pt_rough_density(b->rough, &b->at, p->w);
        p->surface = hit->p;
        p->nee_done = nee_done && transmitted;
        if (p->nee_done) {
            p->exit.hit = *hit;
            p->exit.w = at.w;
            p->exit.length = length;
            p->exit.transmit = 1.0f;
        }
    }
    continue_path(p, hit, b, transmitted);
}

static void smooth_boundary(struct pt_walk *p, const struct pt_hit *hit, const struct boundary *b, float u, float length)
{
    const struct pell_vec3 incident = p->w;
    const bool leaving = p->leaving && b->after.count == 0 && b->before.count == 1 && !b->flat;
    float fresnel;
    bool wrong, transmitted = pt_smooth(&b->at, b->eta, u, &p->w, &fresnel, &wrong);

    p->last = PT_LAST_NONE;
    if (leaving && transmitted && !wrong) {
        p->last = PT_LAST_EXIT;
        p->exit.hit = *hit;
        p->exit.w = incident;
        p->exit.length = length;
        p->exit.transmit = 1.0f - fresnel;
    }
    continue_path(p, hit, b, transmitted);
}

static void hit_solid(struct pt_walk *p, const struct pt_hit *hit, float length)
{
    struct boundary b;

    if (!prepare_boundary(p, hit, &b)) {
        p->x = hit->p;
        p->from = pt_offset_origin(hit, p->w);
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
 * in channel c. The exiting path is traced at once, with that fraction of the throughput; the path continues with the rest, conditioned not
 * to leave: the densities of its collisions, and of being reflected, are divided by 1 - out_c (with the balance heuristic over channels, as
 * in distance_sampling.c). A path that ended at its first exit would sample the surface there only; this one samples many exits, and its
 * throughput decreases gradually. The decision to split is made before the length of the flight is known: for boundaries within `split_mm`
 * of the bound. */

#define MIN_SPLIT 0.02f               /* smallest probability to leave for which a flight is split */
#define MIN_REMAINING 1e-6f           /* lower bound of the probability to stay, a divisor */
#define MIN_EXIT_WEIGHT 0.3f          /* minimum weight of an exiting path that hits another surface */
#define EXIT_SALT 0x9fb21c651e98df25u /* of its random numbers */

/* Follows the exiting path: adds the lights it hits; if it hits a surface, it is subject to Russian roulette and continues after the
 * current path is complete, or at once if the queue is full. */
static void trace_exit(const struct pt_walk *p, const struct pt_hit *hit, const struct boundary *b, const float beta[3])
{
    struct pt_branches *to = p->branches;
    struct pt_sampler sampler = pt_independent_sampler(p->sampler, EXIT_SALT);
    struct pt_walk q = *p;
    struct pt_hit next;
    bool has_hit;

    q.sampler = &sampler;
    for (int c = 0; c < 3; c++)
        q.beta[c] = beta[c];
    smooth_boundary(&q, hit, b, 1.0f, hit->t);
    q.leaving = false;
    if (q.events++ >= p->s->knobs.events) {
        pt_count_cut(q.counts, q.beta);
        return;
    }
    has_hit = pt_intersect(p->s, q.counts, q.from, q.w, INFINITY, PELL_RAY_ALL, &next);
    hit_lights(&q, has_hit ? (double) next.t : INFINITY);
    if (!has_hit || !pt_bounce_allowed(p->s, ++q.bounces) ||
        !pt_roulette(q.beta, (q.beta[0] + q.beta[1] + q.beta[2]) * (1.0f / 3.0f), MIN_EXIT_WEIGHT, &sampler) ||
        !pt_surface_event(&q, &next, next.t))
        return;
    if (to->count == PT_BRANCHES) {
        q.branches = NULL;
        while (pt_step(&q))
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
    const int solid = pt_top(&p->stack);
    const struct pt_coefficients *m = &s->solid[solid].medium.layer[0];
    const int64_t crossed = p->counts->crossed;
    struct boundary b;
    float fresnel, cos_t, passed[3], arrived[3], out[3], outside[3], sum = 0.0f, density = 0.0f, u, near, most = 0.0f;

    if (!f->found || p->stack.count != 1 || f->hit.solid != solid || !(f->hit.t <= f->bound + s->solid[solid].split_mm))
        return PT_SPLIT_NOT;
    if (!prepare_boundary(p, &f->hit, &b) || b.enter || b.after.count > 0 || b.rough || b.flat) {
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
    if (most < MIN_SPLIT || !(density > 0.0f))
        return PT_SPLIT_NOT;
    for (int c = 0; c < 3; c++) {
        outside[c] = p->beta[c] * passed[c] * out[c] * (sum / density);
        f->inverse_stay[c] = 1.0f / fmaxf(1.0f - out[c], MIN_REMAINING);
    }
    trace_exit(p, &f->hit, &b, outside);
    /* Maps the rest of the flight beyond the bound to [0, 1), for the path that stays inside: below 1 - arrived it collides. */
    u = (1.0f - pt_exp(-m->sigma_t[f->channel] * fmaxf(f->length - f->bound, 0.0f))) * (1.0f - out[f->channel]);
    if (u < 1.0f - arrived[f->channel] || !(fresnel > 0.0f)) {
        f->has_hit = false;
        f->length = f->bound - pt_log(fmaxf(1.0f - u, 1e-30f)) * m->mean_free_path[f->channel];
        f->length = fminf(f->length, f->hit.t);
        return PT_SPLIT_COLLIDES;
    }
    density = 0.0f;
    for (int c = 0; c < 3; c++) {
        passed[c] *= arrived[c];
        density += p->beta[c] * passed[c] * f->inverse_stay[c];
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

bool pt_surface_event(struct pt_walk *p, const struct pt_hit *hit, float length)
{
    if (hit->solid >= 0)
        hit_solid(p, hit, length);
    else
        reflect_opaque(p, hit);
    return roulette(p);
}

void pt_escaped(struct pt_walk *p, struct pell_vec3 x)
{
    p->counts->lost++;
    p->x = p->from = x;
    p->stack.count = 0;
    p->last = PT_LAST_NONE;
    p->leaving = false;
    p->crossed = true;
}

void pt_count_cut(struct pt_counts *counts, const float beta[3])
{
    counts->cut++;
    counts->cut_weight += (double) (beta[0] + beta[1] + beta[2]) / 3.0;
}

bool pt_step(struct pt_walk *p)
{
    const struct pt_scene *s = p->s;
    const int solid = pt_top(&p->stack);
    const struct pt_ray ray = { p->x, p->from, p->w };
    struct pt_free_path free_path;

    if (p->events % CHECK_INTERVAL == 0 && pt_stopped(s))
        return false;
    if (p->events++ >= s->knobs.events) {
        pt_count_cut(p->counts, p->beta);
        return false;
    }
    if (solid < 0) {
        struct pt_hit hit;
        const bool has_hit = pt_intersect(s, p->counts, p->from, p->w, INFINITY, PELL_RAY_ALL, &hit);
        hit_lights(p, has_hit ? (double) hit.t : INFINITY);
        return has_hit && pt_bounce_allowed(s, ++p->bounces) && pt_surface_event(p, &hit, hit.t);
    }
    if (p->branches && s->solid[solid].split_mm > 0.0f) {
        struct pt_flight flight = { .lookahead = s->solid[solid].split_mm };
        pt_sample_flight(s, p->counts, solid, &ray, p->beta, &p->safe, p->sampler, &flight);
        if (pt_split(p, &flight) == PT_SPLIT_REFLECTS)
            return roulette(p);
        pt_end_flight(s, solid, &ray, &flight, p->beta, &free_path);
    } else {
        pt_sample_distance(s, p->counts, solid, &ray, p->beta, &p->safe, p->sampler, &free_path);
    }
    if (free_path.has_hit)
        return pt_surface_event(p, &free_path.hit, free_path.length);
    if (free_path.lost) {
        pt_escaped(p, free_path.x);
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
    pt_scattering_event(p, &at, solid, PT_CONNECTION_UNDECIDED);
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
                         .all_specular = true,
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
    if (!prepare_boundary(&p, hit, &b)) /* impossible: the camera is in no solid yet */
        return 0;
    walker->counts.crossed = crossed; /* a camera inside a solid crosses no surface */
    p.entered = b.before.count > 0;
    for (int reflected = 0; reflected < (b.rough ? 1 : 2); reflected++) {
        struct pt_walk *q = &walks[count];
        float fresnel, cos_t, fraction;
        /* Independent random numbers: the refracted path does not depend on the reflected one. */
        sampler[count] = pt_sampler_start(s->seed, point->pixel, sample, reflected ? 2 : 0);
        if (!reflected)
            p.selection = pell_unit_float(pell_hash(sampler[0].pattern ^ pell_sobol0(sample)));
        *q = p;
        q->sampler = &sampler[count];
        q->out = &out[count];
        if (b.rough) {
            rough_boundary(q, hit, &b, 0.0f);
            q->entered = q->entered || q->stack.count > 0;
            return 1;
        }
        fresnel = pt_fresnel(b.eta, vec3_dot(b.at.o, b.at.ns), &cos_t);
        fraction = reflected ? fresnel : 1.0f - fresnel;
        if (!(fraction > 0.0f))
            continue;
        for (int c = 0; c < 3; c++)
            q->beta[c] = fraction;
        smooth_boundary(q, hit, &b, reflected ? -1.0f : 1.0f, 0.0f);
        q->entered = q->entered || !reflected;
        count++;
    }
    return count;
}
