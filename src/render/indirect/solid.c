/* SPDX-License-Identifier: MIT
 *
 * solid.c - diffusion in the solid that there is, in place of a half-space under each place of its surface.
 *
 * What is below a surface in a fold is not a half-space: light takes the way around the air, and the distance across it says too little. In
 * a medium that scatters much the fluence phi obeys (nabla^2 - kappa^2) phi = -q inside and phi + s dphi/dn = 0 on the surface, q the light
 * that enters, where it is scattered first: t mean free paths z along its refracted direction w, with the density exp(-t). Green's third
 * identity with G = exp(-kappa r)/(4 pi r) turns this into an equation on the surface alone (O. D. Kellogg, "Foundations of Potential
 * Theory", 1929, chapter 8):
 *
 *     phi/2 + Int (G/s + dG/dn) phi = Int exp(-t) G(x, y + t z w) q          q = L E/s, so that phi is what leaves
 *
 * kappa is that of transport, w the mean of the light at y, and s = tanh(kappa b)/kappa puts the plane where the fluence would vanish b
 * above a flat surface. Over a ball it stays as high, so that s turns into s/(1 + s H), H the mean curvature. A slab transmits of light at
 * right angles what diffusion in opposed.h says, if L cosh(kappa b) Int exp(-t) sinh(kappa (t z + b)) = amount sinh(kappa (z + b)). A
 * half-space returns L/(1 + s kappa) Int exp(-t (1 + kappa z m)), m = -n.w; what the profile's total has beside that, scattered few times,
 * leaves where it entered.
 *
 * It is solved (equation.c) at places that stand for equal areas, 0.4 diffusion lengths 1/kappa apart, the same for all channels.
 *
 * A method finds M, the sum of the profile over the faces that it sees, over the same sum under even light; or what whole.h says. It keeps
 * its detail: what enters is scaled by phi/M, or what is found. What is beyond LARGEST was transmitted, and is added without detail.
 */
#include "render/indirect/equation.h"
#include "render/indirect/internal.h"
#include "render/indirect/slope.h"

#include "math/scalar.h"

#include <string.h>

enum { SAMPLES = 256, FEWEST = 800, MOST = 4096, FOUND = 64 };
#define STEP 0.4f          /* distance of places over the diffusion length */
#define FINEST 1.2f        /* over the distance of samples */
#define NEAR 6.0f          /* distances of places: beyond, clusters stand for them */
#define REACH 8.0f         /* diffusion lengths that a method looks for light */
#define RESOLVED 0.7f      /* STEP up to which a channel is solved, */
#define UNRESOLVED 1.2f    /* and from which on it is not */
#define DARK 0.02f         /* total of a profile up to which light scatters too seldom for diffusion, */
#define BRIGHT 0.06f       /* and from which on it is; */
#define BRIGHTEST 0.999    /* beyond, nothing is absorbed */
#define LEAST 0.3f         /* distances that places across a thin part are taken to be apart at least */
#define WINDOW 2.5f        /* distances inside which the profile's sum is set right */
#define SMOOTH 1.6f        /* distances over which places are interpolated, */
#define ASIDE 1.5f         /* and that a sample is from its place at most */
#define STRAIGHT 0.93f     /* mean cosine of light that goes down, which is not all straight */
#define LARGEST 1.1f       /* factor of what enters, */
#define LARGEST_WHOLE 3.0f /* and of what is found by methods that ask the whole solid */
#define THIN 2.0f          /* distances of places: thickness up to which a part is not solved, */
#define THICK 4.0f         /* and from which on it is */

#define FEW_PATHS 4.0f  /* mean free paths: the same, where light is scattered too seldom on its way, */
#define MANY_PATHS 6.0f /* and from which on it is not */

/* Mean free paths: the places where light is scattered first stand for others around them. */
static const float blur[2] = { 0.6f, 1.2f };

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

/* Light that goes into a medium is scattered first after t mean free paths with the density exp(-t). Two values of t and their shares
 * stand for it: Gauss and Laguerre's, the farther of them so far that the mean of exp(x t) is 1/(1 - x), as of light that goes straight
 * down where phi grows by exp(x) in a free path. */
