/* SPDX-License-Identifier: MIT
 *
 * plane_grid.c - the least-squares plane of the surface around a vertex, over a neighbourhood of the radius of light transport (Francois et
 * al. 2006, 2.2), from moments.
 *
 * Vertices are sorted by grid cell, a quarter of the radius wide, and by the direction of their normal. A cell inside the radius
 * contributes its moments; in a cell that the sphere intersects every vertex is tested or, if there are many, the cell's centre. The work
 * per vertex is therefore bounded.
 */
#include "methods/layered/layered.h"

#include "math/vec.h"
#include "scene/mesh/topology.h"

#include <string.h>

enum { MIN_POINTS = 6, TEST_EACH = 16, BATCH = 256 };
#define MAX_FLATNESS 0.5 /* largest ratio of the smallest variance to the middle one */
#define MIN_WIDTH 1e-4   /* smallest ratio of the middle variance to the largest; below it the points are on a line */
#define MIN_COSINE 0.2   /* smallest cosine between the plane and the vertex normal */

struct cell {
    uint64_t key;
    uint32_t first, count;
    double weight, sum[3], square[6]; /* xx, xy, xz, yy, yz, zz; about the cloud's centre */
    float normal[3];
};

struct entry {
    uint64_t key;
    uint32_t vertex;
};

struct fit {
    const struct layered_cloud *cloud;
    struct entry *sorted;
    struct cell *cells;
    size_t num_cells;
    double low[3], middle[3], size;
    int64_t across[3];
    float (*plane)[4];
};

struct moments {
    double weight, sum[3], square[6];
    uint64_t count;
};

static void add(struct moments *m, double w, const double p[3])
{
    m->weight += w;
    for (int i = 0, k = 0; i < 3; i++) {
        m->sum[i] += w * p[i];
        for (int j = i; j < 3; j++)
            m->square[k++] += w * p[i] * p[j];
    }
    m->count++;
}

/* --- The grid ------------------------------------------------------------------------------------------------------------------- */

static int64_t cell_index(const struct fit *f, int axis, double x)
{
    const double i = (x - f->low[axis]) / f->size;
    return i > 0.0 ? i < (double) f->across[axis] ? (int64_t) i : f->across[axis] - 1 : 0;
}

/* Key of a cell: 19 bits per axis, 7 for the bin of the normal's direction. */
static uint64_t key_of(int64_t x, int64_t y, int64_t z, unsigned bin)
{
    return ((uint64_t) z << 38 | (uint64_t) y << 19 | (uint64_t) x) << 7 | bin;
}

/* Index of the normal's direction: one of 16 bins on one of the six faces of a cube, [0, 96). */
static unsigned normal_bin(const float *n)
{
    const float size[3] = { fabsf(n[0]), fabsf(n[1]), fabsf(n[2]) };
    const int axis = size[0] >= size[1] && size[0] >= size[2] ? 0 : size[1] >= size[2] ? 1 : 2;
    const float most = size[axis] > 0.0f ? size[axis] : 1.0f, a = n[(axis + 1) % 3] / most, b = n[(axis + 2) % 3] / most;
    const unsigned i = a < -0.5f ? 0 : a < 0.0f ? 1 : a < 0.5f ? 2 : 3, j = b < -0.5f ? 0 : b < 0.0f ? 1 : b < 0.5f ? 2 : 3;

    return ((unsigned) axis * 2 + (n[axis] < 0.0f)) * 16 + i * 4 + j;
}

static uint64_t code_at(const void *items, size_t index)
{
    return ((const uint64_t *) items)[index];
}

static void position_of(const struct fit *f, uint32_t vertex, double p[3])
{
    for (int k = 0; k < 3; k++)
        p[k] = (double) f->cloud->position[3 * (size_t) vertex + (size_t) k] - f->middle[k];
}

