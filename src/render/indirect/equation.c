/* SPDX-License-Identifier: MIT
 *
 * equation.c - see equation.h and diffusion.c. Solved by GMRES (Y. Saad and M. H. Schultz, "GMRES", SIAM J. Sci. Stat. Comput. 7(3), 1986).
 * The diagonal entry of a point completes the sums over the other elements: to the integral of G over a disc as large as the points nearby,
 * and to the solid angle of a closed surface, for which dG/dn of uniform fluence sums to -1/2 where kappa is 0.
 */
#include "render/indirect/equation.h"
#include "render/indirect/edges.h"

#include "base/base.h"
#include "math/scalar.h"

#include <string.h>

enum { CHUNK = 32, MAX_STEPS = 60 };
#define MIN_FACING 0.3f  /* least cosine of normals on one surface */
#define MIN_RADIUS2 0.8f /* of the squared radius of an element's area: least squared distance at which it is treated as a point */
#define MIN_OWN                                                                                                                            \
    0.5f                 /* least diagonal entry, as a fraction of the disc integral of the point's own area: for points next to a
                              * large one */
#define MILNE 0.7104f    /* mean free paths beyond an open plane at which the fluence would vanish (Milne's problem) */
#define TOLERANCE 1e-5   /* requested residual, relative to the right-hand side, */
#define ACCEPTED 1e-4    /* and the residual that is accepted after MAX_STEPS */
#define CLOSED_MAX 0.15f /* missing solid angle (of 1/2) up to which the surface is taken to be closed, */
#define OPEN_MIN 0.3f    /* and from which it is taken to be open */

static uint32_t rows_of(const struct equation *e, int chunk, uint32_t *end)
{
    const uint32_t first = (uint32_t) chunk * CHUNK;

    *end = first + CHUNK < e->points->count ? first + CHUNK : e->points->count;
    return first;
}

static void for_rows(struct equation *e, void (*work)(void *arg, int chunk, int worker), void *arg)
{
    pell_pool_run(e->pool, (int) ((e->points->count + CHUNK - 1) / CHUNK), work, arg);
}

/* --- Elements in a row ---------------------------------------------------------------------------------------------------------------- */

/* Returns whether a cluster is far enough from a point to be one element. */
static bool is_far(const struct equation *e, const struct cluster *c, const struct collocation_point *x)
{
    const struct pell_vec3 d = vec3_sub(c->position, x->position);
    const float far = e->near + c->radius;

    return vec3_dot(d, d) > far * far;
}

/* Elements of a row as runs, with those of points and of clusters kept separate. */
struct runs {
    struct equation_run current[2], *out; /* out: NULL while runs are only counted */
    uint32_t count, entries;
};

static void add_run(struct runs *r, bool far, uint32_t first, uint32_t count)
{
    struct equation_run *o = &r->current[far];

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
    const struct collocation_points *p = e->points;

    for (uint32_t k = 0; k < p->num_clusters; k++) {
        const struct cluster *c = &p->cluster[k];
        if (is_far(e, c, &p->point[row]))
            add_run(r, true, p->count + k, 1);
        else
            add_run(r, false, c->first, c->end - c->first);
    }
    add_run(r, false, 0, 0);
    add_run(r, true, 0, 0);
}

/* Counts the runs of rows, or stores them once they are allocated. */
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

/* The value of s over its value at a plane. Without reflection inside, the fluence vanishes at the same height above a ball as above a
 * plane, so its slope at the surface is steeper. What internal reflection adds to s does not depend on the shape. */
static float curvature_factor(const struct equation_channel *q, float curvature)
{
    const float open = fminf(q->s, MILNE * q->depth), bent = 1.0f / fminf(fmaxf(1.0f + open * curvature, 0.5f), 2.0f);

    return 1.0f - (1.0f - bent) * open / q->s;
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
        if (q->active)
            q->curvature_factor[i] = curvature_factor(q, curvature);
    }
}

static void set_patches(const struct equation *e)
{
    const struct collocation_points *p = e->points;

    for (uint32_t i = 0; i < p->count; i++)
        set_patch(e, i, p->point[i].position, p->point[i].normal, p->point[i].area, p->point[i].curvature);
    for (uint32_t k = 0; k < p->num_clusters; k++)
        set_patch(e, p->count + k, p->cluster[k].position, p->cluster[k].normal, p->cluster[k].area, p->cluster[k].curvature);
}

