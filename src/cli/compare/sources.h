/* SPDX-License-Identifier: MIT
 *
 * sources.h - the images of `pellucid compare A B`: the layers compared, read in bands of rows, so that they need not fit into memory.
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

/* A source image. Channel indices are those of the file, -1 for none. */
struct source {
    const char *path;
    struct pell_rows *rows;
    int width, height;
    bool display;                    /* integers: display values */
    int rgb[3];                      /* the compared channels, three times the same for one channel; unused for a sum */
    int full[3];                     /* R, G, B of all light, if only the subsurface light is compared */
    int light[SUBSURFACE_LAYERS][3]; /* the subsurface light is the sum of these */
    int alpha, translucent, variance[3];
    float **planes; /* planes of the channels, one band each; NULL: not needed */
    float *sum;     /* sum of the subsurface layers, three bands; NULL: not needed */
};

struct sources {
    struct cli *cli;
    struct source test, reference, half; /* half.rows NULL: none */
    char layer[128], mask_name[4096];    /* mask_name "": all pixels count */
    float *mask;                         /* mask from a file: all rows */
    float *variance;                     /* variance of the mean of two halves that both know theirs, three bands; or NULL */
    int first, count, capacity;          /* rows of the band, and its capacity */
    int chunk;                           /* rows that are read together for efficiency */
};

PELL_NODISCARD enum pell_result sources_open(struct cli *cli, struct sources *s);
PELL_NODISCARD enum pell_result sources_hold(struct sources *s, bool whole);
/* Makes rows `first` to `first + count - 1` of all images readable: at most the number that sources_hold allocated. Rows that the band
 * already holds are moved, not read again. */
PELL_NODISCARD enum pell_result sources_take(struct sources *s, int first, int count);
/* Planes that begin with row `first` of the band. `all_light` has an effect if the subsurface light is compared. */
struct pell_compare_input sources_input(const struct sources *s, bool all_light, int first);
/* For pell_compare_by_rows. */
struct pell_compare_rows sources_rows(struct sources *s, bool all_light);
void sources_close(struct sources *s);

/* Whether all light differs from the compared layer. */
bool sources_have_two(const struct sources *s);
bool sources_know_noise(const struct sources *s);

#endif
