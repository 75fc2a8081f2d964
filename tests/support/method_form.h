/* SPDX-License-Identifier: MIT
 *
 * method_form.h - every method of the registry on every engine that it has, small enough for a test: for properties that all methods owe.
 */
#ifndef PELL_METHOD_FORM_H
#define PELL_METHOD_FORM_H

#include "stage.h"

static const enum pell_engine method_engines[] = { PELL_ENGINE_CPU, PELL_ENGINE_VULKAN };

static inline bool method_has(const struct pell_method *m, enum pell_engine engine)
{
    return engine == PELL_ENGINE_CPU ? m->cpu != NULL : m->vulkan != NULL;
}

#define FOR_EACH_METHOD_AND_ENGINE(m, engine)                                                                                              \
    for (size_t m##_index = 0; m##_index < pell_method_count(); m##_index++)                                                               \
        for (const struct pell_method *m = pell_method_at(m##_index); m; m = NULL)                                                         \
            for (size_t engine##_index = 0; engine##_index < PELL_COUNT(method_engines); engine##_index++)                                 \
                for (enum pell_engine engine = method_engines[engine##_index]; engine != PELL_ENGINE_AUTO; engine = PELL_ENGINE_AUTO)      \
                    if (method_has(m, engine))

/* Knobs, as for stage_method, with which a picture of some hundred pixels takes a fraction of a second. */
static inline const char *const *method_form(const struct pell_method *m)
{
    static const struct {
        const char *method, *knobs[4];
    } forms[] = {
        { "texture-space", { "size=64", "tsm-size=64", NULL } }, { "image-space", { "samples=16", NULL } },
        { "layered", { "samples=8", "lamps=2", NULL } },         { "hierarchical", { "most=4096", NULL } },
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
