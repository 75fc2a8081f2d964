/* SPDX-License-Identifier: MIT
 * same_media.c - materials that scatter alike below the surface. */
#include "scene/scene.h"

#include <string.h>

static bool same_text(const char *a, const char *b)
{
    return a && b ? strcmp(a, b) == 0 : a == b;
}

static bool same_medium(const struct pell_material *a, const struct pell_material *b)
{
    return a->model == b->model && a->strength == b->strength &&
           (a->color_from == PELL_COLOR_FROM_TEXTURE) == (b->color_from == PELL_COLOR_FROM_TEXTURE) && same_text(a->preset, b->preset) &&
           !a->profile == !b->profile && (!a->profile || memcmp(a->profile, b->profile, 3 * sizeof(*a->profile)) == 0) &&
           memcmp(&a->gaussians, &b->gaussians, sizeof(a->gaussians)) == 0 && memcmp(&a->medium, &b->medium, sizeof(a->medium)) == 0;
}

void pell_scene_same_media(const struct pell_scene *scene, uint32_t *same)
{
    const struct pell_material *m = scene->materials;

    for (uint32_t i = 0; i < scene->num_materials; i++) {
        uint32_t k = m[i].opaque || m[i].num_layers > 0 ? i : 0;
        while (k < i && (same[k] != k || m[k].opaque || m[k].num_layers > 0 || !same_medium(&m[k], &m[i])))
            k++;
        same[i] = k;
    }
}
