/* SPDX-License-Identifier: MIT
 *
 * plane_cache.c - reuse of planes between frames. The first frame of a solid is kept: if the solid later moves rigidly, its planes are
 * transformed; where parts of it do not move, their planes stay. A frame therefore depends on itself and on the first one only, not on the
 * frames in between.
 */
#include "methods/layered/state.h"

#include "base/hash.h"

#include <string.h>

#define RIGID_TOLERANCE 1e-4  /* relative to the radius: tolerance of a vertex under rigid motion */
#define NORMAL_TOLERANCE 1e-3 /* the same for unit normals */
enum { CELLS = 64 };

struct cached_solid {
    uint64_t hash; /* hash of all inputs of the planes except positions */
    size_t count;
    float *position, *normal;
    float (*plane)[4];
    uint64_t last; /* hash of the last frame's positions and normals */
    float (*last_plane)[4];
};

struct layered_plane_cache {
    struct pell_context *ctx;
    size_t count;
    struct cached_solid *solid; /* by the solid's first mesh; count 0: no planes */
};

/* --- Create and destroy --------------------------------------------------------------------------------------------------------- */

static void finish_solid(struct pell_context *ctx, struct cached_solid *s)
{
    pell_free(ctx, s->position);
    pell_free(ctx, s->normal);
    pell_free(ctx, s->plane);
    pell_free(ctx, s->last_plane);
    memset(s, 0, sizeof(*s));
}

static void cache_destroy(void *state)
{
    struct layered_plane_cache *cache = state;

    if (!cache)
        return;
    for (size_t i = 0; i < cache->count; i++)
        finish_solid(cache->ctx, &cache->solid[i]);
    pell_free(cache->ctx, cache->solid);
    pell_free(cache->ctx, cache);
}

enum pell_result layered_cache_begin(struct layered_state *st, const struct pell_scene *scene)
{
    struct layered_plane_cache *cache = st->services->kept ? st->services->kept->state : NULL;

    if (cache)
        st->services->kept->state = NULL;
    if (cache && cache->count != scene->num_meshes) {
        cache_destroy(cache);
        cache = NULL;
    }
    if (!cache) {
        cache = pell_zalloc(st->ctx, sizeof(*cache));
        if (!cache)
            return PELL_ERR_NOMEM;
        cache->ctx = st->ctx;
        cache->solid = pell_calloc(st->ctx, scene->num_meshes + 1, sizeof(*cache->solid));
        if (!cache->solid) {
            cache_destroy(cache);
            return PELL_ERR_NOMEM;
        }
        cache->count = scene->num_meshes;
    }
    st->cache = cache;
    return PELL_OK;
}

void layered_cache_end(struct layered_state *st)
{
    struct pell_kept *to = st->services->kept;

    if (st->cache && to) {
        if (to->state)
            to->destroy(to->state);
        *to = (struct pell_kept) { st->cache, cache_destroy };
    } else {
        cache_destroy(st->cache);
    }
    st->cache = NULL;
}

static uint64_t hash_of(const struct layered_state *st, const struct pell_scene *scene, size_t first, const struct layered_cloud *cloud)
{
    uint64_t hash = pell_hash_number(pell_hash_word(1, (uint64_t) st->knobs.planes), (double) cloud->radius);

    for (size_t i = first; i < scene->num_meshes; i++)
        if (layered_same_solid(&scene->meshes[i], &scene->meshes[first])) {
            const struct pell_mesh *m = &scene->meshes[i];
            hash = pell_hash_word(hash, (uint64_t) i << 32 | m->num_vertices);
            hash = pell_hash_bytes(hash, m->index, 3 * (size_t) m->num_triangles * sizeof(*m->index));
        }
    return hash;
}

static uint64_t hash_of_shape(const struct layered_cloud *cloud)
{
    const size_t size = 3 * cloud->fitted * sizeof(float);

    return pell_hash_bytes(pell_hash_bytes(2, cloud->position, size), cloud->normal, size);
}

/* --- Rigid motion --------------------------------------------------------------------------------------------------------------- */

struct axes {
    struct pell_dvec3 at, dir[3];
};

static struct pell_dvec3 point(const float *positions, size_t i)
{
    return dvec3_load(positions + 3 * i);
}

