/* SPDX-License-Identifier: MIT
 * polygon.h - polygons into triangles. */
#ifndef PELL_POLYGON_H
#define PELL_POLYGON_H

#include "base/base.h"

/* Room that grows with the largest polygon. Zeroed at first; emptied with pell_polygon_finish. */
struct pell_polygon {
    struct pell_context *ctx;
    float *point;       /* xyz of each corner: fill this */
    uint32_t *triangle; /* count - 2 triples of corner numbers: the result */
    double *flat;
    uint32_t *next, *previous;
    size_t capacity;
    int64_t spent; /* tests so far, see polygon.c */
};

PELL_NODISCARD enum pell_result pell_polygon_reserve(struct pell_polygon *polygon, size_t corners);
/* Triangles of the polygon point[0..count), count >= 3, in its winding. A quad is cut along its shorter diagonal, what is not convex by
 * clipping ears. False: what was left is a fan, since the polygon crosses itself or is too large for this; its shape may be wrong. */
bool pell_polygon_cut(struct pell_polygon *polygon, size_t count);
void pell_polygon_finish(struct pell_polygon *polygon);

#endif
