/* SPDX-License-Identifier: MIT
 *
 * connect.c - see connect.h.
 *
 * With w_v the direction from a surface point P to x inside and w_l from P to the light, P refracts where the half vector
 *
 *     H = eta w_v + w_l = -k n,    |eta - 1| <= |k| <= sqrt(|eta^2 - 1|)
 *
 * is along the normal n (Walter et al. 2007, "Microfacet Models for Refraction", eq. (16); the largest k is that of grazing light). A
 * hierarchy of bounding spheres with cones of normals (bvh.c, bvh_kernel.c) bounds H over whole parts of the surface, and culls those that
 * cannot refract. The sides of x and the light follow from k. The remaining single triangles are solved in solve.c. */
#include "transport/refraction/internal.h"

#include <string.h>

#define NEAR_ONE 1e-9 /* of an index ratio: no refraction */

void pell_connector_destroy(struct pell_connector **connector)
{
    struct pell_connector *c = *connector;

    if (!c)
        return;
    *connector = NULL;
    for (size_t i = 0; c->trees && i < c->solids->count; i++) {
        pell_free(c->ctx, c->trees[i].facets);
        pell_free(c->ctx, c->trees[i].nodes);
    }
    pell_free(c->ctx, c->trees);
    pell_free(c->ctx, c);
}

enum pell_result pell_connector_create(struct pell_context *ctx, const struct pell_scene *scene, const struct pell_rays *rays,
                                       const struct pell_solids *solids, bool flat, struct pell_connector **out)
{
    struct pell_connector *c = pell_zalloc(ctx, sizeof(*c));
    enum pell_result res = PELL_ERR_NOMEM;

    *out = NULL;
    if (!c)
        return PELL_ERR_NOMEM;
    c->ctx = ctx;
    c->rays = rays;
    c->solids = solids;
    c->scene = scene;
    c->flat = flat;
    c->kernels = pell_connect_kernels_tables[pell_simd_best()];
    c->trees = pell_calloc(ctx, solids->count + 1, sizeof(*c->trees));
    if (!c->trees)
        goto fail;
    for (size_t i = 0; i < solids->count; i++)
        PELL_TRY(pell_connect_build_tree(c, i));
    *out = c;
    return PELL_OK;

fail:
    pell_connector_destroy(&c);
    return res;
}

/* --- The hierarchy ------------------------------------------------------------------------------------------------------------ */

static void find_paths(struct query *q, const struct tree *t, const struct pell_connect_kernels *kernels)
{
    struct pell_connect_search s = { .nodes = t->nodes,
                                     .x = { (float) q->x.x, (float) q->x.y, (float) q->x.z },
                                     .light = { (float) q->light.x, (float) q->light.y, (float) q->light.z },
                                     .eta = (float) q->eta,
                                     .grazing = (float) q->grazing,
                                     .reach = (float) q->reach * (1.0f + 1e-5f),
                                     .distant = q->distant,
                                     .narrow = fabs(q->eta - 1.0) > 1e-3,
                                     .count = 1 };
    uint32_t facets[4 * PELL_CONNECT_CHILDREN];

    for (int n; (n = kernels->find(&s, facets, (int) PELL_COUNT(facets))) > 0;)
        for (int i = 0; i < n; i++)
            pell_connect_solve(q, &t->facets[facets[i]]);
}

/* --- Visibility --------------------------------------------------------------------------------------------------------------- */

double pell_connector_rounding(const struct pell_connector *connector, int solid)
{
    return solid >= 0 && (size_t) solid < connector->solids->count ? connector->trees[solid].rounding : 0.0;
}

static void set_ray(struct pell_ray_hit16 *r, int lane, struct pell_dvec3 from, struct pell_dvec3 along, double near, double far)
{
    r->ray.ox[lane] = (float) from.x;
    r->ray.oy[lane] = (float) from.y;
    r->ray.oz[lane] = (float) from.z;
    r->ray.dx[lane] = (float) along.x;
    r->ray.dy[lane] = (float) along.y;
    r->ray.dz[lane] = (float) along.z;
    r->ray.tnear[lane] = (float) near;
    r->ray.tfar[lane] = (float) far;
    r->ray.time[lane] = 0.0f;
    r->ray.mask[lane] = PELL_RAY_ALL;
    r->ray.id[lane] = (uint32_t) lane;
    r->ray.flags[lane] = 0;
}

