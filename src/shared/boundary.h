/* SPDX-License-Identifier: MIT
 *
 * boundary.h - reflection and transmission of a dielectric boundary, per pixel.
 *
 * Fresnel's equations: Born and Wolf, "Principles of Optics", 1.5.2. Schlick 1994, "An Inexpensive BRDF Model for Physically-based
 * Rendering".
 *
 * Below a rough specular layer light enters and leaves by T(mu) = 1 - rho_s albedo(mu), rho_s the layer's weight and albedo the lobe's
 * directional albedo F0 scale(mu) + bias(mu).
 */
#ifndef PELL_SHARED_BOUNDARY_H
#define PELL_SHARED_BOUNDARY_H

#include "shared/language.h"

struct pell_refraction {
    float reflectance; /* of unpolarised light, [0, 1]; 1: total reflection */
    float cos_t;       /* of the refracted direction, >= 0; 0 at total reflection */
};

/* eta: index of the far side over that of the near side; cos_i is clamped to [0, 1]. */
PELL_SHARED PELL_STRUCT(pell_refraction) pell_refract(float eta, float cos_i)
{
    const float c = cos_i < 1.0f ? cos_i > 0.0f ? cos_i : 0.0f : 1.0f;
    const float square = 1.0f - (1.0f - c * c) / (eta * eta), t = sqrtf(square > 0.0f ? square : 0.0f);
    const float rs = (c - eta * t) / (c + eta * t), rp = (eta * c - t) / (eta * c + t);
    PELL_STRUCT(pell_refraction) r;

    r.reflectance = square > 0.0f ? 0.5f * (rs * rs + rp * rp) : 1.0f;
    r.cos_t = t;
    return r;
}

/* Schlick's F = F0 + (1 - F0) w: this is w = (1 - cos_h)^5, cos_h = h . v. */
PELL_SHARED float pell_schlick_weight(float cos_h)
{
    const float c = cos_h < 1.0f ? 1.0f - cos_h : 0.0f, c2 = c * c;
    return c2 * c2 * c;
}

PELL_SHARED float pell_schlick(float f0, float cos_h)
{
    return f0 + (1.0f - f0) * pell_schlick_weight(cos_h);
}

/* T of a direction, from the values of the albedo table. */
PELL_SHARED float pell_transmittance(float rho_s, float f0, float scale, float bias)
{
    return 1.0f - rho_s * pell_saturate(f0 * scale + bias);
}

/* Factor from radiant exitance to radiance: T / (pi n). n = 1 - rho_s mean is the mean of T over a diffuse hemisphere if the exit is
 * normalized (`normalized` = 1), and 1 as published (`normalized` = 0). A boundary that transmits nothing has the factor 0. */
PELL_SHARED float pell_exit_factor(float rho_s, float albedo, float mean, float normalized)
{
    const float a = albedo < 1.0f ? albedo : 1.0f, n = 1.0f - normalized * rho_s * (mean < 1.0f ? mean : 1.0f);
    return (1.0f - rho_s * a) / (PELL_PI_F * (n > 1e-6f ? n : 1e30f));
}

/* The same for a smooth boundary with Fresnel's transmittance F_t(mu), and n its mean or 1. */
PELL_SHARED float pell_smooth_exit_factor(float transmittance, float n)
{
    return transmittance / (PELL_PI_F * n);
}

#endif
