/* SPDX-License-Identifier: MIT
 *
 * wide_bvh.h - a scene's triangles in a hierarchy of boxes, four to a node, as plain words: what shaders trace rays through
 * (wide_bvh.glsl), the same triangles that rays.h sees. Built once on the cpu.
 *
 * A node is PELL_WIDE_NODE words: low x of its four boxes, high x, low y, high y, low z, high z (bits of floats), then four children and
 * four zeros. A child is a node's number; or, with PELL_WIDE_LEAF, triangles: their first times 4, and their count less one; or
 * PELL_WIDE_NONE. Node 0 is the root. A triangle is PELL_WIDE_TRIANGLE words: three corners (bits), each with one word behind it: its mesh,
 * its number in the mesh, and flags: its bit of enum pell_ray_mask, and PELL_WIDE_SINGLE_SIDED.
 *
 * Units      mm.
 * Ownership  pell_wide_bvh_destroy sets the pointer to NULL and accepts NULL in it.
 * Threads    constant once it is built.
 */
#ifndef PELL_WIDE_BVH_H
#define PELL_WIDE_BVH_H

#include "base/base.h"

#include <pellucid/scene.h>

enum {
    PELL_WIDE_NODE = 32,
    PELL_WIDE_TRIANGLE = 12,
    PELL_WIDE_LEAF_MOST = 4, /* triangles of a leaf */
    PELL_WIDE_LEVELS = 20,   /* of nodes at most: what a stack of 3 entries a level holds */
    PELL_WIDE_SINGLE_SIDED = 256
};
#define PELL_WIDE_LEAF 0x80000000u
#define PELL_WIDE_NONE 0xffffffffu

struct pell_wide_bvh {
    struct pell_context *ctx; /* borrowed */
    uint32_t *nodes, *triangles;
    size_t num_nodes, num_triangles;
    bool cut; /* the alpha of some mesh says which parts of its triangles rays meet; here they meet all */
};

/* PELL_ERR_UNSUPPORTED for more triangles than a child's word can number, PELL_ERR_CANCELLED, PELL_ERR_NOMEM; logged. */
PELL_NODISCARD enum pell_result pell_wide_bvh_create(struct pell_context *ctx, const struct pell_scene *scene, struct pell_wide_bvh **out);
void pell_wide_bvh_destroy(struct pell_wide_bvh **bvh);

#endif