/* Bit mask of the unoccluded ones of up to 8 paths; e: mm of rounding error. The refracting triangle itself occludes neither segment. */
static unsigned unoccluded_paths(const struct pell_connector *c, const struct query *q, double e, const struct path *const paths[8],
                                 int count)
{
    _Alignas(64) int valid[16] = { 0 };
    struct pell_ray_hit16 r;
    unsigned mask = 0;

    memset(&r, 0, sizeof(r));
    for (int i = 0; i < count; i++) {
        const struct path *p = paths[i];
        const double in = e / fmax(p->facing_in, 0.05), out = e / fmax(p->facing_out, 0.01);
        const struct pell_dvec3 to = p->outside_mm < INFINITY ? dvec3_sub(q->light, p->at) : p->outside;
        const double unit = p->outside_mm < INFINITY ? 1.0 / p->outside_mm : 1.0;
        if (in < p->inside_mm) {
            valid[2 * i] = -1;
            set_ray(&r, 2 * i, q->x, dvec3_sub(p->at, q->x), 0.0, 1.0 - in / p->inside_mm);
        }
        if (out < p->outside_mm) {
            valid[2 * i + 1] = -1;
            set_ray(&r, 2 * i + 1, p->at, to, out * unit, p->outside_mm < INFINITY ? 1.0 : INFINITY);
        }
    }
    pell_rays_closest16(c->rays, valid, false, &r);
    for (int i = 0; i < count; i++) {
        bool clear = true;
        for (int k = 2 * i; k < 2 * i + 2; k++)
            clear = clear && (!valid[k] || r.hit.mesh[k] == PELL_NO_HIT ||
                              (k == 2 * i && r.hit.mesh[k] == paths[i]->facet->mesh && r.hit.triangle[k] == paths[i]->facet->triangle));
        mask |= (unsigned) clear << i;
    }
    return mask;
}

static void write_connection(const struct query *q, const struct path *p, struct pell_connection *out)
{
    *out = (struct pell_connection) {
        .mesh = p->facet->mesh,
        .triangle = p->facet->triangle,
        .u = (float) fmin(fmax(p->u, 0.0), 1.0),
        .v = (float) fmin(fmax(p->v, 0.0), 1.0),
        .at = dvec3_narrow(p->at),
        .normal = dvec3_narrow(p->normal),
        .inside = dvec3_narrow(p->inside),
        .outside = dvec3_narrow(p->outside),
        .inside_mm = p->inside_mm,
        .outside_mm = p->outside_mm,
        .transmit = fabs(q->eta - 1.0) < NEAR_ONE ? 1.0 : 1.0 - pell_fresnel(q->eta, p->cos_o),
        .spread = p->spread,
    };
}

