/* SPDX-License-Identifier: MIT
 * exr_read.c - OpenEXR through the C library OpenEXRCore: scan lines and tiles, half, float and uint, all compressions but DWA.
 *
 * The library's allocator takes no user pointer, so its own buffers come from the C library; their sizes are checked against the
 * memory limit first. A file's associated (premultiplied) alpha becomes straight for images of role COLOR. */
#include "image/exr.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* --- The file as a stream ------------------------------------------------------------------------------------------- */

static int64_t stream_read(exr_const_context_t exr, void *user, void *buffer, uint64_t size, uint64_t offset,
                           exr_stream_error_func_ptr_t error)
{
    (void) exr;
    (void) error;
    return (int64_t) pell_source_read(((struct exr_file *) user)->src, offset, buffer, size);
}

static int64_t stream_size(exr_const_context_t exr, void *user)
{
    (void) exr;
    return (int64_t) ((struct exr_file *) user)->src->size;
}

static void keep_error(exr_const_context_t exr, exr_result_t code, const char *text)
{
    void *user = NULL;
    struct exr_file *f;

    (void) code;
    if (exr_get_user_data(exr, &user) != EXR_ERR_SUCCESS || !user)
        return;
    f = user;
    if (!f->message[0] && text)
        pell_printable(text, f->message, sizeof(f->message));
}

enum pell_result pell_exr_failed(struct exr_file *f, const char *what, exr_result_t err)
{
    if (err == EXR_ERR_OUT_OF_MEMORY)
        return pell_error(f->ctx, PELL_ERR_NOMEM, f->src->name, NULL, "OpenEXR: %s: out of memory", what);
    return pell_error(f->ctx, PELL_ERR_FORMAT, f->src->name, "the file is damaged: write it again", "OpenEXR: %s: %s", what,
                      f->message[0] ? f->message : exr_get_default_error_message(err));
}

/* Zero-initialised: a chunk that unpacks to fewer bytes than expected must not expose old memory. */
static void *zeroed(size_t size)
{
    return calloc(1, size);
}

enum pell_result pell_exr_open(struct exr_file *f)
{
    exr_context_initializer_t init = EXR_DEFAULT_CONTEXT_INITIALIZER;
    exr_result_t err;
    enum pell_result res = pell_exr_check_header(f->ctx, f->src);

    if (res != PELL_OK)
        return res;
    init.error_handler_fn = keep_error;
    init.alloc_fn = zeroed;
    init.free_fn = free;
    init.user_data = f;
    init.read_fn = stream_read;
    init.size_fn = stream_size;
    init.flags = EXR_CONTEXT_FLAG_DISABLE_CHUNK_RECONSTRUCTION;
    err = exr_start_read(&f->exr, f->src->name, &init);
    if (err != EXR_ERR_SUCCESS) {
        f->exr = NULL;
        return pell_exr_failed(f, "header", err);
    }
    return PELL_OK;
}

void pell_exr_close(struct exr_file *f)
{
    if (f->exr)
        exr_finish(&f->exr);
}

/* --- Parts -------------------------------------------------------------------------------------------------------------------- */

static bool is_deep(const struct exr_file *f, int index)
{
    exr_storage_t storage = EXR_STORAGE_SCANLINE;
    return exr_get_storage(f->exr, index, &storage) == EXR_ERR_SUCCESS &&
           (storage == EXR_STORAGE_DEEP_SCANLINE || storage == EXR_STORAGE_DEEP_TILED);
}

static int64_t extent(int32_t low, int32_t high)
{
    return (int64_t) high - low + 1;
}

static enum pell_result check_channels(struct exr_file *f, const exr_attr_chlist_t *list)
{
    if (list->num_channels < 1)
        return pell_error(f->ctx, PELL_ERR_FORMAT, f->src->name, NULL, "OpenEXR: there is no channel");
    for (int c = 0; c < list->num_channels; c++) {
        const exr_attr_chlist_entry_t *e = &list->entries[c];
        char shown[64];
        if (e->x_sampling != 1 || e->y_sampling != 1)
            return pell_error(f->ctx, PELL_ERR_UNSUPPORTED, f->src->name, "write it with R, G, B in full resolution",
                              "OpenEXR: channel \"%s\" is subsampled %d x %d (luminance and chroma images are not read), must be 1 x 1",
                              pell_printable(e->name.str, shown, sizeof(shown)), e->x_sampling, e->y_sampling);
        if (e->pixel_type != EXR_PIXEL_UINT && e->pixel_type != EXR_PIXEL_HALF && e->pixel_type != EXR_PIXEL_FLOAT)
            return pell_error(f->ctx, PELL_ERR_FORMAT, f->src->name, NULL,
                              "OpenEXR: channel \"%s\" has type %d, must be half, float or uint",
                              pell_printable(e->name.str, shown, sizeof(shown)), (int) e->pixel_type);
    }
    return PELL_OK;
}

