/* SPDX-License-Identifier: MIT
 *
 * single.h - single scattering below a plane surface of a half-space, per pixel.
 *
 * Chandrasekhar 1960, "Radiative Transfer", and Hanrahan and Krueger 1993, "Reflection from Layered Surfaces due to Subsurface Scattering":
 * for a collimated flux that enters, the radiance below the surface is
 *
 *     L = albedo p(c) / (m_in + m_out)      per W/m^2 that entered; the boundary transmits T/eta^2 of it
 *
 * m_in, m_out: cosines with the normal inside; c: cosine between the directions to the light and to the camera inside; p is the
 * Henyey-Greenstein phase function.
 */
#ifndef PELL_SHARED_SINGLE_H
#define PELL_SHARED_SINGLE_H

#include "shared/phase.h"

/* Refracted cosine inside of a direction with cosine mu outside. */
PELL_SHARED float pell_single_cosine(float inverse_eta2, float mu)
{
    const float square = 1.0f - (1.0f - mu * mu) * inverse_eta2;
    return sqrtf(square > 0.0f ? square : 0.0f);
}

/* Cosine c between two refracted directions, from their cosine outside and those with the normal on both sides. */
PELL_SHARED float pell_single_phase_cosine(float inverse_eta2, float outside, float mu_in, float mu_out, float m_in, float m_out)
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
