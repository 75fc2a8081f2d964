/* SPDX-License-Identifier: MIT
 * color.c - the sRGB transfer function, IEC 61966-2-1:1999, equations (5) to (8), with the exact junction of the two pieces. */
#include "image/color.h"

#include <math.h>

float pell_srgb_decode(float encoded)
{
    if (encoded <= 0.04045f)
        return encoded / 12.92f;
    if (encoded > 1.0f) /* slope of the curve at 1 */
        return 1.0f + (encoded - 1.0f) * (2.4f / 1.055f);
    return powf((encoded + 0.055f) / 1.055f, 2.4f);
}

float pell_srgb_encode(float linear)
{
    if (linear <= 0.0031308f)
        return linear * 12.92f;
    if (linear > 1.0f)
        return 1.0f + (linear - 1.0f) * (1.055f / 2.4f);
    return 1.055f * powf(linear, 1.0f / 2.4f) - 0.055f;
}
