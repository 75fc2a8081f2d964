/* SPDX-License-Identifier: MIT
 * source.c - reads from files in memory and from files read in pieces. */
#include "image/rows.h"

#include <string.h>

size_t pell_source_read(const struct pell_source *src, uint64_t at, void *to, size_t size)
{
    if (!src->data)
        return src->file ? pell_file_read_at(src->file, at, to, size) : 0;
    if (at >= src->size)
        return 0;
    size = size < src->size - at ? size : src->size - (size_t) at;
    memcpy(to, src->data + at, size);
    return size;
}

enum pell_result pell_rows_layout(struct pell_rows *rows, int width, int height, int channels)
{
    static const char *const names[4] = { "R", "G", "B", "A" }, *const grey[2] = { "Y", "A" };
    struct pell_layers *l = &rows->layers;

    l->width = width;
    l->height = height;
    l->layers = pell_calloc(rows->ctx, (size_t) channels, sizeof(*l->layers));
    if (!l->layers)
        return PELL_ERR_NOMEM;
    for (; l->count < (size_t) channels; l->count++)
        if (!(l->layers[l->count].name = pell_strdup(rows->ctx, channels > 2 ? names[l->count] : grey[l->count])))
            return PELL_ERR_NOMEM;
    return PELL_OK;
}
