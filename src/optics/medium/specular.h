/* SPDX-License-Identifier: MIT
 *
 * specular.h - the lobes of pellucid/specular.h as formulas without branches or library calls, for kernels over lanes, and look-ups in
 * the tables.
 */
#ifndef PELL_SPECULAR_H
#define PELL_SPECULAR_H

#include "math/vec.h"

#include <pellucid/medium.h>
#include <pellucid/specular.h>

#include <stdint.h>

#define PELL_BOUNDARY_MU 256 /* entries over mu of a smooth boundary: (i / 255)^2 */

/* A smooth boundary seen from outside: F0, Fresnel's transmittance F_t(mu), and its cosine-weighted mean 1 - Fdr(1/eta). */
struct pell_boundary_table {
    double eta;
    float f0, mean;
    float transmittance[PELL_BOUNDARY_MU];
};
void pell_boundary_table_make(double eta, struct pell_boundary_table *out);

/* Schlick's F for cos = h . v, f0 at normal incidence. */
static inline float pell_schlick(float f0, float cos_h)
{
    const float c = cos_h < 1.0f ? 1.0f - cos_h : 0.0f, c2 = c * c;
    return f0 + (1.0f - f0) * c2 * c2 * c;
}

/* Position of a roughness between two entries. */
static inline void pell_roughness_position(float roughness, int *index, float *fraction)
{
    float y = (roughness - PELL_ROUGHNESS_MIN) * ((PELL_ALBEDO_ROUGHNESS - 1) / (1.0f - PELL_ROUGHNESS_MIN));
    int i;
    y = y > 0.0f ? y : 0.0f;
    y = y < PELL_ALBEDO_ROUGHNESS - 1 ? y : PELL_ALBEDO_ROUGHNESS - 1;
    i = (int) y;
    i = i < PELL_ALBEDO_ROUGHNESS - 2 ? i : PELL_ALBEDO_ROUGHNESS - 2;
    *index = i;
    *fraction = y - (float) i;
}

/* Scale and bias at mu, bilinear; `first` points at albedo[model][0][index] and counts from there. */
static inline void pell_albedo_pair(const float *first, float fraction, float mu, float *scale, float *bias)
{
    const float x = sqrtf(mu < 1.0f ? mu > 0.0f ? mu : 0.0f : 1.0f) * (PELL_ALBEDO_MU - 1);
    const int i0 = (int) x, i = i0 < PELL_ALBEDO_MU - 2 ? i0 : PELL_ALBEDO_MU - 2;
    const float f = x - (float) i, g = fraction;
    const float *p = first + 2 * PELL_ALBEDO_ROUGHNESS * i, *q = p + 2 * PELL_ALBEDO_ROUGHNESS;
    const float a = p[0] + g * (p[2] - p[0]), b = q[0] + g * (q[2] - q[0]);
    const float c = p[1] + g * (p[3] - p[1]), d = q[1] + g * (q[3] - q[1]);
    *scale = a + f * (b - a);
    *bias = c + f * (d - c);
}

static inline float pell_boundary_lookup(const float *transmittance, float mu)
{
    const float x = sqrtf(mu < 1.0f ? mu > 0.0f ? mu : 0.0f : 1.0f) * (PELL_BOUNDARY_MU - 1);
    const int i0 = (int) x, i = i0 < PELL_BOUNDARY_MU - 2 ? i0 : PELL_BOUNDARY_MU - 2;
    return transmittance[i] + (x - (float) i) * (transmittance[i + 1] - transmittance[i]);
}

/* A model that there is. */
static inline enum pell_specular_model pell_specular_known(enum pell_specular_model model)
{
    return (unsigned) model < PELL_SPECULAR_MODELS ? model : PELL_SPECULAR_GGX;
}

/* The width that a lobe's formula wants: m of the Beckmann distribution, else alpha. The papers that use Kelemen's lobe for skin give m
 * itself (0.3 in d'Eon et al. 2007), so roughness is m there. */
static inline float pell_lobe_width(enum pell_specular_model model, float roughness)
{
    return model == PELL_SPECULAR_KELEMEN ? roughness : roughness * roughness;
}

