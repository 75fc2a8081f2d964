/* SPDX-License-Identifier: MIT
 * exr_header.c - walks over the attributes of an OpenEXR file before the library reads them: the library goes on with values of its own
 * where the size of one is wrong. */
#include "image/formats.h"

#include <string.h>

enum { NAME_MOST = 255, FLAG_PARTS = 0x1000 };

struct walk {
    struct pell_context *ctx;
    const struct pell_source *src;
    size_t at;
};

static enum pell_result wrong(const struct walk *w, const char *what)
{
    return pell_error(w->ctx, PELL_ERR_FORMAT, w->src->name, "the file is damaged: write it again", "OpenEXR: byte %zu: %s", w->at, what);
}

/* A text that a zero ends; NULL where there is none. */
static const char *read_text(struct walk *w)
{
    const char *text = (const char *) w->src->data + w->at;
    const size_t left = w->src->size - w->at, most = left < NAME_MOST + 1 ? left : NAME_MOST + 1;
    const char *end = memchr(text, 0, most);

    if (end)
        w->at += (size_t) (end - text) + 1;
    return end ? text : NULL;
}

/* One attribute; *last: in place of one stood the end of the header. */
static enum pell_result read_attribute(struct walk *w, bool *last)
{
    const size_t first = w->at;
    const char *name = read_text(w), *type;
    const uint8_t *b;
    char shown[64];
    int32_t size;

    *last = name && !*name;
    if (*last)
        return PELL_OK;
    type = name ? read_text(w) : NULL;
    if (!type || !*type || w->src->size - w->at < 4) {
        w->at = first;
        return wrong(w, "there is no attribute with a name, a type and a size, nor the end of the header");
    }
    b = w->src->data + w->at;
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
    struct walk w = { ctx, src, 8 };
    bool parts, last = false, first = true;
    enum pell_result res;

    if (src->size < 8)
        return PELL_OK; /* the library says it */
    parts = (src->data[5] & (FLAG_PARTS >> 8)) != 0;
    /* Each part's header ends with an empty name; behind the last one of several parts stands another. */
    do {
        res = read_attribute(&w, &last);
        if (res != PELL_OK || (last && (!parts || first)))
            return res;
        first = last;
    } while (w.at < src->size);
    return wrong(&w, "the header does not end");
}