static void make_cells(struct fit *f)
{
    const struct layered_cloud *c = f->cloud;

    for (size_t i = 0; i < c->count && !pell_cancelled_at(c->ctx, i); i++) {
        struct cell *cell = f->num_cells ? &f->cells[f->num_cells - 1] : NULL;
        const uint32_t v = f->sorted[i].vertex;
        struct moments m = { 0 };
        double p[3];
        if (!cell || cell->key != f->sorted[i].key) {
            cell = &f->cells[f->num_cells++];
            cell->key = f->sorted[i].key;
            cell->first = (uint32_t) i;
        }
        position_of(f, v, p);
        add(&m, (double) c->weight[v], p);
        cell->count++;
        cell->weight += m.weight;
        for (int k = 0; k < 3; k++) {
            cell->sum[k] += m.sum[k];
            cell->normal[k] += c->normal[3 * (size_t) v + (size_t) k] * c->weight[v];
        }
        for (int k = 0; k < 6; k++)
            cell->square[k] += m.square[k];
    }
}

static enum pell_result make_grid(struct fit *f, double size)
{
    const struct layered_cloud *c = f->cloud;
    double high[3] = { 0 };
    uint64_t *keys = NULL;
    uint32_t *order = NULL;
    enum pell_result res;

    for (int k = 0; k < 3; k++) {
        f->low[k] = INFINITY;
        high[k] = -INFINITY;
    }
    for (size_t i = 0; i < 3 * c->count && !pell_cancelled_at(c->ctx, i); i++) {
        f->low[i % 3] = fmin(f->low[i % 3], (double) c->position[i]);
        high[i % 3] = fmax(high[i % 3], (double) c->position[i]);
    }
    if (pell_cancelled(c->ctx)) /* bounds are missing */
        return PELL_ERR_CANCELLED;
    f->size = size;
    for (int k = 0; k < 3; k++)
        f->size = fmax(f->size, (high[k] - f->low[k]) / 5e5);
    f->size = f->size > 0.0 ? f->size : 1.0;
    for (int k = 0; k < 3; k++) {
        f->middle[k] = 0.5 * (f->low[k] + high[k]);
        f->across[k] = (int64_t) ((high[k] - f->low[k]) / f->size) + 1;
    }
    f->sorted = pell_alloc_array(c->ctx, c->count, sizeof(*f->sorted));
    f->cells = pell_calloc(c->ctx, c->count, sizeof(*f->cells));
    keys = pell_alloc_array(c->ctx, c->count, sizeof(*keys));
    res = PELL_ERR_NOMEM;
    if (!f->sorted || !f->cells || !keys)
        goto fail;
    for (size_t i = 0; i < c->count && !pell_cancelled_at(c->ctx, i); i++) {
        const float *p = c->position + 3 * i, *n = c->normal + 3 * i;
        keys[i] = key_of(cell_index(f, 0, (double) p[0]), cell_index(f, 1, (double) p[1]), cell_index(f, 2, (double) p[2]), normal_bin(n));
    }
    PELL_TRY(pell_order_by_code(c->ctx, c->count, code_at, keys, &order));
    for (size_t i = 0; i < c->count && !pell_cancelled_at(c->ctx, i); i++)
        f->sorted[i] = (struct entry) { keys[order[i]], order[i] };
    if (!pell_cancelled(c->ctx))
        make_cells(f);
    res = pell_cancelled(c->ctx) ? PELL_ERR_CANCELLED : PELL_OK;

fail:
    pell_free(c->ctx, keys);
    pell_free(c->ctx, order);
    return res;
}

/* The first cell whose key is at least `key`. */
static size_t find(const struct fit *f, uint64_t key)
{
    size_t low = 0, high = f->num_cells;

    while (low < high) {
        const size_t middle = low + (high - low) / 2;
        if (f->cells[middle].key < key)
            low = middle + 1;
        else
            high = middle;
    }
    return low;
}

/* --- A vertex ------------------------------------------------------------------------------------------------------------------- */

