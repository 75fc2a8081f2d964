/* SPDX-License-Identifier: MIT
 * media.c - finds the media that transmit unscattered light, and whether their parts are thin enough for it to matter. */
#include "render/unscattered/internal.h"

#include "base/base.h"
#include "scene/triangle.h"

#include <string.h>

#define MAX_THICKNESS 6.0f /* optical thickness of the clearest channel up to which a part is thin */
#define MIN_FRACTION 0.01f /* least fraction of the surface that is above thin parts */
#define MIN_TOUCHING 0.05f /* and that another solid's faces coincide with for a warning */
#define PROBES 1024        /* per material, uniformly over its area */
#define RAY_OFFSET 2.4e-5f /* of the largest coordinate: offset of ray origins */

static bool make_medium(const struct pell_material *m, const struct pell_frame_material *f, struct unscattered_medium *out)
{
    const struct pell_medium *medium = &f->medium;

    if (!pell_scatters_by_medium(m, f) || m->num_layers > 0 || m->color_from == PELL_COLOR_FROM_TEXTURE || !pell_medium_valid(medium, NULL))
        return false;
    *out = (struct unscattered_medium) { .is_traced = true, .eta = (float) medium->eta, .min_sigma_t = INFINITY };
    for (int c = 0; c < 3; c++) {
        out->sigma_t[c] = (float) (medium->sigma_a[c] + medium->sigma_s_reduced[c] / (1.0 - medium->g[c]));
        out->min_sigma_t = fminf(out->min_sigma_t, out->sigma_t[c]);
    }
    return true;
}

/* --- Thickness ------------------------------------------------------------------------------------------------------------------------ */

struct probe {
    const struct pell_scene *scene;
    const struct pell_rays *rays;
    struct pell_ray_hit16 r, across; /* inward, and from just outside to just inside */
    int object[PELL_PACKET], count;  /* in the packet */
    float reach;                     /* mm */
    int thin, touching, all;
};

/* Whether ray i has hit another translucent object: its outer side (side -1) or its inner one (1). */
static bool hits_other(const struct probe *p, const struct pell_ray_hit16 *r, int i, float side)
{
    const struct pell_mesh *hit = r->hit.mesh[i] < p->scene->num_meshes ? &p->scene->meshes[r->hit.mesh[i]] : NULL;
    const float along = r->hit.ngx[i] * r->ray.dx[i] + r->hit.ngy[i] * r->ray.dy[i] + r->hit.ngz[i] * r->ray.dz[i];

    return hit && pell_mesh_assembly(hit) != p->object[i] && !p->scene->materials[hit->material].opaque && side * along > 0.0f;
}

static void trace(struct probe *p)
{
    _Alignas(64) int active[PELL_PACKET];

    for (int i = 0; i < PELL_PACKET; i++) {
        active[i] = i < p->count ? -1 : 0;
        p->r.hit.mesh[i] = p->r.hit.instance[i] = p->across.hit.mesh[i] = p->across.hit.instance[i] = PELL_NO_HIT;
    }
    pell_rays_closest16(p->rays, active, false, &p->r);
    pell_rays_closest16(p->rays, active, false, &p->across);
    for (int i = 0; i < p->count; i++) {
        /* a ray may enter a solid that overlaps this one */
        p->thin += hits_other(p, &p->r, i, -1.0f) || pell_hit16_inside(p->scene, &p->r, i, p->object[i]);
        p->touching += hits_other(p, &p->across, i, 1.0f);
    }
    p->all += p->count;
    p->count = 0;
}

