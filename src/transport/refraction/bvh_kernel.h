/* SPDX-License-Identifier: MIT
 *
 * bvh_kernel.h - the hierarchy over a solid's triangles that connections search (bvh.c), 16 children per node, and its traversal kernel
 * (bvh_kernel.c).
 */
#ifndef PELL_CONNECT_BVH_KERNEL_H
#define PELL_CONNECT_BVH_KERNEL_H

#include "base/simd.h"

#include <stdbool.h>
#include <stdint.h>

enum {
    PELL_CONNECT_CHILDREN = 16,
    PELL_CONNECT_STACK = 8 * PELL_CONNECT_CHILDREN, /* sufficient for 2^32 triangles */
};
#define PELL_CONNECT_LEAF 0x80000000u
#define PELL_CONNECT_NOTHING UINT32_MAX

/* Per child a bounding sphere of its triangles and a cone of their normals. */
struct pell_connect_node {
    _Alignas(64) float x[PELL_CONNECT_CHILDREN];
    float y[PELL_CONNECT_CHILDREN], z[PELL_CONNECT_CHILDREN], radius[PELL_CONNECT_CHILDREN];
    float ax[PELL_CONNECT_CHILDREN], ay[PELL_CONNECT_CHILDREN], az[PELL_CONNECT_CHILDREN];
    float cosine[PELL_CONNECT_CHILDREN], sine[PELL_CONNECT_CHILDREN]; /* cosine < 0: any normal */
    uint32_t child[PELL_CONNECT_CHILDREN];                            /* index of a node, LEAF + index of a facet, or NOTHING */
};

/* The query, and the state of its traversal. */
struct pell_connect_search {
    const struct pell_connect_node *nodes;
    float x[3], light[3]; /* or a direction */
    float eta, grazing, reach;
    bool distant; /* `light` is a direction */
    bool narrow;  /* the half vector exceeds rounding errors */
    int count;    /* stack size; initially 1, with node 0 */
    uint32_t stack[PELL_CONNECT_STACK];
};

struct pell_connect_kernels {
    /* Returns facets where light may refract toward the position: up to `room`, which is at least 16; 0: the traversal is complete. */
    int (*find)(struct pell_connect_search *s, uint32_t *facets, int room);
};

PELL_SIMD_TABLES(struct pell_connect_kernels, pell_connect_kernels);

#endif