/* Three vertices of a solid that are far from each other; false: all are on a line. */
static bool find_distant_vertices(const float *positions, size_t count, size_t three[3])
{
    struct pell_dvec3 along;
    double most = 0.0;

    three[0] = three[1] = three[2] = 0;
    for (size_t i = 1; i < count; i++) {
        const struct pell_dvec3 d = dvec3_sub(point(positions, i), point(positions, 0));
        if (dvec3_dot(d, d) > most) {
            most = dvec3_dot(d, d);
            three[1] = i;
        }
    }
    along = dvec3_normalize(dvec3_sub(point(positions, three[1]), point(positions, 0)));
    for (size_t i = 1, n = 0; i < count; i++) {
        const struct pell_dvec3 c = dvec3_cross(along, dvec3_sub(point(positions, i), point(positions, 0)));
        most = n++ == 0 ? 0.0 : most;
        if (dvec3_dot(c, c) > most) {
            most = dvec3_dot(c, c);
            three[2] = i;
        }
    }
    return three[1] != 0 && three[2] != 0;
}

static struct axes axes_of(const float *positions, const size_t three[3])
{
    struct axes a = { .at = point(positions, three[0]) };
    const struct pell_dvec3 d = dvec3_sub(point(positions, three[1]), a.at), e = dvec3_sub(point(positions, three[2]), a.at);

    a.dir[0] = dvec3_normalize(d);
    a.dir[2] = dvec3_normalize(dvec3_cross(d, e));
    a.dir[1] = dvec3_cross(a.dir[2], a.dir[0]);
    return a;
}

static struct pell_dvec3 rotate(const struct axes *from, const struct axes *to, struct pell_dvec3 v)
{
    struct pell_dvec3 out = { 0 };

    for (int k = 0; k < 3; k++)
        out = dvec3_mad(out, dvec3_dot(v, from->dir[k]), to->dir[k]);
    return out;
}

/* Transforms the planes of the first frame; false: the solid has changed shape. */
static bool transform_planes(const struct cached_solid *s, const struct layered_cloud *cloud, float (*plane)[4])
{
    const double tolerance = RIGID_TOLERANCE * (double) cloud->radius;
    struct axes from, to;
    size_t three[3];

    if (!find_distant_vertices(s->position, s->count, three))
        return false;
    from = axes_of(s->position, three);
    to = axes_of(cloud->position, three);
    for (size_t i = 0; i < s->count; i++) {
        const struct pell_dvec3 expected = rotate(&from, &to, dvec3_sub(point(s->position, i), from.at));
        const struct pell_dvec3 off = dvec3_sub(dvec3_sub(point(cloud->position, i), to.at), expected);
        const struct pell_dvec3 change = dvec3_sub(rotate(&from, &to, point(s->normal, i)), point(cloud->normal, i));
        if (!(dvec3_dot(off, off) <= tolerance * tolerance) || !(dvec3_dot(change, change) <= NORMAL_TOLERANCE * NORMAL_TOLERANCE))
            return false;
    }
    for (size_t i = 0; i < s->count; i++) {
        vec3_store(dvec3_narrow(rotate(&from, &to, dvec3_load(s->plane[i]))), plane[i]);
        plane[i][3] = s->plane[i][3];
    }
    return true;
}

/* --- Partial motion -------------------------------------------------------------------------------------------------------------- */

/* Cells within the radius of moved geometry. */
struct cells {
    double low[3], size;
    uint8_t near[CELLS][CELLS][CELLS];
};

static int cell_of(const struct cells *c, int axis, double x)
{
    const double i = (x - c->low[axis]) / c->size;

    return i > 0.0 ? i < CELLS ? (int) i : CELLS - 1 : 0;
}

static void mark(struct cells *c, const float *positions, const size_t corner[3], double reach)
{
    int low[3], high[3];

    for (int k = 0; k < 3; k++) {
        double a = INFINITY, b = -INFINITY;
        for (int q = 0; q < 3; q++) {
            a = fmin(a, (double) positions[3 * corner[q] + (size_t) k]);
            b = fmax(b, (double) positions[3 * corner[q] + (size_t) k]);
        }
        low[k] = cell_of(c, k, a - reach);
        high[k] = cell_of(c, k, b + reach);
    }
    for (int z = low[2]; z <= high[2]; z++)
        for (int y = low[1]; y <= high[1]; y++)
            memset(&c->near[z][y][low[0]], 1, (size_t) (high[0] - low[0] + 1));
}

static void bound_cells(const struct cached_solid *s, const struct layered_cloud *cloud, struct cells *c)
{
    double high[3];

    c->size = 0.0;
    for (int k = 0; k < 3; k++) {
        c->low[k] = INFINITY;
        high[k] = -INFINITY;
        for (size_t i = (size_t) k; i < 3 * s->count; i += 3) {
            c->low[k] = fmin(c->low[k], fmin((double) s->position[i], (double) cloud->position[i]));
            high[k] = fmax(high[k], fmax((double) s->position[i], (double) cloud->position[i]));
        }
        c->size = fmax(c->size, (high[k] - c->low[k]) / CELLS);
    }
    c->size = c->size > 0.0 ? c->size : 1.0;
}

