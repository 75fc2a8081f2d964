/* SPDX-License-Identifier: MIT
 *
 * edges.h - correction of a point's entries in equation.h for adjacent faces across a nearby edge, by the known area of such a face.
 */
#ifndef INDIRECT_EDGES_H
#define INDIRECT_EDGES_H

#include "render/indirect/equation.h"

enum { EDGE_MOST = 64 };
#define EDGE_REACH 3.5f /* in steps: distance of points */

/* An element of an adjacent face. */
struct edge_element {
    uint32_t element, entry; /* indices in the equation */
    float weight;            /* [0, 1], falls with distance */
    float double_layer0;
    float single_layer[3], from_sources[3]; /* see struct equation_block */
};

/* Elements near a point that face elsewhere. */
struct edges {
    uint32_t count;
    struct edge_element elements[EDGE_MOST];
};

/* Corrects the matrix entries of a point. Adds the correction of the sum of double_layer0[] to `double_layer0`, and that of each
 * channel's source term to `rhs`. */
void equation_correct_edges(struct equation *e, uint32_t row, struct edges *b, float *double_layer0, double rhs[3]);

#endif