/* Checks the size of a chunk, and the memory needed to decode it. */
static enum pell_result check_chunks(struct exr_file *f, struct exr_part *p)
{
    const uint64_t channels = (uint64_t) p->channels->num_channels;
    uint64_t width, height;
    int32_t chunks;
    exr_result_t err;

    if (p->tiled) {
        if ((err = exr_get_tile_sizes(f->exr, p->index, 0, 0, &p->tile_width, &p->tile_height)) != EXR_ERR_SUCCESS)
            return pell_exr_failed(f, "tiles", err);
        if (p->tile_width < 1 || p->tile_height < 1)
            return pell_error(f->ctx, PELL_ERR_FORMAT, f->src->name, NULL, "OpenEXR: tiles of %d x %d pixels, must be 1 x 1 or more",
                              p->tile_width, p->tile_height);
        /* a tile may be larger than the image: the part outside is not stored */
        width = (uint64_t) (p->tile_width < p->data_width ? p->tile_width : p->data_width);
        height = (uint64_t) (p->tile_height < p->data_height ? p->tile_height : p->data_height);
    } else {
        if ((err = exr_get_scanlines_per_chunk(f->exr, p->index, &p->lines)) != EXR_ERR_SUCCESS)
            return pell_exr_failed(f, "scan lines", err);
        if (p->lines < 1)
            return pell_error(f->ctx, PELL_ERR_FORMAT, f->src->name, NULL, "OpenEXR: %d scan lines in a chunk, must be 1 or more",
                              p->lines);
        width = (uint64_t) p->data_width;
        height = (uint64_t) p->lines;
    }
    if ((err = exr_get_chunk_count(f->exr, p->index, &chunks)) != EXR_ERR_SUCCESS)
        return pell_exr_failed(f, "chunk table", err);
    if (chunks < 1 || (size_t) chunks > f->src->size / 8)
        return pell_error(f->ctx, PELL_ERR_FORMAT, f->src->name, "the file is damaged: write it again",
                          "OpenEXR: a table of %d chunks can't stand in a file of %zu bytes", chunks, f->src->size);
    if (width > INT32_MAX / 4 || height > INT32_MAX || width * height > (uint64_t) INT64_MAX / 64 / channels)
        return pell_error(f->ctx, PELL_ERR_UNSUPPORTED, f->src->name, NULL, "OpenEXR: a chunk of %llu x %llu pixels is too large",
                          (unsigned long long) width, (unsigned long long) height);
    /* our buffer, the unpacked one and two for scratch */
    return pell_image_check_memory(f->ctx, f->src->name, 4 * 4 * width * height * channels);
}

/* Limits windows by the file's size. ZIP, the best compression, expands by at most 1032; pixels outside of the data window take memory and
 * time, but no bytes. */
#define MAX_EXPANSION 1100
#define EMPTY_PIXELS ((int64_t) 1 << 24)
#define MAX_EMPTY_FACTOR 64
static enum pell_result check_windows(struct exr_file *f, const struct exr_part *p)
{
    const int64_t data = p->data_width * p->data_height, display = (int64_t) p->width * p->height;
    uint64_t bytes = 0;

    for (int c = 0; c < p->channels->num_channels; c++)
        bytes += (uint64_t) data * (p->channels->entries[c].pixel_type == EXR_PIXEL_HALF ? 2 : 4);
    if (bytes / (p->uncompressed ? 1 : MAX_EXPANSION) > f->src->size)
        return pell_error(f->ctx, PELL_ERR_FORMAT, f->src->name, "the file is damaged: write it again",
                          "OpenEXR: a data window of %lld x %lld pixels can't stand in a file of %zu bytes", (long long) p->data_width,
                          (long long) p->data_height, f->src->size);
    if (display > EMPTY_PIXELS && display / MAX_EMPTY_FACTOR > data)
        return pell_error(f->ctx, PELL_ERR_UNSUPPORTED, f->src->name, "make the display window smaller: oiiotool IN --fullpixels -o OUT",
                          "OpenEXR: the display window of %d x %d pixels holds %lld x %lld pixels of data, must be at most %lld pixels or "
                          "%d times the data",
                          p->width, p->height, (long long) p->data_width, (long long) p->data_height, (long long) EMPTY_PIXELS,
                          MAX_EMPTY_FACTOR);
    return PELL_OK;
}

