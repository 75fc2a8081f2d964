/* SPDX-License-Identifier: MIT
 *
 * wide_bvh.h - a scene's triangles in a BVH with four children per node, as plain words: the data for ray tracing in shaders
 * (wide_bvh.glsl), with the same triangles as rays.h. Built once on the cpu.
 *
 * A node is PELL_WIDE_NODE words: low x of its four boxes, high x, low y, high y, low z, high z (bits of floats), then four children and
 * four zeros. A child is a node's index; or, with PELL_WIDE_LEAF, triangles: the index of the first times 4, and their number less one; or
 * PELL_WIDE_NONE. Node 0 is the root. A triangle is PELL_WIDE_TRIANGLE words: three vertices (bits), each followed by one word: its mesh,
 * its index in the mesh, and flags: its bit of enum pell_ray_mask, and PELL_WIDE_SINGLE_SIDED.
 *
 * Units      mm.
 * Ownership  pell_wide_bvh_destroy sets the pointer to NULL and accepts NULL in it.
 * Threads    constant after construction.
 */
#ifndef PELL_WIDE_BVH_H
#define PELL_WIDE_BVH_H

#include "base/base.h"

#include <pellucid/scene.h>

enum {
    PELL_WIDE_NODE = 32,
    PELL_WIDE_TRIANGLE = 12,
    PELL_WIDE_LEAF_MOST = 4, /* triangles per leaf */
    PELL_WIDE_LEVELS = 20,   /* maximum depth: the capacity of a stack with 3 entries per level */
    PELL_WIDE_SINGLE_SIDED = 256
};
#define PELL_WIDE_LEAF 0x80000000u
#define PELL_WIDE_NONE 0xffffffffu

struct pell_wide_bvh {
    struct pell_context *ctx; /* borrowed */
    uint32_t *nodes, *triangles;
    size_t num_nodes, num_triangles;
    bool cut; /* some mesh has alpha cutouts; rays through this hierarchy hit all of its triangles */
};

/* PELL_ERR_UNSUPPORTED for more triangles than a child's word can index, PELL_ERR_CANCELLED, PELL_ERR_NOMEM; logged. */
PELL_NODISCARD enum pell_result pell_wide_bvh_create(struct pell_context *ctx, const struct pell_scene *scene, struct pell_wide_bvh **out);
void pell_wide_bvh_destroy(struct pell_wide_bvh **bvh);

#endif
