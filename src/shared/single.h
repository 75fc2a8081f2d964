/* SPDX-License-Identifier: MIT
 *
 * single.h - light that is scattered once below a plane surface, from a half-space, per pixel.
 *
 * Chandrasekhar 1960, "Radiative Transfer", and Hanrahan and Krueger 1993, "Reflection from Layered Surfaces due to Subsurface
 * Scattering": of a flux that enters along one direction the radiance below the surface is
 *
 *     L = albedo p(c) / (m_in + m_out)      per W/m^2 that entered; the boundary lets T/eta^2 of it out
 *
 * m_in, m_out: cosines with the normal inside; c: cosine between the directions to the light and to the camera inside, with which p is
 * Henyey and Greenstein's.
 */
#ifndef PELL_SHARED_SINGLE_H
#define PELL_SHARED_SINGLE_H

#include "shared/phase.h"

/* The cosine behind the boundary of a direction at cosine mu outside. */
PELL_SHARED float pell_single_cosine(float inverse_eta2, float mu)
{
    const float square = 1.0f - (1.0f - mu * mu) * inverse_eta2;
    return sqrtf(square > 0.0f ? square : 0.0f);
}

/* c of two refracted directions, from their cosine outside and those with the normal on both sides. */
PELL_SHARED float pell_single_turn(float inverse_eta2, float outside, float mu_in, float mu_out, float m_in, float m_out)
{
    const float c = m_in * m_out + (outside - mu_in * mu_out) * inverse_eta2;
    return c < 1.0f ? c > -1.0f ? c : -1.0f : 1.0f;
}

/* L per W/m^2. */
PELL_SHARED float pell_single_radiance(float albedo, float g, float c, float m_in, float m_out)
{
    const float base = PELL_PHASE_HG_BASE(g, -c), sum = m_in + m_out;
    return albedo * PELL_PHASE_HG_VALUE(g, base, sqrtf(base)) / (sum > 1e-6f ? sum : 1e-6f);
}

#endif
