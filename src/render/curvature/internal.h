/* SPDX-License-Identifier: MIT
 *
 * internal.h - declarations shared by the files of this stage. Private to the folder.
 */
#ifndef RENDER_CURVATURE_INTERNAL_H
#define RENDER_CURVATURE_INTERNAL_H

#include "render/curvature/stage.h"

#include "math/vec.h"

/* The part of an object that has one medium. Its curvature is that of the whole object, averaged for this medium. */
struct curvature_patch {
    uint32_t medium;      /* pell_scene_same_media */
    struct pell_vec3 low; /* corner of the object's box */
    float step;           /* mm: side of a cell of the grid */
    float max_thickness;  /* mm: largest thickness of thin parts */
};

/* Sums over pieces of the surface. */
struct curvature_sum {
    double area; /* mm^2 */
    double turn; /* over edges: length times dihedral angle, mm */
    double thin; /* area times thinness, mm */
};

/* Sums around a node of a patch's grid. */
struct curvature_node {
    uint64_t key; /* patch and position, + 1; 0: free */
    struct curvature_sum sum;
};

/* Hash table of nodes by key, with open addressing. */
struct curvature_grid {
    struct pell_context *ctx;
    struct curvature_node *node;
    size_t capacity, count; /* capacity: a power of two */
};

/* Adds to the eight nodes around a point, with trilinear weights. */
PELL_NODISCARD enum pell_result curvature_grid_add(struct curvature_grid *grid, const struct curvature_patch *patch, size_t patch_index,
                                                   struct pell_vec3 at, const struct curvature_sum *piece);
struct pell_curvature_shape curvature_grid_at(const struct curvature_grid *grid, const struct curvature_patch *patch, size_t patch_index,
                                              struct pell_vec3 at);

struct pell_topology;

/* An object whose shape is measured. */
struct curvature_object {
    struct pell_pool *pool;
    const struct pell_rays *rays; /* NULL: nothing is thin */
    const struct pell_scene *scene;
    const struct pell_topology *topology;
    const uint32_t *same; /* per material: pell_scene_same_media */
    int id;               /* pell_mesh_assembly */
};

/* Adds all triangles and edges of an object. First widens the patch's step to the length of the edges that represent a smooth surface. */
PELL_NODISCARD enum pell_result curvature_measure(struct curvature_grid *grid, struct curvature_patch *patch, size_t patch_index,
                                                  const struct curvature_object *object);

/* Writes the nodes in the format of pell_curvature_words. */
void curvature_grid_write(const struct curvature_grid *grid, uint32_t *out);

/* --- thin.c ----------------------------------------------------------------------------------------------------------------------- */

#define CURVATURE_OFFSET 2.4e-5f /* of the largest coordinate: offset of ray origins */

/* A piece of a triangle. */
struct curvature_piece {
    struct pell_vec3 at, normal; /* mm; unit, outward */
    double area;                 /* mm^2 */
    float thinness;              /* 1/mm */
};

/* Sets the pieces' thinness: n_A.(-n)/d, where the ray along -n leaves the object at A after d mm, at most patch->max_thickness, with
 * nothing in between, else 0. All pieces are of one object and material. */
void curvature_find_thin(const struct curvature_object *object, const struct curvature_patch *patch, struct curvature_piece *piece,
                         size_t count);

#endif
