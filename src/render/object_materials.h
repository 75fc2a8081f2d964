/* SPDX-License-Identifier: MIT
 *
 * object_materials.h - copies of materials that several objects share, for methods that know the material of a pixel but not its object.
 */
#ifndef PELL_OBJECT_MATERIALS_H
#define PELL_OBJECT_MATERIALS_H

#include "render/engine.h"

/* Appends to m->frame a copy of a material for each further object that has it, and fills in m->of_mesh and m->count_with_copies; needs
 * m->frame_index, m->frame and m->count. Makes no copies where no two objects share a material, or where frames can't hold more materials,
 * which is reported. */
PELL_NODISCARD enum pell_result pell_object_materials_make(struct pell_context *ctx, const struct pell_scene *scene,
                                                           struct pell_scene_materials *m);

#endif
