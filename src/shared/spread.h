/* SPDX-License-Identifier: MIT
 * spread.h - light that went straight through thin parts, shared out between Gaussians and blurred (render/spread/stage.h). */
#ifndef PELL_SHARED_SPREAD_H
#define PELL_SHARED_SPREAD_H

#include "shared/language.h"

/* How far light went straight, mm > 0, and what share of the transmitted light it is, as one number: its last 10 bits are the share, the
 * rest the way. 0: none went straight. */
PELL_SHARED float pell_spread_pack(float way, float share)
{
    const int32_t part = PELL_TO_INT(1023.0f * pell_saturate(share) + 0.5f);
    return way > 0.0f && part > 0 ? pell_bits_float((pell_float_bits(way) & ~1023) | part) : 0.0f;
}

/* The same of sums: `straight` of `all` transmitted light, and `way` that times the mm. */
PELL_SHARED float pell_spread_pack_sums(float way, float straight, float all)
{
    return all > 0.0f && straight > 0.0f ? pell_spread_pack(way / straight, straight / all) : 0.0f;
}

PELL_SHARED float pell_spread_straight(float packed)
{
    return PELL_TO_FLOAT(pell_float_bits(packed) & 1023) / 1023.0f;
}

/* The part of its way that light spreads by, of how flat the part of the solid is: all in a sheet. In round parts light spreads around all
 * of it, which a blur of one way's light has no room for; but where ways jump, at the edge of a shadow and where one more limb lies on the
 * way, transmitted light does not. */
PELL_SHARED float pell_spread_part(float flat_share)
{
    return 0.2f + 0.8f * flat_share;
}

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
