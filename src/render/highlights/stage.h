/* SPDX-License-Identifier: MIT
 *
 * stage.h - stage "highlights": what neighbouring pixels see of lights with a face is shared between them.
 *
 * A few rays say which points of a light's face are hidden: in penumbras highlights have noise many times as bright as all else, and the
 * ground has grain. How much light there would be without shadows is known well, and varies quickly; what share of it is hidden varies
 * slowly. The share is taken from all pixels around, weighed by their light without shadows (a ratio estimator: E. Heitz, S. Hill and
 * M. McGuire, "Combining Analytic Direct Illumination and Stochastic Shadows", I3D 2018), of highlights and of light on
 * opaque surfaces apart; from the nearest alone where those differ from the others by more than noise, as at sharp edges of shadows.
 *
 * Threads    one call at a time per set of planes.
 */
#ifndef PELL_RENDER_HIGHLIGHTS_STAGE_H
#define PELL_RENDER_HIGHLIGHTS_STAGE_H

#include "base/pool.h"
#include "render/highlights/kernel.h"

#include <pellucid/frame.h>

struct pell_highlights_params {
    struct pell_rect rect; /* of the pixels that show something */
    ptrdiff_t stride;      /* of all planes */
    const uint16_t *material;
    const float *depth, *normal[3];            /* mm; of the triangle */
    float *light[PELL_HIGHLIGHTS_SUMS];        /* specular and irradiance of struct pell_lighting: are changed */
    const float *hidden[PELL_HIGHLIGHTS_SUMS]; /* hidden and lost */
    int rays;                                  /* of a pixel, for each light: more of them have less noise */
    float depth_mm, fixed_mm;                  /* a pixel at depth d is d depth_mm + fixed_mm wide */
    float *room[PELL_HIGHLIGHTS_SUMS];         /* may hold anything */
    uint8_t *lit;                              /* room: pell_highlights_blocks(stride) a row of the picture */
};

static inline size_t pell_highlights_blocks(ptrdiff_t stride)
{
    return (size_t) stride / PELL_HIGHLIGHTS_BLOCK + 1;
}

/* How many pixels it changed, or might have. */
int64_t pell_highlights_render(struct pell_pool *pool, const struct pell_highlights_params *params);

#endif
