/* SPDX-License-Identifier: MIT
 *
 * bandwidth.h - what the bytes of a stage would take to copy on this machine, which its time is judged by.
 */
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
    double seconds[PELL_BANDWIDTH_RUNS]; /* of the last rounds */
};

/* Room to copy four planes of the picture's size (a blur's key and light) to and fro. */
PELL_NODISCARD enum pell_result pell_bandwidth_plan(struct pell_context *ctx, struct pell_bandwidth *c, int width, int height);
void pell_bandwidth_finish(struct pell_context *ctx, struct pell_bandwidth *c);

/* After a frame: sets bandwidth_ms of its stages. The pool's threads copy to and fro, and the way back counts: what it reads was last
 * touched a pass ago, as it is between stages, so it is in the outer caches or in memory according to the size of the picture. The median
 * of the last frames, so that one that was lucky does not count, nor one that was disturbed. */
void pell_bandwidth_measure(struct pell_pool *pool, struct pell_bandwidth *c, struct pell_stage_time *stages, size_t num_stages);

#endif
