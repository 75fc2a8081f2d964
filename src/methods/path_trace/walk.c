/* SPDX-License-Identifier: MIT
 * walk.c - paths from the eye.
 *
 * A walk keeps its weight at boundaries (path.h) and loses at collisions what the medium absorbs; below `roulette` it goes on by chance.
 * Lamps are looked for where it scatters (lamps.c, chain.c), paths from lamps are joined there (light.c), and where it leaves it meets
 * lamps by chance. At the pixel's own surface a smooth boundary is split: what it reflects and what enters are both followed. */
#include "methods/path_trace/path.h"

#include <string.h>

/* The last decision before a walk goes through the open: how else could the lamp that it meets have been found? */
enum last { LAST_NONE, LAST_SURFACE, LAST_EXIT };

struct path {
    const struct pt_scene *s;
    struct pt_walker *walker;
    struct pt_sampler *sampler;
    struct pt_light *out;
    struct pell_vec3 x, from, w; /* from: where rays start, x or just off its surface */
    struct pt_place place;
    float beta[3];
    float safe;
    int bounces, scattered;
    bool entered, mixed; /* mixed: something opaque reflected it */
    bool crossed;        /* a surface, since it last scattered */
    bool tight;          /* a smooth surface on every edge between scatterings, since the eye or a rough surface: no path of a lamp can be
                          * joined to it */
    enum last last;
    float density;            /* LAST_SURFACE: of w, per sr */
    struct pell_vec3 surface; /* LAST_SURFACE: where it is */
    bool looked;              /* LAST_SURFACE: lamps but the sky were looked for at exit.from */
    struct pt_exit exit;      /* LAST_EXIT, or looked; before that what is known of it */
    bool leaving;             /* exit.from is the last vertex, with no surface since */
    float turn;               /* see pt_connect_lamps */
};

static void add(struct path *p, const double light[3], int scattered)
{
    double *to = !p->entered ? p->out->surface : scattered == 1 && !p->mixed ? p->out->single : p->out->multiple;

    for (int c = 0; c < 3; c++)
        to[c] += light[c];
}

/* --- In the open ---------------------------------------------------------------------------------------------------------------------- */

/* Lamps that the way through the open meets before `reach`. */
static void meet_lamps(struct path *p, double reach)
{
    const struct pt_scene *s = p->s;
    struct pell_emitter_sample lamp;
    double distance, pdf;
    float radiance[3];
    const struct pell_vec3 from = p->last == LAST_SURFACE ? p->surface : p->last == LAST_EXIT ? p->exit.from.x : p->x;

    if (!(s->knobs.techniques & PT_CHANCE))
        return;
    for (int k = 0; pell_emitters_hit(s->emitters, from, p->x, p->w, reach, k, &lamp, &distance, radiance, &pdf); k++) {
        const double facing = lamp.away ? 1.0 : -(double) vec3_dot(lamp.normal, p->w);
        double met = 0.0, found = 0.0, light[3];
        if (p->last == LAST_SURFACE && p->looked && !lamp.away) {
            met = pt_exit_density(s, &p->exit) * (double) p->density * facing / (distance * distance);
            found = pell_emitters_pdf(s->emitters, p->exit.from.x, &lamp) * pt_rough_looked(s, &p->walker->counts, &p->exit, &lamp);
        } else if (p->last == LAST_SURFACE && (s->knobs.techniques & PT_LAMPS)) {
            met = (double) p->density * (lamp.away ? 1.0 : facing / (distance * distance));
            found = pdf;
        } else if (p->last == LAST_EXIT) {
            met = pt_exit_density(s, &p->exit) * pt_beam(s, &p->exit, distance) * facing;
            found = pdf * pt_exit_looked(s, &p->exit, &lamp);
        }
        for (int c = 0; c < 3; c++)
            light[c] = (double) (p->beta[c] * radiance[c]) * (found > 0.0 ? met / (met + found) : 1.0);
        add(p, light, p->scattered);
    }
}

