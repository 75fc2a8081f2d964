/* SPDX-License-Identifier: MIT
 * pfm.c - portable float map: "PF" or "Pf", width height, a scale whose sign says the byte order, rows from the bottom up. */
#include "image/formats.h"

#include <stdio.h>
#include <string.h>

static bool blank(uint8_t c)
{
    return c == ' ' || c == '\t' || c == '\r' || c == '\n';
}

/* The next word of the header, of at most 31 characters; moves *at behind it. NULL if there is none. */
static const char *word(const struct pell_source *src, size_t *at, char buffer[32])
{
    size_t length = 0;

    while (*at < src->size && blank(src->data[*at]))
        (*at)++;
    while (*at < src->size && !blank(src->data[*at])) {
        if (length == 31)
            return NULL;
        buffer[length++] = (char) src->data[(*at)++];
    }
    buffer[length] = '\0';
    return length ? buffer : NULL;
}

static enum pell_result bad_header(struct pell_context *ctx, const struct pell_source *src, const char *what)
{
    return pell_error(ctx, PELL_ERR_FORMAT, src->name, NULL, "PFM: the header's %s is missing or not a number", what);
}

enum pell_result pell_pfm_decode(struct pell_context *ctx, const struct pell_source *src, struct pell_image *image)
{
    const int channels = src->data[1] == 'F' ? 3 : 1;
    size_t at = 2, row, needed;
    int64_t size[2];
    double scale;
    enum pell_result res;
    char buffer[32];
    float *out;

    for (int i = 0; i < 2; i++)
        if (!word(src, &at, buffer) || !pell_parse_int(buffer, strlen(buffer), &size[i]))
            return bad_header(ctx, src, i ? "height" : "width");
    if (!word(src, &at, buffer) || !pell_parse_number(buffer, strlen(buffer), &scale) || scale == 0 || at == src->size)
        return bad_header(ctx, src, "scale (not 0)");
    at++; /* exactly one blank ends the header, "\r\n" apart */
    if (src->data[at - 1] == '\r' && at < src->size && src->data[at] == '\n')
        at++;
    res = pell_image_check_size(ctx, src->name, size[0], size[1]);
    if (res != PELL_OK)
        return res;
    row = (size_t) size[0] * (size_t) channels;
    needed = row * 4 * (size_t) size[1];
    if (src->size - at < needed)
        return pell_error(ctx, PELL_ERR_FORMAT, src->name, "the file is damaged: write it again",
                          "PFM: %zu bytes of pixels, must be %zu for %lld x %lld pixels", src->size - at, needed, (long long) size[0],
                          (long long) size[1]);
    if (scale != 1 && scale != -1)
        pell_warn(ctx, src->name, NULL, "PFM: the scale is %g; only its sign is used", scale);
    res = pell_image_make(ctx, src->name, size[0], size[1], channels, PELL_PIXEL_F32, image);
    if (res != PELL_OK)
        return res;
    out = image->pixels;
    for (int y = 0; y < image->height; y++) {
        const uint8_t *in = src->data + at + row * 4 * (size_t) (image->height - 1 - y);
        for (size_t i = 0; i < row; i++, in += 4) {
            const uint32_t bits = scale < 0 ? (uint32_t) in[0] | (uint32_t) in[1] << 8 | (uint32_t) in[2] << 16 | (uint32_t) in[3] << 24
                                            : (uint32_t) in[3] | (uint32_t) in[2] << 8 | (uint32_t) in[1] << 16 | (uint32_t) in[0] << 24;
            memcpy(&out[(size_t) y * row + i], &bits, 4);
        }
    }
    if (src->role != PELL_ROLE_RAW)
        pell_image_make_finite(ctx, src->name, out, row * (size_t) image->height);
    return PELL_OK;
}

enum pell_result pell_pfm_encode(struct pell_writer *w)
{
    const struct pell_write_params *p = w->params;
    const int channels = p->num_channels < 3 ? 1 : 3;
    const size_t row = (size_t) p->width * (size_t) channels;
    float *values = pell_alloc_array(w->ctx, row, sizeof(*values));
    enum pell_result res = PELL_ERR_NOMEM;
    char header[64];
    size_t at;

    if (!values)
        return res;
    snprintf(header, sizeof(header), "%s\n%d %d\n-1.0\n", channels == 3 ? "PF" : "Pf", p->width, p->height);
    PELL_TRY(pell_writer_append(w, header, strlen(header)));
    at = w->size;
    PELL_TRY(pell_writer_reserve(w, at, row * 4 * (size_t) p->height));
    for (int y = p->height - 1; y >= 0; y--) {
        for (int c = 0; c < channels; c++)
            pell_writer_row(w, (size_t) c, y, values + c, (size_t) channels);
        for (size_t i = 0; i < row; i++, at += 4) {
            uint32_t bits;
            memcpy(&bits, &values[i], 4);
            for (int byte = 0; byte < 4; byte++)
                w->data[at + (size_t) byte] = (uint8_t) (bits >> (8 * byte));
        }
    }
fail:
    pell_free(w->ctx, values);
    return res;
}
