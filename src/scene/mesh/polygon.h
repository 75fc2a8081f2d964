/* SPDX-License-Identifier: MIT
 * polygon.h - polygons into triangles. */
#ifndef PELL_POLYGON_H
#define PELL_POLYGON_H

#include "base/base.h"

/* Buffers that grow with the largest polygon. Zero-initialise; release with pell_polygon_finish. */
struct pell_polygon {
    struct pell_context *ctx;
    float *point;       /* xyz of each corner: fill this */
    uint32_t *triangle; /* count - 2 triples of corner indices: the result */
    double *flat;
    uint32_t *next, *previous;
    size_t capacity;
    int64_t spent; /* tests so far, see polygon.c */
};

PELL_NODISCARD enum pell_result pell_polygon_reserve(struct pell_polygon *polygon, size_t corners);
/* Triangulates the polygon point[0..count), count >= 3, in its winding. A quad is split along its shorter diagonal, a non-convex polygon by
 * ear clipping. False: the rest was made a fan, since the polygon crosses itself or is too large; its shape may be wrong. */
bool pell_polygon_triangulate(struct pell_polygon *polygon, size_t count);
void pell_polygon_finish(struct pell_polygon *polygon);

#endif
