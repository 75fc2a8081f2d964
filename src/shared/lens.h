/* SPDX-License-Identifier: MIT
 *
 * lens.h - circles of confusion as discs, and how overlapping discs are composited (render/post/dof.h). Units: pixels.
 */
#ifndef PELL_SHARED_LENS_H
#define PELL_SHARED_LENS_H

#include "shared/language.h"

#define PELL_LENS_MOST 16  /* largest radius; also the side of a tile, so that discs reach the adjacent tiles and no farther */
#define PELL_LENS_STEPS 16 /* entries of the weight table per pixel */
#define PELL_LENS_TABLE (PELL_LENS_MOST * PELL_LENS_STEPS + 2)
#define PELL_LENS_SHARP 0.25f /* radius below which a disc is invisible */

/* Fraction of a pixel that a disc of radius r covers at distance d. */
PELL_SHARED float pell_disc_cover(float r, float d)
{
    const float w = r + 0.5f - d;
    return w < 0.0f ? 0.0f : w < 1.0f ? w : 1.0f;
}

/* Disc radius from the inverse of a depth: negative in front of the focus, increasing with depth. `scale` as in struct pell_dof_params. */
PELL_SHARED float pell_disc_radius(float scale, float inverse_focus, float inverse_depth)
{
    return scale * (inverse_focus - inverse_depth);
}

/* Discs whose radii differ by more are at different depths. */
PELL_SHARED float pell_disc_band(float radius)
{
    return 0.5f + 0.1f * radius;
}

/* Composites one channel of near, same-depth and far discs, from their weights and weighted sums: the far fills what the same depth
 * leaves, or the same depth does if there is no far disc. `inside` is the fraction of the pixel's disc inside the image: beyond the
 * border the content is taken to be alike. */
PELL_SHARED float pell_disc_composite(float near, float near_sum, float same, float same_sum, float far, float far_sum, float inside)
{
    const float n = near / inside, s = same / inside;
    const float front = near_sum / (n > 1.0f ? near : inside), left = n > 1.0f ? 0.0f : 1.0f - n;
    const float alone = s > 0.0f ? same_sum / (s > 0.0f ? same : 1.0f) : 0.0f;
    const float filled = same_sum / inside + (1.0f - s) * (far_sum / (far > 0.0f ? far : 1.0f));

    return front + left * (s >= 1.0f || !(far > 0.0f) ? alone : filled);
}

#endif
