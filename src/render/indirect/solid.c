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
 * It is solved by collocation at places that stand for equal areas, 0.4 diffusion lengths 1/kappa apart, the same for all channels, and by
 * GMRES (Y. Saad and M. H. Schultz, "GMRES", SIAM J. Sci. Stat. Comput. 7(3), 1986). Far places are seen as clusters. A place's share of
 * its own light is what is missing: to the G of a disc as large as the places nearby, and to the solid angle of a closed surface, by which
 * dG/dn of even fluence sums to -1/2 where kappa is 0.
 *
 * A method finds M, the sum of the profile over the faces that it sees, over the same sum under even light; or what whole.h says. It keeps
 * its detail: what enters is scaled by phi/M, or what is found. What is beyond LARGEST was transmitted, and is added without detail.
 */
#include "render/indirect/internal.h"
#include "render/indirect/places.h"

#include "math/scalar.h"

#include <string.h>

enum { CHUNK = 32, SAMPLES = 256, FEWEST = 800, MOST = 4096, STEPS = 60, FOUND = 64 };
#define STEP 0.4f          /* distance of places over the diffusion length */
#define FINEST 1.2f        /* over the distance of samples */
#define NEAR 10.0f         /* distances of places: beyond, clusters stand for them */
#define REACH 8.0f         /* diffusion lengths that a method looks for light */
#define RESOLVED 0.7f      /* STEP up to which a channel is solved, */
#define UNRESOLVED 1.2f    /* and from which on it is not */
#define DARK 0.3f          /* total of a profile up to which light scatters too seldom for diffusion, */
#define BRIGHT 0.6f        /* and from which on it is; */
#define BRIGHTEST 0.999    /* beyond, nothing is absorbed */
#define FACING 0.3f        /* least cosine of normals on one surface */
#define LEAST 0.3f         /* distances that places across a thin part are taken to be apart at least */
#define SEEN_LOW 0.4f      /* cosine of normals from which on methods see faces together, */
#define SEEN_HIGH 0.9f     /* and from which on all of them */
#define SPREAD 0.8f        /* of the squared radius of a place's area: nearer, it is not seen as a point */
#define OWN 0.5f           /* of what a disc of its own area returns to a place: the least share, where a large place is beside it */
#define WINDOW 2.5f        /* distances inside which the profile's sum is set right */
#define SMOOTH 1.6f        /* distances over which places are interpolated */
#define TOLERANCE 1e-7     /* of the residual, over the right side, that is asked for; */
#define ENOUGH 1e-4        /* and that will do after STEPS */
#define LARGEST 1.1f       /* factor of what enters, */
#define LARGEST_WHOLE 3.0f /* and of what is found by methods that ask the whole solid */
#define TURNED 0.15f       /* dG/dn of a place at itself up to which the surface is taken to be closed, */
#define OPEN 0.3f          /* and from which on it is not */
#define THIN 2.0f          /* distances of places: thickness up to which a part is not solved, */
#define THICK 4.0f         /* and from which on it is */

struct solid {
    struct pell_context *ctx;
    struct pell_pool *pool;
    const struct indirect_solid *of_solid;
    struct places places;
    int channel;
    float kappa, s, depth, enters, stays;      /* enters: L; stays: what leaves where it entered, of E */
    float near, window2, least2, share, total; /* share: of the profile inside the window */
    uint32_t *start, *column;                  /* of rows; entries of a row: as many as there are places and more are clusters */
    float *left;                               /* phi's factor, of entries */
    double *vectors;                           /* holds those below */
    double *right, *phi, *sum;                 /* of places; sum: what a method finds */
    double *basis;                             /* STEPS + 1 of them */
    double *all, *light;                       /* with clusters behind the places; light: what enters, W/m^2 */
    struct radial *radial;
    float (*found)[3]; /* of places, by a method that asks the whole solid; NULL: by the profile */
};

/* --- The equation --------------------------------------------------------------------------------------------------------------------- */

static uint32_t rows_of(const struct solid *s, int chunk, uint32_t *end)
{
    const uint32_t first = (uint32_t) chunk * CHUNK;

    *end = first + CHUNK < s->places.count ? first + CHUNK : s->places.count;
    return first;
}

