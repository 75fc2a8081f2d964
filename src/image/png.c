/* SPDX-License-Identifier: MIT
 * png.c - PNG (ISO/IEC 15948) through libspng: all colour types and depths in, 8 and 16 bit grey, RGB and RGBA out. */
#include "image/color.h"
#include "image/rows.h"

#include <math.h>
#include <string.h>

#include <spng.h>

/* Zlib expands by at most 1032 : 1, so a small file can't be a large image. */
#define DEFLATE_MAX 1032

#define CHUNK_CACHE ((size_t) 64 << 20) /* for text and profiles, which are skipped; at least the largest chunk */

static enum pell_result png_error(struct pell_context *ctx, const char *name, const char *what, int err)
{
    if (err == SPNG_IO_ERROR) /* a writer that could not grow has reported it */
        return PELL_ERR_NOMEM;
    return pell_error(ctx, err == SPNG_EMEM ? PELL_ERR_NOMEM : PELL_ERR_FORMAT, name,
                      err == SPNG_EMEM ? NULL : "the file is damaged: write it again", "PNG: %s: %s", what, spng_strerror(err));
}

/* An open file with a checked header, and the layout of its pixels. */
struct png {
    struct pell_context *ctx;
    const struct pell_source *src;
    spng_ctx *spng;
    uint64_t at; /* read position, for a file that is read in pieces */
    struct spng_ihdr ihdr;
    bool trns;
    int channels, format;
    enum pell_pixel_type type;
};

static int read_bytes(spng_ctx *spng, void *user, void *to, size_t size)
{
    struct png *png = user;
    const size_t got = pell_source_read(png->src, png->at, to, size);

    (void) spng;
    png->at += got;
    return got == size ? 0 : SPNG_IO_EOF;
}

static int64_t number_at(const uint8_t *p)
{
    return (int64_t) p[0] << 24 | p[1] << 16 | p[2] << 8 | p[3];
}

/* Chooses the narrowest layout for the file's pixels, and the matching spng format. */
static void choose_layout(const struct spng_ihdr *ihdr, bool trns, int *channels, int *fmt)
{
    const bool wide = ihdr->bit_depth == 16;

    switch (ihdr->color_type) {
    case SPNG_COLOR_TYPE_GRAYSCALE:
        *channels = trns ? 2 : 1;
        *fmt = wide ? (trns ? SPNG_FMT_GA16 : SPNG_FMT_PNG) : (trns ? SPNG_FMT_GA8 : SPNG_FMT_G8);
        break;
    case SPNG_COLOR_TYPE_GRAYSCALE_ALPHA:
        *channels = 2;
        *fmt = SPNG_FMT_PNG;
        break;
    case SPNG_COLOR_TYPE_TRUECOLOR_ALPHA:
        *channels = 4;
        *fmt = SPNG_FMT_PNG;
        break;
    default: /* RGB or palette */
        *channels = trns ? 4 : 3;
        *fmt = wide ? (trns ? SPNG_FMT_RGBA16 : SPNG_FMT_PNG) : (trns ? SPNG_FMT_RGBA8 : SPNG_FMT_RGB8);
        break;
    }
}

/* `png` with its context and source. */
static enum pell_result png_open(struct png *png)
{
    struct pell_context *ctx = png->ctx;
    const struct pell_source *src = png->src;
    struct spng_trns trns;
    const size_t chunk = src->size < INT32_MAX ? src->size : INT32_MAX;
    uint8_t head[24];
    size_t raw;
    int err;
    enum pell_result res;

