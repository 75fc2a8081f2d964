/* SPDX-License-Identifier: MIT
 * embree.c - ray queries by Embree 3. One Embree geometry per mesh, with the mesh's index as its ID, sharing the mesh's arrays.
 *
 * Traversal is robust, so that rays do not pass between triangles at shared edges (some in 500 of rays aimed exactly at vertices still do).
 * Masks use Embree's if it was built with them (Debian's is), else a filter function on every geometry. Embree reads positions 16 bytes at
 * a time: pell_mesh_allocate adds padding after the last vertex. */
#include "visibility/embree.h"
#include "image/color.h"
#include "scene/scene.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* Packets have Embree's layout, so they are passed without copying. */
#define SAME(type, field, rtc_type, rtc_field)                                                                                             \
    _Static_assert(offsetof(struct type, field) == offsetof(struct rtc_type, rtc_field), "layout of " #field)
SAME(pell_ray16, ox, RTCRay16, org_x);
SAME(pell_ray16, oy, RTCRay16, org_y);
SAME(pell_ray16, oz, RTCRay16, org_z);
SAME(pell_ray16, tnear, RTCRay16, tnear);
SAME(pell_ray16, dx, RTCRay16, dir_x);
SAME(pell_ray16, dy, RTCRay16, dir_y);
SAME(pell_ray16, dz, RTCRay16, dir_z);
SAME(pell_ray16, time, RTCRay16, time);
SAME(pell_ray16, tfar, RTCRay16, tfar);
SAME(pell_ray16, mask, RTCRay16, mask);
SAME(pell_ray16, id, RTCRay16, id);
SAME(pell_ray16, flags, RTCRay16, flags);
SAME(pell_hit16, ngx, RTCHit16, Ng_x);
SAME(pell_hit16, ngy, RTCHit16, Ng_y);
SAME(pell_hit16, ngz, RTCHit16, Ng_z);
SAME(pell_hit16, u, RTCHit16, u);
SAME(pell_hit16, v, RTCHit16, v);
SAME(pell_hit16, triangle, RTCHit16, primID);
SAME(pell_hit16, mesh, RTCHit16, geomID);
SAME(pell_hit16, instance, RTCHit16, instID);
SAME(pell_ray_hit16, hit, RTCRayHit16, hit);
_Static_assert(sizeof(struct pell_ray16) == sizeof(struct RTCRay16) && sizeof(struct pell_ray_hit16) == sizeof(struct RTCRayHit16),
               "packets are Embree's");
_Static_assert(_Alignof(struct pell_ray16) == 64 && _Alignof(struct pell_ray_hit16) == 64, "packets are aligned as Embree wants");
_Static_assert(PELL_NO_HIT == RTC_INVALID_GEOMETRY_ID, "no hit is Embree's no geometry");

#if defined(__SANITIZE_THREAD__)
#define THREAD_SANITIZER 1
#elif defined(__has_feature)
#if __has_feature(thread_sanitizer)
#define THREAD_SANITIZER 1
#endif
#endif
#ifndef THREAD_SANITIZER
#define THREAD_SANITIZER 0
#endif

/* --- Filters ------------------------------------------------------------------------------------------------------------------ */

/* Alpha of the base colour at a hit: factor x map x vertex colour, as glTF defines it. */
static float alpha_at(const struct pell_rays_surface *s, uint32_t triangle, float u, float v)
{
    const uint32_t *i = s->mesh->index + 3 * (size_t) triangle;
    const struct pell_texture_map *map = &s->material->base_color_map;
    const float w = 1.0f - u - v;
    float alpha = s->material->base_color[3];

    if (s->mesh->color)
        alpha *= w * s->mesh->color[4 * (size_t) i[0] + 3] + u * s->mesh->color[4 * (size_t) i[1] + 3] +
                 v * s->mesh->color[4 * (size_t) i[2] + 3];
    if (map->texture && s->mesh->uv[map->uv]) {
        const float *uv = s->mesh->uv[map->uv], *a = uv + 2 * (size_t) i[0], *b = uv + 2 * (size_t) i[1], *c = uv + 2 * (size_t) i[2];
        const float tu = w * a[0] + u * b[0] + v * c[0], tv = w * a[1] + u * b[1] + v * c[1], *m = map->matrix;
        float rgba[4];
        pell_image_sample(&map->texture->image, map->texture->wrap_u, map->texture->wrap_v, map->texture->nearest,
                          m[0] * tu + m[1] * tv + m[2], m[3] * tu + m[4] * tv + m[5], rgba);
        alpha *= rgba[3];
    }
    return alpha;
}

static void filter(const struct RTCFilterFunctionNArguments *args)
{
    const struct pell_rays_surface *s = args->geometryUserPtr;
    const unsigned n = args->N;
    const float *hit = (const float *) args->hit; /* planes of n: Ng x, y, z, u, v, primID, ... */
    const uint32_t *triangle = (const uint32_t *) args->hit + 5 * (size_t) n;
    const uint32_t *mask = (const uint32_t *) args->ray + 9 * (size_t) n; /* planes of n, in the order of struct pell_ray16 */
    const float *dir = (const float *) args->ray + 4 * (size_t) n;

    for (unsigned i = 0; i < n; i++) {
        if (args->valid[i] != -1)
            continue;
        if (!(mask[i] & s->mask) ||
            (s->single_sided && mask[i] == PELL_RAY_CAMERA &&
             hit[i] * dir[i] + hit[n + i] * dir[n + i] + hit[2 * n + i] * dir[2 * n + i] > 0) ||
            (s->alpha && alpha_at(s, triangle[i], hit[3 * (size_t) n + i], hit[4 * (size_t) n + i]) < s->material->alpha_cutoff) ||
            (!pell_counts_crossings(args->context) &&
             pell_surface_is_inside(s, triangle[i], hit[3 * (size_t) n + i], hit[4 * (size_t) n + i])))
            args->valid[i] = 0;
    }
}

/* --- Build -------------------------------------------------------------------------------------------------------------------- */

static void on_error(void *user, enum RTCError code, const char *text)
{
    struct pell_rays *rays = user;
    int none = RTC_ERROR_NONE;

    if (atomic_compare_exchange_strong(&rays->error, &none, (int) code))
        pell_printable(text ? text : "", rays->text, sizeof(rays->text));
}

/* Counts Embree's memory against the context's limit. Called from Embree's threads. */
static bool on_memory(void *user, ssize_t bytes, bool post)
{
    struct pell_rays *rays = user;
    const int64_t now = atomic_fetch_add(&rays->bytes, bytes) + bytes;

    if (bytes <= 0 || now + (int64_t) pell_memory_used(rays->ctx) <= pell_context_limits(rays->ctx)->memory_bytes)
        return true;
    if (!post) /* rejected before it was allocated */
        atomic_fetch_sub(&rays->bytes, bytes);
    atomic_store(&rays->over_limit, true);
    return false;
}

static bool on_progress(void *user, double fraction)
{
    struct pell_rays *rays = user;

    (void) fraction;
    atomic_store(&rays->building, true);
    return !pell_cancelled(rays->ctx);
}

/* Converts Embree's errors to a result, logged. */
static enum pell_result check(const struct pell_rays *rays, const struct pell_scene *scene, enum RTCError code)
{
    switch (code) {
    case RTC_ERROR_NONE: return PELL_OK;
    case RTC_ERROR_CANCELLED: return PELL_ERR_CANCELLED;
    case RTC_ERROR_OUT_OF_MEMORY:
        if (rays && atomic_load(&rays->over_limit))
            return pell_error(scene->ctx, PELL_ERR_NOMEM, scene->path, PELL_RAISE_LIMIT("memory-bytes") ", if the machine has more",
                              "the ray structure would exceed the memory limit of %lld bytes",
                              (long long) pell_context_limits(scene->ctx)->memory_bytes);
        return pell_error(scene->ctx, PELL_ERR_NOMEM, scene->path, NULL, "out of memory while building the ray structure");
    case RTC_ERROR_UNSUPPORTED_CPU:
        return pell_error(scene->ctx, PELL_ERR_DEVICE, scene->path, NULL, "Embree does not run on this processor");
    default:
        if (rays && rays->committed && !atomic_load(&rays->building)) /* TBB could not begin */
            return pell_error(scene->ctx, PELL_ERR_NOMEM, scene->path, "use fewer threads",
                              "no memory or threads for building the ray structure: %s", rays->text);
        return pell_error(scene->ctx, PELL_ERR_DEVICE, scene->path, NULL, "Embree reports error %d: %s", (int) code,
                          rays ? rays->text : "no device");
    }
}

static enum pell_result check_mesh(const struct pell_scene *scene, size_t number)
{
    const struct pell_mesh *m = &scene->meshes[number];
    uint32_t highest = 0;

    if (m->material < 0 || (size_t) m->material >= scene->num_materials)
        return pell_error(scene->ctx, PELL_ERR_INVALID, m->name, NULL, "material %d does not exist; there are %zu", m->material,
                          scene->num_materials);
    for (size_t i = 0; i < 3 * (size_t) m->num_triangles && !pell_cancelled_at(scene->ctx, i); i++)
        highest = m->index[i] > highest ? m->index[i] : highest;
    if (pell_cancelled(scene->ctx))
        return PELL_ERR_CANCELLED;
    if (m->num_triangles && highest >= m->num_vertices)
        return pell_error(scene->ctx, PELL_ERR_INVALID, m->name, NULL, "vertex index %u is out of range; there are %u vertices", highest,
                          m->num_vertices);
    return PELL_OK;
}

bool pell_rays_show(const struct pell_scene *scene, const struct pell_mesh *m, bool *cut)
{
    const struct pell_material *material = &scene->materials[m->material];
    const bool varies = material->base_color_map.texture || m->color;

    *cut = material->alpha_mask && varies;
    return m->num_triangles > 0 && !(material->alpha_mask && !varies && material->base_color[3] < material->alpha_cutoff);
}

static enum pell_result attach(struct pell_rays *rays, const struct pell_scene *scene, size_t number, bool masks)
{
    const struct pell_mesh *m = &scene->meshes[number];
    const struct pell_material *material = &scene->materials[m->material];
    struct pell_rays_surface *s = &rays->surfaces[number];
    RTCGeometry geometry;

    s->mesh = m;
    s->material = material;
    s->mask = m->light_shell ? PELL_RAY_LIGHT_SHELL : material->opaque ? PELL_RAY_OPAQUE : PELL_RAY_TRANSLUCENT;
    s->single_sided = pell_rays_single_sided(scene, m);
    s->scene = rays->scene;
    if (m->overlaps && !material->opaque && !(s->side = pell_zalloc(rays->ctx, m->num_triangles)))
        return PELL_ERR_NOMEM;
    if (!pell_rays_show(scene, m, &s->alpha))
        return PELL_OK;

    geometry = rtcNewGeometry(rays->device, RTC_GEOMETRY_TYPE_TRIANGLE);
    if (geometry) {
        rtcSetSharedGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3, m->position, 0, 3 * sizeof(float),
                                   m->num_vertices);
        rtcSetSharedGeometryBuffer(geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3, m->index, 0, 3 * sizeof(uint32_t),
                                   m->num_triangles);
        rtcSetGeometryBuildQuality(geometry, RTC_BUILD_QUALITY_MEDIUM);
        rtcSetGeometryMask(geometry, s->mask);
        rtcSetGeometryUserData(geometry, s);
        if (s->alpha || !masks || s->single_sided || s->side)
            rtcSetGeometryIntersectFilterFunction(geometry, filter);
        if (s->alpha || !masks || s->side)
            rtcSetGeometryOccludedFilterFunction(geometry, filter);
        rtcCommitGeometry(geometry);
        rtcAttachGeometryByID(rays->scene, geometry, (unsigned) number);
        rtcReleaseGeometry(geometry);
    }
    return check(rays, scene, (enum RTCError) atomic_load(&rays->error));
}