static void add_probe(struct probe *p, const struct pell_mesh *mesh, uint32_t triangle, uint32_t index)
{
    const float u = pell_unit_float(pell_hash(2 * index)), v = pell_unit_float(pell_hash(2 * index + 1)), root = sqrtf(u);
    struct pell_vec3 corner[3], n, at;
    float offset;

    pell_triangle_corners(mesh, triangle, corner);
    n = vec3_normalize(pell_triangle_cross(corner));
    at = vec3_mad(vec3_mad(vec3_mul(corner[0], 1.0f - root), root * (1.0f - v), corner[1]), root * v, corner[2]);
    offset = RAY_OFFSET * vec3_max_abs(at);
    p->object[p->count] = pell_mesh_assembly(mesh);
    pell_ray16_set(&p->across.ray, p->count, vec3_mad(at, offset, n), vec3_mul(n, -1.0f), 2.0f * offset);
    pell_ray16_set(&p->r.ray, p->count++, vec3_mad(at, -offset, n), vec3_mul(n, -1.0f), p->reach);
    if (p->count == PELL_PACKET)
        trace(p);
}

static double area_of(const struct pell_mesh *mesh, uint32_t triangle)
{
    struct pell_vec3 corner[3];

    pell_triangle_corners(mesh, triangle, corner);
    return 0.5 * (double) vec3_length(pell_triangle_cross(corner));
}

/* Probes a material by inward rays from points distributed uniformly over the area of its triangles. */
static bool is_thin(const struct pell_scene *scene, const struct pell_rays *rays, size_t material, float min_sigma_t, bool *touches)
{
    struct probe p = { .scene = scene, .rays = rays, .reach = MAX_THICKNESS / min_sigma_t };
    double area = 0.0, next, sum = 0.0;
    uint32_t index = 0;

    for (size_t i = 0; i < scene->num_meshes; i++)
        for (uint32_t t = 0; (size_t) scene->meshes[i].material == material && t < scene->meshes[i].num_triangles; t++)
            area += area_of(&scene->meshes[i], t);
    next = 0.5 * area / PROBES;
    for (size_t i = 0; i < scene->num_meshes && area > 0.0; i++)
        for (uint32_t t = 0; (size_t) scene->meshes[i].material == material && t < scene->meshes[i].num_triangles; t++)
            for (sum += area_of(&scene->meshes[i], t); sum > next && index < PROBES; next += area / PROBES)
                add_probe(&p, &scene->meshes[i], t, index++);
    if (p.count > 0)
        trace(&p);
    *touches = (float) p.touching >= MIN_TOUCHING * (float) p.all;
    return p.all > 0 && (float) p.thin >= MIN_FRACTION * (float) p.all;
}

enum pell_result pell_unscattered_create(struct pell_context *ctx, const struct pell_scene *scene, const struct pell_rays *rays,
                                         const uint16_t *frame_index, const struct pell_frame_material *materials,
                                         struct pell_unscattered **out)
{
    struct pell_unscattered *u = *out = pell_zalloc(ctx, sizeof(*u));
    bool any = false;

    if (!u)
        return PELL_ERR_NOMEM;
    u->ctx = ctx;
    u->media = pell_calloc(ctx, scene->num_materials + 1, sizeof(*u->media));
    if (!u->media) {
        pell_unscattered_destroy(out);
        return PELL_ERR_NOMEM;
    }
    for (size_t i = 0; i < scene->num_materials; i++) {
        const size_t id = frame_index[i + 1];
        bool touches;
        if (id == 0 || !make_medium(&scene->materials[i], &materials[id - 1], &u->media[i]))
            continue;
        u->media[i].thin = is_thin(scene, rays, i, u->media[i].min_sigma_t, &touches);
        any |= u->media[i].thin;
        if (u->media[i].thin && touches)
            pell_warn(
                ctx, pell_material_shown_name(&scene->materials[i]), "let one overlap the other, or leave a gap",
                "its faces coincide with those of another translucent object: rays meet only one of them, and unscattered light is noisy");
    }
    for (uint32_t i = 0; i < UNSCATTERED_BUNDLES; i++)
        unscattered_bundle_make(i, u->bundles[i]);
    if (!any)
        pell_unscattered_destroy(out);
    return PELL_OK;
}

void pell_unscattered_destroy(struct pell_unscattered **unscattered)
{
    struct pell_unscattered *u = *unscattered;

    *unscattered = NULL;
    if (u) {
        pell_free(u->ctx, u->media);
        pell_free(u->ctx, u);
    }
}
