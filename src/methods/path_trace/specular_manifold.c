/* SPDX-License-Identifier: MIT
 * specular_manifold.c - light of delta lights that reaches a scatterer through a chain of smooth surfaces: internal reflections, paths
 * through several solids, caustics on opaque surfaces.
 *
 * Finitely many directions lead to a point light through a given chain, and a random direction hits none of them. A random seed direction
 * is therefore moved until it hits the light (Newton's method on the direction, with the differentials of the chain). The contribution is
 * divided by the probability of finding that solution; the number of trials until it is found again is an unbiased estimate of the
 * reciprocal (Zeltner, Georgiev and Jakob 2020, "Specular Manifold Sampling for Rendering High-Frequency Caustics and Glints", section
 * 4.2). Neither the basins of the solutions nor their number need to be known; it suffices that each solution has a basin of positive
 * measure. */
#include "methods/path_trace/path.h"

#define MAX_SURFACES 32     /* maximum number of surfaces per chain */
#define RANGE_RATE 0.5      /* the range of chains is exponential, with this rate per optical depth */
#define STEPS 16            /* of Newton's method */
#define MAX_HALVINGS 5      /* per step */
#define MAX_STEP 0.5        /* rad: per step */
#define SAME 1e-6           /* rad: chains of the same type closer than this are identical */
#define CONVERGED 1e-9      /* rad */
#define TRIALS (1 << 20)    /* before a chain is given up */
#define CHECK_INTERVAL 64   /* trials between two checks of the clock */
#define CHAIN_FRACTION 1e-2 /* relative to the typical radiance: weaker chains are subject to Russian roulette */

/* Events along a chain; their sequence is the type of the chain. */
struct kind {
    int count;
    bool transmitted[MAX_SURFACES];
};

struct segment {
    int solid; /* -1: outside */
    struct pell_vec3 x, w;
    float length;
};

struct chain {
    struct kind kind;
    struct segment segment[MAX_SURFACES];
    struct pell_dvec3 w0;           /* from the scatterer */
    struct pell_dvec3 at, w;        /* current point and direction */
    struct pell_dvec3 dp[2], dw[2]; /* derivatives under rotation of w0 about t0, t1 */
    struct pell_vec3 from;          /* ray origin */
    struct pt_medium_stack stack;
    double fraction; /* Fresnel factors */
    float tint[3];   /* of the transmitting boundaries */
    double depth;    /* minimum optical depth */
    bool odd;        /* it contains an event that refractive connections do not handle */
};

/* Data shared by all chains of one query. */
struct query {
    const struct pt_scene *s;
    struct pt_counts *counts;
    const struct pt_scatterer *at;
    const struct pt_medium_stack *here, *beyond; /* medium stacks on both sides of a surface; beyond NULL: the other side is not used */
    struct pell_light_sample source;
    double deepest; /* optical depth */
    bool connected; /* single refractions are found by connections */
};

static void start(const struct query *q, struct pell_dvec3 w0, struct pell_dvec3 t0, struct pell_dvec3 t1, struct chain *c)
{
    const struct pell_vec3 n = q->at->medium ? vec3(0.0f, 0.0f, 0.0f) : q->at->n, w = dvec3_narrow(w0);
    const bool front = !q->beyond || vec3_dot(w, n) > 0.0f;

    c->kind.count = 0;
    c->w0 = c->w = w0;
    c->at = dvec3_widen(q->at->x);
    c->from = vec3_mad(q->at->x, front ? q->at->off : -q->at->off, n);
    c->dp[0] = c->dp[1] = (struct pell_dvec3) { 0.0, 0.0, 0.0 };
    c->dw[0] = t0;
    c->dw[1] = t1;
    c->stack = front ? *q->here : *q->beyond;
    c->fraction = 1.0;
    for (int k = 0; k < 3; k++)
        c->tint[k] = front ? 1.0f : q->at->tint[k];
    c->depth = 0.0;
    c->odd = false;
}

