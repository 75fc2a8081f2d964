/* SPDX-License-Identifier: MIT
 *
 * materials.h - the table that scripts/gen_materials.py makes of data/materials; sorted by name (strcmp). */
#ifndef PELL_OPTICS_MATERIALS_H
#define PELL_OPTICS_MATERIALS_H

#include <pellucid/material.h>

extern const struct pell_material_entry pell_materials_data[];
extern const size_t pell_materials_data_count;

#endif
