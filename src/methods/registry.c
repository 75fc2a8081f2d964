/* SPDX-License-Identifier: MIT
 * registry.c - lookup of methods by name, and of their knobs from text. */
#include "base/base.h"

#include <pellucid/method.h>

#include <stdio.h>
#include <string.h>

enum { LISTED = 64, SHOWN = 96 };

const struct pell_method *pell_method_find(struct pell_context *ctx, const char *where, const char *name)
{
    const char *names[LISTED] = { NULL };
    struct pell_text hint = { .length = 0 };
    char shown[SHOWN];
    size_t count = 0;

    for (size_t i = 0; i < pell_method_count(); i++) {
        const struct pell_method *method = pell_method_at(i);

        if (strcmp(method->name, name) == 0)
            return method;
        if (count < LISTED)
            names[count++] = method->name;
    }
    pell_text_suggest_or_list(&hint, "known: ", name, names, count);
    pell_error(ctx, PELL_ERR_INVALID, where, hint.str, "there is no method \"%s\"", pell_printable(name, shown, sizeof(shown)));
    return NULL;
}

/* Sets a knob. If only other methods have a knob of that name, the error names them. */
static enum pell_result set_knob(struct pell_context *ctx, const struct pell_method *method, const char *owner,
                                 const struct pell_setting *setting, void *values)
{
    struct pell_text hint = { .length = 0 };
    char shown[SHOWN];

    if (pell_knob_find(method->knobs, setting->name))
        return pell_knob_set(ctx, method->knobs, owner, setting->where, values, setting->name, setting->value);
    for (size_t i = 0; i < pell_method_count(); i++)
        if (pell_knob_find(pell_method_at(i)->knobs, setting->name))
            pell_text_add(&hint, "%s%s", hint.length ? ", " : "it is a knob of ", pell_method_at(i)->name);
    if (hint.length == 0) /* suggests similar names */
        return pell_knob_set(ctx, method->knobs, owner, setting->where, values, setting->name, setting->value);
    return pell_error(ctx, PELL_ERR_INVALID, setting->where, hint.str, "%s has no knob \"%s\"", owner,
                      pell_printable(setting->name, shown, sizeof(shown)));
}

bool pell_method_runs_on_planes(const struct pell_method *method, const void *knobs)
{
    struct pell_plan plan;

    method->plan(knobs, &plan);
    return !(plan.needs & PELL_NEED_SCENE);
}

enum pell_result pell_method_configure(struct pell_context *ctx, const struct pell_method *method, const struct pell_setting *settings,
                                       size_t num_settings, void *values)
{
    if (!method || (!settings && num_settings) || (!values && method->knobs->type))
        return pell_null(ctx, "pell_method_configure");
    for (size_t i = 0; i < num_settings; i++)
        if (!settings[i].name || !settings[i].value)
            return pell_null(ctx, "pell_method_configure");

    char owner[SHOWN];
    enum pell_result res;

    snprintf(owner, sizeof(owner), "method %s", method->name);
    memset(values, 0, method->knobs_size);
    pell_knobs_default(method->knobs, values);
    for (size_t i = 0; i < num_settings; i++)
        if (strcmp(settings[i].name, "as") == 0)
            PELL_TRY(pell_knob_set(ctx, method->knobs, owner, settings[i].where, values, "as", settings[i].value));
    if (method->paper && pell_method_as_paper(method, values))
        method->paper(values);
    for (size_t i = 0; i < num_settings; i++)
        if (strcmp(settings[i].name, "as") != 0)
            PELL_TRY(set_knob(ctx, method, owner, &settings[i], values));
    return PELL_OK;

fail:
    return res;
}