/* Peak memory of the builder per triangle (96 to 125 bytes measured), stack of a TBB thread, and a constant part. */
#define TRIANGLE_BYTES 128
#define THREAD_BYTES ((size_t) 5 << 20)
#define BUILD_BYTES ((size_t) 16 << 20)

/* Whether the system has enough memory for the build. TBB allocates its threads and task groups itself; on failure it terminates the
 * process or leaves a scene that can't be released. So the required memory is allocated and freed beforehand. */
static enum pell_result check_memory(const struct pell_scene *scene, struct pell_pool *pool)
{
    size_t triangles = 0, bytes;

    for (size_t i = 0; i < scene->num_meshes; i++)
        triangles += scene->meshes[i].num_triangles;
    bytes = triangles * TRIANGLE_BYTES + (size_t) pell_pool_threads(pool) * THREAD_BYTES + BUILD_BYTES;
    if (pell_memory_available(bytes))
        return PELL_OK;
    return pell_error(scene->ctx, PELL_ERR_NOMEM, scene->path, pell_pool_threads(pool) > 1 ? "use fewer threads" : NULL,
                      "out of memory: the ray structure of %zu triangles needs about %zu MB", triangles, bytes >> 20);
}

static enum pell_result set_media(struct pell_rays *rays, const struct pell_scene *scene)
{
    uint32_t *same = pell_alloc_array(rays->ctx, scene->num_materials, sizeof(*same));

