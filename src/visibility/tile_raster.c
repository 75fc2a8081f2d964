/* SPDX-License-Identifier: MIT
 * tile_raster.c - see tile_raster.h: triangle lists by tile. The processing of triangles and pixels is in tile_raster_kernel.c. */
#include "visibility/tile_raster.h"

#include <string.h>

PELL_SIMD_TABLES(struct pell_raster_kernels, pell_raster_kernels);

#define MAX_TRIANGLES (1u << 24)
#define VERTICES 4096        /* per task */
#define ENTRIES_A_TRIANGLE 2 /* capacity of the lists: mean number of tiles per triangle */
#define ENTRIES_A_TILE 16
#define PER_PIXEL 1.5 /* triangles per pixel: with more, rays are faster */

static int tiles_of(int pixels)
{
    return (pixels + PELL_RASTER_TILE - 1) / PELL_RASTER_TILE;
}

/* The rasteriser is an optimisation: it uses at most a quarter of the memory that the context may still allocate. */
static bool room_for(const struct pell_context *ctx, size_t bytes)
{
    const size_t limit = (size_t) pell_context_limits(ctx)->memory_bytes, used = pell_memory_used(ctx);

    return used < limit && bytes < (limit - used) / 4;
}

/* False: the raster can't be used. */
static bool count(struct pell_raster *r, const struct pell_scene *scene)
{
    bool cut;

    for (size_t i = 0; i < scene->num_meshes; i++) {
        const struct pell_mesh *m = &scene->meshes[i];
        if (!pell_rays_show(scene, m, &cut))
            continue;
        r->num_triangles += m->num_triangles;
        r->num_vertices += m->num_vertices;
        if (cut || r->num_triangles > MAX_TRIANGLES || r->num_vertices > 3 * (size_t) MAX_TRIANGLES)
            return false;
    }
    return r->num_triangles > 0 && (double) r->num_triangles <= PER_PIXEL * (double) r->width * (double) r->height;
}

static void number_vertices(struct pell_raster *r)
{
    const struct pell_scene *scene = r->scene;
    size_t vertex = 0, triangle = 0;
    bool cut;

    for (size_t i = 0; i < scene->num_meshes; i++) {
        const struct pell_mesh *m = &scene->meshes[i];
        r->first_vertex[i] = (uint32_t) vertex;
        r->first_triangle[i] = (uint32_t) triangle;
        if (!pell_rays_show(scene, m, &cut))
            continue;
        for (size_t k = 0; k < m->num_triangles; k++) {
            struct pell_raster_triangle *t = &r->triangles[triangle + k];
            for (size_t c = 0; c < 3; c++)
                t->vertex[c] = (uint32_t) vertex + m->index[3 * k + c];
            t->mesh = (uint32_t) i;
        }
        vertex += m->num_vertices;
        triangle += m->num_triangles;
    }
}

enum pell_result pell_raster_create(struct pell_context *ctx, const struct pell_scene *scene, int width, int height,
                                    struct pell_raster **out)
{
    struct pell_raster *r = pell_zalloc(ctx, sizeof(*r));
    enum pell_result res = PELL_ERR_NOMEM;
    size_t tiles, lists;