/* What is looked for at a scatterer in a medium, at something opaque in it, or (body < 0) at something opaque in the open. */
static void scatter_at(struct path *p, const struct pt_scatterer *at, int body)
{
    const struct pt_scene *s = p->s;
    double sum[3] = { 0.0, 0.0, 0.0 };

    p->leaving = false;
    p->tight = p->tight && p->crossed;
    p->crossed = false;
    if (p->tight && s->chains) {
        pt_chains(s, &p->walker->counts, at, &p->place, NULL, 0.0f, p->safe, p->beta, p->sampler, sum);
        add(p, sum, p->scattered);
        memset(sum, 0, sizeof(sum));
    }
    if (body >= 0 && (s->body[body].connects || s->body[body].near) && p->place.count == 1) {
        const float share = p->scattered <= 1 ? 1.0f : s->body[body].share;
        if (s->body[body].connects)
            pt_connect_lamps(s, &p->walker->counts, body, at, p->beta, p->safe, share, &p->turn, p->sampler, sum);
        else
            pt_connect_rough(s, &p->walker->counts, body, at, p->beta, share, &p->turn, p->sampler, sum);
        add(p, sum, p->scattered);
        p->exit.from = *at;
        p->exit.body = body;
        p->exit.share = share;
        memcpy(p->exit.beta, p->beta, sizeof(p->beta));
        p->leaving = true;
    }
    if (p->walker->vertices > 0) {
        memset(sum, 0, sizeof(sum));
        pt_join(s, p->walker, body, at, p->beta, p->sampler, sum);
        add(p, sum, 2);
    }
}

static void reflect_opaque(struct path *p, const struct pt_hit *hit)
{
    const struct pt_scene *s = p->s;
    const int body = pt_top(&p->place);
    const struct pell_vec3 n = vec3_dot(p->w, hit->ng) > 0.0f ? vec3_mul(hit->ng, -1.0f) : hit->ng;
    const struct pt_facing at = { vec3_mul(p->w, -1.0f), n, n, 0 };
    struct pell_vec3 t, b;
    float albedo[3], u, v, r, phi;

    p->mixed = true;
    pt_albedo(s, hit, albedo);
    for (int c = 0; c < 3; c++)
        p->beta[c] *= albedo[c];
    p->safe = 0.0f;
    p->last = LAST_NONE;
    if (body < 0 && (s->knobs.techniques & PT_LAMPS)) {
        double sum[3] = { 0.0, 0.0, 0.0 };
        pt_lamps(s, &p->walker->counts, hit, NULL, &at, 1, false, p->beta, p->sampler, sum);
        add(p, sum, p->scattered);
    }
    const struct pt_scatterer from = { vec3_mad(hit->p, hit->unit, n), p->w, NULL, n, NULL, NULL };
    scatter_at(p, &from, body);
    u = pt_random(p->sampler);
    v = pt_random(p->sampler);
    r = sqrtf(u);
    phi = 2.0f * PELL_PI_F * v;
    vec3_basis(n, &t, &b);
    p->w = vec3_normalize(vec3_add(vec3_add(vec3_mul(t, r * cosf(phi)), vec3_mul(b, r * sinf(phi))), vec3_mul(n, sqrtf(1.0f - u))));
    p->x = hit->p;
    p->from = vec3_mad(hit->p, hit->unit, n);
    if (body < 0) {
        p->last = LAST_SURFACE;
        p->density = fmaxf(vec3_dot(p->w, n), 0.0f) / PELL_PI_F;
        p->surface = hit->p;
        p->looked = false;
    }
}

/* --- Boundaries ------------------------------------------------------------------------------------------------------------------- */

bool pt_smooth(const struct pt_facing *at, float eta, float u, struct pell_vec3 *w, float *fresnel, bool *wrong)
{
    const float c = vec3_dot(at->o, at->ns);
    float cos_t;
    bool through;
    struct pell_vec3 to;

    *fresnel = pt_fresnel(eta, c, &cos_t);
    through = u >= *fresnel;
    to = through ? vec3_mad(vec3_mul(at->o, -1.0f / eta), c / eta - cos_t, at->ns) : vec3_sub(vec3_mul(at->ns, 2.0f * c), at->o);
    to = vec3_normalize(to);
    *w = pt_to_side(to, at->ng, !through);
    *wrong = (vec3_dot(to, at->ng) > 0.0f) == through;
    return through;
}

struct boundary {
    struct pt_facing at;
    struct pt_place before, after;
    const struct pt_rough *rough;
    float eta; /* after / before */
    bool enter, flat;
};

/* False: light notices nothing. */
static bool look(const struct path *p, const struct pt_hit *hit, struct boundary *b)
{
    const float side = vec3_dot(p->w, hit->ng) < 0.0f ? 1.0f : -1.0f;
    float outward;

    b->enter = side > 0.0f;
    if (!pt_cross(p->s, &p->place, hit->body, b->enter, &b->before, &b->after)) {
        p->walker->counts.crossed++;
        return false;
    }
    p->walker->counts.crossed += !b->enter && b->before.count != p->place.count;
    b->eta = pt_index(p->s, pt_top(&b->after)) / pt_index(p->s, pt_top(&b->before));
    outward = b->enter ? b->eta : 1.0f / b->eta;
    b->rough = pt_rough_find(p->s, hit->material, outward);
    b->at = (struct pt_facing){ vec3_mul(p->w, -1.0f), vec3_mul(hit->ns, side), vec3_mul(hit->ng, side), b->enter ? 0 : 1 };
    b->flat = !(vec3_dot(b->at.o, b->at.ns) > 1e-4f);
    if (b->flat)
        b->at.ns = b->at.ng;
    return true;
}

