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

/* Sums over the samples of one pixel, W/(m^2 sr). */
struct pt_pixel {
    double sum[3][3]; /* [multiple, single, surface][channel] */
    double spread[4]; /* of R, G, B and luminance of the parts that count: sum of squared distances from the mean */
    uint32_t count;   /* samples */
};

enum pt_part { PT_MULTIPLE, PT_SINGLE, PT_SURFACE, PT_PARTS };

/* The translucent pixels of one sample of the multisample. */
struct pt_film {
    size_t count, capacity;
    uint64_t identity;       /* of the places that its pixels see */
    struct pt_pixel *pixels; /* in the order of rows */
};

/* Adds a sample; `traced`: what the surface reflects counts, too. One that is not finite counts as black: false. */
bool pt_pixel_add(struct pt_pixel *pixel, const struct pt_light *light, bool traced);
/* Mean and its standard error of R, G, B and luminance of the parts that count; of no sample: 0. */
void pt_pixel_measure(const struct pt_pixel *pixel, bool traced, double mean[4], double error[4]);
/* Root of the mean over pixels of the squared relative standard error of the luminance. Pixels darker than 1/100 of the mean count as if
 * they were as bright as that. 0: the film is black; INFINITY: some pixel has fewer than 2 samples. */
double pt_film_error(const struct pt_film *film, bool traced);

/* --- checkpoint.c: films in a file -------------------------------------------------------------------------------------------------- */

/* What a file must be of to be gone on with. */
struct pt_checkpoint_key {
    uint32_t width, height, films; /* films: samples of the multisample */
    uint64_t scene, run;           /* run: knobs, settings and seed, as far as they change what a sample gives */
};

/* The bytes of a file of these films, owned by the caller (pell_free). */
PELL_NODISCARD enum pell_result pt_checkpoint_encode(struct pell_context *ctx, const struct pt_checkpoint_key *key,
                                                     const struct pt_film *films, uint8_t **data, size_t *size);
/* Fills key->films films, whose pixels are the caller's (pell_free), on failure none. PELL_ERR_FORMAT: damaged; PELL_ERR_INVALID: of
 * something else than `key`. Both are logged with `path`. */
PELL_NODISCARD enum pell_result pt_checkpoint_decode(struct pell_context *ctx, const char *path, const uint8_t *data, size_t size,
                                                     const struct pt_checkpoint_key *key, struct pt_film *films);

extern const struct pell_method_engine pell_path_trace_cpu;

#endif
