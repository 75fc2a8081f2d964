/* SPDX-License-Identifier: MIT
 *
 * path_trace.h - runs the transport of trace.h over images: knobs, films, checkpoint files. The method's only external symbol is
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

/* --- film.c: per-pixel sums of samples ---------------------------------------------------------------------------------------------- */

/* An exact sum: a 128-bit integer in two's complement, in units of 2^-64 of the film's unit. Independent of the order of addition. */
struct pt_sum {
    uint64_t low;
    int64_t high;
};

/* Sums over the samples of one pixel, W/(m^2 sr). */
struct pt_pixel {
    struct pt_sum sum[3][3];  /* [multiple, single, surface][channel] */
    struct pt_sum squares[4]; /* of R, G, B and luminance of the visible parts, in 2^-64 of the squared unit; saturating */
    uint32_t count;           /* samples */
};

enum pt_component { PT_MULTIPLE, PT_SINGLE, PT_SURFACE, PT_COMPONENTS };

/* Pixels of a tile, in scan order; a tile is the unit of files and ranks. */
#define PT_TILE 8
/* Maximum number of spans of a tile. */
#define PT_SPANS 4096

/* Samples of a tile: first, first + 1, ... end - 1. */
struct pt_span {
    uint32_t first, end;
};

/* The translucent pixels of one sample of the multisample, and which of their samples are included. */
struct pt_film {
    size_t count, capacity;
    uint64_t identity;       /* hash of the positions visible in its pixels */
    int exponent;            /* its unit is 2^exponent W/(m^2 sr) */
    struct pt_pixel *pixels; /* tile by tile, row by row within a tile */
    size_t tiles;
    uint32_t *starts;      /* tiles + 1 entries: the first pixel of each */
    uint16_t *num_spans;   /* per tile */
    struct pt_span *spans; /* span_capacity entries per tile, the first num_spans in use: sorted and disjoint */
    uint32_t span_capacity;
};

/* Number of tiles of an image, in rows from the top. */
static inline size_t pt_tiles(uint32_t width, uint32_t height)
{
    return (size_t) ((width + PT_TILE - 1) / PT_TILE) * ((height + PT_TILE - 1) / PT_TILE);
}

/* Adds a sample; `traced`: the surface reflection is included. A sample that is not finite, or exceeds 2^31 units, is added as black:
 * false. */
bool pt_pixel_add(struct pt_pixel *pixel, int exponent, const struct pt_light *light, bool traced);
/* Adds all samples of another pixel. */
void pt_pixel_merge(struct pt_pixel *pixel, const struct pt_pixel *other);
/* The sum's value, if its unit is 2^exponent. */
double pt_sum_value(const struct pt_sum *sum, int exponent);
/* Mean and standard error of R, G, B and luminance of the visible parts; without samples: 0. */
void pt_pixel_measure(const struct pt_pixel *pixel, int exponent, bool traced, double mean[4], double error[4]);
/* Root mean square over pixels of the relative standard error of the luminance. Pixels darker than 1/100 of the mean count as if they had
 * that luminance. 0: the film is black; INFINITY: some pixel has fewer than 2 samples. */
double pt_film_error(const struct pt_film *film, bool traced);

/* Creates an empty film whose tiles have these numbers of pixels. Zeroed on failure. */
PELL_NODISCARD enum pell_result pt_film_create(struct pell_context *ctx, const uint8_t *pixels, size_t tiles, struct pt_film *film);
void pt_film_free(struct pell_context *ctx, struct pt_film *film);
/* Reserves `more` further spans per tile; PELL_ERR_NOMEM. */
PELL_NODISCARD enum pell_result pt_film_reserve(struct pell_context *ctx, struct pt_film *film, uint32_t more);
/* The first missing sample of a tile from `from` on, and the next one that is present (or UINT32_MAX). */
uint32_t pt_film_missing(const struct pt_film *film, size_t tile, uint32_t from, uint32_t *end);
/* Records samples that were missing. Needs a reserved span. */
void pt_film_cover(struct pt_film *film, size_t tile, struct pt_span span);
/* Records the samples of `from`. PELL_ERR_INVALID: some were present already; *tile and *sample are the first. Then nothing is added. */
PELL_NODISCARD enum pell_result pt_film_merge(struct pell_context *ctx, struct pt_film *film, const struct pt_film *from, size_t *tile,
                                              uint32_t *sample);
/* Whether all samples of `part` are in the film. */
bool pt_film_holds(const struct pt_film *film, const struct pt_film *part);

struct pell_communicator;
/* Collective: sums the films of all ranks, with the same number of pixels, into those of `total` on rank 0. */
PELL_NODISCARD enum pell_result pt_ranks_reduce(struct pell_context *ctx, const struct pell_communicator *comm, const struct pt_film *film,
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

/* Identifies a run; a file must match to be continued. */
struct pt_checkpoint_key {
    uint32_t width, height, films; /* films: samples of the multisample */
    uint64_t scene;
    int64_t seed;
    int32_t words[PT_KEY_WORDS]; /* knobs that affect samples */
    float roulette;
    int32_t exponent; /* of the films */
    char version[32]; /* of the program, padded with 0 */
};

/* Serialises these films, to memory owned by the caller (pell_free). `note`: a text of the program, NULL: none. */
PELL_NODISCARD enum pell_result pt_checkpoint_encode(struct pell_context *ctx, const struct pt_checkpoint_key *key, const char *note,
                                                     const struct pt_film *films, uint8_t **data, size_t *size);
/* The note of any file, owned by the caller (pell_free). PELL_ERR_FORMAT: there is none, or it is damaged; PELL_ERR_INVALID: another
 * version. Both are logged with `path`. */
PELL_NODISCARD enum pell_result pt_checkpoint_note(struct pell_context *ctx, const char *path, const uint8_t *data, size_t size,
                                                   char **note);
/* Reads key->films films, owned by the caller (pt_film_free); none on failure. PELL_ERR_FORMAT: damaged; PELL_ERR_INVALID: does not match
 * `key`. Both are logged with `path`. */
PELL_NODISCARD enum pell_result pt_checkpoint_decode(struct pell_context *ctx, const char *path, const uint8_t *data, size_t size,
                                                     const struct pt_checkpoint_key *key, struct pt_film *films);

extern const struct pell_method_engine pell_path_trace_cpu;

#endif
