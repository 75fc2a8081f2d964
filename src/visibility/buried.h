/* SPDX-License-Identifier: MIT
 *
 * buried.h - parts of an object are often pushed into each other, and what is inside of another part is no surface: no light enters there,
 * and none leaves.
 */
#ifndef PELL_BURIED_H
#define PELL_BURIED_H

#include "visibility/rays.h"

/* A place of a surface, and how far from it rays start. */
struct pell_buried_place {
    struct pell_vec3 at, normal; /* mm; unit, outward */
    float clearance;             /* mm */
    int object;                  /* of struct pell_mesh */
};

/* Which of up to PELL_PACKET places are inside of their own objects: most rays that leave them come to an inner side. A ray along the
 * normal that does not meet the object tells of most that they are not. Thread-safe. */
void pell_buried16(const struct pell_scene *scene, const struct pell_rays *rays, const struct pell_buried_place *places, int count,
                   bool buried[PELL_PACKET]);

#endif
