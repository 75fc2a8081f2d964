/* SPDX-License-Identifier: MIT
 * pfm.c - portable float map: "PF" or "Pf", width height, a scale whose sign gives the byte order, rows from the bottom up. */
#include "image/rows.h"

#include <stdio.h>
#include <string.h>

static bool blank(uint8_t c)
{
    return c == ' ' || c == '\t' || c == '\r' || c == '\n';
}

/* The next word of the header, of at most 31 characters; moves *at past it. NULL if there is none. */
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

struct header {
    int channels;
    int64_t width, height;
    double scale;
    size_t at; /* first byte of the pixels */
};

/* Returns the name of a missing or invalid field; NULL: the header is valid. */
static const char *read_header(const struct pell_source *src, struct header *h)
{
    static const char *const names[2] = { "width", "height" };
    int64_t size[2];
    size_t at = 2;
    char buffer[32];

    h->channels = src->data[1] == 'F' ? 3 : 1;
    for (int i = 0; i < 2; i++)
        if (!word(src, &at, buffer) || !pell_parse_int(buffer, strlen(buffer), &size[i]))
            return names[i];
    if (!word(src, &at, buffer) || !pell_parse_number(buffer, strlen(buffer), &h->scale) || h->scale == 0 || at == src->size)
        return "scale (not 0)";
    h->at = at + 1; /* exactly one blank ends the header, or "\r\n" */
    if (src->data[at] == '\r' && h->at < src->size && src->data[h->at] == '\n')
        h->at++;
    h->width = size[0];
    h->height = size[1];
    return NULL;
}

/* Checks the image size and the number of bytes; `size`: of the file. */
static enum pell_result check_header(struct pell_context *ctx, const struct pell_source *src, size_t size, const struct header *h)
{
    const enum pell_result res = pell_image_check_size(ctx, src->name, h->width, h->height);
    size_t needed;

    if (res != PELL_OK)
        return res;
    needed = (size_t) h->width * (size_t) h->channels * 4 * (size_t) h->height;
    if (size - h->at < needed)
        return pell_error(ctx, PELL_ERR_FORMAT, src->name, "the file is damaged: write it again",
                          "PFM: %zu bytes of pixels, must be %zu for %lld x %lld pixels", size - h->at, needed, (long long) h->width,
                          (long long) h->height);
    if (h->scale != 1 && h->scale != -1)
        pell_warn(ctx, src->name, NULL, "PFM: the scale is %g; only its sign is used", h->scale);
    return PELL_OK;
}

static inline float value_at(const uint8_t *in, bool little)
{
    const uint32_t bits = little ? (uint32_t) in[0] | (uint32_t) in[1] << 8 | (uint32_t) in[2] << 16 | (uint32_t) in[3] << 24
                                 : (uint32_t) in[3] | (uint32_t) in[2] << 8 | (uint32_t) in[1] << 16 | (uint32_t) in[0] << 24;
    float v;

    memcpy(&v, &bits, sizeof(v));
    return v;
}

enum pell_result pell_pfm_decode(struct pell_context *ctx, const struct pell_source *src, struct pell_image *image)
{
    struct header h;
    const char *wrong = read_header(src, &h);
    enum pell_result res;
    size_t row;
    float *out;

    if (wrong)
        return pell_error(ctx, PELL_ERR_FORMAT, src->name, NULL, "PFM: the header's %s is missing or not a number", wrong);
    if ((res = check_header(ctx, src, src->size, &h)) != PELL_OK ||
        (res = pell_image_make(ctx, src->name, h.width, h.height, h.channels, PELL_PIXEL_F32, image)) != PELL_OK)
        return res;
    out = image->pixels;
    row = (size_t) h.width * (size_t) h.channels;
    for (int y = 0; y < image->height; y++) {
        const uint8_t *in = src->data + h.at + row * 4 * (size_t) (image->height - 1 - y);
        for (size_t i = 0; i < row; i++, in += 4)
            out[(size_t) y * row + i] = value_at(in, h.scale < 0);
    }
    if (src->role != PELL_ROLE_RAW)
        pell_image_make_finite(ctx, src->name, out, row * (size_t) image->height);
    return PELL_OK;
}

/* --- Row by row --------------------------------------------------------------------------------------------------------------- */

struct row_reader {
    struct header header;
    uint8_t *row;
};

static enum pell_result pfm_read_rows(struct pell_rows *rows, int first, int count, float *const *dest, size_t stride)
{
    const struct row_reader *r = rows->state;
    const size_t channels = (size_t) r->header.channels, width = (size_t) r->header.width, size = 4 * width * channels;

    for (int y = first; y < first + count; y++) {
        if (pell_source_read(&rows->src, r->header.at + size * (uint64_t) (r->header.height - 1 - y), r->row, size) != size)
            return pell_error(rows->ctx, PELL_ERR_IO, rows->src.name, "wait until it is written, then try again",
                              "PFM: row %d can't be read any more", y);
        for (size_t c = 0; c < channels; c++)
            for (size_t x = 0; x < width && dest[c]; x++)
                dest[c][(size_t) (y - first) * stride + x] = value_at(r->row + 4 * (x * channels + c), r->header.scale < 0);
    }
    return PELL_OK;
}

static void pfm_close_rows(struct pell_rows *rows)
{
    struct row_reader *r = rows->state;

    if (r)
        pell_free(rows->ctx, r->row);
    pell_free(rows->ctx, r);
    rows->state = NULL;
}

static const struct pell_rows_format pfm_rows = { pfm_read_rows, pfm_close_rows };

enum pell_result pell_pfm_rows(struct pell_rows *rows)
{
    struct row_reader *r;
    struct header header;
    enum pell_result res;
    uint8_t head[256];
    const struct pell_source begin = { .name = rows->src.name, .data = head, .size = pell_source_read(&rows->src, 0, head, sizeof(head)) };

    if (read_header(&begin, &header))
        return PELL_OK; /* a long or damaged header: decoding the whole file reports it */
    rows->state = r = pell_calloc(rows->ctx, 1, sizeof(*r));
    if (!r)
        return PELL_ERR_NOMEM;
    rows->format = &pfm_rows;
    r->header = header;
    PELL_TRY(check_header(rows->ctx, &rows->src, rows->src.size, &header));
    PELL_TRY(pell_rows_layout(rows, (int) header.width, (int) header.height, header.channels));
    r->row = pell_alloc_array(rows->ctx, (size_t) header.width * (size_t) header.channels, 4);
    res = r->row ? PELL_OK : PELL_ERR_NOMEM;
fail:
    return res;
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
