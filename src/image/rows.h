/* SPDX-License-Identifier: MIT
 *
 * rows.h - an image file that is read some rows at a time, so that it need not fit into memory: OpenEXR, PNG, PFM and Radiance HDR files.
 * Others, and interlaced PNG or rows that are not stored from top to bottom, are decoded when they are opened.
 *
 *     pell_rows_open(ctx, path, &rows);
 *     pell_rows_read(rows, 0, 64, planes, stride);      // any number of times; cheap if rows continue after the previous ones
 *     pell_rows_close(&rows);
 *
 * Units      linear light, as pell_image_read gives it for role RAW and pell_image_to_float makes it.
 * Errors     logged once, with the file and the position.
 * Threads    a reader belongs to one thread.
 */
#ifndef PELL_ROWS_H
#define PELL_ROWS_H

#include "image/formats.h"

struct pell_rows_format {
    /* As pell_rows_read, after its checks. */
    enum pell_result (*read)(struct pell_rows *rows, int first, int count, float *const *dest, size_t stride);
    void (*close)(struct pell_rows *rows); /* releases `state` */
};

struct pell_rows {
    struct pell_context *ctx;
    struct pell_source src;
    struct pell_file file;
    struct pell_layers layers; /* size and channels, without their data; R, G, B, A or Y, A for files other than OpenEXR */
    bool layered;              /* an OpenEXR file */
    bool display;              /* the file holds integers: display values */
    int chunk;                 /* rows that are decoded together: reading fewer costs as much */
    const struct pell_rows_format *format;
    void *state;
};

PELL_NODISCARD enum pell_result pell_rows_open(struct pell_context *ctx, const char *path, struct pell_rows **out);
/* The same for bytes that the caller keeps alive; `name` is for messages. */
PELL_NODISCARD enum pell_result pell_rows_open_memory(struct pell_context *ctx, const char *name, const void *data, size_t size,
                                                      struct pell_rows **out);

/* dest[c] + (y - first) stride <- rows `first` to `first + count - 1` of channel c of the layers; NULL: not needed. */
PELL_NODISCARD enum pell_result pell_rows_read(struct pell_rows *rows, int first, int count, float *const *dest, size_t stride);

void pell_rows_close(struct pell_rows **rows);

/* --- For the formats ------------------------------------------------------------------------------------------------------------ */

/* Sets the size and the channels of a file other than OpenEXR. */
enum pell_result pell_rows_layout(struct pell_rows *rows, int width, int height, int channels);

#endif