    png->at = 0;
    png->spng = spng_ctx_new(0);
    if (!png->spng)
        return pell_error(ctx, PELL_ERR_NOMEM, src->name, NULL, "out of memory: PNG reader");
    /* We check the size ourselves, from the bytes, with a message that gives the limit. No chunk can be longer than the file. */
    if (pell_source_read(src, 0, head, sizeof(head)) == sizeof(head) && memcmp(head + 12, "IHDR", 4) == 0)
        PELL_TRY(pell_image_check_size(ctx, src->name, number_at(head + 16), number_at(head + 20)));
    if ((err = spng_set_image_limits(png->spng, INT32_MAX, INT32_MAX)) ||
        (err = spng_set_chunk_limits(png->spng, chunk, chunk > CHUNK_CACHE ? chunk : CHUNK_CACHE)) ||
        (err = src->data ? spng_set_png_buffer(png->spng, src->data, src->size) : spng_set_png_stream(png->spng, read_bytes, png)) ||
        (err = spng_get_ihdr(png->spng, &png->ihdr)) || (err = spng_decoded_image_size(png->spng, SPNG_FMT_RAW, &raw)))
        return png_error(ctx, src->name, "header", err);
    if (raw / DEFLATE_MAX > src->size)
        return pell_error(ctx, PELL_ERR_FORMAT, src->name, "the file is damaged: write it again",
                          "PNG: a file of %zu bytes can't hold %u x %u pixels", src->size, png->ihdr.width, png->ihdr.height);
    err = spng_get_trns(png->spng, &trns);
    if (err && err != SPNG_ECHUNKAVAIL)
        return png_error(ctx, src->name, "before the image", err);
    png->trns = err == 0;
    choose_layout(&png->ihdr, png->trns, &png->channels, &png->format);
    png->type = png->ihdr.bit_depth == 16 ? PELL_PIXEL_U16 : PELL_PIXEL_U8;
    if ((err = spng_decoded_image_size(png->spng, png->format, &raw)))
        return png_error(ctx, src->name, "header", err);
    if (raw != (size_t) png->ihdr.width * png->ihdr.height * (size_t) png->channels * pell_pixel_size(png->type))
        return pell_error(ctx, PELL_ERR_UNSUPPORTED, src->name, "write it as 8 bit RGBA", "PNG: colour type %u with %u bits is not read",
                          png->ihdr.color_type, png->ihdr.bit_depth);
    return PELL_OK;
fail:
    return res;
}

/* spng checks the checksum of the last data chunk only when the reader continues past it. */
static enum pell_result png_end(struct png *png)
{
    const int err = spng_decode_chunks(png->spng);
    return err ? png_error(png->ctx, png->src->name, "its end is missing or damaged", err) : PELL_OK;
}

enum pell_result pell_png_decode(struct pell_context *ctx, const struct pell_source *src, struct pell_image *image)
{
    struct png png = { .ctx = ctx, .src = src };
    enum pell_result res;
    size_t bytes;
    int err;

    PELL_TRY(png_open(&png));
    PELL_TRY(pell_image_make(ctx, src->name, png.ihdr.width, png.ihdr.height, png.channels, png.type, image));
    bytes = (size_t) image->width * (size_t) image->height * (size_t) png.channels * pell_pixel_size(png.type);
    err = spng_decode_image(png.spng, image->pixels, bytes, png.format, png.trns ? SPNG_DECODE_TRNS : 0);
    res = err ? png_error(ctx, src->name, "image data", err) : png_end(&png);
fail:
    spng_ctx_free(png.spng);
    return res;
}

/* --- Row by row --------------------------------------------------------------------------------------------------------------- */

struct row_reader {
    struct png png;
    int next; /* next row */
    uint8_t *row;
    float *line;
};

static enum pell_result start(struct row_reader *r)
{
    enum pell_result res;
    int err;

    spng_ctx_free(r->png.spng);
    PELL_TRY(png_open(&r->png));
    r->next = 0;
    err = spng_decode_image(r->png.spng, NULL, 0, r->png.format, (r->png.trns ? SPNG_DECODE_TRNS : 0) | SPNG_DECODE_PROGRESSIVE);
    res = err ? png_error(r->png.ctx, r->png.src->name, "image data", err) : PELL_OK;
fail:
    return res;
}

static enum pell_result next_row(struct row_reader *r)
{
    const size_t size = (size_t) r->png.ihdr.width * (size_t) r->png.channels * pell_pixel_size(r->png.type);
    const bool last = ++r->next == (int) r->png.ihdr.height;
    const int err = spng_decode_row(r->png.spng, r->row, size);

    if (err && !(last && err == SPNG_EOI))
        return png_error(r->png.ctx, r->png.src->name, "image data", err);
    return last ? png_end(&r->png) : PELL_OK;
}

static enum pell_result png_read_rows(struct pell_rows *rows, int first, int count, float *const *dest, size_t stride)
{
    struct row_reader *r = rows->state;
    const struct pell_image layout = { .channels = r->png.channels, .type = r->png.type, .srgb = true };
    const size_t channels = (size_t) r->png.channels, width = r->png.ihdr.width;
    enum pell_result res;

    if (first < r->next)
        PELL_TRY(start(r));
    while (r->next < first)
        PELL_TRY(next_row(r));
    for (int y = 0; y < count; y++) {
        PELL_TRY(next_row(r));
        pell_image_convert(&layout, r->row, r->line, width * channels);
        for (size_t c = 0; c < channels; c++)
            for (size_t x = 0; x < width && dest[c]; x++)
                dest[c][(size_t) y * stride + x] = r->line[x * channels + c];
    }
    return PELL_OK;
fail:
    r->next = INT32_MAX; /* force a restart */
    return res;
}

