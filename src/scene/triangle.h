/* SPDX-License-Identifier: MIT
 * triangle.h - a triangle of a mesh: its corners and its orientation. */
#ifndef PELL_TRIANGLE_H
#define PELL_TRIANGLE_H

#include "math/vec.h"

#include <pellucid/scene.h>

static inline void pell_triangle_corners(const struct pell_mesh *mesh, uint32_t triangle, struct pell_vec3 at[3])
{
    for (int k = 0; k < 3; k++)
        at[k] = vec3_load(mesh->position + 3 * (size_t) mesh->index[3 * (size_t) triangle + (size_t) k]);
}

/* Cross product of two edges: points to the side from which the corners run counter-clockwise; its length is twice the area. */
static inline struct pell_vec3 pell_triangle_cross(const struct pell_vec3 at[3])
{
    return vec3_cross(vec3_sub(at[1], at[0]), vec3_sub(at[2], at[0]));
}

#endif
