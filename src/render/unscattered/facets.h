/* SPDX-License-Identifier: MIT
 *
 * facets.h - sampling of the facets of a rough boundary. Private to the folder and its test.
 *
 * A lobe around one path (lobe.h) describes how lights appear, but the path itself exits at one point, and is either transmitted or
 * reflected there: the background would have the edges that a smooth boundary shows. So facets are sampled: one sets the direction of a
 * path into a solid, and one decides whether the path exits again. Adjacent pixels use stratified facets and share their results
 * (incoherent.c). Slopes are sampled uniformly from a disc in the middle of their density, and lobes represent the rest: if tails were
 * sampled, few pixels would get all the light.
 */
#ifndef RENDER_UNSCATTERED_FACETS_H
#define RENDER_UNSCATTERED_FACETS_H

#include "math/vec.h"
#include "render/unscattered/lobe.h"

#define UNSCATTERED_MIN_WIDTH 0.004f /* width of a boundary's lobe from which facets are sampled */

/* State of the random numbers of a path. */
struct unscattered_random {
    uint32_t x, y;  /* pixel */
    uint32_t seed;  /* the same for all pixels of a sample */
    uint32_t count; /* numbers used so far */
};

/* Samples the normal of a facet around n, both unit. It faces light along w wherever n does. */
static inline struct pell_vec3 unscattered_facet(struct unscattered_random *random, float alpha, struct pell_vec3 n, struct pell_vec3 w)
{
    const uint32_t seed = pell_hash(random->seed + random->count++), i = pell_pixel_curve(random->x & 31u, random->y & 31u, seed);
    const uint32_t block = pell_hash(random->x >> 5 ^ pell_hash(random->y >> 5 ^ pell_hash(seed)));
    const float slope = UNSCATTERED_DISC * alpha;
    const struct pell_point2 m = pell_disc_at(pell_unit_float(pell_sobol0(i) ^ block), pell_unit_float(pell_sobol1(i) ^ pell_hash(block)));
    struct pell_vec3 t, b, facet;

    vec3_basis(n, &t, &b);
    facet = vec3_normalize(vec3_mad(vec3_mad(n, slope * m.x, t), slope * m.y, b));
    return vec3_dot(facet, w) < -1e-4f ? facet : n;
}

#endif
