/* SPDX-License-Identifier: MIT
 *
 * lens.h - discs that pixels are blurred to, and how they lie over each other (render/post/dof.h). Units: pixels.
 */
#ifndef PELL_SHARED_LENS_H
#define PELL_SHARED_LENS_H

#include "shared/language.h"

#define PELL_LENS_MOST 16  /* radius at which discs are cut; the tiles' side, so that discs reach into the tiles beside, and no farther */
#define PELL_LENS_STEPS 16 /* of the table of weights, a pixel */
#define PELL_LENS_TABLE (PELL_LENS_MOST * PELL_LENS_STEPS + 2)
#define PELL_LENS_SHARP 0.25f /* radius of a disc that nobody sees */

/* Share of a pixel that a disc of radius r covers at distance d. */
PELL_SHARED float pell_disc_cover(float r, float d)
{
    const float w = r + 0.5f - d;
    return w < 0.0f ? 0.0f : w < 1.0f ? w : 1.0f;
}

/* Radius of the disc of a depth, of which the inverse is given: below 0 before the focus; it rises with the depth. `scale` as in struct
 * pell_dof_params. */
PELL_SHARED float pell_disc_radius(float scale, float inverse_focus, float inverse_depth)
{
    return scale * (inverse_focus - inverse_depth);
}

/* Discs whose radii differ by more are of different depths. */
PELL_SHARED float pell_disc_band(float radius)
{
    return 0.5f + 0.1f * radius;
}

/* A channel of what is near over what is of the same depth over what is far, from their weights and weighted sums: the far fills what the
 * same leaves, and where there is none the same does. `inside` is the share of the pixel's disc that lies in the picture: what is beyond
 * the edge is taken to be like what is not. */
PELL_SHARED float pell_disc_lay(float near, float near_sum, float same, float same_sum, float far, float far_sum, float inside)
{
    const float n = near / inside, s = same / inside;
    const float front = near_sum / (n > 1.0f ? near : inside), left = n > 1.0f ? 0.0f : 1.0f - n;
    const float alone = s > 0.0f ? same_sum / (s > 0.0f ? same : 1.0f) : 0.0f;
    const float filled = same_sum / inside + (1.0f - s) * (far_sum / (far > 0.0f ? far : 1.0f));

    return front + left * (s >= 1.0f || !(far > 0.0f) ? alone : filled);
}

#endif
