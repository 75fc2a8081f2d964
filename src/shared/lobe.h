/* SPDX-License-Identifier: MIT
 *
 * lobe.h - the specular lobes of pellucid/specular.h as formulas without branches or library calls.
 *
 * GGX: Walter et al. 2007, "Microfacet Models for Refraction through Rough Surfaces", with Smith's height-correlated masking (Heitz 2014,
 * "Understanding the Masking-Shadowing Function"). Kelemen and Szirmay-Kalos 2001, "A Microfacet Based Coupled Specular-Matte BRDF Model".
 * Phong and Blinn-Phong with the exponents that make them as wide as GGX of the same roughness.
 */
#ifndef PELL_SHARED_LOBE_H
#define PELL_SHARED_LOBE_H

#include "shared/language.h"

/* The models, with the values of enum pell_specular_model. */
#define PELL_LOBE_GGX 0
#define PELL_LOBE_KELEMEN 1
#define PELL_LOBE_PHONG 2
#define PELL_LOBE_BLINN_PHONG 3

/* The width parameter of a lobe: m of the Beckmann distribution, else alpha. The papers that use Kelemen's lobe for skin give m
 * itself (0.3 in d'Eon et al. 2007), so roughness is m there. */
PELL_SHARED float pell_lobe_width(int32_t model, float roughness)
{
    return model == PELL_LOBE_KELEMEN ? roughness : roughness * roughness;
}

/* exp(-x) for x >= 0; relative error under 3e-7 + 1e-7 x, 0 beyond 80. */
PELL_SHARED float pell_exp_minus(float x)
{
    const float y = (x < 80.0f ? x : 80.0f) * -1.44269504f;
    const int32_t n = PELL_TO_INT(y - 0.5f);
    const float f = (y - PELL_TO_FLOAT(n)) * 0.693147181f;
    const float e =
        1.0f + f * (1.0f + f * (0.5f + f * (1.66666667e-1f + f * (4.16666667e-2f + f * (8.33333333e-3f + f * 1.38888889e-3f)))));
    const float two = pell_bits_float((n + 127) << 23);
    return x < 80.0f ? e * two : 0.0f;
}

/* -ln(1 - x) for x in [0, 1); relative error under 3e-7, however small x is. 1 - x = 2^k (1 + f) with f in [-1/4, 1/2), and f is -x
 * itself where k = 0, so that small x keep their precision. */
PELL_SHARED float pell_log_minus(float x)
{
    const int32_t bits = pell_float_bits(1.0f - x), k = (bits - 0x3f400000) >> 23; /* 0x3f400000: 3/4 */
    const float m = pell_bits_float(bits - k * (1 << 23));
    const float f = k == 0 ? -x : m - 1.0f, s = f / (2.0f + f), s2 = s * s;
    const float series = s * (2.0f + s2 * (6.66666667e-1f + s2 * (0.4f + s2 * (2.85714286e-1f + s2 * 2.22222222e-1f))));
    return -(series + PELL_TO_FLOAT(k) * 0.693147181f);
}

/* cos^n of an angle. `rest` is 1 - cos; or sin^2, with n/2 for n. */
PELL_SHARED float pell_power_of_cos(float n, float rest)
{
    const float below = rest > 0.0f ? rest < 0.9999999f ? rest : 0.9999999f : 0.0f, p = pell_exp_minus(n * pell_log_minus(below));
    return rest < 1.0f ? p : 0.0f;
}

/* The lobes from nl = n.l, nv = n.v > 0 and the unnormalised h = l + v: nh = n.h, hh = h.h, sin2 = |n x h|^2 (not from nh:
 * 1 - cos^2 would lose the digits of narrow lobes). width2: square of pell_lobe_width. 1/sr, times the Fresnel reflectance. */
PELL_SHARED float pell_lobe_ggx(float width2, float nl, float nv, float sin2, float nh, float hh)
{
    const float d = (sin2 + nh * nh * width2) / hh; /* sin^2 + alpha^2 cos^2 of the half angle */
    const float sl = sqrtf(width2 + (1.0f - width2) * nl * nl), sv = sqrtf(width2 + (1.0f - width2) * nv * nv);
    return width2 * (1.0f / PELL_PI_F) * 0.5f / (d * d * (nl * sv + nv * sl) + 1e-30f);
}

PELL_SHARED float pell_lobe_kelemen(float width2, float sin2, float nh, float hh)
{
    const float c2 = nh * nh + 1e-20f;
    return pell_exp_minus(sin2 / (c2 * width2)) * hh / (PELL_PI_F * width2 * c2 * c2);
}

/* l minus the mirror direction is h - 2 nv n. Its component along n is nl - nv, perpendicular to n it is that of h. */
PELL_SHARED float pell_lobe_phong(float width2, float nl, float nv, float sin2)
{
    const float n = 0.5f / width2 - 0.5f, along = nl - nv;
    return (n + 2.0f) * (0.5f / PELL_PI_F) * pell_power_of_cos(n, 0.5f * (sin2 + along * along));
}

PELL_SHARED float pell_lobe_blinn_phong(float width2, float sin2, float hh)
{
    const float n = 2.0f / width2 - 2.0f, n2 = 0.5f * n;
    return (n + 2.0f) * (n + 4.0f) / (8.0f * PELL_PI_F * (pell_exp_minus(n2 * 0.693147181f) + n)) * pell_power_of_cos(n2, sin2 / hh);
}

#endif
