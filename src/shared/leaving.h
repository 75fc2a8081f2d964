/* SPDX-License-Identifier: MIT
 * leaving.h - directional factors of light that leaves a translucent medium (render/angle.h, render/indirect/stage.h). */
#ifndef PELL_SHARED_LEAVING_H
#define PELL_SHARED_LEAVING_H

#include "shared/language.h"

#define PELL_TILTED_MOST 0.7f

/* Fraction of irradiance for metering the exposure, from the factor of diffuse light and its fraction of the light: where a profile
 * without single scattering returns almost nothing, the factor is in the hundreds, and such irradiance does not correspond to light that
 * arrives. */
PELL_SHARED float pell_metered(float enter_mean, float diffuse)
{
    return enter_mean > 1.0f ? 1.0f / (1.0f + diffuse * (enter_mean - 1.0f)) : 1.0f;
}

/* 1 - m, m the refracted cosine of this cosine outside. */
PELL_SHARED float pell_angle_off(float inverse_eta2, float mu)
{
    const float square = 1.0f - (1.0f - mu * mu) * inverse_eta2;
    return 1.0f - sqrtf(square > 0.0f ? square : 0.0f);
}

/* Factor of light from the depth that leaves toward v: it was last scattered about a mean free path back along its refracted direction,
 * where the light is stronger or weaker than below the surface (`tilt` in indirect/stage.h). `aside`: v.tilt - (v.n)(n.tilt); `tilts`:
 * the part that depends on the medium alone. */
PELL_SHARED float pell_tilts(float inverse_eta2)
{
    return -sqrtf(inverse_eta2);
}

PELL_SHARED float pell_tilted_by(float tilts, float aside)
{
    const float more = tilts * aside;
    return 1.0f / (1.0f - (more < PELL_TILTED_MOST ? more : PELL_TILTED_MOST));
}

PELL_SHARED float pell_tilted(float inverse_eta2, float aside)
{
    return pell_tilted_by(pell_tilts(inverse_eta2), aside);
}

#endif
