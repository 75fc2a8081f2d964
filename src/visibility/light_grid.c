/* SPDX-License-Identifier: MIT
 * light_grid.c - see light_grid.h. Packet queries are in light_grid_kernel.c. */
#include "visibility/light_grid.h"

#include "math/scalar.h"
#include "scene/triangle.h"

#include <stdlib.h>
#include <string.h>

PELL_SIMD_TABLES(struct pell_light_grid_kernels, pell_light_grid_kernels);

#define MAX_TRIANGLES (1u << 18) /* of 64 bytes: building a larger grid takes longer than an image saves */
#define MAX_SIDE 2048            /* cells per side */
#define PER_CELL 3.0             /* mean number of triangles per cell */
#define MAX_ENTRIES 8            /* mean number of cells per triangle: for larger triangles rays are faster */
#define MAX_LENGTH 48.0          /* mean length of the lists: for longer ones rays are faster */
#define MAX_SLOPE 4.0f           /* of a ray relative to the axis */
#define MAX_APEX_DISTANCE 8.0f   /* distance of the apex over the scene's size: rounding errors grow with it */
#define MARGIN 0.02f             /* in cells, around a triangle */
#define ROUNDING 1e-6f           /* of a slope: bound of the rounding error of projected points; it grows with the square of the slope */
#define SHORT 24                 /* shorter lists are sorted by insertion */

/* Like pell_rays_show, for shadow casters of a light. */
static bool is_shadow_caster(const struct pell_scene *scene, const struct pell_mesh *m, bool *cut)
{
    return pell_rays_show(scene, m, cut) && !m->light_shell;
}

/* A vertex: projected position, and depth. */
static struct pell_vec3 project(const struct pell_light_grid *f, const float *position)
{
    const struct pell_vec3 d = vec3_sub(vec3_load(position), f->apex);
    const float z = vec3_dot(d, f->forward);

    return vec3(vec3_dot(d, f->right) / z, vec3_dot(d, f->up) / z, z);
}

/* Counts triangles and finds their projected bounds. False: no light grid. */
static bool find_bounds(const struct pell_scene *scene, struct pell_light_grid *f, size_t *count, float border[4])
{
    const struct pell_vec3 low = vec3_load(scene->bounds_min), high = vec3_load(scene->bounds_max);
    const struct pell_vec3 middle = vec3_sub(vec3_mul(vec3_add(low, high), 0.5f), f->apex);
    const float least = 1e-3f * vec3_length(middle);
    bool cut;

    *count = 0;
    border[0] = border[2] = INFINITY;
    border[1] = border[3] = -INFINITY;
    if (!(least > 0.0f) || !(1e3f * least < MAX_APEX_DISTANCE * vec3_length(vec3_sub(high, low))))
        return false;
    f->forward = vec3_normalize(middle);
    vec3_basis(f->forward, &f->right, &f->up);
    for (size_t i = 0; i < scene->num_meshes; i++) {
        const struct pell_mesh *m = &scene->meshes[i];
        if (!is_shadow_caster(scene, m, &cut))
            continue;
        *count += m->num_triangles;
        if (cut || *count > MAX_TRIANGLES)
            return false;
        for (size_t k = 0; k < 3 * (size_t) m->num_triangles; k++) {
            const struct pell_vec3 p = project(f, m->position + 3 * (size_t) m->index[k]);
            if (!(p.z > least) || !(fabsf(p.x) < MAX_SLOPE) || !(fabsf(p.y) < MAX_SLOPE))
                return false;
            border[0] = p.x < border[0] ? p.x : border[0];
            border[1] = p.x > border[1] ? p.x : border[1];
            border[2] = p.y < border[2] ? p.y : border[2];
            border[3] = p.y > border[3] ? p.y : border[3];
        }
    }
    return *count > 0 && border[1] > border[0] && border[3] > border[2];
}

