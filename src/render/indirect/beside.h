/* SPDX-License-Identifier: MIT
 *
 * beside.h - what comes to a place of equation.h from a face beside an edge that is near it, by the area of that face.
 */
#ifndef INDIRECT_BESIDE_H
#define INDIRECT_BESIDE_H

#include "render/indirect/equation.h"

enum { BESIDE_MOST = 64 };
#define BESIDE_REACH 3.5f /* distances of places */

/* A patch of such a face. */
struct beside_patch {
    uint32_t patch, entry; /* of the equation's */
    float weight;          /* [0, 1], less the farther it is */
    float even;
    float pull[3], below[3]; /* see struct equation_block */
};

/* Those near to a place. */
struct beside {
    uint32_t count;
    struct beside_patch patch[BESIDE_MOST];
};

/* Sets the entries of a place right. What is to be added to the sum of even[], and to that of the light's sources of each channel, goes to
 * `even` and `right`. */
void equation_beside(struct equation *e, uint32_t row, struct beside *b, float *even, double right[3]);

#endif
