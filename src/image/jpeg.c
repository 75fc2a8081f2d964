/* SPDX-License-Identifier: MIT
 * jpeg.c - baseline and progressive JPEG (ITU-T T.81) of 8 bits through libjpeg-turbo. A libjpeg warning means that pixels were invented,
 * so it is an error here. */
#include "image/formats.h"

#include <string.h>

#include <turbojpeg.h>

/* Real progressive files have about ten scans; thousands over a large image would take hours. */
#define SCANS_MAX 500

struct frame {
    int width, height, components, precision, marker;
    int scans;
    bool adobe; /* CMYK is stored inverted */
};

static int word_at(const uint8_t *p)
{
    return p[0] << 8 | p[1];
}

/* Reads one frame header; false if it is too short. */
static bool frame_header(const uint8_t *segment, size_t length, int marker, struct frame *f)
{
    if (length < 8)
        return false;
    f->marker = marker;
    f->precision = segment[2];
    f->height = word_at(segment + 3);
    f->width = word_at(segment + 5);
    f->components = segment[7];
    return true;
}

/* Scans all markers of the file. False, with the position, if the structure is broken before the first scan. */
static bool scan_markers(const struct pell_source *src, struct frame *f, size_t *at)
{
    const uint8_t *d = src->data;
    size_t i = 2;

    *f = (struct frame) { 0 };
    while (i + 1 < src->size) {
        const int marker = d[i + 1];
        size_t length;
        const uint8_t *next;

        *at = i;
        if (d[i] != 0xff || marker == 0 || marker == 0xff || (marker >= 0xd0 && marker <= 0xd7)) {
            /* entropy-coded data, stuffing, fill or restart: skip to the next 0xff */
            if (d[i] != 0xff && f->scans == 0)
                return false;
            next = memchr(d + i + 1, 0xff, src->size - i - 1);
            if (!next)
                break;
            i = (size_t) (next - d);
            continue;
        }
        if (marker == 0xd9)
            break;
        if (marker == 0xd8 || marker == 0x01) {
            i += 2;
            continue;
        }
        if (i + 4 > src->size || (length = (size_t) word_at(d + i + 2)) < 2 || length > src->size - i - 2)
            return f->scans > 0;
        if (marker >= 0xc0 && marker <= 0xcf && marker != 0xc4 && marker != 0xc8 && marker != 0xcc && f->marker == 0 &&
            !frame_header(d + i + 2, length, marker, f))
            return false;
        if (marker == 0xee && length >= 14 && memcmp(d + i + 4, "Adobe", 5) == 0)
            f->adobe = true;
        f->scans += marker == 0xda;
        i += 2 + length;
    }
    return f->marker != 0 && f->scans > 0;
}

static enum pell_result check_frame(struct pell_context *ctx, const struct pell_source *src, const struct frame *f)
{
    enum pell_result res;
    uint64_t pixels, planes;

    if (f->marker != 0xc0 && f->marker != 0xc1 && f->marker != 0xc2 && f->marker != 0xc9 && f->marker != 0xca)
        return pell_error(ctx, PELL_ERR_UNSUPPORTED, src->name, "write it as baseline JPEG or as PNG",
                          "JPEG: process SOF%d (lossless or hierarchical) is not read; baseline and progressive are", f->marker - 0xc0);
    if (f->precision != 8)
        return pell_error(ctx, PELL_ERR_UNSUPPORTED, src->name, "write it as 16 bit PNG or OpenEXR", "JPEG: %d bits per sample, must be 8",
                          f->precision);
    if (f->components != 1 && f->components != 3 && f->components != 4)
        return pell_error(ctx, PELL_ERR_UNSUPPORTED, src->name, NULL, "JPEG: %d components, must be 1 (grey), 3 (colour) or 4 (CMYK)",
                          f->components);
    if (f->height == 0)
        return pell_error(ctx, PELL_ERR_UNSUPPORTED, src->name, "write it again", "JPEG: the height is given behind the image (DNL)");
    res = pell_image_check_size(ctx, src->name, f->width, f->height);
    if (res != PELL_OK)
        return res;
    if (f->scans > SCANS_MAX)
        return pell_error(ctx, PELL_ERR_INVALID, src->name, "write it as baseline JPEG", "JPEG: %d scans, the limit is %d", f->scans,
                          SCANS_MAX);
    /* Progressive: libjpeg keeps 2 bytes per coefficient of all planes. */
    pixels = (uint64_t) (f->width + 16) * (uint64_t) (f->height + 16);
    planes = (uint64_t) f->components;
    return pell_image_check_memory(ctx, src->name, pixels * planes * (f->scans > 1 ? 3 : 1));
}

/* CMYK to RGB without a profile, from 4 to 3 bytes per pixel: white times the transmittance of each ink and black. */
static void cmyk_to_rgb(uint8_t *pixels, const uint8_t *cmyk, size_t count, bool inverted)
{
    const unsigned flip = inverted ? 0 : 255;

    for (size_t i = 0; i < count; i++, pixels += 3, cmyk += 4)
        for (int c = 0; c < 3; c++)
            pixels[c] = (uint8_t) (((cmyk[c] ^ flip) * (cmyk[3] ^ flip) + 127) / 255);
}

static enum pell_result decompress(struct pell_context *ctx, const struct pell_source *src, const struct frame *f, uint8_t *out)
{
    const int format = f->components == 1 ? TJPF_GRAY : f->components == 3 ? TJPF_RGB : TJPF_CMYK;
    enum pell_result res = PELL_OK;
    tjhandle jpeg = tjInitDecompress();
    char text[200];

    if (!jpeg)
        return pell_error(ctx, PELL_ERR_NOMEM, src->name, NULL, "out of memory: JPEG reader");
    if (tjDecompress2(jpeg, src->data, src->size, out, f->width, 0, f->height, format,
                      TJFLAG_STOPONWARNING | TJFLAG_LIMITSCANS | TJFLAG_ACCURATEDCT) != 0)
        res = pell_error(ctx, PELL_ERR_FORMAT, src->name, "the file is damaged: write it again", "JPEG: %s",
                         pell_printable(tjGetErrorStr2(jpeg), text, sizeof(text)));
    tjDestroy(jpeg);
    return res;
}

enum pell_result pell_jpeg_decode(struct pell_context *ctx, const struct pell_source *src, struct pell_image *image)
{
    enum pell_result res;
    struct frame f;
    uint8_t *cmyk = NULL;
    size_t at = 0, count;

    if (!scan_markers(src, &f, &at))
        return pell_error(ctx, PELL_ERR_FORMAT, src->name, "the file is damaged: write it again",
                          "JPEG: the chain of segments breaks at byte %zu of %zu, before the image", at, src->size);
    PELL_TRY(check_frame(ctx, src, &f));
    PELL_TRY(pell_image_make(ctx, src->name, f.width, f.height, f.components == 1 ? 1 : 3, PELL_PIXEL_U8, image));
    count = (size_t) f.width * (size_t) f.height;
    if (f.components != 4) {
        PELL_TRY(decompress(ctx, src, &f, image->pixels));
        return PELL_OK;
    }
    cmyk = pell_alloc_array(ctx, count, 4);
    if (!cmyk) {
        res = PELL_ERR_NOMEM;
        goto fail;
    }
    PELL_TRY(decompress(ctx, src, &f, cmyk));
    cmyk_to_rgb(image->pixels, cmyk, count, f.adobe);
    pell_warn(ctx, src->name, "write it as RGB for true colours", "JPEG: CMYK was converted to RGB without its colour profile");
fail:
    pell_free(ctx, cmyk);
    return res;
}