/* Copies the planes of vertices that nothing moved near, and sets their `keep` to 1. A triangle counts as its bounding box before and after
 * the motion, because points of its parts may represent it; the neighbourhood of a vertex reaches up to twice the radius. Returns the
 * number of kept planes. */
static size_t keep_planes(const struct layered_state *st, const struct pell_scene *scene, size_t first, const struct cached_solid *s,
                          const struct layered_cloud *cloud, struct cells *cells, float (*plane)[4], uint8_t *keep)
{
    size_t at = 0, kept = 0;

    bound_cells(s, cloud, cells);
    for (size_t i = 0; i < s->count; i++)
        keep[i] = memcmp(s->position + 3 * i, cloud->position + 3 * i, 3 * sizeof(float)) == 0 &&
                  memcmp(s->normal + 3 * i, cloud->normal + 3 * i, 3 * sizeof(float)) == 0;
    for (size_t i = first; i < scene->num_meshes; i++) {
        const struct pell_mesh *m = &scene->meshes[i];
        if (!layered_same_solid(m, &scene->meshes[first]))
            continue;
        for (uint32_t t = 0; t < m->num_triangles && !pell_cancelled_at(st->ctx, t); t++) {
            size_t corner[3];
            for (int k = 0; k < 3; k++)
                corner[k] = at + m->index[3 * (size_t) t + (size_t) k];
            if (keep[corner[0]] && keep[corner[1]] && keep[corner[2]])
                continue;
            mark(cells, s->position, corner, 2.0 * (double) cloud->radius);
            mark(cells, cloud->position, corner, 2.0 * (double) cloud->radius);
        }
        at += m->num_vertices;
    }
    for (size_t i = 0; i < s->count; i++) {
        const float *p = cloud->position + 3 * i;
        keep[i] =
            keep[i] && !cells->near[cell_of(cells, 2, (double) p[2])][cell_of(cells, 1, (double) p[1])][cell_of(cells, 0, (double) p[0])];
        if (keep[i])
            memcpy(plane[i], s->plane[i], sizeof(*plane));
        kept += keep[i];
    }
    return kept;
}

/* --- One solid ------------------------------------------------------------------------------------------------------------------ */

enum pell_result layered_cache_load(const struct layered_state *st, const struct pell_scene *scene, size_t first,
                                    const struct layered_cloud *cloud, float (*plane)[4], uint8_t *keep, size_t *left)
{
    const struct cached_solid *s = &st->cache->solid[first];
    struct cells *cells;

    *left = cloud->fitted;
    if (s->count == 0 || s->count != cloud->fitted || s->hash != hash_of(st, scene, first, cloud))
        return PELL_OK;
    if (s->last == hash_of_shape(cloud)) {
        memcpy(plane, s->last_plane, s->count * sizeof(*plane));
        *left = 0;
    } else if (transform_planes(s, cloud, plane)) {
        *left = 0;
    } else {
        cells = pell_zalloc(st->ctx, sizeof(*cells));
        if (!cells)
            return PELL_ERR_NOMEM;
        *left -= keep_planes(st, scene, first, s, cloud, cells, plane, keep);
        pell_free(st->ctx, cells);
    }
    return PELL_OK;
}

enum pell_result layered_cache_store(const struct layered_state *st, const struct pell_scene *scene, size_t first,
                                     const struct layered_cloud *cloud, const float (*plane)[4])
{
    struct cached_solid *s = &st->cache->solid[first];
    const uint64_t hash = hash_of(st, scene, first, cloud);
    const size_t n = cloud->fitted;

    if (s->count != n || s->hash != hash) {
        finish_solid(st->ctx, s);
        s->position = pell_alloc_array(st->ctx, n + 1, 3 * sizeof(float));
        s->normal = pell_alloc_array(st->ctx, n + 1, 3 * sizeof(float));
        s->plane = pell_alloc_array(st->ctx, n + 1, sizeof(*s->plane));
        s->last_plane = pell_alloc_array(st->ctx, n + 1, sizeof(*s->plane));
        if (!s->position || !s->normal || !s->plane || !s->last_plane)
            return PELL_ERR_NOMEM;
        memcpy(s->position, cloud->position, 3 * n * sizeof(float));
        memcpy(s->normal, cloud->normal, 3 * n * sizeof(float));
        memcpy(s->plane, plane, n * sizeof(*s->plane));
        s->count = n;
        s->hash = hash;
    }
    s->last = hash_of_shape(cloud);
    memcpy(s->last_plane, plane, n * sizeof(*s->plane));
    return PELL_OK;
}
