/* SPDX-License-Identifier: MIT
 *
 * equation.c - see equation.h and solid.c. It is solved by GMRES (Y. Saad and M. H. Schultz, "GMRES", SIAM J. Sci. Stat. Comput. 7(3),
 * 1986). A place's share of its own light is what is missing: to the G of a disc as large as the places nearby, and to the solid angle of
 * a closed surface, by which dG/dn of even fluence sums to -1/2 where kappa is 0.
 */
#include "render/indirect/equation.h"
#include "render/indirect/beside.h"

#include "base/base.h"
#include "math/scalar.h"

#include <string.h>

enum { CHUNK = 32, STEPS = 60 };
#define FACING 0.3f    /* least cosine of normals on one surface */
#define SEEN_LOW 0.4f  /* cosine of normals from which on methods see faces together, */
#define SEEN_HIGH 0.9f /* and from which on all of them; */
#define AROUND_LOW -1.0f
#define AROUND_HIGH 1.0f /* the same for methods that spread light along the surface */
#define SPREAD 0.8f      /* of the squared radius of a place's area: nearer, it is not seen as a point */
#define OWN 0.5f         /* of what a disc of its own area returns to a place: the least share, where a large place is beside it */
#define TOLERANCE 1e-6   /* of the residual, over the right side, that is asked for; */
#define ENOUGH 1e-4      /* and that will do after STEPS */
#define TURNED 0.15f     /* dG/dn of a place at itself up to which the surface is taken to be closed, */
#define OPEN 0.3f        /* and from which on it is not */

static uint32_t rows_of(const struct equation *e, int chunk, uint32_t *end)
{
    const uint32_t first = (uint32_t) chunk * CHUNK;

    *end = first + CHUNK < e->places->count ? first + CHUNK : e->places->count;
    return first;
}

static void for_rows(struct equation *e, void (*work)(void *arg, int chunk, int worker), void *arg)
{
    pell_pool_run(e->pool, (int) ((e->places->count + CHUNK - 1) / CHUNK), work, arg);
}

/* --- Which patches a place sees ----------------------------------------------------------------------------------------------------- */

/* Whether a cluster is seen as one from a place. */
static bool is_far(const struct equation *e, const struct cluster *c, const struct place *x)
{
    const struct pell_vec3 d = vec3_sub(c->position, x->position);
    const float far = e->near + c->radius;

    return vec3_dot(d, d) > far * far;
}

/* A row's patches as runs, those of places and of clusters for themselves. */
struct runs {
    struct equation_run open[2], *out; /* out: NULL, they are counted */
    uint32_t count, entries;
};

static void add_run(struct runs *r, bool far, uint32_t first, uint32_t count)
{
    struct equation_run *o = &r->open[far];

    r->entries += count;
    if (o->count && o->first + o->count == first) {
        o->count += count;
        return;
    }
    if (o->count && r->out)
        r->out[r->count] = *o;
    r->count += o->count > 0;
    *o = (struct equation_run) { first, count };
}

static void find_runs(const struct equation *e, uint32_t row, struct runs *r)
{
    const struct places *p = e->places;

    for (uint32_t k = 0; k < p->num_clusters; k++) {
        const struct cluster *c = &p->cluster[k];
        if (is_far(e, c, &p->place[row]))
            add_run(r, true, p->count + k, 1);
        else
            add_run(r, false, c->first, c->end - c->first);
    }
    add_run(r, false, 0, 0);
    add_run(r, true, 0, 0);
}

/* Counts the runs of rows, or once there is room for them puts them there. */
static void find_chunk(void *arg, int chunk, int worker)
{
    struct equation *e = arg;
    uint32_t end;

    (void) worker;
    for (uint32_t i = rows_of(e, chunk, &end); i < end; i++) {
        struct runs r = { .out = e->run ? e->run + e->first_run[i] : NULL };
        find_runs(e, i, &r);
        if (e->run)
            continue;
        e->first_run[i + 1] = r.count;
        e->first_entry[i + 1] = r.entries;
    }
}