/* Whether a cluster is seen as one from a place. */
static bool is_far(const struct solid *s, const struct cluster *c, const struct place *x)
{
    const struct pell_vec3 d = vec3_sub(c->position, x->position);
    const float far = s->near + c->radius;

    return vec3_dot(d, d) > far * far;
}

static void count_chunk(void *arg, int chunk, int worker)
{
    struct solid *s = arg;
    uint32_t end;

    (void) worker;
    for (uint32_t i = rows_of(s, chunk, &end); i < end; i++) {
        s->start[i + 1] = 0;
        for (uint32_t k = 0; k < s->places.num_clusters; k++)
            s->start[i + 1] +=
                is_far(s, &s->places.cluster[k], &s->places.place[i]) ? 1 : s->places.cluster[k].end - s->places.cluster[k].first;
    }
}

/* What a row sums up. */
struct row {
    const struct place *x;
    uint32_t at;
    float angle, area, pull, below, seen_area, near_pairs, pairs;
    double right, sum;
};

/* Most x are small. */
static float exp_near_0(float x)
{
    return fabsf(x) < 0.25f ? 1.0f + x * (1.0f + x * (0.5f + x * (1.0f / 6.0f + x * (1.0f / 24.0f)))) : expf(x);
}

/* exp(-kappa r)/(4 pi r) */
static float green(float kappa, float r)
{
    return expf(-kappa * r) / (4.0f * PELL_PI_F * r);
}

/* Int exp(-kappa r)/(4 pi r) over a disc, at its middle. */
static float disc(float kappa, float area)
{
    return (1.0f - expf(-kappa * sqrtf(area / PELL_PI_F))) / (2.0f * kappa);
}

/* What light leaves from or enters through: a place or a cluster. */
struct patch {
    struct pell_vec3 position, normal;
    float area, curvature;
};

/* s of a curved surface, over that of a plane: what vanishes as far above a ball as above a plane falls faster at its surface. */
static float bend_of(const struct solid *s, float curvature)
{
    return 1.0f / fminf(fmaxf(1.0f + s->s * curvature, 0.5f), 2.0f);
}

static void add_entry(struct solid *s, struct row *row, const struct patch *y, uint32_t column)
{
    const struct pell_vec3 v = vec3_sub(y->position, row->x->position), deep = vec3_mad(v, -s->depth, y->normal);
    const float r2 = fmaxf(vec3_dot(v, v), fmaxf(s->least2, SPREAD * y->area / PELL_PI_F)), r = sqrtf(r2), G = y->area * green(s->kappa, r);
    const float even = -y->area * vec3_dot(v, y->normal) / (4.0f * PELL_PI_F * r2 * r);
    const float deeper = sqrtf(fmaxf(vec3_dot(deep, deep), s->least2)), below = G * r / deeper * exp_near_0(s->kappa * (r - deeper));
    const float facing = vec3_dot(row->x->normal, y->normal), seen = ramp(SEEN_LOW, SEEN_HIGH, facing);
    const float pair = seen > 0.0f ? seen * radial_at(s->radial, r2) * y->area : 0.0f;
    const uint32_t at = row->at++;

    s->column[at] = column;
    s->left[at] = G / s->s - bend_of(s, y->curvature) * (s->kappa + 1.0f / r) * G * vec3_dot(v, y->normal) / r;
    row->right += (double) below * s->light[column];
    row->sum += (double) pair * s->light[column];
    row->pairs += pair;
    row->angle += even;
    if (r2 < s->window2 && facing > FACING) {
        row->area += y->area;
        row->pull += G;
        row->below += below;
        row->seen_area += seen * y->area;
        row->near_pairs += pair;
    }
}

