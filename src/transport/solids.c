/* SPDX-License-Identifier: MIT
 * solids.c - see solids.h. */
#include "transport/solids.h"

#include "scene/mesh/topology.h"

#include <string.h>

#define CURVE_BITS 20 /* bits per coordinate along the curve */

struct curve_point {
    uint64_t code;
    uint32_t mesh, triangle;
    double area;
};

void pell_solids_destroy(struct pell_solids **solids)
{
    struct pell_solids *b = *solids;

    if (!b)
        return;
    *solids = NULL;
    for (size_t i = 0; b->solids && i < b->count; i++) {
        pell_free(b->ctx, b->solids[i].triangles);
        pell_free(b->ctx, b->solids[i].area_after);
    }
    pell_free(b->ctx, b->solids);
    pell_free(b->ctx, b->of_mesh);
    pell_free(b->ctx, b);
}

/* --- Space-filling curve -------------------------------------------------------------------------------------------------------- */

/* Position along the Hilbert curve in the unit cube: Skilling 2004, "Programming the Hilbert Curve", AIP Conf. Proc. 707. */
static uint64_t hilbert(uint32_t x, uint32_t y, uint32_t z)
{
    uint32_t p[3] = { x, y, z }, t;
    uint64_t code = 0;

    for (uint32_t q = 1u << (CURVE_BITS - 1); q > 1; q >>= 1)
        for (int i = 0; i < 3; i++) {
            if (p[i] & q) {
                p[0] ^= q - 1;
            } else {
                t = (p[0] ^ p[i]) & (q - 1);
                p[0] ^= t;
                p[i] ^= t;
            }
        }
    for (int i = 1; i < 3; i++)
        p[i] ^= p[i - 1];
    t = 0;
    for (uint32_t q = 1u << (CURVE_BITS - 1); q > 1; q >>= 1)
        if (p[2] & q)
            t ^= q - 1;
    for (int bit = CURVE_BITS - 1; bit >= 0; bit--)
        for (int i = 0; i < 3; i++)
            code = code << 1 | ((p[i] ^ t) >> bit & 1);
    return code;
}

static uint32_t step_of(float x, float low, float size)
{
    const float f = size > 0.0f ? (x - low) / size : 0.0f;
    return (uint32_t) (fminf(fmaxf(f, 0.0f), 0.999999f) * (float) (1u << CURVE_BITS));
}

static void measure(const struct pell_mesh *m, uint32_t triangle, struct pell_vec3 *centre, double *area)
{
    const uint32_t *index = m->index + 3 * (size_t) triangle;
    double p[3][3], n[3];

    for (int k = 0; k < 3; k++)
        for (int j = 0; j < 3; j++)
            p[k][j] = (double) m->position[3 * (size_t) index[k] + (size_t) j];
    for (int j = 0; j < 3; j++) {
        const int a = (j + 1) % 3, b = (j + 2) % 3;
        n[j] = (p[1][a] - p[0][a]) * (p[2][b] - p[0][b]) - (p[1][b] - p[0][b]) * (p[2][a] - p[0][a]);
    }
    *area = 0.5 * sqrt(n[0] * n[0] + n[1] * n[1] + n[2] * n[2]);
    *centre = vec3((float) ((p[0][0] + p[1][0] + p[2][0]) / 3.0), (float) ((p[0][1] + p[1][1] + p[2][1]) / 3.0),
                   (float) ((p[0][2] + p[1][2] + p[2][2]) / 3.0));
}

static uint64_t code_at(const void *items, size_t index)
{
    return ((const struct curve_point *) items)[index].code;
}

/* Sorts the solid's triangles by `points` along the curve; the sort is stable. */
static enum pell_result sort_points(struct pell_context *ctx, const struct curve_point *points, size_t count, struct pell_solid *solid)
{
    uint32_t *order;
    enum pell_result res = pell_order_by_code(ctx, count, code_at, points, &order);

    for (size_t i = 0; res == PELL_OK && i < count; i++) {
        const struct curve_point *p = &points[order[i]];
        if (pell_cancelled_at(ctx, i))
            res = PELL_ERR_CANCELLED;
        solid->triangles[i] = (struct pell_solid_triangle) { p->mesh, p->triangle };
        solid->area += p->area;
        solid->area_after[i] = solid->area;
    }
    solid->num_triangles = count;
    pell_free(ctx, order);
    return res;
}