/* The next surface of a solid, up to an optical depth of `deepest`. */
static bool next(const struct query *q, const struct chain *c, double deepest, struct pt_hit *hit)
{
    const int solid = pt_top(&c->stack);
    const float min_sigma_t = solid >= 0 ? q->s->solid[solid].medium.min_sigma_t : 0.0f;
    const double reach = min_sigma_t > 0.0f ? (deepest - c->depth) / (double) min_sigma_t : INFINITY;

    return reach > 0.0 &&
           pt_intersect(q->s, q->counts, c->from, dvec3_narrow(c->w), reach < 1e30 ? (float) reach : INFINITY, PELL_RAY_ALL, hit) &&
           hit->solid >= 0;
}

/* The geometric normal in double precision: the plane must be known to more digits than the tolerance of chains. */
static struct pell_dvec3 plane_of(const struct pt_scene *s, const struct pt_hit *hit, struct pell_dvec3 *corner)
{
    const struct pell_mesh *m = &s->scene->meshes[hit->mesh];
    const uint32_t *i = m->index + 3 * (size_t) hit->triangle;
    const struct pell_dvec3 a = dvec3_widen(vec3_load(m->position + 3 * (size_t) i[0]));
    const struct pell_dvec3 n = dvec3_cross(dvec3_mad(dvec3_widen(vec3_load(m->position + 3 * (size_t) i[1])), -1.0, a),
                                            dvec3_mad(dvec3_widen(vec3_load(m->position + 3 * (size_t) i[2])), -1.0, a));

    *corner = a;
    return dvec3_dot(n, n) > 0.0 ? dvec3_normalize(n) : dvec3_widen(hit->ng);
}

/* Probability that a random chain reflects where both events are possible. */
static double reflection_probability(const struct query *q, const struct chain *c, const struct pt_medium_stack *after, double fresnel)
{
    if (!(fresnel > 1e-7))
        return 0.0;
    if (c->kind.count == 0 && q->connected && after->count == 0)
        return 0.9; /* transmission is found by connections, unless it hits another solid */
    return fmin(fmax(fresnel, 0.2), 0.8);
}

