/* SPDX-License-Identifier: MIT
 *
 * distance_field.c - see distance_field.h.
 *
 * A solid's bounds are divided into cubes. Each stores a lower bound of the distance at its centre c; distance is 1-Lipschitz: d(x) >= d(c)
 * - |x - c|. Near surfaces, every triangle writes exact distances to the cubes within a band. Farther away: every surface point is in a
 * cube whose centre is within half a diagonal, so the distance between cube centres, from an exact distance transform (Felzenszwalb and
 * Huttenlocher 2012, "Distance Transforms of Sampled Functions"), minus half a diagonal is a bound.
 */
#include "transport/distance_field.h"

#include <string.h>

#define MAX_CUBES 6e6         /* per solid: more take longer to fill than they save */
#define STEPS 24              /* per cube side: quantisation of stored distances, rounded down */
#define BAND 3.0f             /* in cubes: within it distances are exact */
#define MAX_SPAN 8.0f         /* in cubes: larger triangles are subdivided */
#define MAX_DEPTH 48          /* maximum subdivision depth of a triangle */
#define SLAB 8                /* layers per task */
#define HALF 0.8660255f       /* half of a cube's diagonal, in sides */
#define ROUNDING_MARGIN 2e-3f /* in sides: rounding errors relative to the grid's corner */

struct pell_distance {
    struct pell_context *ctx;
    struct pell_distance_grid *grids; /* one per solid; size 0: none */
    size_t count;
};

/* Temporary data of filling a grid. */
struct fill {
    const struct pell_scene *scene;
    struct pell_distance_grid *grid;
    float *centre[3]; /* centres of cubes along each axis, from the grid's corner, in sides */
    float *near2;     /* squared distance in sides, within the band; then, as int32_t, the transform */
    int32_t *lines;   /* scratch of the transform: 3 lines per worker */
    int longest;
    struct span { /* extent of a mesh along z, in layers */
        int from, to;
    } * spans;
};

static inline size_t row_at(const struct pell_distance_grid *g, int y, int z)
{
    return ((size_t) z * (size_t) g->size[1] + (size_t) y) * (size_t) g->size[0];
}

/* --- Near field: triangles ------------------------------------------------------------------------------------------------------ */

/* A triangle relative to its first corner, prepared for many points. */
struct facet {
    float p[3], e[3], f[3], g[3], n[3];
    float ee, ef, ff, det, inv_e, inv_f, inv_g;
};

