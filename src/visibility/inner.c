/* SPDX-License-Identifier: MIT
 *
 * inner.c - surface inside its own object. Parts of an object may touch or overlap; where a part is inside another one of the same medium
 * nothing changes for light, so rays do not meet it. Triangles that no other one touches are inside or outside as a whole; for others the
 * filter asks at each point.
 */
#include "math/near.h"
#include "scene/triangle.h"
#include "visibility/embree.h"

#define OUTWARD 2e-6f /* of the largest coordinate: how far from the surface its outer side is */

#define NEAR 1e-5   /* of the largest coordinate: surfaces this near touch */
#define SHRINK 1e-3 /* a triangle's neighbours touch its border only */

/* A query that counts intersections. */
struct crossings {
    struct RTCIntersectContext context; /* first: Embree passes it to the filters */
    int object;
    int64_t medium; /* -1: any */
    int exits;
};

/* Counts an intersection, and rejects it, so that the ray continues to all others. */
static void count_crossing(const struct RTCFilterFunctionNArguments *args)
{
    struct crossings *c = (struct crossings *) args->context;
    const struct pell_rays_surface *s = args->geometryUserPtr;
    const float *n = (const float *) args->hit, *d = (const float *) args->ray + 4; /* planes of one, see filter */
    const float along = n[0] * d[0] + n[1] * d[1] + n[2] * d[2];

    if (args->valid[0] == -1 && pell_mesh_assembly(s->mesh) == c->object && (c->medium < 0 || s->medium == (uint32_t) c->medium))
        c->exits += along > 0.0f ? 1 : -1;
    args->valid[0] = 0;
}

static int count_exits(RTCScene scene, struct RTCRay ray, int object, int64_t medium)
{
    struct crossings c = { .context = pell_intersect_context(false), .object = object, .medium = medium };
    struct RTCRayHit r = { .ray = ray, .hit = { .geomID = RTC_INVALID_GEOMETRY_ID } };

    c.context.filter = count_crossing;
    rtcIntersect1(scene, &c.context, &r);
    return c.exits;
}

bool pell_counts_crossings(const struct RTCIntersectContext *context)
{
    return context->filter == count_crossing;
}

/* Whether the outer side of a point of the surface is inside another part of the object that has the same medium: nothing changes there.
 * Slanted, so that the ray meets few edges of parts that lie in rows. */
static bool is_inner(const struct pell_rays_surface *s, uint32_t triangle, float u, float v)
{
    struct pell_vec3 corner[3], at, normal, t, b, d;

    pell_triangle_corners(s->mesh, triangle, corner);
    normal = vec3_normalize(pell_triangle_cross(corner));
    at = vec3_mad(vec3_mad(vec3_mul(corner[0], 1.0f - u - v), u, corner[1]), v, corner[2]);
    at = vec3_mad(at, OUTWARD * fmaxf(vec3_max_abs(corner[0]), fmaxf(vec3_max_abs(corner[1]), vec3_max_abs(corner[2]))), normal);
    vec3_basis(normal, &t, &b);
    d = vec3_normalize(vec3_mad(vec3_mad(normal, 0.17f, t), 0.11f, b));
    return count_exits(s->scene,
                       (struct RTCRay) { .org_x = at.x,
                                         .org_y = at.y,
                                         .org_z = at.z,
                                         .dir_x = d.x,
                                         .dir_y = d.y,
                                         .dir_z = d.z,
                                         .tfar = INFINITY,
                                         .mask = PELL_RAY_ALL },
                       pell_mesh_assembly(s->mesh), s->medium) > 0;
}

bool pell_surface_is_inside(const struct pell_rays_surface *s, uint32_t triangle, float u, float v)
{
    return s->side && s->side[triangle] != SIDE_OUTER && (s->side[triangle] == SIDE_INNER || is_inner(s, triangle, u, v));
}

/* --- Sides ----------------------------------------------------------------------------------------------------------------------- */

#define SIDES 64        /* triangles per task */
#define TRIED_MOST 2048 /* neighbours of a triangle; one with more is tested at each hit */

struct side_job {
    const struct pell_rays *rays;
    const struct pell_rays_surface *surface;
};

/* A triangle, a little smaller than it is, and whether another one of the solid touches it. */
struct contact {
    const struct pell_rays_surface *surface, *surfaces;
    uint32_t triangle;
    struct pell_dvec3 corner[3];
    struct pell_dvec3 lo, hi; /* its box, wider by the distance */
    double distance2;
    int tried;
    bool any;
};

static bool overlap(double a, double b, double c, double low, double high)
{
    return fmin(a, fmin(b, c)) <= high && fmax(a, fmax(b, c)) >= low;
}

static bool meets_box(const struct pell_dvec3 p[3], struct pell_dvec3 lo, struct pell_dvec3 hi)
{
    return overlap(p[0].x, p[1].x, p[2].x, lo.x, hi.x) && overlap(p[0].y, p[1].y, p[2].y, lo.y, hi.y) &&
           overlap(p[0].z, p[1].z, p[2].z, lo.z, hi.z);
}