static void go_on(struct path *p, const struct pt_hit *hit, const struct boundary *b, bool through)
{
    p->place = through ? b->after : b->before;
    p->x = hit->p;
    p->from = pt_leave(hit, p->w);
    p->safe = 0.0f;
    p->crossed = true;
    p->entered = p->entered || p->place.count > 0;
}

static void rough_boundary(struct path *p, const struct pt_hit *hit, const struct boundary *b, float length)
{
    const struct pt_scene *s = p->s;
    const int open = b->before.count == 0 ? 1 : b->after.count == 0 ? -1 : 0;
    const bool looked = p->leaving && open < 0 && b->before.count == 1; /* for lamps but the sky, from where the walk scattered */
    const struct pell_vec3 came = p->w;
    bool through;

    if (open != 0 && (s->knobs.techniques & PT_LAMPS)) {
        double sum[3] = { 0.0, 0.0, 0.0 };
        pt_lamps(s, &p->walker->counts, hit, b->rough, &b->at, open, looked, p->beta, p->sampler, sum);
        add(p, sum, p->scattered);
    }
    if (s->chains) {
        const struct pt_scatterer at = { hit->p, came, NULL, b->at.ng, b->rough, &b->at };
        double sum[3] = { 0.0, 0.0, 0.0 };
        pt_chains(s, &p->walker->counts, &at, &b->before, &b->after, hit->unit, 0.0f, p->beta, p->sampler, sum);
        add(p, sum, p->scattered);
    }
    p->tight = true; /* a lamp's path ends at rough surfaces */
    p->w = pt_rough_sample(b->rough, &b->at, p->sampler, &through);
    p->last = LAST_NONE;
    if ((through ? b->after : b->before).count == 0) {
        p->last = LAST_SURFACE;
        p->density = pt_rough_density(b->rough, &b->at, p->w);
        p->surface = hit->p;
        p->looked = looked && through;
        if (p->looked) {
            p->exit.hit = *hit;
            p->exit.w = came;
            p->exit.length = length;
            p->exit.transmit = 1.0f;
        }
    }
    go_on(p, hit, b, through);
}

static void smooth_boundary(struct path *p, const struct pt_hit *hit, const struct boundary *b, float u, float length)
{
    const struct pell_vec3 came = p->w;
    const bool leaving = p->leaving && b->after.count == 0 && b->before.count == 1 && !b->flat;
    float fresnel;
    bool wrong, through = pt_smooth(&b->at, b->eta, u, &p->w, &fresnel, &wrong);

    p->last = LAST_NONE;
    if (leaving && through && !wrong) {
        p->last = LAST_EXIT;
        p->exit.hit = *hit;
        p->exit.w = came;
        p->exit.length = length;
        p->exit.transmit = 1.0f - fresnel;
    }
    go_on(p, hit, b, through);
}

static void meet_body(struct path *p, const struct pt_hit *hit, float length)
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

/* --- Walking ------------------------------------------------------------------------------------------------------------------------- */

static bool roulette(struct path *p)
{
    const float now = (p->beta[0] + p->beta[1] + p->beta[2]) * (1.0f / 3.0f), least = p->s->knobs.roulette;

    if (!(now > 0.0f))
        return false;
    if (now >= least)
        return true;
    if (pt_random(p->sampler) * least >= now)
        return false;
    for (int c = 0; c < 3; c++)
        p->beta[c] *= least / now;
    return true;
}

