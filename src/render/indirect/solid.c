/* SPDX-License-Identifier: MIT
 *
 * solid.c - diffusion in the solid that there is, in place of a half-space under each place of its surface.
 *
 * What is below a surface in a fold is not a half-space: light takes the way around the air, and the distance across it says too little. In
 * a medium that scatters much the fluence phi obeys (nabla^2 - kappa^2) phi = -q inside and phi + s dphi/dn = 0 on the surface, q the light
 * that enters and diffuses, from the depth z below where it enters. Green's third identity with G = exp(-kappa r)/(4 pi r) turns this into
 * an equation on the surface alone (O. D. Kellogg, "Foundations of Potential Theory", 1929, chapter 8):
 *
 *     phi/2 + Int (G/s + dG/dn) phi = Int G(x, y - z n) q          q = L E/s, so that phi is what leaves
 *
 * kappa is that of transport, z a mean free path, and s = tanh(kappa b)/kappa puts the plane where the fluence would vanish b above a flat
 * surface. Over a ball it stays as high, so that s turns into s/(1 + s H), H the mean curvature. A slab then transmits what diffusion in
 * opposed.h says, if L = amount/cosh(kappa b). A half-space returns L exp(-kappa z)/(1 + s kappa); what the profile's total has beside
 * that, scattered few times, leaves where it entered.
 *
 * It is solved (equation.c) at places that stand for equal areas, 0.4 diffusion lengths 1/kappa apart, the same for all channels.
 *
 * A method finds M, the sum of the profile over the faces that it sees, over the same sum under even light; or what whole.h says. It keeps
 * its detail: what enters is scaled by phi/M, or what is found. What is beyond LARGEST was transmitted, and is added without detail.
 */
#include "render/indirect/equation.h"
#include "render/indirect/internal.h"

#include "math/scalar.h"

#include <string.h>

enum { SAMPLES = 256, FEWEST = 800, MOST = 4096, FOUND = 64 };
#define STEP 0.4f          /* distance of places over the diffusion length */
#define FINEST 1.2f        /* over the distance of samples */
#define NEAR 6.0f          /* distances of places: beyond, clusters stand for them */
#define REACH 8.0f         /* diffusion lengths that a method looks for light */
#define RESOLVED 0.7f      /* STEP up to which a channel is solved, */
#define UNRESOLVED 1.2f    /* and from which on it is not */
#define DARK 0.3f          /* total of a profile up to which light scatters too seldom for diffusion, */
#define BRIGHT 0.6f        /* and from which on it is; */
#define BRIGHTEST 0.999    /* beyond, nothing is absorbed */
#define LEAST 0.3f         /* distances that places across a thin part are taken to be apart at least */
#define WINDOW 2.5f        /* distances inside which the profile's sum is set right */
#define SMOOTH 1.6f        /* distances over which places are interpolated, */
#define ASIDE 1.5f         /* and that a sample is from its place at most */
#define LARGEST 1.1f       /* factor of what enters, */
#define LARGEST_WHOLE 3.0f /* and of what is found by methods that ask the whole solid */
#define THIN 2.0f          /* distances of places: thickness up to which a part is not solved, */
#define THICK 4.0f         /* and from which on it is */

struct solid {
    struct pell_context *ctx;
    struct pell_pool *pool;
    const struct indirect_solid *of_solid;
    struct places places;
    struct equation equation;
    float solved[3];                /* of channels */
    uint32_t *first_near, *near_by; /* of clusters, and one more: those that samples of theirs are interpolated from */
    struct indirect_solid_light *out;
};

/* --- Of a channel -------------------------------------------------------------------------------------------------------------------- */

/* The law of a channel, see above. */
static void find_kappa(const struct pell_opposed *law, int c, struct equation_channel *q)
{
    const float beyond = law->kappa[c] * law->beyond[c];

    q->kappa = law->kappa[c];
    q->s = tanhf(beyond) / q->kappa;
    q->depth = law->depth[c];
    q->enters = law->amount[c] / coshf(beyond);
    q->stays = q->total - q->enters * expf(-q->kappa * q->depth) / (1.0f + tanhf(beyond));
}

/* All that depends on a channel's profile. */
static void find_law(struct solid *s, int c)
{
    const struct pell_profile *profile = &s->of_solid->profile[c];
    struct equation *e = &s->equation;
    struct equation_channel *q = &e->channel[c];
    const double total = pell_profile_total(profile);
    const float step = s->places.step;

    q->total = (float) total;
    if (!(total > (double) DARK && total < BRIGHTEST))
        return;
    find_kappa(s->of_solid->law, c, q);
    q->is = q->kappa > 0.0f && q->s > 0.0f && step * q->kappa <= UNRESOLVED;
    if (!q->is)
        return;
    s->solved[c] = (1.0f - ramp(RESOLVED, UNRESOLVED, step * q->kappa)) * ramp(DARK, BRIGHT, q->total);
    q->share = (float) (total * pell_profile_cdf(profile, (double) (WINDOW * step)));
    radial_make(&q->radial, profile, 0.1f * step, fmaxf(REACH / q->kappa, e->near));
}

