/* SPDX-License-Identifier: MIT
 * packet_rays.c - rays of a packet: the exit of the camera ray from the solid, and paths from lights to points of the march. */
#include "methods/layered/state.h"

#include <string.h>

struct rays {
    struct pell_ray_hit16 r;
    _Alignas(64) int valid[16];
    int count;
};

static void set_ray(struct rays *rays, int i, struct pell_vec3 from, struct pell_vec3 dir, float near, float far)
{
    struct pell_ray16 *r = &rays->r.ray;

    r->ox[i] = from.x;
    r->oy[i] = from.y;
    r->oz[i] = from.z;
    r->dx[i] = dir.x;
    r->dy[i] = dir.y;
    r->dz[i] = dir.z;
    r->tnear[i] = near;
    r->tfar[i] = far;
    r->mask[i] = PELL_RAY_ALL;
    rays->valid[i] = -1;
    rays->count++;
}

static void clear_rays(struct rays *rays)
{
    memset(rays, 0, sizeof(*rays));
    for (int i = 0; i < 16; i++)
        rays->r.hit.mesh[i] = PELL_NO_HIT;
}

static float ray_offset(const struct layered_packet *p, int i)
{
    return LAYERED_RAY_OFFSET * fmaxf(fmaxf(fabsf(p->p[0][i]), fabsf(p->p[1][i])), fmaxf(fabsf(p->p[2][i]), 1e-3f));
}

/* --- Camera ray -------------------------------------------------------------------------------------------------------------------- */

/* Texture lookups relative to the far surface: the coordinates at the exit point, extrapolated along the ray. */
static void far_lookup(const struct layered_medium *m, struct layered_packet *p, int i, const struct pell_mesh *mesh, uint32_t triangle,
                       float u, float v)
{
    const uint32_t *index = mesh->index + 3 * (size_t) triangle;
    const struct pell_vec3 a = vec3_load(mesh->position + 3 * (size_t) index[0]);
    const struct pell_vec3 e1 = vec3_sub(vec3_load(mesh->position + 3 * (size_t) index[1]), a);
    const struct pell_vec3 e2 = vec3_sub(vec3_load(mesh->position + 3 * (size_t) index[2]), a), n = vec3_cross(e1, e2);
    const float square = vec3_dot(n, n), inv_square = square > 1e-30f ? 1.0f / square : 0.0f;
    const struct pell_vec3 g1 = vec3_mul(vec3_cross(e2, n), inv_square), g2 = vec3_mul(vec3_cross(n, e1), inv_square),
                           w = layered_lane3(p->w, i);
    const float d1 = vec3_dot(g1, w), d2 = vec3_dot(g2, w);

    for (int k = 0; k < m->packs + m->colors; k++) {
        struct layered_lookup *o = &p->lookup[k];
        float c[3][2];
        for (int q = 0; q < 3; q++)
            layered_map_uv(m->pack[k].map, mesh, index[q], c[q]);
        o->du[1][i] = (c[1][0] - c[0][0]) * d1 + (c[2][0] - c[0][0]) * d2;
        o->dv[1][i] = (c[1][1] - c[0][1]) * d1 + (c[2][1] - c[0][1]) * d2;
        o->u[1][i] = (1.0f - u - v) * c[0][0] + u * c[1][0] + v * c[2][0] - p->exit[i] * o->du[1][i];
        o->v[1][i] = (1.0f - u - v) * c[0][1] + u * c[1][1] + v * c[2][1] - p->exit[i] * o->dv[1][i];
    }
}

void layered_find_exits(const struct layered_state *st, const struct layered_medium *m, const uint32_t *mesh, struct layered_worker *w)
{
    const struct pell_scene *scene = st->services->scene;
    struct layered_packet *p = &w->packet;
    const bool both_surfaces = st->knobs.path != LAYERED_PLANES;
    struct rays rays;

    st->kernels->exit_rays(p, st->size, &rays.r.ray, rays.valid);
    for (int i = 0; i < LAYERED_LANES; i++)
        rays.r.hit.mesh[i] = PELL_NO_HIT;
    pell_rays_closest16(st->services->rays, rays.valid, true, &rays.r);
    w->rays += p->count;
    for (int i = 0; i < p->count; i++) {
        const struct pell_hit16 *h = &rays.r.hit;
        const struct pell_vec3 dir = layered_lane3(p->w, i);
        float facing;
        p->length[i] = fminf(p->length[i], 4.0f * st->size);
        if (h->mesh[i] == PELL_NO_HIT)
            continue;
        facing = h->ngx[i] * dir.x + h->ngy[i] * dir.y + h->ngz[i] * dir.z;
        p->ends_deep[i] = -(p->length[i] < rays.r.ray.tfar[i]);
        if (facing > 0.0f && both_surfaces && layered_same_solid(&scene->meshes[h->mesh[i]], &scene->meshes[mesh[i]])) {
            struct pell_vec3 n = layered_normal_at(&scene->meshes[h->mesh[i]], h->triangle[i], h->u[i], h->v[i]);
            float rate = vec3_dot(n, dir), end = fminf(p->length[i], rays.r.ray.tfar[i]);
            if (!(rate > LAYERED_GRAZING))
                rate = LAYERED_GRAZING;
            if ((rays.r.ray.tfar[i] - end) * rate < end * p->rate[i]) {
                p->exit[i] = rays.r.ray.tfar[i];
                p->exit_rate[i] = rate;
                p->exit_normal[0][i] = n.x;
                p->exit_normal[1][i] = n.y;
                p->exit_normal[2][i] = n.z;
                p->thin = true;
                far_lookup(m, p, i, &scene->meshes[h->mesh[i]], h->triangle[i], h->u[i], h->v[i]);
            }
        }
        p->length[i] = fminf(p->length[i], rays.r.ray.tfar[i]);
    }
}

