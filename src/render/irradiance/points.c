/* SPDX-License-Identifier: MIT
 *
 * points.c - light that enters at any point of the scene's surfaces: a packet of points is made to look like 4 x 4 pixels, each seen from
 * along its own normal, and goes the way of pixels from there.
 */
#include "render/irradiance/points_kernel.h"
#include "render/irradiance/stage.h"

#include "render/curvature/stage.h"
#include "scene/triangle.h"

#include <string.h>

/* The planes of 16 points. */
struct planes {
    _Alignas(64) float depth[16], ng[3][16], ns[3][16], base[3][16], roughness[16], metallic[16], specular[3][16], strength[16],
        terminator_offset[16], transmission[3][16], reflection[16];
    float place[3][16], irradiance[3][16], transmitted[3][16], mirrored[3][16], aside[3][16], once[3][16], way[3][16], diffuse[16];
    uint16_t material[16];
};

/* Places of the points from `first` on, and rays that look at them from outside, against their normals. Returns which there are. */
static uint32_t place_points(const struct pell_scene *scene, enum pell_simd_level simd, const struct pell_surface_points *p, size_t first,
                             size_t count, struct pell_ray_hit16 *packet, struct planes *s)
{
    struct pell_triangles16 triangles;
    uint32_t some = 0;

    memset(packet, 0, sizeof(*packet));
    for (size_t i = 0; i < 16; i++) {
        const size_t k = first + (i < count ? i : 0);
        const bool is = i < count && p->mesh[k] < scene->num_meshes && p->triangle[k] < scene->meshes[p->mesh[k]].num_triangles;
        struct pell_vec3 corner[3] = { { 0 } };

        if (is)
            pell_triangle_corners(&scene->meshes[p->mesh[k]], p->triangle[k], corner);
        for (int j = 0; j < 3; j++) {
            triangles.corner[j][0][i] = corner[j].x;
            triangles.corner[j][1][i] = corner[j].y;
            triangles.corner[j][2][i] = corner[j].z;
        }
        triangles.u[i] = p->u[k];
        triangles.v[i] = p->v[k];
        triangles.side[i] = p->back && p->back[k] ? -1.0f : 1.0f;
        packet->hit.triangle[i] = p->triangle[k];
        packet->hit.mesh[i] = is ? p->mesh[k] : PELL_NO_HIT;
        some |= (uint32_t) is << i;
    }
    pell_points_kernels_tables[simd]->place(&triangles, packet, s->place);
    for (int i = 0; i < 16; i++)
        if (!(some >> i & 1))
            packet->ray.dz[i] = -1.0f;
    return some;
}

/* Where alpha may cut the surface away, a short ray says whether it is there. */
static uint32_t drop_cut_out(const struct pell_irradiance_params *params, const struct planes *s, uint32_t some,
                             struct pell_ray_hit16 *packet, int64_t *rays)
{
    const struct pell_scene *scene = params->scene;
    _Alignas(64) int ask[16];
    struct pell_ray16 r;
    int any = 0;

    for (int i = 0; i < 16; i++) {
        ask[i] = some >> i & 1 && scene->materials[scene->meshes[packet->hit.mesh[i]].material].alpha_mask ? -1 : 0;
        any |= ask[i];
    }
    if (!any)
        return some;
    memset(&r, 0, sizeof(r));
    for (int i = 0; i < 16; i++) {
        const float e = 2.4e-5f * packet->ray.tfar[i];
        r.ox[i] = s->place[0][i] - e * packet->ray.dx[i];
        r.oy[i] = s->place[1][i] - e * packet->ray.dy[i];
        r.oz[i] = s->place[2][i] - e * packet->ray.dz[i];
        r.dx[i] = packet->ray.dx[i];
        r.dy[i] = packet->ray.dy[i];
        r.dz[i] = packet->ray.dz[i];
        r.tfar[i] = 2.0f * e;
        r.mask[i] = PELL_RAY_ALL;
    }
    pell_rays_occluded16(params->rays, ask, false, &r);
    for (int i = 0; i < 16; i++) {
        *rays += ask[i] != 0;
        if (ask[i] && r.tfar[i] >= 0.0f) {
            packet->hit.mesh[i] = PELL_NO_HIT;
            some &= ~(1u << i);
        }
    }
    return some;
}