static void choose_cells(struct pell_light_grid *f, size_t count, const float border[4])
{
    const double w = (double) border[1] - (double) border[0], h = (double) border[3] - (double) border[2];
    const double cells = (double) count / PER_CELL + 1.0, columns = ceil(sqrt(cells * w / h)), rows = ceil(sqrt(cells * h / w));
    const float x = LARGER(-border[0], border[1]), y = LARGER(-border[2], border[3]), rounding = ROUNDING * (1.0f + x * x + y * y);

    f->columns = columns < MAX_SIDE ? (int) columns : MAX_SIDE;
    f->rows = rows < MAX_SIDE ? (int) rows : MAX_SIDE;
    f->left = border[0];
    f->low = border[2];
    f->inv_x = (float) ((double) f->columns / w);
    f->inv_y = (float) ((double) f->rows / h);
    f->margin_x = MARGIN + rounding * f->inv_x;
    f->margin_y = MARGIN + rounding * f->inv_y;
}

static int clamp(float v, int most)
{
    return v > 0.0f ? v < (float) most ? (int) v : most : 0;
}

/* The cells covered by a triangle's bounds. */
struct span {
    int x0, x1, y0, y1;
    float depth, end;
};

static struct span cells_of(const struct pell_light_grid *f, const struct pell_mesh *m, size_t triangle)
{
    float x0 = INFINITY, x1 = -INFINITY, y0 = INFINITY, y1 = -INFINITY, depth = INFINITY, end = 0.0f;

    for (size_t k = 0; k < 3; k++) {
        const struct pell_vec3 p = project(f, m->position + 3 * (size_t) m->index[3 * triangle + k]);
        const float x = (p.x - f->left) * f->inv_x, y = (p.y - f->low) * f->inv_y;
        x0 = x < x0 ? x : x0;
        x1 = x > x1 ? x : x1;
        y0 = y < y0 ? y : y0;
        y1 = y > y1 ? y : y1;
        depth = p.z < depth ? p.z : depth;
        end = p.z > end ? p.z : end;
    }
    return (struct span) { clamp(x0 - f->margin_x, f->columns - 1),
                           clamp(x1 + f->margin_x, f->columns - 1),
                           clamp(y0 - f->margin_y, f->rows - 1),
                           clamp(y1 + f->margin_y, f->rows - 1),
                           depth * (1.0f - 1e-5f),
                           end * (1.0f + 1e-5f) };
}

static struct pell_vec3 side(struct pell_vec3 a, struct pell_vec3 b)
{
    return vec3_cross(vec3_sub(a, b), vec3_add(a, b));
}

/* False if it is seen edge-on and therefore occludes nothing. */
static bool make_triangle(const struct pell_light_grid *f, const struct pell_mesh *m, uint32_t triangle,
                          struct pell_light_grid_triangle *out, float *orientation)
{
    struct pell_vec3 p[3], v[3], normal;
    float plane, turn;

    pell_triangle_corners(m, triangle, p);
    normal = pell_triangle_cross(p);
    for (int k = 0; k < 3; k++)
        v[k] = vec3_sub(p[k], f->apex);
    plane = vec3_dot(normal, v[0]);
    if (!(fabsf(plane) > 0.0f))
        return false;
    *orientation = turn = plane > 0.0f ? 1.0f : -1.0f;
    for (int k = 0; k < 3; k++)
        vec3_store(vec3_mul(side(v[k], v[(k + 1) % 3]), turn), out->edge[k]);
    vec3_store(p[0], out->corner);
    vec3_store(vec3_mul(normal, turn), out->normal);
    out->plane = turn * plane;
    return true;
}

static int by_depth(const void *a, const void *b)
{
    const struct pell_light_grid_entry *p = a, *q = b;

    if (p->depth != q->depth)
        return p->depth < q->depth ? -1 : 1;
    return (int) (p->triangle & PELL_LIGHT_GRID_INDEX) - (int) (q->triangle & PELL_LIGHT_GRID_INDEX);
}

