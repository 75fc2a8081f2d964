/* SPDX-License-Identifier: MIT
 *
 * run.h - what a run over the pixels of a frame holds: for cpu.c, which traces, and films.c, which reads and writes.
 */
#ifndef PELL_PATH_TRACE_RUN_H
#define PELL_PATH_TRACE_RUN_H

#include "methods/path_trace/path_trace.h"
#include "methods/reference_frame.h"

struct pt_state {
    struct reference_frame frame;         /* first */
    const struct pell_services *services; /* borrowed */
    struct pell_context *ctx;
    struct pt_method_knobs knobs;
    struct pt_scene *scene;
    struct pt_walker **walkers;
    int threads;
    struct pt_film *films; /* of each sample of the multisample where they are kept, else one for all */
    size_t num_films;
    uint32_t *places; /* of the film's pixels in the planes */
    size_t places_capacity;
    struct pt_counts before; /* of all frames before this */
    double begin, written;   /* of the frame; of the last checkpoint */
    double shown;            /* progress */
    bool unfinished;         /* the frame, because of a time limit or an interruption */
    atomic_bool invalid;     /* some sample of the frame was no number */
    atomic_bool late;        /* the round was given up at the deadline */
    struct pt_film kept;     /* the film before the round, where there is a deadline */
    uint32_t *tasks;         /* first tile of each task of a round, and the end */
    size_t tasks_capacity;
};

/* One sample of the multisample. */
struct pt_run {
    struct pt_state *st;
    const struct pell_frame *in;
    struct pt_film *film;
    struct pell_view view;
    uint32_t number; /* of the sample */
    uint32_t from;   /* first sample of a pixel that the run makes */
    uint32_t target; /* end of the samples of a pixel after the round */
    size_t first_tile, end_tile;
    size_t first; /* task of the batch */
};

/* Whether what surfaces reflect is traced. */
static inline bool pt_traced(const struct pt_state *st)
{
    return st->knobs.surface == PT_SURFACE_TRACED;
}

/* Whether the frame is of the samples in files, and none is made. */
static inline bool pt_merges(const struct pt_state *st)
{
    return st->services->checkpoint && st->services->checkpoint->mode != PELL_CHECKPOINT_RENDER;
}

void pt_drop_films(struct pt_state *st);
/* The films of the checkpoint, or of the files that are to be merged. */
PELL_NODISCARD enum pell_result pt_read_films(struct pt_state *st, const struct pell_frame *in);
/* A full disk or the like must not end the work of hours: it is said, and the work goes on. PELL_ERR_IO and an error at the last write of a
 * run whose file is its result: a part of a picture, or merged parts. */
PELL_NODISCARD enum pell_result pt_write_films(struct pt_state *st, const struct pell_frame *in, bool last);
/* Readies the film of a sample: empty, or as the files have it. */
PELL_NODISCARD enum pell_result pt_start_film(struct pt_run *run);
/* PELL_ERR_INVALID, and a message, where samples before `end` are missing and must not. */
PELL_NODISCARD enum pell_result pt_check_gaps(const struct pt_run *run, uint32_t end);

#endif
