/* SPDX-License-Identifier: MIT
 * report.c - report.html: one file that holds its pictures as linear light and needs nothing but a browser.
 *
 * A picture is three planes of half floats. Of each row the differences from pixel to pixel are kept (halves of one sign rise with their
 * bits), high bytes first, then low bytes, deflated (zlib) and in base64. report/light.js reads them back. */
#include "cli/compare/compare.h"

#include "base/file.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <zlib.h>

#define BASE64 4096 /* letters of one write; whole groups of 4 */

/* Made by report/embed.py of report.html, report.css and the scripts: the page up to its title, from there to its data, and the rest. */
extern const char report_page_head[], report_page_body[], report_page_end[];

struct report {
    struct pell_context *ctx;
    int width, height;        /* of the pictures that are compared */
    int factor, across, down; /* pixels of theirs to one here, along a side; and the size here */
    FILE *stream;             /* grows `data` */
    char *data;
    size_t size;
    float *plane;            /* one, reduced */
    uint8_t *bytes, *packed; /* of one picture */
    size_t packed_size;
    int count; /* of pictures and maps */
};

/* --- Text --------------------------------------------------------------------------------------------------------------------- */

static void put_base64(FILE *f, const uint8_t *bytes, size_t size)
{
    static const char letters[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    char line[BASE64];
    size_t n = 0;

    for (size_t i = 0; i < size; i += 3) {
        const unsigned left = (unsigned) (size - i < 3 ? size - i : 3);
        const unsigned v = (unsigned) bytes[i] << 16 | (left > 1 ? (unsigned) bytes[i + 1] << 8 : 0) | (left > 2 ? bytes[i + 2] : 0);
        line[n++] = letters[v >> 18];
        line[n++] = letters[v >> 12 & 63];
        line[n++] = left > 1 ? letters[v >> 6 & 63] : '=';
        line[n++] = left > 2 ? letters[v & 63] : '=';
        if (n == sizeof(line) || i + 3 >= size) {
            fwrite(line, 1, n, f);
            n = 0;
        }
    }
}

/* Text as HTML shows it. */
static void put_text(FILE *f, const char *text)
{
    for (; *text; text++)
        if (strchr("<>&\"'", *text))
            fprintf(f, "&#%d;", *text);
        else
            fputc(*text, f);
}

/* JSON inside of a script element: no letter of it may end the element, or begin a comment there. All such stand in texts. */
static void put_json(FILE *f, const char *text)
{
    for (; *text; text++)
        if (strchr("<>&", *text))
            fprintf(f, "\\u%04x", (unsigned) *text);
        else
            fputc(*text, f);
}

/* --- Pictures ----------------------------------------------------------------------------------------------------------------- */

/* The nearest half, of two the even one; no number becomes 0, what is too large the largest. */
static uint16_t half_of(float v)
{
    uint32_t bits, sign, a;

    if (isnan(v))
        return 0;
    memcpy(&bits, &v, sizeof(bits));
    sign = bits >> 16 & 0x8000;
    a = bits & 0x7fffffff;
    if (a >= 0x477fe000) /* 65504 and more */
        return (uint16_t) (sign | 0x7bff);
    if (a < 0x38800000) { /* under 2^-14: steps of 2^-24 */
        const float steps = fabsf(v) * 16777216.0f;
        uint32_t whole = (uint32_t) steps;
        const float rest = steps - (float) whole;
        whole += rest > 0.5f || (rest == 0.5f && (whole & 1));
        return (uint16_t) (sign | whole);
    }
    a += 0xfff + (a >> 13 & 1);
    return (uint16_t) (sign | ((a >> 13) - (112 << 10)));
}

/* Means of factor x factor pixels, of fewer at the right and lower border. What is no number counts as 0. */
static void reduce(const struct report *r, const float *plane, ptrdiff_t stride)
{
    for (int y = 0; y < r->down; y++)
        for (int x = 0; x < r->across; x++) {
            const int x0 = x * r->factor, y0 = y * r->factor;
            const int x1 = x0 + r->factor < r->width ? x0 + r->factor : r->width;
            const int y1 = y0 + r->factor < r->height ? y0 + r->factor : r->height;
            double sum = 0.0;
            for (int v = y0; v < y1; v++)
                for (int u = x0; u < x1; u++)
                    sum += isfinite(plane[v * stride + u]) ? (double) plane[v * stride + u] : 0.0;
            r->plane[(size_t) y * (size_t) r->across + (size_t) x] = (float) (sum / ((double) (x1 - x0) * (y1 - y0)));
        }
}

static enum pell_result put_packed(struct report *r, size_t size, json_t **id)
{
    uLongf packed = (uLongf) r->packed_size;
    char name[24];

    if (compress2(r->packed, &packed, r->bytes, (uLong) size, 6) != Z_OK)
        return PELL_ERR_NOMEM;
    snprintf(name, sizeof(name), "data-%d", r->count++);
    fprintf(r->stream, "<script type=\"application/octet-stream\" id=\"%s\">", name);
    put_base64(r->stream, r->packed, packed);
    fputs("</script>\n", r->stream);
    *id = json_string(name);
    return pell_cancelled(r->ctx) ? PELL_ERR_CANCELLED : PELL_OK;
}

enum pell_result report_image(struct report *r, const float *const rgb[3], ptrdiff_t stride, json_t **id)
{
    const size_t all = (size_t) r->across * (size_t) r->down;

    for (size_t c = 0; c < 3; c++) {
        uint8_t *high = r->bytes + 2 * c * all, *low = high + all;
        uint16_t above = 0;
        reduce(r, rgb[c], stride);
        for (int y = 0; y < r->down; y++) {
            uint16_t last = above;
            for (int x = 0; x < r->across; x++) {
                const size_t at = (size_t) y * (size_t) r->across + (size_t) x;
                const uint16_t h = half_of(r->plane[at]), step = (uint16_t) (h - last);
                above = x == 0 ? h : above;
                last = h;
                high[at] = (uint8_t) (step >> 8);
                low[at] = (uint8_t) step;
            }
        }
    }
    return put_packed(r, 6 * all, id);
}

enum pell_result report_map(struct report *r, const float *map, ptrdiff_t stride, json_t **id)
{
    const size_t all = (size_t) r->across * (size_t) r->down;
    uint8_t above = 0;

    reduce(r, map, stride);
    for (int y = 0; y < r->down; y++) {
        uint8_t last = above;
        for (int x = 0; x < r->across; x++) {
            const size_t at = (size_t) y * (size_t) r->across + (size_t) x;
            const float v = r->plane[at];
            const uint8_t b = (uint8_t) ((v > 0.0f ? v < 1.0f ? v : 1.0f : 0.0f) * 255.0f + 0.5f);
            r->bytes[at] = (uint8_t) (b - last);
            above = x == 0 ? b : above;
            last = b;
        }
    }
    return put_packed(r, all, id);
}

json_t *report_view(struct report *r, const char *id, const char *title, const char *text, const struct pell_compare_input *in,
                    const struct pell_compare_params *params, const struct pell_comparison *result)
{
    static const char *const curves[] = { "reinhard", "aces", "linear" };
    const struct pell_metrics *m = in->mask ? &result->masked : &result->whole;
    json_t *mask = json_null(), *o;

    if (in->mask && report_map(r, in->mask, in->stride, &mask) != PELL_OK)
        return NULL;
    o = json_pack("{s:s,s:s,s:s,s:o,s:s,s:f,s:f,s:I}", "id", id, "title", title, "text", text, "mask", mask, "tonemap",
                  in->display ? "linear" : curves[params->tonemap], "floor", m->floor, "ppd", (double) params->ppd, "pixels",
                  (json_int_t) m->pixels);
    if (o)
        compare_add_shown(o, result, in->display);
    return o;
}

/* --- The page ----------------------------------------------------------------------------------------------------------------- */

enum pell_result report_open(struct pell_context *ctx, int width, int height, struct report **out)
{
    struct report *r = *out = pell_zalloc(ctx, sizeof(*r));
    size_t all;

    if (!r)
        return PELL_ERR_NOMEM;
    r->ctx = ctx;
    r->width = width;
    r->height = height;
    do {
        r->factor++;
        r->across = (width + r->factor - 1) / r->factor;
        r->down = (height + r->factor - 1) / r->factor;
    } while ((int64_t) r->across * r->down > REPORT_PIXELS);
    all = (size_t) r->across * (size_t) r->down;
    r->packed_size = compressBound((uLong) (6 * all));
    r->plane = pell_alloc_array(ctx, all, sizeof(float));
    r->bytes = pell_alloc_array(ctx, all, 6);
    r->packed = pell_alloc(ctx, r->packed_size);
    r->stream = open_memstream(&r->data, &r->size);
    if (r->plane && r->bytes && r->packed && r->stream)
        return PELL_OK;
    report_close(out);
    return PELL_ERR_NOMEM;
}

/* 256 colours as one text of hexadecimal digits. */
static json_t *colors(void (*color)(float, float *), bool signed_map)
{
    char text[256 * 6 + 1];

    for (int i = 0; i < 256; i++) {
        const float u = (float) i / 255.0f;
        float srgb[3];
        color(signed_map ? 2.0f * u - 1.0f : u, srgb);
        for (int c = 0; c < 3; c++)
            snprintf(text + 6 * i + 2 * c, 3, "%02x", (unsigned) (srgb[c] * 255.0f + 0.5f));
    }
    return json_string(text);
}

enum pell_result report_page(struct report *r, json_t *data, char **page, size_t *size)
{
    char *text;
    const char *title = json_string_value(json_object_get(data, "title"));
    FILE *f;
    enum pell_result res = PELL_ERR_NOMEM;

    *page = NULL;
    *size = 0;
    json_object_set_new(data, "version", json_string(pell_version_string()));
    json_object_set_new(data, "size",
                        json_pack("{s:i,s:i,s:i,s:i,s:i}", "width", r->width, "height", r->height, "factor", r->factor, "across", r->across,
                                  "down", r->down));
    json_object_set_new(data, "colors",
                        json_pack("{s:o,s:o}", "flip", colors(pell_color_magma, false), "signed", colors(pell_color_diverging, true)));
    text = json_dumps(data, JSON_COMPACT | JSON_ENSURE_ASCII | JSON_REAL_PRECISION(9));
    f = text && fflush(r->stream) == 0 ? open_memstream(page, size) : NULL;
    if (f) {
        fputs(report_page_head, f);
        put_text(f, title ? title : "");
        fputs(report_page_body, f);
        fwrite(r->data, 1, r->size, f);
        fputs("<script type=\"application/json\" id=\"data\">", f);
        put_json(f, text);
        fputs("</script>\n", f);
        fputs(report_page_end, f);
        res = ferror(f) || fclose(f) != 0 ? PELL_ERR_NOMEM : PELL_OK;
    }
    free(text);
    if (res != PELL_OK) {
        free(*page);
        *page = NULL;
    }
    return res;
}

enum pell_result report_write(struct report *r, json_t *data, const char *path)
{
    char *page;
    size_t size;
    enum pell_result res = report_page(r, data, &page, &size);

    if (res == PELL_OK)
        res = pell_file_write(r->ctx, path, page, size);
    free(page);
    return res;
}

void report_close(struct report **report)
{
    struct report *r = *report;

    if (!r)
        return;
    *report = NULL;
    if (r->stream)
        fclose(r->stream);
    free(r->data);
    pell_free(r->ctx, r->plane);
    pell_free(r->ctx, r->bytes);
    pell_free(r->ctx, r->packed);
    pell_free(r->ctx, r);
}
