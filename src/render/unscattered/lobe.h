/* SPDX-License-Identifier: MIT
 *
 * lobe.h - angular spread of a path by rough boundaries. Private to the folder and its test.
 *
 * Directions around the path are points in the plane at distance 1 across it. Facets whose slopes have the density a^2/(pi (a^2 + m^2)^2)
 * (GGX) spread them by the same density with a width in place of a, to first order in the slope: a boundary turns the path by (n c - n'
 * c')/(n' c') times the slope in the plane of incidence and by (n c - n' c')/n' across it, of which the geometric mean is used, and it
 * widens the incoming lobe by n/n' sqrt(c/c'). n, n' are the indices before and behind it, c, c' the cosines with its normal. Through a
 * slab the lobe is thus that of two independent slopes; of more boundaries all but the last are combined.
 */
#ifndef RENDER_UNSCATTERED_LOBE_H
#define RENDER_UNSCATTERED_LOBE_H

#include "shared/gloss.h"
#include "shared/sampling.h"

#include <math.h>
#include <stdint.h>

#define UNSCATTERED_BUNDLE 16 /* directions per bundle */
#define UNSCATTERED_BUNDLES 64
#define UNSCATTERED_DISC 0.6f /* of a: radius of the disc from which facets are sampled */

struct unscattered_lobe {
    float earlier, last; /* widths: by the boundaries before the last, and by the last; */
    float pixel;         /* radius of a disc of uniform density: the pixel's footprint. All 0: a ray */
    float sampled;       /* width of the distribution from which the path's direction was sampled (facets.h); not part of the others */
};

static inline void unscattered_refract(struct unscattered_lobe *l, float alpha, float n, float n2, float c, float c2)
{
    const float root = sqrtf(c2 > 1e-4f ? c2 : 1e-4f), wider = n / n2 * sqrtf(c) / root;

    l->earlier = wider * sqrtf(l->earlier * l->earlier + l->last * l->last);
    l->sampled *= wider;
    l->last = alpha * fabsf(n * c - n2 * c2) / (n2 * root);
}

static inline void unscattered_reflect(struct unscattered_lobe *l, float alpha)
{
    l->earlier = sqrtf(l->earlier * l->earlier + l->last * l->last);
    l->last = 2.0f * alpha;
}

/* Removes the sampled part from the last width, after its facet was sampled. The lobe keeps the density c^2/(pi (c^2 + m^2)^2), of which
 * a disc of radius d contains d^2/(c^2 + d^2): with c^2 + d^2 = a^2 both together equal the whole density at its centre. */
static inline void unscattered_narrow(struct unscattered_lobe *l)
{
    const float disc = UNSCATTERED_DISC * l->last;

    l->sampled = sqrtf(l->sampled * l->sampled + disc * disc);
    l->last = sqrtf(l->last * l->last - disc * disc);
}

/* Two offsets for each direction of a bundle, of slopes with a = 1: [0], [1] and [2], [3]. `index` below UNSCATTERED_BUNDLES. */
static inline void unscattered_bundle_make(uint32_t index, float bundle[4][UNSCATTERED_BUNDLE])
{
    for (uint32_t j = 0; j < UNSCATTERED_BUNDLE; j++)
        for (uint32_t k = 0; k < 2; k++) {
            const uint32_t i = k == 0 ? j : (5 * j + 3) % UNSCATTERED_BUNDLE, pattern = pell_hash(2 * index + k + 1);
            const struct pell_point2 p =
                pell_disc_at(pell_unit_float(pell_sobol0(i) ^ pattern), pell_unit_float(pell_sobol1(i) ^ pell_hash(pattern)));
            const struct pell_half_vector h = pell_half_vector_at(1.0f, p.x, p.y);
            bundle[2 * k][j] = h.x / h.z;
            bundle[2 * k + 1][j] = h.y / h.z;
        }
}

/* Density of the lobe's directions at an offset, per sr. Far from the centre it is that of both tails, a^2 + b^2 over the fourth power
 * of the distance, and by a fit within 4 % more at r times both widths: there each of the few directions would have too much weight. */
static inline float unscattered_density(const struct unscattered_lobe *l, const float bundle[4][UNSCATTERED_BUNDLE], float x, float y)
{
    const float a = l->earlier > l->last ? l->earlier : l->last, b = l->earlier > l->last ? l->last : l->earlier, a2 = a * a,
                sum2 = a2 + b * b;
    const float m2 = x * x + y * y, r2 = m2 / ((a + b) * (a + b)), excess = r2 / ((1.0f + r2) * sqrtf(1.0f + r2));
    const float tail = (1.0f + 0.68f * sqrtf(b / a) * excess) * sum2 / ((sum2 + m2) * (sum2 + m2));
    const float beyond = fminf(fmaxf(sqrtf(r2) - 1.0f, 0.0f), 1.0f), far = 1.0f + m2; /* far: 1/cos^2 */
    float total = 0.0f;

    for (int j = 0; beyond < 1.0f && j < UNSCATTERED_BUNDLE; j++) {
        const float dx = x - b * bundle[0][j], dy = y - b * bundle[1][j], d = a2 + dx * dx + dy * dy;
        total += a2 / (d * d);
    }
    total *= 1.0f / UNSCATTERED_BUNDLE;
    return (total + beyond * (tail - total)) * (1.0f / PELL_PI_F) * far * sqrtf(far);
}

#endif
