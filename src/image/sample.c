/* SPDX-License-Identifier: MIT
 * sample.c - texture look-up; runs per pixel in the renderer. */
#include "image/color.h"
#include "shared/texture.h"

#include <math.h>
#include <string.h>

#define INV255 (1.0f / 255.0f)
#define INV65535 (1.0f / 65535.0f)

/* Expands 1 to 4 channels to RGBA. */
static inline void to_rgba(int channels, const float v[4], float rgba[4])
{
    switch (channels) {
    case 1:
        rgba[0] = rgba[1] = rgba[2] = v[0];
        rgba[3] = 1.0f;
        break;
    case 2:
        rgba[3] = v[1];
        rgba[0] = rgba[1] = rgba[2] = v[0];
        break;
    case 3:
        memcpy(rgba, v, 3 * sizeof(*v));
        rgba[3] = 1.0f;
        break;
    default: memcpy(rgba, v, 4 * sizeof(*v)); break;
    }
}

/* Adds weight * texel to acc, channel by channel, as stored (1 to 4 of them), decoded to linear. */
static inline void add_texel(const struct pell_image *image, size_t index, float weight, float acc[4])
{
    const int n = image->channels, color = n == 2 || n == 4 ? n - 1 : n;
    const size_t at = index * (size_t) n;

    switch (image->type) {
    case PELL_PIXEL_U8: {
        const uint8_t *p = (const uint8_t *) image->pixels + at;
        if (image->srgb) {
            for (int c = 0; c < color; c++)
                acc[c] += weight * pell_srgb_u8[p[c]];
            if (color < n)
                acc[color] += weight * INV255 * (float) p[color];
        } else {
            for (int c = 0; c < n; c++)
                acc[c] += weight * INV255 * (float) p[c];
        }
        break;
    }
    case PELL_PIXEL_U16: {
        const uint16_t *p = (const uint16_t *) image->pixels + at;
        for (int c = 0; c < n; c++)
            acc[c] += weight * (image->srgb && c < color ? pell_srgb_decode_u16(p[c]) : INV65535 * (float) p[c]);
        break;
    }
    case PELL_PIXEL_F32: {
        const float *p = (const float *) image->pixels + at;
        for (int c = 0; c < n; c++)
            acc[c] += weight * p[c];
        break;
    }
    }
}

void pell_image_texel(const struct pell_image *image, int x, int y, float rgba[4])
{
    float v[4] = { 0 };
    add_texel(image, (size_t) y * (size_t) image->width + (size_t) x, 1.0f, v);
    to_rgba(image->channels, v, rgba);
}

/* Folds a texel index in the range that coordinate() returns into [0, size). */
static inline int fold(enum pell_wrap wrap, int i, int size)
{
    if (i >= 0 && i < size)
        return i;
    switch (wrap) {
    case PELL_WRAP_REPEAT: return i < 0 ? i + size : i - size;
    case PELL_WRAP_MIRROR:
        /* coordinate() leaves [-1, 2 size] */
        if (i < 0)
            return -1 - i;
        i -= size;
        return i < size ? size - 1 - i : 0;
    case PELL_WRAP_CLAMP: break;
    }
    return i < 0 ? 0 : size - 1;
}

/* u as a texel coordinate in a small range, equivalent under wrapping. */
static inline float coordinate(enum pell_wrap wrap, float u, int size)
{
    if (!(fabsf(u) < 16777216.0f)) /* it has no fractional bits, and the conversion to int must be safe */
        u = wrap == PELL_WRAP_CLAMP ? (u > 0 ? 1.0f : 0.0f) : 0.0f;
    if (wrap == PELL_WRAP_REPEAT)
        u -= floorf(u);
    else if (wrap == PELL_WRAP_MIRROR)
        u -= 2.0f * floorf(0.5f * u);
    else
        u = u < -1.0f ? -1.0f : u > 2.0f ? 2.0f : u;
    return u * (float) size;
}

void pell_image_sample(const struct pell_image *image, enum pell_wrap wrap_u, enum pell_wrap wrap_v, bool nearest, float u, float v,
                       float rgba[4])
{
    const int w = image->width, h = image->height;
    float x = coordinate(wrap_u, u, w), y = coordinate(wrap_v, v, h), acc[4] = { 0 };
    int x0, x1, y0, y1;
    float fx, fy;
    size_t row0, row1;

    if (nearest) {
        pell_image_texel(image, fold(wrap_u, pell_floor_to_int(x), w), fold(wrap_v, pell_floor_to_int(y), h), rgba);
        return;
    }
    x -= 0.5f;
    y -= 0.5f;
    x0 = pell_floor_to_int(x);
    y0 = pell_floor_to_int(y);
    fx = x - (float) x0;
    fy = y - (float) y0;
    x1 = fold(wrap_u, x0 + 1, w);
    y1 = fold(wrap_v, y0 + 1, h);
    x0 = fold(wrap_u, x0, w);
    y0 = fold(wrap_v, y0, h);
    row0 = (size_t) y0 * (size_t) w;
    row1 = (size_t) y1 * (size_t) w;
    add_texel(image, row0 + (size_t) x0, (1.0f - fx) * (1.0f - fy), acc);
    add_texel(image, row0 + (size_t) x1, fx * (1.0f - fy), acc);
    add_texel(image, row1 + (size_t) x0, (1.0f - fx) * fy, acc);
    add_texel(image, row1 + (size_t) x1, fx * fy, acc);
    to_rgba(image->channels, acc, rgba);
}