/* How far apart places are that resolve every channel, as far as there may be so many. The same for all: colours stay what they are where a
 * part is too thin for them. 0: none can be resolved. */
static float distance_of_places(const struct indirect_solid *of)
{
    double area = 0.0, least = HUGE_VAL, most = 0.0;
    float step;

    for (size_t i = 0; i < of->count; i++)
        area += (double) of->samples[i].area;
    for (int c = 0; c < 3; c++) {
        const double total = pell_profile_total(&of->profile[c]);
        if (!(total > (double) DARK && total < BRIGHTEST) || !(of->law->kappa[c] > 0.0f))
            continue;
        least = fmin(least, 1.0 / (double) of->law->kappa[c]);
        most = fmax(most, 1.0 / (double) of->law->kappa[c]);
    }
    if (!(most > 0.0))
        return 0.0f;
    step = (float) sqrt(area / fmin(fmax(area / pow((double) STEP * least, 2.0), FEWEST), MOST));
    step = fmaxf(step, FINEST * of->spacing);
    return (double) step < (double) UNRESOLVED * most ? step : 0.0f;
}

/* Light that enters, of each place. */
static void find_light(const struct solid *s, int c)
{
    const struct places *p = &s->places;
    double *light = s->equation.channel[c].light;

    memset(light, 0, p->count * sizeof(*light));
    for (size_t i = 0; i < p->num_samples; i++)
        if (p->of[i] != PLACES_NONE)
            light[p->of[i]] += (double) p->sample[i].power[c];
    for (uint32_t i = 0; i < p->count; i++)
        light[i] = p->place[i].area > 0.0f ? light[i] / (double) p->place[i].area : 0.0;
    equation_extend(&s->equation, light);
}

/* --- Back to the samples -------------------------------------------------------------------------------------------------------------- */

/* Whether samples of places of one cluster may be interpolated from those of the other. */
static bool is_near(const struct solid *s, const struct cluster *a, const struct cluster *b)
{
    const struct pell_vec3 d = vec3_sub(a->position, b->position);
    const float within = a->radius + b->radius + (SMOOTH + ASIDE) * s->places.step;

    return vec3_dot(d, d) <= within * within;
}

static enum pell_result find_near(struct solid *s)
{
    const struct places *p = &s->places;
    size_t count = 0;

    if (!(s->first_near = pell_alloc_array(s->ctx, (size_t) p->num_clusters + 1, sizeof(*s->first_near))))
        return PELL_ERR_NOMEM;
    for (int fill = 0; fill < 2; fill++) {
        count = 0;
        for (uint32_t k = 0; k < p->num_clusters && !pell_cancelled(s->ctx); k++) {
            s->first_near[k] = (uint32_t) count;
            for (uint32_t j = 0; j < p->num_clusters; j++)
                if (is_near(s, &p->cluster[k], &p->cluster[j])) {
                    if (fill)
                        s->near_by[count] = j;
                    count++;
                }
        }
        s->first_near[p->num_clusters] = (uint32_t) count;
        if (!fill && !(s->near_by = pell_alloc_array(s->ctx, count, sizeof(*s->near_by))))
            return PELL_ERR_NOMEM;
    }
    return pell_cancelled(s->ctx) ? PELL_ERR_CANCELLED : PELL_OK;
}

struct around {
    float phi[3], sum[3], weight;
};

/* What places of a cluster have at a sample. */
static void add_around(const struct solid *s, const struct cluster *cluster, struct pell_vec3 at, struct pell_vec3 normal, struct around *a)
{
    const float wide2 = SMOOTH * SMOOTH * s->places.step * s->places.step;

    for (uint32_t j = cluster->first; j < cluster->end; j++) {
        const struct place *p = &s->places.place[j];
        const struct pell_vec3 d = vec3_sub(p->position, at);
        const float t = fmaxf(1.0f - vec3_dot(d, d) / wide2, 0.0f), w = t * t * fmaxf(vec3_dot(p->normal, normal), 0.0f);
        if (!(w > 0.0f))
            continue;
        a->weight += w;
        for (int c = 0; c < 3; c++) {
            const struct equation_channel *q = &s->equation.channel[c];
            if (!q->is)
                continue;
            a->phi[c] += w * (float) (q->phi[j] + (double) q->stays * q->light[j]);
            a->sum[c] += w * (float) q->sum[j];
        }
    }
}

