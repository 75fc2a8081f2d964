/* SPDX-License-Identifier: MIT
 * ignored.c - inputs of materials that a scene has and the method ignores: one table names them, one warning reports them. */
#include "render/renderer_state.h"

#include "transport/equivalent_medium.h"

#include <stdio.h>
#include <string.h>

static bool has_strength_map(const struct pell_material *m)
{
    return m->strength_map.texture;
}

static bool has_color(const struct pell_material *m)
{
    const float *c = m->base_color;

    if (!m->base_color_map.texture && pell_has_profile_only(m))
        return false; /* a method that needs a medium takes the one of this colour */
    return m->color_from == PELL_COLOR_FROM_TEXTURE && (m->base_color_map.texture || c[0] != 1.0f || c[1] != 1.0f || c[2] != 1.0f);
}

static bool has_normal_map(const struct pell_material *m)
{
    return m->normal_map.texture;
}

static bool has_roughness_map(const struct pell_material *m)
{
    return m->roughness_map.texture;
}

static bool has_specular_map(const struct pell_material *m)
{
    return m->rho_s_map.texture || m->specular_color_map.texture;
}

static bool has_depth_map(const struct pell_material *m)
{
    for (int i = 0; i < m->num_layers; i++)
        if (m->layers[i].depth_map.texture)
            return true;
    return false;
}

static const struct {
    unsigned input;
    const char *name;
    bool (*has)(
        const struct pell_material *m); /* whether the material sets it; NULL: every material does, so a warning would always appear */
} rows[] = {
    { PELL_IGNORES_STRENGTH_MAP, "strength map", has_strength_map },
    { PELL_IGNORES_COLOR, "colour", has_color },
    { PELL_IGNORES_MIX, "mix", NULL },
    { PELL_IGNORES_NORMAL_MAP, "normal map", has_normal_map },
    { PELL_IGNORES_ROUGHNESS, "roughness", has_roughness_map },
    { PELL_IGNORES_SPECULAR, "specular lobe", has_specular_map },
    { PELL_IGNORES_PROFILE_MODEL, "profile model", NULL },
    { PELL_IGNORES_DEPTH_MAPS, "layers' depth maps", has_depth_map },
};

const char *pell_ignored_name(unsigned input)
{
    for (size_t i = 0; i < PELL_COUNT(rows); i++)
        if (rows[i].input == input)
            return rows[i].name;
    return NULL;
}

static bool is_used(const struct pell_scene *scene, size_t material)
{
    for (size_t i = 0; i < scene->num_meshes; i++)
        if (scene->meshes[i].material == (int) material)
            return true;
    return false;
}

void pell_renderer_warn_ignored(const struct pell_renderer *r)
{
    for (size_t i = 0; i < r->scene->num_materials; i++) {
        const struct pell_material *m = &r->scene->materials[i];
        char list[160] = "";
        for (size_t k = 0; r->materials.frame_index[i + 1] && k < PELL_COUNT(rows); k++)
            if ((r->method->ignores & rows[k].input) && rows[k].has && rows[k].has(m))
                snprintf(list + strlen(list), sizeof(list) - strlen(list), "%s%s", list[0] ? ", " : "", rows[k].name);
        if (list[0] && is_used(r->scene, i))
            pell_warn(r->ctx, pell_material_shown_name(m), "compare methods on scenes without it", "%s ignores its %s", r->method->name,
                      list);
    }
}