/* Lists the triangles of solid `number` in order; its `count` meshes are at `meshes`. */
static enum pell_result list_triangles(struct pell_solids *b, const struct pell_scene *scene, size_t number, const uint32_t *meshes,
                                       size_t count)
{
    struct pell_solid *solid = &b->solids[number];
    struct curve_point *points = NULL;
    struct pell_vec3 low = { INFINITY, INFINITY, INFINITY }, high = { -INFINITY, -INFINITY, -INFINITY };
    size_t most = 0, n = 0;
    float size;
    enum pell_result res = PELL_ERR_NOMEM;

    for (size_t i = 0; i < count; i++) {
        const struct pell_mesh *m = &scene->meshes[meshes[i]];
        most += m->num_triangles;
        for (size_t v = 0; v < m->num_vertices && !pell_cancelled_at(b->ctx, v); v++) {
            const float *p = m->position + 3 * v;
            low = vec3(fminf(low.x, p[0]), fminf(low.y, p[1]), fminf(low.z, p[2]));
            high = vec3(fmaxf(high.x, p[0]), fmaxf(high.y, p[1]), fmaxf(high.z, p[2]));
        }
    }
    size = fmaxf(high.x - low.x, fmaxf(high.y - low.y, high.z - low.z));
    points = pell_alloc_array(b->ctx, most + 1, sizeof(*points));
    solid->triangles = pell_alloc_array(b->ctx, most + 1, sizeof(*solid->triangles));
    solid->area_after = pell_alloc_array(b->ctx, most + 1, sizeof(*solid->area_after));
    if (!points || !solid->triangles || !solid->area_after)
        goto fail;
    for (size_t i = 0; i < count; i++)
        for (uint32_t t = 0; t < scene->meshes[meshes[i]].num_triangles && !pell_cancelled_at(b->ctx, t); t++) {
            struct pell_vec3 c;
            double area;
            measure(&scene->meshes[meshes[i]], t, &c, &area);
            if (!(area > 0.0 && area < INFINITY))
                continue;
            points[n++] = (struct curve_point) { hilbert(step_of(c.x, low.x, size), step_of(c.y, low.y, size), step_of(c.z, low.z, size)),
                                                 meshes[i], t, area };
        }
    res = pell_cancelled(b->ctx) ? PELL_ERR_CANCELLED : sort_points(b->ctx, points, n, solid);

fail:
    pell_free(b->ctx, points);
    return res;
}

/* Hash table from an object's index to its solids, chained by `next`. */
struct by_object {
    int32_t *first, *next;
    size_t mask;
};

static int32_t *row_of(const struct by_object *o, int object)
{
    return &o->first[((uint32_t) object * 2654435761u >> 7) & o->mask];
}

static enum pell_result by_object_create(struct pell_context *ctx, size_t count, struct by_object *o)
{
    for (o->mask = 1; o->mask < count; o->mask *= 2)
        continue;
    o->first = pell_alloc_array(ctx, o->mask, sizeof(*o->first));
    o->next = pell_alloc_array(ctx, count + 1, sizeof(*o->next));
    if (!o->first || !o->next)
        return PELL_ERR_NOMEM;
    memset(o->first, -1, o->mask * sizeof(*o->first));
    o->mask--;
    return PELL_OK;
}

/* The solid of a mesh's triangles, created if necessary. */
static int32_t solid_of(struct pell_solids *b, const struct by_object *o, const struct pell_frame_material *materials, int object,
                        size_t at, bool layered)
{
    int32_t *const row = row_of(o, object);

    for (int32_t k = *row; k >= 0; k = o->next[k]) {
        const struct pell_frame_material *other = &materials[b->solids[k].material];
        if (b->solids[k].object == object && other->profile == materials[at].profile && other->white == materials[at].white &&
            (b->solids[k].material == at || (!layered && !b->solids[k].layered)))
            return k;
    }
    o->next[b->count] = *row;
    *row = (int32_t) b->count;
    b->solids[b->count] = (struct pell_solid) { .object = object, .material = at, .layered = layered };
    return (int32_t) b->count++;
}

/* Meshes sorted by solid, in a stable order. */
static enum pell_result list_solids(struct pell_solids *b, const struct pell_scene *scene)
{
    uint32_t *meshes = pell_alloc_array(b->ctx, b->num_meshes + 1, sizeof(*meshes));
    size_t *end = pell_calloc(b->ctx, b->count + 1, sizeof(*end)), at = 0;
    enum pell_result res = PELL_ERR_NOMEM;

    if (!meshes || !end)
        goto fail;
    for (size_t i = 0; i < b->num_meshes; i++)
        if (b->of_mesh[i] >= 0)
            end[b->of_mesh[i] + 1]++;
    for (size_t k = 0; k < b->count; k++)
        end[k + 1] += end[k];
    for (size_t i = 0; i < b->num_meshes; i++)
        if (b->of_mesh[i] >= 0)
            meshes[end[b->of_mesh[i]]++] = (uint32_t) i; /* each becomes its own end */
    for (size_t k = 0; k < b->count; at = end[k++])
        PELL_TRY(list_triangles(b, scene, k, meshes + at, end[k] - at));
    res = PELL_OK;

fail:
    pell_free(b->ctx, end);
    pell_free(b->ctx, meshes);
    return res;
}

