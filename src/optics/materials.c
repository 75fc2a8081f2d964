/* SPDX-License-Identifier: MIT
 *
 * materials.c - looking up built-in materials. */
#include "optics/materials.h"

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
