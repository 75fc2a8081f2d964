/* SPDX-License-Identifier: MIT
 *
 * buried.h - detects buried points: parts of an object often overlap, and surface inside another part is no boundary, so no light enters or
 * leaves there.
 */
#ifndef PELL_BURIED_H
#define PELL_BURIED_H

#include "visibility/rays.h"

/* A surface point to test, and the offset of its rays. */
struct pell_buried_query {
    struct pell_vec3 position, normal; /* mm; unit, outward */
    float clearance;                   /* mm */
    int object;                        /* pell_mesh_assembly */
};

/* The points, of up to PELL_PACKET, that are inside of their own objects: most of their rays hit an inner side. A ray along the normal that
 * misses the object shows for most points that they are not buried. Thread-safe. */
void pell_buried16(const struct pell_scene *scene, const struct pell_rays *rays, const struct pell_buried_query *points, int count,
                   bool buried[PELL_PACKET]);

#endif
