/* SPDX-License-Identifier: MIT
 *
 * sources.h - the pictures of `pellucid compare A B`: what is compared of them, and a band of their rows at a time, so that they need not
 * fit into memory.
 *
 *     sources_open(cli, &s);                             // headers, channels, mask
 *     sources_hold(&s, whole);                           // memory for a band, or for all rows
 *     sources_take(&s, first, count);                    // reads rows into it
 *     in = sources_input(&s, all_light, first);          // planes of the band
 */
#ifndef PELL_CLI_SOURCES_H
#define PELL_CLI_SOURCES_H

#include "cli/compare/compare.h"

#include "compare/rows.h"
#include "image/rows.h"

#define SUBSURFACE "subsurface" /* the layer that is a sum of layers */
enum { SUBSURFACE_LAYERS = 3 };

/* Numbers are those of the file's channels, -1 for none. */
struct source {
    const char *path;
    struct pell_rows *rows;
    int width, height;
    bool display;                    /* integers: what a display shows */
    int rgb[3];                      /* what is compared, three times the same for one channel; unused where there is a sum */
    int full[3];                     /* R, G, B of all light, where the subsurface light alone is compared */
    int light[SUBSURFACE_LAYERS][3]; /* the subsurface light is the sum of these */
    int alpha, translucent, variance[3];
    float **planes; /* of the channels, a band each; NULL: not wanted */
    float *sum;     /* of the subsurface light, three bands; NULL: not wanted */
};

struct sources {
    struct cli *cli;
    struct source test, reference, half; /* half.rows NULL: none */
    char layer[128], mask_name[4096];    /* mask_name "": all pixels count */
    float *mask;                         /* of a file: all rows */
    float *variance;                     /* of the mean of two halves that both know theirs, three bands; or NULL */
    int first, count, capacity;          /* the band: its rows, and how many fit into it */
    int chunk;                           /* rows that are worth reading together */
};

PELL_NODISCARD enum pell_result sources_open(struct cli *cli, struct sources *s);
PELL_NODISCARD enum pell_result sources_hold(struct sources *s, bool whole);
/* Makes rows `first` to `first + count - 1` of all pictures readable: at most those that sources_hold made room for. Rows of the band
 * before are moved, not read again. */
PELL_NODISCARD enum pell_result sources_take(struct sources *s, int first, int count);
/* Planes that begin with row `first` of the band. `all_light` is heeded where the subsurface light is compared. */
struct pell_compare_input sources_input(const struct sources *s, bool all_light, int first);
/* For pell_compare_by_rows. */
struct pell_compare_rows sources_rows(struct sources *s, bool all_light);
void sources_close(struct sources *s);

/* Whether all light is another picture than what is compared. */
bool sources_have_two(const struct sources *s);
bool sources_know_noise(const struct sources *s);

#endif