    if (!same)
        return PELL_ERR_NOMEM;
    pell_scene_same_media(scene, same);
    for (size_t i = 0; i < scene->num_meshes; i++)
        rays->surfaces[i].medium = same[scene->meshes[i].material];
    pell_free(rays->ctx, same);
    return PELL_OK;
}

static RTCDevice new_device(struct pell_pool *pool)
{
    const char *more = getenv("PELL_EMBREE");
    char config[128];

    /* Embree's threads (TBB) are not instrumented: the thread sanitizer would report races. */
    snprintf(config, sizeof(config), "threads=%d,%s", THREAD_SANITIZER ? 1 : pell_pool_threads(pool), more ? more : "");
    return rtcNewDevice(config);
}

enum pell_result pell_rays_create(struct pell_context *ctx, const struct pell_scene *scene, struct pell_pool *pool, struct pell_rays **out)
{
    struct pell_rays *rays;
    enum pell_result res;
    bool masks;

    *out = NULL;
    if (scene->num_meshes >= PELL_NO_HIT)
        return pell_error(ctx, PELL_ERR_UNSUPPORTED, scene->path, NULL, "%zu meshes are too many", scene->num_meshes);
    for (size_t i = 0; i < scene->num_meshes; i++)
        if ((res = check_mesh(scene, i)) != PELL_OK)
            return res;

