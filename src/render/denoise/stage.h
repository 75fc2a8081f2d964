/* SPDX-License-Identifier: MIT
 *
 * stage.h - stage "denoise": filters the noise of a reference out of the image, for show.
 *
 * What is filtered is the scattered light, which has the noise: highlights stay as they are, and don't hide the noise below them. Of pixels
 * that the object covers in part, it is the light of that part.
 *
 * Joint non-local means (Rousselle, Manzi and Zwicker 2013, "Robust denoising using feature and color information"): a pixel becomes the
 * mean of the pixels around it. Their weight is the smaller of two: one falls with the distance of patches of colour, in units of the
 * variance that the method states for them; one with the differences of normal, albedo and depth, which have no noise. Both pixels of a
 * pair have the same weight w for one another, and the same share of their light changes place:
 *
 *     p' = p + Sum of w(p, q) min(s(p), s(q)) (q/s(q) - p/s(p)) / max(W(p), W(q))
 *     W(p) = 1 + Sum of w(p, q) min(1, s(q)/s(p))
 *
 * where s is the share of a pixel that is covered, so that the total light of the picture does not change. Opaque pixels, which have no
 * noise, are neither changed nor read. Before that, a pixel that exceeds those around it by far, and as uncertainly as that, gives them
 * what it has too much. Error is traded for bias: it is never for measurements.
 */
#ifndef PELL_DENOISE_H
#define PELL_DENOISE_H

#include "render/composite/stage.h"

#define PELL_DENOISE_PLANES 4 /* of scratch */

struct pell_denoise_params {
    ptrdiff_t stride;
    struct pell_rect rect;              /* of the composite: only read and written there */
    const struct pell_accumulator *sum; /* color is replaced; the other planes are read */
    bool traced;                        /* reflected light has noise as well */
    float *scratch[PELL_DENOISE_PLANES];
};

/* Whether the noise is known: not for a single sample. */
bool pell_denoise_knows(const struct pell_denoise_params *params);
/* Allocates nothing. The result does not depend on the number of threads, to the bit. */
void pell_denoise_render(struct pell_pool *pool, const struct pell_denoise_params *params);

#endif
