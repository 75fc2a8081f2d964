/* SPDX-License-Identifier: MIT
 * leaving.h - directional factors of light that exits a translucent medium (render/angle.h, render/indirect/stage.h). */
#ifndef PELL_SHARED_LEAVING_H
#define PELL_SHARED_LEAVING_H

#include "shared/language.h"

#define PELL_GRADIENT_MAX 0.7f

/* Fraction of irradiance for metering the exposure, from the factor of diffuse light and its fraction of the light: where a profile
 * without single scattering returns almost nothing, the factor is in the hundreds, and such irradiance does not correspond to light that
 * arrives. */
PELL_SHARED float pell_meter_fraction(float enter_mean, float diffuse)
{
    return enter_mean > 1.0f ? 1.0f / (1.0f + diffuse * (enter_mean - 1.0f)) : 1.0f;
}

/* 1 - m, m the refracted cosine of this cosine outside. */
PELL_SHARED float pell_angle_off(float inverse_eta2, float mu)
{
    const float square = 1.0f - (1.0f - mu * mu) * inverse_eta2;
    return 1.0f - sqrtf(square > 0.0f ? square : 0.0f);
}

/* Factor of multiply scattered light that exits toward v, from the lateral gradient of the fluence: the light was last scattered about a
 * mean free path back along its refracted direction, where the fluence differs from that below the exit point. `tilt` (indirect/tilt.c) is
 * the logarithmic gradient times the mean free path; `lateral`: v.tilt - (v.n)(n.tilt); `scale`: the factor of the medium alone. */
PELL_SHARED float pell_gradient_scale(float inverse_eta2)
{
    return -sqrtf(inverse_eta2);
}

PELL_SHARED float pell_gradient_exit_by(float scale, float lateral)
{
    const float more = scale * lateral;
    return 1.0f / (1.0f - (more < PELL_GRADIENT_MAX ? more : PELL_GRADIENT_MAX));
}

PELL_SHARED float pell_gradient_exit(float inverse_eta2, float lateral)
{
    return pell_gradient_exit_by(pell_gradient_scale(inverse_eta2), lateral);
}

#endif
