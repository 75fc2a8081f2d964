/* SPDX-License-Identifier: MIT
 *
 * points.c - irradiance at arbitrary points of the scene's surfaces: a packet of points is presented as 4 x 4 pixels, each viewed along its
 * own normal, and is then processed like pixels.
 */
#include "render/irradiance/points_kernel.h"
#include "render/irradiance/stage.h"

#include "render/curvature/stage.h"
#include "scene/triangle.h"

#include <string.h>

/* Surface planes of 16 points. */
struct planes {
    _Alignas(64) float depth[16], ng[3][16], ns[3][16], base[3][16], roughness[16], metallic[16], specular[3][16], strength[16],
        terminator_offset[16], transmission[3][16], reflection[16];
    float position[3][16], irradiance[3][16], transmitted[3][16], mirrored[3][16], shifted[3][16], single_surplus[3][16], direction[3][16],
        diffuse[16];
    uint16_t material[16];
};

/* Computes the positions of points from `first` on, and rays that arrive at them from outside, against their normals. Returns a mask of
 * valid points. */
static uint32_t place_points(const struct pell_scene *scene, enum pell_simd_level simd, const struct pell_surface_points *p, size_t first,
                             size_t count, struct pell_ray_hit16 *packet, struct planes *s)
{
    struct pell_triangles16 triangles;
    uint32_t valid = 0;

    memset(packet, 0, sizeof(*packet));
    for (size_t i = 0; i < 16; i++) {
        const size_t k = first + (i < count ? i : 0);
        const bool valid_point = i < count && p->mesh[k] < scene->num_meshes && p->triangle[k] < scene->meshes[p->mesh[k]].num_triangles;
        struct pell_vec3 corner[3] = { { 0 } };

        if (valid_point)
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
        packet->hit.mesh[i] = valid_point ? p->mesh[k] : PELL_NO_HIT;
        valid |= (uint32_t) valid_point << i;
    }
    pell_points_kernels_tables[simd]->position(&triangles, packet, s->position);
    for (int i = 0; i < 16; i++)
        if (!(valid >> i & 1))
            packet->ray.dz[i] = -1.0f;
    return valid;
}

/* Removes points where alpha cuts the surface away, by short rays. */
static uint32_t drop_cut_out(const struct pell_irradiance_params *params, const struct planes *s, uint32_t valid,
                             struct pell_ray_hit16 *packet, int64_t *rays)
{
    const struct pell_scene *scene = params->scene;
    _Alignas(64) int active[16];
    struct pell_ray16 r;
    int any = 0;

    for (int i = 0; i < 16; i++) {
        active[i] = valid >> i & 1 && scene->materials[scene->meshes[packet->hit.mesh[i]].material].alpha_mask ? -1 : 0;
        any |= active[i];
    }
    if (!any)
        return valid;
    memset(&r, 0, sizeof(r));
    for (int i = 0; i < 16; i++) {
        const float e = 2.4e-5f * packet->ray.tfar[i];
        r.ox[i] = s->position[0][i] - e * packet->ray.dx[i];
        r.oy[i] = s->position[1][i] - e * packet->ray.dy[i];
        r.oz[i] = s->position[2][i] - e * packet->ray.dz[i];
        r.dx[i] = packet->ray.dx[i];
        r.dy[i] = packet->ray.dy[i];
        r.dz[i] = packet->ray.dz[i];
        r.tfar[i] = 2.0f * e;
        r.mask[i] = PELL_RAY_ALL;
    }
    pell_rays_occluded16(params->rays, active, false, &r);
    for (int i = 0; i < 16; i++) {
        *rays += active[i] != 0;
        if (active[i] && r.tfar[i] >= 0.0f) {
            packet->hit.mesh[i] = PELL_NO_HIT;
            valid &= ~(1u << i);
        }
    }
    return valid;
}