static void png_close_rows(struct pell_rows *rows)
{
    struct row_reader *r = rows->state;

    if (!r)
        return;
    spng_ctx_free(r->png.spng);
    pell_free(rows->ctx, r->row);
    pell_free(rows->ctx, r->line);
    pell_free(rows->ctx, r);
    rows->state = NULL;
}

static const struct pell_rows_format png_rows = { png_read_rows, png_close_rows };

enum pell_result pell_png_rows(struct pell_rows *rows)
{
    struct row_reader *r = rows->state = pell_calloc(rows->ctx, 1, sizeof(*r));
    enum pell_result res;

    if (!r)
        return PELL_ERR_NOMEM;
    rows->format = &png_rows;
    r->png.ctx = rows->ctx;
    r->png.src = &rows->src;
    PELL_TRY(start(r));
    if (r->png.ihdr.interlace_method != SPNG_INTERLACE_NONE) {
        png_close_rows(rows);
        rows->format = NULL;
        return PELL_OK;
    }
    PELL_TRY(pell_rows_layout(rows, (int) r->png.ihdr.width, (int) r->png.ihdr.height, r->png.channels));
    rows->display = true;
    r->row = pell_alloc_array(rows->ctx, r->png.ihdr.width, (size_t) r->png.channels * pell_pixel_size(r->png.type));
    r->line = pell_alloc_array(rows->ctx, r->png.ihdr.width, (size_t) r->png.channels * sizeof(float));
    res = r->row && r->line ? PELL_OK : PELL_ERR_NOMEM;
fail:
    return res;
}

/* --- Writing ------------------------------------------------------------------------------------------------------------------ */

/* Linear interpolation of the sRGB curve in steps of 1/64 of a power of two: the error is at most 8e-6, which is 1/500 of an 8-bit step. */
#define STEPS 64
#define LOWEST (-9) /* 2^-9 is below the start of the linear segment */
struct curve {
    float at[-LOWEST * STEPS + 2];
};

static void make_curve(struct curve *curve)
{
    for (int i = 0; i < -LOWEST * STEPS + 2; i++)
        curve->at[i] = pell_srgb_encode(ldexpf(1.0f + (float) (i % STEPS) / STEPS, i / STEPS + LOWEST));
}

static inline float encode8(const struct curve *curve, float x)
{
    uint32_t bits;
    int i;

    if (!(x > 0.0031308f))
        return x > 0 ? x * 12.92f : 0;
    if (x >= 1.0f)
        return 1.0f;
    memcpy(&bits, &x, sizeof(bits));
    i = (int) (bits >> 17) - ((127 + LOWEST) << 6);
    return curve->at[i] + (float) (bits & 0x1ffff) * (1.0f / 131072.0f) * (curve->at[i + 1] - curve->at[i]);
}

static double encode16(float x)
{
    if (!(x > 0.0031308f))
        return x > 0 ? (double) x * 12.92 : 0;
    return x >= 1.0f ? 1.0 : 1.055 * pow((double) x, 1 / 2.4) - 0.055;
}

/* The 8 x 8 ordered dither of Bayer (1973) as an offset of less than half a step, mean 0: bit-reversed interleave of x ^ y and y. A value
 * exactly on a step is unchanged. */
static void make_dither(float dither[8][8])
{
    for (int y = 0; y < 8; y++)
        for (int x = 0; x < 8; x++) {
            int v = 0;
            for (int bit = 0; bit < 3; bit++)
                v |= (((x ^ y) >> bit) & 1) << (5 - 2 * bit) | ((y >> bit) & 1) << (4 - 2 * bit);
            dither[y][x] = ((float) v + 0.5f) / 64.0f - 0.5f;
        }
}

static int write_bytes(spng_ctx *png, void *user, void *bytes, size_t size)
{
    (void) png;
    return pell_writer_append(user, bytes, size) == PELL_OK ? 0 : SPNG_IO_ERROR;
}

static enum pell_result set_text(struct pell_writer *w, spng_ctx *png, struct spng_text *text)
{
    const struct pell_write_params *p = w->params;
    static const char nothing[] = "";
    int err;

    for (size_t i = 0; i < p->num_attributes; i++) {
        const char *name = p->attributes[i].name, *value = p->attributes[i].value;
        struct spng_text *t = &text[i];
        const size_t length = strlen(name);

        if (length < 1 || length > 79)
            return pell_error(w->ctx, PELL_ERR_INVALID, w->name, NULL,
                              "PNG: the attribute name \"%.80s\" has %zu characters, must be 1 to 79", name, length);
        memcpy(t->keyword, name, length + 1);
        t->type = SPNG_TEXT;
        for (const char *c = value; *c; c++)
            if ((unsigned char) *c >= 0x80)
                t->type = SPNG_ITXT; /* tEXt is Latin-1 */
        t->length = strlen(value);
        t->text = (char *) (uintptr_t) value; /* only read */
        t->language_tag = t->translated_keyword = (char *) (uintptr_t) nothing;
    }
    if (p->num_attributes && (err = spng_set_text(png, text, (uint32_t) p->num_attributes)))
        return pell_error(w->ctx, PELL_ERR_INVALID, w->name, NULL, "PNG: the attributes can't be written: %s", spng_strerror(err));
    return PELL_OK;
}

