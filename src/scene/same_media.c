/* SPDX-License-Identifier: MIT
 * same_media.c - materials that scatter alike below the surface. */
#include "scene/scene.h"

#include <string.h>

#define COMPARED 512 /* different media that others are compared with; those of further materials are equal to none of them */

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
    uint32_t different[COMPARED], num_different = 0;

    for (uint32_t i = 0; i < scene->num_materials; i++) {
        const bool alone = m[i].opaque || m[i].num_layers > 0;
        uint32_t k = 0;
        while (!alone && k < num_different && !same_medium(&m[different[k]], &m[i]))
            k++;
        same[i] = alone || k == num_different ? i : different[k];
        if (!alone && k == num_different && num_different < COMPARED)
            different[num_different++] = i;
    }
}
