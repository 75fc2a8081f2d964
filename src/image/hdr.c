/* SPDX-License-Identifier: MIT
 * hdr.c - Radiance HDR images (G. Ward, "Real Pixels", Graphics Gems II, 1991): RGBE, flat, old and new run lengths, the eight orders of
 * rows and columns, EXPOSURE and COLORCORR. A pixel is mantissa 2^(exponent - 136); 0 stays 0. */
#include "image/rows.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#define HEADER_LINE 2047 /* characters of one header line */

struct reader {
    struct pell_context *ctx;
    const struct pell_source *src;
    size_t at;
    float scale[3]; /* factors of the pixels, from EXPOSURE and COLORCORR */
    bool flip[2];   /* whether the major and the minor axis are reversed */
    bool columns;   /* scanlines are columns: X is the major axis */
    int length[2];  /* number of scanlines, and pixels per scanline */
};

static enum pell_result damaged(struct reader *r, const char *what)
{
    return pell_error(r->ctx, PELL_ERR_FORMAT, r->src->name, "the file is damaged: write it again", "Radiance HDR: %s at byte %zu of %zu",
                      what, r->at, r->src->size);
}

/* The next header line without its end; false if the file ends in it or it is too long. */
static bool next_line(struct reader *r, char line[HEADER_LINE + 1])
{
    size_t length = 0;

    while (r->at < r->src->size && length < HEADER_LINE) {
        const char c = (char) r->src->data[r->at++];
        if (c == '\n') {
            if (length && line[length - 1] == '\r')
                length--;
            line[length] = '\0';
            return true;
        }
        line[length++] = c;
    }
    return false;
}

/* Parses up to 3 numbers separated by blanks; returns how many, -1 if one is invalid. */
static int parse_numbers(const char *text, double out[3])
{
    int count = 0;

    for (;;) {
        size_t length;
        text += strspn(text, " \t");
        length = strcspn(text, " \t");
        if (length == 0)
            return count;
        if (count == 3 || !pell_parse_number(text, length, &out[count]))
            return -1;
        count++;
        text += length;
    }
}

static enum pell_result read_header(struct reader *r)
{
    char line[HEADER_LINE + 1], shown[80];
    double v[3];

    r->scale[0] = r->scale[1] = r->scale[2] = 1.0f;
    if (!next_line(r, line))
        return damaged(r, "the header does not end");
    for (;;) {
        if (!next_line(r, line))
            return damaged(r, "the header does not end");
        if (line[0] == '\0')
            return PELL_OK;
        if (strncmp(line, "FORMAT=", 7) == 0) {
            const char *format = line + 7 + strspn(line + 7, " \t");
            if (strcmp(format, "32-bit_rle_xyze") == 0)
                return pell_error(r->ctx, PELL_ERR_UNSUPPORTED, r->src->name, "convert it with ra_xyze -r",
                                  "Radiance HDR: pixels in CIE XYZ (32-bit_rle_xyze) are not read, must be 32-bit_rle_rgbe");
            if (strcmp(format, "32-bit_rle_rgbe") != 0)
                return pell_error(r->ctx, PELL_ERR_UNSUPPORTED, r->src->name, NULL,
                                  "Radiance HDR: FORMAT is \"%s\", must be 32-bit_rle_rgbe", pell_printable(format, shown, sizeof(shown)));
        } else if (strncmp(line, "EXPOSURE=", 9) == 0 || strncmp(line, "COLORCORR=", 10) == 0) {
            /* Both give factors that the pixels were multiplied by, and accumulate. */
            const bool exposure = line[0] == 'E';
            const int count = parse_numbers(line + (exposure ? 9 : 10), v);
            if (count != (exposure ? 1 : 3))
                return pell_error(r->ctx, PELL_ERR_FORMAT, r->src->name, NULL, "Radiance HDR: \"%s\" must hold %d numbers",
                                  pell_printable(line, shown, sizeof(shown)), exposure ? 1 : 3);
            for (int c = 0; c < 3; c++) {
                r->scale[c] = (float) ((double) r->scale[c] / v[exposure ? 0 : c]);
                if (!(r->scale[c] > 1e-30f && r->scale[c] < 1e30f))
                    return pell_error(r->ctx, PELL_ERR_FORMAT, r->src->name, NULL,
                                      "Radiance HDR: the product of EXPOSURE and COLORCORR leaves (1e-30, 1e30) at \"%s\"",
                                      pell_printable(line, shown, sizeof(shown)));
            }
        }
    }
}

/* "-Y 32 +X 64": the major axis first; -Y is top to bottom, +X left to right. */
static enum pell_result read_resolution(struct reader *r)
{
    char line[HEADER_LINE + 1], shown[80];
    const char *p = line;
    char axis[2];
    enum pell_result res;