    *out = NULL;
    if (!r)
        return PELL_ERR_NOMEM;
    r->ctx = ctx;
    r->kernels = pell_raster_kernels_tables[pell_simd_best()];
    r->scene = scene;
    r->width = width;
    r->height = height;
    r->columns = tiles_of(width);
    r->rows = tiles_of(height);
    if (!count(r, scene))
        goto none;
    tiles = (size_t) r->columns * (size_t) r->rows;
    lists = 2 * tiles;
    r->capacity = ENTRIES_A_TRIANGLE * r->num_triangles + ENTRIES_A_TILE * tiles;
    if (r->capacity > UINT32_MAX / PELL_RASTER_CHUNKS ||
        !room_for(ctx, r->num_vertices * sizeof(*r->vertices) + r->num_triangles * (sizeof(*r->triangles) + sizeof(*r->spans)) +
                           (lists * (PELL_RASTER_CHUNKS + 1) + r->capacity) * sizeof(uint32_t)))
        goto none;
    r->slope_x = pell_calloc(ctx, (size_t) (r->columns + r->rows) * PELL_RASTER_TILE, sizeof(*r->slope_x));
    r->slope_y = r->slope_x ? r->slope_x + r->columns * PELL_RASTER_TILE : NULL;
    r->vertices = pell_alloc_array(ctx, r->num_vertices, sizeof(*r->vertices));
    r->triangles = pell_alloc_array(ctx, r->num_triangles, sizeof(*r->triangles));
    r->first_triangle = pell_alloc_array(ctx, scene->num_meshes, sizeof(*r->first_triangle));
    r->first_vertex = pell_alloc_array(ctx, scene->num_meshes, sizeof(*r->first_vertex));
    r->spans = pell_alloc_array(ctx, r->num_triangles, sizeof(*r->spans));
    r->counts = pell_alloc_array(ctx, PELL_RASTER_CHUNKS * lists, sizeof(*r->counts));
    r->first = pell_alloc_array(ctx, lists + 1, sizeof(*r->first));
    r->entries = pell_alloc_array(ctx, r->capacity, sizeof(*r->entries));
    if (!r->slope_x || !r->vertices || !r->triangles || !r->first_triangle || !r->first_vertex || !r->spans || !r->counts || !r->first ||
        !r->entries)
        goto fail;
    number_vertices(r);
    *out = r;
    return PELL_OK;

none:
    res = PELL_OK;
fail:
    pell_raster_destroy(&r);
    return res;
}

void pell_raster_destroy(struct pell_raster **raster)
{
    struct pell_raster *r = *raster;

    if (!r)
        return;
    *raster = NULL;
    pell_free(r->ctx, r->entries);
    pell_free(r->ctx, r->first);
    pell_free(r->ctx, r->counts);
    pell_free(r->ctx, r->spans);
    pell_free(r->ctx, r->first_vertex);
    pell_free(r->ctx, r->first_triangle);
    pell_free(r->ctx, r->triangles);
    pell_free(r->ctx, r->vertices);
    pell_free(r->ctx, r->slope_x);
    pell_free(r->ctx, r);
}

/* --- Drawing -------------------------------------------------------------------------------------------------------------------- */

/* The mesh of a vertex: the last one that begins at it or before, because hidden meshes begin where the next one does. */
static size_t mesh_at(const struct pell_raster *r, size_t vertex)
{
    size_t low = 0, high = r->scene->num_meshes;

    while (high - low > 1) {
        const size_t middle = low + (high - low) / 2;
        if (r->first_vertex[middle] <= vertex)
            low = middle;
        else
            high = middle;
    }
    return low;
}

static void vertex_task(void *arg, int index, int worker)
{
    const struct pell_raster *r = arg;
    const size_t begin = (size_t) index * VERTICES, end = begin + VERTICES < r->num_vertices ? begin + VERTICES : r->num_vertices;
    bool cut;
    (void) worker;

    for (size_t i = mesh_at(r, begin); i < r->scene->num_meshes && r->first_vertex[i] < end; i++) {
        const struct pell_mesh *m = &r->scene->meshes[i];
        const size_t base = r->first_vertex[i], low = begin > base ? begin - base : 0, high = end > base ? end - base : 0;
        const size_t stop = high < m->num_vertices ? high : m->num_vertices;
        if (pell_rays_show(r->scene, m, &cut) && low < stop)
            r->kernels->vertices(&r->view, m->position + 3 * low, stop - low, r->vertices + base + low);
    }
}

static size_t chunk_begin(const struct pell_raster *r, int chunk)
{
    return r->num_triangles * (size_t) chunk / PELL_RASTER_CHUNKS;
}

static uint32_t *counts_of(const struct pell_raster *r, int chunk)
{
    return r->counts + (size_t) chunk * 2 * (size_t) r->columns * (size_t) r->rows;
}

