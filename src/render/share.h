/* SPDX-License-Identifier: MIT
 *
 * share.h - processes that render one frame together: what a method needs of whatever joins them. All ranks render the same scene with the
 * same settings; rank 0 ends with the frame.
 *
 * Threads    everything here is called by the thread that renders. What is said to be collective is called by all ranks, in one order.
 */
#ifndef PELL_SHARE_H
#define PELL_SHARE_H

#include <pellucid/render.h>

struct pell_share {
    void *user;
    int rank, ranks;
    bool finished; /* set by the method: all ranks have ended the frame together */
    /* Collective: work begins whose items are numbered from 0. */
    void (*begin)(void *user);
    /* `count` further items for this rank, and the number of the first. */
    int64_t (*take)(void *user, int64_t count);
    /* Indices from take() from here on are too large, for all ranks. */
    void (*stop)(void *user);
    /* Collective: whether it is true of any rank. */
    bool (*any)(void *user, bool mine);
    /* Collective: from rank 0 to all. */
    void (*broadcast)(void *user, void *data, size_t size);
    void (*send)(void *user, int to, const void *data, size_t size);
    /* At most `size` bytes; returns how many came. */
    size_t (*receive)(void *user, int from, void *data, size_t size);
};

/* From the next frame on; NULL: the renderer works alone. Borrowed. */
void pell_renderer_set_share(struct pell_renderer *r, struct pell_share *share);

#endif
