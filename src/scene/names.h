/* SPDX-License-Identifier: MIT
 * names.h - a map from arbitrary names in files to ids. */
#ifndef PELL_NAMES_H
#define PELL_NAMES_H

#include "base/base.h"

struct pell_names {
    struct pell_context *ctx; /* set this and `where`, zero the rest */
    const char *where;        /* the file, for messages; borrowed */
    struct pell_name {
        char *text;
        size_t length;
        uint64_t hash;
    } * names;
    size_t count, capacity;
    uint32_t *slots;
    size_t num_slots;
};

/* The id of a name, counted from 0 in order of first insertion; *fresh: the name is new. */
PELL_NODISCARD enum pell_result pell_names_enter(struct pell_names *names, const char *text, size_t length, uint32_t *number, bool *fresh);
void pell_names_finish(struct pell_names *names);

#endif