/* Entries of i: kernels from place to place, and at itself what a disc of the places nearby has more. */
static void fill_row(struct solid *s, uint32_t i)
{
    const struct place *x = &s->places.place[i];
    struct row row = { .x = x, .at = s->start[i], .area = x->area, .seen_area = x->area };
    uint32_t self = row.at;
    float angle, wide, pull, below, pair;

    for (uint32_t k = 0; k < s->places.num_clusters; k++) {
        const struct cluster *c = &s->places.cluster[k];
        if (is_far(s, c, x)) {
            add_entry(s, &row, &(struct patch) { c->position, c->normal, c->area, c->curvature }, s->places.count + k);
            continue;
        }
        for (uint32_t j = c->first; j < c->end; j++) {
            const struct place *p = &s->places.place[j];
            if (j == i)
                self = row.at++;
            else
                add_entry(s, &row, &(struct patch) { p->position, p->normal, p->area, p->curvature }, j);
        }
    }
    s->column[self] = i;
    /* Int exp(-kappa r)/(4 pi r) over a disc is (exp(-kappa z) - exp(-kappa r'))/(2 kappa), z the distance from its plane, r' from its
     * edge. */
    wide = row.area / PELL_PI_F;
    pull = fmaxf(disc(s->kappa, row.area) - row.pull, OWN * disc(s->kappa, x->area));
    below = (expf(-s->kappa * s->depth) - expf(-s->kappa * sqrtf(wide + s->depth * s->depth))) / (2.0f * s->kappa) - row.below;
    s->right[i] = (row.right + (double) fmaxf(below, 0.0f) * s->light[i]) * (double) (s->enters / s->s);
    pair = fmaxf(s->share * row.seen_area / (PELL_PI_F * s->window2) - row.near_pairs, 0.0f);
    /* Methods that see a part of the profile take it for all. */
    row.pairs += pair;
    s->sum[i] = row.pairs > 0.0f ? (row.sum + (double) pair * s->light[i]) * (double) (s->total / row.pairs) : 0.0;
    /* A closed surface of even fluence: dG/dn sums to -1/2. Where one is open, its own is that of a plane. */
    angle = -0.5f - row.angle;
    angle = angle < 0.0f ? angle * (1.0f - ramp(TURNED, OPEN, -angle)) : fminf(angle, 0.5f);
    s->left[self] = bend_of(s, x->curvature) * (0.5f + angle) + pull / s->s;
}

static void fill_chunk(void *arg, int chunk, int worker)
{
    struct solid *s = arg;
    uint32_t end;

    (void) worker;
    for (uint32_t i = rows_of(s, chunk, &end); i < end; i++)
        fill_row(s, i);
}

struct product {
    const struct solid *s;
    double *to;
};

static void product_chunk(void *arg, int chunk, int worker)
{
    const struct product *p = arg;
    const struct solid *s = p->s;
    uint32_t end;

    (void) worker;
    for (uint32_t i = rows_of(s, chunk, &end); i < end; i++) {
        double sum = 0.0;
        for (uint32_t k = s->start[i]; k < s->start[i + 1]; k++)
            sum += (double) s->left[k] * s->all[s->column[k]];
        p->to[i] = sum;
    }
}

/* Puts the means of clusters behind the places. */
static void extend(const struct solid *s, double *all)
{
    for (uint32_t k = 0; k < s->places.num_clusters; k++) {
        const struct cluster *c = &s->places.cluster[k];
        double sum = 0.0;
        for (uint32_t j = c->first; j < c->end; j++)
            sum += (double) s->places.place[j].area * all[j];
        all[s->places.count + k] = c->area > 0.0f ? sum / (double) c->area : 0.0;
    }
}

/* The left side of the equation. */
static void multiply(const struct solid *s, const double *phi, double *to)
{
    struct product p = { s, to };

    memcpy(s->all, phi, s->places.count * sizeof(*phi));
    extend(s, s->all);
    pell_pool_run(s->pool, (int) ((s->places.count + CHUNK - 1) / CHUNK), product_chunk, &p);
}

static double dot(const double *a, const double *b, uint32_t n)
{
    double sum = 0.0;

    for (uint32_t i = 0; i < n; i++)
        sum += a[i] * b[i];
    return sum;
}

/* The last of the basis against those before it: its part along each goes to h, its length behind them. */
static void orthogonalise(const struct solid *s, int last, double *h)
{
    const uint32_t n = s->places.count;
    double *v = s->basis + (size_t) last * n;

    for (int k = 0; k < last; k++) {
        const double *u = s->basis + (size_t) k * n;
        h[k] = dot(u, v, n);
        for (uint32_t i = 0; i < n; i++)
            v[i] -= h[k] * u[i];
    }
    h[last] = sqrt(dot(v, v, n));
    for (uint32_t i = 0; i < n && h[last] > 0.0; i++)
        v[i] /= h[last];
}