/* --- Light ---------------------------------------------------------------------------------------------------------------------- */

static struct pell_vec3 toward(const struct layered_light *source, int i, struct pell_vec3 from, float *distance)
{
    struct pell_vec3 d = layered_lane3(source->to, i);

    *distance = INFINITY;
    if (source->distant)
        return d;
    d = vec3_sub(d, from);
    *distance = fmaxf(vec3_length(d), 1e-6f);
    return vec3_mul(d, 1.0f / *distance);
}

void layered_set_planes(const struct layered_state *st, const struct layered_light_point *s, const struct layered_packet *p,
                        struct layered_worker *w, struct layered_light *source)
{
    _Alignas(64) int32_t visible[LAYERED_LANES];
    struct rays rays;
    const int count = st->kernels->light_rays(p, st->knobs.path, st->knobs.shadows, source, &rays.r.ray, rays.valid);

    if (count == 0)
        return;
    w->rays += count;
    if (!s->grid || !pell_light_grid_visible16(s->grid, rays.valid, rays.r.ray.ox, rays.r.ray.oy, rays.r.ray.oz, visible)) {
        pell_rays_occluded16(st->services->rays, rays.valid, true, &rays.r.ray);
        for (int i = 0; i < p->count; i++)
            visible[i] = rays.r.ray.tfar[i] < 0.0f ? 0 : -1;
    }
    for (int i = 0; i < p->count; i++)
        if (rays.valid[i] && !visible[i])
            source->seen[i] = 0.0f;
}

/* One node of a packet: the points of the march where active lanes look for light, and the entry points of the light on its way to them. */
struct node {
    struct rays rays;
    struct pell_vec3 at[16], dir[16], k[16], n[16];
    bool active[16], found[16], refracted[16]; /* found: the ray hit the solid's surface from inside; refracted: the path is exact */
};

static void trace_node(const struct layered_state *st, const struct layered_packet *p, const uint32_t *mesh, struct node *n,
                       struct layered_worker *w)
{
    const struct pell_scene *scene = st->services->scene;

    clear_rays(&n->rays);
    for (int i = 0; i < p->count; i++)
        if (n->active[i])
            set_ray(&n->rays, i, n->at[i], n->dir[i], ray_offset(p, i), INFINITY);
    pell_rays_closest16(st->services->rays, n->rays.valid, true, &n->rays.r);
    w->rays += n->rays.count;
    for (int i = 0; i < p->count; i++) {
        const struct pell_hit16 *h = &n->rays.r.hit;
        const struct pell_vec3 g = vec3(h->ngx[i], h->ngy[i], h->ngz[i]);
        n->found[i] = n->active[i] && h->mesh[i] != PELL_NO_HIT && vec3_dot(g, n->dir[i]) > 0.0f &&
                      layered_same_solid(&scene->meshes[h->mesh[i]], &scene->meshes[mesh[i]]);
        if (!n->found[i])
            continue;
        n->k[i] = vec3_mad(n->at[i], n->rays.r.ray.tfar[i], n->dir[i]);
        n->n[i] = layered_normal_at(&scene->meshes[h->mesh[i]], h->triangle[i], h->u[i], h->v[i]);
        if (!(vec3_dot(n->n[i], n->dir[i]) > 0.0f))
            n->n[i] = vec3_normalize(g);
    }
}

/* Refracts the light direction at the entry point found, as an estimate of the direction from M. */
static void refract_at_node(const struct layered_packet *p, const struct layered_light *source, float eta, struct node *n)
{
    for (int i = 0; i < p->count; i++) {
        float distance, co, ci;
        struct pell_vec3 to;
        if (!n->found[i])
            continue;
        to = toward(source, i, n->k[i], &distance);
        co = vec3_dot(n->n[i], to);
        if (!(co > 0.0f))
            continue;
        ci = sqrtf(1.0f - (1.0f - co * co) / (eta * eta));
        n->dir[i] = vec3_mad(vec3_mul(to, 1.0f / eta), ci - co / eta, n->n[i]);
    }
}

