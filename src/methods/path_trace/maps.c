/* SPDX-License-Identifier: MIT
 * maps.c - what textures say of a place on a surface: numbers, the colour of something opaque, and the tint of a boundary.
 *
 * Where colour comes from the base colour b, a medium has the reflectance b, as with the methods that blur: light that enters is multiplied
 * by b^m, and light that leaves by b^(1-m)/rho, m the material's mix, rho what the half-space of the medium reflects of diffuse light that
 * entered it. The medium says how far light spreads, the texture how much returns. */
#include "methods/path_trace/path.h"

#include "image/color.h"
#include "scene/material_maps.h"
#include "transport/equivalent_medium.h"

#include <pellucid/profile.h>
#include <string.h>

void pt_texel_at(const struct pt_scene *s, const struct pt_hit *hit, const struct pell_texture_map *map, float texel[4])
{
    const struct pell_mesh *m = &s->scene->meshes[hit->mesh];
    const uint32_t *i = m->index + 3 * (size_t) hit->triangle;
    const float k = 1.0f - hit->u - hit->v;

    texel[0] = texel[1] = texel[2] = texel[3] = 1.0f;
    if (map->texture && m->uv[map->uv]) {
        const float *uv = m->uv[map->uv], *a = uv + 2 * (size_t) i[0], *b = uv + 2 * (size_t) i[1], *c = uv + 2 * (size_t) i[2];
        const float tu = k * a[0] + hit->u * b[0] + hit->v * c[0], tv = k * a[1] + hit->u * b[1] + hit->v * c[1], *t = map->matrix;
        pell_image_sample(&map->texture->image, map->texture->wrap_u, map->texture->wrap_v, map->texture->nearest,
                          t[0] * tu + t[1] * tv + t[2], t[3] * tu + t[4] * tv + t[5], texel);
    }
}

static void base_color(const struct pt_scene *s, const struct pt_hit *hit, float rgb[3])
{
    const struct pell_mesh *m = &s->scene->meshes[hit->mesh];
    const struct pell_material *material = &s->scene->materials[hit->material];
    const uint32_t *i = m->index + 3 * (size_t) hit->triangle;
    const float k = 1.0f - hit->u - hit->v;
    float texel[4];

    pt_texel_at(s, hit, &material->base_color_map, texel);
    for (size_t c = 0; c < 3; c++) {
        float x = material->base_color[c] * (1.0f - material->metallic) * texel[c];
        if (m->color)
            x *= k * m->color[4 * (size_t) i[0] + c] + hit->u * m->color[4 * (size_t) i[1] + c] + hit->v * m->color[4 * (size_t) i[2] + c];
        rgb[c] = fminf(fmaxf(x, 0.0f), 1.0f);
    }
}

struct pell_vec3 pt_leave_opaque(const struct pt_scene *s, const struct pt_hit *hit, struct pell_vec3 w, struct pt_sampler *sampler,
                                 float weight[3])
{
    const struct pell_material *m = &s->scene->materials[hit->material];
    const struct pell_vec3 n = vec3_dot(w, hit->ng) > 0.0f ? vec3_mul(hit->ng, -1.0f) : hit->ng;
    float texel[4], color[4], through, sum[2] = { 0.0f, 0.0f }, pass[3];
    bool passes;

    base_color(s, hit, weight);
    if (!pell_material_is_thin(m))
        return n;
    pt_texel_at(s, hit, &m->diffuse_transmission_map, texel);
    pt_texel_at(s, hit, &m->diffuse_transmission_color_map, color);
    through = fminf(fmaxf(m->diffuse_transmission * texel[m->diffuse_transmission_map.channel & 3], 0.0f), 1.0f);
    for (int c = 0; c < 3; c++) {
        pass[c] = through * (1.0f - m->metallic) * fminf(fmaxf(m->diffuse_transmission_color[c] * color[c], 0.0f), 1.0f);
        weight[c] *= 1.0f - through;
        sum[0] += weight[c];
        sum[1] += pass[c];
    }
    if (!(sum[1] > 0.0f))
        return n;
    passes = pt_random(sampler) * (sum[0] + sum[1]) < sum[1];
    for (int c = 0; c < 3; c++)
        weight[c] = (passes ? pass[c] : weight[c]) * (sum[0] + sum[1]) / sum[passes];
    return passes ? vec3_mul(n, -1.0f) : n;
}

/* --- Tints ------------------------------------------------------------------------------------------------------------------------ */

/* What a material's half-space reflects of diffuse light that entered it. `medium`: what is traced of it. */
static double reflectance(const struct pell_material *m, const struct pell_medium *medium, int c)
{
    const double scattered = medium->sigma_s_reduced[c], eta = (double) m->medium.eta;
    struct pell_profile own;
    double total;

    if (medium == &m->medium && m->profile)
        total = pell_profile_total(&m->profile[c]);
    else if (medium == &m->medium && m->gaussians.count > 0 && pell_profile_from_gaussians(&m->gaussians, c, &own) == PELL_OK)
        total = pell_profile_total(&own);
    else
        total = pell_half_space_albedo(scattered / (scattered + medium->sigma_a[c]), eta);
    return total * pell_half_space_angle_of(total, eta).mean;
}

void pt_set_tints(struct pt_scene *s)
{
    for (size_t i = 0; i < s->scene->num_materials; i++) {
        const struct pell_material *m = &s->scene->materials[i];
        const struct pell_medium *medium = &m->medium;
        struct pt_tint *t = &s->tint[i];
        struct pell_medium equivalent;
        struct pell_medium_fault fault;
        if (m->opaque || m->color_from != PELL_COLOR_FROM_TEXTURE)
            continue;
        if (pell_has_profile_only(m)) {
            if (pell_equivalent_medium(m, &equivalent, &fault) != PELL_OK)
                continue; /* no solid is of it: it was refused */
            medium = &equivalent;
        }
        t->is = true;
        t->mix = m->mix;
        for (int c = 0; c < 3; c++) {
            const double rho = reflectance(m, medium, c);
            t->per_reflectance[c] = rho > 0.0 ? (float) (1.0 / rho) : 0.0f;
        }
    }
}

void pt_tint(const struct pt_scene *s, const struct pt_hit *hit, bool enters, float beta[3])
{
    const struct pt_tint *t = &s->tint[hit->material];
    float color[3];

    if (!t->is)
        return;
    base_color(s, hit, color);
    for (int c = 0; c < 3; c++)
        beta[c] *= enters ? pell_color_share(color[c], t->mix) : pell_color_share(color[c], 1.0f - t->mix) * t->per_reflectance[c];
}
