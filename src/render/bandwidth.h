/* SPDX-License-Identifier: MIT
 * bandwidth.h - the time to copy a stage's bytes on this machine, as a baseline for its time. */
#ifndef PELL_BANDWIDTH_H
#define PELL_BANDWIDTH_H

#include "base/pool.h"

#include <pellucid/render.h>

#define PELL_BANDWIDTH_RUNS 9

struct pell_bandwidth {
    bool wanted;
    char *block; /* of 2 x `bytes` */
    size_t bytes;
    unsigned runs;
    double seconds[PELL_BANDWIDTH_RUNS]; /* of the last runs, as a ring */
};

/* Allocates buffers for four planes of the image's size (as many as a blur reads: a key and three channels). */
PELL_NODISCARD enum pell_result pell_bandwidth_plan(struct pell_context *ctx, struct pell_bandwidth *b, int width, int height);
void pell_bandwidth_finish(struct pell_context *ctx, struct pell_bandwidth *b);

/* After a frame: sets bandwidth_ms of its stages. The pool's threads copy forth and back, and the copy back is timed: its input was last
 * touched one pass ago, as between stages, so it is in the outer caches or in memory depending on the image size. The median of the last
 * frames is used, which is robust to outliers. */
void pell_bandwidth_measure(struct pell_pool *pool, struct pell_bandwidth *b, struct pell_stage_time *stages, size_t num_stages);

#endif