/* Continues at a surface: as `transmitted` says, or at random (NULL). False: impossible. */
static bool interact(const struct query *q, struct chain *c, const struct pt_hit *hit, const bool *transmitted, struct pt_sampler *sampler)
{
    const struct pt_scene *s = q->s;
    const int solid = pt_top(&c->stack);
    const bool enter = vec3_dot(dvec3_narrow(c->w), hit->ng) < 0.0f;
    const double side = enter ? 1.0 : -1.0;
    struct pt_medium_stack before, after;
    struct pell_dvec3 corner, ng = plane_of(s, hit, &corner), ns, dn[2];
    struct segment *segment = &c->segment[c->kind.count];
    double along = dvec3_dot(c->w, ng), t, eta, r, cosine, square, ct = 0.0, fresnel;
    bool passes;
    float ignored;

    if (c->kind.count >= MAX_SURFACES || !((along < 0.0) == enter) || along == 0.0)
        return false;
    t = dvec3_dot(dvec3_mad(corner, -1.0, c->at), ng) / along;
    if (!(t > 0.0))
        return false;
    *segment = (struct segment) { solid, dvec3_narrow(c->at), dvec3_narrow(c->w), (float) t };
    if (solid >= 0)
        c->depth += t * (double) s->solid[solid].medium.min_sigma_t;
    c->at = dvec3_mad(c->at, t, c->w);
    for (int k = 0; k < 2; k++) {
        c->dp[k] = dvec3_mad(c->dp[k], t, c->dw[k]);
        c->dp[k] = dvec3_mad(c->dp[k], -dvec3_dot(c->dp[k], ng) / along, c->w);
    }
    if (!pt_cross(s, &c->stack, hit->solid, enter, &before, &after)) { /* the surface is ignored */
        if (transmitted && !*transmitted)
            return false;
        c->kind.transmitted[c->kind.count++] = true;
        c->from = vec3_mad(dvec3_narrow(c->at), enter ? -hit->epsilon : hit->epsilon, hit->ng);
        c->odd = true;
        return true;
    }
    eta = (double) pt_index(s, pt_top(&after)) / (double) pt_index(s, pt_top(&before));
    if (pt_rough_find(s, hit, (float) (enter ? eta : 1.0 / eta)))
        return false;
    ns = pt_normal_at(s, hit, c->at, c->dp, dn);
    if (!hit->interpolated)
        ns = ng;
    ng = dvec3_mul(ng, side);
    ns = dvec3_mul(ns, side);
    cosine = -dvec3_dot(c->w, ns);
    if (!(cosine > 1e-4)) { /* as on the path */
        ns = ng;
        cosine = -dvec3_dot(c->w, ns);
        dn[0] = dn[1] = (struct pell_dvec3) { 0.0, 0.0, 0.0 };
        c->odd = true;
    }
    dn[0] = dvec3_mul(dn[0], side);
    dn[1] = dvec3_mul(dn[1], side);
    r = 1.0 / eta;
    square = 1.0 - r * r * (1.0 - cosine * cosine);
    fresnel = square > 0.0 ? (double) pt_fresnel((float) eta, (float) cosine, &ignored) : 1.0;
    passes = transmitted ? *transmitted : fresnel < 1.0 && (double) pt_random(sampler) >= reflection_probability(q, c, &after, fresnel);
    if (passes && !(square > 0.0 && fresnel < 1.0))
        return false;
    c->fraction *= passes ? 1.0 - fresnel : fresnel;
    if (passes)
        pt_tint(s, hit, !enter, c->tint); /* light travels in the opposite direction */
    if (passes)
        ct = sqrt(square);
    for (int k = 0; k < 2; k++) {
        const double dc = -(dvec3_dot(c->dw[k], ns) + dvec3_dot(c->w, dn[k]));
        if (passes)
            c->dw[k] = dvec3_mad(dvec3_mad(dvec3_mul(c->dw[k], r), r * dc - r * r * cosine * dc / ct, ns), r * cosine - ct, dn[k]);
        else
            c->dw[k] = dvec3_mad(dvec3_mad(c->dw[k], 2.0 * dc, ns), 2.0 * cosine, dn[k]);
    }
    c->w = passes ? dvec3_mad(dvec3_mul(c->w, r), r * cosine - ct, ns) : dvec3_mad(c->w, 2.0 * cosine, ns);
    if ((dvec3_dot(c->w, ng) < 0.0) != passes) { /* mirrored to its side */
        for (int k = 0; k < 2; k++)
            c->dw[k] = dvec3_mad(c->dw[k], -2.0 * dvec3_dot(c->dw[k], ng), ng);
        c->w = dvec3_mad(c->w, -2.0 * dvec3_dot(c->w, ng), ng);
        c->odd = true;
    }
    c->w = dvec3_normalize(c->w);
    c->stack = passes ? after : before;
    c->from = vec3_mad(dvec3_narrow(c->at), (dvec3_dot(c->w, ng) > 0.0) == (side > 0.0) ? hit->epsilon : -hit->epsilon, hit->ng);
    c->kind.transmitted[c->kind.count++] = passes;
    return true;
}

/* --- Seed chains --------------------------------------------------------------------------------------------------------------------- */

/* Half of the seeds are near the direction of the light, from which refracted light deviates little. */
static struct pell_dvec3 any_direction(const struct query *q, struct pt_sampler *sampler)
{
    const struct pt_scene *s = q->s;
    const double pick = pt_fine(sampler), u = pt_fine(sampler), phi = 2.0 * PELL_PI * pt_fine(sampler);
    const struct pell_dvec3 x = dvec3_widen(q->at->x), to = dvec3_mad(dvec3_widen(s->centre), -1.0, x);
    const double square = dvec3_dot(to, to), r2 = s->radius * s->radius;
    double z = 2.0 * u - 1.0, sine = sqrt(fmax(1.0 - z * z, 0.0));
    struct pell_dvec3 axis = { 0.0, 0.0, 1.0 };
    struct pell_vec3 t, b;