    if (!next_line(r, line))
        return damaged(r, "there is no line with the size");
    for (int i = 0; i < 2; i++) {
        int64_t n;
        size_t length;
        p += strspn(p, " \t");
        if ((p[0] != '-' && p[0] != '+') || (p[1] != 'X' && p[1] != 'Y'))
            goto bad;
        axis[i] = p[1];
        r->flip[i] = p[1] == 'Y' ? p[0] == '+' : p[0] == '-';
        p += 2;
        p += strspn(p, " \t");
        length = strcspn(p, " \t");
        if (!pell_parse_int(p, length, &n) || n < 0)
            goto bad;
        if (n > INT32_MAX)
            return pell_image_check_size(r->ctx, r->src->name, n, n);
        r->length[i] = (int) n;
        p += length;
    }
    if (axis[0] == axis[1] || p[strspn(p, " \t")] != '\0')
        goto bad;
    r->columns = axis[0] == 'X';
    res = pell_image_check_size(r->ctx, r->src->name, r->length[!r->columns], r->length[r->columns]);
    if (res != PELL_OK)
        return res;
    /* The densest coding is 4 bytes for 16,843,008 pixels of one scanline, so at least 4 bytes per scanline. */
    if ((size_t) r->length[0] > (r->src->size - r->at) / 4)
        return damaged(r, "fewer bytes follow than the scanlines need");
    return PELL_OK;
bad:
    return pell_error(r->ctx, PELL_ERR_FORMAT, r->src->name, NULL, "Radiance HDR: the size is \"%s\", must be like \"-Y 480 +X 640\"",
                      pell_printable(line, shown, sizeof(shown)));
}

/* Flat pixels, of which (1, 1, 1, n) repeats the previous one n times; consecutive repeats are digits of base 256. */
static enum pell_result read_old_scanline(struct reader *r, uint8_t *rgbe)
{
    const size_t length = (size_t) r->length[1];
    size_t x = 0;
    int shift = 0;

    while (x < length) {
        const uint8_t *p = r->src->data + r->at;
        if (r->src->size - r->at < 4)
            return damaged(r, "the pixels end early");
        if (p[0] == 1 && p[1] == 1 && p[2] == 1) {
            size_t run;
            if (x == 0 || shift > 24)
                return damaged(r, "a run repeats nothing");
            run = (size_t) p[3] << shift;
            if (run > length - x)
                return damaged(r, "a run passes the scanline's end");
            for (; run; run--, x++)
                memcpy(rgbe + 4 * x, rgbe + 4 * (x - 1), 4);
            shift += 8;
        } else {
            memcpy(rgbe + 4 * x++, p, 4);
            shift = 0;
        }
        r->at += 4;
    }
    return PELL_OK;
}

/* Four runs of bytes, one per component: n > 128 repeats the next byte n - 128 times, else n bytes follow. */
static enum pell_result read_new_scanline(struct reader *r, uint8_t *rgbe)
{
    const size_t length = (size_t) r->length[1];
    const uint8_t *d = r->src->data;

    r->at += 4;
    for (size_t c = 0; c < 4; c++)
        for (size_t x = 0; x < length;) {
            size_t n;
            if (r->src->size - r->at < 2)
                return damaged(r, "the pixels end early");
            n = d[r->at++];
            if (n > 128) {
                const uint8_t value = d[r->at++];
                n -= 128;
                if (n > length - x)
                    return damaged(r, "a run passes the scanline's end");
                for (; n; n--)
                    rgbe[4 * x++ + c] = value;
            } else {
                if (n == 0 || n > length - x)
                    return damaged(r, "a run is empty or passes the scanline's end");
                if (r->src->size - r->at < n)
                    return damaged(r, "the pixels end early");
                for (; n; n--)
                    rgbe[4 * x++ + c] = d[r->at++];
            }
        }
    return PELL_OK;
}

static enum pell_result read_scanline(struct reader *r, uint8_t *rgbe)
{
    const uint8_t *p = r->src->data + r->at;
    const int length = r->length[1];

    if (r->src->size - r->at < 4)
        return damaged(r, "the pixels end early");
    if (length < 8 || length > 32767 || p[0] != 2 || p[1] != 2 || p[2] >= 128)
        return read_old_scanline(r, rgbe);
    if ((p[2] << 8 | p[3]) != length)
        return damaged(r, "a scanline has another length than the header says");
    return read_new_scanline(r, rgbe);
}

static void make_powers(float power[256])
{
    power[0] = 0;
    for (int e = 1; e < 256; e++)
        power[e] = ldexpf(1.0f, e - 136);
}

