/* SPDX-License-Identifier: MIT
 *
 * solid.c - diffusion in the solid that there is, in place of a half-space under each place of its surface.
 *
 * What is below a surface in a fold is not a half-space: light takes the way around the air, and the distance across it says too little. In
 * a medium that scatters much the fluence phi obeys (nabla^2 - kappa^2) phi = 0 inside and phi + s dphi/dn = E on the surface, E the light
 * that enters and diffuses; in these units phi there is what leaves. Green's third identity with G = exp(-kappa r)/(4 pi r) turns this into
 * an equation on the surface alone (O. D. Kellogg, "Foundations of Potential Theory", 1929, chapter 8):
 *
 *     phi/2 + Int (G/s + dG/dn) phi = Int G E/s
 *
 * kappa is that of transport. Of light E0 a half-space returns E/(1 + s kappa), and a slab of the thickness t lets
 * 2 s kappa/(1 + s kappa)^2 exp(-kappa t) E through, if it is thick: s and E/E0 are those that make the one the profile's total a, the
 * other what transport says, C exp(-kappa t) (opposed.h):
 *
 *     s kappa/(1 + s kappa) = C/(2a),     E/E0 = a (1 + s kappa)          E/E0 at most 1
 *
 * It is solved by collocation at places that stand for equal areas, 0.4 diffusion lengths 1/kappa apart, for each channel its own, and by
 * BiCGSTAB (H. A. van der Vorst, "Bi-CGSTAB", SIAM J. Sci. Stat. Comput. 13(2), 1992). Far places are seen as clusters. A place's share of
 * its own light is what is missing: to the G of a disc as large as the places nearby, and to the solid angle of a closed surface, by which
 * dG/dn of even fluence sums to -1/2 where kappa is 0.
 *
 * A method finds M, the sum of the profile over the faces that it sees, over the same sum under even light. It keeps its detail: what
 * enters is scaled by phi/M. What is beyond LARGEST was transmitted, and is added without detail.
 */
#include "render/indirect/internal.h"
#include "render/indirect/places.h"

#include <string.h>

enum { CHUNK = 32, SAMPLES = 256, FEWEST = 800, MOST = 4096, STEPS = 60, TABLE_BITS = 18, TABLE = 4096 };
#define STEP 0.4f       /* distance of places over the diffusion length */
#define FINEST 1.2f     /* over the distance of samples */
#define NEAR 10.0f      /* distances of places: beyond, clusters stand for them */
#define REACH 8.0f      /* diffusion lengths that a method looks for light */
#define RESOLVED 0.7f   /* STEP up to which a channel is solved, */
#define UNRESOLVED 1.2f /* and from which on it is not */
#define DARK 0.25f      /* total of a profile up to which light scatters too seldom for diffusion, */
#define BRIGHT 0.5f     /* and from which on it is; */
#define BRIGHTEST 0.999 /* beyond, nothing is absorbed */
#define FACING 0.3f     /* least cosine of normals on one surface */
#define LEAST 0.3f      /* distances that places across a thin part are taken to be apart at least */
#define SEEN_LOW 0.4f   /* cosine of normals from which on methods see faces together, */
#define SEEN_HIGH 0.9f  /* and from which on all of them */
#define WINDOW 2.5f     /* distances inside which the profile's sum is set right */
#define SMOOTH 1.6f     /* distances over which places are interpolated */
#define TOLERANCE 1e-7
#define LARGEST 1.1f /* factor of what enters */
#define TURNED 0.15f /* dG/dn of a place at itself up to which the surface is taken to be closed, */
#define OPEN 0.3f    /* and from which on it is not */
#define THIN 2.0f    /* distances of places: thickness up to which a part is not solved, */
#define THICK 4.0f   /* and from which on it is */

struct solid {
    struct pell_context *ctx;
    struct pell_pool *pool;
    const struct indirect_solid *of_solid;
    struct places places;
    int channel;
    float kappa, s, enters, near, window2, least2, share, total; /* share: of the profile's total inside the window */
    uint32_t *start, *column;    /* of rows; entries of a row: as many as there are places and more are clusters */
    float *left, *source, *pair; /* of entries: phi's factor, G/s, and the profile as a method sums it */
    double *work, *all;          /* vectors of places; all: with clusters behind the places */
    double *phi, *sum;
    float *table; /* R over the bits of the squared distance */
    uint32_t table_first;
};

static float ramp(float low, float high, float x)
{
    return fminf(fmaxf((x - low) / (high - low), 0.0f), 1.0f);
}