static void find_paths(float x, struct equation_channel *q)
{
    const double nearer = 2.0 - sqrt(2.0), right = 1.0 / (1.0 - (double) x);
    double low = 2.0 + sqrt(2.0), high = 12.0;

    for (int i = 0; i < 30; i++) {
        const double farther = 0.5 * (low + high), share = (1.0 - nearer) / (farther - nearer); /* the mean is 1 */
        *((1.0 - share) * exp((double) x * nearer) + share * exp((double) x * farther) < right ? &low : &high) = farther;
    }
    q->path[0] = (float) nearer;
    q->path[1] = (float) low;
    q->share[1] = (float) ((1.0 - nearer) / (low - nearer));
    q->share[0] = 1.0f - q->share[1];
}

/* L, so that light at right angles goes through slabs as `amount` says, whose source is a mean free path deep. */
static float enters_of(const struct pell_opposed *law, int c, const struct equation_channel *q)
{
    const float kappa = law->kappa[c], beyond = law->beyond[c];
    float at = 0.0f;

    for (int k = 0; k < 2; k++)
        at += q->share[k] * sinhf(kappa * (q->path[k] * law->depth[c] + beyond));
    return law->amount[c] * sinhf(kappa * (law->depth[c] + beyond)) / (at * coshf(kappa * beyond));
}

