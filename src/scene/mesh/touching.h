/* SPDX-License-Identifier: MIT
 *
 * touching.h - objects that touch.
 */
#ifndef PELL_TOUCHING_H
#define PELL_TOUCHING_H

#include "scene/scene.h"

/* Makes objects of one mesh file that touch and scatter alike (pell_scene_same_media) one assembly: sets pell_mesh.joined. Closed objects
 * of mesh files whose faces coincide with those of another medium are extended until they overlap. Materials must be complete. */
PELL_NODISCARD enum pell_result pell_join_touching(struct pell_scene *scene, bool quiet);

#endif
