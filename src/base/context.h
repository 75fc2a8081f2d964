/* SPDX-License-Identifier: MIT
 * context.h - the inside of a context; only src/base includes it. */
#ifndef PELL_BASE_CONTEXT_H
#define PELL_BASE_CONTEXT_H

#include "base/base.h"

#include <pthread.h>

#define PELL_WARNING_KINDS 64

struct pell_context {
    pell_log_fn log;
    void *log_user;
    enum pell_log_level log_level;
    pell_progress_fn progress;
    void *progress_user;
    struct pell_allocator allocator;
    bool plain; /* the allocator is the C library's */
    struct pell_limits limits;
    pthread_mutex_t log_lock;
    _Atomic size_t used;
    _Atomic uint64_t allocations;
    atomic_bool cancelled;
    _Atomic unsigned writes; /* number of files replaced or created */
    /* twice the number of active sections of pell_interruptible, + 1 if an early end of these, or of the last of them, was requested */
    _Atomic unsigned interruptible;
    _Atomic int in_flight;  /* pell_file_in_flight */
    _Atomic int downgrades; /* pell_log_downgrade */
    /* Number of times each warning was given, by its format; guarded by log_lock. Kinds beyond the table are not counted. */
    struct {
        const char *format;
        int count;
    } warned[PELL_WARNING_KINDS];
    /* Files that were read: a hash table, at most half full, of devices and inodes, 0 and 0 if free; guarded by log_lock. */
    struct pell_file_id {
        uint64_t device, inode;
    } * files;
    size_t num_files, file_slots;
};

#endif
