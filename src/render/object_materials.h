/* SPDX-License-Identifier: MIT
 *
 * object_materials.h - which objects of a scene share a material, for methods that see materials of pixels and no objects.
 */
#ifndef PELL_OBJECT_MATERIALS_H
#define PELL_OBJECT_MATERIALS_H

#include "render/engine.h"

/* Appends to m->frame a copy of a material for each further object that has it, and fills in m->of_mesh and m->count_apart; m->frame_index,
 * m->frame and m->count are there. Where no two objects share a material, or where frames can't hold more materials, which is reported,
 * objects keep the material's own. */
PELL_NODISCARD enum pell_result pell_object_materials_make(struct pell_context *ctx, const struct pell_scene *scene,
                                                           struct pell_scene_materials *m);

#endif
