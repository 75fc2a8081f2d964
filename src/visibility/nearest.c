/* SPDX-License-Identifier: MIT
 * nearest.c - the point of a surface that is nearest to another point. */
#include "math/near.h"
#include "visibility/embree.h"

/* The search radius exceeds the nearest distance slightly, so that the result does not depend on the traversal order. */
#define RADIUS_MARGIN 1.000001

struct nearest_search {
    const struct pell_rays *rays;
    const int32_t *of_mesh;
    int32_t which;
    struct pell_dvec3 x;
    double best2; /* squared distance */
    double u, v;
    uint32_t mesh, triangle;
};

static bool try_triangle(struct RTCPointQueryFunctionArguments *args)
{
    struct nearest_search *s = args->userPtr;
    const struct pell_mesh *m = s->rays->surfaces[args->geomID].mesh;
    const uint32_t *index = m->index + 3 * (size_t) args->primID;
    const struct pell_dvec3 corner = dvec3_load(m->position + 3 * (size_t) index[0]);
    double d2, u, v, radius;

    if (s->of_mesh && s->of_mesh[args->geomID] != s->which)
        return false;
    d2 = pell_triangle_distance2(dvec3_sub(s->x, corner), dvec3_sub(dvec3_load(m->position + 3 * (size_t) index[1]), corner),
                                 dvec3_sub(dvec3_load(m->position + 3 * (size_t) index[2]), corner), &u, &v);
    if (!(d2 <= s->best2) ||
        (d2 == s->best2 && s->mesh != PELL_NO_HIT && (args->geomID > s->mesh || (args->geomID == s->mesh && args->primID >= s->triangle))))
        return false;
    s->best2 = d2;
    s->u = u;
    s->v = v;
    s->mesh = args->geomID;
    s->triangle = args->primID;
    radius = sqrt(d2) * RADIUS_MARGIN;
    if (!(radius < (double) args->query->radius))
        return false;
    args->query->radius = (float) radius;
    return true;
}

bool pell_rays_closest_point(const struct pell_rays *rays, struct pell_vec3 x, float radius, const int32_t *of_mesh, int32_t which,
                             struct pell_nearest *out)
{
    struct nearest_search s = {
        .rays = rays,
        .of_mesh = of_mesh,
        .which = which,
        .x = dvec3_widen(x),
        .best2 = (double) radius * (double) radius,
        .mesh = PELL_NO_HIT,
    };
    struct RTCPointQuery query = { .x = x.x, .y = x.y, .z = x.z, .time = 0.0f, .radius = (float) ((double) radius * RADIUS_MARGIN) };
    struct RTCPointQueryContext context;
    const struct pell_mesh *m;
    const uint32_t *index;
    float point[3];

    if (!isfinite(x.x + x.y + x.z) || !(radius >= 0.0f))
        return false;
    rtcInitPointQueryContext(&context);
    rtcPointQuery(rays->scene, &query, &context, try_triangle, &s);
    if (s.mesh == PELL_NO_HIT)
        return false;
    out->mesh = s.mesh;
    out->triangle = s.triangle;
    out->u = (float) s.u;
    out->v = (float) s.v;
    out->distance = sqrt(s.best2);
    m = rays->surfaces[s.mesh].mesh;
    index = m->index + 3 * (size_t) s.triangle;
    for (size_t k = 0; k < 3; k++) {
        const double a = (double) m->position[3 * (size_t) index[0] + k], b = (double) m->position[3 * (size_t) index[1] + k],
                     c = (double) m->position[3 * (size_t) index[2] + k];
        point[k] = (float) (a + s.u * (b - a) + s.v * (c - a));
    }
    out->point = vec3_load(point);
    return true;
}
