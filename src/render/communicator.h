/* SPDX-License-Identifier: MIT
 *
 * communicator.h - communication of the processes (ranks) that render one frame together, as methods use it; the command line implements
 * it by MPI. All ranks render the same scene with the same settings; rank 0 gets the frame.
 *
 * Threads    all functions are called by the rendering thread. Collective ones are called by all ranks, in the same order.
 */
#ifndef PELL_COMMUNICATOR_H
#define PELL_COMMUNICATOR_H

#include <pellucid/render.h>

struct pell_communicator {
    void *user;
    int rank, ranks;
    bool finished; /* set by the method: all ranks have ended the frame together */
    /* Collective: starts a list of work items with indices from 0. */
    void (*begin)(void *user);
    /* Assigns `count` further items to this rank. Returns the index of the first. */
    int64_t (*take)(void *user, int64_t count);
    /* Ends the list: from here on take() returns indices that are too large, on all ranks. */
    void (*stop)(void *user);
    /* Collective: whether `mine` is true on any rank. */
    bool (*any)(void *user, bool mine);
    /* Collective: copies data from rank 0 to all ranks. */
    void (*broadcast)(void *user, void *data, size_t size);
    void (*send)(void *user, int to, const void *data, size_t size);
    /* Receives at most `size` bytes; returns their number. */
    size_t (*receive)(void *user, int from, void *data, size_t size);
};

/* Applies from the next frame on; NULL: this process renders alone. `comm` is borrowed. */
void pell_renderer_set_communicator(struct pell_renderer *r, struct pell_communicator *comm);

#endif