/* Allocates the arrays of elements and channels. */
static enum pell_result make_room(struct equation *e, size_t entries)
{
    const size_t n = e->points->count, patches = n + e->points->num_clusters;
    struct equation_patches *p = &e->patches;
    float **const element_arrays[] = { &p->x, &p->y, &p->z, &p->nx, &p->ny, &p->nz, &p->area, &p->wx, &p->wy, &p->wz };
    const size_t channels = (size_t) e->channel[0].active + e->channel[1].active + e->channel[2].active;
    float *floats = e->values =
        pell_alloc_array(e->ctx, PELL_COUNT(element_arrays) * patches + channels * (3 * patches + entries), sizeof(*floats));
    double *doubles = e->numbers =
        pell_alloc_array(e->ctx, (MAX_STEPS + 1) * n + patches + channels * (3 * n + 3 * patches), sizeof(*doubles));

    if (!floats || !doubles)
        return PELL_ERR_NOMEM;
    for (size_t i = 0; i < PELL_COUNT(element_arrays); i++, floats += patches)
        *element_arrays[i] = floats;
    e->basis = doubles;
    e->extended = e->basis + (MAX_STEPS + 1) * n;
    doubles = e->extended + patches;
    for (int c = 0; c < 3; c++) {
        struct equation_channel *q = &e->channel[c];
        if (!q->active)
            continue;
        q->light = doubles;
        q->source = q->light + patches;
        q->single = q->source + patches;
        q->rhs = q->single + patches;
        q->phi = q->rhs + n;
        q->point_source = q->phi + n;
        doubles = q->point_source + n;
        q->curvature_factor = floats;
        q->source_depth[0] = q->curvature_factor + patches;
        q->source_depth[1] = q->source_depth[0] + patches;
        q->matrix = q->source_depth[1] + patches;
        floats = q->matrix + entries;
    }
    return PELL_OK;
}

enum pell_result equation_make(struct equation *e)
{
    const uint32_t n = e->points->count;
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

/* --- Matrix entries ------------------------------------------------------------------------------------------------------------------- */

/* Sums over the elements of a row, the same for all channels. */
struct surroundings {
    float area;          /* mm^2: of the points nearby */
    float double_layer0; /* integral of dG/dn without absorption */
};

/* Sums of a row of one channel. */
struct row {
    uint32_t point;
    float inward; /* component of its light's direction along the inward normal */
    float single_layer, from_sources, own_sources;
    double rhs;
};

/* Int exp(-kappa r)/(4 pi r) over a disc, seen from a point on its axis: (exp(-kappa z) - exp(-kappa r'))/(2 kappa), z the distance to
 * the plane of the disc, r' to its edge. */
static float disc_integral(float kappa, float area, float above)
{
    return (expf(-kappa * above) - expf(-kappa * sqrtf(area / PELL_PI_F + above * above))) / (2.0f * kappa);
}

/* G from sources vertically below a point at this distance, as deep as those of point i. */
static float source_kernel(const struct equation_channel *q, uint32_t i, float inward, float distance2)
{
    float sum = 0.0f;

    for (int k = 0; k < 2; k++) {
        const float z = inward * q->source_depth[k][i], r = sqrtf(fmaxf(distance2 + z * z, q->min_distance2[k]));
        sum += q->path_weight[k] * expf(-q->kappa * r) / (4.0f * PELL_PI_F * r);
    }
    return sum;
}

/* Integral of G over sources below a disc around a point. */
static float source_kernel_disc(const struct equation_channel *q, uint32_t i, float inward, float area)
{
    return q->path_weight[0] * disc_integral(q->kappa, area, inward * q->source_depth[0][i]) +
           q->path_weight[1] * disc_integral(q->kappa, area, inward * q->source_depth[1][i]);
}

/* Adds a block's entries to the sums. `diagonal`: the entry of the point itself. */
static void add_block(const struct equation *e, const struct equation_channel *q, const struct equation_block *b, uint32_t first,
                      uint32_t count, uint32_t diagonal, struct row *row)
{
    const double *source = q->source + first;

    for (uint32_t i = 0; i < count; i++) {
        row->rhs += i == diagonal ? 0.0 : (double) b->from_sources[i] * source[i];
        if (i == diagonal) {
            row->own_sources = b->from_sources[i];
            continue;
        }
        if (b->r2[i] < e->window2 && b->facing[i] > MIN_FACING) {
            row->single_layer += b->single_layer[i];
            row->from_sources += e->patches.area[first + i] * source_kernel(q, row->point, row->inward, b->distance2[i]);
        }
    }
}

/* Collects the elements of a block that are near and face elsewhere. */
static void add_edge_elements(const struct equation *e, const struct equation_block *b, uint32_t first, uint32_t count, uint32_t entry,
                              struct edges *out)
{
    const float reach = EDGE_REACH * e->points->step;

