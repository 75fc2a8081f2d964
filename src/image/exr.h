/* SPDX-License-Identifier: MIT
 *
 * exr.h - an OpenEXR file that is open for reading: its parts, and any rows of their channels. For exr_read.c and exr_layers.c.
 */
#ifndef PELL_EXR_H
#define PELL_EXR_H

#include "image/formats.h"

#include <openexr.h>

struct exr_file {
    struct pell_context *ctx;
    const struct pell_source *src;
    exr_context_t exr;
    char message[200]; /* the library's first message */
};

/* One part, checked. */
struct exr_part {
    int index;
    bool tiled, uncompressed;
    int32_t lines, tile_width, tile_height;          /* of one chunk */
    int64_t data_x, data_y, data_width, data_height; /* data window, relative to the display window's corner */
    int width, height;                               /* display window */
    const exr_attr_chlist_t *channels;
};

/* `f` with its context and source; `pell_exr_close` also after a failure. */
enum pell_result pell_exr_open(struct exr_file *f);
void pell_exr_close(struct exr_file *f);
enum pell_result pell_exr_failed(struct exr_file *f, const char *what, exr_result_t err);

/* Checks a part, its sizes against the limits, and what decoding it takes. */
enum pell_result pell_exr_describe(struct exr_file *f, int index, struct exr_part *p);

/* Rows of a chunk. */
int64_t pell_exr_chunk_rows(const struct exr_part *p);

/* dest[c] + step ((y - first) width + x) <- channel c, for `count` rows of the display window from row `first`. Pixels outside the data
 * window are not written. dest[c] NULL: not needed. */
enum pell_result pell_exr_read_rows(struct exr_file *f, const struct exr_part *p, int first, int count, float *const *dest, size_t step);

#endif