enum pell_result pell_solids_create(struct pell_context *ctx, const struct pell_scene *scene, const uint16_t *frame_index,
                                    const struct pell_frame_material *materials, struct pell_solids **out)
{
    struct pell_solids *b = pell_zalloc(ctx, sizeof(*b));
    struct by_object objects = { NULL, NULL, 0 };
    enum pell_result res = PELL_ERR_NOMEM;

    *out = NULL;
    if (!b)
        return PELL_ERR_NOMEM;
    b->ctx = ctx;
    b->num_meshes = scene->num_meshes;
    b->of_mesh = pell_alloc_array(ctx, scene->num_meshes + 1, sizeof(*b->of_mesh));
    b->solids = pell_calloc(ctx, scene->num_meshes + 1, sizeof(*b->solids));
    if (!b->of_mesh || !b->solids)
        goto fail;
    PELL_TRY(by_object_create(ctx, scene->num_meshes, &objects));
    for (size_t i = 0; i < scene->num_meshes; i++) {
        const struct pell_mesh *m = &scene->meshes[i];
        const size_t at = frame_index[m->material + 1];
        const bool layered = scene->materials[m->material].num_layers > 0;

        b->of_mesh[i] = at == 0 ? -1 : solid_of(b, &objects, materials, pell_mesh_assembly(m), at - 1, layered);
    }
    PELL_TRY(list_solids(b, scene));
    pell_free(ctx, objects.next);
    pell_free(ctx, objects.first);
    *out = b;
    return PELL_OK;

fail:
    pell_free(ctx, objects.next);
    pell_free(ctx, objects.first);
    pell_solids_destroy(&b);
    return res;
}

/* --- Queries ------------------------------------------------------------------------------------------------------------------ */

struct pell_solid_triangle pell_solid_at(const struct pell_solid *solid, double area, double *f)
{
    size_t low = 0, high = solid->num_triangles - 1;
    double before, own;

    while (low < high) {
        const size_t mid = low + (high - low) / 2;
        if (solid->area_after[mid] > area)
            high = mid;
        else
            low = mid + 1;
    }
    before = low > 0 ? solid->area_after[low - 1] : 0.0;
    own = solid->area_after[low] - before;
    *f = own > 0.0 ? (area - before) / own : 0.0;
    *f = *f < 0.0 ? 0.0 : *f < 0.99999994 ? *f : 0.99999994;
    return solid->triangles[low];
}

void pell_solids_find(const struct pell_solids *solids, const struct pell_rays *rays, const struct pell_frame *in, const ptrdiff_t *at,
                      int count, int32_t out[16])
{
    float position[3][16] = { { 0 } }, normal[3][16] = { { 0 } }, depth[16] = { 0 };
    _Alignas(64) int unresolved[16] = { 0 };
    struct pell_ray_hit16 p;
    int any = count > 0 ? -1 : 0;

    memset(&p, 0, sizeof(p));
    for (int i = 0; i < 16; i++)
        out[i] = -1;
    for (int i = 0; i < count; i++) {
        unresolved[i] = -1;
        depth[i] = in->depth[at[i]];
        for (int k = 0; k < 3; k++) {
            position[k][i] = in->position[k][at[i]];
            normal[k][i] = in->normal[k][at[i]];
        }
    }
    /* Retries with growing offsets: at grazing angles a short one may miss the surface. */
    for (float reach = 3e-5f; any && reach < 1e-2f; reach *= 8.0f) {
        for (int i = 0; i < 16; i++) {
            const float e = reach * (fmaxf(fabsf(position[0][i]), fmaxf(fabsf(position[1][i]), fabsf(position[2][i]))) + depth[i]);
            p.ray.ox[i] = position[0][i] + e * normal[0][i];
            p.ray.oy[i] = position[1][i] + e * normal[1][i];
            p.ray.oz[i] = position[2][i] + e * normal[2][i];
            p.ray.dx[i] = -normal[0][i];
            p.ray.dy[i] = -normal[1][i];
            p.ray.dz[i] = -normal[2][i];
            p.ray.tnear[i] = 0.0f;
            p.ray.tfar[i] = 2.0f * e;
            p.ray.mask[i] = PELL_RAY_TRANSLUCENT;
        }
        pell_rays_closest16(rays, unresolved, true, &p);
        any = 0;
        for (int i = 0; i < 16; i++) {
            if (unresolved[i] && p.hit.mesh[i] < solids->num_meshes && solids->of_mesh[p.hit.mesh[i]] >= 0) {
                out[i] = solids->of_mesh[p.hit.mesh[i]];
                unresolved[i] = 0;
            }
            any |= unresolved[i];
        }
    }
    for (int i = 0; any && i < 16; i++)
        for (size_t k = 0; unresolved[i] && k < solids->count; k++)
            if (solids->solids[k].material == in->material[at[i]] - 1u) {
                out[i] = (int32_t) k;
                unresolved[i] = 0;
            }
}
