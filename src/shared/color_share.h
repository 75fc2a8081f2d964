/* SPDX-License-Identifier: MIT
 * color_share.h - the part of a texture's colour that is applied where light enters: base^m; the exponent 1 - m is left for where it
 * leaves. */
#ifndef PELL_SHARED_COLOR_SHARE_H
#define PELL_SHARED_COLOR_SHARE_H

#include "shared/language.h"

/* m in [0, 1]. */
PELL_SHARED float pell_color_share(float base, float m)
{
    if (m <= 0.0f)
        return 1.0f;
    if (m >= 1.0f)
        return base;
    if (m == 0.5f)
        return sqrtf(base > 0.0f ? base : 0.0f);
    return base > 0.0f ? powf(base, m) : 0.0f;
}

#endif