    for (uint32_t i = 0; i < count && first < e->points->count && out->count < EDGE_MOST; i++) {
        const float t = 1.0f - b->distance2[i] / (reach * reach);
        if (t > 0.0f && b->facing[i] <= MIN_FACING)
            out->elements[out->count++] =
                (struct edge_element) { .element = first + i, .entry = entry + i, .weight = t * t, .double_layer0 = b->double_layer0[i] };
    }
}

/* Stores the integrals of one channel with the collected elements of the block that begins at `first`. */
static void keep_edge_values(const struct equation_block *b, uint32_t first, int c, uint32_t before, struct edges *out)
{
    for (uint32_t i = before; i < out->count; i++) {
        out->elements[i].single_layer[c] = b->single_layer[out->elements[i].element - first];
        out->elements[i].from_sources[c] = b->from_sources[out->elements[i].element - first];
    }
}

static void add_surroundings(const struct equation *e, const struct equation_block *b, uint32_t first, uint32_t count, uint32_t diagonal,
                             struct surroundings *around)
{
    for (uint32_t i = 0; i < count; i++) {
        const float area = e->patches.area[first + i];
        if (i == diagonal)
            continue;
        around->double_layer0 += b->double_layer0[i];
        if (b->r2[i] < e->window2 && b->facing[i] > MIN_FACING)
            around->area += area;
    }
}

/* Computes the diagonal entry of a point, which is what a disc of the nearby points exceeds their sum by, and its right-hand side. */
static void finish_row(const struct equation *e, struct equation_channel *q, uint32_t i, const struct row *row,
                       const struct surroundings *around, uint32_t diagonal)
{
    const float own_sources = disc_integral(q->kappa, e->patches.area[i], 0.0f);
    const float single_layer = fmaxf(disc_integral(q->kappa, around->area, 0.0f) - row->single_layer, MIN_OWN * own_sources);
    const float unobstructed = e->patches.area[i] * source_kernel(q, i, row->inward, 0.0f);
    const float moved = fmaxf(1.0f - row->own_sources / unobstructed, 0.0f); /* fraction of the sources below the point that its oblique
                                                                              * light moves elsewhere */
    const float from_sources = source_kernel_disc(q, i, row->inward, around->area) - row->from_sources -
                               moved * source_kernel_disc(q, i, row->inward, e->patches.area[i]);
    float missing = -0.5f - around->double_layer0;

    q->rhs[i] = (row->rhs + (double) fmaxf(from_sources, 0.0f) * q->point_source[i]) * (double) (q->source_scale / q->s);
    /* On a closed surface of uniform fluence dG/dn sums to -1/2. Where the surface is open, the diagonal is that of a plane. */
    missing = missing < 0.0f ? missing * (1.0f - ramp(CLOSED_MAX, OPEN_MIN, -missing)) : fminf(missing, 0.5f);
    q->matrix[diagonal] = q->curvature_factor[i] * (0.5f + missing) + single_layer / q->s;
}

/* Computes the entries of row i. */
static void fill_row(struct equation *e, uint32_t i)
{
    const struct collocation_point *x = &e->points->point[i];
    const struct equation_receiver receiver = { x->position.x, x->position.y, x->position.z,    x->normal.x,
                                                x->normal.y,   x->normal.z,   e->min_distance2, MIN_RADIUS2 / PELL_PI_F };
    struct equation_block b;
    struct row row[3] = { { .rhs = 0.0 } };
    const float inward = -(x->normal.x * e->patches.wx[i] + x->normal.y * e->patches.wy[i] + x->normal.z * e->patches.wz[i]);
    struct surroundings around = { .area = x->area };
    double rhs[3] = { 0.0 };
    struct edges edges;
    uint32_t at = e->first_entry[i], diagonal = at;

    edges.count = 0;
    for (int c = 0; c < 3; c++) {
        row[c].point = i;
        row[c].inward = inward;
    }
    for (uint32_t r = e->first_run[i]; r < e->first_run[i + 1]; r++)
        for (uint32_t k = 0, count; k < e->run[r].count; k += count, at += count) {
            const uint32_t first = e->run[r].first + k, own_entry = i - first; /* index in the block; beyond its end if point i is not in
                                                                                * it */
            const uint32_t before = edges.count;
            count = e->run[r].count - k < EQUATION_BLOCK ? e->run[r].count - k : EQUATION_BLOCK;
            e->kernels->measure(&e->patches, first, count, &receiver, &b);
            add_surroundings(e, &b, first, count, own_entry, &around);
            add_edge_elements(e, &b, first, count, at, &edges);
            if (own_entry < count)
                diagonal = at + own_entry;
            for (int c = 0; c < 3; c++) {
                const struct equation_channel *q = &e->channel[c];
                const struct equation_kernel_params params = { q->kappa,
                                                               1.0f / q->s,
                                                               q->curvature_factor,
                                                               { q->source_depth[0], q->source_depth[1] },
                                                               { q->path_weight[0], q->path_weight[1] },
                                                               { q->min_distance2[0], q->min_distance2[1] } };
                if (!q->active)
                    continue;
                e->kernels->fill(&params, first, count, &b, q->matrix + at);
                add_block(e, q, &b, first, count, own_entry, &row[c]);
                keep_edge_values(&b, first, c, before, &edges);
            }
        }
    equation_correct_edges(e, i, &edges, &around.double_layer0, rhs);
    for (int c = 0; c < 3; c++)
        row[c].rhs += rhs[c];
    for (int c = 0; c < 3; c++)
        if (e->channel[c].active)
            finish_row(e, &e->channel[c], i, &row[c], &around, diagonal);
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

/* --- Solution ------------------------------------------------------------------------------------------------------------------------- */

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
        const float *matrix = p->channel->matrix + e->first_entry[i];
        double sum = 0.0;
        for (uint32_t r = e->first_run[i]; r < e->first_run[i + 1]; matrix += e->run[r++].count)
            sum += e->kernels->product(matrix, e->extended + e->run[r].first, e->run[r].count);
        p->to[i] = sum;
    }
}