/* The law of a channel, see above. */
static void find_kappa(const struct pell_opposed *law, int c, struct equation_channel *q)
{
    const float beyond = law->kappa[c] * law->beyond[c];

    q->kappa = law->kappa[c];
    q->s = tanhf(beyond) / q->kappa;
    q->depth = law->depth[c];
    find_paths(fminf(STRAIGHT * q->kappa * q->depth, 0.95f), q);
    q->enters = enters_of(law, c, q);
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
    for (int k = 0; k < 2; k++) {
        q->blur2[k] = blur[k] * blur[k] * q->depth * q->depth;
        q->least2[k] = fmaxf(e->least2, q->blur2[k]);
    }
    q->is = q->kappa > 0.0f && q->s > 0.0f && step * q->kappa <= UNRESOLVED;
    if (!q->is)
        return;
    s->solved[c] = (1.0f - ramp(RESOLVED, UNRESOLVED, step * q->kappa)) * ramp(DARK, BRIGHT, q->total);
    q->window = (float) (total * pell_profile_cdf(profile, (double) (WINDOW * step)));
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

/* Light that enters, of each place, and its parts. */
static void find_light(const struct solid *s, int c)
{
    const struct places *p = &s->places;
    double *light = s->equation.channel[c].light, *source = s->equation.channel[c].source, *once = s->equation.channel[c].once;

    memset(light, 0, p->count * sizeof(*light));
    memset(source, 0, p->count * sizeof(*source));
    memset(once, 0, p->count * sizeof(*once));
    for (size_t i = 0; i < p->num_samples; i++)
        if (p->of[i] != PLACES_NONE) {
            light[p->of[i]] += (double) p->sample[i].power[c];
            source[p->of[i]] += (double) s->of_solid->source[i][c];
            once[p->of[i]] += s->of_solid->once ? (double) s->of_solid->once[i][c] : 0.0;
        }
    for (uint32_t i = 0; i < p->count; i++) {
        const double per_area = p->place[i].area > 0.0f ? 1.0 / (double) p->place[i].area : 0.0;
        light[i] *= per_area;
        source[i] *= per_area;
        once[i] *= per_area;
    }
    equation_extend(&s->equation, light);
    equation_extend(&s->equation, source);
    equation_extend(&s->equation, once);
}

/* Ways of patches, and how far along them the sources are: those of the light of samples, and none beyond the far side. */
static enum pell_result find_ways(struct solid *s)
{
    const struct places *p = &s->places;
    const struct equation_patches *to = &s->equation.patches;
    const uint32_t patches = p->count + p->num_clusters;
    float *sum = pell_alloc_array(s->ctx, patches, 3 * sizeof(*sum)), *thickness = sum + patches, *weight = sum + 2 * patches;

    if (!sum)
        return PELL_ERR_NOMEM;
    memset(sum, 0, patches * 3 * sizeof(*sum));
    memset(to->wx, 0, patches * sizeof(*to->wx));
    memset(to->wy, 0, patches * sizeof(*to->wy));
    memset(to->wz, 0, patches * sizeof(*to->wz));
    for (size_t i = 0; i < p->num_samples; i++) {
        const struct pell_lit_place *q = &p->sample[i];
        float light = 0.0f;
        if (p->of[i] == PLACES_NONE)
            continue;
        for (int c = 0; c < 3; c++)
            light += s->of_solid->source[i][c];
        for (int k = 0; k < 2; k++) {
            const uint32_t at = k == 0 ? p->of[i] : p->count + p->place[p->of[i]].cluster;
            to->wx[at] += light * q->way[0];
            to->wy[at] += light * q->way[1];
            to->wz[at] += light * q->way[2];
            sum[at] += light;
            if (s->of_solid->thickness[i] < INFINITY) {
                thickness[at] += q->area * s->of_solid->thickness[i];
                weight[at] += q->area;
            }
        }
    }
    for (uint32_t i = 0; i < patches; i++) {
        const struct pell_vec3 normal = i < p->count ? p->place[i].normal : vec3_normalize(p->cluster[i - p->count].normal);
        const float scale = sum[i] > 0.0f ? 1.0f / sum[i] : 0.0f, thick = weight[i] > 0.0f ? thickness[i] / weight[i] : INFINITY;
        float inward;
        struct pell_vec3 way = vec3_mul(vec3(to->wx[i], to->wy[i], to->wz[i]), scale);
        if (!(vec3_dot(way, way) > 1e-6f))
            way = vec3_mul(normal, -1.0f);
        to->wx[i] = way.x;
        to->wy[i] = way.y;
        to->wz[i] = way.z;
        inward = -vec3_dot(way, normal);
        for (int c = 0; c < 3; c++) {
            struct equation_channel *q = &s->equation.channel[c];
            if (!q->is)
                continue;
            if (i < p->count)
                q->here[i] = (q->light[i] - q->once[i]) / (double) (1.0f + s->of_solid->slope[c] * fmaxf(1.0f - inward, 0.0f));
            for (int k = 0; k < 2; k++) {
                const float within = 1.0f - expf(-thick / fmaxf(q->depth * inward, 1e-6f));
                q->deep[k][i] = -q->depth * logf(1.0f - (1.0f - expf(-q->path[k])) * within);
            }
        }
    }
    pell_free(s->ctx, sum);
    return PELL_OK;
}

/* What the profile has beside diffusion leaves where it entered, as does all that is scattered once. */
static void add_kept(const struct solid *s, float slope, struct equation_channel *q)
{
    const struct places *p = &s->places;
    const struct equation_patches *way = &s->equation.patches;

    for (uint32_t i = 0; i < p->count; i++) {
        const struct pell_vec3 n = p->place[i].normal;
        const float inward = -(way->wx[i] * n.x + way->wy[i] * n.y + way->wz[i] * n.z), depth = q->kappa * q->depth * inward;
        const float leaves =
            q->enters * (q->share[0] * expf(-q->path[0] * depth) + q->share[1] * expf(-q->path[1] * depth)) / (1.0f + q->kappa * q->s);
        q->phi[i] += (double) (q->total - leaves) * q->light[i] + (double) (leaves * slope * (1.0f - inward)) * q->source[i] +
                     (double) leaves * q->once[i];
    }
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

/* Sums over places by their weights, and by those times how far they are along the sample's plane. */
struct around {
    struct pell_vec3 t, b; /* along the plane */
    struct slope_sums at;
    float phi[3][3], sum[3][3];
};

static inline void add_along(float sum[3], float w, float x, float y, float value)
{
    sum[0] += w * value;
    sum[1] += w * x * value;
    sum[2] += w * y * value;
}

/* A sum by sloped weights. */
static inline float sloped(const float sum[3], const float slope[2])
{
    return sum[0] + slope[0] * sum[1] + slope[1] * sum[2];
}

/* What places of a cluster have at a sample. */
static void add_around(const struct solid *s, const struct cluster *cluster, struct pell_vec3 at, struct pell_vec3 normal, struct around *a)
{
    const float wide2 = SMOOTH * SMOOTH * s->places.step * s->places.step;

    for (uint32_t j = cluster->first; j < cluster->end; j++) {
        const struct place *p = &s->places.place[j];
        const struct pell_vec3 d = vec3_sub(p->position, at);
        const float t = fmaxf(1.0f - vec3_dot(d, d) / wide2, 0.0f), w = t * t * fmaxf(vec3_dot(p->normal, normal), 0.0f);
        const float x = vec3_dot(d, a->t), y = vec3_dot(d, a->b);
        if (!(w > 0.0f))
            continue;
        slope_add(&a->at, w, x, y, 0.0f);
        for (int c = 0; c < 3; c++) {
            const struct equation_channel *q = &s->equation.channel[c];
            if (!q->is)
                continue;
            add_along(a->phi[c], w, x, y, (float) q->phi[j]);
            add_along(a->sum[c], w, x, y, (float) q->sum[j]);
        }
    }
}

/* Share of what leaves a sample that a half-space would not return of the light there. */
static float from_the_depth(const struct solid *s, size_t i, int c, float all)
{
    const struct pell_lit_place *p = &s->places.sample[i];

    return all > 0.0f && p->area > 0.0f ? fmaxf(1.0f - s->equation.channel[c].total * p->power[c] / (p->area * all), 0.0f) : 0.0f;
}

/* From the places around to a sample: their middle is there, as in near.c. */
static void hand_to(const struct solid *s, size_t i)
{
    const struct places *p = &s->places;
    const struct pell_vec3 at = vec3_load(p->sample[i].position), normal = vec3_load(p->sample[i].normal);
    const uint32_t own = p->place[p->of[i]].cluster;
    const float largest = s->of_solid->whole ? LARGEST_WHOLE : LARGEST;
    struct around a = { .at = { .one = 0.0f } };
    float slope[2], weight;

    vec3_basis(normal, &a.t, &a.b);
    for (uint32_t k = s->first_near[own]; k < s->first_near[own + 1]; k++) {
        const struct cluster *c = &p->cluster[s->near_by[k]];
        const struct pell_vec3 far = vec3_sub(c->position, at);
        const float within = c->radius + SMOOTH * p->step;
        if (vec3_dot(far, far) <= within * within)
            add_around(s, c, at, normal, &a);
    }
    slope_centre(&a.at, 1.0f / (SMOOTH * p->step), slope);
    weight = a.at.one + slope[0] * a.at.x + slope[1] * a.at.y;
    for (int c = 0; c < 3 && weight > 0.0f; c++) {
        const float phi = fmaxf(sloped(a.phi[c], slope), 0.0f), sum = sloped(a.sum[c], slope);
        const float gain = sum > 0.0f ? fminf(phi / sum, largest) : largest;
        struct indirect_solid_light *out = &s->out[i];
        if (!s->equation.channel[c].is)
            continue;
        out->solved[c] = s->solved[c] * ramp(THIN, THICK, s->of_solid->thickness[i] / p->step) *
                         ramp(FEW_PATHS, MANY_PATHS, s->of_solid->thickness[i] / s->of_solid->law->depth[c]);
        out->gain[c] = gain;
        out->light[c] = fmaxf(phi - gain * sum, 0.0f) / weight;
        out->all[c] = phi / weight;
        out->deep[c] = s->of_solid->whole ? from_the_depth(s, i, c, out->all[c]) : 1.0f;
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

    equation_fill(e);
    if (s->of_solid->whole)
        pell_pool_run(s->pool, (int) ((n + FOUND - 1) / FOUND), find_chunk, s);
    for (int c = 0; c < 3; c++) {
        struct equation_channel *q = &e->channel[c];
        if (!q->is)
            continue;
        memcpy(q->phi, q->sum, n * sizeof(*q->phi));
        q->is = equation_solve(e, q);
        if (q->is)
            add_kept(s, s->of_solid->slope[c], q);
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
    s->equation.around = solid->around;
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
        for (int c = 0; c < 3; c++)
            if (s->equation.channel[c].is)
                find_light(s, c);
        PELL_TRY(find_ways(s));
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
