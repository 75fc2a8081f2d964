/* SPDX-License-Identifier: MIT
 * exr_write.c - OpenEXR through OpenEXRCore: one part of scan lines, named half and float channels, text attributes. */
#include "image/formats.h"

#include <stdlib.h>
#include <string.h>

#include <openexr.h>

#define ZIP_LEVEL 4 /* half the time of 6 for a few per cent more bytes */
#define NAME_MAX_LENGTH 255

struct exr_writer {
    struct pell_writer *w;
    exr_context_t exr;
    exr_encode_pipeline_t pipe;
    bool started;
    const struct pell_channel **sorted; /* sorted by name, as EXR requires */
    float *rows;                        /* one chunk, planes one after the other */
    int lines;
    exr_result_t (*compress)(exr_encode_pipeline_t *pipe); /* the library's function */
    char message[200];
};

static int64_t stream_write(exr_const_context_t exr, void *user, const void *buffer, uint64_t size, uint64_t offset,
                            exr_stream_error_func_ptr_t error)
{
    struct pell_writer *w = ((struct exr_writer *) user)->w;

    (void) exr;
    (void) error;
    if (pell_writer_reserve(w, offset, size) != PELL_OK)
        return -1;
    memcpy(w->data + offset, buffer, size);
    return (int64_t) size;
}

static void keep_error(exr_const_context_t exr, exr_result_t code, const char *text)
{
    void *user = NULL;
    struct exr_writer *e;

    (void) code;
    if (exr_get_user_data(exr, &user) != EXR_ERR_SUCCESS || !user)
        return;
    e = user;
    if (!e->message[0] && text)
        pell_printable(text, e->message, sizeof(e->message));
}

static enum pell_result exr_failed(struct exr_writer *e, const char *what, exr_result_t err)
{
    if (err == EXR_ERR_WRITE_IO || err == EXR_ERR_OUT_OF_MEMORY) /* the file is written to memory only */
        return PELL_ERR_NOMEM;
    return pell_error(e->w->ctx, PELL_ERR_INVALID, e->w->name, NULL, "OpenEXR: %s: %s", what,
                      e->message[0] ? e->message : exr_get_default_error_message(err));
}

static int by_name(const void *a, const void *b)
{
    return strcmp((*(const struct pell_channel *const *) a)->name, (*(const struct pell_channel *const *) b)->name);
}

/* Sorts the channels and refuses names that EXR does not allow. */
static enum pell_result sort_channels(struct exr_writer *e)
{
    const struct pell_write_params *p = e->w->params;
    char shown[64];

    for (size_t i = 0; i < p->num_channels; i++) {
        const char *name = p->channels[i].name;
        if (!name || !name[0] || strlen(name) > NAME_MAX_LENGTH)
            return pell_error(e->w->ctx, PELL_ERR_INVALID, e->w->name, NULL,
                              "OpenEXR: channel %zu has the name \"%s\", must have 1 to %d characters", i,
                              pell_printable(name ? name : "", shown, sizeof(shown)), NAME_MAX_LENGTH);
        e->sorted[i] = &p->channels[i];
    }
    qsort(e->sorted, p->num_channels, sizeof(*e->sorted), by_name);
    for (size_t i = 1; i < p->num_channels; i++)
        if (strcmp(e->sorted[i]->name, e->sorted[i - 1]->name) == 0)
            return pell_error(e->w->ctx, PELL_ERR_INVALID, e->w->name, NULL, "OpenEXR: two channels have the name \"%s\"",
                              pell_printable(e->sorted[i]->name, shown, sizeof(shown)));
    return PELL_OK;
}

static enum pell_result write_header(struct exr_writer *e)
{
    static const exr_compression_t codes[] = {
        [PELL_EXR_PIZ] = EXR_COMPRESSION_PIZ,
        [PELL_EXR_ZIPS] = EXR_COMPRESSION_ZIPS,
        [PELL_EXR_ZIP] = EXR_COMPRESSION_ZIP,
        [PELL_EXR_NONE] = EXR_COMPRESSION_NONE,
    };
    const struct pell_write_params *p = e->w->params;
    exr_context_initializer_t init = EXR_DEFAULT_CONTEXT_INITIALIZER;
    exr_result_t err;
    int part = 0;

    init.error_handler_fn = keep_error;
    init.user_data = e;
    init.write_fn = stream_write;
    init.zip_level = ZIP_LEVEL;
    err = exr_start_write(&e->exr, e->w->name, EXR_WRITE_FILE_DIRECTLY, &init);
    if (err != EXR_ERR_SUCCESS) {
        e->exr = NULL;
        return exr_failed(e, "start", err);
    }
    if ((err = exr_set_longname_support(e->exr, 1)) || (err = exr_add_part(e->exr, "rgb", EXR_STORAGE_SCANLINE, &part)) ||
        (err = exr_initialize_required_attr_simple(e->exr, part, p->width, p->height, codes[p->compression])))
        return exr_failed(e, "header", err);
    for (size_t i = 0; i < p->num_channels; i++)
        if ((err = exr_add_channel(e->exr, part, e->sorted[i]->name, e->sorted[i]->full_float ? EXR_PIXEL_FLOAT : EXR_PIXEL_HALF,
                                   EXR_PERCEPTUALLY_LOGARITHMIC, 1, 1)))
            return exr_failed(e, "channel", err);
    for (size_t i = 0; i < p->num_attributes; i++)
        if ((err = exr_attr_set_string(e->exr, part, p->attributes[i].name, p->attributes[i].value)))
            return exr_failed(e, p->attributes[i].name, err);
    if ((err = exr_write_header(e->exr)) || (err = exr_get_scanlines_per_chunk(e->exr, part, &e->lines)))
        return exr_failed(e, "header", err);
    return PELL_OK;
}

