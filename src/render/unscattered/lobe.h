/* SPDX-License-Identifier: MIT
 *
 * lobe.h - how rough boundaries spread what goes along a way. Private to the folder and its test.
 *
 * Directions about the way are places in the plane at distance 1 across it. Facets whose slopes have the density a^2/(pi (a^2 + m^2)^2)
 * (GGX) spread them by the same density with a width in place of a, to first order in the slope: a boundary turns the way by
 * (n c - n' c')/(n' c') times the slope in the plane of incidence and by (n c - n' c')/n' across it, of which the geometric mean is taken,
 * and makes what came to it wider by n/n' sqrt(c/c'). n, n' are the indices before and behind it, c, c' the cosines with its normal. So
 * through a slab the lobe is that of two slopes drawn apart; of more boundaries all but the last are taken together.
 */
#ifndef RENDER_UNSCATTERED_LOBE_H
#define RENDER_UNSCATTERED_LOBE_H

#include "shared/gloss.h"
#include "shared/sampling.h"

#include <math.h>
#include <stdint.h>

#define UNSCATTERED_BUNDLE 16 /* directions of a lobe */
#define UNSCATTERED_BUNDLES 64
#define UNSCATTERED_CORE 0.6f /* of a: radius of the disc that facets are drawn from */

struct unscattered_lobe {
    float wide, last; /* widths: by the boundaries before the last, and by that; */
    float pixel;      /* radius of a disc of even density: what a pixel sees. All 0: a ray */
    float drawn;      /* width of what the way is one direction of (facets.h), which the others are without */
};

static inline void unscattered_refract(struct unscattered_lobe *l, float alpha, float n, float n2, float c, float c2)
{
    const float root = sqrtf(c2 > 1e-4f ? c2 : 1e-4f), wider = n / n2 * sqrtf(c) / root;

    l->wide = wider * sqrtf(l->wide * l->wide + l->last * l->last);
    l->drawn *= wider;
    l->last = alpha * fabsf(n * c - n2 * c2) / (n2 * root);
}

static inline void unscattered_reflect(struct unscattered_lobe *l, float alpha)
{
    l->wide = sqrtf(l->wide * l->wide + l->last * l->last);
    l->last = 2.0f * alpha;
}

/* The last boundary's facet was drawn. What the lobe keeps has the density c^2/(pi (c^2 + m^2)^2), of which a disc of radius d holds
 * d^2/(c^2 + d^2): with c^2 + d^2 = a^2 both together have in the middle what the whole has. */
static inline void unscattered_drawn(struct unscattered_lobe *l)
{
    const float core = UNSCATTERED_CORE * l->last;

    l->drawn = sqrtf(l->drawn * l->drawn + core * core);
    l->last = sqrtf(l->last * l->last - core * core);
}

/* Two places for each direction of a bundle, of slopes with a = 1: [0], [1] and [2], [3]. `number` below UNSCATTERED_BUNDLES. */
static inline void unscattered_bundle_make(uint32_t number, float bundle[4][UNSCATTERED_BUNDLE])
{
    for (uint32_t j = 0; j < UNSCATTERED_BUNDLE; j++)
        for (uint32_t k = 0; k < 2; k++) {
            const uint32_t i = k == 0 ? j : (5 * j + 3) % UNSCATTERED_BUNDLE, pattern = pell_hash(2 * number + k + 1);
            const struct pell_place2 p =
                pell_disc_at(pell_unit_float(pell_sobol0(i) ^ pattern), pell_unit_float(pell_sobol1(i) ^ pell_hash(pattern)));
            const struct pell_half_vector h = pell_half_vector_at(1.0f, p.x, p.y);
            bundle[2 * k][j] = h.x / h.z;
            bundle[2 * k + 1][j] = h.y / h.z;
        }
}

/* Density of the lobe's directions at a place, per sr. Far from the middle it is that of both tails, a^2 + b^2 over the fourth power of the
 * distance, and by a fit within 4 % more at r times both widths: there one of the few directions would stand for many. */
static inline float unscattered_density(const struct unscattered_lobe *l, const float bundle[4][UNSCATTERED_BUNDLE], float x, float y)
{
    const float a = l->wide > l->last ? l->wide : l->last, b = l->wide > l->last ? l->last : l->wide, a2 = a * a, both = a2 + b * b;
    const float m2 = x * x + y * y, r2 = m2 / ((a + b) * (a + b)), more = r2 / ((1.0f + r2) * sqrtf(1.0f + r2));
    const float tail = (1.0f + 0.68f * sqrtf(b / a) * more) * both / ((both + m2) * (both + m2));
    const float beyond = fminf(fmaxf(sqrtf(r2) - 1.0f, 0.0f), 1.0f), far = 1.0f + m2; /* far: 1/cos^2 */
    float sum = 0.0f;

    for (int j = 0; beyond < 1.0f && j < UNSCATTERED_BUNDLE; j++) {
        const float dx = x - b * bundle[0][j], dy = y - b * bundle[1][j], d = a2 + dx * dx + dy * dy;
        sum += a2 / (d * d);
    }
    sum *= 1.0f / UNSCATTERED_BUNDLE;
    return (sum + beyond * (tail - sum)) * (1.0f / PELL_PI_F) * far * sqrtf(far);
}

#endif