static void count_task(void *arg, int chunk, int worker)
{
    struct pell_raster *r = arg;
    uint32_t *counts = counts_of(r, chunk);
    (void) worker;

    memset(counts, 0, 2 * (size_t) r->columns * (size_t) r->rows * sizeof(*counts));
    if (!r->kernels->spans(r, chunk_begin(r, chunk), chunk_begin(r, chunk + 1), r->spans)) {
        atomic_store_explicit(&r->failed, true, memory_order_relaxed);
        return;
    }
    for (size_t t = chunk_begin(r, chunk), room = r->capacity; t < chunk_begin(r, chunk + 1); t++) {
        const struct pell_raster_span s = r->spans[t];
        const size_t y0 = s.y0 & (PELL_RASTER_BACK - 1), back = (s.y0 & PELL_RASTER_BACK) != 0;
        const size_t touched = s.x0 <= s.x1 ? (size_t) (s.x1 - s.x0 + 1) * (s.y1 - y0 + 1) : 0;

        if (touched > room) {
            atomic_store_explicit(&r->failed, true, memory_order_relaxed);
            return;
        }
        room -= touched;
        for (size_t y = y0; y <= s.y1; y++)
            for (size_t x = s.x0; x <= s.x1; x++)
                counts[2 * (y * (size_t) r->columns + x) + back]++;
    }
}

static void list_task(void *arg, int chunk, int worker)
{
    const struct pell_raster *r = arg;
    uint32_t *at = counts_of(r, chunk);
    (void) worker;

    for (size_t t = chunk_begin(r, chunk); t < chunk_begin(r, chunk + 1); t++) {
        const struct pell_raster_span s = r->spans[t];
        const size_t y0 = s.y0 & (PELL_RASTER_BACK - 1), back = (s.y0 & PELL_RASTER_BACK) != 0;

        for (size_t y = y0; y <= s.y1; y++)
            for (size_t x = s.x0; x <= s.x1; x++) {
                const size_t list = 2 * (y * (size_t) r->columns + x) + back;
                r->entries[r->first[list] + at[list]++] = (uint32_t) t;
            }
    }
}

/* The start of each list, and of each chunk's part in it: lists are in the order of the triangles, independent of threads. */
static bool place_lists(struct pell_raster *r)
{
    const size_t lists = 2 * (size_t) r->columns * (size_t) r->rows;
    uint32_t *restrict first = r->first;
    size_t sum = 0;

    memset(first, 0, (lists + 1) * sizeof(*first));
    for (int chunk = 0; chunk < PELL_RASTER_CHUNKS; chunk++) {
        uint32_t *restrict counts = counts_of(r, chunk);
        for (size_t i = 0; i < lists; i++) {
            const uint32_t n = counts[i];
            counts[i] = first[i];
            first[i] += n;
        }
    }
    for (size_t i = 0; i < lists; i++) {
        const uint32_t n = first[i];
        first[i] = (uint32_t) sum;
        sum += n;
        if (sum > r->capacity)
            return false;
    }
    first[lists] = (uint32_t) sum;
    return true;
}

bool pell_raster_draw(struct pell_raster *r, struct pell_pool *pool, const struct pell_raster_view *view, int64_t pixels)
{
    const float inverse = 1.0f / view->focal;

    if ((double) r->num_triangles > PER_PIXEL * (double) pixels)
        return false;
    r->view = *view;
    atomic_store(&r->failed, false);
    for (int x = 0; x < r->columns * PELL_RASTER_TILE; x++)
        r->slope_x[x] = ((float) x + view->left) * inverse;
    for (int y = 0; y < r->rows * PELL_RASTER_TILE; y++)
        r->slope_y[y] = (view->top - (float) y) * inverse;
    pell_pool_run(pool, (int) ((r->num_vertices + VERTICES - 1) / VERTICES), vertex_task, r);
    pell_pool_run(pool, PELL_RASTER_CHUNKS, count_task, r);
    if (pell_cancelled(r->ctx) || atomic_load(&r->failed) || !place_lists(r))
        return false;
    pell_pool_run(pool, PELL_RASTER_CHUNKS, list_task, r);
    return !pell_cancelled(r->ctx);
}

int pell_raster_columns(const struct pell_raster *raster)
{
    return raster->columns;
}

int pell_raster_tiles(const struct pell_raster *raster)
{
    return raster->columns * raster->rows;
}

bool pell_raster_tile(const struct pell_raster *raster, int number, struct pell_raster_tile *tile)
{
    const uint32_t *first = raster->first + 2 * (size_t) number;

    if (first[0] == first[2])
        return false;
    raster->kernels->tile(raster, number, tile);
    return true;
}

void pell_raster_intersect16(const struct pell_raster *raster, const int32_t *triangle, struct pell_ray_hit16 *packet,
                             struct pell_corners *corners)
{
    raster->kernels->intersect(raster, triangle, packet, corners);
}
