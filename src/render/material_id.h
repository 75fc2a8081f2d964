/* SPDX-License-Identifier: MIT
 *
 * material_id.h - checked access to the material plane: on a caller's planes an id may have any value.
 */
#ifndef PELL_MATERIAL_ID_H
#define PELL_MATERIAL_ID_H

#include <pellucid/frame.h>

/* The material id at [at] of the frame's planes; 0, not translucent, for an id above num_materials. */
static inline uint16_t pell_material_id(const struct pell_frame *frame, ptrdiff_t at)
{
    const uint16_t id = frame->material[at];

    return id <= frame->shape.num_materials ? id : 0;
}

#endif