/* Turns the column h by the rotations so far and by one that makes its last entry 0, and the residual g with it. */
static void rotate(int step, double (*turn)[2], double *h, double *g)
{
    double length;

    for (int k = 0; k < step; k++) {
        const double a = h[k], b = h[k + 1];
        h[k] = turn[k][0] * a + turn[k][1] * b;
        h[k + 1] = turn[k][0] * b - turn[k][1] * a;
    }
    length = hypot(h[step], h[step + 1]);
    turn[step][0] = length > 0.0 ? h[step] / length : 1.0;
    turn[step][1] = length > 0.0 ? h[step + 1] / length : 0.0;
    h[step] = length;
    g[step + 1] = -turn[step][1] * g[step];
    g[step] *= turn[step][0];
}

/* phi, from what it is set to. False where it does not converge. */
static bool solve(struct solid *s)
{
    const uint32_t n = s->places.count;
    double h[STEPS][STEPS + 1], turn[STEPS][2], g[STEPS + 1] = { 0.0 };
    double *v = s->basis, whole = 0.0;
    int steps = 0;

    multiply(s, s->phi, v);
    for (uint32_t i = 0; i < n; i++) {
        v[i] = s->right[i] - v[i];
        whole += s->right[i] * s->right[i];
    }
    g[0] = sqrt(dot(v, v, n));
    whole = sqrt(whole);
    for (uint32_t i = 0; i < n && g[0] > 0.0; i++)
        v[i] /= g[0];
    while (steps < STEPS && fabs(g[steps]) > TOLERANCE * whole) {
        multiply(s, s->basis + (size_t) steps * n, s->basis + (size_t) (steps + 1) * n);
        orthogonalise(s, steps + 1, h[steps]);
        rotate(steps, turn, h[steps], g);
        steps++;
        if (pell_cancelled(s->ctx))
            return false;
    }
    if (!(fabs(g[steps]) <= ENOUGH * whole))
        return false;
    for (int k = steps; k-- > 0;) { /* the triangle h y = g; y takes the place of g */
        for (int j = k + 1; j < steps; j++)
            g[k] -= h[j][k] * g[j];
        g[k] = h[k][k] > 0.0 ? g[k] / h[k][k] : 0.0;
        for (uint32_t i = 0; i < n; i++)
            s->phi[i] += g[k] * s->basis[(size_t) k * n + i];
    }
    return true;
}

/* --- Of a channel -------------------------------------------------------------------------------------------------------------------- */

/* The law of a channel, see above. */
static void find_kappa(struct solid *s)
{
    const struct pell_opposed *law = s->of_solid->law;
    const int c = s->channel;
    const float beyond = law->kappa[c] * law->beyond[c];

    s->kappa = law->kappa[c];
    s->s = tanhf(beyond) / s->kappa;
    s->depth = law->depth[c];
    s->enters = law->amount[c] / coshf(beyond);
    s->stays = s->total - s->enters * expf(-s->kappa * s->depth) / (1.0f + tanhf(beyond));
}

/* All that depends on a channel's profile. False: it is not solved. */
static bool find_law(struct solid *s, const struct pell_profile *profile)
{
    const double total = pell_profile_total(profile);
    const float step = s->places.step;

    s->total = (float) total;
    if (!(total > (double) DARK && total < BRIGHTEST))
        return false;
    find_kappa(s);
    if (!(s->kappa > 0.0f && s->s > 0.0f) || step * s->kappa > UNRESOLVED)
        return false;
    s->least2 = LEAST * LEAST * step * step;
    s->window2 = WINDOW * WINDOW * step * step;
    s->share = (float) (total * pell_profile_cdf(profile, (double) (WINDOW * step)));
    radial_make(s->radial, profile, 0.1f * step, fmaxf(REACH / s->kappa, s->near));
    return true;
}

/* How far apart places are that resolve every channel, as far as there may be so many. The same for all: colours stay what they are where a
 * part is too thin for them. 0: none can be resolved. */