enum pell_result pell_exr_describe(struct exr_file *f, int index, struct exr_part *p)
{
    exr_attr_box2i_t data, display;
    exr_compression_t compression;
    exr_storage_t storage;
    exr_result_t err;
    enum pell_result res;

    *p = (struct exr_part) { .index = index };
    if ((err = exr_get_storage(f->exr, index, &storage)) != EXR_ERR_SUCCESS ||
        (err = exr_get_compression(f->exr, index, &compression)) != EXR_ERR_SUCCESS ||
        (err = exr_get_data_window(f->exr, index, &data)) != EXR_ERR_SUCCESS ||
        (err = exr_get_display_window(f->exr, index, &display)) != EXR_ERR_SUCCESS ||
        (err = exr_get_channels(f->exr, index, &p->channels)) != EXR_ERR_SUCCESS)
        return pell_exr_failed(f, "header", err);
    if (is_deep(f, index))
        return pell_error(f->ctx, PELL_ERR_UNSUPPORTED, f->src->name, "flatten it", "OpenEXR: deep images are not read");
    if (compression == EXR_COMPRESSION_DWAA || compression == EXR_COMPRESSION_DWAB)
        return pell_error(f->ctx, PELL_ERR_UNSUPPORTED, f->src->name, "save it again: oiiotool IN.exr --compression zip -o OUT.exr",
                          "OpenEXR: compression %s is not read", compression == EXR_COMPRESSION_DWAA ? "DWAA" : "DWAB");
    res = check_channels(f, p->channels);
    if (res != PELL_OK)
        return res;
    res = pell_image_check_size(f->ctx, f->src->name, extent(display.min.x, display.max.x), extent(display.min.y, display.max.y));
    if (res != PELL_OK)
        return res;
    p->data_width = extent(data.min.x, data.max.x);
    p->data_height = extent(data.min.y, data.max.y);
    res = pell_image_check_size(f->ctx, f->src->name, p->data_width, p->data_height);
    if (res != PELL_OK)
        return res;
    p->uncompressed = compression == EXR_COMPRESSION_NONE;
    p->tiled = storage == EXR_STORAGE_TILED;
    p->width = (int) extent(display.min.x, display.max.x);
    p->height = (int) extent(display.min.y, display.max.y);
    p->data_x = (int64_t) data.min.x - display.min.x;
    p->data_y = (int64_t) data.min.y - display.min.y;
    res = check_windows(f, p);
    return res == PELL_OK ? check_chunks(f, p) : res;
}

/* --- Pixels ------------------------------------------------------------------------------------------------------------------- */

/* Decodes chunks into planes of 32 bit values and copies what lies in the display window to dest[channel]. */
struct reader {
    struct exr_file *f;
    const struct exr_part *p;
    exr_decode_pipeline_t pipe;
    bool started;
    uint32_t *planes;
    int64_t width, height; /* of one plane */
    int first, count;      /* requested rows of the display window */
    float *const *dest;    /* per channel of the part, from row `first`; NULL: not needed */
    size_t step;
};

static void copy_chunk(const struct reader *r, int64_t x, int64_t y, int64_t width, int64_t height)
{
    const struct exr_part *p = r->p;
    const int64_t x0 = x < 0 ? -x : 0, x1 = x + width > p->width ? p->width - x : width;

    for (int c = 0; c < p->channels->num_channels; c++) {
        const bool is_uint = p->channels->entries[c].pixel_type == EXR_PIXEL_UINT;
        if (!r->dest[c])
            continue;
        for (int64_t row = 0; row < height; row++) {
            const uint32_t *in = r->planes + ((size_t) c * (size_t) r->height + (size_t) row) * (size_t) r->width;
            float *out;
            if (y + row < r->first || y + row >= r->first + r->count)
                continue;
            out = r->dest[c] + (size_t) (y + row - r->first) * (size_t) p->width * r->step;
            for (int64_t i = x0; i < x1; i++) {
                float *to = out + (size_t) (x + i) * r->step;
                if (is_uint)
                    *to = (float) in[i];
                else
                    memcpy(to, &in[i], sizeof(*to));
            }
        }
    }
}