static void set_patch(const struct equation *e, uint32_t i, struct pell_vec3 at, struct pell_vec3 normal, float area, float curvature)
{
    const struct equation_patches *p = &e->patches;

    p->x[i] = at.x;
    p->y[i] = at.y;
    p->z[i] = at.z;
    p->nx[i] = normal.x;
    p->ny[i] = normal.y;
    p->nz[i] = normal.z;
    p->area[i] = area;
    for (int c = 0; c < 3; c++) {
        const struct equation_channel *q = &e->channel[c];
        /* What vanishes as far above a ball as above a plane falls faster at its surface. */
        if (q->is)
            q->bend[i] = 1.0f / fminf(fmaxf(1.0f + q->s * curvature, 0.5f), 2.0f);
    }
}

static void set_patches(const struct equation *e)
{
    const struct places *p = e->places;

    for (uint32_t i = 0; i < p->count; i++)
        set_patch(e, i, p->place[i].position, p->place[i].normal, p->place[i].area, p->place[i].curvature);
    for (uint32_t k = 0; k < p->num_clusters; k++)
        set_patch(e, p->count + k, p->cluster[k].position, p->cluster[k].normal, p->cluster[k].area, p->cluster[k].curvature);
}

/* Room for what patches and channels have. */
static enum pell_result make_room(struct equation *e, size_t entries)
{
    const size_t n = e->places->count, patches = n + e->places->num_clusters;
    struct equation_patches *p = &e->patches;
    float **const of_patches[] = { &p->x, &p->y, &p->z, &p->nx, &p->ny, &p->nz, &p->area, &p->wx, &p->wy, &p->wz };
    const size_t channels = (size_t) e->channel[0].is + e->channel[1].is + e->channel[2].is;
    float *value = e->values =
        pell_alloc_array(e->ctx, PELL_COUNT(of_patches) * patches + channels * (3 * patches + entries), sizeof(*value));
    double *number = e->numbers = pell_alloc_array(e->ctx, (STEPS + 1) * n + patches + channels * (4 * n + 3 * patches), sizeof(*number));

    if (!value || !number)
        return PELL_ERR_NOMEM;
    for (size_t i = 0; i < PELL_COUNT(of_patches); i++, value += patches)
        *of_patches[i] = value;
    e->basis = number;
    e->all = e->basis + (STEPS + 1) * n;
    number = e->all + patches;
    for (int c = 0; c < 3; c++) {
        struct equation_channel *q = &e->channel[c];
        if (!q->is)
            continue;
        q->light = number;
        q->source = q->light + patches;
        q->once = q->source + patches;
        q->right = q->once + patches;
        q->phi = q->right + n;
        q->sum = q->phi + n;
        q->here = q->sum + n;
        number = q->here + n;
        q->bend = value;
        q->deep[0] = q->bend + patches;
        q->deep[1] = q->deep[0] + patches;
        q->left = q->deep[1] + patches;
        value = q->left + entries;
    }
    return PELL_OK;
}

enum pell_result equation_make(struct equation *e)
{
    const uint32_t n = e->places->count;
    size_t entries = 0, runs = 0;
    enum pell_result res;

    e->kernels = equation_kernels_tables[pell_simd_best()];
    e->first_run = pell_calloc(e->ctx, (size_t) n + 1, sizeof(*e->first_run));
    e->first_entry = pell_calloc(e->ctx, (size_t) n + 1, sizeof(*e->first_entry));
    if (!e->first_run || !e->first_entry)
        return PELL_ERR_NOMEM;
    for_rows(e, find_chunk, e);
    for (uint32_t i = 0; i < n; i++) {
        entries += e->first_entry[i + 1];
        runs += e->first_run[i + 1];
        e->first_entry[i + 1] = (uint32_t) entries;
        e->first_run[i + 1] = (uint32_t) runs;
    }
    if (!(e->run = pell_alloc_array(e->ctx, runs, sizeof(*e->run))))
        return PELL_ERR_NOMEM;
    for_rows(e, find_chunk, e);
    res = make_room(e, entries);
    if (res == PELL_OK)
        set_patches(e);
    return res;
}

void equation_finish(struct equation *e)
{
    if (!e->ctx)
        return;
    pell_free(e->ctx, e->first_run);
    pell_free(e->ctx, e->first_entry);
    pell_free(e->ctx, e->run);
    pell_free(e->ctx, e->values);
    pell_free(e->ctx, e->numbers);
}

/* --- Its entries ---------------------------------------------------------------------------------------------------------------------- */

/* What a row of a channel sums up. */
struct row {
    uint32_t place;
    float inward; /* the way of its light along its inward normal */
    float pull, below, own, near_pairs, pairs;
    double right, sum;
};

