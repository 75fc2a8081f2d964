/* SPDX-License-Identifier: MIT
 * highlights.h - shadows of highlights, shared by the pixels around each (render/highlights/stage.h). */
#ifndef PELL_SHARED_HIGHLIGHTS_H
#define PELL_SHARED_HIGHLIGHTS_H

#include "shared/language.h"

#define PELL_HIGHLIGHTS_REACH 3     /* px to each side; a tap's weight falls linearly to 0 one pixel beyond */
#define PELL_HIGHLIGHTS_SLOPE 24.0f /* of a surface that pixels see together, at most: depths apart, widths of a pixel; at that reach */
#define PELL_HIGHLIGHTS_TURN                                                                                                               \
    12.0f /* one over one minus the cosine between normals from which on pixels have nothing in common: 24 degrees */

#define PELL_HIGHLIGHTS_NOISE 0.5f /* of squared noise: rays are spread more evenly over pixels than chance would */

/* How far a pixel has its shadow in common with one whose normal has this cosine to its own, and whose depth is so far away; `reach` mm is
 * the most. */
PELL_SHARED float pell_highlights_alike(float turn, float far, float reach)
{
    const float alike = 1.0f - PELL_HIGHLIGHTS_TURN * (1.0f - turn), near = far < reach ? alike : 0.0f;
    return near > 0.0f ? near : 0.0f;
}

/* Share of a light that is seen, from the nine pixels next to one (`next`) and from all around it: the latter, but where they differ by
 * more than the noise of `rays` a pixel, as at a sharp shadow's edge. The nine have the noise of seven with even weights. */
PELL_SHARED float pell_highlights_seen(float next, float around, float rays)
{
    const float here = next * (1.0f - next), far = around * (1.0f - around), noise = (here > far ? here : far) / (7.0f * rays);
    const float apart = (next - around) * (next - around) - PELL_HIGHLIGHTS_NOISE * noise, over = apart > 0.0f ? apart : 0.0f;
    return around + (next - around) * (over / (over + noise + 1e-12f));
}

/* What is mirrored, or enters: this share of what would if nothing were in the way; `all` of around, of which `seen` is seen. */
PELL_SHARED float pell_highlights_shared(float light, float hidden, float share, float seen, float all)
{
    return all > seen ? (light + hidden) * share : light;
}

#endif