    if (pick < 0.5) {
        axis = dvec3_normalize(q->source.distant ? dvec3_widen(q->source.toward) : dvec3_mad(dvec3_widen(q->source.at), -1.0, x));
        z = 1.0;
        sine = exp(-7.0 * u);
    } else if (q->here->count == 0 && !q->beyond && square > 1.02 * r2) { /* from outside, toward the solids */
        z = 1.0 - u * (1.0 - sqrt(1.0 - r2 / square));
        sine = sqrt(fmax(1.0 - z * z, 0.0));
        axis = dvec3_normalize(to);
    }
    vec3_basis(dvec3_narrow(axis), &t, &b);
    return dvec3_normalize(dvec3_mad(dvec3_mad(dvec3_mul(dvec3_widen(t), sine * cos(phi)), sine * sin(phi), dvec3_widen(b)), z, axis));
}

static void tangents(struct pell_dvec3 w, struct pell_dvec3 *t0, struct pell_dvec3 *t1)
{
    struct pell_vec3 t, b;

    vec3_basis(dvec3_narrow(w), &t, &b);
    *t0 = dvec3_normalize(dvec3_mad(dvec3_widen(t), -dvec3_dot(dvec3_widen(t), w), w));
    *t1 = dvec3_cross(w, *t0);
}

/* Chains that connections find, and chains without surfaces, are useless. */
static bool is_useful(const struct query *q, const struct chain *c)
{
    return c->kind.count > 0 && c->stack.count == 0 && !(q->connected && c->kind.count == 1 && c->kind.transmitted[0] && !c->odd);
}

/* Number of path segments outside with this chain. */
static int bounces_over(const struct query *q, const struct chain *c)
{
    int bounces = q->at->bounces;

    for (int i = 0; i < c->kind.count; i++)
        bounces += c->segment[i].solid < 0;
    return bounces;
}

static bool random_chain(const struct query *q, struct pt_sampler *sampler, struct chain *c)
{
    const double deepest = 1.5 * q->deepest + 0.1; /* seed chains may be longer than the solution */
    const struct pell_dvec3 w = any_direction(q, sampler);
    struct pell_dvec3 t0, t1;

    if (!q->at->medium && !q->beyond && !(vec3_dot(dvec3_narrow(w), q->at->n) > 0.0f))
        return false;
    tangents(w, &t0, &t1);
    start(q, w, t0, t1, c);
    for (;;) {
        struct pt_hit hit;
        const bool has_hit = next(q, c, deepest, &hit), outside = c->kind.count > 0 && c->stack.count == 0;
        if (outside && (!has_hit || pt_random(sampler) < 0.5f))
            return is_useful(q, c);
        if (!has_hit || !interact(q, c, &hit, NULL, sampler))
            return false;
    }
}

/* --- Newton iteration -------------------------------------------------------------------------------------------------------------- */

/* The same type of chain in another direction. */
static bool follow(const struct query *q, const struct kind *kind, struct pell_dvec3 w, struct chain *c)
{
    struct pell_dvec3 t0, t1;

    tangents(w, &t0, &t1);
    start(q, w, t0, t1, c);
    for (int i = 0; i < kind->count; i++) {
        struct pt_hit hit;
        if (!next(q, c, (double) INFINITY, &hit) || !interact(q, c, &hit, &kind->transmitted[i], NULL))
            return false;
    }
    return c->stack.count == 0;
}

/* Direction of the light from the last point of the chain. *distance INFINITY: distant. */
static struct pell_dvec3 aim(const struct query *q, const struct chain *c, double *distance)
{
    struct pell_dvec3 to = dvec3_widen(q->source.toward);