/* Int exp(-kappa r)/(4 pi r) over a disc, from a place above its middle: (exp(-kappa z) - exp(-kappa r'))/(2 kappa), z the distance from
 * its plane, r' from its edge. */
static float disc(float kappa, float area, float above)
{
    return (expf(-kappa * above) - expf(-kappa * sqrtf(area / PELL_PI_F + above * above))) / (2.0f * kappa);
}

/* G from sources right below a place this far away, as deep as those of place i. */
static float shallow(const struct equation_channel *q, uint32_t i, float inward, float apart2)
{
    float sum = 0.0f;

    for (int k = 0; k < 2; k++) {
        const float z = inward * q->deep[k][i], r = sqrtf(fmaxf(apart2 + z * z, q->least2[k]));
        sum += q->share[k] * expf(-q->kappa * r) / (4.0f * PELL_PI_F * r);
    }
    return sum;
}

/* What reaches a place from sources below discs around it. */
static float shallow_disc(const struct equation_channel *q, uint32_t i, float inward, float area)
{
    return q->share[0] * disc(q->kappa, area, inward * q->deep[0][i]) + q->share[1] * disc(q->kappa, area, inward * q->deep[1][i]);
}

/* Share of a face that a method spreads light to. */
static float seen(const struct equation *e, float facing)
{
    return e->around ? ramp(AROUND_LOW, AROUND_HIGH, facing) : ramp(SEEN_LOW, SEEN_HIGH, facing);
}

/* Square of the way along a surface over that of the chord, by the cosine of the angle t that it turns by: of an arc,
 * (t/2)^2/sin^2(t/2), as a series of sin^2(t/2). */
static float along_surface(float facing)
{
    const float h = fminf(fmaxf(0.5f - 0.5f * facing, 0.0f), 1.0f);

    return 1.0f + h * (1.0f / 3.0f + h * (8.0f / 45.0f + h * (4.0f / 35.0f + h * (128.0f / 1575.0f + h * (128.0f / 2079.0f)))));
}

/* Adds a block's entries to the sums; `self`: the entry that is the place itself. */
static void add_block(const struct equation *e, const struct equation_channel *q, const struct equation_block *b, uint32_t first,
                      uint32_t count, uint32_t self, struct row *row)
{
    const double *light = q->light + first, *source = q->source + first;

    for (uint32_t i = 0; i < count; i++) {
        const float share = seen(e, b->facing[i]), r2 = e->around ? b->r2[i] * along_surface(b->facing[i]) : b->r2[i];
        float pair = 0.0f;
        row->right += i == self ? 0.0 : (double) b->below[i] * source[i];
        if (i == self) {
            row->own = b->below[i];
            continue;
        }
        if (share > 0.0f) {
            pair = share * radial_at(&q->radial, r2) * e->patches.area[first + i];
            row->sum += (double) pair * light[i];
            row->pairs += pair;
        }
        if (b->r2[i] < e->window2 && b->facing[i] > FACING) {
            row->pull += b->pull[i];
            row->below += e->patches.area[first + i] * shallow(q, row->place, row->inward, b->apart2[i]);
            row->near_pairs += pair;
        }
    }
}

/* Keeps the patches of a block that are near and look elsewhere. */
static void add_beside(const struct equation *e, const struct equation_block *b, uint32_t first, uint32_t count, uint32_t entry,
                       struct beside *out)
{
    const float reach = BESIDE_REACH * e->places->step;

    for (uint32_t i = 0; i < count && first < e->places->count && out->count < BESIDE_MOST; i++) {
        const float t = 1.0f - b->apart2[i] / (reach * reach);
        if (t > 0.0f && b->facing[i] <= FACING)
            out->patch[out->count++] =
                (struct beside_patch) { .patch = first + i, .entry = entry + i, .weight = t * t, .even = b->even[i] };
    }
}

/* What those of the block that begins at `first` have in a channel. */
static void keep_beside(const struct equation_block *b, uint32_t first, int c, uint32_t before, struct beside *out)
{
    for (uint32_t i = before; i < out->count; i++) {
        out->patch[i].pull[c] = b->pull[out->patch[i].patch - first];
        out->patch[i].below[c] = b->below[out->patch[i].patch - first];
    }
}