static float distance_of_places(struct solid *s)
{
    const struct indirect_solid *of = s->of_solid;
    double area = 0.0, least = HUGE_VAL, most = 0.0;
    float step;

    for (size_t i = 0; i < of->count; i++)
        area += (double) of->samples[i].area;
    for (s->channel = 0; s->channel < 3; s->channel++) {
        const double total = pell_profile_total(&of->profile[s->channel]);
        if (!(total > (double) DARK && total < BRIGHTEST) || !(of->law->kappa[s->channel] > 0.0f))
            continue;
        least = fmin(least, 1.0 / (double) of->law->kappa[s->channel]);
        most = fmax(most, 1.0 / (double) of->law->kappa[s->channel]);
    }
    if (!(most > 0.0))
        return 0.0f;
    step = (float) sqrt(area / fmin(fmax(area / pow((double) STEP * least, 2.0), FEWEST), MOST));
    step = fmaxf(step, FINEST * of->spacing);
    return (double) step < (double) UNRESOLVED * most ? step : 0.0f;
}

/* Light that enters, of each place. */
static void find_light(struct solid *s)
{
    const struct places *p = &s->places;

    memset(s->light, 0, p->count * sizeof(*s->light));
    for (size_t i = 0; i < p->num_samples; i++)
        if (p->of[i] != PLACES_NONE)
            s->light[p->of[i]] += (double) p->sample[i].power[s->channel];
    for (uint32_t i = 0; i < p->count; i++)
        s->light[i] = p->place[i].area > 0.0f ? s->light[i] / (double) p->place[i].area : 0.0;
    extend(s, s->light);
}

/* Which place sees which: the same for all channels. */
static enum pell_result make_entries(struct solid *s)
{
    const uint32_t n = s->places.count;
    size_t entries = 0;

    if (!(s->start = pell_calloc(s->ctx, (size_t) n + 1, sizeof(*s->start))))
        return PELL_ERR_NOMEM;
    pell_pool_run(s->pool, (int) ((n + CHUNK - 1) / CHUNK), count_chunk, s);
    for (uint32_t i = 0; i < n; i++) {
        entries += s->start[i + 1];
        s->start[i + 1] = (uint32_t) entries;
    }
    s->column = pell_alloc_array(s->ctx, entries, sizeof(*s->column));
    s->left = pell_alloc_array(s->ctx, entries, sizeof(*s->left));
    s->vectors = pell_alloc_array(s->ctx, n, (7 + STEPS + 1) * sizeof(*s->vectors));
    return s->column && s->left && s->vectors ? PELL_OK : PELL_ERR_NOMEM;
}

struct hand_out {
    const struct solid *s;
    float solved;
    struct indirect_solid_light *out;
};

/* From the places around to a sample. */
static void hand_to(const struct hand_out *h, size_t i)
{
    const struct solid *s = h->s;
    const struct pell_vec3 at = vec3_load(s->places.sample[i].position), normal = vec3_load(s->places.sample[i].normal);
    const float wide2 = SMOOTH * SMOOTH * s->places.step * s->places.step;
    struct indirect_solid_light *out = &h->out[i];
    float phi = 0.0f, sum = 0.0f, weight = 0.0f, gain, largest;

    for (uint32_t k = 0; k < s->places.num_clusters; k++) {
        const struct cluster *c = &s->places.cluster[k];
        const struct pell_vec3 far = vec3_sub(c->position, at);
        const float within = c->radius + SMOOTH * s->places.step;
        if (vec3_dot(far, far) > within * within)
            continue;
        for (uint32_t j = c->first; j < c->end; j++) {
            const struct place *p = &s->places.place[j];
            const struct pell_vec3 d = vec3_sub(p->position, at);
            const float t = fmaxf(1.0f - vec3_dot(d, d) / wide2, 0.0f), w = t * t * fmaxf(vec3_dot(p->normal, normal), 0.0f);
            phi += w * (float) (s->phi[j] + (double) s->stays * s->light[j]);
            sum += w * (float) s->sum[j];
            weight += w;
        }
    }
    if (!(weight > 0.0f))
        return;
    phi = fmaxf(phi, 0.0f);
    largest = s->found ? LARGEST_WHOLE : LARGEST;
    gain = sum > 0.0f ? fminf(phi / sum, largest) : largest;
    out->solved[s->channel] = h->solved * ramp(THIN, THICK, s->of_solid->thickness[i] / s->places.step);
    out->gain[s->channel] = gain;
    out->light[s->channel] = fmaxf(phi - gain * sum, 0.0f) / weight;
}

