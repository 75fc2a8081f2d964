/* SPDX-License-Identifier: MIT
 *
 * pool.h - a thread pool that sleeps when idle and hands out task indices by an atomic counter.
 *
 * The thread that calls pell_pool_run works too, so a pool of 1 has no thread of its own. What a task writes must depend on its
 * index alone, never on the worker: then results are bit-identical for any number of threads. Denormals are flushed to zero in
 * workers and, during a run, in the calling thread.
 *
 * Threads    one run at a time per pool; a second caller waits.
 */
#ifndef PELL_POOL_H
#define PELL_POOL_H

#include "base/base.h"

struct pell_pool;

/* `threads` 1..256, or 0 for one per core that this process may use. */
PELL_NODISCARD enum pell_result pell_pool_create(struct pell_context *ctx, int threads, struct pell_pool **out);
void pell_pool_destroy(struct pell_pool **pool);
int pell_pool_threads(const struct pell_pool *pool);

/* Calls task(arg, index, worker) for each index in [0, count) and returns when all are done; worker in [0, threads). Allocates nothing.
 * Once the context is cancelled no further index is handed out (the caller checks pell_cancelled). */
void pell_pool_run(struct pell_pool *pool, int count, void (*task)(void *arg, int index, int worker), void *arg);

#endif