static uint32_t bits_of(float x)
{
    uint32_t bits;

    memcpy(&bits, &x, sizeof(bits));
    return bits;
}

static float look_up(const struct solid *s, float r2)
{
    const uint32_t bits = bits_of(r2), at = bits >> TABLE_BITS;
    const float f = (float) (bits & ((1u << TABLE_BITS) - 1)) * (1.0f / (float) (1u << TABLE_BITS));
    const uint32_t i = at < s->table_first ? 0 : at - s->table_first;

    return i + 1 < TABLE ? s->table[i] + f * (s->table[i + 1] - s->table[i]) : 0.0f;
}

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
    float angle, area, pull, seen_area, pairs, sum;
};

static void add_entry(struct solid *s, struct row *row, struct pell_vec3 position, struct pell_vec3 normal, float area, uint32_t column)
{
    const struct pell_vec3 v = vec3_sub(position, row->x->position);
    const float around = 1.0f / (4.0f * PELL_PI_F), r2 = fmaxf(vec3_dot(v, v), s->least2), r = sqrtf(r2);
    const float even = -around * area * vec3_dot(v, normal) / (r2 * r), fallen = expf(-s->kappa * r);
    const float facing = vec3_dot(row->x->normal, normal), seen = ramp(SEEN_LOW, SEEN_HIGH, facing);
    const uint32_t at = row->at++;

    s->column[at] = column;
    s->source[at] = around * fallen * area / (r * s->s);
    s->left[at] = s->source[at] + (1.0f + s->kappa * r) * fallen * even;
    s->pair[at] = seen > 0.0f ? seen * look_up(s, r2) * area : 0.0f;
    row->sum += s->pair[at];
    row->angle += even;
    if (r2 < s->window2 && facing > FACING) {
        row->area += area;
        row->pull += s->source[at];
        row->seen_area += seen * area;
        row->pairs += s->pair[at];
    }
}

/* Entries of i: kernels from place to place, and at itself what a disc of the places nearby has more. */
static void fill_row(struct solid *s, uint32_t i)
{
    const struct place *x = &s->places.place[i];
    struct row row = { .x = x, .at = s->start[i], .area = x->area, .seen_area = x->area };
    uint32_t self = row.at;
    float angle;

    for (uint32_t k = 0; k < s->places.num_clusters; k++) {
        const struct cluster *c = &s->places.cluster[k];
        if (is_far(s, c, x)) {
            add_entry(s, &row, c->position, c->normal, c->area, s->places.count + k);
            continue;
        }
        for (uint32_t j = c->first; j < c->end; j++) {
            if (j == i)
                self = row.at++;
            else
                add_entry(s, &row, s->places.place[j].position, s->places.place[j].normal, s->places.place[j].area, j);
        }
    }
    s->column[self] = i;
    /* Int exp(-kappa r)/(4 pi r) over a disc is (1 - exp(-kappa radius))/(2 kappa). */
    s->source[self] = fmaxf((1.0f - expf(-s->kappa * sqrtf(row.area / PELL_PI_F))) / (2.0f * s->kappa * s->s) - row.pull, 0.0f);
    s->pair[self] = fmaxf(s->share * row.seen_area / (PELL_PI_F * s->window2) - row.pairs, 0.0f);
    row.sum += s->pair[self];
    /* A closed surface of even fluence: dG/dn sums to -1/2. Where one is open, its own is that of a plane. */
    angle = -0.5f - row.angle;
    angle = angle < 0.0f ? angle * (1.0f - ramp(TURNED, OPEN, -angle)) : fminf(angle, 0.5f);
    s->left[self] = 0.5f + s->source[self] + angle;
    /* Methods that see a part of the profile take it for all. */
    for (uint32_t k = s->start[i]; k < row.at && row.sum > 0.0f; k++)
        s->pair[k] *= s->total / row.sum;
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
    const float *entry;
    const double *from;
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
            sum += (double) p->entry[k] * p->from[s->column[k]];
        p->to[i] = sum;
    }
}

static void multiply(const struct solid *s, const float *entry, const double *from, double *to)
{
    struct product p = { s, entry, s->all, to };

    memcpy(s->all, from, s->places.count * sizeof(*from));
    for (uint32_t k = 0; k < s->places.num_clusters; k++) {
        const struct cluster *c = &s->places.cluster[k];
        double sum = 0.0;
        for (uint32_t j = c->first; j < c->end; j++)
            sum += (double) s->places.place[j].area * from[j];
        s->all[s->places.count + k] = c->area > 0.0f ? sum / (double) c->area : 0.0;
    }

    pell_pool_run(s->pool, (int) ((s->places.count + CHUNK - 1) / CHUNK), product_chunk, &p);
}

