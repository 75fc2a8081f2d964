/* SPDX-License-Identifier: MIT
 * image.c - pictures in memory, and which reader a file's first bytes ask for. */
#include "image/formats.h"

#include "base/file.h"
#include "image/color.h"

#include <limits.h>
#include <math.h>
#include <string.h>

size_t pell_pixel_size(enum pell_pixel_type type)
{
    switch (type) {
    case PELL_PIXEL_U8: return 1;
    case PELL_PIXEL_U16: return 2;
    case PELL_PIXEL_F32: return 4;
    }
    return 4;
}

enum pell_result pell_image_check_size(struct pell_context *ctx, const char *name, int64_t width, int64_t height)
{
    const int64_t limit = pell_context_limits(ctx)->image_pixels;

    if (width < 1 || height < 1)
        return pell_error(ctx, PELL_ERR_FORMAT, name, NULL, "the picture is %lld x %lld pixels, must be 1 x 1 or more", (long long) width,
                          (long long) height);
    if (width > INT_MAX || height > INT_MAX || width > limit / height)
        return pell_error(ctx, PELL_ERR_INVALID, name, "make it smaller, or raise the limit image-pixels",
                          "the picture is %lld x %lld pixels, the limit is %lld pixels", (long long) width, (long long) height,
                          (long long) limit);
    return PELL_OK;
}

enum pell_result pell_image_make(struct pell_context *ctx, const char *name, int64_t width, int64_t height, int channels,
                                 enum pell_pixel_type type, struct pell_image *image)
{
    enum pell_result res = pell_image_check_size(ctx, name, width, height);
    void *pixels;

    if (res != PELL_OK)
        return res;
    pixels = pell_alloc_array(ctx, (size_t) width * (size_t) height, (size_t) channels * pell_pixel_size(type));
    if (!pixels)
        return PELL_ERR_NOMEM;
    *image = (struct pell_image) {
        .width = (int) width, .height = (int) height, .channels = channels, .type = type, .pixels = pixels,
    };
    return PELL_OK;
}

enum pell_result pell_image_check_memory(struct pell_context *ctx, const char *name, uint64_t bytes)
{
    const uint64_t limit = (uint64_t) pell_context_limits(ctx)->memory_bytes, used = pell_memory_used(ctx);

    if (used > limit || bytes > limit - used)
        return pell_error(ctx, PELL_ERR_NOMEM, name, "raise the limit memory-bytes if the machine has more",
                          "reading it takes %llu bytes more, which exceeds the memory limit of %llu bytes", (unsigned long long) bytes,
                          (unsigned long long) limit);
    return PELL_OK;
}

void pell_image_make_finite(struct pell_context *ctx, const char *name, float *values, size_t count)
{
    size_t nan = 0, inf = 0;

    for (size_t i = 0; i < count; i++) {
        if (isfinite(values[i]))
            continue;
        if (isnan(values[i])) {
            values[i] = 0;
            nan++;
        } else {
            values[i] = values[i] > 0 ? PELL_HALF_MAX : -PELL_HALF_MAX;
            inf++;
        }
    }
    if (nan || inf)
        pell_warn(ctx, name, NULL, "%zu values are not a number and were read as 0, %zu are infinite and were read as +-%g", nan, inf,
                  (double) PELL_HALF_MAX);
}

/* --- Which format ------------------------------------------------------------------------------------------------------------- */

struct format {
    const char *title;
    size_t offset, length; /* of the mark */
    const char *mark;
    /* NULL: known, not read */
    enum pell_result (*decode)(struct pell_context *ctx, const struct pell_source *src, struct pell_image *image);
};

static const struct format formats[] = {
    { "PNG", 0, 8, "\x89PNG\r\n\x1a\n", pell_png_decode },
    { "JPEG", 0, 3, "\xff\xd8\xff", pell_jpeg_decode },
    { "OpenEXR", 0, 4, "\x76\x2f\x31\x01", pell_exr_decode },
    { "Radiance HDR", 0, 2, "#?", pell_hdr_decode },
    { "PFM", 0, 3, "PF\n", pell_pfm_decode },
    { "PFM", 0, 3, "Pf\n", pell_pfm_decode },
    { "PFM", 0, 4, "PF\r\n", pell_pfm_decode },
    { "PFM", 0, 4, "Pf\r\n", pell_pfm_decode },
    { "PFM", 0, 3, "PF ", pell_pfm_decode },
    { "PFM", 0, 3, "Pf ", pell_pfm_decode },
    { "KTX2 (Basis Universal)", 0, 7, "\xabKTX 20", NULL },
    { "KTX", 0, 7, "\xabKTX 11", NULL },
    { "DDS", 0, 4, "DDS ", NULL },
    { "WebP", 8, 4, "WEBP", NULL },
    { "GIF", 0, 4, "GIF8", NULL },
    { "TIFF", 0, 4, "II*\0", NULL },
    { "TIFF", 0, 4, "MM\0*", NULL },
    { "Photoshop", 0, 4, "8BPS", NULL },
    { "AVIF or HEIC", 4, 4, "ftyp", NULL },
    { "JPEG XL", 0, 2, "\xff\x0a", NULL },
    { "JPEG XL", 4, 4, "JXL ", NULL },
    { "JPEG 2000", 4, 4, "jP  ", NULL },
    { "JPEG 2000", 0, 4, "\xff\x4f\xff\x51", NULL },
    { "PGM", 0, 2, "P5", NULL },
    { "PPM", 0, 2, "P6", NULL },
    { "BMP", 0, 2, "BM", NULL },
};

