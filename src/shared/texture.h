/* SPDX-License-Identifier: MIT
 * texture.h - texels and mipmap levels of a texture lookup (render/surface/sample16.h), and roughness from the bumps of a normal map that
 * are smaller than a pixel (render/surface/hits16.h). */
#ifndef PELL_SHARED_TEXTURE_H
#define PELL_SHARED_TEXTURE_H

#include "shared/language.h"

/* As enum pell_wrap. */
#define PELL_TEXELS_REPEAT 0
#define PELL_TEXELS_MIRROR 2

#define PELL_BUMPS_ROUNDED 0.004f /* what eight bits leave of 1 - length^2 of a mean normal */

/* Two adjacent texels along one axis, and the fraction between them. */
struct pell_texels {
    int32_t a, b;
    float f;
};

/* Levels between which a lookup blends; blend 0: `lower` alone. */
struct pell_mip_levels {
    int32_t lower, upper;
    float blend;
};

PELL_SHARED int32_t pell_floor_to_int(float x)
{
    const int32_t i = PELL_TO_INT(x);
    return PELL_TO_FLOAT(i) > x ? i - 1 : i;
}

PELL_SHARED PELL_STRUCT(pell_texels) pell_texels_of(int32_t wrap, float at, int32_t size)
{
    const float repeated = at - PELL_TO_FLOAT(pell_floor_to_int(at));
    const float mirrored = at - 2.0f * PELL_TO_FLOAT(pell_floor_to_int(0.5f * at));
    const float clamped = at < -1.0f ? -1.0f : at > 2.0f ? 2.0f : at;
    const float u = wrap == PELL_TEXELS_REPEAT ? repeated : wrap == PELL_TEXELS_MIRROR ? mirrored : clamped;
    const float x = u * PELL_TO_FLOAT(size) - 0.5f;
    const int32_t i = pell_floor_to_int(x), last = size - 1;
    const int32_t before = wrap == PELL_TEXELS_REPEAT ? last : 0;
    const int32_t a = i < 0 ? before : i > last ? wrap == PELL_TEXELS_MIRROR ? 2 * last + 1 - i : last : i;
    const int32_t over = wrap == PELL_TEXELS_REPEAT ? 0 : wrap == PELL_TEXELS_MIRROR ? 2 * last - i : last;
    const int32_t b = i + 1 > last ? over : i + 1 < 0 ? 0 : i + 1;
    PELL_STRUCT(pell_texels) t;

    t.a = a < 0 ? 0 : a;
    t.b = b < 0 ? 0 : b;
    t.f = x - PELL_TO_FLOAT(i);
    return t;
}

/* log2 of positive numbers, with an error of at most 0.005: the exponent, and a parabola through the mantissa in [1, 2). */
PELL_SHARED float pell_approximate_log2(float x)
{
    const int32_t bits = pell_float_bits(x);
    const float m = pell_bits_float((bits & 0x7fffff) | 0x3f800000);
    return PELL_TO_FLOAT((bits >> 23) - 127) + ((-0.34484843f * m + 2.02466578f) * m - 1.67487759f);
}

/* Levels for a pixel that covers so many texels of the full size, >= 1. Between two levels the blend covers only half of the range
 * (fractions 1/4 to 3/4). */
PELL_SHARED PELL_STRUCT(pell_mip_levels) pell_mip_levels_of(float texels, float last)
{
    const float raw = 0.5f * pell_approximate_log2(texels), low = raw > 0.0f ? raw : 0.0f, lod = low < last ? low : last;
    const int32_t l = PELL_TO_INT(lod);
    const float f = 2.0f * (lod - PELL_TO_FLOAT(l)) - 0.5f;
    PELL_STRUCT(pell_mip_levels) m;

    m.lower = f >= 1.0f ? l + 1 : l;
    m.upper = f > 0.0f ? l + 1 : l;
    m.blend = f > 0.0f && f < 1.0f ? f : 0.0f;
    return m;
}

/* Slope variance of normals whose filtered mean has this squared length: as of a von Mises-Fisher distribution with this mean length r,
 * whose slopes have the variance (1 - r^2)/(r (3 - r^2)) (Toksvig 2005, "Mipmapping Normal Maps", has (1 - r)/r, the same to first
 * order). `texels`: covered by a pixel. */
PELL_SHARED float pell_bumps(float length2, float texels, float scale)
{
    const float missing = 1.0f - length2 - PELL_BUMPS_ROUNDED, least = length2 > 0.01f ? length2 : 0.01f;
    const float covered = texels - 1.0f, shrunk = covered > 1.0f ? 1.0f : covered > 0.0f ? covered : 0.0f;
    return missing > 0.0f ? shrunk * (scale * scale) * missing / (sqrtf(least) * (3.0f - least)) : 0.0f;
}

/* The same for a smooth surface whose normal turns by this square along the two axes of a pixel, with a footprint of variance `spread`
 * along each. Limited to the lobe of a roughness of 0.45: pixels of silhouettes contain normals of all directions. */
PELL_SHARED float pell_slope_variance(float square, float spread)
{
    const float variance = spread * square;
    return variance > 0.0f ? variance < 0.02f ? variance : 0.02f : 0.0f;
}

/* Roughness of a lobe over such bumps: the squared widths add. Twice the variance of slopes is the square of alpha (Beckmann's
 * distribution). `linear`: alpha is the roughness, not its square. */
PELL_SHARED float pell_bumpy_roughness(float roughness, float bumps, int32_t linear)
{
    const float r2 = roughness * roughness, root = sqrtf((linear != 0 ? r2 : r2 * r2) + 2.0f * bumps);
    return bumps > 0.0f ? linear != 0 ? root : sqrtf(root) : roughness;
}

#endif
