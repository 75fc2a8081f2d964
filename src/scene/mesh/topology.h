/* SPDX-License-Identifier: MIT
 *
 * topology.h - the surface of one object as a whole: equal positions welded, edges with their triangles, connected parts.
 *
 * Everything is linear in the size of the object (radix and counting sorts, union-find), so that no input makes it slow, and
 * depends on the order of the file alone.
 */
#ifndef PELL_TOPOLOGY_H
#define PELL_TOPOLOGY_H

#include "scene/scene.h"

struct pell_topology {
    struct pell_context *ctx;
    size_t num_meshes;
    const uint32_t *mesh;   /* the object's meshes, as indices into the scene; borrowed */
    uint32_t *first_vertex; /* first vertex of each mesh, num_meshes + 1: vertices and triangles are numbered through the object */
    uint32_t *first_triangle;
    uint32_t num_vertices, num_triangles, num_positions;
    uint32_t *weld;   /* per vertex: index of its position, in order of first appearance */
    uint32_t *corner; /* per half-edge 3 t + k: the position where it starts; it ends at the next corner's */
    float *face;      /* per triangle: the cross product of two edges (normal times twice the area) over `scale`^2; 0 if degenerate */
    double scale;     /* largest extent of the object */
    uint32_t *half;   /* half-edges of the non-degenerate triangles, sorted so that those of an edge are adjacent */
    uint32_t num_halves;
    uint32_t num_degenerate;
    uint32_t *part; /* per triangle: id of the connected part; UINT32_MAX if degenerate */
    uint32_t num_parts;
};

PELL_NODISCARD enum pell_result pell_topology_make(struct pell_topology *topology, const struct pell_scene *scene, const uint32_t *meshes,
                                                   size_t num_meshes);
void pell_topology_finish(struct pell_topology *topology);

static inline uint32_t pell_half_next(uint32_t half)
{
    return half % 3 == 2 ? half - 2 : half + 1;
}

static inline uint32_t pell_half_start(const struct pell_topology *t, uint32_t half)
{
    return t->corner[half];
}

static inline uint32_t pell_half_end(const struct pell_topology *t, uint32_t half)
{
    return t->corner[pell_half_next(half)];
}

/* One past the last half-edge of the edge whose first is half[first]. */
uint32_t pell_topology_edge(const struct pell_topology *topology, uint32_t first);

/* Edges of one triangle, of more than two, and of two that face opposite ways; those that are not traversed equally often in both
 * directions, 0 of a closed surface. Incomplete if the work was cancelled. */
struct pell_edge_counts {
    int64_t boundary, nonmanifold, flipped, unbalanced;
};
struct pell_edge_counts pell_topology_count_edges(const struct pell_topology *topology);

/* Per connected part. */
struct pell_part {
    bool closed;   /* every edge is traversed equally often in both directions */
    double volume; /* enclosed, signed: positive where normals point outward; in the meshes' units */
    double min[3], max[3];
};
/* `parts` has num_parts elements; incomplete if the work was cancelled. */
void pell_topology_parts(const struct pell_topology *topology, const struct pell_scene *scene, struct pell_part *parts);

/* Flips triangles whose orientation disagrees with their neighbours, and closed surfaces that face inward (winding.c), and makes the
 * topology anew if any were flipped: of `meshes`, those that it was made of. `where`: for messages. */
PELL_NODISCARD enum pell_result pell_orient(struct pell_scene *scene, struct pell_topology *topology, const uint32_t *meshes, size_t count,
                                            const char *where);

/* Removes duplicate triangles of the same mesh, with equal winding, texture coordinates and colours (repeated.c). If *dropped is not 0, the
 * topology is no longer valid. */
PELL_NODISCARD enum pell_result pell_drop_repeated(struct pell_scene *scene, const struct pell_topology *topology, uint32_t *dropped);

/* Gives the object's meshes with pell_mesh.thicken > 0 that thickness (thicken.c); the topology is no longer valid. */
PELL_NODISCARD enum pell_result pell_thicken(struct pell_scene *scene, const struct pell_topology *topology);

/* Fills `order` with 0..count-1 sorted by keys of `words` words each (most significant first), stable. Returns the array that holds the
 * result: `order` or `scratch`, which has the same size; unsorted where the work was cancelled. */
uint32_t *pell_sort_keys(struct pell_context *ctx, const uint32_t *keys, size_t words, uint32_t *order, uint32_t *scratch, uint32_t count);

/* Indices of `count` items in the order of their codes, ties in their own order; the caller frees them. `items` is passed to `code_at`. */
PELL_NODISCARD enum pell_result pell_order_by_code(struct pell_context *ctx, size_t count,
                                                   uint64_t (*code_at)(const void *items, size_t index), const void *items,
                                                   uint32_t **order);

/* The scene's meshes sorted by (object, index), and by (assembly, index): an object or an assembly is a run. `order` and `scratch`
 * have num_meshes elements. */
void pell_scene_objects(const struct pell_scene *scene, uint32_t *order, uint32_t *scratch);
void pell_scene_assemblies(const struct pell_scene *scene, uint32_t *order, uint32_t *scratch);
/* One past the last mesh, in that order, of the assembly whose first is order[first]. */
size_t pell_assembly_end(const struct pell_scene *scene, const uint32_t *order, size_t first);

/* Union-find over ids that are their own parents at first. The lower id becomes the root: sets are numbered in the file's order. */
uint32_t pell_union_root(uint32_t *parent, uint32_t i);
void pell_union_join(uint32_t *parent, uint32_t a, uint32_t b);

#endif
