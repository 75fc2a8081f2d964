/* SPDX-License-Identifier: MIT
 * maps.c - textures at a hit point: values, the colour of an opaque surface, and the tint of a boundary (transport/surface_color.h). */
#include "methods/path_trace/path.h"

#include "scene/material_maps.h"

void pt_texel_at(const struct pt_scene *s, const struct pt_hit *hit, const struct pell_texture_map *map, float texel[4])
{
    pell_texel_at(map, &s->scene->meshes[hit->mesh], hit->triangle, hit->u, hit->v, texel);
}

static void base_color(const struct pt_scene *s, const struct pt_hit *hit, float rgb[3])
{
    pell_base_color_at(&s->scene->materials[hit->material], &s->scene->meshes[hit->mesh], hit->triangle, hit->u, hit->v, rgb);
}

struct pell_vec3 pt_scatter_opaque(const struct pt_scene *s, const struct pt_hit *hit, struct pell_vec3 w, struct pt_sampler *sampler,
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

void pt_set_tints(struct pt_scene *s)
{
    for (size_t i = 0; i < s->scene->num_materials; i++)
        pell_tint_make(&s->scene->materials[i], &s->tint[i]);
}

void pt_tint(const struct pt_scene *s, const struct pt_hit *hit, bool enters, float beta[3])
{
    const struct pell_tint *t = &s->tint[hit->material];
    float color[3];

    if (!t->enabled)
        return;
    base_color(s, hit, color);
    pell_tint_apply(t, color, enters, beta);
}