/* With matched indices there is a single straight path, and a ray finds its surface point. */
static int straight(const struct pell_connector *c, int solid, const struct query *q, struct pell_connection *out, int64_t *rays)
{
    _Alignas(64) int valid[16] = { -1 };
    const struct pell_dvec3 to = q->distant ? q->light : dvec3_sub(q->light, q->x);
    const double distance = q->distant ? INFINITY : sqrt(dvec3_dot(to, to));
    struct pell_ray_hit16 r;
    struct facet f = { .planar = true };
    struct path p = { .facet = &f };
    struct pell_dvec3 geometric, n;
    double length;

    if (!(distance > 0.0))
        return 0;
    memset(&r, 0, sizeof(r));
    p.inside = p.outside = q->distant ? to : dvec3_mul(to, 1.0 / distance);
    set_ray(&r, 0, q->x, p.inside, 0.0, fmin(q->reach, distance));
    pell_rays_closest16(c->rays, valid, false, &r);
    *rays += 1;
    if (r.hit.mesh[0] >= c->solids->num_meshes || c->solids->of_mesh[r.hit.mesh[0]] != solid)
        return 0;
    pell_connect_fill_facet(&c->scene->meshes[r.hit.mesh[0]], r.hit.mesh[0], r.hit.triangle[0], c->flat, &f);
    geometric = dvec3_cross(dvec3_sub(dvec3_load(f.p[1]), dvec3_load(f.p[0])), dvec3_sub(dvec3_load(f.p[2]), dvec3_load(f.p[0])));
    length = sqrt(dvec3_dot(geometric, geometric));
    p.facing_in = p.facing_out = length > 0.0 ? dvec3_dot(p.inside, geometric) / length : 0.0;
    if (!(p.facing_in > 0.0))
        return 0;
    p.u = (double) r.hit.u[0];
    p.v = (double) r.hit.v[0];
    n = dvec3_mad(dvec3_mad(dvec3_mul(dvec3_load(f.n[0]), 1.0 - p.u - p.v), p.u, dvec3_load(f.n[1])), p.v, dvec3_load(f.n[2]));
    length = sqrt(dvec3_dot(n, n));
    p.normal = length > 0.0 ? dvec3_mul(n, 1.0 / length) : geometric;
    p.inside_mm = (double) r.ray.tfar[0];
    p.outside_mm = q->distant ? INFINITY : distance - p.inside_mm;
    p.at = dvec3_mad(q->x, p.inside_mm, p.inside);
    p.cos_o = 1.0;
    p.spread = q->distant ? 1.0 : 1.0 / (distance * distance);
    if (!(p.inside_mm > 0.0) || !(p.outside_mm > 0.0))
        return 0;
    {
        const double near = c->trees[solid].rounding / fmax(p.facing_out, 0.01);
        if (near < p.outside_mm) {
            memset(&r, 0, sizeof(r));
            set_ray(&r, 0, p.at, p.outside, near, p.outside_mm);
            pell_rays_closest16(c->rays, valid, false, &r);
            *rays += 1;
            if (r.hit.mesh[0] != PELL_NO_HIT)
                return 0;
        }
    }
    write_connection(q, &p, out);
    return 1;
}

int pell_connect(const struct pell_connector *connector, const struct pell_connection_query *query, struct pell_connection *out, int max,
                 int64_t *rays)
{
    const int solid = query->solid;
    const double eta = query->eta;
    struct query q;
    const struct path *order[PELL_CONNECTIONS];
    int64_t traced = 0;
    int count = 0;

    if (solid < 0 || (size_t) solid >= connector->solids->count || connector->trees[solid].num_facets == 0 || max <= 0 ||
        !(query->reach > 0.0) || !(eta >= PELL_ETA_MIN && eta <= PELL_ETA_MAX))
        return 0;
    q.eta = eta;
    q.grazing = sqrt(fabs(eta * eta - 1.0));
    q.reach = query->reach;
    q.x = dvec3_widen(query->x);
    q.light = dvec3_widen(query->light);
    q.distant = query->distant;
    q.count = 0;
    if (!is_point(q.x) || !is_point(q.light))
        return 0;
    if (q.distant) {
        const double length = sqrt(dvec3_dot(q.light, q.light));
        if (!(length > 0.0))
            return 0;
        q.light = dvec3_mul(q.light, 1.0 / length);
    }
    if (fabs(eta - 1.0) < NEAR_ONE) {
        count = straight(connector, solid, &q, out, &traced);
        if (rays)
            *rays += traced;
        return count;
    }
    find_paths(&q, &connector->trees[solid], connector->kernels);
    for (int i = 0; i < q.count; i++) {
        int at = i;
        for (; at > 0 && order[at - 1]->inside_mm > q.paths[i].inside_mm; at--)
            order[at] = order[at - 1];
        order[at] = &q.paths[i];
    }
    for (int first = 0; first < q.count && count < max; first += 8) {
        const int n = q.count - first < 8 ? q.count - first : 8;
        const unsigned unoccluded = unoccluded_paths(connector, &q, connector->trees[solid].rounding, order + first, n);
        traced += 2 * n;
        for (int i = 0; i < n && count < max; i++)
            if (unoccluded >> i & 1)
                write_connection(&q, order[first + i], &out[count++]);
    }
    if (rays)
        *rays += traced;
    return count;
}