/* `x`, `y`: position of the chunk in the display window. */
static enum pell_result read_chunk(struct reader *r, const exr_chunk_info_t *chunk, int64_t x, int64_t y)
{
    const struct exr_part *p = r->p;
    struct exr_file *f = r->f;
    exr_result_t err;

    if (pell_cancelled(f->ctx))
        return PELL_ERR_CANCELLED;
    if (chunk->width < 1 || chunk->height < 1 || chunk->width > r->width || chunk->height > r->height ||
        chunk->packed_size > f->src->size || (p->uncompressed && chunk->packed_size != chunk->unpacked_size) ||
        chunk->unpacked_size > 4 * (uint64_t) (r->width * r->height) * (uint64_t) p->channels->num_channels)
        return pell_error(f->ctx, PELL_ERR_FORMAT, f->src->name, "the file is damaged: write it again",
                          "OpenEXR: the chunk at row %lld does not have its size", (long long) y);
    err = r->started ? exr_decoding_update(f->exr, p->index, chunk, &r->pipe) : exr_decoding_initialize(f->exr, p->index, chunk, &r->pipe);
    if (err == EXR_ERR_SUCCESS && r->pipe.channel_count != p->channels->num_channels)
        err = EXR_ERR_CORRUPT_CHUNK;
    if (err != EXR_ERR_SUCCESS)
        goto failed;
    for (int c = 0; c < r->pipe.channel_count; c++) {
        exr_coding_channel_info_t *ch = &r->pipe.channels[c];
        ch->user_data_type = ch->data_type == EXR_PIXEL_UINT ? EXR_PIXEL_UINT : EXR_PIXEL_FLOAT;
        ch->user_bytes_per_element = 4;
        ch->user_pixel_stride = 4;
        ch->user_line_stride = (int32_t) (4 * r->width);
        ch->decode_to_ptr = (uint8_t *) (r->planes + (size_t) c * (size_t) r->height * (size_t) r->width);
    }
    if (!r->started && (err = exr_decoding_choose_default_routines(f->exr, p->index, &r->pipe)) != EXR_ERR_SUCCESS)
        goto failed;
    r->started = true;
    err = exr_decoding_run(f->exr, p->index, &r->pipe);
    if (err != EXR_ERR_SUCCESS)
        goto failed;
    copy_chunk(r, x, y, chunk->width, chunk->height);
    return PELL_OK;
failed:
    r->started = true; /* partially initialised: must be destroyed */
    return pell_exr_failed(f, "pixels", err);
}

/* The first row of the data window at which a chunk of `lines` rows begins that overlaps the requested rows. */
static int64_t first_chunk(const struct reader *r, int64_t lines)
{
    const int64_t above = r->first - r->p->data_y;
    return above > 0 ? above / lines * lines : 0;
}

static enum pell_result read_lines(struct reader *r)
{
    const struct exr_part *p = r->p;
    exr_attr_box2i_t data;
    exr_chunk_info_t chunk;
    enum pell_result res;
    exr_result_t err = exr_get_data_window(r->f->exr, p->index, &data);

    for (int64_t y = first_chunk(r, p->lines); err == EXR_ERR_SUCCESS && y < p->data_height; y += p->lines) {
        if (p->data_y + y >= r->first + r->count)
            break;
        err = exr_read_scanline_chunk_info(r->f->exr, p->index, (int) (data.min.y + y), &chunk);
        if (err != EXR_ERR_SUCCESS)
            break;
        res = read_chunk(r, &chunk, p->data_x, p->data_y + y);
        if (res != PELL_OK)
            return res;
    }
    return err == EXR_ERR_SUCCESS ? PELL_OK : pell_exr_failed(r->f, "chunk table", err);
}

static enum pell_result read_tiles(struct reader *r)
{
    const struct exr_part *p = r->p;
    exr_chunk_info_t chunk;
    enum pell_result res;
    exr_result_t err;

