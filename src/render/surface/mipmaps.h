/* SPDX-License-Identifier: MIT
 * mipmaps.h - shared by mipmaps.c and kernel.c. */
#ifndef PELL_SURFACE_MIPS_H
#define PELL_SURFACE_MIPS_H

#include "image/color.h"
#include "render/surface/stage.h"
#include "scene/material_maps.h"

#define SURFACE_MIP_LEVELS 32

/* Level 0 is the scene's own image. Smaller levels of 8 and 16 bit images are linear RGBA of 16 bits, red in the lowest: 8 bytes per
 * texel whatever the source holds, 2.7 bytes per texel of the source in all, and no sRGB to decode per pixel. Smaller levels of float
 * images are float images. Each level halves the one before by an area-weighted box. */
struct pyramid {
    struct pell_image image; /* level 0, borrowed */
    int levels;
    int width[SURFACE_MIP_LEVELS], height[SURFACE_MIP_LEVELS];
    uint64_t *texels[SURFACE_MIP_LEVELS];         /* from 1 on; NULL for float images */
    struct pell_image floats[SURFACE_MIP_LEVELS]; /* from 1 on, float images */
};

struct pell_mips {
    struct pell_context *ctx;
    struct pyramid *pyramids; /* one per image that a material of the scene reads */
    size_t num_pyramids;
    bool any_thin;                /* some material of the scene is a thin sheet */
    const struct pyramid **slots; /* [material * PELL_MAPS + map], NULL where there is no map */
};

/* 8 bits to 16 bits linear: for sRGB, and for linear data. */
struct surface_decode {
    uint16_t srgb[256], linear[256];
};

void surface_decode_make(struct surface_decode *decode);

static inline uint16_t surface_decode16(const struct pell_image *image, uint16_t v)
{
    return image->srgb ? (uint16_t) (pell_srgb_decode_u16(v) * 65535.0f + 0.5f) : v;
}

/* One texel of an 8 or 16 bit image as linear RGBA of 16 bits, red in the lowest: grey is copied, missing alpha is 1. */
static inline uint64_t surface_texel(const struct pell_image *image, const struct surface_decode *decode, size_t at)
{
    const int n = image->channels;
    uint64_t r, g, b, a = 65535;

    if (image->type == PELL_PIXEL_U8) {
        const uint8_t *p = (const uint8_t *) image->pixels + at * (size_t) n;
        const uint16_t *table = image->srgb ? decode->srgb : decode->linear;
        r = g = b = table[p[0]];
        if (n >= 3) {
            g = table[p[1]];
            b = table[p[2]];
        }
        if (n == 2 || n == 4)
            a = decode->linear[p[n - 1]];
    } else {
        const uint16_t *p = (const uint16_t *) image->pixels + at * (size_t) n;
        r = g = b = surface_decode16(image, p[0]);
        if (n >= 3) {
            g = surface_decode16(image, p[1]);
            b = surface_decode16(image, p[2]);
        }
        if (n == 2 || n == 4)
            a = p[n - 1];
    }
    return r | g << 16 | b << 32 | a << 48;
}

/* Level 0 alone. */
static inline struct pyramid pyramid_of(const struct pell_image *image)
{
    return (struct pyramid) { .image = *image, .levels = 1, .width = { image->width }, .height = { image->height } };
}

#endif
