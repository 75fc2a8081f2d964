/* SPDX-License-Identifier: MIT
 *
 * run.h - what a run over the pixels of a frame holds: for cpu.c, which traces, and films.c, which reads and writes.
 */
#ifndef PELL_PATH_TRACE_RUN_H
#define PELL_PATH_TRACE_RUN_H

#include "methods/path_trace/path_trace.h"
#include "methods/reference_frame.h"
#include "render/share.h"

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
    uint8_t *tile_pixels; /* how many each tile has */
    size_t tiles_capacity;
    struct pt_counts before; /* of all frames before this */
    double begin, written;   /* of the frame; of the last checkpoint */
    double shown;            /* progress */
    bool unfinished;         /* the frame, because of a time limit or an interruption */
    atomic_bool invalid;     /* some sample of the frame was no number */
    atomic_bool late;        /* the round was given up at the deadline */
    bool unwritten;          /* the last checkpoint was not written */
    bool gaps;               /* of the files that are merged, told */
    uint64_t made;           /* samples of a pixel, of all samples of the multisample so far, */
    uint32_t fewest, most;   /* and of one of them */
    double error2;           /* sum of their squared errors; INFINITY: some is not known */
    struct pt_film *done;    /* of each film: samples that were there at the beginning of a shared run; spans alone */
    struct pt_film total;    /* of all ranks, on rank 0: pixels alone */
    struct pt_film kept;     /* the film before the round, where there is a deadline */
    uint32_t *tasks;         /* first tile of each task of a round, and the end */
    size_t tasks_capacity;
};

/* One sample of the multisample. */
struct pt_run {
    struct pt_state *st;
    const struct pell_frame *in;
    struct pt_film *film;
    const struct pt_film *done;  /* samples that are not to be made, beside the film's; NULL: none */
    const struct pt_film *shown; /* the film, or on rank 0 that of all ranks */
    struct pell_view view;
    uint32_t number; /* of the sample */
    uint32_t from;   /* first sample of a pixel that the run makes */
    uint32_t low;    /* first sample of the round */
    uint32_t target; /* end of the samples of a pixel after the round */
    size_t first_tile, end_tile;
    size_t first; /* task of the batch */
};

/* When a run ends. */
struct pt_goal {
    uint32_t most;   /* samples */
    uint32_t least;  /* samples before the error is believed */
    double error;    /* of this film; 0: not asked for */
    double deadline; /* INFINITY: none */
    double begin;
    uint32_t first; /* samples that were there at the beginning */
    double needed;  /* samples that the error asks for, as far as is known; INFINITY */
};

enum {
    PT_TOGETHER = 4,  /* samples of a round, from the fourth on */
    PT_TASK = 449,    /* pixels of a task, and those of one tile more: many walks, so that lanes are seldom free */
    PT_MOST = 1 << 30 /* samples of a pixel */
};

#define PT_BATCH_SECONDS 0.25 /* between two looks at the clock */

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

/* NULL: the run is alone. */
static inline struct pell_share *pt_share(const struct pt_state *st)
{
    return st->services->share;
}

/* --- tasks.c -------------------------------------------------------------------------------------------------------------------------- */

/* Tiles of one task are next to each other, with about so many pixels. */
PELL_NODISCARD enum pell_result pt_list_tasks(struct pt_run *run, size_t pixels, size_t *count);
/* Task `index` of the batch: samples from run->low to run->target that are missing. */
void pt_do_task(void *run, int index, int worker);
/* Samples from the run's first on that all pixels of its tiles have in `film`, and the most that one of them has. */
void pt_count_range(const struct pt_run *run, const struct pt_film *film, uint32_t *least, uint32_t *most);
void pt_show(struct pt_run *run, double done);
double pt_progress_of(const struct pt_goal *g, double samples);

/* --- shared.c: a run by several ranks ----------------------------------------------------------------------------------------------- */

/* Collective, as all that follows. Reads what earlier runs left. */
PELL_NODISCARD enum pell_result pt_share_start(struct pt_state *st, const struct pell_frame *in);
/* Rounds until the goal is reached. On rank 0 run->shown has all samples of all ranks afterwards. */
PELL_NODISCARD enum pell_result pt_share_run(struct pt_run *run, struct pt_goal *goal);
/* Writes what is to be kept. */
PELL_NODISCARD enum pell_result pt_share_finish(struct pt_state *st, const struct pell_frame *in);

/* --- films.c -------------------------------------------------------------------------------------------------------------------------- */

struct pt_checkpoint_key pt_make_key(const struct pt_state *st, const struct pell_frame *in);
PELL_NODISCARD enum pell_result pt_read_file(struct pt_state *st, const struct pt_checkpoint_key *key, const char *path,
                                             struct pt_film *films);
/* Adds what `more` has of a sample of the multisample; it may be taken as it is. */
PELL_NODISCARD enum pell_result pt_merge_film(struct pt_state *st, const char *path, struct pt_film *film, struct pt_film *more);
#define PT_RANK_SUFFIX ".rank"
/* Where a rank keeps its films. */
void pt_rank_path(const char *path, int rank, char *out, size_t size);
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