static bool try_contact(struct RTCPointQueryFunctionArguments *args)
{
    struct contact *c = args->userPtr;
    const struct pell_rays_surface *s = &c->surfaces[args->geomID];
    struct pell_vec3 at[3];
    struct pell_dvec3 corner[3];

    if (c->any || pell_mesh_assembly(s->mesh) != pell_mesh_assembly(c->surface->mesh) || s->medium != c->surface->medium ||
        (s == c->surface && args->primID == c->triangle))
        return false;
    pell_triangle_corners(s->mesh, args->primID, at);
    for (int k = 0; k < 3; k++)
        corner[k] = dvec3_widen(at[k]);
    c->any = ++c->tried > TRIED_MOST || (meets_box(corner, c->lo, c->hi) && pell_triangles_touch(c->corner, corner, c->distance2));
    if (!c->any)
        return false;
    args->query->radius = 0.0f; /* ends the search after this leaf */
    return true;
}

/* Barycentrics of the points that must all be inside for a triangle that others touch to be inside as a whole, as one that coincides with
 * the face of another part: the middle, near the corners, and near the sides. */
static const float probes[][2] = { { 0.333f, 0.333f },  { 0.001f, 0.001f },  { 0.998f, 0.001f }, { 0.001f, 0.998f }, { 0.4995f, 0.4995f },
                                   { 0.4995f, 0.001f }, { 0.001f, 0.4995f }, { 0.25f, 0.25f },   { 0.5f, 0.25f },    { 0.25f, 0.5f } };

static uint8_t side_of(const struct side_job *job, uint32_t triangle)
{
    struct contact c = { .surface = job->surface, .surfaces = job->rays->surfaces, .triangle = triangle };
    struct RTCPointQuery query = { .time = 0.0f };
    struct RTCPointQueryContext context;
    struct pell_vec3 at[3], middle;
    float radius = 0.0f, distance;

    pell_triangle_corners(job->surface->mesh, triangle, at);
    middle = vec3_mul(vec3_add(vec3_add(at[0], at[1]), at[2]), 1.0f / 3.0f);
    distance = (float) NEAR * fmaxf(vec3_max_abs(at[0]), fmaxf(vec3_max_abs(at[1]), vec3_max_abs(at[2])));
    for (int k = 0; k < 3; k++) {
        c.corner[k] = dvec3_mad(dvec3_mul(dvec3_widen(at[k]), 1.0 - SHRINK), SHRINK, dvec3_widen(middle));
        radius = fmaxf(radius, vec3_length(vec3_sub(at[k], middle)));
    }
    c.distance2 = (double) distance * (double) distance;
    c.lo = dvec3(INFINITY, INFINITY, INFINITY);
    c.hi = dvec3(-INFINITY, -INFINITY, -INFINITY);
    for (int k = 0; k < 3; k++) {
        const double d = (double) distance;
        c.lo = dvec3(fmin(c.lo.x, c.corner[k].x - d), fmin(c.lo.y, c.corner[k].y - d), fmin(c.lo.z, c.corner[k].z - d));
        c.hi = dvec3(fmax(c.hi.x, c.corner[k].x + d), fmax(c.hi.y, c.corner[k].y + d), fmax(c.hi.z, c.corner[k].z + d));
    }
    query.x = middle.x;
    query.y = middle.y;
    query.z = middle.z;
    query.radius = radius + distance;
    rtcInitPointQueryContext(&context);
    rtcPointQuery(job->rays->scene, &query, &context, try_contact, &c);
    if (!c.any)
        return is_inner(job->surface, triangle, 1.0f / 3.0f, 1.0f / 3.0f) ? SIDE_INNER : SIDE_OUTER;
    for (size_t i = 0; i < PELL_COUNT(probes); i++)
        if (!is_inner(job->surface, triangle, probes[i][0], probes[i][1]))
            return SIDE_MIXED;
    return SIDE_INNER;
}

static void sides_task(void *arg, int index, int worker)
{
    const struct side_job *job = arg;
    const uint32_t first = (uint32_t) index * SIDES, count = job->surface->mesh->num_triangles;

    (void) worker;
    for (uint32_t i = first; i < count && i - first < SIDES && !pell_cancelled(job->rays->ctx); i++)
        job->surface->side[i] = side_of(job, i);
}

void pell_rays_find_sides(const struct pell_rays *rays, const struct pell_scene *scene, struct pell_pool *pool)
{
    for (size_t i = 0; i < scene->num_meshes; i++) {
        struct side_job job = { rays, &rays->surfaces[i] };
        if (job.surface->side)
            pell_pool_run(pool, (int) ((scene->meshes[i].num_triangles + SIDES - 1) / SIDES), sides_task, &job);
    }
}

bool pell_rays_hide(const struct pell_rays *rays, uint32_t mesh, uint32_t triangle)
{
    return rays->surfaces[mesh].side && rays->surfaces[mesh].side[triangle] == SIDE_INNER;
}

bool pell_rays_inner(const struct pell_rays *rays, uint32_t mesh, uint32_t triangle, float u, float v)
{
    return pell_surface_is_inside(&rays->surfaces[mesh], triangle, u, v);
}

int pell_rays_exits(const struct pell_rays *rays, const struct pell_ray *ray, int object)
{
    return count_exits(rays->scene, pell_embree_ray(ray), object, -1);
}
