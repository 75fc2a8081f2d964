/* SPDX-License-Identifier: MIT
 *
 * run.h - state of a run over the pixels of a frame: for cpu.c, which traces, and films.c, which reads and writes.
 */
#ifndef PELL_PATH_TRACE_RUN_H
#define PELL_PATH_TRACE_RUN_H

#include "methods/path_trace/path_trace.h"
#include "methods/reference_frame.h"
#include "render/communicator.h"

struct pt_state {
    struct reference_frame frame;         /* first member */
    const struct pell_services *services; /* borrowed */
    struct pell_context *ctx;
    struct pt_method_knobs knobs;
    struct pt_scene *scene;
    struct pt_walker **walkers;
    int threads;
    struct pt_film *films; /* one per sample of the multisample if they are kept, else one in total */
    size_t num_films;
    uint32_t *pixel_index; /* indices of the film's pixels in the planes */
    size_t pixel_index_capacity;
    uint8_t *tile_pixels; /* number of pixels per tile */
    size_t tiles_capacity;
    struct pt_counts before; /* of all previous frames */
    double begin, written;   /* start of the frame; time of the last checkpoint */
    double shown;            /* reported progress */
    bool unfinished;         /* the frame is incomplete because of a time limit or an interruption */
    atomic_bool invalid;     /* some sample of the frame was not finite */
    atomic_bool late;        /* the round was abandoned at the deadline */
    bool unwritten;          /* writing the last checkpoint failed */
    bool gaps;               /* missing samples in merged files have been reported */
    uint64_t made;           /* samples per pixel, over all samples of the multisample so far, */
    uint32_t fewest, most;   /* and per sample of the multisample */
    double error2;           /* sum of their squared errors; INFINITY: some is unknown */
    struct pt_film *done;    /* per film: samples present at the beginning of a shared run; spans only */
    struct pt_film total;    /* of all ranks, on rank 0: pixels only */
    struct pt_film saved;    /* the film before the round, if there is a deadline */
    uint32_t *tasks;         /* first tile of each task of a round, and the end */
    size_t tasks_capacity;
};

/* One sample of the multisample. */
struct pt_run {
    struct pt_state *st;
    const struct pell_frame *in;
    struct pt_film *film;
    const struct pt_film *done;  /* samples to skip besides the film's; NULL: none */
    const struct pt_film *shown; /* the film, or on rank 0 that of all ranks */
    struct pell_view view;
    uint32_t index;  /* index of the sample of the multisample */
    uint32_t from;   /* first sample per pixel of the run */
    uint32_t low;    /* first sample of the round */
    uint32_t target; /* end of the round's samples per pixel */
    size_t first_tile, end_tile;
    size_t first; /* task of the batch */
};

/* Stopping criteria of a run. */
struct pt_goal {
    uint32_t most;   /* maximum number of samples */
    uint32_t least;  /* samples before the error estimate is used */
    double error;    /* of this film; 0: not a criterion */
    double deadline; /* INFINITY: none */
    double begin;
    uint32_t first; /* samples present at the beginning */
    double needed;  /* estimated number of samples to reach the error; INFINITY */
};

enum {
    PT_ROUND_SAMPLES = 4,    /* samples of a pixel per round, from the fourth on */
    PT_TASK_PIXELS = 449,    /* pixels per task, in whole tiles: many paths, so that lanes are seldom idle */
    PT_MAX_SAMPLES = 1 << 30 /* samples per pixel */
};

#define PT_BATCH_SECONDS 0.25 /* between two checks of the clock */

/* Whether reflected light is traced. */
static inline bool pt_traced(const struct pt_state *st)
{
    return st->knobs.surface == PT_SURFACE_TRACED;
}

/* Whether the frame only merges the samples of files. */
static inline bool pt_merges(const struct pt_state *st)
{
    return st->services->checkpoint && st->services->checkpoint->mode != PELL_CHECKPOINT_RENDER;
}

/* NULL: a single process. */
static inline struct pell_communicator *pt_communicator(const struct pt_state *st)
{
    return st->services->communicator;
}

/* --- tasks.c -------------------------------------------------------------------------------------------------------------------------- */

/* Forms tasks of adjacent tiles with about this many pixels. */
PELL_NODISCARD enum pell_result pt_list_tasks(struct pt_run *run, size_t pixels, size_t *count);
/* Runs task `index` of the batch: the missing samples from run->low to run->target. */
void pt_do_task(void *run, int index, int worker);
/* Samples from the run's first on that all pixels of its tiles have in `film`, and the largest number of one pixel. */
void pt_count_range(const struct pt_run *run, const struct pt_film *film, uint32_t *least, uint32_t *most);
void pt_show(struct pt_run *run, double done);
double pt_progress_of(const struct pt_goal *g, double samples);

/* --- ranks.c: a run of several ranks ----------------------------------------------------------------------------------------------- */

/* Collective, like all that follows. Reads the results of earlier runs. */
PELL_NODISCARD enum pell_result pt_ranks_start(struct pt_state *st, const struct pell_frame *in);
/* Runs rounds until the goal is reached. Afterwards run->shown on rank 0 has the samples of all ranks. */
PELL_NODISCARD enum pell_result pt_ranks_run(struct pt_run *run, struct pt_goal *goal);
/* Writes the films to keep. */
PELL_NODISCARD enum pell_result pt_ranks_finish(struct pt_state *st, const struct pell_frame *in);

/* --- films.c -------------------------------------------------------------------------------------------------------------------------- */

struct pt_checkpoint_key pt_make_key(const struct pt_state *st, const struct pell_frame *in);
PELL_NODISCARD enum pell_result pt_read_file(struct pt_state *st, const struct pt_checkpoint_key *key, const char *path,
                                             struct pt_film *films);
/* Adds the samples of `more` to one sample of the multisample; may take ownership of its memory. */
PELL_NODISCARD enum pell_result pt_merge_film(struct pt_state *st, const char *path, struct pt_film *film, struct pt_film *more);
#define PT_RANK_SUFFIX ".rank"
/* File of a rank's films. */
void pt_rank_path(const char *path, int rank, char *out, size_t size);
void pt_drop_films(struct pt_state *st);
/* Reads the films of the checkpoint, or of the files to be merged. */
PELL_NODISCARD enum pell_result pt_read_films(struct pt_state *st, const struct pell_frame *in);
/* A failure such as a full disk must not end hours of work: it is reported, and the run continues. PELL_ERR_IO and an error at the last
 * write of a run whose file is its result: a part of an image, or merged parts. */
PELL_NODISCARD enum pell_result pt_write_films(struct pt_state *st, const struct pell_frame *in, bool last);
/* Prepares the film of a sample: empty, or from the files. */
PELL_NODISCARD enum pell_result pt_start_film(struct pt_run *run);
/* PELL_ERR_INVALID, and a message, if samples before `end` are missing that are required. */
PELL_NODISCARD enum pell_result pt_check_gaps(const struct pt_run *run, uint32_t end);

#endif