/* exp(-x) for x >= 0; relative error under 3e-7 + 1e-7 x, 0 beyond 80. */
static inline float pell_exp_minus(float x)
{
    const float y = (x < 80.0f ? x : 80.0f) * -1.44269504f;
    const int32_t whole = (int32_t) (y - 0.5f);
    const float f = (y - (float) whole) * 0.693147181f;
    const float e =
        1.0f + f * (1.0f + f * (0.5f + f * (1.66666667e-1f + f * (4.16666667e-2f + f * (8.33333333e-3f + f * 1.38888889e-3f)))));
    const int32_t bits = (whole + 127) << 23;
    float two;
    __builtin_memcpy(&two, &bits, sizeof(two));
    return x < 80.0f ? e * two : 0.0f;
}

/* -ln(1 - x) for x in [0, 1); relative error under 3e-7, however small x is. 1 - x = 2^k (1 + f) with f in [-1/4, 1/2), and f is -x
 * itself where k = 0, so that nothing drowns in the rounding of 1 - x. */
static inline float pell_log_minus(float x)
{
    const float y = 1.0f - x;
    int32_t bits, k;
    float m;
    __builtin_memcpy(&bits, &y, sizeof(bits));
    k = (bits - 0x3f400000) >> 23; /* 0x3f400000: 3/4 */
    bits -= k * (1 << 23);
    __builtin_memcpy(&m, &bits, sizeof(m));
    const float f = k == 0 ? -x : m - 1.0f, s = f / (2.0f + f), s2 = s * s;
    const float series = s * (2.0f + s2 * (6.66666667e-1f + s2 * (0.4f + s2 * (2.85714286e-1f + s2 * 2.22222222e-1f))));
    return -(series + (float) k * 0.693147181f);
}

/* cos^n of an angle, from 1 - cos, or from sin^2 with n/2. */
static inline float pell_power_of_cos(float n, float rest)
{
    const float below = rest > 0.0f ? rest < 0.9999999f ? rest : 0.9999999f : 0.0f, p = pell_exp_minus(n * pell_log_minus(below));
    return rest < 1.0f ? p : 0.0f;
}

/* The lobes from nl = n.l, nv = n.v > 0 and the unnormalised h = l + v: nh = n.h, hh = h.h, sin2 = |n x h|^2 (not from nh: narrow
 * lobes would drown in the rounding of 1 - cos^2). width2: square of pell_lobe_width. */
static inline float pell_lobe_ggx(float width2, float nl, float nv, float sin2, float nh, float hh)
{
    const float d = (sin2 + nh * nh * width2) / hh; /* sin^2 + alpha^2 cos^2 of the half angle */
    const float sl = sqrtf(width2 + (1.0f - width2) * nl * nl), sv = sqrtf(width2 + (1.0f - width2) * nv * nv);
    return width2 * (1.0f / PELL_PI_F) * 0.5f / (d * d * (nl * sv + nv * sl) + 1e-30f);
}

static inline float pell_lobe_kelemen(float width2, float sin2, float nh, float hh)
{
    const float c2 = nh * nh + 1e-20f;
    return pell_exp_minus(sin2 / (c2 * width2)) * hh / (PELL_PI_F * width2 * c2 * c2);
}

/* l less the mirror direction is h - 2 nv n: nl - nv along n, and what h has beside n. */
static inline float pell_lobe_phong(float width2, float nl, float nv, float sin2)
{
    const float n = 0.5f / width2 - 0.5f, along = nl - nv;
    return (n + 2.0f) * (0.5f / PELL_PI_F) * pell_power_of_cos(n, 0.5f * (sin2 + along * along));
}

static inline float pell_lobe_blinn_phong(float width2, float sin2, float hh)
{
    const float n = 2.0f / width2 - 2.0f, half = 0.5f * n;
    return (n + 2.0f) * (n + 4.0f) / (8.0f * PELL_PI_F * (pell_exp_minus(half * 0.693147181f) + n)) * pell_power_of_cos(half, sin2 / hh);
}

#endif
