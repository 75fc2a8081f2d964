/* SPDX-License-Identifier: MIT
 * knob_text.c - parses a method's knobs from one line of text, and sets single knobs. */
#include "base/base.h"

#include <pellucid/method.h>

#include <stdio.h>
#include <string.h>

enum { SHOWN = 96 };
static const char breaks[] = " \t\r\n,";
static const char where[] = "knobs";

/* The next "name=value" of *text, which is advanced; name and value become 0-terminated. Text after a comma without a '=' of its own
 * belongs to the previous value: "tint=1,0.5,0.2 lod=2". False at the end of the text, or with *res set if a '=' is missing. */
static bool next_setting(struct pell_context *ctx, char **text, struct pell_setting *setting, enum pell_result *res)
{
    char *name = *text + strspn(*text, breaks), *end = name + strcspn(name, breaks), *next = end + strspn(end, breaks);
    char *equals = memchr(name, '=', (size_t) (end - name)), shown[SHOWN];

    if (!*name)
        return false;
    if (!equals) {
        *end = '\0';
        *res = pell_error(ctx, PELL_ERR_INVALID, where, "write gaussians=6, without spaces around =", "\"%s\" is not NAME=VALUE",
                          pell_printable(name, shown, sizeof(shown)));
        return false;
    }
    while (*next && memchr(end, ',', (size_t) (next - end)) && !memchr(next, '=', strcspn(next, breaks))) {
        end = next + strcspn(next, breaks);
        next = end + strspn(end, breaks);
    }
    *equals = *end = '\0';
    *setting = (struct pell_setting) { name, equals + 1, where };
    *text = next;
    return true;
}

enum pell_result pell_method_knobs_create(struct pell_context *ctx, const struct pell_method *method, const char *text, void **out)
{
    if (out)
        *out = NULL;
    if (!ctx || !method || !out)
        return pell_null(ctx, "pell_method_knobs_create");

    struct pell_setting *settings = NULL;
    char *copy = NULL, *rest;
    size_t most = 0, count = 0;
    enum pell_result res = PELL_ERR_NOMEM;
    void *knobs = NULL;

    *out = NULL;
    for (const char *c = text; c && *c; c++)
        most += *c == '=';
    if (!(knobs = pell_alloc(ctx, method->knobs_size)) || !(copy = pell_strdup(ctx, text ? text : "")) ||
        !(settings = pell_alloc_array(ctx, most, sizeof(*settings))))
        goto fail;
    res = PELL_OK;
    rest = copy;
    for (struct pell_setting one; next_setting(ctx, &rest, &one, &res);)
        settings[count++] = one;
    if (res != PELL_OK)
        goto fail;
    PELL_TRY(pell_method_configure(ctx, method, settings, count, knobs));
    *out = knobs;
    knobs = NULL;
fail:
    pell_free(ctx, settings);
    pell_free(ctx, copy);
    pell_free(ctx, knobs);
    return res;
}

void pell_method_knobs_destroy(struct pell_context *ctx, void **knobs)
{
    pell_free(ctx, *knobs);
    *knobs = NULL;
}

/* "as" selects the defaults of all knobs, so setting it alone would leave the others unchanged. */
static enum pell_result check_single(struct pell_context *ctx, const struct pell_method *method, const char *name, char owner[SHOWN])
{
    snprintf(owner, SHOWN, "method %s", method->name);
    if (strcmp(name, "as") != 0)
        return PELL_OK;
    return pell_error(ctx, PELL_ERR_INVALID, where, "pell_method_knobs_create takes it",
                      "\"as\" chooses the defaults of all knobs of %s and can't be set by itself", owner);
}

enum pell_result pell_method_knobs_set_text(struct pell_context *ctx, const struct pell_method *method, void *knobs, const char *name,
                                            const char *text)
{
    if (!method || !knobs || !name || !text)
        return pell_null(ctx, "pell_method_knobs_set_text");

    char owner[SHOWN];
    const enum pell_result res = check_single(ctx, method, name, owner);

    return res == PELL_OK ? pell_knob_set(ctx, method->knobs, owner, where, knobs, name, text) : res;
}

enum pell_result pell_method_knobs_set_number(struct pell_context *ctx, const struct pell_method *method, void *knobs, const char *name,
                                              double number)
{
    if (!method || !knobs || !name)
        return pell_null(ctx, "pell_method_knobs_set_number");

    char owner[SHOWN];
    const enum pell_result res = check_single(ctx, method, name, owner);

    return res == PELL_OK ? pell_knob_set_number(ctx, method->knobs, owner, where, knobs, name, number) : res;
}
