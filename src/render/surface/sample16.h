/* SPDX-License-Identifier: MIT
 *
 * sample16.h - 16 texture look-ups at once, filtered in space and between levels; part of kernel.c, so compiled per SIMD level.
 *
 * Levels are blended over half of the interval between them only: the image has no seams where levels change, and half of the pixels need
 * one level instead of two.
 */
#ifndef PELL_SURFACE_SAMPLE16_H
#define PELL_SURFACE_SAMPLE16_H

#include "image/color.h"
#include "render/surface/mipmaps.h"
#include "shared/texture.h"

#include <string.h>

#define LANES 16
#define ALL_LANES 0xffffu

typedef float float16[LANES] __attribute__((aligned(64)));
typedef int32_t int16lanes[LANES] __attribute__((aligned(64)));
typedef uint32_t uint16lanes[LANES] __attribute__((aligned(64)));

struct uv16 {
    float16 u, v, area; /* area of the pixel in (u, v) */
};

/* Neighbouring texels along one axis, and the fraction between them. */
static inline void axis16(enum pell_wrap wrap, const float *restrict at, const int32_t *restrict size, int32_t *restrict i0,
                          int32_t *restrict i1, float *restrict f)
{
#define AXIS(how)                                                                                                                          \
    for (int i = 0; i < LANES; i++) {                                                                                                      \
        const struct pell_texels t = pell_texels_of(how, at[i], size[i]);                                                                  \
        i0[i] = t.a;                                                                                                                       \
        i1[i] = t.b;                                                                                                                       \
        f[i] = t.f;                                                                                                                        \
    }
    /* a loop per mode, without branches inside */
    if (wrap == PELL_WRAP_REPEAT) {
        AXIS(PELL_TEXELS_REPEAT)
    } else if (wrap == PELL_WRAP_MIRROR) {
        AXIS(PELL_TEXELS_MIRROR)
    } else {
        AXIS(PELL_WRAP_CLAMP)
    }
#undef AXIS
}

/* surface_texel for the most common type, 8 bit RGB. */
static inline uint64_t rgb_texel(const uint8_t *rgb, const uint16_t *table, size_t at)
{
    const uint8_t *p = rgb + 3 * at;

    return (uint64_t) table[p[0]] | (uint64_t) table[p[1]] << 16 | (uint64_t) table[p[2]] << 32 | 0xffffull << 48;
}

/* Bilinear look-up in each lane's level, for 8 and 16 bit images. Lanes that are not in `lanes` get some finite value. */
static void bilinear16(const struct pyramid *p, const struct pell_texture *t, const struct surface_decode *decode,
                       const float16 *restrict uv, const int32_t *restrict level, uint32_t lanes, unsigned channels, float16 *restrict out)
{
    const struct pell_image *image = &p->image;
    const uint8_t *rgb = image->type == PELL_PIXEL_U8 && image->channels == 3 ? image->pixels : NULL;
    const uint16_t *table = image->srgb ? decode->srgb : decode->linear;
    int16lanes w, h, x0, x1, y0, y1;
    uint16lanes at[4], low[4], high[4];
    _Alignas(64) uint64_t texel[4][LANES];
    float16 fx, fy, weight[4];

    for (int i = 0; i < LANES; i++) {
        w[i] = p->width[level[i]];
        h[i] = p->height[level[i]];
    }
    axis16(t->wrap_u, uv[0], w, x0, x1, fx);
    axis16(t->wrap_v, uv[1], h, y0, y1, fy);
    for (int i = 0; i < LANES; i++) {
        weight[0][i] = (1.0f - fx[i]) * (1.0f - fy[i]) * (1.0f / 65535.0f);
        weight[1][i] = fx[i] * (1.0f - fy[i]) * (1.0f / 65535.0f);
        weight[2][i] = (1.0f - fx[i]) * fy[i] * (1.0f / 65535.0f);
        weight[3][i] = fx[i] * fy[i] * (1.0f / 65535.0f);
        at[0][i] = (uint32_t) (y0[i] * w[i] + x0[i]);
        at[1][i] = (uint32_t) (y0[i] * w[i] + x1[i]);
        at[2][i] = (uint32_t) (y1[i] * w[i] + x0[i]);
        at[3][i] = (uint32_t) (y1[i] * w[i] + x1[i]);
    }
    if (lanes != ALL_LANES)
        memset(texel, 0, sizeof(texel));
    for (uint32_t left = lanes; left; left &= left - 1) {
        const int i = __builtin_ctz(left);
        const uint64_t *texels = p->texels[level[i]];
        if (texels) {
            for (int k = 0; k < 4; k++)
                texel[k][i] = texels[at[k][i]];
        } else if (rgb) {
            for (int k = 0; k < 4; k++)
                texel[k][i] = rgb_texel(rgb, table, at[k][i]);
        } else {
            for (int k = 0; k < 4; k++)
                texel[k][i] = surface_texel(image, decode, at[k][i]);
        }
    }
    for (int k = 0; k < 4; k++)
        for (int i = 0; i < LANES; i++) {
            low[k][i] = (uint32_t) texel[k][i];
            high[k][i] = (uint32_t) (texel[k][i] >> 32);
        }
    for (int c = 0; c < 4; c++) {
        const uint16lanes *half = c < 2 ? low : high;
        const int shift = 16 * (c & 1);
        if (!(channels >> c & 1))
            continue;
        for (int i = 0; i < LANES; i++)
            out[c][i] = weight[0][i] * (float) (int32_t) (half[0][i] >> shift & 0xffff) +
                        weight[1][i] * (float) (int32_t) (half[1][i] >> shift & 0xffff) +
                        weight[2][i] * (float) (int32_t) (half[2][i] >> shift & 0xffff) +
                        weight[3][i] * (float) (int32_t) (half[3][i] >> shift & 0xffff);
    }
}