    *distance = INFINITY;
    if (!q->source.distant) {
        to = dvec3_mad(dvec3_widen(q->source.at), -1.0, c->at);
        *distance = sqrt(dvec3_dot(to, to));
    }
    return dvec3_normalize(to);
}

static double miss(const struct query *q, const struct chain *c)
{
    double distance;
    const struct pell_dvec3 off = dvec3_mad(c->w, -1.0, aim(q, c, &distance));

    return sqrt(dvec3_dot(off, off));
}

/* Newton step: the rotation of w0 that would bring c to the light if everything were linear. */
static bool newton(const struct query *q, const struct chain *c, struct pell_dvec3 *by)
{
    struct pell_dvec3 t0, t1, e0, e1;
    double distance, a[2][2], r[2], det, x, y;
    const struct pell_dvec3 v = aim(q, c, &distance);

    if (!(distance > 0.0))
        return false;
    tangents(v, &e0, &e1);
    for (int k = 0; k < 2; k++) {
        struct pell_dvec3 d = c->dw[k];
        if (distance < INFINITY)
            d = dvec3_mad(d, 1.0 / distance, dvec3_mad(c->dp[k], -dvec3_dot(c->dp[k], v), v));
        a[0][k] = dvec3_dot(e0, d);
        a[1][k] = dvec3_dot(e1, d);
    }
    r[0] = -dvec3_dot(e0, c->w);
    r[1] = -dvec3_dot(e1, c->w);
    det = a[0][0] * a[1][1] - a[0][1] * a[1][0];
    x = (r[0] * a[1][1] - r[1] * a[0][1]) / det;
    y = (a[0][0] * r[1] - a[1][0] * r[0]) / det;
    if (!(fabs(x) < 1e9 && fabs(y) < 1e9))
        return false;
    tangents(c->w0, &t0, &t1);
    *by = dvec3_mad(dvec3_mul(t0, x), y, t1);
    return true;
}

/* Iterates from a seed chain to one that hits the light. */
static bool solve(const struct query *q, struct chain *c)
{
    const struct kind kind = c->kind;
    double off = miss(q, c);

    for (int i = 0; i < STEPS; i++) {
        struct chain moved;
        struct pell_dvec3 by;
        double step, most;
        bool better = false;
        if (!newton(q, c, &by))
            return false;
        step = sqrt(dvec3_dot(by, by));
        if (step < CONVERGED)
            return off < 1e-3;
        most = fmin(MAX_STEP / step, 1.0);
        for (int k = 0; k < MAX_HALVINGS && !better; k++, most *= 0.5) {
            better = follow(q, &kind, dvec3_normalize(dvec3_mad(c->w0, most, by)), &moved) &&
                     (miss(q, &moved) < off || (off < 1e-9 && step < 1e-7));
        }
        if (!better)
            return step < 1e-8 && off < 1e-3; /* within rounding errors */
        *c = moved;
        off = miss(q, c);
    }
    return false;
}

static bool is_same(const struct chain *a, const struct chain *b)
{
    const struct pell_dvec3 off = dvec3_mad(a->w0, -1.0, b->w0);

    if (a->kind.count != b->kind.count || dvec3_dot(off, off) > SAME * SAME)
        return false;
    for (int i = 0; i < a->kind.count; i++)
        if (a->kind.transmitted[i] != b->kind.transmitted[i])
            return false;
    return true;
}

