/* SPDX-License-Identifier: MIT
 * exr_header.c - checks the attributes of an OpenEXR file before the library reads them: the library continues with default values if the
 * size of one is wrong. */
#include "image/formats.h"

#include <string.h>

enum { MAX_NAME = 255, FLAG_PARTS = 0x1000 };

struct cursor {
    struct pell_context *ctx;
    const struct pell_source *src;
    size_t at;
};

static enum pell_result wrong(const struct cursor *w, const char *what)
{
    return pell_error(w->ctx, PELL_ERR_FORMAT, w->src->name, "the file is damaged: write it again", "OpenEXR: byte %zu: %s", w->at, what);
}

/* Reads a zero-terminated text into `text`; false if it is not terminated. */
static bool read_text(struct cursor *w, char text[MAX_NAME + 1])
{
    const size_t got = pell_source_read(w->src, w->at, text, MAX_NAME + 1);
    const char *end = memchr(text, 0, got);

    w->at += end ? (size_t) (end - text) + 1 : 0;
    return end;
}

/* Reads one attribute; *last: it was the end of the header instead. */
static enum pell_result read_attribute(struct cursor *w, bool *last)
{
    const size_t first = w->at;
    char name[MAX_NAME + 1], type[MAX_NAME + 1], shown[64];
    const bool named = read_text(w, name);
    uint8_t b[4];
    int32_t size;

    *last = named && !*name;
    if (*last)
        return PELL_OK;
    if (!named || !read_text(w, type) || !*type || pell_source_read(w->src, w->at, b, 4) < 4) {
        w->at = first;
        return wrong(w, "there is no attribute with a name, a type and a size, nor the end of the header");
    }
    size = (int32_t) ((uint32_t) b[0] | (uint32_t) b[1] << 8 | (uint32_t) b[2] << 16 | (uint32_t) b[3] << 24);
    if (size < 0 || (size_t) size > w->src->size - w->at - 4)
        return pell_error(w->ctx, PELL_ERR_FORMAT, w->src->name, "the file is damaged: write it again",
                          "OpenEXR: byte %zu: attribute \"%s\" has %d bytes, must be in [0, %zu]: so many are left", w->at,
                          pell_printable(name, shown, sizeof(shown)), size, w->src->size - w->at - 4);
    w->at += 4 + (size_t) size;
    return PELL_OK;
}

enum pell_result pell_exr_check_header(struct pell_context *ctx, const struct pell_source *src)
{
    struct cursor w = { ctx, src, 8 };
    const int64_t limit = pell_context_limits(ctx)->items;
    bool parts, last = false, first = true;
    enum pell_result res;
    int64_t count = 0;
    uint8_t b[8];

    if (pell_source_read(src, 0, b, sizeof(b)) < sizeof(b))
        return PELL_OK; /* the library reports the error */
    parts = (b[5] & (FLAG_PARTS >> 8)) != 0;
    /* Each part's header ends with an empty name; another one follows the last of several parts. */
    do {
        res = read_attribute(&w, &last);
        if (res != PELL_OK || (last && (!parts || first)))
            return res;
        first = last;
        if (++count > limit)
            return pell_error(ctx, PELL_ERR_INVALID, src->name, PELL_RAISE_LIMIT("items") ", if this file is meant",
                              "OpenEXR: the header has more than %lld attributes", (long long) limit);
    } while (w.at < src->size);
    return wrong(&w, "the header does not end");
}