static void fill_row(struct pell_writer *w, int channels, int y, float *values, const struct curve *curve, float dither[8], uint8_t *row)
{
    const size_t count = (size_t) w->params->width * (size_t) channels;
    const int alpha = channels == 4 ? 3 : -1;
    size_t x = 0;

    for (int c = 0; c < channels; c++)
        pell_writer_row(w, (size_t) c, y, values + c, (size_t) channels);
    for (size_t i = 0; i < count; x++)
        for (int c = 0; c < channels; c++, i++) {
            const float v = values[i] > 0 ? values[i] < 1 ? values[i] : 1 : 0;
            if (w->params->png_bits == 16) {
                const double code = (c == alpha ? (double) v : encode16(v)) * 65535 + 0.5 + (double) dither[x & 7];
                ((uint16_t *) (void *) row)[i] = (uint16_t) code;
            } else {
                row[i] = (uint8_t) ((c == alpha ? v : encode8(curve, v)) * 255.0f + 0.5f + dither[x & 7]);
            }
        }
}

enum pell_result pell_png_encode(struct pell_writer *w)
{
    const struct pell_write_params *p = w->params;
    const int channels = p->num_channels < 3                                                                   ? 1
                         : p->num_channels > 3 && p->channels[3].name && strcmp(p->channels[3].name, "A") == 0 ? 4
                                                                                                               : 3;
    const int bits = p->png_bits == 16 ? 16 : 8;
    const size_t count = (size_t) p->width * (size_t) channels;
    struct spng_ihdr ihdr = { .width = (uint32_t) p->width, .height = (uint32_t) p->height, .bit_depth = (uint8_t) bits };
    struct spng_text *text = NULL;
    struct curve curve;
    float dither[8][8], *values = NULL;
    uint8_t *row = NULL;
    enum pell_result res = PELL_ERR_NOMEM;
    int err;
    spng_ctx *png = spng_ctx_new(SPNG_CTX_ENCODER);

    if (!png)
        return pell_error(w->ctx, PELL_ERR_NOMEM, w->name, NULL, "out of memory: PNG writer");
    values = pell_alloc_array(w->ctx, count, sizeof(*values));
    row = pell_alloc_array(w->ctx, count, (size_t) bits / 8);
    text = pell_calloc(w->ctx, p->num_attributes, sizeof(*text));
    if (!values || !row || !text)
        goto fail;
    ihdr.color_type = channels == 1   ? SPNG_COLOR_TYPE_GRAYSCALE
                      : channels == 3 ? SPNG_COLOR_TYPE_TRUECOLOR
                                      : SPNG_COLOR_TYPE_TRUECOLOR_ALPHA;
    PELL_TRY(set_text(w, png, text));
    make_curve(&curve);
    make_dither(dither);
    /* Level 4 with the two cheap filters: half the time of the defaults for a file a few per cent larger. */
    if ((err = spng_set_png_stream(png, write_bytes, w)) || (err = spng_set_option(png, SPNG_IMG_COMPRESSION_LEVEL, 4)) ||
        (err = spng_set_option(png, SPNG_FILTER_CHOICE, SPNG_FILTER_CHOICE_SUB | SPNG_FILTER_CHOICE_UP)) ||
        (err = spng_set_ihdr(png, &ihdr)) || (err = spng_set_srgb(png, 0)) ||
        (err = spng_encode_image(png, NULL, 0, SPNG_FMT_PNG, SPNG_ENCODE_PROGRESSIVE | SPNG_ENCODE_FINALIZE))) {
        res = png_error(w->ctx, w->name, "header", err);
        goto fail;
    }
    for (int y = 0; y < p->height; y++) {
        fill_row(w, channels, y, values, &curve, dither[y & 7], row);
        err = spng_encode_row(png, row, count * (size_t) bits / 8);
        if (err && err != SPNG_EOI) {
            res = png_error(w->ctx, w->name, "image data", err);
            goto fail;
        }
        if (pell_cancelled(w->ctx)) {
            res = PELL_ERR_CANCELLED;
            goto fail;
        }
    }
    res = PELL_OK;
fail:
    spng_ctx_free(png);
    pell_free(w->ctx, text);
    pell_free(w->ctx, row);
    pell_free(w->ctx, values);
    return res;
}