    for (int64_t y = first_chunk(r, p->tile_height); y < p->data_height && p->data_y + y < r->first + r->count; y += p->tile_height)
        for (int64_t x = 0; x < p->data_width; x += p->tile_width) {
            err = exr_read_tile_chunk_info(r->f->exr, p->index, (int) (x / p->tile_width), (int) (y / p->tile_height), 0, 0, &chunk);
            if (err != EXR_ERR_SUCCESS)
                return pell_exr_failed(r->f, "tile table", err);
            res = read_chunk(r, &chunk, p->data_x + x, p->data_y + y);
            if (res != PELL_OK)
                return res;
        }
    return PELL_OK;
}

enum pell_result pell_exr_read_rows(struct exr_file *f, const struct exr_part *p, int first, int count, float *const *dest, size_t step)
{
    struct reader r = { .f = f, .p = p, .first = first, .count = count, .dest = dest, .step = step };
    enum pell_result res;

    r.width = p->tiled && p->tile_width < p->data_width ? p->tile_width : p->data_width;
    r.height = pell_exr_chunk_rows(p);
    r.planes = pell_calloc(f->ctx, (size_t) r.width * (size_t) r.height, 4 * (size_t) p->channels->num_channels);
    if (!r.planes)
        return PELL_ERR_NOMEM;
    res = p->tiled ? read_tiles(&r) : read_lines(&r);
    if (r.started)
        exr_decoding_destroy(f->exr, &r.pipe);
    pell_free(f->ctx, r.planes);
    return res;
}

int64_t pell_exr_chunk_rows(const struct exr_part *p)
{
    return !p->tiled ? p->lines : p->tile_height < p->data_height ? p->tile_height : p->data_height;
}

/* --- As an image ------------------------------------------------------------------------------------------------------------- */

/* The channel called `prefix` (its first `length` bytes) + `name`, or -1. */
static int find_channel(const exr_attr_chlist_t *list, const char *prefix, size_t length, const char *name)
{
    for (int c = 0; c < list->num_channels; c++) {
        const exr_attr_string_t *s = &list->entries[c].name;
        if ((size_t) s->length == length + strlen(name) && memcmp(s->str, prefix, length) == 0 && strcmp(s->str + length, name) == 0)
            return c;
    }
    return -1;
}

static bool pick_rgb(const exr_attr_chlist_t *list, const char *prefix, size_t length, int pick[4], int *count)
{
    static const char *const names[4] = { "R", "G", "B", "A" };

    for (int i = 0; i < 4; i++)
        pick[i] = find_channel(list, prefix, length, names[i]);
    *count = pick[3] >= 0 ? 4 : 3;
    return pick[0] >= 0 && pick[1] >= 0 && pick[2] >= 0;
}

/* Chooses R, G, B (and A); else Y (and A); else the first layer that has R, G and B; else a single channel. Returns a rating: 3, 2, 1; 0:
 * none. */
static int pick_channels(const exr_attr_chlist_t *list, int pick[4], int *count)
{
    if (pick_rgb(list, "", 0, pick, count))
        return 3;
    pick[0] = find_channel(list, "", 0, "Y");
    pick[1] = find_channel(list, "", 0, "A");
    *count = pick[1] >= 0 ? 2 : 1;
    if (pick[0] >= 0)
        return find_channel(list, "", 0, "RY") < 0 && find_channel(list, "", 0, "BY") < 0 ? 2 : 0;
    for (int c = 0; c < list->num_channels; c++) {
        const exr_attr_string_t *s = &list->entries[c].name;
        if (s->length > 2 && strcmp(s->str + s->length - 2, ".R") == 0 && pick_rgb(list, s->str, (size_t) s->length - 1, pick, count))
            return 1;
    }
    pick[0] = 0;
    *count = 1;
    return list->num_channels == 1 ? 1 : 0;
}

/* The best part to read as an image. */
static enum pell_result choose_part(struct exr_file *f, int *index, int pick[4], int *count)
{
    int parts = 0, best = 0, first = -1;
    const exr_attr_chlist_t *list;
    struct pell_text names = { "" };

