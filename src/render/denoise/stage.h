/* SPDX-License-Identifier: MIT
 *
 * stage.h - stage "denoise": removes the Monte Carlo noise of a reference from the displayed image.
 *
 * Only the scattered light is filtered, because only it is noisy: highlights are unchanged, and do not hide the noise below them. In
 * partially covered pixels the light of the covered part is filtered.
 *
 * Joint non-local means (Rousselle, Manzi and Zwicker 2013, "Robust denoising using feature and color information"): a pixel becomes a
 * weighted mean of its neighbours. The weight is the smaller of two: the first falls with the distance between colour patches, in units of
 * the variance that the method reports for them; the second with the differences of normal, albedo and depth, which have no noise. The
 * weight w is symmetric, and the two pixels of a pair exchange the same fraction of their light:
 *
 *     p' = p + Sum of w(p, q) min(s(p), s(q)) (q/s(q) - p/s(p)) / max(W(p), W(q))
 *     W(p) = 1 + Sum of w(p, q) min(1, s(q)/s(p))
 *
 * where s is the covered fraction of a pixel, so that the total light of the image does not change. Opaque pixels, which have no noise, are
 * neither changed nor read. Before that, fireflies are spread: a pixel that exceeds its neighbours by far, with a standard error as large,
 * gives its excess to them. The filter trades variance for bias, so it is never used for measurements.
 */
#ifndef PELL_DENOISE_H
#define PELL_DENOISE_H

#include "render/composite/stage.h"

#define PELL_DENOISE_PLANES 4 /* scratch planes */

struct pell_denoise_params {
    ptrdiff_t stride;
    struct pell_rect rect;              /* rectangle of the composite: only its pixels are read and written */
    const struct pell_accumulator *sum; /* color is replaced; the other planes are read */
    bool traced;                        /* reflected light is noisy, too, and filtered */
    float *scratch[PELL_DENOISE_PLANES];
};

/* Whether the variance is known: not for a single sample. */
bool pell_denoise_has_variance(const struct pell_denoise_params *params);
/* Allocates nothing. The result does not depend on the number of threads, to the bit. */
void pell_denoise_render(struct pell_pool *pool, const struct pell_denoise_params *params);

#endif