static double dot(const double *a, const double *b, uint32_t n)
{
    double sum = 0.0;

    for (uint32_t i = 0; i < n; i++)
        sum += a[i] * b[i];
    return sum;
}

/* phi of `right`, from phi as it is. False where it does not converge. */
static bool solve(struct solid *s, const double *right)
{
    const uint32_t n = s->places.count;
    double *r = s->work, *shadow = r + n, *p = shadow + n, *v = p + n, *t = v + n, *x = s->phi;
    double rho = 1.0, alpha = 1.0, omega = 1.0;
    const double enough = TOLERANCE * TOLERANCE * dot(right, right, n);

    multiply(s, s->left, x, v);
    for (uint32_t i = 0; i < n; i++) {
        r[i] = shadow[i] = right[i] - v[i];
        p[i] = v[i] = 0.0;
    }
    for (int step = 0; step < STEPS; step++) {
        const double next = dot(shadow, r, n), beta = next / rho * (alpha / omega);
        double tt, vs;
        if (dot(r, r, n) <= enough)
            return true;
        rho = next;
        for (uint32_t i = 0; i < n; i++)
            p[i] = r[i] + beta * (p[i] - omega * v[i]);
        multiply(s, s->left, p, v);
        vs = dot(shadow, v, n);
        if (!(fabs(vs) > 0.0) || pell_cancelled(s->ctx))
            return false;
        alpha = rho / vs;
        for (uint32_t i = 0; i < n; i++) {
            x[i] += alpha * p[i];
            r[i] -= alpha * v[i];
        }
        multiply(s, s->left, r, t);
        tt = dot(t, t, n);
        if (!(tt > 0.0))
            return true;
        omega = dot(t, r, n) / tt;
        for (uint32_t i = 0; i < n; i++) {
            x[i] += omega * r[i];
            r[i] -= omega * t[i];
        }
        if (!(fabs(omega) > 0.0))
            return false;
    }
    return false;
}

/* --- Of a channel -------------------------------------------------------------------------------------------------------------------- */

/* kappa, s and `enters` of a profile, see above. */
static void find_kappa(struct solid *s, double total)
{
    const struct pell_opposed *law = s->of_solid->law;
    const int c = s->channel;
    const double k = (double) law->kappa[c], beyond = (double) law->beyond[c];
    const double deep = 2.0 * (double) law->amount[c] * sinh(k * ((double) law->depth[c] + beyond)) * exp(-2.0 * k * beyond);
    const double q = fmin(deep / (2.0 * total), 1.0 - total);

    s->kappa = (float) k;
    s->s = (float) (q / (1.0 - q) / k);
    s->enters = (float) (total / (1.0 - q));
}