/* Rows y .. y + height - 1 of all channels, finite, and clamped to the range of half if stored as half. */
static void fill_chunk(struct exr_writer *e, int y, int height)
{
    const struct pell_write_params *p = e->w->params;
    const size_t width = (size_t) p->width;

    for (size_t c = 0; c < p->num_channels; c++)
        for (int row = 0; row < height; row++) {
            float *out = e->rows + (c * (size_t) e->lines + (size_t) row) * width;
            pell_writer_row(e->w, (size_t) (e->sorted[c] - p->channels), y + row, out, 1);
            if (e->sorted[c]->full_float)
                continue;
            for (size_t x = 0; x < width; x++) {
                const float v = out[x] > PELL_HALF_MAX ? PELL_HALF_MAX : out[x] < -PELL_HALF_MAX ? -PELL_HALF_MAX : out[x];
                e->w->clamped += v != out[x];
                out[x] = v;
            }
        }
}

/* OpenEXRCore up to 3.4.7 (its issue 2306) stores zlib's bytes if there are exactly as many as of the pixels, but every reader takes a
 * chunk of that size for uncompressed pixels: so store those. */
static exr_result_t compress(exr_encode_pipeline_t *pipe)
{
    const struct exr_writer *e = pipe->encoding_user_data;
    const exr_result_t err = e->compress(pipe);

    if (err == EXR_ERR_SUCCESS && pipe->compressed_bytes == pipe->packed_bytes && pipe->compressed_buffer != pipe->packed_buffer)
        memcpy(pipe->compressed_buffer, pipe->packed_buffer, pipe->packed_bytes);
    return err;
}

static enum pell_result write_chunk(struct exr_writer *e, int y)
{
    const struct pell_write_params *p = e->w->params;
    exr_chunk_info_t chunk;
    exr_result_t err;

    if (pell_cancelled(e->w->ctx))
        return PELL_ERR_CANCELLED;
    if ((err = exr_write_scanline_chunk_info(e->exr, 0, y, &chunk)))
        return exr_failed(e, "pixels", err);
    err = e->started ? exr_encoding_update(e->exr, 0, &chunk, &e->pipe) : exr_encoding_initialize(e->exr, 0, &chunk, &e->pipe);
    if (err)
        return exr_failed(e, "pixels", err);
    fill_chunk(e, y, chunk.height);
    for (int c = 0; c < e->pipe.channel_count; c++) {
        exr_coding_channel_info_t *ch = &e->pipe.channels[c];
        ch->user_data_type = EXR_PIXEL_FLOAT;
        ch->user_bytes_per_element = 4;
        ch->user_pixel_stride = 4;
        ch->user_line_stride = (int32_t) (4 * p->width);
        ch->encode_from_ptr = (const uint8_t *) (e->rows + (size_t) c * (size_t) e->lines * (size_t) p->width);
    }
    if (!e->started) {
        if ((err = exr_encoding_choose_default_routines(e->exr, 0, &e->pipe)))
            return exr_failed(e, "pixels", err);
        e->started = true;
        e->pipe.encoding_user_data = e;
        e->compress = e->pipe.compress_fn;
        if (e->compress)
            e->pipe.compress_fn = compress;
    }
    if ((err = exr_encoding_run(e->exr, 0, &e->pipe)))
        return exr_failed(e, "pixels", err);
    return PELL_OK;
}

enum pell_result pell_exr_encode(struct pell_writer *w)
{
    const struct pell_write_params *p = w->params;
    struct exr_writer e = { .w = w };
    enum pell_result res = PELL_ERR_NOMEM;
    exr_result_t err;

    if (p->width > INT32_MAX / 4)
        return pell_error(w->ctx, PELL_ERR_INVALID, w->name, NULL, "OpenEXR: the width is %d, must be at most %d", p->width, INT32_MAX / 4);
    e.sorted = pell_alloc_array(w->ctx, p->num_channels, sizeof(*e.sorted));
    if (!e.sorted)
        goto fail;
    PELL_TRY(sort_channels(&e));
    PELL_TRY(write_header(&e));
    e.rows = pell_alloc_array(w->ctx, (size_t) p->width * (size_t) e.lines, p->num_channels * sizeof(*e.rows));
    if (!e.rows) {
        res = PELL_ERR_NOMEM;
        goto fail;
    }
    for (int y = 0; y < p->height; y += e.lines)
        PELL_TRY(write_chunk(&e, y));
fail:
    if (e.exr)
        exr_encoding_destroy(e.exr, &e.pipe);
    if (e.exr && (err = exr_finish(&e.exr)) && res == PELL_OK) /* writes the chunk table */
        res = exr_failed(&e, "chunk table", err);
    pell_free(w->ctx, e.rows);
    pell_free(w->ctx, e.sorted);
    return res;
}