static void sort(struct pell_light_grid_entry *list, uint32_t count)
{
    if (count > SHORT) {
        qsort(list, count, sizeof(*list), by_depth);
        return;
    }
    for (uint32_t i = 1; i < count; i++) {
        const struct pell_light_grid_entry e = list[i];
        uint32_t k = i;
        for (; k > 0 && by_depth(&list[k - 1], &e) > 0; k--)
            list[k] = list[k - 1];
        list[k] = e;
    }
}

/* Computes prefix sums of the cells' entries in f->first. False: too many in total, or in one cell. */
static bool count_entries(const struct pell_scene *scene, struct pell_light_grid *f, size_t triangles)
{
    const size_t cells = (size_t) f->columns * (size_t) f->rows, most = MAX_ENTRIES * triangles + 64;
    double squares = 0.0;
    size_t sum = 0;
    bool cut;

    for (size_t i = 0; i < scene->num_meshes; i++) {
        const struct pell_mesh *m = &scene->meshes[i];
        for (size_t t = 0; is_shadow_caster(scene, m, &cut) && t < m->num_triangles; t++) {
            const struct span s = cells_of(f, m, t);
            f->max_thickness = s.end - s.depth > f->max_thickness ? s.end - s.depth : f->max_thickness;
            sum += (size_t) (s.x1 - s.x0 + 1) * (size_t) (s.y1 - s.y0 + 1);
            if (sum > most)
                return false;
            for (int y = s.y0; y <= s.y1; y++)
                for (int x = s.x0; x <= s.x1; x++)
                    f->first[(size_t) y * (size_t) f->columns + (size_t) x + 1]++;
        }
    }
    for (size_t i = 1; i <= cells; i++) {
        squares += (double) f->first[i] * (double) f->first[i];
        f->first[i] += f->first[i - 1];
    }
    return squares <= MAX_LENGTH * (double) sum;
}

/* A light grid only saves time, so it may use at most a quarter of the remaining memory limit. */
static bool room_for(const struct pell_context *ctx, size_t bytes)
{
    const size_t limit = (size_t) pell_context_limits(ctx)->memory_bytes, used = pell_memory_used(ctx);

    return used < limit && bytes < (limit - used) / 4;
}

/* `starts`: per cell, the number of triangles that begin in the cells before: neighbours in the projection are neighbours in memory. */
static void find_starts(const struct pell_scene *scene, const struct pell_light_grid *f, uint32_t *starts)
{
    const size_t cells = (size_t) f->columns * (size_t) f->rows;
    uint32_t sum = 0;
    bool cut;

    for (size_t i = 0; i < scene->num_meshes; i++) {
        const struct pell_mesh *m = &scene->meshes[i];
        for (size_t t = 0; is_shadow_caster(scene, m, &cut) && t < m->num_triangles; t++) {
            const struct span s = cells_of(f, m, t);
            starts[(size_t) s.y0 * (size_t) f->columns + (size_t) s.x0]++;
        }
    }
    for (size_t i = 0; i < cells; i++) {
        const uint32_t count = starts[i];
        starts[i] = sum;
        sum += count;
    }
}

