/* SPDX-License-Identifier: MIT
 *
 * corners.h - indices for the distinct corners of one mesh.
 */
#ifndef PELL_SCENE_OBJ_CORNERS_H
#define PELL_SCENE_OBJ_CORNERS_H

#include "base/base.h"

struct pell_obj_corner {
    uint32_t v, vt, vn; /* v from 0; vt and vn from 1, 0: none */
};

/* Indices for the distinct corners of one mesh. Most vertices have one corner only, which `first` finds; seams use a hash table. A corner
 * that finds no slot near its own becomes a separate vertex, which is also correct, and bounds the time. */
struct pell_obj_numbering {
    struct pell_context *ctx;
    uint32_t *first; /* per v of the file: vertex + 1 of its first corner in this mesh */
    struct pell_obj_corner *unique;
    size_t count, capacity;
    uint32_t *slots;
    size_t num_slots, used;
};

/* The index of a corner among the distinct ones so far, or the next index. */
PELL_NODISCARD enum pell_result pell_obj_number_corner(struct pell_obj_numbering *n, const struct pell_obj_corner *c, uint32_t *number);

#endif