/* Writes the gains of curvature for points from `first` on. */
static void write_gains(const struct pell_irradiance_params *params, const struct pell_points_params *what, const struct pell_hit16 *hit,
                        uint32_t valid, size_t first, size_t count, const struct pell_surface_light *out)
{
    struct pell_curvature_effects e;
    struct pell_points16 points;
    int32_t active[16];

    memcpy(points.mesh, hit->mesh, sizeof(points.mesh));
    memcpy(points.triangle, hit->triangle, sizeof(points.triangle));
    memcpy(points.u, hit->u, sizeof(points.u));
    memcpy(points.v, hit->v, sizeof(points.v));
    for (size_t i = 0; i < 16; i++)
        active[i] = -(int32_t) (params->curvature && valid >> i & 1);
    if (params->curvature)
        pell_curvature_effects_at(params->curvature, &points, active, &e);
    for (size_t i = 0; i < count; i++)
        for (int c = 0; c < 3; c++) {
            out->gain[c][first + i] = active[i] ? pell_irradiance_gain(params, &e)[c][i] : 1.0f;
            if (out->crossed[c])
                out->crossed[c][first + i] = active[i] ? e.crossed[c][i] : 1.0f;
            if (out->uniform[c]) {
                out->uniform[c][first + i] = active[i] ? e.uniform[c][i] : 1.0f;
                out->small[c][first + i] = active[i] ? (1.0f - e.flat[i]) * e.small[c][i] : 0.0f;
            }
            if (out->transmission[c] && active[i] && what->local) { /* light that is transmitted by a round part leaves all around it */
                out->transmission[c][first + i] += e.sheet[c][i];
                out->gain[c][first + i] += e.round[c][i];
            }
        }
}

/* 16 points, presented as pixels. */
struct point_packet {
    struct pell_irradiance_params params16; /* parameters of the stage for these points */
    struct pell_ray_hit16 packet;
    struct planes s;
    struct pell_surface surface;
    struct pell_irradiance_packet at;
    _Alignas(64) float ambient[16];
    uint32_t seed[16], valid;
    int64_t rays;
};

/* Loads at most 16 points from `first` on. */
static void load16(const struct pell_lights *lights, const struct pell_irradiance_params *params, const struct pell_points_params *what,
                   const struct pell_surface_points *in, size_t first, size_t count, struct point_packet *l)
{
    struct planes *s = &l->s;

    memset(s, 0, sizeof(*s));
    l->rays = 0;
    l->valid = place_points(params->scene, lights->simd, in, first, count, &l->packet, s);
    l->valid = drop_cut_out(params, s, l->valid, &l->packet, &l->rays);
    for (size_t i = 0; i < 16; i++) {
        const size_t k = first + (i < count ? i : 0);
        l->seed[i] = in->seed[k];
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
        l->at.position[c] = s->position[c];
    }
    if (l->valid)
        pell_surface_look(params->surface, params->scene, what->spacing, &l->packet, l->valid, &l->surface);
    l->surface.mesh = l->packet.hit.mesh;
    l->surface.triangle = l->packet.hit.triangle;
    l->surface.barycentric[0] = l->packet.hit.u;
    l->surface.barycentric[1] = l->packet.hit.v;
    l->at.seed = l->seed;
    l->at.slot = l->at.sample = 0;
    l->params16 = *params;
    l->params16.surface = &l->surface;
    l->params16.thickness = NULL;
    l->params16.ambient = in->ambient ? l->ambient : NULL;
    l->params16.lights = what->lights;
    l->params16.local = what->local;
    l->params16.flat = what->flat;
    l->params16.opposed = params->opposed && what->opposed;
    l->params16.sample = what->first;
    l->params16.directions = false;
}

/* Writes the properties of points other than light. */
static void write_shape16(const struct point_packet *l, const struct pell_points_params *what, size_t first, size_t count,
                          const struct pell_surface_light *out)
{
    const float *const inward[3] = { l->packet.ray.dx, l->packet.ray.dy, l->packet.ray.dz };

    for (size_t i = 0; i < count; i++) {
        const bool valid_point = l->valid >> i & 1;
        for (int c = 0; c < 3; c++) {
            if (out->transmission[c])
                out->transmission[c][first + i] = valid_point && l->surface.any_thin ? l->s.transmission[c][i] : 0.0f;
            if (out->position[c])
                out->position[c][first + i] = l->s.position[c][i];
            if (out->normal[c])
                out->normal[c][first + i] = -inward[c][i];
        }
        if (out->strength)
            out->strength[first + i] = valid_point ? l->s.strength[i] : 1.0f;
        if (out->curvature || out->thinness) {
            const struct pell_hit16 *hit = &l->packet.hit;
            struct pell_curvature_shape shape = { 0.0f, 0.0f };
            if (l->params16.curvature && valid_point)
                shape = pell_curvature_at(l->params16.curvature, hit->mesh[i], hit->triangle[i], hit->u[i], hit->v[i]);
            if (out->curvature)
                out->curvature[first + i] = shape.mean;
            if (out->thinness)
                out->thinness[first + i] = shape.thinness;
        }
        if (out->valid)
            out->valid[first + i] = valid_point;
    }
    if (out->gain[0])
        write_gains(&l->params16, what, &l->packet.hit, l->valid, first, count, out);
}

