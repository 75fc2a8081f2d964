/* SPDX-License-Identifier: MIT
 * highlights.h - shadows of highlights, shared by the pixels around each (render/highlights/stage.h). */
#ifndef PELL_SHARED_HIGHLIGHTS_H
#define PELL_SHARED_HIGHLIGHTS_H

#include "shared/language.h"

#define PELL_HIGHLIGHTS_REACH 3     /* px to each side; a tap's weight falls linearly to 0 one pixel beyond */
#define PELL_HIGHLIGHTS_SLOPE 24.0f /* of a surface that pixels see together, at most: depths apart, widths of a pixel; at that reach */
#define PELL_HIGHLIGHTS_TURN                                                                                                               \
    12.0f /* one over one minus the cosine between normals from which on pixels have nothing in common: 24 degrees */

/* How far a pixel has its shadow in common with one whose normal has this cosine to its own, and whose depth is so far away; `reach` mm is
 * the most. */
PELL_SHARED float pell_highlights_alike(float turn, float far, float reach)
{
    const float alike = 1.0f - PELL_HIGHLIGHTS_TURN * (1.0f - turn), near = far < reach ? alike : 0.0f;
    return near > 0.0f ? near : 0.0f;
}

/* What is mirrored: `seen` of `all` around the pixel, of what it would mirror if nothing were in the way. */
PELL_SHARED float pell_highlights_shared(float specular, float hidden, float seen, float all)
{
    const float part = (specular + hidden) * (seen / (all > 0.0f ? all : 1.0f));
    return all > seen ? part : specular;
}

#endif
