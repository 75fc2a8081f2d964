/* SPDX-License-Identifier: MIT
 *
 * stage.h - stage "highlights": neighbouring pixels share their visibility of area lights.
 *
 * A few shadow rays sample which points of a light are hidden: in penumbras highlights are many times as noisy as all other light, and the
 * ground is grainy. The light without shadows is known accurately, and varies quickly; its hidden fraction varies slowly. The fraction is
 * averaged over all pixels around, weighted by their light without shadows (a ratio estimator: E. Heitz, S. Hill and M. McGuire, "Combining
 * Analytic Direct Illumination and Stochastic Shadows", I3D 2018), separately for highlights and for entering light, as far as the
 * surface does not spread that over more pixels (pell_highlights_share); only over the nearest pixels where these differ from the others by
 * more than noise, as at sharp edges of shadows.
 *
 * Threads: one call at a time per set of planes.
 */
#ifndef PELL_RENDER_HIGHLIGHTS_STAGE_H
#define PELL_RENDER_HIGHLIGHTS_STAGE_H

#include "base/pool.h"
#include "render/highlights/kernel.h"

#include <pellucid/frame.h>

struct pell_highlights_params {
    struct pell_rect rect; /* bounds of the covered pixels */
    ptrdiff_t stride;      /* of all planes */
    const uint16_t *material;
    const float *depth, *normal[3];            /* mm; shading normal */
    float *light[PELL_HIGHLIGHTS_SUMS];        /* specular and irradiance of struct pell_lighting: modified in place */
    const float *hidden[PELL_HIGHLIGHTS_SUMS]; /* hidden and lost */
    int rays;                                  /* per pixel and light: more rays mean less noise */
    float depth_mm, fixed_mm;                  /* a pixel at depth d is d depth_mm + fixed_mm wide */
    float *scratch[PELL_HIGHLIGHTS_SUMS];      /* initial content is ignored */
    uint8_t *has_hidden;                       /* scratch: pell_highlights_blocks(stride) entries per row of the image */
};

/* Number of blocks per row for which it is recorded whether they contain hidden light. */
static inline size_t pell_highlights_blocks(ptrdiff_t stride)
{
    return (size_t) stride / PELL_HIGHLIGHTS_BLOCK + 1;
}

/* Returns an upper bound of the number of changed pixels. */
int64_t pell_highlights_render(struct pell_pool *pool, const struct pell_highlights_params *params);

#endif