/* Computes the light at no more than 16 points from `first` on; `slot`: see pell_irradiance_take_points. Returns the number of rays. */
static int64_t light16(const struct pell_lights *lights, const struct pell_irradiance_params *params, const struct pell_points_params *what,
                       const struct pell_surface_points *in, size_t first, size_t count, uint32_t slot,
                       const struct pell_surface_light *out)
{
    _Alignas(64) float mean[3][16] = { { 0 } }, shifted[3][16] = { { 0 } }, single_surplus[3][16] = { { 0 } }, albedo[3][16] = { { 0 } };
    const float part = 1.0f / (float) what->samples;
    struct pell_lighting lighting = { .shadow_rays = 0 };
    struct point_packet l;
    int64_t rays;

    load16(lights, params, what, in, first, count, &l);
    rays = l.rays;
    l.at.slot = slot;
    for (int c = 0; c < 3; c++) {
        lighting.irradiance[c] = l.s.irradiance[c];
        lighting.transmitted[c] = l.s.transmitted[c];
        lighting.specular[c] = l.s.mirrored[c];
        lighting.shifted[c] = l.s.shifted[c];
        lighting.single_surplus[c] = l.s.single_surplus[c];
        lighting.direction_in[c] = l.s.direction[c];
    }
    lighting.diffuse = l.s.diffuse;
    l.params16.directions = out->shifted[0] || out->single_surplus[0] || out->direction[0] || out->diffuse;
    for (int k = 0; l.valid && k < what->samples; k++) {
        l.params16.sample = what->first + (uint32_t) k;
        l.at.sample = (uint32_t) k;
        pell_irradiance_at(lights, &l.params16, &l.at, &lighting, albedo);
        rays += lighting.shadow_rays + lighting.device_rays;
        for (int c = 0; c < 3; c++)
            for (int i = 0; i < 16; i++)
                mean[c][i] += l.valid >> i & 1 ? (l.s.irradiance[c][i] + l.s.transmitted[c][i]) / (float) what->samples : 0.0f;
        for (int c = 0; c < 3 && l.params16.directions; c++)
            for (int i = 0; i < 16; i++) {
                shifted[c][i] += part * l.s.shifted[c][i];
                single_surplus[c][i] += part * l.s.single_surplus[c][i];
            }
    }
    for (size_t i = 0; i < count; i++)
        for (int c = 0; c < 3; c++) {
            if (out->shifted[c])
                out->shifted[c][first + i] = shifted[c][i];
            if (out->single_surplus[c])
                out->single_surplus[c][first + i] = single_surplus[c][i];
            if (out->direction[c]) /* from the last sample */
                out->direction[c][first + i] = l.s.direction[c][i];
            out->irradiance[c][first + i] = mean[c][i];
            if (out->albedo[c])
                out->albedo[c][first + i] = albedo[c][i];
        }
    if (out->diffuse)
        memcpy(out->diffuse + first, l.s.diffuse, count * sizeof(*out->diffuse));
    write_shape16(&l, what, first, count, out);
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
    struct point_packet l;

    load16(lights, params, what, in, 0, n, &l);
    return l.valid ? pell_irradiance_send(lights, &l.params16, &l.at, what->samples) : 0;
}

int64_t pell_irradiance_take_points(const struct pell_lights *lights, const struct pell_irradiance_params *params,
                                    const struct pell_points_params *what, const struct pell_surface_points *in, size_t n, uint32_t slot,
                                    const struct pell_surface_light *out)
{
    return light16(lights, params, what, in, 0, n, slot, out);
}
