/* SPDX-License-Identifier: MIT
 * leaving.h - by what light from a translucent medium leaves toward a direction (render/angle.h, render/indirect/stage.h). */
#ifndef PELL_SHARED_LEAVING_H
#define PELL_SHARED_LEAVING_H

#include "shared/language.h"

#define PELL_TILTED_MOST 0.7f

/* What of irradiance is metered, by the factor of diffuse light and its share of the light: where a profile without single scattering
 * returns next to nothing, the factor is hundreds, and that irradiance no light that arrives. */
PELL_SHARED float pell_metered(float enter_mean, float diffuse)
{
    return enter_mean > 1.0f ? 1.0f / (1.0f + diffuse * (enter_mean - 1.0f)) : 1.0f;
}

/* 1 - m, of a cosine outside. */
PELL_SHARED float pell_angle_off(float inverse_eta2, float mu)
{
    const float square = 1.0f - (1.0f - mu * mu) * inverse_eta2;
    return 1.0f - sqrtf(square > 0.0f ? square : 0.0f);
}

/* Factor of light from the depth that leaves toward v: it was scattered last about a mean free path back along its refracted direction,
 * where there is more of it, or less, than below the surface (`tilt` in indirect/stage.h). `aside`: v.tilt - (v.n)(n.tilt); `tilts`: what
 * depends on the medium alone. */
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