static inline float decoded(const struct reader *r, const uint8_t *rgbe, int c, const float power[256])
{
    return (float) rgbe[c] * power[rgbe[3]] * r->scale[c];
}

/* Stores scanline `i` at its position in the image, as floats. */
static void store_scanline(const struct reader *r, int i, const uint8_t *rgbe, const float power[256], struct pell_image *image)
{
    const int major = r->flip[0] ? r->length[0] - 1 - i : i;
    float *out = image->pixels;

    for (int j = 0; j < r->length[1]; j++, rgbe += 4) {
        const int minor = r->flip[1] ? r->length[1] - 1 - j : j;
        const size_t x = (size_t) (r->columns ? major : minor), y = (size_t) (r->columns ? minor : major);
        float *pixel = out + 3 * (y * (size_t) image->width + x);
        for (int c = 0; c < 3; c++)
            pixel[c] = decoded(r, rgbe, c, power);
    }
}

enum pell_result pell_hdr_decode(struct pell_context *ctx, const struct pell_source *src, struct pell_image *image)
{
    struct reader r = { .ctx = ctx, .src = src };
    enum pell_result res;
    uint8_t *rgbe = NULL;
    float power[256];

    PELL_TRY(read_header(&r));
    PELL_TRY(read_resolution(&r));
    make_powers(power);
    PELL_TRY(pell_image_make(ctx, src->name, r.length[!r.columns], r.length[r.columns], 3, PELL_PIXEL_F32, image));
    rgbe = pell_alloc_array(ctx, (size_t) r.length[1], 4);
    if (!rgbe) {
        res = PELL_ERR_NOMEM;
        goto fail;
    }
    for (int i = 0; i < r.length[0]; i++) {
        PELL_TRY(read_scanline(&r, rgbe));
        store_scanline(&r, i, rgbe, power, image);
    }
    pell_image_make_finite(ctx, src->name, image->pixels, 3 * (size_t) image->width * (size_t) image->height);
fail:
    pell_free(ctx, rgbe);
    return res;
}

/* --- Row by row --------------------------------------------------------------------------------------------------------------- */

struct row_reader {
    struct pell_source src; /* all bytes: they are compressed, and read sequentially */
    uint8_t *data, *rgbe;
    struct reader reader;
    size_t begin;   /* first byte of the pixels */
    int next, seen; /* next row; rows whose values were counted */
    struct pell_not_finite bad;
    float power[256];
};

static enum pell_result hdr_read_rows(struct pell_rows *rows, int first, int count, float *const *dest, size_t stride)
{
    struct row_reader *h = rows->state;
    const int width = rows->layers.width;
    enum pell_result res;

    if (first < h->next) {
        h->reader.at = h->begin;
        h->next = 0;
    }
    while (h->next < first + count) {
        const int y = h->next++;
        struct pell_not_finite bad = { 0 };
        PELL_TRY(read_scanline(&h->reader, h->rgbe));
        for (int c = 0; c < 3 && y >= first; c++) {
            float *row = dest[c] ? dest[c] + (size_t) (y - first) * stride : NULL;
            for (int x = 0; row && x < width; x++)
                row[x] = decoded(&h->reader, h->rgbe + 4 * (h->reader.flip[1] ? width - 1 - x : x), c, h->power);
            if (row)
                pell_image_replace_not_finite(row, (size_t) width, y >= h->seen ? &h->bad : &bad);
        }
        if (y == rows->layers.height - 1 && h->seen <= y)
            pell_image_warn_not_finite(rows->ctx, rows->src.name, &h->bad);
        h->seen = y >= h->seen ? y + 1 : h->seen;
    }
    return PELL_OK;
fail:
    h->next = INT32_MAX; /* force a restart */
    return res;
}

static void hdr_close_rows(struct pell_rows *rows)
{
    struct row_reader *h = rows->state;

    if (!h)
        return;
    pell_free(rows->ctx, h->data);
    pell_free(rows->ctx, h->rgbe);
    pell_free(rows->ctx, h);
    rows->state = NULL;
}

static const struct pell_rows_format hdr_rows = { hdr_read_rows, hdr_close_rows };

enum pell_result pell_hdr_rows(struct pell_rows *rows)
{
    struct row_reader *h = rows->state = pell_calloc(rows->ctx, 1, sizeof(*h));
    enum pell_result res;