/* Smallest and largest squared distance from v (about the centre) to a cell's box. */
static void box_reach(const struct fit *f, const int64_t at[3], const double v[3], double *near, double *far)
{
    *near = *far = 0.0;
    for (int k = 0; k < 3; k++) {
        const double low = f->low[k] - f->middle[k] + f->size * (double) at[k], high = low + f->size;
        const double d = fmax(fmax(low - v[k], v[k] - high), 0.0), e = fmax(fabs(v[k] - low), fabs(v[k] - high));
        *near += d * d;
        *far += e * e;
    }
}

static void add_cell(const struct fit *f, const struct cell *c, const int64_t at[3], const double v[3], const float *normal, double radius2,
                     struct moments *m)
{
    const double along = (double) (normal[0] * c->normal[0] + normal[1] * c->normal[1] + normal[2] * c->normal[2]);
    double near, far, mean = 0.0;

    box_reach(f, at, v, &near, &far);
    if (near > radius2)
        return;
    if (far > radius2 && c->count <= TEST_EACH) {
        for (uint32_t i = 0; i < c->count; i++) {
            const uint32_t vertex = f->sorted[c->first + i].vertex;
            const float *n = f->cloud->normal + 3 * (size_t) vertex;
            double p[3], d2 = 0.0;
            position_of(f, vertex, p);
            for (int k = 0; k < 3; k++) {
                const double d = p[k] - v[k];
                d2 += d * d;
            }
            if (d2 <= radius2 && normal[0] * n[0] + normal[1] * n[1] + normal[2] * n[2] > 0.0f)
                add(m, (double) f->cloud->weight[vertex], p);
        }
        return;
    }
    for (int k = 0; k < 3; k++) {
        const double d = c->sum[k] / c->weight - v[k];
        mean += d * d;
    }
    if ((far > radius2 && mean > radius2) || !(along > 0.0))
        return;
    m->weight += c->weight;
    m->count += c->count;
    for (int k = 0; k < 3; k++)
        m->sum[k] += c->sum[k];
    for (int k = 0; k < 6; k++)
        m->square[k] += c->square[k];
}

static void gather(const struct fit *f, const double v[3], const float *normal, double radius, struct moments *m)
{
    int64_t low[3], high[3];

    memset(m, 0, sizeof(*m));
    for (int k = 0; k < 3; k++) {
        low[k] = cell_index(f, k, v[k] + f->middle[k] - radius);
        high[k] = cell_index(f, k, v[k] + f->middle[k] + radius);
    }
    for (int64_t z = low[2]; z <= high[2]; z++)
        for (int64_t y = low[1]; y <= high[1]; y++) {
            const uint64_t last = key_of(high[0], y, z, 127);
            for (size_t i = find(f, key_of(low[0], y, z, 0)); i < f->num_cells && f->cells[i].key <= last; i++) {
                const int64_t at[3] = { (int64_t) (f->cells[i].key >> 7 & 0x7ffff), y, z };
                add_cell(f, &f->cells[i], at, v, normal, radius * radius, m);
            }
        }
}

/* Eigenvalues and eigenvectors (columns) of a symmetric matrix by Jacobi rotations. */
static void eigen(double a[3][3], double values[3], double vectors[3][3])
{
    static const int pairs[3][2] = { { 0, 1 }, { 0, 2 }, { 1, 2 } };

    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            vectors[i][j] = i == j;
    for (int sweep = 0; sweep < 30; sweep++) {
        const double off = fabs(a[0][1]) + fabs(a[0][2]) + fabs(a[1][2]);
        if (!(off > 1e-30 * (fabs(a[0][0]) + fabs(a[1][1]) + fabs(a[2][2]))))
            break;
        for (int k = 0; k < 3; k++) {
            const int p = pairs[k][0], q = pairs[k][1];
            double theta, t, c, s;
            if (a[p][q] == 0.0)
                continue;
            theta = 0.5 * (a[q][q] - a[p][p]) / a[p][q];
            t = copysign(1.0, theta) / (fabs(theta) + sqrt(theta * theta + 1.0));
            c = 1.0 / sqrt(t * t + 1.0);
            s = t * c;
            for (int i = 0; i < 3; i++) {
                const double x = a[i][p], y = a[i][q];
                a[i][p] = c * x - s * y;
                a[i][q] = s * x + c * y;
            }
            for (int i = 0; i < 3; i++) {
                const double x = a[p][i], y = a[q][i], u = vectors[i][p], v = vectors[i][q];
                a[p][i] = c * x - s * y;
                a[q][i] = s * x + c * y;
                vectors[i][p] = c * u - s * v;
                vectors[i][q] = s * u + c * v;
            }
        }
    }
    for (int i = 0; i < 3; i++)
        values[i] = a[i][i];
}