    if (exr_get_count(f->exr, &parts) != EXR_ERR_SUCCESS || parts < 1)
        return pell_error(f->ctx, PELL_ERR_FORMAT, f->src->name, NULL, "OpenEXR: there is no part");
    for (int i = 0; i < parts; i++) {
        int channels[4], n, rating;
        if (is_deep(f, i) || exr_get_channels(f->exr, i, &list) != EXR_ERR_SUCCESS)
            continue;
        first = first < 0 ? i : first;
        rating = pick_channels(list, channels, &n);
        if (rating > best) {
            best = rating;
            *index = i;
            *count = n;
            memcpy(pick, channels, sizeof(channels));
        }
    }
    if (first < 0)
        return pell_error(f->ctx, PELL_ERR_UNSUPPORTED, f->src->name, "flatten it", "OpenEXR: deep images are not read");
    if (best)
        return PELL_OK;
    if (exr_get_channels(f->exr, first, &list) == EXR_ERR_SUCCESS)
        for (int c = 0; c < list->num_channels && names.length < 300; c++)
            pell_text_add(&names, "%s%.40s", c ? ", " : "", list->entries[c].name.str);
    if (find_channel(list, "", 0, "RY") >= 0 || find_channel(list, "", 0, "BY") >= 0)
        return pell_error(f->ctx, PELL_ERR_UNSUPPORTED, f->src->name, "write it with R, G, B in full resolution",
                          "OpenEXR: luminance and chroma images (channels %s) are not read", names.str);
    return pell_error(f->ctx, PELL_ERR_UNSUPPORTED, f->src->name, NULL, "OpenEXR: the channels are %s; must hold R, G, B or Y", names.str);
}

static void warn_primaries(struct exr_file *f, int index)
{
    static const float rec709[8] = { 0.64f, 0.33f, 0.30f, 0.60f, 0.15f, 0.06f, 0.3127f, 0.3290f };
    exr_attr_chromaticities_t c;
    float v[8];

    if (exr_attr_get_chromaticities(f->exr, index, "chromaticities", &c) != EXR_ERR_SUCCESS)
        return;
    memcpy(v, &c, sizeof(v));
    for (int i = 0; i < 8; i++)
        if (!(fabsf(v[i] - rec709[i]) < 0.005f)) {
            pell_warn(f->ctx, f->src->name, "convert it to linear Rec.709",
                      "OpenEXR: the primaries are not those of Rec.709; colours are "
                      "taken as if they were");
            return;
        }
}

static void make_straight(struct pell_image *image)
{
    const int n = image->channels;
    float *p = image->pixels;

    for (size_t i = (size_t) image->width * (size_t) image->height; i; i--, p += n) {
        const float alpha = p[n - 1];
        for (int c = 0; c < n - 1 && alpha > 0 && alpha < 1; c++) {
            const float v = p[c] / alpha;
            p[c] = isfinite(v) ? v : p[c]; /* light with zero alpha is kept */
        }
    }
}

enum pell_result pell_exr_decode(struct pell_context *ctx, const struct pell_source *src, struct pell_image *image)
{
    struct exr_file f = { .ctx = ctx, .src = src };
    int index = 0, pick[4] = { -1, -1, -1, -1 }, count = 0;
    enum pell_result res;
    struct exr_part part;
    float **dest = NULL;

    PELL_TRY(pell_exr_open(&f));
    PELL_TRY(choose_part(&f, &index, pick, &count));
    PELL_TRY(pell_exr_describe(&f, index, &part));
    PELL_TRY(pell_image_make(ctx, src->name, part.width, part.height, count, PELL_PIXEL_F32, image));
    memset(image->pixels, 0, (size_t) part.width * (size_t) part.height * (size_t) count * sizeof(float));
    dest = pell_calloc(ctx, (size_t) part.channels->num_channels, sizeof(*dest));
    if (!dest) {
        res = PELL_ERR_NOMEM;
        goto fail;
    }
    for (int i = 0; i < count; i++)
        dest[pick[i]] = (float *) image->pixels + i;
    PELL_TRY(pell_exr_read_rows(&f, &part, 0, part.height, dest, (size_t) count));
    if (src->role != PELL_ROLE_RAW)
        pell_image_make_finite(ctx, src->name, image->pixels, (size_t) part.width * (size_t) part.height * (size_t) count);
    if (src->role == PELL_ROLE_COLOR) {
        warn_primaries(&f, index);
        if (count == 2 || count == 4)
            make_straight(image);
    }
fail:
    pell_free(ctx, dest);
    pell_exr_close(&f);
    return res;
}