static double dot3(const double a[3], const double b[3])
{
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

static float inverse(double x)
{
    return x > 1e-30 ? (float) (1.0 / x) : 0.0f;
}

static struct facet facet_of(const float corner[3][3])
{
    struct facet t;
    double e[3], f[3], g[3], n[3];

    for (int k = 0; k < 3; k++) {
        e[k] = (double) corner[1][k] - (double) corner[0][k];
        f[k] = (double) corner[2][k] - (double) corner[0][k];
        g[k] = f[k] - e[k];
    }
    for (int k = 0; k < 3; k++) {
        n[k] = e[(k + 1) % 3] * f[(k + 2) % 3] - e[(k + 2) % 3] * f[(k + 1) % 3];
        t.p[k] = corner[0][k];
        t.e[k] = (float) e[k];
        t.f[k] = (float) f[k];
        t.g[k] = (float) g[k];
    }
    for (int k = 0; k < 3; k++)
        t.n[k] = (float) (dot3(n, n) > 0.0 ? n[k] / sqrt(dot3(n, n)) : 0.0);
    t.ee = (float) dot3(e, e);
    t.ef = (float) dot3(e, f);
    t.ff = (float) dot3(f, f);
    t.det = (float) dot3(n, n);
    t.inv_e = inverse(dot3(e, e));
    t.inv_f = inverse(dot3(f, f));
    t.inv_g = inverse(dot3(g, g));
    return t;
}

static inline float unit_clamp(float x)
{
    return x > 0.0f ? x < 1.0f ? x : 1.0f : 0.0f;
}

/* Lowers squared distances of a row of cubes to those of the triangle. Where rounding misjudges whether the projection is inside, a side is
 * as near. */
static void lower_row(const struct facet *restrict t, const float *restrict x, int count, float y, float z, float *restrict near2)
{
    const float dy = y - t->p[1], dz = z - t->p[2];
    const float e0 = dy * t->e[1] + dz * t->e[2], f0 = dy * t->f[1] + dz * t->f[2], n0 = dy * t->n[1] + dz * t->n[2];
    const float hy = dy - t->e[1], hz = dz - t->e[2], g0 = hy * t->g[1] + hz * t->g[2];

    for (int i = 0; i < count; i++) {
        const float dx = x[i] - t->p[0], hx = dx - t->e[0];
        const float de = dx * t->e[0] + e0, df = dx * t->f[0] + f0, dn = dx * t->n[0] + n0, hg = hx * t->g[0] + g0;
        const float u = t->ff * de - t->ef * df, v = t->ee * df - t->ef * de, w = t->det - u - v;
        const float a = unit_clamp(de * t->inv_e), b = unit_clamp(df * t->inv_f), c = unit_clamp(hg * t->inv_g);
        const float ax = dx - a * t->e[0], ay = dy - a * t->e[1], az = dz - a * t->e[2];
        const float bx = dx - b * t->f[0], by = dy - b * t->f[1], bz = dz - b * t->f[2];
        const float cx = hx - c * t->g[0], cy = hy - c * t->g[1], cz = hz - c * t->g[2];
        const float sa = ax * ax + ay * ay + az * az, sb = bx * bx + by * by + bz * bz, sc = cx * cx + cy * cy + cz * cz;
        const float least = u < v ? u < w ? u : w : v < w ? v : w, plane = least > 0.0f ? dn * dn : INFINITY;
        const float ab = sa < sb ? sa : sb, cp = sc < plane ? sc : plane, d2 = ab < cp ? ab : cp;
        near2[i] = near2[i] < d2 ? near2[i] : d2;
    }
}

/* The longest side, by the corner where it starts. */
static int longest_side(const float corner[3][3])
{
    float longest = -1.0f;
    int at = 0;

    for (int i = 0; i < 3; i++) {
        const float *a = corner[i], *b = corner[(i + 1) % 3];
        const float d[3] = { b[0] - a[0], b[1] - a[1], b[2] - a[2] }, length2 = d[0] * d[0] + d[1] * d[1] + d[2] * d[2];
        if (length2 > longest) {
            longest = length2;
            at = i;
        }
    }
    return at;
}

/* Corners in sides from the grid's corner; layers [from, to). Large triangles are bisected across their longest side, so that slivers are
 * divided by their length. */
static void write_distances(const struct fill *f, const float corner[3][3], int from, int to, int depth)
{
    const struct pell_distance_grid *g = f->grid;
    int first[3], last[3];
    float extent = 0.0f;
    struct facet t;

    for (int k = 0; k < 3; k++) {
        const float a = corner[0][k], b = corner[1][k], c = corner[2][k];
        const float low = fminf(a, fminf(b, c)), high = fmaxf(a, fmaxf(b, c)), begin = k == 2 ? (float) from : 0.0f,
                    end = (float) (k == 2 ? to : g->size[k]);
        extent = fmaxf(extent, high - low);
        if (!(high + BAND >= begin && low - BAND <= end))
            return;
        first[k] = (int) fmaxf(low - BAND, begin);
        last[k] = (int) fminf(high + BAND, end - 0.5f) + 1;
    }
    if (extent > MAX_SPAN && depth < MAX_DEPTH) {
        const int at = longest_side(corner), next = (at + 1) % 3;
        for (int i = 0; i < 2; i++) {
            float half[3][3];
            memcpy(half, corner, sizeof(half));
            for (int k = 0; k < 3; k++)
                half[i ? at : next][k] = 0.5f * (corner[at][k] + corner[next][k]);
            write_distances(f, (const float(*)[3]) half, from, to, depth + 1);
        }
        return;
    }
    t = facet_of(corner);
    for (int z = first[2]; z < last[2]; z++)
        for (int y = first[1]; y < last[1]; y++)
            lower_row(&t, f->centre[0] + first[0], last[0] - first[0], f->centre[1][y], f->centre[2][z],
                      f->near2 + row_at(g, y, z) + first[0]);
}

/* A slab of layers: distances within the band, then the input of the transform: 0 where a surface may be in the cube. */
static void near_task(void *arg, int index, int worker)
{
    const struct fill *f = arg;
    struct pell_distance_grid *g = f->grid;
    const int from = index * SLAB, to = from + SLAB < g->size[2] ? from + SLAB : g->size[2];
    const size_t start = row_at(g, 0, from), end = row_at(g, 0, to);
    const double inverse_side = 1.0 / (double) g->side;
    const float far2 = BAND * BAND, scale = g->side / g->unit;
    int32_t *transform = (int32_t *) f->near2;

    (void) worker;
    for (size_t i = start; i < end; i++)
        f->near2[i] = far2;
    for (size_t k = 0; k < f->scene->num_meshes; k++) {
        const struct pell_mesh *m = &f->scene->meshes[k];
        if (f->spans[k].from >= to || f->spans[k].to < from)
            continue;
        for (size_t i = 0; i < m->num_triangles && !pell_cancelled_at(f->scene->ctx, i); i++) {
            const float *p[3];
            float corner[3][3];
            for (size_t c = 0; c < 3; c++) {
                p[c] = m->position + 3 * (size_t) m->index[3 * i + c];
                corner[c][2] = (float) (((double) p[c][2] - (double) g->low[2]) * inverse_side);
            }
            if (fmaxf(corner[0][2], fmaxf(corner[1][2], corner[2][2])) + BAND < (float) from ||
                fminf(corner[0][2], fminf(corner[1][2], corner[2][2])) - BAND > (float) to)
                continue;
            for (size_t c = 0; c < 3; c++)
                for (int j = 0; j < 2; j++)
                    corner[c][j] = (float) (((double) p[c][j] - (double) g->low[j]) * inverse_side);
            write_distances(f, (const float(*)[3]) corner, from, to, 0);
        }
    }
    for (size_t i = start; i < end; i++) {
        const float d = sqrtf(f->near2[i]), known = (d - ROUNDING_MARGIN) * scale;
        g->steps[i] = (uint16_t) (known > 0.0f ? known : 0.0f);
        transform[i] = d <= HALF + ROUNDING_MARGIN ? 0 : INT32_MAX;
    }
}

/* --- Far field: distance transform ------------------------------------------------------------------------------------------------ */

/* Along x: squared distance to the nearest 0. */
static void transform_row(int32_t *d, int n)
{
    int last = -1;

    for (int i = 0; i < n; i++)
        if (d[i] == 0) {
            for (int k = last < 0 ? 0 : last + 1; k < i; k++) {
                const int a = i - k, b = last < 0 ? a : k - last, c = a < b ? a : b;
                d[k] = c * c;
            }
            last = i;
        }
    for (int k = last + 1; last >= 0 && k < n; k++)
        d[k] = (k - last) * (k - last);
}

/* Along y or z: the lower envelope of parabolas. */
static void transform_line(int32_t *d, size_t stride, int n, int32_t *height, int32_t *at, int32_t *begin)
{
    int count = 0;

    for (int i = 0; i < n; i++) {
        const int32_t h = d[(size_t) i * stride];
        int32_t first = 0;
        if (h == INT32_MAX)
            continue;
        while (count > 0) { /* the first coordinate where parabola i is below the previous one; exact enough for integers */
            const double j = at[count - 1];
            const double x = ((double) h - height[count - 1] + ((double) i * i - j * j)) / (2.0 * (i - j));
            first = x < 0.0 ? 0 : x < n ? (int32_t) x + 1 : n;
            if (first > begin[count - 1])
                break;
            count--;
            first = 0;
        }
        if (first >= n)
            continue;
        height[count] = h;
        at[count] = i;
        begin[count++] = first;
    }
    for (int i = 0, k = 0; i < n && count > 0; i++) {
        while (k + 1 < count && begin[k + 1] <= i)
            k++;
        d[(size_t) i * stride] = height[k] + (i - at[k]) * (i - at[k]);
    }
}

static void layer_task(void *arg, int z, int worker)
{
    const struct fill *f = arg;
    const struct pell_distance_grid *g = f->grid;
    int32_t *d = (int32_t *) f->near2 + row_at(g, 0, z), *lines = f->lines + 3 * (size_t) f->longest * (size_t) worker;

    for (int y = 0; y < g->size[1]; y++)
        transform_row(d + (size_t) y * (size_t) g->size[0], g->size[0]);
    for (int x = 0; x < g->size[0]; x++)
        transform_line(d + x, (size_t) g->size[0], g->size[1], lines, lines + f->longest, lines + 2 * f->longest);
}

static void depth_task(void *arg, int y, int worker)
{
    const struct fill *f = arg;
    struct pell_distance_grid *g = f->grid;
    const size_t layer = (size_t) g->size[0] * (size_t) g->size[1];
    int32_t *d = (int32_t *) f->near2 + row_at(g, y, 0), *lines = f->lines + 3 * (size_t) f->longest * (size_t) worker;
    uint16_t *steps = g->steps + row_at(g, y, 0);

    for (int x = 0; x < g->size[0]; x++)
        transform_line(d + x, layer, g->size[2], lines, lines + f->longest, lines + 2 * f->longest);
    for (int z = 0; z < g->size[2]; z++)
        for (int x = 0; x < g->size[0]; x++) {
            const size_t i = (size_t) z * layer + (size_t) x;
            const float known = (sqrtf((float) d[i]) * (1.0f - 1e-6f) - HALF - ROUNDING_MARGIN) * (g->side / g->unit);
            const uint16_t bound = (uint16_t) (known > 0.0f ? known < 65535.0f ? known : 65535.0f : 0.0f);
            steps[i] = steps[i] > bound ? steps[i] : bound;
        }
}

/* --- Grids ------------------------------------------------------------------------------------------------------------------------ */

/* Finds the smallest cube size with at most `most` cubes over the bounds. False: the extent of the solid is degenerate. */
static bool cut(struct pell_distance_grid *g, double most)
{
    double low, high, extent[3], largest = 0.0, magnitude = 0.0;

    for (int k = 0; k < 3; k++) {
        extent[k] = (double) g->high[k] - (double) g->low[k];
        largest = fmax(largest, extent[k]);
        magnitude = fmax(magnitude, fmax(fabs((double) g->low[k]), fabs((double) g->high[k])));
    }
    if (!(largest > 1e-6 * magnitude && largest > 1e-15 && largest < 1e18))
        return false;
    low = largest * 1e-4;
    high = largest;
    for (int i = 0; i < 40; i++) {
        const double side = sqrt(low * high);
        double cubes = 1.0;
        for (int k = 0; k < 3; k++)
            cubes *= floor(extent[k] / side) + 1.0;
        if (cubes > most)
            low = side;
        else
            high = side;
    }
    g->side = (float) (high * 1.000001); /* rounded up */
    g->unit = g->side / STEPS;
    g->inverse_side = 1.0f / g->side;
    for (int k = 0; k < 3; k++)
        g->size[k] = (int) floor(extent[k] / (double) g->side) + 1;
    return true;
}

static void bounds_of(const struct pell_scene *scene, const struct pell_solid *solid, struct pell_distance_grid *g)
{
    for (int k = 0; k < 3; k++) {
        g->low[k] = INFINITY;
        g->high[k] = -INFINITY;
    }
    for (size_t i = 0; i < solid->num_triangles && !pell_cancelled_at(scene->ctx, i); i++) {
        const struct pell_mesh *m = &scene->meshes[solid->triangles[i].mesh];
        for (size_t corner = 0; corner < 3; corner++) {
            const float *p = m->position + 3 * (size_t) m->index[3 * (size_t) solid->triangles[i].triangle + corner];
            for (int k = 0; k < 3; k++) {
                g->low[k] = fminf(g->low[k], p[k]);
                g->high[k] = fmaxf(g->high[k], p[k]);
            }
        }
    }
}

/* Layers within the extent of meshes; meshes outside of the ray-tracing scene are skipped. */
static void span_meshes(const struct fill *f)
{
    const struct pell_distance_grid *g = f->grid;

    for (size_t k = 0; k < f->scene->num_meshes; k++) {
        const struct pell_mesh *m = &f->scene->meshes[k];
        float low[3] = { INFINITY, INFINITY, INFINITY }, high[3] = { -INFINITY, -INFINITY, -INFINITY };
        bool overlaps = true;
        for (size_t i = 0; i < m->num_vertices; i++)
            for (int j = 0; j < 3; j++) {
                low[j] = fminf(low[j], m->position[3 * i + (size_t) j]);
                high[j] = fmaxf(high[j], m->position[3 * i + (size_t) j]);
            }
        for (int j = 0; j < 3; j++)
            overlaps = overlaps && high[j] >= g->low[j] - (BAND + 1.0f) * g->side && low[j] <= g->high[j] + (BAND + 2.0f) * g->side;
        f->spans[k] = (struct span) { INT32_MAX, -1 };
        if (overlaps) {
            const double from = floor(((double) low[2] - (double) g->low[2]) / (double) g->side - (double) BAND - 1.0);
            const double to = ((double) high[2] - (double) g->low[2]) / (double) g->side + (double) BAND + 2.0;
            f->spans[k] = (struct span) { (int) fmax(from, -1.0), (int) fmin(to, g->size[2]) };
        }
    }
}

static enum pell_result fill_grid(struct pell_context *ctx, struct pell_pool *pool, const struct pell_scene *scene,
                                  struct pell_distance_grid *g)
{
    const size_t cubes = row_at(g, 0, g->size[2]);
    struct fill f = { .scene = scene, .grid = g };
    enum pell_result res = PELL_ERR_NOMEM;

    for (int k = 0; k < 3; k++)
        f.longest = g->size[k] > f.longest ? g->size[k] : f.longest;
    g->steps = pell_alloc_array(ctx, cubes, sizeof(*g->steps));
    f.near2 = pell_alloc_array(ctx, cubes, sizeof(*f.near2));
    f.centre[0] = pell_alloc_array(ctx, 3 * (size_t) f.longest, sizeof(float));
    f.lines = pell_alloc_array(ctx, 3 * (size_t) f.longest * (size_t) pell_pool_threads(pool), sizeof(*f.lines));
    f.spans = pell_alloc_array(ctx, scene->num_meshes + 1, sizeof(*f.spans));
    if (!g->steps || !f.near2 || !f.centre[0] || !f.lines || !f.spans)
        goto fail;
    for (int k = 0; k < 3; k++) {
        f.centre[k] = f.centre[0] + k * f.longest;
        for (int i = 0; i < g->size[k]; i++)
            f.centre[k][i] = (float) (((double) pell_distance_centre(g, k, i) - (double) g->low[k]) / (double) g->side);
    }
    span_meshes(&f);
    pell_pool_run(pool, (g->size[2] + SLAB - 1) / SLAB, near_task, &f);
    pell_pool_run(pool, g->size[2], layer_task, &f);
    pell_pool_run(pool, g->size[1], depth_task, &f);
    res = pell_cancelled(ctx) ? PELL_ERR_CANCELLED : PELL_OK;

fail:
    pell_free(ctx, f.near2);
    pell_free(ctx, f.centre[0]);
    pell_free(ctx, f.lines);
    pell_free(ctx, f.spans);
    return res;
}

enum pell_result pell_distance_create(struct pell_context *ctx, struct pell_pool *pool, const struct pell_scene *scene,
                                      const struct pell_solids *solids, size_t bytes, struct pell_distance **out)
{
    struct pell_distance *d = pell_zalloc(ctx, sizeof(*d));
    enum pell_result res = PELL_ERR_NOMEM;

    *out = NULL;
    if (!d)
        return PELL_ERR_NOMEM;
    d->ctx = ctx;
    d->count = solids->count;
    d->grids = pell_calloc(ctx, solids->count + 1, sizeof(*d->grids));
    if (!d->grids)
        goto fail;
    for (size_t i = 0; i < solids->count; i++) {
        const double most = (double) (bytes / sizeof(*d->grids->steps)) / (double) solids->count;
        bounds_of(scene, &solids->solids[i], &d->grids[i]);
        if (most >= 1.0 && cut(&d->grids[i], fmin(most, MAX_CUBES)))
            PELL_TRY(fill_grid(ctx, pool, scene, &d->grids[i]));
    }
    *out = d;
    return PELL_OK;

fail:
    pell_distance_destroy(&d);
    return res;
}

void pell_distance_destroy(struct pell_distance **distance)
{
    struct pell_distance *d = *distance;

    if (!d)
        return;
    *distance = NULL;
    for (size_t i = 0; d->grids && i < d->count; i++)
        pell_free(d->ctx, d->grids[i].steps);
    pell_free(d->ctx, d->grids);
    pell_free(d->ctx, d);
}

const struct pell_distance_grid *pell_distance_grid(const struct pell_distance *distance, int solid)
{
    return solid >= 0 && (size_t) solid < distance->count && distance->grids[solid].steps ? &distance->grids[solid] : NULL;
}

float pell_distance_bound(const struct pell_distance *distance, int solid, struct pell_vec3 x)
{
    const struct pell_distance_grid *g = pell_distance_grid(distance, solid);
    float offset2;
    int32_t at;

    if (!g || !pell_distance_cube(g, x.x, x.y, x.z, &at, &offset2))
        return 0.0f;
    return pell_distance_within(g, g->steps[at], offset2);
}
