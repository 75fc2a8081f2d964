/* SPDX-License-Identifier: MIT
 *
 * facets.h - which facet of a rough boundary a way meets. Private to the folder and its test.
 *
 * A lobe about one way (lobe.h) says how lights are seen, but the way itself comes out at one place, and is reflected there or is not: what
 * is behind would have the edges that a smooth boundary shows. So a way goes into a solid by one facet, and one says whether it comes out
 * again. Pixels beside each other share the facets out among them, and share what they see (stray.c). Slopes are drawn from a disc in the
 * middle of their density, evenly, and lobes keep the rest: of tails few pixels would have all the light.
 */
#ifndef RENDER_UNSCATTERED_FACETS_H
#define RENDER_UNSCATTERED_FACETS_H

#include "math/vec.h"
#include "render/unscattered/lobe.h"

#define UNSCATTERED_DRAWN 0.004f /* width of a boundary's lobe from which on facets are drawn */

/* The numbers that a way draws by. */
struct unscattered_draw {
    uint32_t x, y; /* its pixel */
    uint32_t seed; /* the same for all pixels of a sample */
    uint32_t met;  /* how many it has drawn */
};

/* Normal of a facet about n, both unit. It faces what comes along w where n does. */
static inline struct pell_vec3 unscattered_facet(struct unscattered_draw *d, float alpha, struct pell_vec3 n, struct pell_vec3 w)
{
    const uint32_t seed = pell_hash(d->seed + d->met++), i = pell_pixel_curve(d->x & 31u, d->y & 31u, seed);
    const uint32_t block = pell_hash(d->x >> 5 ^ pell_hash(d->y >> 5 ^ pell_hash(seed)));
    const float slope = UNSCATTERED_CORE * alpha;
    const struct pell_place2 m = pell_disc_at(pell_unit_float(pell_sobol0(i) ^ block), pell_unit_float(pell_sobol1(i) ^ pell_hash(block)));
    struct pell_vec3 t, b, facet;

    vec3_basis(n, &t, &b);
    facet = vec3_normalize(vec3_mad(vec3_mad(n, slope * m.x, t), slope * m.y, b));
    return vec3_dot(facet, w) < -1e-4f ? facet : n;
}

#endif