enum pell_result pell_image_decode(struct pell_context *ctx, const char *name, const void *data, size_t size, enum pell_image_role role,
                                   struct pell_image *image)
{
    const struct pell_source src = { name, data, size, role };
    enum pell_result res = PELL_ERR_UNSUPPORTED;

    *image = (struct pell_image) { 0 };
    if (!data || size == 0)
        return pell_error(ctx, PELL_ERR_FORMAT, name, NULL, "the file is empty, must be a PNG, JPEG, Radiance HDR, OpenEXR or PFM picture");
    for (size_t i = 0; i < PELL_COUNT(formats); i++) {
        const struct format *f = &formats[i];
        if (size < f->offset + f->length || memcmp(src.data + f->offset, f->mark, f->length) != 0)
            continue;
        if (!f->decode)
            return pell_error(ctx, PELL_ERR_UNSUPPORTED, name, "convert it to PNG, JPEG or OpenEXR",
                              "%s pictures are not read; PNG, JPEG, Radiance HDR, OpenEXR and PFM are", f->title);
        res = f->decode(ctx, &src, image);
        if (res == PELL_OK)
            image->srgb = role != PELL_ROLE_DATA && image->type != PELL_PIXEL_F32;
        else
            pell_image_finish(ctx, image);
        return res;
    }
    return pell_error(ctx, PELL_ERR_FORMAT, name, "convert it to PNG, JPEG or OpenEXR",
                      "the first bytes (%02x %02x %02x %02x) are not those of a PNG, JPEG, Radiance HDR, OpenEXR or PFM picture",
                      src.data[0], size > 1 ? src.data[1] : 0, size > 2 ? src.data[2] : 0, size > 3 ? src.data[3] : 0);
}

enum pell_result pell_image_read(struct pell_context *ctx, const char *path, enum pell_image_role role, struct pell_image *image)
{
    enum pell_result res;
    uint8_t *data = NULL;
    size_t size = 0;

    *image = (struct pell_image) { 0 };
    PELL_TRY(pell_file_read(ctx, path, &data, &size));
    PELL_TRY(pell_image_decode(ctx, path, data, size, role, image));
fail:
    pell_free(ctx, data);
    return res;
}

/* --- Conversion --------------------------------------------------------------------------------------------------------------- */

static void convert_u8(const struct pell_image *image, float *out, size_t count)
{
    const uint8_t *in = image->pixels;
    const int alpha = image->channels == 2 || image->channels == 4 ? image->channels - 1 : -1;

    for (size_t i = 0; i < count; i += (size_t) image->channels)
        for (int c = 0; c < image->channels; c++)
            out[i + (size_t) c] = image->srgb && c != alpha ? pell_srgb_u8[in[i + (size_t) c]] : (float) in[i + (size_t) c] / 255.0f;
}

static void convert_u16(const struct pell_image *image, float *out, size_t count)
{
    const uint16_t *in = image->pixels;
    const int alpha = image->channels == 2 || image->channels == 4 ? image->channels - 1 : -1;

    for (size_t i = 0; i < count; i += (size_t) image->channels)
        for (int c = 0; c < image->channels; c++)
            out[i + (size_t) c] =
                image->srgb && c != alpha ? pell_srgb_decode_u16(in[i + (size_t) c]) : (float) in[i + (size_t) c] / 65535.0f;
}

enum pell_result pell_image_to_float(struct pell_context *ctx, struct pell_image *image)
{
    const size_t count = (size_t) image->width * (size_t) image->height * (size_t) image->channels;
    float *out;

    if (image->type == PELL_PIXEL_F32)
        return PELL_OK;
    out = pell_alloc_array(ctx, count, sizeof(*out));
    if (!out)
        return PELL_ERR_NOMEM;
    if (image->type == PELL_PIXEL_U8)
        convert_u8(image, out, count);
    else
        convert_u16(image, out, count);
    pell_free(ctx, image->pixels);
    image->pixels = out;
    image->type = PELL_PIXEL_F32;
    image->srgb = false;
    return PELL_OK;
}

void pell_image_finish(struct pell_context *ctx, struct pell_image *image)
{
    if (!image)
        return;
    pell_free(ctx, image->pixels);
    *image = (struct pell_image) { 0 };
}