    rays = pell_zalloc(ctx, sizeof(*rays));
    if (!rays)
        return PELL_ERR_NOMEM;
    rays->ctx = ctx;
    rays->surfaces = pell_calloc(ctx, scene->num_meshes, sizeof(*rays->surfaces));
    rays->num_surfaces = scene->num_meshes;
    if (!rays->surfaces) {
        res = PELL_ERR_NOMEM;
        goto fail;
    }
    rays->device = new_device(pool);
    if (!rays->device) {
        const enum RTCError code = rtcGetDeviceError(NULL);
        res = check(NULL, scene, code == RTC_ERROR_NONE ? RTC_ERROR_UNKNOWN : code);
        goto fail;
    }
    rtcSetDeviceErrorFunction(rays->device, on_error, rays);
    rtcSetDeviceMemoryMonitorFunction(rays->device, on_memory, rays);
    masks = rtcGetDeviceProperty(rays->device, RTC_DEVICE_PROPERTY_RAY_MASK_SUPPORTED) != 0;
    rays->native16 = rtcGetDeviceProperty(rays->device, RTC_DEVICE_PROPERTY_NATIVE_RAY16_SUPPORTED) != 0;

    rays->scene = rtcNewScene(rays->device);
    PELL_TRY(check(rays, scene, (enum RTCError) atomic_load(&rays->error)));
    rtcSetSceneFlags(rays->scene, RTC_SCENE_FLAG_ROBUST | RTC_SCENE_FLAG_CONTEXT_FILTER_FUNCTION); /* pell_rays_exits has a filter */
    rtcSetSceneBuildQuality(rays->scene, RTC_BUILD_QUALITY_MEDIUM);
    rtcSetSceneProgressMonitorFunction(rays->scene, on_progress, rays);
    PELL_TRY(set_media(rays, scene));
    for (size_t i = 0; i < scene->num_meshes; i++)
        PELL_TRY(attach(rays, scene, i, masks));
    PELL_TRY(check_memory(scene, pool));
    rays->committed = true;
    rtcCommitScene(rays->scene);
    PELL_TRY(check(rays, scene, (enum RTCError) atomic_load(&rays->error)));
    pell_rays_find_sides(rays, scene, pool);
    if (pell_cancelled(ctx)) {
        res = PELL_ERR_CANCELLED;
        goto fail;
    }
    *out = rays;
    return PELL_OK;

fail:
    pell_rays_destroy(&rays);
    return res;
}

