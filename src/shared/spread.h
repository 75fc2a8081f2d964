/* SPDX-License-Identifier: MIT
 * spread.h - light that went straight through thin parts, shared out between Gaussians and blurred (render/spread/stage.h). */
#ifndef PELL_SHARED_SPREAD_H
#define PELL_SHARED_SPREAD_H

#include "shared/language.h"

/* Share of light of a variance that the Gaussian of the variance `here` takes, between those of `below` and `above`; below < 0: it is the
 * narrowest; above <= here: the widest. */
PELL_SHARED float pell_spread_share(float variance, float below, float here, float above)
{
    if (variance <= here)
        return below >= 0.0f ? fmaxf((variance - below) / (here - below), 0.0f) : 1.0f;
    return above > here ? fmaxf((above - variance) / (above - here), 0.0f) : 1.0f;
}

/* Of a tap so many mm aside and ahead; `inverse`: 1 over the square of the reach. (1 - d^2/reach^2)^4 has a variance of reach^2/11 along a
 * line. */
PELL_SHARED float pell_spread_weight(float aside, float ahead, float inverse)
{
    const float left = 1.0f - (aside * aside + ahead * ahead) * inverse, inside = left > 0.0f ? left : 0.0f, w2 = inside * inside;
    return w2 * w2;
}

#endif