/* From the places around to a sample. */
static void hand_to(const struct solid *s, size_t i)
{
    const struct places *p = &s->places;
    const struct pell_vec3 at = vec3_load(p->sample[i].position), normal = vec3_load(p->sample[i].normal);
    const uint32_t own = p->place[p->of[i]].cluster;
    const float largest = s->of_solid->whole ? LARGEST_WHOLE : LARGEST;
    struct around a = { .weight = 0.0f };

    for (uint32_t k = s->first_near[own]; k < s->first_near[own + 1]; k++) {
        const struct cluster *c = &p->cluster[s->near_by[k]];
        const struct pell_vec3 far = vec3_sub(c->position, at);
        const float within = c->radius + SMOOTH * p->step;
        if (vec3_dot(far, far) <= within * within)
            add_around(s, c, at, normal, &a);
    }
    for (int c = 0; c < 3 && a.weight > 0.0f; c++) {
        const float phi = fmaxf(a.phi[c], 0.0f), gain = a.sum[c] > 0.0f ? fminf(phi / a.sum[c], largest) : largest;
        struct indirect_solid_light *out = &s->out[i];
        if (!s->equation.channel[c].is)
            continue;
        out->solved[c] = s->solved[c] * ramp(THIN, THICK, s->of_solid->thickness[i] / p->step);
        out->gain[c] = gain;
        out->light[c] = fmaxf(phi - gain * a.sum[c], 0.0f) / a.weight;
    }
}

static void hand_out_chunk(void *arg, int chunk, int worker)
{
    const struct solid *s = arg;
    const size_t first = (size_t) chunk * SAMPLES;

    (void) worker;
    for (size_t i = first; i < first + SAMPLES && i < s->places.num_samples; i++)
        if (s->places.of[i] != PLACES_NONE)
            hand_to(s, i);
}

/* --- A solid -------------------------------------------------------------------------------------------------------------------------- */

/* What a method that asks the whole solid finds. */
static void find_chunk(void *arg, int chunk, int worker)
{
    const struct solid *s = arg;
    const uint32_t first = (uint32_t) chunk * FOUND;

    (void) worker;
    for (uint32_t i = first; i < first + FOUND && i < s->places.count; i++) {
        float position[3], normal[3], found[3];
        vec3_store(s->places.place[i].position, position);
        vec3_store(s->places.place[i].normal, normal);
        indirect_whole_at(s->of_solid->whole, position, normal, found);
        for (int c = 0; c < 3; c++)
            if (s->equation.channel[c].is)
                s->equation.channel[c].sum[i] = (double) found[c];
    }
}

/* phi of the channels; those that don't converge are left out. */
static void solve_channels(struct solid *s)
{
    struct equation *e = &s->equation;
    const uint32_t n = s->places.count;

    for (int c = 0; c < 3; c++)
        if (e->channel[c].is)
            find_light(s, c);
    equation_fill(e);
    if (s->of_solid->whole)
        pell_pool_run(s->pool, (int) ((n + FOUND - 1) / FOUND), find_chunk, s);
    for (int c = 0; c < 3; c++) {
        struct equation_channel *q = &e->channel[c];
        if (!q->is)
            continue;
        memcpy(q->phi, q->sum, n * sizeof(*q->phi));
        q->is = equation_solve(e, q);
    }
}

enum pell_result indirect_solid_solve(struct pell_context *ctx, struct pell_pool *pool, const struct indirect_solid *solid,
                                      struct indirect_solid_light *out)
{
    const float step = distance_of_places(solid);
    struct solid *s;
    enum pell_result res = PELL_ERR_NOMEM;

    memset(out, 0, solid->count * sizeof(*out));
    if (!(step > 0.0f))
        return PELL_OK;
    if (!(s = pell_calloc(ctx, 1, sizeof(*s))))
        return PELL_ERR_NOMEM;
    s->ctx = ctx;
    s->pool = pool;
    s->of_solid = solid;
    s->out = out;
    s->equation.ctx = ctx;
    s->equation.pool = pool;
    s->equation.places = &s->places;
    s->equation.near = NEAR * step;
    s->equation.window2 = WINDOW * WINDOW * step * step;
    s->equation.least2 = LEAST * LEAST * step * step;
    PELL_TRY(indirect_places_create(ctx, pool, solid->samples, solid->count, &s->places));
    PELL_TRY(indirect_places_choose(&s->places, step));
    for (int c = 0; c < 3; c++)
        find_law(s, c);
    if (s->equation.channel[0].is || s->equation.channel[1].is || s->equation.channel[2].is) {
        PELL_TRY(equation_make(&s->equation));
        PELL_TRY(find_near(s));
        solve_channels(s);
        pell_pool_run(pool, (int) ((solid->count + SAMPLES - 1) / SAMPLES), hand_out_chunk, s);
    }
    res = pell_cancelled(ctx) ? PELL_ERR_CANCELLED : PELL_OK;

fail:
    equation_finish(&s->equation);
    indirect_places_finish(&s->places);
    pell_free(ctx, s->first_near);
    pell_free(ctx, s->near_by);
    pell_free(ctx, s);
    return res;
}