static void hand_out_chunk(void *arg, int chunk, int worker)
{
    const struct hand_out *h = arg;
    const size_t first = (size_t) chunk * SAMPLES;

    (void) worker;
    for (size_t i = first; i < first + SAMPLES && i < h->s->places.num_samples; i++)
        if (h->s->places.of[i] != PLACES_NONE)
            hand_to(h, i);
}

static void find_chunk(void *arg, int chunk, int worker)
{
    struct solid *s = arg;
    const uint32_t first = (uint32_t) chunk * FOUND;

    (void) worker;
    for (uint32_t i = first; i < first + FOUND && i < s->places.count; i++) {
        float position[3], normal[3];
        vec3_store(s->places.place[i].position, position);
        vec3_store(s->places.place[i].normal, normal);
        indirect_whole_at(s->of_solid->whole, position, normal, s->found[i]);
    }
}

static enum pell_result solve_channel(struct solid *s, const struct pell_profile *profile, struct indirect_solid_light *out)
{
    const uint32_t n = s->places.count;
    struct hand_out h = { .s = s, .out = out };

    if (!find_law(s, profile))
        return PELL_OK;
    s->right = s->vectors;
    s->phi = s->right + n;
    s->sum = s->phi + n;
    s->all = s->sum + n; /* no more clusters than places */
    s->light = s->all + 2 * (size_t) n;
    s->basis = s->light + 2 * (size_t) n;
    find_light(s);
    pell_pool_run(s->pool, (int) ((n + CHUNK - 1) / CHUNK), fill_chunk, s);
    for (uint32_t i = 0; s->found && i < n; i++)
        s->sum[i] = (double) s->found[i][s->channel];
    memcpy(s->phi, s->sum, n * sizeof(*s->phi));
    h.solved = (1.0f - ramp(RESOLVED, UNRESOLVED, s->places.step * s->kappa)) * ramp(DARK, BRIGHT, s->total);
    if (solve(s))
        pell_pool_run(s->pool, (int) ((s->places.num_samples + SAMPLES - 1) / SAMPLES), hand_out_chunk, &h);
    return pell_cancelled(s->ctx) ? PELL_ERR_CANCELLED : PELL_OK;
}

enum pell_result indirect_solid_solve(struct pell_context *ctx, struct pell_pool *pool, const struct indirect_solid *solid,
                                      struct indirect_solid_light *out)
{
    struct solid s = { .ctx = ctx, .pool = pool, .of_solid = solid };
    const float step = distance_of_places(&s);
    enum pell_result res = PELL_ERR_NOMEM;

    memset(out, 0, solid->count * sizeof(*out));
    if (!(step > 0.0f))
        return PELL_OK;
    if (!(s.radial = pell_alloc(ctx, sizeof(*s.radial))))
        goto fail;
    PELL_TRY(indirect_places_create(ctx, pool, solid->samples, solid->count, &s.places));
    PELL_TRY(indirect_places_choose(&s.places, step));
    s.near = NEAR * step;
    if (solid->whole) {
        res = PELL_ERR_NOMEM;
        if (!(s.found = pell_alloc_array(ctx, s.places.count, sizeof(*s.found))))
            goto fail;
        pell_pool_run(pool, (int) ((s.places.count + FOUND - 1) / FOUND), find_chunk, &s);
        res = PELL_OK;
    }
    PELL_TRY(make_entries(&s));
    for (s.channel = 0; s.channel < 3 && res == PELL_OK; s.channel++)
        res = solve_channel(&s, &solid->profile[s.channel], out);

fail:
    indirect_places_finish(&s.places);
    pell_free(ctx, s.radial);
    pell_free(ctx, s.found);
    pell_free(ctx, s.start);
    pell_free(ctx, s.column);
    pell_free(ctx, s.left);
    pell_free(ctx, s.vectors);
    return res;
}
