/* SPDX-License-Identifier: MIT
 *
 * maps.c - texture maps of a material by the names that scene files have for them.
 */
#include "scene/file/scene_file.h"

#include <string.h>

const char *const pell_texture_keys[PELL_TEXTURE_KEYS] = { "baseColor", "normal", "roughness", "metallic", "specular", "emissive" };

struct pell_texture_map *pell_scene_map_called(struct pell_material *m, const char *name)
{
    struct pell_texture_map *const maps[PELL_TEXTURE_KEYS] = { &m->base_color_map, &m->normal_map, &m->roughness_map,
                                                               &m->metallic_map,   &m->rho_s_map,  &m->emissive_map };

    for (size_t i = 0; i < PELL_TEXTURE_KEYS; i++)
        if (strcmp(name, pell_texture_keys[i]) == 0)
            return maps[i];
    return NULL;
}

int pell_scene_channel_called(const char *name)
{
    const char *const letters = "rgba", *at = name[0] && !name[1] ? strchr(letters, name[0]) : NULL;
    return at ? (int) (at - letters) : -1;
}

bool pell_scene_own_map(const struct pell_material *m, const char *text, struct pell_texture_map *map)
{
    const char *dot = strrchr(text, '.');
    char name[32];
    const struct pell_texture_map *own;

    if (!dot || pell_scene_channel_called(dot + 1) < 0 || (size_t) (dot - text) >= sizeof(name))
        return false;
    memcpy(name, text, (size_t) (dot - text));
    name[dot - text] = '\0';
    own = pell_scene_map_called((struct pell_material *) m, name);
    if (!own)
        return false;
    *map = *own;
    map->channel = pell_scene_channel_called(dot + 1);
    return true;
}