void equation_extend(const struct equation *e, double *extended)
{
    const struct collocation_points *p = e->points;

    for (uint32_t k = 0; k < p->num_clusters; k++) {
        const struct cluster *c = &p->cluster[k];
        double sum = 0.0;
        for (uint32_t j = c->first; j < c->end; j++)
            sum += (double) p->point[j].area * extended[j];
        extended[p->count + k] = c->area > 0.0f ? sum / (double) c->area : 0.0;
    }
}

/* Multiplies the matrix by `phi`. */
static void multiply(struct equation *e, const struct equation_channel *channel, const double *phi, double *to)
{
    struct product p = { e, channel, to };

    memcpy(e->extended, phi, e->points->count * sizeof(*phi));
    equation_extend(e, e->extended);
    for_rows(e, product_chunk, &p);
}

static double dot(const double *a, const double *b, uint32_t n)
{
    double sum = 0.0;

    for (uint32_t i = 0; i < n; i++)
        sum += a[i] * b[i];
    return sum;
}

/* Orthogonalizes the last basis vector against those before it: its components go to h, its remaining length behind them. */
static void orthogonalise(const struct equation *e, int last, double *h)
{
    const uint32_t n = e->points->count;
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

/* Applies the Givens rotations so far to column h, and adds one that makes its last entry 0; rotates the residual g as well. */
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
    const uint32_t n = e->points->count;
    double h[MAX_STEPS][MAX_STEPS + 1], turn[MAX_STEPS][2], g[MAX_STEPS + 1] = { 0.0 };
    double *v = e->basis, rhs_norm;
    int steps = 0;

    memset(c->phi, 0, n * sizeof(*c->phi));
    memcpy(v, c->rhs, n * sizeof(*v));
    rhs_norm = g[0] = sqrt(dot(v, v, n));
    for (uint32_t i = 0; i < n && g[0] > 0.0; i++)
        v[i] /= g[0];
    while (steps < MAX_STEPS && fabs(g[steps]) > TOLERANCE * rhs_norm) {
        multiply(e, c, e->basis + (size_t) steps * n, e->basis + (size_t) (steps + 1) * n);
        orthogonalise(e, steps + 1, h[steps]);
        rotate(steps, turn, h[steps], g);
        steps++;
        if (pell_cancelled(e->ctx))
            return false;
    }
    if (!(fabs(g[steps]) <= ACCEPTED * rhs_norm))
        return false;
    for (int k = steps; k-- > 0;) { /* back substitution: h y = g; y replaces g */
        for (int j = k + 1; j < steps; j++)
            g[k] -= h[j][k] * g[j];
        g[k] = h[k][k] > 0.0 ? g[k] / h[k][k] : 0.0;
        for (uint32_t i = 0; i < n; i++)
            c->phi[i] += g[k] * e->basis[(size_t) k * n + i];
    }
    return true;
}
