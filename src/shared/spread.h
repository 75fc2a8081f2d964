/* SPDX-License-Identifier: MIT
 * spread.h - straight transmission through thin parts, split between Gaussians and blurred (render/spread/stage.h). */
#ifndef PELL_SHARED_SPREAD_H
#define PELL_SHARED_SPREAD_H

#include "shared/language.h"

/* Packs the path length of straight transmission, mm > 0, and its fraction of all transmitted light into one float: the last 10 bits are
 * the fraction, the others the length. 0: no straight transmission. */
PELL_SHARED float pell_spread_pack(float path, float fraction)
{
    const int32_t part = PELL_TO_INT(1023.0f * pell_saturate(fraction) + 0.5f);
    return path > 0.0f && part > 0 ? pell_bits_float((pell_float_bits(path) & ~1023) | part) : 0.0f;
}

/* The same from sums: `straight` of `all` transmitted light, and `path`, the sum of straight light times its length. */
PELL_SHARED float pell_spread_pack_sums(float path, float straight, float all)
{
    return all > 0.0f && straight > 0.0f ? pell_spread_pack(path / straight, straight / all) : 0.0f;
}

PELL_SHARED float pell_spread_straight(float packed)
{
    return PELL_TO_FLOAT(pell_float_bits(packed) & 1023) / 1023.0f;
}

/* Fraction of the path length by which light spreads, by how flat the part of the solid is: all of it in a sheet. In round parts light
 * spreads around the whole part, which a blur by one path length does not describe; and where path lengths jump, at the edge of a shadow
 * or where another limb is on the path, transmitted light does not jump. */
PELL_SHARED float pell_spread_path_fraction(float flat_weight)
{
    return 0.2f + 0.8f * flat_weight;
}

/* Fraction of light of a variance that the Gaussian with the variance `here` takes, between those with `below` and `above`; below < 0:
 * it is the narrowest; above <= here: the widest. */
PELL_SHARED float pell_spread_gaussian_fraction(float variance, float below, float here, float above)
{
    if (variance <= here)
        return below >= 0.0f ? fmaxf((variance - below) / (here - below), 0.0f) : 1.0f;
    return above > here ? fmaxf((above - variance) / (above - here), 0.0f) : 1.0f;
}

/* Weight of a tap at this offset across and along the view, mm; `inverse`: 1 over the squared reach. (1 - d^2/reach^2)^4 has a variance
 * of reach^2/11 along a line. */
PELL_SHARED float pell_spread_weight(float aside, float ahead, float inverse)
{
    const float left = 1.0f - (aside * aside + ahead * ahead) * inverse, inside = left > 0.0f ? left : 0.0f, w2 = inside * inside;
    return w2 * w2;
}

#endif
