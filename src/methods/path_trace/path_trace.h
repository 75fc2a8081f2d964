/* SPDX-License-Identifier: MIT
 *
 * path_trace.h - what runs the transport of trace.h over pictures: knobs, films, checkpoint files. The method's only symbol for others is
 * pell_method_path_trace.
 */
#ifndef PELL_PATH_TRACE_METHOD_H
#define PELL_PATH_TRACE_METHOD_H

#include "methods/path_trace/trace.h"

enum pt_as { PT_BEST, PT_PAPER };
enum pt_surface { PT_SURFACE_LOBE, PT_SURFACE_TRACED };

struct pt_method_knobs {
    int as; /* enum pt_as */
    int samples;
    float error, time_limit; /* s */
    int surface;             /* enum pt_surface */
    bool connections;
    bool reentry;          /* false: no bounces */
    struct pt_knobs trace; /* `techniques` follows from `connections` */
};

/* --- film.c: sums of samples, pixel by pixel ---------------------------------------------------------------------------------------- */

/* An exact sum: a whole number of 128 bits, in two's complement, of 2^-64 of the film's unit. No order of adding changes it. */
struct pt_sum {
    uint64_t low;
    int64_t high;
};

/* Sums over the samples of one pixel, W/(m^2 sr). */
struct pt_pixel {
    struct pt_sum sum[3][3];  /* [multiple, single, surface][channel] */
    struct pt_sum squares[4]; /* of R, G, B and luminance of the parts that count, in 2^-64 of the squared unit; end at the largest */
    uint32_t count;           /* samples */
};

enum pt_part { PT_MULTIPLE, PT_SINGLE, PT_SURFACE, PT_PARTS };

/* Pixels from left to right and from top to bottom of a tile, the smallest part of a picture that a file or a rank has. */
#define PT_TILE 8
/* Spans of a tile. */
#define PT_SPANS 4096

/* Samples of a tile: first, first + 1, ... end - 1. */
struct pt_span {
    uint32_t first, end;
};

/* The translucent pixels of one sample of the multisample, and which of their samples are in the sums. */
struct pt_film {
    size_t count, capacity;
    uint64_t identity;       /* of the places that its pixels see */
    int exponent;            /* its unit is 2^exponent W/(m^2 sr) */
    struct pt_pixel *pixels; /* tile by tile, row by row in a tile */
    size_t tiles;
    uint32_t *starts;      /* of tiles + 1: the first pixel of each */
    uint16_t *num_spans;   /* of each tile */
    struct pt_span *spans; /* most_spans of each tile: in order, apart from each other */
    uint32_t most_spans;
};

/* Tiles of a picture, in rows from the top. */
static inline size_t pt_tiles(uint32_t width, uint32_t height)
{
    return (size_t) ((width + PT_TILE - 1) / PT_TILE) * ((height + PT_TILE - 1) / PT_TILE);
}

/* Adds a sample; `traced`: what the surface reflects counts, too. One that is not finite, or 2^31 units away from 0, counts as black:
 * false. */
bool pt_pixel_add(struct pt_pixel *pixel, int exponent, const struct pt_light *light, bool traced);
/* Adds all samples of another one. */
void pt_pixel_merge(struct pt_pixel *pixel, const struct pt_pixel *other);
/* Of 2^exponent. */
double pt_sum_value(const struct pt_sum *sum, int exponent);
/* Mean and its standard error of R, G, B and luminance of the parts that count; of no sample: 0. */
void pt_pixel_measure(const struct pt_pixel *pixel, int exponent, bool traced, double mean[4], double error[4]);
/* Root of the mean over pixels of the squared relative standard error of the luminance. Pixels darker than 1/100 of the mean count as if
 * they were as bright as that. 0: the film is black; INFINITY: some pixel has fewer than 2 samples. */
double pt_film_error(const struct pt_film *film, bool traced);

/* An empty film, whose tiles have these numbers of pixels. On failure it is zeroed. */
PELL_NODISCARD enum pell_result pt_film_create(struct pell_context *ctx, const uint8_t *pixels, size_t tiles, struct pt_film *film);
void pt_film_free(struct pell_context *ctx, struct pt_film *film);
/* Room for `more` further spans of each tile; PELL_ERR_NOMEM. */
PELL_NODISCARD enum pell_result pt_film_reserve(struct pell_context *ctx, struct pt_film *film, uint32_t more);
/* The first sample of a tile from `from` on that is missing, and where the next one is that is not (or UINT32_MAX). */
uint32_t pt_film_missing(const struct pt_film *film, size_t tile, uint32_t from, uint32_t *end);
/* Notes samples that were missing. There is room for a span. */
void pt_film_cover(struct pt_film *film, size_t tile, struct pt_span span);
/* Notes samples that `from` has, too. PELL_ERR_INVALID: some of them were there; *tile and *sample are the first. Then nothing is added. */
PELL_NODISCARD enum pell_result pt_film_merge(struct pell_context *ctx, struct pt_film *film, const struct pt_film *from, size_t *tile,
                                              uint32_t *sample);
/* Whether all samples of `part` are in the film. */
bool pt_film_holds(const struct pt_film *film, const struct pt_film *part);

struct pell_share;
/* Collective: adds the films of all ranks, of as many pixels, into those of `total`, on rank 0. */
PELL_NODISCARD enum pell_result pt_share_reduce(struct pell_context *ctx, const struct pell_share *share, const struct pt_film *film,
                                                struct pt_film *total);

/* --- checkpoint.c: films in a file -------------------------------------------------------------------------------------------------- */

enum {
    PT_KEY_NORMALS,
    PT_KEY_BOUNDARY,
    PT_KEY_ACCELERATION,
    PT_KEY_EVENTS,
    PT_KEY_BOUNCES,
    PT_KEY_TECHNIQUES,
    PT_KEY_SURFACE,
    PT_KEY_SETTING,
    PT_KEY_HALF,
    PT_KEY_WORDS
};

/* What a file must be of to be gone on with. */
struct pt_checkpoint_key {
    uint32_t width, height, films; /* films: samples of the multisample */
    uint64_t scene;
    int64_t seed;
    int32_t words[PT_KEY_WORDS]; /* knobs, as far as they change what a sample gives */
    float roulette;
    int32_t exponent; /* of the films */
    char version[32]; /* of the program, filled up with 0 */
};

/* The bytes of a file of these films, owned by the caller (pell_free). `note` is text of the program's, NULL: none. */
PELL_NODISCARD enum pell_result pt_checkpoint_encode(struct pell_context *ctx, const struct pt_checkpoint_key *key, const char *note,
                                                     const struct pt_film *films, uint8_t **data, size_t *size);
/* The note of a file, which is the caller's (pell_free), whatever the file is of. PELL_ERR_FORMAT: there is none, or it is damaged;
 * PELL_ERR_INVALID: of another version. Both are logged with `path`. */
PELL_NODISCARD enum pell_result pt_checkpoint_note(struct pell_context *ctx, const char *path, const uint8_t *data, size_t size,
                                                   char **note);
/* Fills key->films films, which are the caller's (pt_film_free), on failure none. PELL_ERR_FORMAT: damaged; PELL_ERR_INVALID: of
 * something else than `key`. Both are logged with `path`. */
PELL_NODISCARD enum pell_result pt_checkpoint_decode(struct pell_context *ctx, const char *path, const uint8_t *data, size_t size,
                                                     const struct pt_checkpoint_key *key, struct pt_film *films);

extern const struct pell_method_engine pell_path_trace_cpu;

#endif
