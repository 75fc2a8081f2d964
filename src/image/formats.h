/* SPDX-License-Identifier: MIT
 *
 * formats.h - internal interface of the format files; one pair of functions per format, called by image.c and write.c only.
 *
 * Ownership  decoders fill an image that the caller finishes, also on failure (it is {0} or complete enough for pell_image_finish).
 */
#ifndef PELL_FORMATS_H
#define PELL_FORMATS_H

#include "base/file.h"

#include <pellucid/image.h>

/* A file in memory, or one that is read in pieces. */
struct pell_source {
    const char *name;    /* for messages */
    const uint8_t *data; /* NULL: the data is in `file`, which only row readers and pell_source_read support */
    size_t size;
    enum pell_image_role role;
    const struct pell_file *file;
};

/* Copies `size` bytes from `at`; returns how many there were. */
size_t pell_source_read(const struct pell_source *src, uint64_t at, void *to, size_t size);

enum pell_result pell_png_decode(struct pell_context *ctx, const struct pell_source *src, struct pell_image *image);
enum pell_result pell_jpeg_decode(struct pell_context *ctx, const struct pell_source *src, struct pell_image *image);
enum pell_result pell_hdr_decode(struct pell_context *ctx, const struct pell_source *src, struct pell_image *image);
enum pell_result pell_exr_decode(struct pell_context *ctx, const struct pell_source *src, struct pell_image *image);
enum pell_result pell_pfm_decode(struct pell_context *ctx, const struct pell_source *src, struct pell_image *image);

/* Set up `rows` (rows.h), whose context and source are set and stay unchanged: its layers, format and state. If `format` and all else are
 * left unset, this file can't be read row by row. State is released by the format's `close`, also on failure. */
struct pell_rows;
enum pell_result pell_png_rows(struct pell_rows *rows);
enum pell_result pell_hdr_rows(struct pell_rows *rows);
enum pell_result pell_exr_rows(struct pell_rows *rows);
enum pell_result pell_pfm_rows(struct pell_rows *rows);
/* The row reader for a file with these first bytes; NULL: none. */
enum pell_result (*pell_image_rows_of(const uint8_t *head, size_t size))(struct pell_rows *rows);

/* pell_exr_read of a source. */
enum pell_result pell_exr_decode_layers(struct pell_context *ctx, const struct pell_source *src, struct pell_layers *layers);
/* Checks that all attributes of all parts lie inside the file. */
enum pell_result pell_exr_check_header(struct pell_context *ctx, const struct pell_source *src);

/* Checks a size against the limits before anything is allocated: PELL_ERR_FORMAT for 0, PELL_ERR_INVALID over image-pixels. */
enum pell_result pell_image_check_size(struct pell_context *ctx, const char *name, int64_t width, int64_t height);

/* Checks the size and allocates the pixels, not cleared. `srgb` is left false. */
enum pell_result pell_image_make(struct pell_context *ctx, const char *name, int64_t width, int64_t height, int channels,
                                 enum pell_pixel_type type, struct pell_image *image);

/* For buffers that a library allocates itself: PELL_ERR_NOMEM if `bytes` more would exceed the memory limit. */
enum pell_result pell_image_check_memory(struct pell_context *ctx, const char *name, uint64_t bytes);

/* Makes the values of a float file finite: NaN becomes 0, infinity +-65504; both are reported in one warning. */
void pell_image_make_finite(struct pell_context *ctx, const char *name, float *values, size_t count);
/* The same in pieces: counts accumulate. */
struct pell_not_finite {
    size_t nan, inf;
};
void pell_image_replace_not_finite(float *values, size_t count, struct pell_not_finite *bad);
void pell_image_warn_not_finite(struct pell_context *ctx, const char *name, const struct pell_not_finite *bad);

/* Linear floats of `count` values of an image's layout; `in` begins with a pixel. Floats are copied. */
void pell_image_convert(const struct pell_image *layout, const void *in, float *out, size_t count);

size_t pell_pixel_size(enum pell_pixel_type type); /* bytes of one channel */

#define PELL_HALF_MAX 65504.0f

/* --- Writing ------------------------------------------------------------------------------------------------------------------ */

/* A file that is written to memory, and counts of modified values. */
struct pell_writer {
    struct pell_context *ctx;
    const char *name; /* for messages */
    const struct pell_write_params *params;
    uint8_t *data;
    size_t size, capacity;
    size_t bad, clamped; /* values that were not finite; values out of the format's range */
};

enum pell_result pell_png_encode(struct pell_writer *w);
enum pell_result pell_hdr_encode(struct pell_writer *w);
enum pell_result pell_exr_encode(struct pell_writer *w);
enum pell_result pell_pfm_encode(struct pell_writer *w);

/* Makes `size` bytes from `at` valid (zero if never written) so that they can be written in place. */
enum pell_result pell_writer_reserve(struct pell_writer *w, size_t at, size_t size);
enum pell_result pell_writer_append(struct pell_writer *w, const void *bytes, size_t size);

/* Row `y` of a channel as finite floats: out[0], out[step], ... Counts values that were not finite. */
void pell_writer_row(struct pell_writer *w, size_t channel, int y, float *out, size_t step);

#endif