/* What curvature does to out's points from `first` on. */
static void find_gains(const struct pell_irradiance_params *params, const struct pell_points_params *what, const struct pell_hit16 *hit,
                       uint32_t some, size_t first, size_t count, const struct pell_surface_light *out)
{
    struct pell_curvature_effects e;
    struct pell_points16 points;
    int32_t ask[16];

    memcpy(points.mesh, hit->mesh, sizeof(points.mesh));
    memcpy(points.triangle, hit->triangle, sizeof(points.triangle));
    memcpy(points.u, hit->u, sizeof(points.u));
    memcpy(points.v, hit->v, sizeof(points.v));
    for (size_t i = 0; i < 16; i++)
        ask[i] = -(int32_t) (params->curvature && some >> i & 1);
    if (params->curvature)
        pell_curvature_effects_at(params->curvature, &points, ask, &e);
    for (size_t i = 0; i < count; i++)
        for (int c = 0; c < 3; c++) {
            out->gain[c][first + i] = ask[i] ? pell_irradiance_gain(params, &e)[c][i] : 1.0f;
            if (out->crossed[c])
                out->crossed[c][first + i] = ask[i] ? e.crossed[c][i] : 1.0f;
            if (out->transmission[c] && ask[i] && what->local) { /* what passes a round part leaves all around it */
                out->transmission[c][first + i] += e.sheet[c][i];
                out->gain[c][first + i] += e.round[c][i];
            }
        }
}

/* 16 points, as pixels. */
struct looked {
    struct pell_irradiance_params one; /* the stage's, for them */
    struct pell_ray_hit16 packet;
    struct planes s;
    struct pell_surface surface;
    struct pell_lit_place at;
    _Alignas(64) float ambient[16];
    uint32_t number[16], some;
    int64_t rays;
};

/* Looks at the points from `first` on, at most 16. */
static void look16(const struct pell_lights *lights, const struct pell_irradiance_params *params, const struct pell_points_params *what,
                   const struct pell_surface_points *in, size_t first, size_t count, struct looked *l)
{
    struct planes *s = &l->s;

    memset(s, 0, sizeof(*s));
    l->rays = 0;
    l->some = place_points(params->scene, lights->simd, in, first, count, &l->packet, s);
    l->some = drop_cut_out(params, s, l->some, &l->packet, &l->rays);
    for (size_t i = 0; i < 16; i++) {
        const size_t k = first + (i < count ? i : 0);
        l->number[i] = in->number[k];
        l->ambient[i] = in->ambient ? in->ambient[k] : 0.0f;
    }
    l->surface = (struct pell_surface) {
        .material = s->material,
        .depth = s->depth,
        .roughness = s->roughness,
        .metallic = s->metallic,
        .strength = s->strength,
        .terminator_offset = s->terminator_offset,
        .reflection = s->reflection,
    };
    for (int c = 0; c < 3; c++) {
        l->surface.ng[c] = s->ng[c];
        l->surface.ns[c] = s->ns[c];
        l->surface.base[c] = s->base[c];
        l->surface.specular[c] = s->specular[c];
        l->surface.transmission[c] = s->transmission[c];
        l->at.place[c] = s->place[c];
    }
    if (l->some)
        pell_surface_look(params->surface, params->scene, what->spacing, &l->packet, l->some, &l->surface);
    l->surface.mesh = l->packet.hit.mesh;
    l->surface.triangle = l->packet.hit.triangle;
    l->surface.barycentric[0] = l->packet.hit.u;
    l->surface.barycentric[1] = l->packet.hit.v;
    l->at.number = l->number;
    l->at.slot = l->at.sample = 0;
    l->one = *params;
    l->one.surface = &l->surface;
    l->one.thickness = NULL;
    l->one.ambient = in->ambient ? l->ambient : NULL;
    l->one.lights = what->lights;
    l->one.local = what->local;
    l->one.flat = what->flat;
    l->one.opposed = params->opposed && what->opposed;
    l->one.sample = what->first;
    l->one.ways = false;
}

