/* SPDX-License-Identifier: MIT
 * ignored.c - inputs of materials that a scene has and the method ignores: one table names them, one warning reports them. */
#include "render/renderer_state.h"

#include <stdio.h>
#include <string.h>

static bool has_strength_map(const struct pell_material *m)
{
    return m->strength_map.texture;
}

static bool has_color_map(const struct pell_material *m)
{
    return m->base_color_map.texture && m->color_from == PELL_COLOR_FROM_TEXTURE;
}

static bool has_normal_map(const struct pell_material *m)
{
    return m->normal_map.texture;
}

static const struct {
    unsigned input;
    const char *name;
    bool (*has)(const struct pell_material *m);
} rows[] = {
    { PELL_IGNORES_STRENGTH_MAP, "strength map", has_strength_map },
    { PELL_IGNORES_COLOR_MAP, "colour map", has_color_map },
    { PELL_IGNORES_NORMAL_MAP, "normal map", has_normal_map },
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
        char list[96] = "";
        for (size_t k = 0; r->materials.frame_index[i + 1] && k < PELL_COUNT(rows); k++)
            if ((r->method->ignores & rows[k].input) && rows[k].has(m))
                snprintf(list + strlen(list), sizeof(list) - strlen(list), "%s%s", list[0] ? ", " : "", rows[k].name);
        if (list[0] && is_used(r->scene, i))
            pell_warn(r->ctx, m->name, "compare methods on scenes without it", "%s ignores its %s", r->method->name, list);
    }
}
