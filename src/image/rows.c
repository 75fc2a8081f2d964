/* SPDX-License-Identifier: MIT
 * rows.c - see rows.h: dispatches to the formats that can be read in pieces, and decodes the others when opened. */
#include "image/rows.h"

#include <string.h>

/* --- Decoded when opened ---------------------------------------------------------------------------------------------------------- */

struct whole {
    struct pell_image image;
    float *line;
};

static enum pell_result whole_read(struct pell_rows *rows, int first, int count, float *const *dest, size_t stride)
{
    const struct whole *w = rows->state;
    const size_t channels = (size_t) w->image.channels, width = (size_t) w->image.width;
    const size_t row = width * channels * pell_pixel_size(w->image.type);

    for (int y = first; y < first + count; y++) {
        pell_image_convert(&w->image, (const uint8_t *) w->image.pixels + (size_t) y * row, w->line, width * channels);
        for (size_t c = 0; c < channels; c++)
            for (size_t x = 0; x < width && dest[c]; x++)
                dest[c][(size_t) (y - first) * stride + x] = w->line[x * channels + c];
    }
    return PELL_OK;
}

static void whole_close(struct pell_rows *rows)
{
    struct whole *w = rows->state;

    if (!w)
        return;
    pell_image_finish(rows->ctx, &w->image);
    pell_free(rows->ctx, w->line);
    pell_free(rows->ctx, w);
}

static const struct pell_rows_format whole_format = { whole_read, whole_close };

static enum pell_result open_whole(struct pell_rows *rows)
{
    struct whole *w = rows->state = pell_calloc(rows->ctx, 1, sizeof(*w));
    enum pell_result res;

    if (!w)
        return PELL_ERR_NOMEM;
    rows->format = &whole_format;
    PELL_TRY(rows->src.data ? pell_image_decode(rows->ctx, rows->src.name, rows->src.data, rows->src.size, PELL_ROLE_RAW, &w->image)
                            : pell_image_read(rows->ctx, rows->src.name, PELL_ROLE_RAW, &w->image));
    PELL_TRY(pell_rows_layout(rows, w->image.width, w->image.height, w->image.channels));
    rows->display = w->image.type != PELL_PIXEL_F32;
    w->line = pell_alloc_array(rows->ctx, (size_t) w->image.width, (size_t) w->image.channels * sizeof(float));
    res = w->line ? PELL_OK : PELL_ERR_NOMEM;
fail:
    return res;
}

/* --- All ------------------------------------------------------------------------------------------------------------------------- */

static struct pell_rows *new_rows(struct pell_context *ctx)
{
    struct pell_rows *rows = pell_calloc(ctx, 1, sizeof(*rows));

    if (!rows)
        return NULL;
    rows->ctx = ctx;
    rows->file.handle = -1;
    rows->chunk = 1;
    return rows;
}

static enum pell_result open_source(struct pell_rows *rows)
{
    uint8_t head[16];
    const size_t got = pell_source_read(&rows->src, 0, head, sizeof(head));
    enum pell_result (*set_up)(struct pell_rows *) = pell_image_rows_of(head, got);
    enum pell_result res = PELL_OK;

    if (set_up)
        PELL_TRY(set_up(rows));
    if (!rows->format)
        PELL_TRY(open_whole(rows));
fail:
    return res;
}

enum pell_result pell_rows_open(struct pell_context *ctx, const char *path, struct pell_rows **out)
{
    struct pell_rows *rows = *out = new_rows(ctx);
    enum pell_result res;

    if (!rows)
        return PELL_ERR_NOMEM;
    PELL_TRY(pell_file_open(ctx, path, &rows->file));
    rows->src = (struct pell_source) { .name = path, .size = rows->file.size, .role = PELL_ROLE_RAW, .file = &rows->file };
    PELL_TRY(open_source(rows));
    return PELL_OK;
fail:
    pell_rows_close(out);
    return res;
}

enum pell_result pell_rows_open_memory(struct pell_context *ctx, const char *name, const void *data, size_t size, struct pell_rows **out)
{
    struct pell_rows *rows = *out = new_rows(ctx);
    enum pell_result res;

    if (!rows)
        return PELL_ERR_NOMEM;
    rows->src = (struct pell_source) { .name = name, .data = data, .size = size, .role = PELL_ROLE_RAW };
    PELL_TRY(open_source(rows));
    return PELL_OK;
fail:
    pell_rows_close(out);
    return res;
}

enum pell_result pell_rows_read(struct pell_rows *rows, int first, int count, float *const *dest, size_t stride)
{
    if (pell_cancelled(rows->ctx))
        return PELL_ERR_CANCELLED;
    if (first < 0 || count < 0 || count > rows->layers.height - first || stride < (size_t) rows->layers.width)
        return pell_error(rows->ctx, PELL_ERR_INVALID, rows->src.name, NULL, "%d rows from row %d on are asked for, there are %d", count,
                          first, rows->layers.height);
    return rows->format->read(rows, first, count, dest, stride);
}

void pell_rows_close(struct pell_rows **rows)
{
    struct pell_rows *r = *rows;

    *rows = NULL;
    if (!r)
        return;
    if (r->format)
        r->format->close(r);
    pell_layers_finish(r->ctx, &r->layers);
    pell_file_close(&r->file);
    pell_free(r->ctx, r);
}
