/* SPDX-License-Identifier: MIT
 *
 * tone.h - luminance, the tone curves, and the sRGB transfer function.
 *
 * Reinhard, Stark, Shirley and Ferwerda 2002, "Photographic Tone Reproduction for Digital Images", equation (4):
 * L_d = L (1 + L / white^2) / (1 + L). The filmic curve is that of ACES 1.0 (Academy Color Encoding System, reference rendering and sRGB
 * output transforms) as S. Hill fitted it (2016): a matrix, a rational function of each channel, a matrix. IEC 61966-2-1:1999, equations
 * (5) to (8), with the exact junction of the two pieces.
 */
#ifndef PELL_SHARED_TONE_H
#define PELL_SHARED_TONE_H

#include "shared/language.h"

#ifdef __STDC_VERSION__
/* Names of the curves, for the knobs `tonemap` of images and of comparing. */
#define PELL_CURVE_REINHARD "reinhard"
#define PELL_CURVE_LINEAR "linear"
#define PELL_CURVE_FILMIC "filmic"
#endif

/* Luminance of linear Rec.709 colours; for any arithmetic type. */
#define PELL_LUMINANCE_R 0.2126f
#define PELL_LUMINANCE_G 0.7152f
#define PELL_LUMINANCE_B 0.0722f
#define PELL_LUMINANCE(r, g, b) (PELL_LUMINANCE_R * (r) + PELL_LUMINANCE_G * (g) + PELL_LUMINANCE_B * (b))

/* Factor of a colour: exposure L_d / L for its exposed luminance L >= 0. curve = 1: Reinhard, white_scale = 1 / white^2; curve = 0:
 * linear, white_scale = 0. For any arithmetic type. */
#define PELL_TONE_SCALE(exposure, l, curve, white_scale) ((exposure) * (1.0f + (l) * (white_scale)) / (1.0f + (l) * (curve)))

/* Inverse of Reinhard's curve: the L that is shown as L_d, the positive root of L (1 + L / white^2) = L_d (1 + L). */
PELL_SHARED float pell_tone_inverse(float shown, float white_scale)
{
    const float b = 1.0f - shown;
    return 2.0f * shown / (b + sqrtf(b * b + 4.0f * white_scale * shown));
}

/* Rows of the matrices around the filmic curve; each sums to 1 within 1e-5, so that grey stays grey. For any arithmetic type. */
#define PELL_FILMIC_TO_R(r, g, b) (0.59719f * (r) + 0.35458f * (g) + 0.04823f * (b))
#define PELL_FILMIC_TO_G(r, g, b) (0.07600f * (r) + 0.90834f * (g) + 0.01566f * (b))
#define PELL_FILMIC_TO_B(r, g, b) (0.02840f * (r) + 0.13383f * (g) + 0.83777f * (b))
#define PELL_FILMIC_FROM_R(r, g, b) (1.60475f * (r) -0.53108f * (g) -0.07367f * (b))
#define PELL_FILMIC_FROM_G(r, g, b) (-0.10208f * (r) + 1.10813f * (g) -0.00605f * (b))
#define PELL_FILMIC_FROM_B(r, g, b) (-0.00327f * (r) -0.07276f * (g) + 1.07602f * (b))

/* Scale of exposed light before the curve, so that 0.18 stays 0.18. */
#define PELL_FILMIC_SCALE 1.461930f
#define PELL_FILMIC_MOST 1e6f /* largest input of the curve: white long before, so that squares do not overflow */
#define PELL_FILMIC_CURVE(x) (((x) * ((x) + 0.0245786f) - 0.000090537f) / ((x) * (0.983729f * (x) + 0.4329510f) + 0.238081f))

/* Inverse of PELL_FILMIC_CURVE for y in [0, 1]. */
PELL_SHARED float pell_filmic_inverse(float y)
{
    const float a = 1.0f - 0.983729f * y, b = 0.0245786f - 0.4329510f * y, c = -0.000090537f - 0.238081f * y;
    return (sqrtf(b * b - 4.0f * a * c) - b) / (2.0f * a);
}

/* [0, 1] -> [0, 1]; continued linearly outside. */
PELL_SHARED float pell_srgb_encode(float linear)
{
    if (linear <= 0.0031308f)
        return linear * 12.92f;
    if (linear > 1.0f)
        return 1.0f + (linear - 1.0f) * (1.055f / 2.4f);
    return 1.055f * powf(linear, 1.0f / 2.4f) - 0.055f;
}

PELL_SHARED float pell_srgb_decode(float encoded)
{
    if (encoded <= 0.04045f)
        return encoded / 12.92f;
    if (encoded > 1.0f) /* slope of the curve at 1 */
        return 1.0f + (encoded - 1.0f) * (2.4f / 1.055f);
    return powf((encoded + 0.055f) / 1.055f, 2.4f);
}

#endif
