/* SPDX-License-Identifier: MIT
 * exr_layers.c - all channels of an OpenEXR file, some rows at a time or all at once. */
#include "image/exr.h"
#include "image/rows.h"

#include "base/file.h"

#include <string.h>

/* --- Layers ---------------------------------------------------------------------------------------------------------------------- */

void pell_layers_finish(struct pell_context *ctx, struct pell_layers *layers)
{
    if (!layers)
        return;
    for (size_t i = 0; i < layers->count; i++) {
        pell_free(ctx, layers->layers[i].name);
        pell_free(ctx, layers->layers[i].data);
    }
    for (size_t i = 0; i < layers->num_attributes; i++) {
        pell_free(ctx, layers->attributes[i].name);
        pell_free(ctx, layers->attributes[i].value);
    }
    pell_free(ctx, layers->layers);
    pell_free(ctx, layers->attributes);
    *layers = (struct pell_layers) { 0 };
}

static enum pell_result read_attributes(struct exr_file *f, struct pell_layers *out)
{
    size_t capacity = 0;
    int32_t count = 0;
    enum pell_result res;

    if (exr_get_attribute_count(f->exr, 0, &count) != EXR_ERR_SUCCESS)
        return PELL_OK;
    for (int32_t i = 0; i < count; i++) {
        const exr_attribute_t *a;
        struct pell_layer_attribute *to;
        if (exr_get_attribute_by_index(f->exr, 0, EXR_ATTR_LIST_SORTED_ORDER, i, &a) != EXR_ERR_SUCCESS || a->type != EXR_ATTR_STRING ||
            !a->string || !a->string->str)
            continue;
        res = pell_grow(f->ctx, (void **) &out->attributes, out->num_attributes, &capacity, sizeof(*out->attributes));
        if (res != PELL_OK)
            return res;
        to = &out->attributes[out->num_attributes++];
        to->value = NULL;
        to->name = pell_strdup(f->ctx, a->name);
        if (!to->name || !(to->value = pell_strndup(f->ctx, a->string->str, (size_t) a->string->length)))
            return PELL_ERR_NOMEM;
    }
    return PELL_OK;
}

/* --- Row by row ------------------------------------------------------------------------------------------------------------------ */

struct reader {
    struct exr_file file;
    struct exr_part *parts; /* parts whose channels are concatenated in the layers */
    size_t count;
    float **dest; /* destinations, for the part with the most channels */
};

static enum pell_result name_channels(struct exr_file *f, const struct exr_part *p, const char *prefix, struct pell_layers *out,
                                      size_t *capacity)
{
    enum pell_result res;

    for (int c = 0; c < p->channels->num_channels; c++) {
        struct pell_text name = { "" };
        res = pell_grow(f->ctx, (void **) &out->layers, out->count, capacity, sizeof(*out->layers));
        if (res != PELL_OK)
            return res;
        pell_text_add(&name, "%s%s", prefix, p->channels->entries[c].name.str);
        out->layers[out->count] = (struct pell_layer) { .name = pell_strdup(f->ctx, name.str) };
        if (!out->layers[out->count++].name)
            return PELL_ERR_NOMEM;
    }
    return PELL_OK;
}

static enum pell_result find_parts(struct pell_rows *rows, struct reader *r)
{
    struct exr_file *f = &r->file;
    struct pell_layers *out = &rows->layers;
    enum pell_result res;
    size_t capacity = 0, most = 0;
    int parts = 0;

    if (exr_get_count(f->exr, &parts) != EXR_ERR_SUCCESS || parts < 1)
        return pell_error(f->ctx, PELL_ERR_FORMAT, f->src->name, NULL, "OpenEXR: there is no part");
    if (!(r->parts = pell_calloc(f->ctx, (size_t) parts, sizeof(*r->parts))))
        return PELL_ERR_NOMEM;
    for (int i = 0; i < parts; i++) {
        struct pell_text prefix = { "" };
        struct exr_part *part = &r->parts[i];
        const char *name = NULL;
        int64_t chunk;

        res = pell_exr_describe(f, i, part);
        if (res != PELL_OK)
            return res;
        if (i > 0 && (part->width != out->width || part->height != out->height))
            return pell_error(f->ctx, PELL_ERR_UNSUPPORTED, f->src->name, NULL,
                              "OpenEXR: part %d is %d x %d pixels, must be %d x %d as the first", i, part->width, part->height, out->width,
                              out->height);
        out->width = part->width;
        out->height = part->height;
        if (parts > 1 && exr_get_name(f->exr, i, &name) == EXR_ERR_SUCCESS && name)
            pell_text_add(&prefix, "%s.", name);
        else if (parts > 1)
            pell_text_add(&prefix, "part%d.", i);
        res = name_channels(f, part, prefix.str, out, &capacity);
        if (res != PELL_OK)
            return res;
        most = (size_t) part->channels->num_channels > most ? (size_t) part->channels->num_channels : most;
        chunk = pell_exr_chunk_rows(part);
        rows->chunk = chunk > rows->chunk ? chunk < out->height ? (int) chunk : out->height : rows->chunk;
        r->count++;
    }
    r->dest = pell_calloc(f->ctx, most, sizeof(*r->dest));
    return r->dest ? read_attributes(f, out) : PELL_ERR_NOMEM;
}

