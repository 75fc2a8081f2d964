/* SPDX-License-Identifier: MIT
 *
 * specular_tables.h - the tables of src/optics/medium/specular.h for a scene's materials, shared between materials with the same lobe or
 * the same index of refraction.
 */
#ifndef PELL_SPECULAR_TABLES_H
#define PELL_SPECULAR_TABLES_H

#include "base/base.h"
#include "optics/medium/specular.h"

#include <pellucid/scene.h>

struct pell_specular_tables {
    struct pell_context *ctx;
    size_t num_materials, num_boundaries;
    bool made[PELL_SPECULAR_MODELS];
    uint8_t *model;     /* by material */
    uint32_t *boundary; /* by material: index into boundaries */
    struct pell_boundary_table *boundaries;
    float mean[PELL_SPECULAR_MODELS][PELL_ALBEDO_ROUGHNESS][2];
    float albedo[PELL_SPECULAR_MODELS][PELL_ALBEDO_MU][PELL_ALBEDO_ROUGHNESS][2]; /* scale, bias */
};

/* `lobe`: 0 for each material's own, else 1 + enum pell_specular_model for all. Integrates the needed tables: tens of milliseconds per
 * model. */
PELL_NODISCARD enum pell_result pell_specular_tables_create(struct pell_context *ctx, const struct pell_scene *scene, int lobe,
                                                            struct pell_specular_tables **out);
/* Changes the lobe for the same scene. */
void pell_specular_tables_choose(struct pell_specular_tables *tables, const struct pell_scene *scene, int lobe);
void pell_specular_tables_destroy(struct pell_specular_tables **tables);

#endif
