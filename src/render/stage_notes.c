/* SPDX-License-Identifier: MIT
 * stage_notes.c - times of a frame's stages. */
#include "render/engine.h"

#include <string.h>

void pell_stage_note(struct pell_stage_notes *notes, const char *name, double seconds, int64_t pixels, int64_t rays, int64_t bytes)
{
    struct pell_stage_time *s = NULL;

    for (size_t i = 0; i < notes->count && !s; i++)
        if (strcmp(notes->rows[i].name, name) == 0)
            s = &notes->rows[i];
    if (!s) {
        if (notes->count == PELL_STAGES_MOST)
            return;
        s = &notes->rows[notes->count++];
        *s = (struct pell_stage_time) { .name = name };
    }
    s->ms += 1e3 * seconds;
    s->pixels += pixels;
    s->rays += rays;
    s->bytes += bytes;
}