/* An open sheet has no far surface: light enters where its layers end. */
static void enter_open_sheet(const struct layered_medium *m, const struct layered_packet *p, struct layered_light *source,
                             const struct node *n, int node, float deepest, float t, int i)
{
    float *km = &source->km[node][i], *beam = &source->beam[node][i];
    const float under = -vec3_dot(layered_lane3(p->n, i), n->dir[i]), depth = t * p->length[i] * p->rate[i];
    float distance;

    *km = 0.0f;
    *beam = 0.0f;
    if (m->bottomless || n->rays.r.hit.mesh[i] != PELL_NO_HIT || !(under > 0.0f))
        return;
    *km = fmaxf(deepest - depth, 0.0f) / fmaxf(under, LAYERED_GRAZING);
    toward(source, i, vec3_mad(n->at[i], *km, n->dir[i]), &distance);
    *beam = source->distant ? 1.0f : 1.0f / fmaxf(distance * distance, 1e-6f);
}

static void cast_shadows(const struct layered_state *st, const struct layered_packet *p, struct layered_light *source, const struct node *n,
                         int node, struct layered_worker *w)
{
    struct rays rays;

    clear_rays(&rays);
    for (int i = 0; i < p->count; i++) {
        struct pell_vec3 from = n->k[i], to;
        float distance;
        if (!n->active[i] || n->refracted[i] || !(source->beam[node][i] > 0.0f))
            continue;
        if (!n->found[i])
            from = vec3_mad(n->at[i], source->km[node][i], n->dir[i]);
        to = toward(source, i, from, &distance);
        set_ray(&rays, i, from, to, 2.0f * ray_offset(p, i), source->distant ? INFINITY : 0.9999f * distance);
    }
    if (rays.count == 0)
        return;
    pell_rays_occluded16(st->services->rays, rays.valid, true, &rays.r.ray);
    w->rays += rays.count;
    for (int i = 0; i < p->count; i++)
        if (rays.valid[i] && rays.r.ray.tfar[i] < 0.0f)
            source->beam[node][i] = 0.0f;
}

static void depths_at_point(const struct layered_state *st, int material, const struct pell_mesh *mesh, uint32_t triangle, float u, float v,
                            float *depth)
{
    const struct layered_medium *m = &st->media[material];

    pell_medium_layers_depths(st->medium_layers[material], mesh, triangle, u, v, depth);
    for (int j = 0; j < m->count; j++)
        depth[j] = fminf(j + 1 == m->count && m->bottomless ? LAYERED_FAR : depth[j], LAYERED_FAR);
}

/* A point of a mesh. */
struct surface_point {
    uint32_t mesh, triangle;
    float u, v;
};

/* Tint of light that enters at this point. */
static void tint_node(const struct layered_medium *m, const struct pell_scene *scene, const struct surface_point *at,
                      struct layered_light *source, int node, int i)
{
    const struct pell_mesh *mesh = &scene->meshes[at->mesh];
    float color[3], tint[3] = { 1.0f, 1.0f, 1.0f };

    if (!m->colors)
        return;
    pell_base_color_at(&scene->materials[mesh->material], mesh, at->triangle, at->u, at->v, color);
    pell_tint_apply(&m->tint, color, true, tint);
    for (int c = 0; c < 3; c++)
        source->tint[node][c][i] = tint[c];
}

/* Finds exact refracted paths; a lane without one keeps the geometry of its traced ray, with no light. */
static void refract_node(const struct layered_state *st, const struct layered_medium *m, const struct layered_packet *p,
                         struct layered_light *source, const uint32_t *mesh, int node, struct node *n, struct layered_worker *w)
{
    const struct pell_scene *scene = st->services->scene;
    const int material = scene->meshes[mesh[0]].material;
    const float before = node > 0 ? st->work.node[node - 1] : 0.0f;
    float min_sigma_t2 = INFINITY;

