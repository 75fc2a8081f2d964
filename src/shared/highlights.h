/* SPDX-License-Identifier: MIT
 * highlights.h - filter for the shadows of highlights, shared by neighbouring pixels (render/highlights/stage.h). */
#ifndef PELL_SHARED_HIGHLIGHTS_H
#define PELL_SHARED_HIGHLIGHTS_H

#include "shared/language.h"

#define PELL_HIGHLIGHTS_REACH 3     /* px to each side; the weight of a tap falls linearly to 0 one pixel beyond */
#define PELL_HIGHLIGHTS_SLOPE 24.0f /* largest slope of a surface that pixels share: depth difference in pixel widths, at that reach */
#define PELL_HIGHLIGHTS_TURN 12.0f  /* 1 over 1 - cosine between the normals from which pixels share nothing: 24 degrees */

#define PELL_HIGHLIGHTS_NOISE 0.5f /* of the variance: samples are stratified over pixels, so it is lower than that of independent ones */

/* Weight of a pixel whose normal has this cosine to the centre's, and whose depth differs by `far`; `reach` mm is the limit. */
PELL_SHARED float pell_highlights_weight(float cosine, float far, float reach)
{
    const float alike = 1.0f - PELL_HIGHLIGHTS_TURN * (1.0f - cosine), weight = far < reach ? alike : 0.0f;
    return weight > 0.0f ? weight : 0.0f;
}

/* Visible fraction of a light, from the nine pixels next to the centre (`next`) and from all around it: the latter, unless they differ
 * by more than the noise of `rays` per pixel, as at the edge of a sharp shadow. The nine have the noise of seven with equal weights. */
PELL_SHARED float pell_highlights_visibility(float next, float around, float rays)
{
    const float next_variance = next * (1.0f - next), around_variance = around * (1.0f - around),
                noise = (next_variance > around_variance ? next_variance : around_variance) / (7.0f * rays);
    const float difference2 = (next - around) * (next - around) - PELL_HIGHLIGHTS_NOISE * noise,
                excess = difference2 > 0.0f ? difference2 : 0.0f;
    return around + (next - around) * (excess / (excess + noise + 1e-12f));
}

/* Fraction of entering light whose shadows are filtered, on a surface that spreads it over this mean radius: all where that is less than a
 * quarter of a pixel, nothing where it is more than half of one. */
PELL_SHARED float pell_highlights_share(float radius_mm, float pixel_mm)
{
    return pell_saturate(2.0f - 4.0f * radius_mm / pixel_mm);
}

/* Filtered highlight or irradiance: the fraction `visibility` of the unoccluded light, which is `light` + `hidden`, if any of the `all`
 * samples around is occluded; `seen` of them are visible. */
PELL_SHARED float pell_highlights_filtered(float light, float hidden, float visibility, float seen, float all)
{
    return all > seen ? (light + hidden) * visibility : light;
}

#endif
