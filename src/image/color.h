/* SPDX-License-Identifier: MIT
 *
 * color.h - tables of the sRGB transfer function (shared/tone.h), luminance, and texture look-up.
 *
 * Threads    all functions are pure and safe; the tables are constant, made by the build (srgb_table.py).
 */
#ifndef PELL_COLOR_H
#define PELL_COLOR_H

#include "shared/tone.h"

#include <pellucid/image.h>

extern const float pell_srgb_u8[256];    /* exact to the float: decode(i/255) */
extern const float pell_srgb_fine[4098]; /* decode(i/4096) */

/* decode(value/65535) by linear interpolation; the error is below 1/10 of a 16-bit step. */
static inline float pell_srgb_decode_u16(uint16_t value)
{
    const float x = (float) value * (4096.0f / 65535.0f);
    const int i = (int) x;
    return pell_srgb_fine[i] + (x - (float) i) * (pell_srgb_fine[i + 1] - pell_srgb_fine[i]);
}

/* Rec.709 luminance of linear RGB. */
static inline float pell_luminance(const float rgb[3])
{
    return PELL_LUMINANCE(rgb[0], rgb[1], rgb[2]);
}

/* One texel as linear RGBA: grey is copied to R, G, B; missing alpha is 1. x, y must be inside. */
void pell_image_texel(const struct pell_image *image, int x, int y, float rgba[4]);

/* Bilinear (or nearest) look-up at (u, v), v down, texel centres at (i + 1/2)/size; any u, v (not finite: treated as 0). Filtering is done
 * on linear values; straight alpha is filtered separately. */
void pell_image_sample(const struct pell_image *image, enum pell_wrap wrap_u, enum pell_wrap wrap_v, bool nearest, float u, float v,
                       float rgba[4]);

#endif
