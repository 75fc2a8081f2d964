/* SPDX-License-Identifier: MIT
 * method_form.h - knobs that make every method of the registry fast enough for a test. */
#ifndef PELL_METHOD_FORM_H
#define PELL_METHOD_FORM_H

#include "stage.h"

/* Knobs, as for stage_method, with which an image of some hundred pixels takes a fraction of a second. */
static inline const char *const *method_form(const struct pell_method *m)
{
    static const struct {
        const char *method, *knobs[4];
    } forms[] = {
        { "texture-space", { "size=64", "tsm-size=64", NULL } }, { "image-space", { "samples=16", NULL } },
        { "layered", { "samples=8", "lamps=2", NULL } },         { "hierarchical", { "points=4096", NULL } },
        { "dipole", { "error=1", "most=128", NULL } },           { "path-trace", { "samples=2", NULL } },
        { "single-scatter", { "error=1", "most=128", NULL } },
    };
    static const char *const plain[] = { NULL };

    for (size_t i = 0; i < PELL_COUNT(forms); i++)
        if (strcmp(forms[i].method, m->name) == 0)
            return forms[i].knobs;
    return plain;
}

#endif