    for (int j = 0; j < m->count; j++)
        for (int c = 0; c < 3; c++)
            min_sigma_t2 = fminf(min_sigma_t2, m->layer[j].sigma_t2[c]);
    for (int i = 0; i < p->count; i++) {
        struct layered_entry e;
        float depth[PELL_LAYERS_MOST];
        if (before * p->length[i] * min_sigma_t2 > st->work.max_tau2) /* the march ends before this node */
            continue;
        n->refracted[i] = n->active[i] && n->rays.r.hit.mesh[i] != PELL_NO_HIT; /* else an open sheet without a far surface */
        if (!n->refracted[i])
            continue;
        source->beam[node][i] = 0.0f;
        if (!layered_refract(st, m, st->solids->of_mesh[mesh[i]], n->at[i], source->distant, layered_lane3(source->to, i), &e, &w->rays))
            continue;
        source->km[node][i] = e.km;
        source->cosine[node][i] = e.cosine;
        source->beam[node][i] = e.beam;
        source->dir[node][0][i] = e.dir.x;
        source->dir[node][1][i] = e.dir.y;
        source->dir[node][2][i] = e.dir.z;
        tint_node(m, scene, &(struct surface_point) { e.mesh, e.triangle, e.u, e.v }, source, node, i);
        if (m->packs > 0)
            depths_at_point(st, material, &scene->meshes[e.mesh], e.triangle, e.u, e.v, depth);
        for (int j = 0; j < m->count && m->packs > 0; j++)
            source->depth[(node * m->count + j) * LAYERED_LANES + i] = depth[j];
    }
}

void layered_set_node(const struct layered_state *st, const struct layered_medium *m, const struct layered_packet *p,
                      struct layered_light *source, const uint32_t *mesh, const uint32_t *triangle, int node, struct layered_worker *w)
{
    const struct pell_scene *scene = st->services->scene;
    const int material = scene->meshes[mesh[0]].material;
    const float t = st->work.node[node], eta = st->work.refracts ? m->eta : 1.0f;
    struct node n;

    for (int i = 0; i < p->count; i++) {
        float distance;
        n.refracted[i] = false;
        n.active[i] = source->planes[i] < 1.0f && source->power[0][i] + source->power[1][i] + source->power[2][i] > 0.0f;
        n.at[i] = vec3_mad(layered_lane3(p->p, i), t * p->length[i], layered_lane3(p->w, i));
        n.dir[i] = toward(source, i, n.at[i], &distance);
    }
    trace_node(st, p, mesh, &n, w);
    if (eta != 1.0f) {
        refract_at_node(p, source, eta, &n);
        trace_node(st, p, mesh, &n, w);
    }
    for (int i = 0; i < LAYERED_LANES; i++) {
        const struct pell_hit16 *h = &n.rays.r.hit;
        float depth[PELL_LAYERS_MOST], distance, co;
        source->km[node][i] = source->beam[node][i] = 0.0f;
        source->cosine[node][i] = 1.0f;
        for (int k = 0; k < 3; k++) {
            source->dir[node][k][i] = k == 0;
            source->tint[node][k][i] = 0.0f;
        }
        for (int j = 0; j < m->count; j++)
            source->depth[(node * m->count + j) * LAYERED_LANES + i] = m->layer[j].depth;
        if (i >= p->count || !n.active[i])
            continue;
        source->dir[node][0][i] = n.dir[i].x;
        source->dir[node][1][i] = n.dir[i].y;
        source->dir[node][2][i] = n.dir[i].z;
        if (n.found[i]) {
            const struct pell_vec3 to = toward(source, i, n.k[i], &distance);
            co = vec3_dot(n.n[i], to);
            source->km[node][i] = n.rays.r.ray.tfar[i];
            source->cosine[node][i] = fmaxf(vec3_dot(n.n[i], n.dir[i]), LAYERED_GRAZING);
            if (co > 0.0f) {
                const float ci = sqrtf(1.0f - (1.0f - co * co) / (eta * eta));
                source->beam[node][i] = eta == 1.0f ? 1.0f : (float) (1.0 - pell_fresnel((double) eta, (double) fminf(co, 1.0f))) * co / ci;
                source->beam[node][i] *= source->distant ? 1.0f : 1.0f / fmaxf(distance * distance, 1e-6f);
            }
            tint_node(m, scene, &(struct surface_point) { h->mesh[i], h->triangle[i], h->u[i], h->v[i] }, source, node, i);
            if (m->packs > 0)
                depths_at_point(st, material, &scene->meshes[h->mesh[i]], h->triangle[i], h->u[i], h->v[i], depth);
        } else {
            tint_node(m, scene, &(struct surface_point) { mesh[i], triangle[i], p->u[i], p->v[i] }, source, node, i);
            if (m->packs > 0)
                depths_at_point(st, material, &scene->meshes[mesh[i]], triangle[i], p->u[i], p->v[i], depth);
            enter_open_sheet(m, p, source, &n, node, m->packs > 0 ? depth[m->count - 1] : m->deepest, t, i);
            source->cosine[node][i] = 1e6f;
        }
        for (int j = 0; j < m->count && m->packs > 0; j++)
            source->depth[(node * m->count + j) * LAYERED_LANES + i] = depth[j];
    }
    if (st->connector)
        refract_node(st, m, p, source, mesh, node, &n, w);
    if (st->knobs.shadows)
        cast_shadows(st, p, source, &n, node, w);
}