/* The area around a place, and of it what methods see; and the integral of dG/dn where nothing is absorbed. */
static void add_areas(const struct equation *e, const struct equation_block *b, uint32_t first, uint32_t count, uint32_t self, float sum[3])
{
    for (uint32_t i = 0; i < count; i++) {
        const float area = e->patches.area[first + i];
        if (i == self)
            continue;
        sum[2] += b->even[i];
        if (b->r2[i] < e->window2 && b->facing[i] > FACING) {
            sum[0] += area;
            sum[1] += seen(e, b->facing[i]) * area;
        }
    }
}

/* What a place has of its own light: what a disc of the places nearby has more than they have. */
static void finish_row(const struct equation *e, struct equation_channel *q, uint32_t i, const struct row *row, const float sum[3],
                       uint32_t self)
{
    const float own = disc(q->kappa, e->patches.area[i], 0.0f);
    const float pull = fmaxf(disc(q->kappa, sum[0], 0.0f) - row->pull, OWN * own);
    const float straight = e->patches.area[i] * shallow(q, i, row->inward, 0.0f);
    const float aside = fmaxf(1.0f - row->own / straight, 0.0f); /* of what starts below the place itself, as its way leads elsewhere */
    const float below = shallow_disc(q, i, row->inward, sum[0]) - row->below - aside * shallow_disc(q, i, row->inward, e->patches.area[i]);
    const float pair = fmaxf(q->window * sum[1] / (PELL_PI_F * e->window2) - row->near_pairs, 0.0f);
    /* Methods that see a part of the profile take it for all. */
    const float pairs = row->pairs + pair;
    float angle = -0.5f - sum[2];

    q->right[i] = (row->right + (double) fmaxf(below, 0.0f) * q->here[i]) * (double) (q->enters / q->s);
    q->sum[i] = pairs > 0.0f ? (row->sum + (double) pair * q->light[i]) * (double) (q->total / pairs) : 0.0;
    /* A closed surface of even fluence: dG/dn sums to -1/2. Where one is open, its own is that of a plane. */
    angle = angle < 0.0f ? angle * (1.0f - ramp(TURNED, OPEN, -angle)) : fminf(angle, 0.5f);
    q->left[self] = q->bend[i] * (0.5f + angle) + pull / q->s;
}

/* Entries of i: kernels from place to place. */
static void fill_row(struct equation *e, uint32_t i)
{
    const struct place *x = &e->places->place[i];
    const struct equation_from from = { x->position.x, x->position.y, x->position.z, x->normal.x,
                                        x->normal.y,   x->normal.z,   e->least2,     SPREAD / PELL_PI_F };
    struct equation_block b;
    struct row row[3] = { { .right = 0.0 } };
    const float inward = -(x->normal.x * e->patches.wx[i] + x->normal.y * e->patches.wy[i] + x->normal.z * e->patches.wz[i]);
    float sum[3] = { x->area, x->area, 0.0f };
    double right[3] = { 0.0 };
    struct beside beside;
    uint32_t at = e->first_entry[i], self = at;

    beside.count = 0;
    for (int c = 0; c < 3; c++) {
        row[c].place = i;
        row[c].inward = inward;
    }
    for (uint32_t r = e->first_run[i]; r < e->first_run[i + 1]; r++)
        for (uint32_t k = 0, count; k < e->run[r].count; k += count, at += count) {
            const uint32_t first = e->run[r].first + k, mine = i - first; /* no entry of the block where i is none */
            const uint32_t before = beside.count;
            count = e->run[r].count - k < EQUATION_BLOCK ? e->run[r].count - k : EQUATION_BLOCK;
            e->kernels->measure(&e->patches, first, count, &from, &b);
            add_areas(e, &b, first, count, mine, sum);
            add_beside(e, &b, first, count, at, &beside);
            if (mine < count)
                self = at + mine;
            for (int c = 0; c < 3; c++) {
                const struct equation_channel *q = &e->channel[c];
                const struct equation_law law = {
                    q->kappa, 1.0f / q->s, q->bend, { q->deep[0], q->deep[1] }, { q->share[0], q->share[1] }, { q->least2[0], q->least2[1] }
                };
                if (!q->is)
                    continue;
                e->kernels->entries(&law, first, count, &b, q->left + at);
                add_block(e, q, &b, first, count, mine, &row[c]);
                keep_beside(&b, first, c, before, &beside);
            }
        }
    equation_beside(e, i, &beside, &sum[2], right);
    for (int c = 0; c < 3; c++)
        row[c].right += right[c];
    for (int c = 0; c < 3; c++)
        if (e->channel[c].is)
            finish_row(e, &e->channel[c], i, &row[c], sum, self);
}

