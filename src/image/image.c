/* SPDX-License-Identifier: MIT
 * image.c - images in memory. */
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
        return pell_error(ctx, PELL_ERR_FORMAT, name, NULL, "the image is %lld x %lld pixels, must be 1 x 1 or more", (long long) width,
                          (long long) height);
    if (width > INT_MAX || height > INT_MAX || width > limit / height)
        return pell_error(ctx, PELL_ERR_INVALID, name, "make it smaller, or " PELL_RAISE_LIMIT("image-pixels"),
                          "the image is %lld x %lld pixels, the limit is %lld pixels", (long long) width, (long long) height,
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
        .width = (int) width,
        .height = (int) height,
        .channels = channels,
        .type = type,
        .pixels = pixels,
    };
    return PELL_OK;
}

enum pell_result pell_image_check_memory(struct pell_context *ctx, const char *name, uint64_t bytes)
{
    const uint64_t limit = (uint64_t) pell_context_limits(ctx)->memory_bytes, used = pell_memory_used(ctx);

    if (used > limit || bytes > limit - used)
        return pell_error(ctx, PELL_ERR_NOMEM, name, PELL_RAISE_LIMIT("memory-bytes") ", if the machine has more",
                          "reading it takes %llu bytes more, which exceeds the memory limit of %llu bytes", (unsigned long long) bytes,
                          (unsigned long long) limit);
    return PELL_OK;
}

void pell_image_replace_not_finite(float *values, size_t count, struct pell_not_finite *bad)
{
    for (size_t i = 0; i < count; i++) {
        if (isfinite(values[i]))
            continue;
        if (isnan(values[i])) {
            values[i] = 0;
            bad->nan++;
        } else {
            values[i] = values[i] > 0 ? PELL_HALF_MAX : -PELL_HALF_MAX;
            bad->inf++;
        }
    }
}

void pell_image_warn_not_finite(struct pell_context *ctx, const char *name, const struct pell_not_finite *bad)
{
    const char *nan = "values are not a number and were", *inf = "are infinite and were";
    struct pell_text text = { 0 };

    if (bad->nan)
        pell_text_add(&text, "%s read as 0", pell_counted((long long) bad->nan, "value is not a number and was", nan).str);
    if (bad->inf)
        pell_text_add(&text, "%s%s read as +-%g", bad->nan ? ", " : "",
                      pell_counted((long long) bad->inf, bad->nan ? "is infinite and was" : "value is infinite and was",
                                   bad->nan ? inf : "values are infinite and were")
                          .str,
                      (double) PELL_HALF_MAX);
    if (text.str[0])
        pell_warn(ctx, name, NULL, "%s", text.str);
}

void pell_image_make_finite(struct pell_context *ctx, const char *name, float *values, size_t count)
{
    struct pell_not_finite bad = { 0 };

    pell_image_replace_not_finite(values, count, &bad);
    pell_image_warn_not_finite(ctx, name, &bad);
}

/* --- Conversion --------------------------------------------------------------------------------------------------------------- */

static void convert_u8(const struct pell_image *image, const uint8_t *in, float *out, size_t count)
{
    const int alpha = image->channels == 2 || image->channels == 4 ? image->channels - 1 : -1;

    for (size_t i = 0; i < count; i += (size_t) image->channels)
        for (int c = 0; c < image->channels; c++)
            out[i + (size_t) c] = image->srgb && c != alpha ? pell_srgb_u8[in[i + (size_t) c]] : (float) in[i + (size_t) c] / 255.0f;
}

static void convert_u16(const struct pell_image *image, const uint16_t *in, float *out, size_t count)
{
    const int alpha = image->channels == 2 || image->channels == 4 ? image->channels - 1 : -1;

    for (size_t i = 0; i < count; i += (size_t) image->channels)
        for (int c = 0; c < image->channels; c++)
            out[i + (size_t) c] =
                image->srgb && c != alpha ? pell_srgb_decode_u16(in[i + (size_t) c]) : (float) in[i + (size_t) c] / 65535.0f;
}

void pell_image_convert(const struct pell_image *layout, const void *in, float *out, size_t count)
{
    switch (layout->type) {
    case PELL_PIXEL_U8: convert_u8(layout, in, out, count); break;
    case PELL_PIXEL_U16: convert_u16(layout, in, out, count); break;
    case PELL_PIXEL_F32: memcpy(out, in, count * sizeof(*out)); break;
    }
}

enum pell_result pell_image_to_float(struct pell_context *ctx, struct pell_image *image)
{
    if (!ctx || !image)
        return pell_null(ctx, "pell_image_to_float");

    const size_t count = (size_t) image->width * (size_t) image->height * (size_t) image->channels;
    float *out;

    if (image->type == PELL_PIXEL_F32)
        return PELL_OK;
    out = pell_alloc_array(ctx, count, sizeof(*out));
    if (!out)
        return PELL_ERR_NOMEM;
    pell_image_convert(image, image->pixels, out, count);
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
