/* SPDX-License-Identifier: MIT
 *
 * internal.h - what the files of this stage share. Private to the folder.
 */
#ifndef RENDER_CURVATURE_INTERNAL_H
#define RENDER_CURVATURE_INTERNAL_H

#include "render/curvature/stage.h"

#include "math/vec.h"

/* The part of an object that has one material. Its curvature is that of the whole object, averaged for this material. */
struct curvature_patch {
    uint32_t material;
    struct pell_vec3 low; /* corner of the object's box */
    float step;           /* mm: side of a cell of the grid */
};

/* Sums around a node of a patch's grid. */
struct curvature_node {
    uint64_t key;      /* of patch and place, + 1; 0: free */
    double area, turn; /* mm^2; Sum of length times dihedral angle, mm */
};

/* Nodes by their keys: open addressing. */
struct curvature_grid {
    struct pell_context *ctx;
    struct curvature_node *node;
    size_t room, count; /* room: a power of two */
};

/* Adds to the eight nodes around a point, by their nearness. */
PELL_NODISCARD enum pell_result curvature_grid_add(struct curvature_grid *grid, const struct curvature_patch *patch, size_t number,
                                                   struct pell_vec3 at, double area, double turn);
/* Mean curvature there, 1/mm. */
float curvature_grid_at(const struct curvature_grid *grid, const struct curvature_patch *patch, size_t number, struct pell_vec3 at);

/* Adds all of an object's triangles and edges. Widens the patch's step first, to the length of the edges that stand for a smooth
 * surface. */
struct pell_topology;
PELL_NODISCARD enum pell_result curvature_measure(struct curvature_grid *grid, struct curvature_patch *patch, size_t number,
                                                  const struct pell_scene *scene, const struct pell_topology *topology);

#endif