/* False: the points do not resemble a surface. */
static bool plane_of(const struct moments *m, const double v[3], const float *normal, float plane[4])
{
    static const int at[3][3] = { { 0, 1, 2 }, { 1, 3, 4 }, { 2, 4, 5 } };
    double a[3][3], values[3], vectors[3][3], mean[3], n[3], dot = 0.0, h = 0.0;
    int least = 0, most = 0, middle;

    if (m->count < MIN_POINTS || !(m->weight > 0.0))
        return false;
    for (int i = 0; i < 3; i++)
        mean[i] = m->sum[i] / m->weight;
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            a[i][j] = m->square[at[i][j]] / m->weight - mean[i] * mean[j];
    eigen(a, values, vectors);
    for (int i = 1; i < 3; i++) {
        least = values[i] < values[least] ? i : least;
        most = values[i] >= values[most] ? i : most;
    }
    middle = 3 - least - most;
    if (least == most || !(values[middle] > MIN_WIDTH * values[most]) || !(values[least] < MAX_FLATNESS * values[middle]))
        return false;
    for (int i = 0; i < 3; i++) {
        n[i] = vectors[i][least];
        dot += n[i] * (double) normal[i];
    }
    if (!(fabs(dot) > MIN_COSINE))
        return false;
    for (int i = 0; i < 3; i++)
        h += n[i] * (mean[i] - v[i]);
    for (int i = 0; i < 3; i++)
        plane[i] = (float) (dot < 0.0 ? -n[i] : n[i]);
    plane[3] = (float) (h / dot);
    return isfinite(plane[0] + plane[1] + plane[2] + plane[3]);
}

static void fit_batch(void *arg, int index, int worker)
{
    const struct fit *f = arg;
    const struct layered_cloud *c = f->cloud;
    const size_t first = (size_t) index * BATCH, end = first + BATCH < c->count ? first + BATCH : c->count;

    (void) worker;
    for (size_t i = first; i < end; i++) {
        const uint32_t vertex = f->sorted[i].vertex;
        const float *normal = c->normal + 3 * (size_t) vertex;
        struct moments m;
        double v[3];
        if (vertex >= c->fitted || (c->keep && c->keep[vertex]))
            continue;
        position_of(f, vertex, v);
        for (int k = 0; k < 3; k++)
            f->plane[vertex][k] = normal[k];
        f->plane[vertex][3] = 0.0f;
        for (int wide = 1; wide <= 2; wide++) {
            gather(f, v, normal, wide * (double) c->radius, &m);
            if (plane_of(&m, v, normal, f->plane[vertex]))
                break;
        }
    }
}

enum pell_result layered_planes_fit(const struct layered_cloud *cloud, float (*plane)[4])
{
    struct fit f = { .cloud = cloud, .plane = plane };
    enum pell_result res;

    if (cloud->fitted == 0)
        return PELL_OK;
    PELL_TRY(make_grid(&f, 0.25 * (double) cloud->radius));
    pell_pool_run(cloud->pool, (int) ((cloud->count + BATCH - 1) / BATCH), fit_batch, &f);
    res = pell_cancelled(cloud->ctx) ? PELL_ERR_CANCELLED : PELL_OK;

fail:
    pell_free(cloud->ctx, f.sorted);
    pell_free(cloud->ctx, f.cells);
    return res;
}
