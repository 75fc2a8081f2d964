/* SPDX-License-Identifier: MIT
 *
 * bvh_kernel.h - the hierarchy over a solid's triangles in which connections are looked for (bvh.c), 16 children a node, and the
 * kernel that goes through it (bvh_kernel.c).
 */
#ifndef PELL_CONNECT_FIND_H
#define PELL_CONNECT_FIND_H

#include "base/simd.h"

#include <stdbool.h>
#include <stdint.h>

enum {
    PELL_CONNECT_CHILDREN = 16,
    PELL_CONNECT_STACK = 8 * PELL_CONNECT_CHILDREN, /* deep enough for 2^32 triangles */
};
#define PELL_CONNECT_LEAF 0x80000000u
#define PELL_CONNECT_NOTHING UINT32_MAX

/* Of each child a sphere about its triangles and a cone about their normals. */
struct pell_connect_node {
    _Alignas(64) float x[PELL_CONNECT_CHILDREN];
    float y[PELL_CONNECT_CHILDREN], z[PELL_CONNECT_CHILDREN], radius[PELL_CONNECT_CHILDREN];
    float ax[PELL_CONNECT_CHILDREN], ay[PELL_CONNECT_CHILDREN], az[PELL_CONNECT_CHILDREN];
    float cosine[PELL_CONNECT_CHILDREN], sine[PELL_CONNECT_CHILDREN]; /* cosine < 0: any normal */
    uint32_t child[PELL_CONNECT_CHILDREN];                            /* of a node, or LEAF + of a facet, or NOTHING */
};

/* What is looked for, and how far the search is. */
struct pell_connect_search {
    const struct pell_connect_node *nodes;
    float x[3], place[3]; /* or a direction */
    float eta, grazing, reach;
    bool away;   /* a direction */
    bool narrow; /* the half vector is more than rounding */
    int count;   /* on the stack; 1 at the start, with node 0 */
    uint32_t stack[PELL_CONNECT_STACK];
};

struct pell_connect_kernels {
    /* Facets in which light may refract toward the place: up to `room`, which is 16 or more, of them; 0: that was all. */
    int (*find)(struct pell_connect_search *s, uint32_t *facets, int room);
};

PELL_SIMD_TABLES(struct pell_connect_kernels, pell_connect_kernels);

#endif
