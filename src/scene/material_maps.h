/* SPDX-License-Identifier: MIT
 * material_maps.h - the texture maps of a material, by index: code that processes all maps goes through this list. */
#ifndef PELL_MATERIAL_MAPS_H
#define PELL_MATERIAL_MAPS_H

#include <pellucid/scene.h>

#include <math.h>
#include <string.h>

#define PELL_DEFAULT_MATERIAL "default" /* of meshes without a material in the file */

enum pell_map {
    PELL_MAP_BASE,
    PELL_MAP_NORMAL,
    PELL_MAP_ROUGHNESS,
    PELL_MAP_METALLIC,
    PELL_MAP_RHO_S,
    PELL_MAP_SPECULAR,
    PELL_MAP_STRENGTH,
    PELL_MAP_EMISSIVE,
    PELL_MAP_TRANSMISSION,
    PELL_MAP_TRANSMISSION_COLOR,
    PELL_MAPS
};

static inline const struct pell_texture_map *pell_material_map(const struct pell_material *m, enum pell_map map)
{
    switch (map) {
    case PELL_MAP_BASE: return &m->base_color_map;
    case PELL_MAP_NORMAL: return &m->normal_map;
    case PELL_MAP_ROUGHNESS: return &m->roughness_map;
    case PELL_MAP_METALLIC: return &m->metallic_map;
    case PELL_MAP_RHO_S: return &m->rho_s_map;
    case PELL_MAP_SPECULAR: return &m->specular_color_map;
    case PELL_MAP_STRENGTH: return &m->strength_map;
    case PELL_MAP_TRANSMISSION: return &m->diffuse_transmission_map;
    case PELL_MAP_TRANSMISSION_COLOR: return &m->diffuse_transmission_color_map;
    default: return &m->emissive_map;
    }
}

/* The same, mutable. */
static inline struct pell_texture_map *pell_material_map_of(struct pell_material *m, enum pell_map map)
{
    return (struct pell_texture_map *) pell_material_map(m, map);
}

/* Name for messages: the default material that the loader made is called by its preset. */
static inline const char *pell_material_shown_name(const struct pell_material *m)
{
    return m->preset && m->preset[0] && strcmp(m->name, PELL_DEFAULT_MATERIAL) == 0 ? m->preset : m->name;
}

/* A thin sheet that transmits light: both of its sides are illuminated. */
static inline bool pell_material_is_thin(const struct pell_material *m)
{
    return m->opaque && m->diffuse_transmission > 0.0f;
}

static inline bool pell_scene_has_sheets(const struct pell_scene *scene)
{
    for (size_t i = 0; i < scene->num_materials; i++)
        if (pell_material_is_thin(&scene->materials[i]))
            return true;
    return false;
}

#endif
