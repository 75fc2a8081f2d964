/* SPDX-License-Identifier: MIT
 * surface_color.c - see surface_color.h. */
#include "transport/surface_color.h"

#include "image/color.h"
#include "scene/material_maps.h"
#include "shared/color_share.h"
#include "transport/equivalent_medium.h"

#include <pellucid/profile.h>

void pell_texel_at(const struct pell_texture_map *map, const struct pell_mesh *mesh, uint32_t triangle, float u, float v, float texel[4])
{
    const uint32_t *i = mesh->index + 3 * (size_t) triangle;
    const float k = 1.0f - u - v;

    texel[0] = texel[1] = texel[2] = texel[3] = 1.0f;
    if (map->texture && mesh->uv[map->uv]) {
        const float *uv = mesh->uv[map->uv], *a = uv + 2 * (size_t) i[0], *b = uv + 2 * (size_t) i[1], *c = uv + 2 * (size_t) i[2];
        const float tu = k * a[0] + u * b[0] + v * c[0], tv = k * a[1] + u * b[1] + v * c[1], *t = map->matrix;
        pell_image_sample(&map->texture->image, map->texture->wrap_u, map->texture->wrap_v, map->texture->nearest,
                          t[0] * tu + t[1] * tv + t[2], t[3] * tu + t[4] * tv + t[5], texel);
    }
}

void pell_base_color_at(const struct pell_material *m, const struct pell_mesh *mesh, uint32_t triangle, float u, float v, float rgb[3])
{
    const uint32_t *i = mesh->index + 3 * (size_t) triangle;
    const float k = 1.0f - u - v;
    float texel[4];

    pell_texel_at(&m->base_color_map, mesh, triangle, u, v, texel);
    for (size_t c = 0; c < 3; c++) {
        float x = m->base_color[c] * (1.0f - m->metallic) * texel[c];
        if (mesh->color)
            x *= k * mesh->color[4 * (size_t) i[0] + c] + u * mesh->color[4 * (size_t) i[1] + c] + v * mesh->color[4 * (size_t) i[2] + c];
        rgb[c] = fminf(fmaxf(x, 0.0f), 1.0f);
    }
}

/* Reflectance of a material's half-space for diffuse light that has entered it. `medium`: the traced medium. */
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

void pell_tint_make(const struct pell_material *m, struct pell_tint *out)
{
    const struct pell_medium *medium = &m->medium;
    struct pell_medium equivalent;
    struct pell_medium_fault fault;

    *out = (struct pell_tint) { .mix = m->mix };
    if (m->opaque || m->color_from != PELL_COLOR_FROM_TEXTURE)
        return;
    if (pell_has_profile_only(m)) {
        if (pell_equivalent_medium(m, &equivalent, &fault) != PELL_OK)
            return; /* no solid has it: it was rejected */
        medium = &equivalent;
    }
    out->enabled = true;
    for (int c = 0; c < 3; c++) {
        const double rho = reflectance(m, medium, c);
        out->per_reflectance[c] = rho > 0.0 ? (float) (1.0 / rho) : 0.0f;
    }
}

void pell_tint_apply(const struct pell_tint *t, const float color[3], bool enters, float light[3])
{
    for (int c = 0; c < 3 && t->enabled; c++)
        light[c] *= enters ? pell_color_share(color[c], t->mix) : pell_color_share(color[c], 1.0f - t->mix) * t->per_reflectance[c];
}
