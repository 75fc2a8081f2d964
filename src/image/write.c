/* SPDX-License-Identifier: MIT
 * write.c - writes an image in the format of its file extension; the file is built in memory and then replaces the old one. */
#include "image/formats.h"

#include "base/file.h"

#include <math.h>
#include <string.h>

static const char *const formats[] = { "png", "exr", "hdr", "pfm" };
static enum pell_result (*const encoders[])(struct pell_writer *w) = { pell_png_encode, pell_exr_encode, pell_hdr_encode, pell_pfm_encode };
_Static_assert(PELL_COUNT(formats) == PELL_COUNT(encoders), "one encoder per format");

size_t pell_write_format_count(void)
{
    return PELL_COUNT(formats);
}

const char *pell_write_format_at(size_t index)
{
    return index < PELL_COUNT(formats) ? formats[index] : NULL;
}

static enum pell_result check(struct pell_context *ctx, const char *name, const struct pell_write_params *p)
{
    const int64_t limit = pell_context_limits(ctx)->image_pixels;

    if (p->width < 1 || p->height < 1 || p->width > limit / p->height)
        return pell_error(ctx, PELL_ERR_INVALID, name, PELL_RAISE_LIMIT("image-pixels"),
                          "an image of %d x %d pixels can't be written, must be 1 x 1 or more and at most %lld pixels", p->width, p->height,
                          (long long) limit);
    if (!p->channels || p->num_channels < 1)
        return pell_error(ctx, PELL_ERR_INVALID, name, NULL, "an image without channels can't be written");
    for (size_t i = 0; i < p->num_channels; i++)
        if (!p->channels[i].data)
            return pell_error(ctx, PELL_ERR_INVALID, name, NULL, "channel %zu (\"%s\") has no data", i,
                              p->channels[i].name ? p->channels[i].name : "");
    for (size_t i = 0; i < p->num_attributes; i++)
        if (!p->attributes || !p->attributes[i].name || !p->attributes[i].value)
            return pell_error(ctx, PELL_ERR_INVALID, name, NULL, "attribute %zu has no name or no value", i);
    if (p->png_bits != 0 && p->png_bits != 8 && p->png_bits != 16)
        return pell_error(ctx, PELL_ERR_INVALID, name, NULL, "png_bits = %d, must be 8 or 16", p->png_bits);
    if ((int) p->compression < PELL_EXR_PIZ || (int) p->compression > PELL_EXR_NONE)
        return pell_error(ctx, PELL_ERR_INVALID, name, NULL, "compression = %d is not one of enum pell_exr_compression",
                          (int) p->compression);
    return PELL_OK;
}

static enum pell_result find_format(struct pell_context *ctx, const char *path, const char *format, size_t *index)
{
    const size_t count = PELL_COUNT(encoders);
    const char *dot = strrchr(pell_path_name(path), '.'), *given = format ? format : dot ? dot + 1 : "";
    struct pell_text hint = { "" };
    char shown[64];

    for (size_t i = 0; i < count; i++)
        if (format ? strcmp(format, formats[i]) == 0 : pell_path_has_extension(path, formats[i])) {
            *index = i;
            return PELL_OK;
        }
    if (!format && strcmp(path, "-") == 0)
        return pell_error(ctx, PELL_ERR_INVALID, path, NULL, "standard output needs a format: png, exr, hdr or pfm");
    pell_text_suggest(&hint, "", given, formats, count);
    return pell_error(ctx, PELL_ERR_INVALID, path, hint.str, "images of format \"%s\" are not written, must be png, exr, hdr or pfm",
                      pell_printable(given, shown, sizeof(shown)));
}

enum pell_result pell_image_write(struct pell_context *ctx, const char *path, const char *format, const struct pell_write_params *params)
{
    if (!ctx || !path || !params)
        return pell_null(ctx, "pell_image_write");

    struct pell_writer w = { .ctx = ctx, .name = path, .params = params };
    enum pell_result res;
    size_t index = 0;

    PELL_TRY(find_format(ctx, path, format, &index));
    PELL_TRY(check(ctx, path, params));
    PELL_TRY(encoders[index](&w));
    if (w.bad)
        pell_warn(
            ctx, path, NULL, "%s written as 0",
            pell_counted((long long) w.bad, "value is not a number or infinite and was", "values are not a number or infinite and were")
                .str);
    if (w.clamped)
        pell_warn(ctx, path, NULL, "%s written as its nearest value",
                  pell_counted((long long) w.clamped, "value is out of the format's range and was",
                               "values are out of the format's range and were")
                      .str);
    PELL_TRY(pell_file_write(ctx, path, w.data, w.size));
fail:
    pell_free(ctx, w.data);
    return res;
}