/* Contribution of a chain over the probability of its solution. False: none. */
static bool contribution_of(const struct query *q, const struct chain *c, struct pt_sampler *sampler, double out[3])
{
    const struct pell_vec3 w = dvec3_narrow(c->w0), at = dvec3_narrow(c->at);
    double distance, across;
    const struct pell_dvec3 v = aim(q, c, &distance);
    float power[3], values[3];
    struct pell_dvec3 moved[2];

    if (!(c->depth <= q->deepest))
        return false;
    for (int k = 0; k < 2; k++)
        moved[k] = distance < INFINITY ? dvec3_mad(c->dp[k], distance, c->dw[k]) : c->dw[k];
    across = fabs(dvec3_dot(dvec3_cross(moved[0], moved[1]), c->w));
    if (!(across > 1e-30))
        return false;
    pell_light_sampler_power_at(q->s->light_sampler, &q->source, at, power);
    pt_scatter_values(q->at, w, values);
    for (int k = 0; k < 3; k++)
        out[k] = (double) (q->at->beta[k] * values[k] * power[k] * c->tint[k]) * c->fraction /
                 (across * q->source.pdf * exp(-RANGE_RATE * c->depth));
    for (int i = 0; i < c->kind.count; i++) {
        float passed[3];
        if (c->segment[i].solid < 0)
            continue;
        pt_transmittance(q->s, c->segment[i].solid, c->segment[i].x, c->segment[i].w, c->segment[i].length, sampler, passed);
        for (int k = 0; k < 3; k++)
            out[k] *= (double) passed[k];
    }
    return out[0] + out[1] + out[2] > 0.0 &&
           pt_unoccluded(q->s, q->counts, c->from, dvec3_narrow(v), distance < INFINITY ? (float) (distance * (1.0 - 1e-5)) : INFINITY,
                         PELL_RAY_ALL);
}

void pt_specular_manifold(const struct pt_scene *s, struct pt_counts *counts, const struct pt_scatterer *at,
                          const struct pt_medium_stack *here, const struct pt_medium_stack *beyond, float safe,
                          const struct pt_sampler *walk, double sum[3])
{
    struct pt_sampler independent = pt_independent_sampler(walk, 0x9fb21c651e98df25u);
    const int solid = pt_top(here);
    struct query q = { .s = s, .counts = counts, .at = at, .here = here, .beyond = beyond };
    const double least = CHAIN_FRACTION * s->typical;
    struct chain found, again;
    double light[3], most, survival = 1.0;
    int trials = 0;

    q.deepest = -log(pt_fine(&independent)) / RANGE_RATE;
    if (at->medium) {
        const double min_sigma_t = (double) s->solid[solid].medium.min_sigma_t, max_depth = 1.5 * q.deepest + 0.1;
        if (min_sigma_t * (double) safe > max_depth ||
            (s->solid[solid].grid && min_sigma_t * (double) pell_distance_bound(s->distance, solid, at->x) > max_depth))
            return;
    }
    q.connected = !beyond && here->count == 1 && s->solid[solid].connects;
    if (!pt_sample_light(s, at->x, &independent, &q.source) || !q.source.delta)
        return;
    if (!beyond && solid < 0 && !pt_bounce_allowed(s, at->bounces + 1)) /* the first surface would exceed the limit */
        return;
    if (!random_chain(&q, &independent, &found) || !solve(&q, &found) || !is_useful(&q, &found) ||
        !pt_bounce_allowed(s, bounces_over(&q, &found)) || !contribution_of(&q, &found, &independent, light))
        return;
    most = fmax(light[0], fmax(light[1], light[2]));
    if (most < least) {
        survival = most / least;
        if (pt_fine(&independent) >= survival)
            return;
    }
    counts->chains++;
    do {
        if (pt_stopped(s)) /* a million trials take long */
            return;
        if (trials % CHECK_INTERVAL == CHECK_INTERVAL - 1 && s->deadline < (double) INFINITY && pell_seconds() > s->deadline) {
            counts->late++;
            return;
        }
        trials++;
        if (trials == TRIALS) {
            counts->chains_cut++;
            break;
        }
    } while (!random_chain(&q, &independent, &again) || !solve(&q, &again) || !is_same(&found, &again));
    for (int k = 0; k < 3; k++)
        sum[k] += light[k] / survival * trials;
}
