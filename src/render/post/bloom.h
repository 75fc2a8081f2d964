/* SPDX-License-Identifier: MIT
 *
 * bloom.h - light that a lens, a camera or a film scatters: part of stage "post".
 *
 * A fraction b of the light of each pixel is spread over two Gaussians, half of it each, of standard deviations sigma and sigma / 4:
 *
 *     PSF = (1 - b) delta + b (G(sigma) + G(sigma / 4)) / 2
 *
 * so the halo falls about as 1 / r^2 in between, as glare does: as much light in each octave of radius. Two blurs, as the two passes of
 * d'Eon, Luebke and Enderton (2007). At the image's edges light is mirrored, so none is lost and a uniform image stays uniform.
 *
 * A wide Gaussian is made at a smaller size: each pixel's light is distributed linearly to the four nearest points of a grid f times as
 * wide, spread there by a Gaussian, and interpolated linearly back. The variances of the first and last step are taken off the
 * Gaussian's, so that the whole has the requested variance, and its centre does not move.
 */
#ifndef PELL_BLOOM_H
#define PELL_BLOOM_H

#include "base/pool.h"

#include <stddef.h>

#define PELL_BLOOM_PLANES 3 /* scratch planes, of the image's size each */

#define PELL_BLUR_RADIUS 18 /* taps to each side: four times the widest Gaussian at a smaller size */
#define PELL_BLUR_MOST 1024 /* of a factor: standard deviations up to 4096 px */

struct pell_bloom_params {
    int width, height;
    ptrdiff_t stride;
    float fraction; /* b, [0, 1] */
    float sigma;    /* px, >= 0 */
};

/* Parameters of one of the two Gaussians. */
struct pell_blur {
    int factor;        /* f, a power of two */
    int width, height; /* of the smaller size */
    int radius;
    float tap[PELL_BLUR_RADIUS + 1];
    int first, last;                       /* pixels whose light a point takes: f i + first to f i + last - 1, */
    float grid_weight[2 * PELL_BLUR_MOST]; /* and its weight on each side; 1 where f is 1 */
};

void pell_bloom_plan(const struct pell_bloom_params *params, struct pell_blur blurs[2]);

/* Spreads the light of each plane in place. `scratch` are PELL_BLOOM_PLANES planes. Allocates nothing; the same bits for any number of
 * threads. */
void pell_bloom_render(struct pell_pool *pool, const struct pell_bloom_params *params, float *const *planes, size_t count,
                       float *const scratch[PELL_BLOOM_PLANES]);

#endif
