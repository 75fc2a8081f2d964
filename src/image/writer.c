/* SPDX-License-Identifier: MIT
 *
 * writer.c - the growing buffer of a file being written, and access to rows of pixels.
 */
#include "image/formats.h"

#include <math.h>
#include <string.h>

enum pell_result pell_writer_reserve(struct pell_writer *w, size_t at, size_t size)
{
    size_t end, capacity = w->capacity ? w->capacity : 65536;
    uint8_t *grown;

    if (__builtin_add_overflow(at, size, &end) || end > SIZE_MAX / 2)
        return pell_error(w->ctx, PELL_ERR_NOMEM, w->name, NULL, "a file of %zu + %zu bytes can't be made", at, size);
    if (end > w->capacity) {
        while (capacity < end)
            capacity *= 2;
        grown = pell_realloc_array(w->ctx, w->data, capacity, 1);
        if (!grown)
            return PELL_ERR_NOMEM;
        w->data = grown;
        w->capacity = capacity;
    }
    if (end > w->size) {
        memset(w->data + w->size, 0, end - w->size);
        w->size = end;
    }
    return PELL_OK;
}

enum pell_result pell_writer_append(struct pell_writer *w, const void *bytes, size_t size)
{
    const size_t at = w->size;
    enum pell_result res;

    if (size == 0)
        return PELL_OK;
    res = pell_writer_reserve(w, at, size);
    if (res == PELL_OK)
        memcpy(w->data + at, bytes, size);
    return res;
}

void pell_writer_row(struct pell_writer *w, size_t channel, int y, float *out, size_t step)
{
    const struct pell_channel *c = &w->params->channels[channel];
    const float *in = c->data + (ptrdiff_t) y * c->stride;

    for (int x = 0; x < w->params->width; x++) {
        const bool finite = isfinite(in[x]);
        out[(size_t) x * step] = finite ? in[x] : 0.0f;
        w->bad += !finite;
    }
}
