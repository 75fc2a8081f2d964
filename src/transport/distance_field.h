/* SPDX-License-Identifier: MIT
 *
 * distance_field.h - lower bound of a point's distance to all surfaces: a grid over each solid's bounds, so that a path deep inside needs
 * no ray.
 */
#ifndef PELL_DISTANCE_H
#define PELL_DISTANCE_H

#include "transport/solids.h"

struct pell_distance;

/* Distance to all triangles of the scene, including opaque and nested objects, inside the bounds of each solid; alpha cutouts count as
 * surface. Uses at most `bytes` of memory in total, divided evenly over the solids, and temporarily twice as much for one solid. A solid
 * has at most six million cubes: for a bunny of 70,000 triangles, 8 MB, built in half a second on one core, the bound is 80 % of the
 * distance at four cubes from the surface and 93 % deep inside; closer than about one cube it is 0. */
PELL_NODISCARD enum pell_result pell_distance_create(struct pell_context *ctx, struct pell_pool *pool, const struct pell_scene *scene,
                                                     const struct pell_solids *solids, size_t bytes, struct pell_distance **out);
void pell_distance_destroy(struct pell_distance **distance);

/* A lower bound, mm, of the distance from x to the nearest triangle; 0 outside of the solid's bounds. Never more than the true distance,
 * whatever the rounding: tests verify it for every cell. */
float pell_distance_bound(const struct pell_distance *distance, int solid, struct pell_vec3 x);

/* A solid's grid, for SIMD kernels: the three steps of pell_distance_bound. */
struct pell_distance_grid {
    float low[3], high[3], side, inverse_side, unit;
    int size[3];
    uint16_t *steps; /* distance at the centre of each cube, in units, rounded down */
};

/* NULL: the solid has no grid. */
const struct pell_distance_grid *pell_distance_grid(const struct pell_distance *distance, int solid);

/* Bit-identical in all callers, which makes bounds safe. */
static inline float pell_distance_centre(const struct pell_distance_grid *g, int axis, int at)
{
    return g->low[axis] + ((float) at + 0.5f) * g->side;
}

static inline float pell_distance_off(const struct pell_distance_grid *g, int axis, float x, int *at)
{
    const int last = g->size[axis] - 1, i = (int) ((x - g->low[axis]) * g->inverse_side);

    *at = i < last ? i : last;
    return x - pell_distance_centre(g, axis, *at);
}

/* The cube that contains a point, and the squared distance from its centre. False, and the first cube: outside. */
static inline bool pell_distance_cube(const struct pell_distance_grid *g, float x, float y, float z, int32_t *cube, float *offset2)
{
    const bool inside = (x >= g->low[0]) & (x <= g->high[0]) & (y >= g->low[1]) & (y <= g->high[1]) & (z >= g->low[2]) & (z <= g->high[2]);
    int at[3];
    const float a = pell_distance_off(g, 0, inside ? x : g->low[0], &at[0]), b = pell_distance_off(g, 1, inside ? y : g->low[1], &at[1]);
    const float c = pell_distance_off(g, 2, inside ? z : g->low[2], &at[2]);

    *offset2 = a * a + b * b + c * c;
    *cube = (at[2] * g->size[1] + at[1]) * g->size[0] + at[0];
    return inside;
}

static inline float pell_distance_within(const struct pell_distance_grid *g, uint16_t steps, float offset2)
{
    const float known = (float) steps * g->unit, offset = sqrtf(offset2),
                bound = known - (offset + 5e-7f * (known + offset)); /* rounding errors */

    return bound > 0.0f ? bound : 0.0f;
}

#endif
