/* SPDX-License-Identifier: MIT
 *
 * maps.c - texture maps of a material by their names in scene files.
 */
#include "scene/file/scene_file.h"

#include <string.h>

const char *const pell_texture_keys[PELL_TEXTURE_KEYS] = {
    "baseColor", "normal", "roughness", "metallic", "specular", "emissive", "diffuseTransmission", "diffuseTransmissionColor",
};

struct pell_texture_map *pell_scene_map_called(struct pell_material *m, const char *name)
{
    static const enum pell_map maps[PELL_TEXTURE_KEYS] = {
        PELL_MAP_BASE,  PELL_MAP_NORMAL,   PELL_MAP_ROUGHNESS,    PELL_MAP_METALLIC,
        PELL_MAP_RHO_S, PELL_MAP_EMISSIVE, PELL_MAP_TRANSMISSION, PELL_MAP_TRANSMISSION_COLOR,
    };

    for (size_t i = 0; i < PELL_TEXTURE_KEYS; i++)
        if (strcmp(name, pell_texture_keys[i]) == 0)
            return pell_material_map_of(m, maps[i]);
    return NULL;
}

int pell_scene_channel_called(const char *name)
{
    const char *const letters = "rgba", *at = name[0] && !name[1] ? strchr(letters, name[0]) : NULL;
    return at ? (int) (at - letters) : -1;
}

enum pell_result pell_scene_channel_of(const struct pell_json *at, const char *text, size_t *length, int *channel)
{
    const char *hash = strrchr(text, '#');
    char shown[160], letter[32];

    *length = strlen(text);
    *channel = 0;
    if (!hash || strchr(hash, '.')) /* the '#' belongs to the file's name */
        return PELL_OK;
    *channel = pell_scene_channel_called(hash + 1);
    if (*channel < 0)
        return pell_json_error(at, PELL_ERR_FORMAT, "as in \"maps.png#g\"", "is \"%s\": there is no channel \"%s\", allowed: r, g, b, a",
                               pell_printable(text, shown, sizeof(shown)), pell_printable(hash + 1, letter, sizeof(letter)));
    *length = (size_t) (hash - text);
    return PELL_OK;
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