/* All that depends on a channel's profile. False: it is not solved. */
static bool find_law(struct solid *s, const struct pell_profile *profile)
{
    const double total = pell_profile_total(profile);
    const float step = s->places.step;
    float farthest;

    s->total = (float) total;
    if (!(total > (double) DARK && total < BRIGHTEST))
        return false;
    find_kappa(s, total);
    if (!(s->kappa > 0.0f && s->s > 0.0f) || step * s->kappa > UNRESOLVED)
        return false;
    s->near = NEAR * step;
    s->least2 = LEAST * LEAST * step * step;
    s->window2 = WINDOW * WINDOW * step * step;
    s->share = (float) (total * pell_profile_cdf(profile, (double) (WINDOW * step)));
    farthest = fmaxf(REACH / s->kappa, s->near);
    s->table_first = bits_of(0.01f * step * step) >> TABLE_BITS;
    for (uint32_t i = 0; i < TABLE; i++) {
        const uint32_t bits = (s->table_first + i) << TABLE_BITS;
        float r2;
        memcpy(&r2, &bits, sizeof(r2));
        s->table[i] = r2 < farthest * farthest ? (float) pell_profile_eval(profile, sqrt((double) r2)) : 0.0f;
    }
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

static enum pell_result make_matrix(struct solid *s)
{
    const int chunks = (int) ((s->places.count + CHUNK - 1) / CHUNK);
    size_t entries = 0;

    if (!(s->start = pell_calloc(s->ctx, (size_t) s->places.count + 1, sizeof(*s->start))))
        return PELL_ERR_NOMEM;
    pell_pool_run(s->pool, chunks, count_chunk, s);
    for (uint32_t i = 0; i < s->places.count; i++) {
        entries += s->start[i + 1];
        s->start[i + 1] = (uint32_t) entries;
    }
    s->column = pell_alloc_array(s->ctx, entries, sizeof(*s->column));
    s->left = pell_alloc_array(s->ctx, entries, sizeof(*s->left));
    s->source = pell_alloc_array(s->ctx, entries, sizeof(*s->source));
    s->pair = pell_alloc_array(s->ctx, entries, sizeof(*s->pair));
    s->work = pell_calloc(s->ctx, s->places.count, 10 * sizeof(*s->work));
    if (!s->column || !s->left || !s->source || !s->pair || !s->work)
        return PELL_ERR_NOMEM;
    s->phi = s->work + 6 * (size_t) s->places.count;
    s->sum = s->phi + s->places.count;
    s->all = s->sum + s->places.count; /* no more clusters than places */
    pell_pool_run(s->pool, chunks, fill_chunk, s);
    return pell_cancelled(s->ctx) ? PELL_ERR_CANCELLED : PELL_OK;
}

static void drop_matrix(struct solid *s)
{
    pell_free(s->ctx, s->start);
    pell_free(s->ctx, s->column);
    pell_free(s->ctx, s->left);
    pell_free(s->ctx, s->source);
    pell_free(s->ctx, s->pair);
    pell_free(s->ctx, s->work);
    s->start = s->column = NULL;
    s->left = s->source = s->pair = NULL;
    s->work = NULL;
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
    float phi = 0.0f, sum = 0.0f, weight = 0.0f, gain;

    for (uint32_t k = s->start[s->places.of[i]]; k < s->start[s->places.of[i] + 1]; k++) {
        const struct place *p = &s->places.place[s->column[k]];
        if (s->column[k] >= s->places.count)
            continue;
        const struct pell_vec3 d = vec3_sub(p->position, at);
        const float t = 1.0f - vec3_dot(d, d) / wide2;
        if (t > 0.0f) {
            const float w = t * t * fmaxf(vec3_dot(p->normal, normal), 0.0f);
            phi += w * (float) s->phi[s->column[k]];
            sum += w * (float) s->sum[s->column[k]];
            weight += w;
        }
    }
    if (!(weight > 0.0f))
        return;
    phi = fmaxf(phi, 0.0f);
    gain = sum > 0.0f ? fminf(phi / sum, LARGEST) : LARGEST;
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

static enum pell_result solve_channel(struct solid *s, const struct pell_profile *profile, struct indirect_solid_light *out)
{
    struct hand_out h = { .s = s, .out = out };
    double *right;
    enum pell_result res;

    if (!find_law(s, profile))
        return PELL_OK;
    PELL_TRY(make_matrix(s));
    right = s->work + 5 * (size_t) s->places.count;
    for (size_t i = 0; i < s->places.num_samples; i++)
        if (s->places.of[i] != PLACES_NONE)
            s->work[s->places.of[i]] += (double) s->places.sample[i].power[s->channel];
    for (uint32_t i = 0; i < s->places.count; i++)
        s->work[i] = s->places.place[i].area > 0.0f ? s->work[i] / (double) s->places.place[i].area : 0.0;
    multiply(s, s->source, s->work, right);
    for (uint32_t i = 0; i < s->places.count; i++)
        right[i] *= (double) s->enters;
    multiply(s, s->pair, s->work, s->sum);
    memcpy(s->phi, s->sum, s->places.count * sizeof(*s->phi));
    h.solved = (1.0f - ramp(RESOLVED, UNRESOLVED, s->places.step * s->kappa)) * ramp(DARK, BRIGHT, s->total);
    if (solve(s, right))
        pell_pool_run(s->pool, (int) ((s->places.num_samples + SAMPLES - 1) / SAMPLES), hand_out_chunk, &h);
    res = pell_cancelled(s->ctx) ? PELL_ERR_CANCELLED : PELL_OK;

fail:
    drop_matrix(s);
    return res;
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
    if (!(s.table = pell_alloc_array(ctx, TABLE, sizeof(*s.table))))
        goto fail;
    PELL_TRY(places_create(ctx, pool, solid->samples, solid->count, &s.places));
    places_choose(&s.places, step);
    for (s.channel = 0; s.channel < 3 && res == PELL_OK; s.channel++)
        res = solve_channel(&s, &solid->profile[s.channel], out);

fail:
    places_finish(&s.places);
    pell_free(ctx, s.table);
    return res;
}