/* What is known of the points beside their light. */
static void tell16(const struct looked *l, const struct pell_points_params *what, size_t first, size_t count,
                   const struct pell_surface_light *out)
{
    const float *const inward[3] = { l->packet.ray.dx, l->packet.ray.dy, l->packet.ray.dz };

    for (size_t i = 0; i < count; i++) {
        const bool is = l->some >> i & 1;
        for (int c = 0; c < 3; c++) {
            if (out->transmission[c])
                out->transmission[c][first + i] = is && l->surface.any_thin ? l->s.transmission[c][i] : 0.0f;
            if (out->position[c])
                out->position[c][first + i] = l->s.place[c][i];
            if (out->normal[c])
                out->normal[c][first + i] = -inward[c][i];
        }
        if (out->strength)
            out->strength[first + i] = is ? l->s.strength[i] : 1.0f;
        if (out->curvature || out->thinness) {
            const struct pell_hit16 *hit = &l->packet.hit;
            struct pell_curvature_shape shape = { 0.0f, 0.0f };
            if (l->one.curvature && is)
                shape = pell_curvature_at(l->one.curvature, hit->mesh[i], hit->triangle[i], hit->u[i], hit->v[i]);
            if (out->curvature)
                out->curvature[first + i] = shape.mean;
            if (out->thinness)
                out->thinness[first + i] = shape.thinness;
        }
        if (out->there)
            out->there[first + i] = is;
    }
    if (out->gain[0])
        find_gains(&l->one, what, &l->packet.hit, l->some, first, count, out);
}

/* Lights the points from `first` on, at most 16; `slot`: see pell_irradiance_take_points. Returns the number of rays. */
static int64_t light16(const struct pell_lights *lights, const struct pell_irradiance_params *params, const struct pell_points_params *what,
                       const struct pell_surface_points *in, size_t first, size_t count, uint32_t slot,
                       const struct pell_surface_light *out)
{
    _Alignas(64) float mean[3][16] = { { 0 } }, albedo[3][16] = { { 0 } };
    struct pell_lighting lighting = { .shadow_rays = 0 };
    struct looked l;
    int64_t rays;

    look16(lights, params, what, in, first, count, &l);
    rays = l.rays;
    l.at.slot = slot;
    for (int c = 0; c < 3; c++) {
        lighting.irradiance[c] = l.s.irradiance[c];
        lighting.transmitted[c] = l.s.transmitted[c];
        lighting.specular[c] = l.s.mirrored[c];
        lighting.aside[c] = l.s.aside[c];
        lighting.once[c] = l.s.once[c];
        lighting.way_in[c] = l.s.way[c];
    }
    lighting.diffuse = l.s.diffuse;
    l.one.ways = out->aside[0];
    for (int k = 0; l.some && k < what->samples; k++) {
        l.one.sample = what->first + (uint32_t) k;
        l.at.sample = (uint32_t) k;
        pell_irradiance_at(lights, &l.one, &l.at, &lighting, albedo);
        rays += lighting.shadow_rays + lighting.device_rays;
        for (int c = 0; c < 3; c++)
            for (int i = 0; i < 16; i++)
                mean[c][i] += l.some >> i & 1 ? (l.s.irradiance[c][i] + l.s.transmitted[c][i]) / (float) what->samples : 0.0f;
    }
    for (size_t i = 0; i < count; i++)
        for (int c = 0; c < 3; c++) {
            if (out->aside[c]) { /* of the last sample */
                out->aside[c][first + i] = l.s.aside[c][i];
                out->once[c][first + i] = l.s.once[c][i];
                out->way[c][first + i] = l.s.way[c][i];
            }
            out->irradiance[c][first + i] = mean[c][i];
            if (out->albedo[c])
                out->albedo[c][first + i] = albedo[c][i];
        }
    if (out->aside[0])
        memcpy(out->diffuse + first, l.s.diffuse, count * sizeof(*out->diffuse));
    tell16(&l, what, first, count, out);
    return rays;
}

int64_t pell_irradiance_points(const struct pell_lights *lights, const struct pell_irradiance_params *params,
                               const struct pell_points_params *what, const struct pell_surface_points *in, size_t n,
                               const struct pell_surface_light *out)
{
    int64_t rays = 0;

    for (size_t first = 0; first < n; first += 16)
        rays += light16(lights, params, what, in, first, n - first < 16 ? n - first : 16, 0, out);
    return rays;
}

uint32_t pell_irradiance_send_points(const struct pell_lights *lights, const struct pell_irradiance_params *params,
                                     const struct pell_points_params *what, const struct pell_surface_points *in, size_t n)
{
    struct looked l;

    look16(lights, params, what, in, 0, n, &l);
    return l.some ? pell_irradiance_send(lights, &l.one, &l.at, what->samples) : 0;
}

int64_t pell_irradiance_take_points(const struct pell_lights *lights, const struct pell_irradiance_params *params,
                                    const struct pell_points_params *what, const struct pell_surface_points *in, size_t n, uint32_t slot,
                                    const struct pell_surface_light *out)
{
    return light16(lights, params, what, in, 0, n, slot, out);
}