void pell_rays_destroy(struct pell_rays **rays)
{
    struct pell_rays *r = *rays;

    if (!r)
        return;
    *rays = NULL;
    /* A build that TBB could not start leaves a task group in the scene that terminates the process on destruction. In that case the scene,
     * which holds nothing yet, and its device are leaked. */
    if (atomic_load(&r->error) != RTC_ERROR_NONE && r->committed && !atomic_load(&r->building) && !atomic_load(&r->over_limit)) {
        rtcSetDeviceMemoryMonitorFunction(r->device, NULL, NULL);
        rtcSetDeviceErrorFunction(r->device, NULL, NULL);
    } else {
        if (r->scene)
            rtcReleaseScene(r->scene);
        if (r->device)
            rtcReleaseDevice(r->device);
    }
    for (size_t i = 0; r->surfaces && i < r->num_surfaces; i++)
        pell_free(r->ctx, r->surfaces[i].side);
    pell_free(r->ctx, r->surfaces);
    pell_free(r->ctx, r);
}

/* --- Queries ------------------------------------------------------------------------------------------------------------------ */

static void record_ray(struct pell_ray_record *record, const struct pell_ray *ray, bool occlusion)
{
    const size_t at = atomic_fetch_add_explicit(&record->count, 1, memory_order_relaxed);

    if (at >= record->capacity)
        return;
    record->rays[at] = *ray;
    record->occlusion[at] = occlusion;
}

static void record_packet(struct pell_ray_record *record, const int *valid, const struct pell_ray16 *r)
{
    for (int i = 0; i < PELL_PACKET; i++)
        if (valid[i]) {
            const struct pell_ray ray = {
                { r->ox[i], r->oy[i], r->oz[i] }, r->tnear[i], { r->dx[i], r->dy[i], r->dz[i] }, r->tfar[i], r->mask[i]
            };
            record_ray(record, &ray, false);
        }
}

/* Where the processor has no AVX-512, Embree traces packets of 16 as a stream and ignores `valid`: it traces every ray whose interval is
 * not empty. This empties the interval of the other rays; `tfar` keeps their values. */
static void empty_invalid(const int *valid, struct pell_ray16 *restrict r, float *restrict tfar)
{
    for (int i = 0; i < PELL_PACKET; i++) {
        tfar[i] = r->tfar[i];
        r->tfar[i] = valid[i] ? tfar[i] : -INFINITY;
    }
}

static void restore_invalid(const int *valid, struct pell_ray16 *restrict r, const float *restrict tfar)
{
    for (int i = 0; i < PELL_PACKET; i++)
        r->tfar[i] = valid[i] ? r->tfar[i] : tfar[i];
}

void pell_rays_closest16(const struct pell_rays *rays, const int *valid, bool coherent, struct pell_ray_hit16 *packet)
{
    struct RTCIntersectContext context = pell_intersect_context(coherent);
    float tfar[PELL_PACKET];

    if (rays->record)
        record_packet(rays->record, valid, &packet->ray);
    memset(packet->hit.mesh, 0xff, sizeof(packet->hit.mesh));
    memset(packet->hit.instance, 0xff, sizeof(packet->hit.instance));
    if (!rays->native16)
        empty_invalid(valid, &packet->ray, tfar);
    rtcIntersect16(valid, rays->scene, &context, (struct RTCRayHit16 *) packet);
    if (!rays->native16)
        restore_invalid(valid, &packet->ray, tfar);
}

void pell_rays_occluded16(const struct pell_rays *rays, const int *valid, bool coherent, struct pell_ray16 *packet)
{
    struct RTCIntersectContext context = pell_intersect_context(coherent);
    float tfar[PELL_PACKET];

    if (!rays->native16)
        empty_invalid(valid, packet, tfar);
    rtcOccluded16(valid, rays->scene, &context, (struct RTCRay16 *) packet);
    if (!rays->native16)
        restore_invalid(valid, packet, tfar);
}