/* Float images, and textures that are not to be filtered: one by one. */
static void one_by_one(const struct pyramid *p, const struct pell_texture *t, const float16 *uv, const int32_t *level, uint32_t lanes,
                       unsigned channels, float16 *restrict out)
{
    for (uint32_t left = lanes; left; left &= left - 1) {
        const int i = __builtin_ctz(left);
        float rgba[4];
        pell_image_sample(level[i] ? &p->floats[level[i]] : &p->image, t->wrap_u, t->wrap_v, t->nearest, uv[0][i], uv[1][i], rgba);
        for (int c = 0; c < 4; c++)
            if (channels >> c & 1)
                out[c][i] = rgba[c];
    }
}

/* Looks up `channels` (bits) of a map for `lanes`; others get some finite value. */
static void sample16(const struct pyramid *p, const struct pell_texture_map *map, const struct surface_decode *decode,
                     const struct uv16 *at, uint32_t lanes, unsigned channels, float16 *restrict rgba)
{
    const struct pell_texture *t = map->texture;
    const float *m = map->matrix, scale = fabsf(m[0] * m[4] - m[1] * m[3]) * (float) p->image.width * (float) p->image.height;
    /* The quick path counts texels in 32 bits; images beyond that are looked up at full size. */
    const bool floats = p->image.type == PELL_PIXEL_F32, huge = p->image.width * (int64_t) p->image.height > INT32_MAX;
    const bool slow = t->nearest || floats || huge;
    const float last = t->nearest || (huge && !floats) ? 0.0f : (float) (p->levels - 1);
    float16 uv[2], blend, area;
    int16lanes first, second, mixed;
    uint32_t both = 0;

    for (int i = 0; i < LANES; i++) {
        const float tu = m[0] * at->u[i] + m[1] * at->v[i] + m[2], tv = m[3] * at->u[i] + m[4] * at->v[i] + m[5];
        uv[0][i] = fabsf(tu) < 16777216.0f ? tu : 0.0f; /* NaN, and numbers without fractional digits */
        uv[1][i] = fabsf(tv) < 16777216.0f ? tv : 0.0f;
        area[i] = at->area[i] * scale;
        area[i] = area[i] > 1.0f ? area[i] : 1.0f;
    }
    for (int i = 0; i < LANES; i++) {
        const struct pell_mip_levels mip = pell_mip_levels_of(area[i], last);
        mixed[i] = mip.blend > 0.0f;
        blend[i] = mip.blend;
        first[i] = mip.lower;
        second[i] = mip.upper;
    }
    for (int i = 0; i < LANES; i++)
        both |= (uint32_t) mixed[i] << i;
    both &= lanes;
    if (slow) {
        memset(rgba, 0, 4 * sizeof(*rgba));
        one_by_one(p, t, uv, first, lanes, channels, rgba);
    } else {
        bilinear16(p, t, decode, uv, first, lanes, channels, rgba);
    }
    if (both) {
        float16 more[4];
        if (slow) {
            memset(more, 0, sizeof(more));
            one_by_one(p, t, uv, second, both, channels, more);
        } else {
            bilinear16(p, t, decode, uv, second, both, channels, more);
        }
        for (int c = 0; c < 4; c++)
            if (channels >> c & 1)
                for (int i = 0; i < LANES; i++)
                    rgba[c][i] += blend[i] * (more[c][i] - rgba[c][i]);
    }
}

#endif