    if (!h)
        return PELL_ERR_NOMEM;
    rows->format = &hdr_rows;
    h->src = rows->src;
    h->src.data = h->data = pell_alloc(rows->ctx, rows->src.size);
    if (!h->data)
        return PELL_ERR_NOMEM;
    h->src.size = pell_source_read(&rows->src, 0, h->data, rows->src.size);
    h->reader = (struct reader) { .ctx = rows->ctx, .src = &h->src };
    PELL_TRY(read_header(&h->reader));
    PELL_TRY(read_resolution(&h->reader));
    if (h->reader.columns || h->reader.flip[0]) {
        hdr_close_rows(rows);
        rows->format = NULL;
        return PELL_OK;
    }
    h->begin = h->reader.at;
    make_powers(h->power);
    PELL_TRY(pell_rows_layout(rows, h->reader.length[1], h->reader.length[0], 3));
    h->rgbe = pell_alloc_array(rows->ctx, (size_t) h->reader.length[1], 4);
    res = h->rgbe ? PELL_OK : PELL_ERR_NOMEM;
fail:
    return res;
}

/* --- Writing ------------------------------------------------------------------------------------------------------------------ */

/* The nearest RGBE value; negative numbers become 0, too large ones the largest. */
static void to_rgbe(struct pell_writer *w, const float rgb[3], uint8_t rgbe[4])
{
    float v[3], top = 0;
    int exponent;

    for (int c = 0; c < 3; c++) {
        const float largest = 255.0f * 0x1p119f; /* (255, 255) */
        v[c] = rgb[c] < 0 ? 0 : rgb[c] > largest ? largest : rgb[c];
        w->clamped += rgb[c] != v[c];
        top = v[c] > top ? v[c] : top;
    }
    memset(rgbe, 0, 4);
    frexpf(top, &exponent);
    if (top > 0 && ldexpf(top, 8 - exponent) + 0.5f >= 256.0f) /* rounds up to the next power of two */
        exponent++;
    if (top <= 0 || exponent < -127)
        return;
    for (int c = 0; c < 3; c++)
        rgbe[c] = (uint8_t) (ldexpf(v[c], 8 - exponent) + 0.5f);
    rgbe[3] = (uint8_t) (exponent + 128);
}

/* Run-length encodes one component of a scanline: repeats of 4 and more, else up to 128 literal bytes. `out` has room for 2 * n. */
static size_t encode_runs(const uint8_t *in, size_t n, uint8_t *out)
{
    size_t x = 0, size = 0;

    while (x < n) {
        size_t start = x, run = 0;
        /* the next run of 4 or more */
        while (start < n) {
            for (run = 1; run < 127 && start + run < n && in[start + run] == in[start]; run++) {}
            if (run >= 4)
                break;
            start += run;
        }
        while (x < start) {
            const size_t count = start - x < 128 ? start - x : 128;
            out[size++] = (uint8_t) count;
            memcpy(out + size, in + x, count);
            size += count;
            x += count;
        }
        if (start < n) {
            out[size++] = (uint8_t) (128 + run);
            out[size++] = in[start];
            x = start + run;
        }
    }
    return size;
}

enum pell_result pell_hdr_encode(struct pell_writer *w)
{
    const struct pell_write_params *p = w->params;
    const size_t n = (size_t) p->width;
    const bool runs = p->width >= 8 && p->width <= 32767;
    float *values = pell_alloc_array(w->ctx, n, 3 * sizeof(*values));
    uint8_t *planes = pell_alloc_array(w->ctx, n, 6), *coded = planes ? planes + 4 * n : NULL;
    enum pell_result res = PELL_ERR_NOMEM;
    char head[128];

    if (!values || !planes)
        goto fail;
    snprintf(head, sizeof(head), "#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y %d +X %d\n", p->height, p->width);
    PELL_TRY(pell_writer_append(w, head, strlen(head)));
    for (int y = 0; y < p->height; y++) {
        for (size_t c = 0; c < 3; c++)
            pell_writer_row(w, p->num_channels < 3 ? 0 : c, y, values + c, 3);
        for (size_t x = 0; x < n; x++) {
            uint8_t rgbe[4];
            to_rgbe(w, values + 3 * x, rgbe);
            for (size_t c = 0; c < 4; c++)
                planes[runs ? c * n + x : 4 * x + c] = rgbe[c];
        }
        if (!runs) {
            PELL_TRY(pell_writer_append(w, planes, 4 * n));
            continue;
        }
        PELL_TRY(pell_writer_append(w, (uint8_t[]) { 2, 2, (uint8_t) (n >> 8), (uint8_t) n }, 4));
        for (size_t c = 0; c < 4; c++)
            PELL_TRY(pell_writer_append(w, coded, encode_runs(planes + c * n, n, coded)));
    }
fail:
    pell_free(w->ctx, planes);
    pell_free(w->ctx, values);
    return res;
}