void pell_rays_record(struct pell_rays *rays, struct pell_ray_record *record)
{
    rays->record = record;
}

/* Fills a packet with the rays of the same kind from the first one on; returns their number. */
static int fill_packet(const struct pell_ray_record *record, size_t first, size_t count, int *valid, struct pell_ray_hit16 *p)
{
    int n = 0;

    for (; n < PELL_PACKET && first + (size_t) n < count && record->occlusion[first + (size_t) n] == record->occlusion[first]; n++) {
        const struct pell_ray *ray = &record->rays[first + (size_t) n];
        p->ray.ox[n] = ray->origin[0];
        p->ray.oy[n] = ray->origin[1];
        p->ray.oz[n] = ray->origin[2];
        p->ray.dx[n] = ray->direction[0];
        p->ray.dy[n] = ray->direction[1];
        p->ray.dz[n] = ray->direction[2];
        p->ray.tnear[n] = ray->tnear;
        p->ray.tfar[n] = ray->tfar;
        p->ray.mask[n] = ray->mask;
    }
    for (int i = 0; i < PELL_PACKET; i++)
        valid[i] = i < n ? -1 : 0;
    return n;
}

static int64_t trace_packets(const struct pell_rays *rays, const struct pell_ray_record *record, size_t count)
{
    _Alignas(64) int valid[PELL_PACKET];
    struct pell_ray_hit16 p;
    int64_t hits = 0;

    memset(&p, 0, sizeof(p));
    for (size_t i = 0; i < count;) {
        const int n = fill_packet(record, i, count, valid, &p);
        const bool occlusion = record->occlusion[i];
        if (occlusion)
            pell_rays_occluded16(rays, valid, false, &p.ray);
        else
            pell_rays_closest16(rays, valid, false, &p);
        for (int k = 0; k < n; k++)
            hits += occlusion ? p.ray.tfar[k] < 0.0f : p.hit.mesh[k] != PELL_NO_HIT;
        i += (size_t) n;
    }
    return hits;
}

int64_t pell_rays_trace_record(const struct pell_rays *rays, const struct pell_ray_record *record, bool packets)
{
    const size_t count = record->count < record->capacity ? record->count : record->capacity;
    struct RTCIntersectContext context = pell_intersect_context(false);
    int64_t hits = 0;

    if (packets)
        return trace_packets(rays, record, count);
    for (size_t i = 0; i < count; i++) {
        struct RTCRayHit r = { .ray = pell_embree_ray(&record->rays[i]), .hit = { .geomID = RTC_INVALID_GEOMETRY_ID } };
        if (record->occlusion[i]) {
            rtcOccluded1(rays->scene, &context, &r.ray);
            hits += r.ray.tfar < 0.0f;
        } else {
            rtcIntersect1(rays->scene, &context, &r);
            hits += r.hit.geomID != RTC_INVALID_GEOMETRY_ID;
        }
    }
    return hits;
}

bool pell_rays_closest(const struct pell_rays *rays, const struct pell_ray *ray, struct pell_hit *hit)
{
    struct RTCIntersectContext context = pell_intersect_context(false);
    struct RTCRayHit r = { .ray = pell_embree_ray(ray), .hit = { .geomID = RTC_INVALID_GEOMETRY_ID } };

    if (rays->record)
        record_ray(rays->record, ray, false);
    rtcIntersect1(rays->scene, &context, &r);
    if (r.hit.geomID == RTC_INVALID_GEOMETRY_ID)
        return false;
    *hit = (struct pell_hit) { r.ray.tfar, { r.hit.Ng_x, r.hit.Ng_y, r.hit.Ng_z }, r.hit.u, r.hit.v, r.hit.geomID, r.hit.primID };
    return true;
}

bool pell_rays_occluded(const struct pell_rays *rays, const struct pell_ray *ray)
{
    struct RTCIntersectContext context = pell_intersect_context(false);
    struct RTCRay r = pell_embree_ray(ray);

    if (rays->record)
        record_ray(rays->record, ray, true);
    rtcOccluded1(rays->scene, &context, &r);
    return r.tfar < 0.0f;
}
