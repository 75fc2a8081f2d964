/* SPDX-License-Identifier: MIT
 *
 * materials.c - looks up built-in materials, and changes them: concentration, layers. */
#include "optics/material/materials.h"

#include <pellucid/layers.h>

#include <string.h>

size_t pell_material_count(void)
{
    return pell_materials_data_count;
}

const struct pell_material_entry *pell_material_at(size_t index)
{
    return index < pell_materials_data_count ? &pell_materials_data[index] : NULL;
}

const struct pell_material_entry *pell_material_find(const char *name)
{
    size_t low = 0, high = pell_materials_data_count;

    while (name && low < high) {
        const size_t middle = low + (high - low) / 2;
        const int order = strcmp(name, pell_materials_data[middle].name);
        if (order == 0)
            return &pell_materials_data[middle];
        if (order < 0)
            high = middle;
        else
            low = middle + 1;
    }
    return NULL;
}

enum pell_result pell_material_dilute(const struct pell_material_entry *entry, double concentration, struct pell_material_entry *out)
{
    if (!entry || !out)
        return PELL_ERR_INVALID;

    struct pell_medium m;
    double scale;

    if (entry->kind != PELL_MATERIAL_MEDIUM || !(concentration > 0.0 && concentration <= PELL_CONCENTRATION_MAX) ||
        !(entry->concentration > 0.0))
        return PELL_ERR_INVALID;
    m = entry->medium;
    scale = concentration / entry->concentration;
    for (int c = 0; c < 3; c++) {
        m.sigma_a[c] *= scale;
        m.sigma_s_reduced[c] *= scale;
    }
    if (!pell_medium_valid(&m, NULL))
        return PELL_ERR_INVALID;
    *out = *entry;
    out->medium = m;
    out->concentration = concentration;
    return PELL_OK;
}

/* --- Layers ------------------------------------------------------------------------------------------------------------------- */

void pell_material_stack(const struct pell_material_layers *layers, struct pell_stack *out)
{
    memset(out, 0, sizeof(*out));
    out->count = layers->count < PELL_MATERIAL_LAYERS_MAX ? layers->count : PELL_MATERIAL_LAYERS_MAX;
    for (int i = 0; i < out->count; i++) {
        const struct pell_material_layer *from = &layers->item[i];
        memcpy(out->layer[i].sigma_a, from->medium.sigma_a, sizeof(from->medium.sigma_a));
        memcpy(out->layer[i].sigma_s_reduced, from->medium.sigma_s_reduced, sizeof(from->medium.sigma_s_reduced));
        memcpy(out->layer[i].g, from->medium.g, sizeof(from->medium.g));
        out->layer[i].eta = from->medium.eta;
        out->layer[i].thickness = from->thickness_mm;
    }
}