static void fill(const struct pell_scene *scene, struct pell_light_grid *f, uint32_t *starts)
{
    const size_t cells = (size_t) f->columns * (size_t) f->rows;
    bool cut;

    for (size_t i = 0; i < scene->num_meshes; i++) {
        const struct pell_mesh *m = &scene->meshes[i];
        for (size_t t = 0; is_shadow_caster(scene, m, &cut) && t < m->num_triangles; t++) {
            const struct span s = cells_of(f, m, t);
            const uint32_t number = starts[(size_t) s.y0 * (size_t) f->columns + (size_t) s.x0]++;
            f->sources[number] = (struct pell_light_grid_source) { (uint32_t) i, (uint32_t) t, 1.0f };
            if (!make_triangle(f, m, t, &f->triangles[number], &f->sources[number].orientation))
                memset(&f->triangles[number], 0, sizeof(f->triangles[number])); /* occludes nothing: s is 0 */
            for (int y = s.y0; y <= s.y1; y++)
                for (int x = s.x0; x <= s.x1; x++) {
                    const uint32_t begins = (x == s.x0 ? PELL_LIGHT_GRID_LEFT : 0) | (y == s.y0 ? PELL_LIGHT_GRID_LOW : 0);
                    f->entries[f->first[(size_t) y * (size_t) f->columns + (size_t) x]++] =
                        (struct pell_light_grid_entry) { number | begins, s.depth };
                }
        }
    }
    /* Each cell's start has become its end, which is the next one's start. */
    memmove(f->first + 1, f->first, cells * sizeof(*f->first));
    f->first[0] = 0;
    for (size_t i = 0; i < cells; i++)
        sort(f->entries + f->first[i], f->first[i + 1] - f->first[i]);
}

enum pell_result pell_light_grid_create(struct pell_context *ctx, const struct pell_scene *scene, struct pell_vec3 apex,
                                        struct pell_light_grid **out)
{
    struct pell_light_grid *f = pell_zalloc(ctx, sizeof(*f));
    uint32_t *starts = NULL;
    float border[4];
    size_t triangles, cells, fixed;
    enum pell_result res = PELL_ERR_NOMEM;

    *out = NULL;
    if (!f)
        return PELL_ERR_NOMEM;
    f->ctx = ctx;
    f->kernels = pell_light_grid_kernels_tables[pell_simd_best()];
    f->apex = apex;
    if (!find_bounds(scene, f, &triangles, border))
        goto none;
    choose_cells(f, triangles, border);
    cells = (size_t) f->columns * (size_t) f->rows;
    fixed = triangles * (sizeof(*f->triangles) + sizeof(*f->sources)) + cells * sizeof(*starts);
    if (!room_for(ctx, fixed + cells * sizeof(*f->first)))
        goto none;
    f->first = pell_calloc(ctx, cells + 1, sizeof(*f->first));
    if (!f->first)
        goto fail;
    if (!count_entries(scene, f, triangles) || !room_for(ctx, fixed + (size_t) f->first[cells] * sizeof(*f->entries)))
        goto none;
    f->entries = pell_calloc(ctx, (size_t) f->first[cells], sizeof(*f->entries));
    f->triangles = pell_alloc_array(ctx, triangles, sizeof(*f->triangles));
    f->sources = pell_alloc_array(ctx, triangles, sizeof(*f->sources));
    starts = pell_calloc(ctx, cells, sizeof(*starts));
    if (!f->entries || !f->triangles || !f->sources || !starts)
        goto fail;
    find_starts(scene, f, starts);
    fill(scene, f, starts);
    pell_free(ctx, starts);
    *out = f;
    return PELL_OK;

none:
    res = PELL_OK;
fail:
    pell_free(ctx, starts);
    pell_light_grid_destroy(&f);
    return res;
}

void pell_light_grid_destroy(struct pell_light_grid **grid)
{
    struct pell_light_grid *f = *grid;

    if (!f)
        return;
    *grid = NULL;
    pell_free(f->ctx, f->sources);
    pell_free(f->ctx, f->triangles);
    pell_free(f->ctx, f->entries);
    pell_free(f->ctx, f->first);
    pell_free(f->ctx, f);
}

bool pell_light_grid_visible16(const struct pell_light_grid *grid, const int32_t *mask, const float *x, const float *y, const float *z,
                               int32_t *visible)
{
    return grid->kernels->visible(grid, mask, x, y, z, visible);
}

bool pell_light_grid_closest16(const struct pell_light_grid *grid, const int32_t *mask, struct pell_ray_hit16 *packet)
{
    return grid->kernels->closest(grid, mask, packet);
}
