/* SPDX-License-Identifier: MIT
 *
 * subdivision.h - triangles subdivided into cells (render/indirect/cells.c): which child of a cell contains a point.
 *
 * Pattern 0 makes four cells: one at each corner, and one between the midpoints of the sides. Pattern 1 + k makes two: it bisects the side
 * opposite corner k. A child keeps the corners of its parent where they are, and has midpoints in place of the others.
 */
#ifndef PELL_SHARED_SUBDIVISION_H
#define PELL_SHARED_SUBDIVISION_H

#include "shared/language.h"

#define PELL_CELL_PATTERN_SHIFT 30u /* in a cell's word: the pattern above the index of its first child; 0: no children */
#define PELL_CELL_CHILD_MASK 0x3fffffffu

struct pell_child_cell {
    int32_t child;    /* counted from 0 */
    float w0, w1, w2; /* barycentric coordinates in the child */
};

/* w0, w1, w2: barycentric coordinates in the parent. */
PELL_SHARED PELL_STRUCT(pell_child_cell) pell_child_cell_at(uint32_t pattern, float w0, float w1, float w2)
{
    const float a = pattern == 1u ? w1 : pattern == 2u ? w2 : w0, b = pattern == 1u ? w2 : pattern == 2u ? w0 : w1;
    const float child_a = a >= b ? a - b : 2.0f * a, child_b = a >= b ? 2.0f * b : b - a;
    PELL_STRUCT(pell_child_cell) q;

    if (pattern == 0u) {
        q.child = w0 >= 0.5f ? 0 : w1 >= 0.5f ? 1 : w2 >= 0.5f ? 2 : 3;
        q.w0 = q.child == 3 ? 1.0f - 2.0f * w0 : q.child == 0 ? 2.0f * w0 - 1.0f : 2.0f * w0;
        q.w1 = q.child == 3 ? 1.0f - 2.0f * w1 : q.child == 1 ? 2.0f * w1 - 1.0f : 2.0f * w1;
        q.w2 = q.child == 3 ? 1.0f - 2.0f * w2 : q.child == 2 ? 2.0f * w2 - 1.0f : 2.0f * w2;
    } else {
        q.child = a >= b ? 0 : 1;
        q.w0 = pattern == 1u ? w0 : pattern == 2u ? child_b : child_a;
        q.w1 = pattern == 2u ? w1 : pattern == 1u ? child_a : child_b;
        q.w2 = pattern == 3u ? w2 : pattern == 1u ? child_b : child_a;
    }
    return q;
}

#endif