static void fill_chunk(void *arg, int chunk, int worker)
{
    struct equation *e = arg;
    uint32_t end;

    (void) worker;
    for (uint32_t i = rows_of(e, chunk, &end); i < end; i++)
        fill_row(e, i);
}

void equation_fill(struct equation *e)
{
    for_rows(e, fill_chunk, e);
}

/* --- Its solution --------------------------------------------------------------------------------------------------------------------- */

struct product {
    const struct equation *e;
    const struct equation_channel *channel;
    double *to;
};

static void product_chunk(void *arg, int chunk, int worker)
{
    const struct product *p = arg;
    const struct equation *e = p->e;
    uint32_t end;

    (void) worker;
    for (uint32_t i = rows_of(e, chunk, &end); i < end; i++) {
        const float *left = p->channel->left + e->first_entry[i];
        double sum = 0.0;
        for (uint32_t r = e->first_run[i]; r < e->first_run[i + 1]; left += e->run[r++].count)
            sum += e->kernels->product(left, e->all + e->run[r].first, e->run[r].count);
        p->to[i] = sum;
    }
}

void equation_extend(const struct equation *e, double *all)
{
    const struct places *p = e->places;

    for (uint32_t k = 0; k < p->num_clusters; k++) {
        const struct cluster *c = &p->cluster[k];
        double sum = 0.0;
        for (uint32_t j = c->first; j < c->end; j++)
            sum += (double) p->place[j].area * all[j];
        all[p->count + k] = c->area > 0.0f ? sum / (double) c->area : 0.0;
    }
}

/* The left side of the equation. */
static void multiply(struct equation *e, const struct equation_channel *channel, const double *phi, double *to)
{
    struct product p = { e, channel, to };

    memcpy(e->all, phi, e->places->count * sizeof(*phi));
    equation_extend(e, e->all);
    for_rows(e, product_chunk, &p);
}

static double dot(const double *a, const double *b, uint32_t n)
{
    double sum = 0.0;

    for (uint32_t i = 0; i < n; i++)
        sum += a[i] * b[i];
    return sum;
}

/* The last of the basis against those before it: its part along each goes to h, its length behind them. */
static void orthogonalise(const struct equation *e, int last, double *h)
{
    const uint32_t n = e->places->count;
    double *v = e->basis + (size_t) last * n;

    for (int k = 0; k < last; k++) {
        const double *u = e->basis + (size_t) k * n;
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

bool equation_solve(struct equation *e, struct equation_channel *c)
{
    const uint32_t n = e->places->count;
    double h[STEPS][STEPS + 1], turn[STEPS][2], g[STEPS + 1] = { 0.0 };
    double *v = e->basis, whole = 0.0;
    int steps = 0;

    multiply(e, c, c->phi, v);
    for (uint32_t i = 0; i < n; i++) {
        v[i] = c->right[i] - v[i];
        whole += c->right[i] * c->right[i];
    }
    g[0] = sqrt(dot(v, v, n));
    whole = sqrt(whole);
    for (uint32_t i = 0; i < n && g[0] > 0.0; i++)
        v[i] /= g[0];
    while (steps < STEPS && fabs(g[steps]) > TOLERANCE * whole) {
        multiply(e, c, e->basis + (size_t) steps * n, e->basis + (size_t) (steps + 1) * n);
        orthogonalise(e, steps + 1, h[steps]);
        rotate(steps, turn, h[steps], g);
        steps++;
        if (pell_cancelled(e->ctx))
            return false;
    }
    if (!(fabs(g[steps]) <= ENOUGH * whole))
        return false;
    for (int k = steps; k-- > 0;) { /* the triangle h y = g; y takes the place of g */
        for (int j = k + 1; j < steps; j++)
            g[k] -= h[j][k] * g[j];
        g[k] = h[k][k] > 0.0 ? g[k] / h[k][k] : 0.0;
        for (uint32_t i = 0; i < n; i++)
            c->phi[i] += g[k] * e->basis[(size_t) k * n + i];
    }
    return true;
}
