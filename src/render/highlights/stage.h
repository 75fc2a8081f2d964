/* SPDX-License-Identifier: MIT
 *
 * stage.h - stage "highlights": what neighbouring pixels see of lights with a face is shared between them.
 *
 * A highlight is a few directions of a light's face, and a few rays say which of them are hidden: in penumbras their noise is many times as
 * bright as all else. How bright a highlight would be without shadows is known well, and varies quickly; what share of it is hidden varies
 * slowly. The share is taken from all pixels around, weighed by their highlights without shadows (a ratio estimator: E. Heitz, S. Hill and
 * M. McGuire, "Combining Analytic Direct Illumination and Stochastic Shadows", I3D 2018).
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
    const float *depth, *normal[3]; /* mm; of the triangle */
    const float *hidden[3];         /* of struct pell_lighting */
    float *specular[3];             /* of struct pell_lighting: is changed */
    float depth_mm, fixed_mm;       /* a pixel at depth d is d depth_mm + fixed_mm wide */
    float *room[3];                 /* may hold anything */
    uint8_t *lit;                   /* room: pell_highlights_blocks(stride) a row of the picture */
};

static inline size_t pell_highlights_blocks(ptrdiff_t stride)
{
    return (size_t) stride / PELL_HIGHLIGHTS_BLOCK + 1;
}

/* How many pixels it changed, or might have. */
int64_t pell_highlights_render(struct pell_pool *pool, const struct pell_highlights_params *params);

#endif