/* One flight and what is at its end. False: the path is over. */
static bool step(struct path *p)
{
    const struct pt_scene *s = p->s;
    const int body = pt_top(&p->place);
    struct pt_flight flight;

    if (body < 0) {
        struct pt_hit hit;
        const bool met = pt_meet(s, &p->walker->counts, p->from, p->w, INFINITY, PELL_RAY_ALL, &hit);
        meet_lamps(p, met ? (double) hit.t : INFINITY);
        if (!met)
            return false;
        if (hit.body >= 0)
            meet_body(p, &hit, hit.t);
        else
            reflect_opaque(p, &hit);
        return roulette(p);
    }
    pt_fly(s, &p->walker->counts, body, p->x, p->from, p->w, p->beta, &p->safe, p->sampler, &flight);
    if (flight.met) {
        if (flight.hit.body >= 0)
            meet_body(p, &flight.hit, flight.length);
        else
            reflect_opaque(p, &flight.hit);
        return roulette(p);
    }
    if (flight.lost) {
        p->walker->counts.lost++;
        p->x = p->from = flight.x;
        p->place.count = 0;
        p->last = LAST_NONE;
        p->leaving = false;
        p->crossed = true;
        return true;
    }
    p->walker->counts.scatterings++;
    p->scattered++;
    p->x = p->from = flight.x;
    if (!(p->beta[0] + p->beta[1] + p->beta[2] > 0.0f))
        return false;
    const struct pt_scatterer at = { flight.x, p->w, flight.medium, { 0.0f, 0.0f, 0.0f }, NULL, NULL };
    scatter_at(p, &at, body);
    pt_phase_sample(flight.medium, p->w, p->sampler, p->beta, &p->w);
    return roulette(p);
}

static void walk(struct path *p)
{
    struct pt_counts *counts = &p->walker->counts;

    for (;;) {
        if (p->bounces++ >= p->s->knobs.bounces) {
            counts->cut++;
            counts->cut_weight += (double) (p->beta[0] + p->beta[1] + p->beta[2]) / 3.0;
            return;
        }
        if (!step(p))
            return;
    }
}

/* --- The eye ---------------------------------------------------------------------------------------------------------------------- */

/* The surface at the pixel's point: rays from farther and farther back, as the point lies on it to rounding only. */
static bool find(const struct pt_scene *s, struct pt_counts *counts, const struct pt_point *point, struct pt_hit *hit)
{
    const struct pell_vec3 w = vec3_mul(point->toward, -1.0f);
    const float most = fabsf(point->at.x) + fabsf(point->at.y) + fabsf(point->at.z) + point->depth;

    for (float e = 2e-5f; e < 2e-2f; e *= 8.0f) {
        const float back = fminf(e * most, point->depth);
        if (pt_meet(s, counts, vec3_mad(point->at, back, point->toward), w, 2.0f * back, PELL_RAY_TRANSLUCENT, hit) && hit->body >= 0)
            return true;
    }
    return false;
}

static void one(const struct pt_scene *s, struct pt_walker *walker, const struct pt_point *point, const struct pt_hit *hit, uint32_t sample,
                struct pt_light *out)
{
    struct pt_sampler sampler = pt_sampler_start(s->seed, point->pixel, sample, 0);
    struct path p = { .s = s,
                      .walker = walker,
                      .sampler = &sampler,
                      .out = out,
                      .x = hit->p,
                      .w = vec3_mul(point->toward, -1.0f),
                      .beta = { 1.0f, 1.0f, 1.0f },
                      .crossed = true,
                      .tight = true };
    struct boundary b;

    walker->counts.samples++;
    walker->vertices = 0;
    if (s->light_paths) {
        struct pt_sampler light = pt_sampler_start(s->seed, point->pixel, sample, 1);
        pt_light_path(s, walker, &light);
    }
    if (!look(&p, hit, &b)) /* never: the eye is in no body yet */
        return;
    p.bounces = 1;
    p.entered = b.before.count > 0;
    p.turn = pt_unit(pt_hash(sampler.pattern ^ pt_reverse(sample)));
    if (b.rough) {
        rough_boundary(&p, hit, &b, 0.0f);
        walk(&p);
        return;
    }
    for (int through = 0; through < 2; through++) {
        struct pt_sampler apart = pt_sampler_start(s->seed, point->pixel, sample, 2); /* what enters does not depend on what is outside */
        struct path q = p;
        float fresnel, cos_t, share;
        q.sampler = through ? &sampler : &apart;
        fresnel = pt_fresnel(b.eta, vec3_dot(b.at.o, b.at.ns), &cos_t);
        share = through ? 1.0f - fresnel : fresnel;
        if (!(share > 0.0f))
            continue;
        for (int c = 0; c < 3; c++)
            q.beta[c] = share;
        smooth_boundary(&q, hit, &b, through ? 1.0f : -1.0f, 0.0f);
        walk(&q);
    }
}

void pt_trace(const struct pt_scene *s, struct pt_walker *walker, const struct pt_point *point, uint32_t first, int count,
              struct pt_light *out)
{
    struct pt_hit hit;
    const bool there = find(s, &walker->counts, point, &hit);

    memset(out, 0, (size_t) count * sizeof(*out));
    walker->counts.lost += there ? 0 : count;
    for (int i = 0; there && i < count; i++)
        one(s, walker, point, &hit, first + (uint32_t) i, &out[i]);
}