static void clear_rows(float *to, int count, int width)
{
    memset(to, 0, (size_t) count * (size_t) width * sizeof(*to));
}

static enum pell_result exr_read_rows(struct pell_rows *rows, int first, int count, float *const *dest, size_t stride)
{
    struct reader *r = rows->state;
    const int width = rows->layers.width;
    enum pell_result res;

    if (stride != (size_t) width)
        return pell_error(rows->ctx, PELL_ERR_INVALID, rows->src.name, NULL, "rows of OpenEXR files stand without padding");
    for (size_t i = 0; i < r->count; dest += r->parts[i++].channels->num_channels) {
        bool wanted = false;
        for (int c = 0; c < r->parts[i].channels->num_channels; c++) {
            r->dest[c] = dest[c];
            wanted = wanted || dest[c];
            if (dest[c])
                clear_rows(dest[c], count, width);
        }
        if (wanted && (res = pell_exr_read_rows(&r->file, &r->parts[i], first, count, r->dest, 1)) != PELL_OK)
            return res;
    }
    return PELL_OK;
}

static void exr_close_rows(struct pell_rows *rows)
{
    struct reader *r = rows->state;

    if (!r)
        return;
    pell_exr_close(&r->file);
    pell_free(rows->ctx, r->parts);
    pell_free(rows->ctx, r->dest);
    pell_free(rows->ctx, r);
    rows->state = NULL;
}

static const struct pell_rows_format exr_rows = { exr_read_rows, exr_close_rows };

enum pell_result pell_exr_rows(struct pell_rows *rows)
{
    struct reader *r = rows->state = pell_calloc(rows->ctx, 1, sizeof(*r));
    enum pell_result res;

    if (!r)
        return PELL_ERR_NOMEM;
    rows->format = &exr_rows;
    rows->layered = true;
    r->file = (struct exr_file) { .ctx = rows->ctx, .src = &rows->src };
    PELL_TRY(pell_exr_open(&r->file));
    PELL_TRY(find_parts(rows, r));
fail:
    return res;
}

/* --- All at once ------------------------------------------------------------------------------------------------------------------ */

enum pell_result pell_exr_decode_layers(struct pell_context *ctx, const struct pell_source *src, struct pell_layers *layers)
{
    struct pell_rows rows = { .ctx = ctx, .src = *src };
    struct pell_layers *all = &rows.layers;
    float **dest = NULL;
    enum pell_result res;

    *layers = (struct pell_layers) { 0 };
    PELL_TRY(pell_exr_rows(&rows));
    res = PELL_ERR_NOMEM;
    if (!(dest = pell_calloc(ctx, all->count, sizeof(*dest))))
        goto fail;
    for (size_t i = 0; i < all->count; i++)
        if (!(dest[i] = all->layers[i].data = pell_alloc_array(ctx, (size_t) all->width * (size_t) all->height, sizeof(float))))
            goto fail;
    PELL_TRY(exr_read_rows(&rows, 0, all->height, dest, (size_t) all->width));
    *layers = *all;
    *all = (struct pell_layers) { 0 };
fail:
    pell_free(ctx, dest);
    exr_close_rows(&rows);
    pell_layers_finish(ctx, all);
    return res;
}

enum pell_result pell_exr_read(struct pell_context *ctx, const char *path, struct pell_layers *layers)
{
    if (!ctx || !path || !layers)
        return pell_null(ctx, "pell_exr_read");

    struct pell_file file;
    enum pell_result res;

    *layers = (struct pell_layers) { 0 };
    PELL_TRY(pell_file_open(ctx, path, &file));
    PELL_TRY(pell_exr_decode_layers(ctx, &(struct pell_source) { .name = path, .size = file.size, .role = PELL_ROLE_RAW, .file = &file },
                                    layers));
fail:
    pell_file_close(&file);
    return res;
}
