/* SPDX-License-Identifier: MIT
 * runs.c - the renderings of `pellucid compare INPUT`: methods and references by name, each with its own knobs
 * ("screen-space:as=paper"). */
#include "cli/compare/compare.h"

#include <stdlib.h>
#include <string.h>

#define DEFAULT_REFERENCE "hierarchical"
#define TRUTH "path-trace" /* the only method that can leave out light between surfaces */

static const struct pell_knob *find_knob(const struct pell_method *method, const char *name)
{
    return method ? pell_knob_find(method->knobs, name) : NULL;
}

/* Makes a unique file name: two labels may give the same one. */
static void name_file(struct run_list *runs, struct run *run)
{
    size_t n = 0;

    for (const char *c = run->label; *c && n < 150; c++, n++)
        run->file[n] = strchr("abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789.-_", *c) && (n > 0 || *c != '.') ? *c : '-';
    run->file[n] = '\0';
    for (size_t i = 0, number = 2; i < runs->count; i++)
        if (&runs->list[i] != run && strcmp(runs->list[i].file, run->file) == 0) {
            snprintf(run->file + n, sizeof(run->file) - n, "-%zu", number++);
            i = (size_t) -1; /* restart from the first run */
        }
}

static enum exit_code add_run(struct cli *cli, struct run_list *runs, const char *where, const char *label)
{
    struct run *run = &runs->list[runs->count];
    char text[sizeof(run->label)], *next, *name;

    if (strlen(label) >= sizeof(run->label))
        return cli_usage(cli, where, NULL, "\"%.60s...\" is too long", label);
    for (size_t i = 0; i < runs->count; i++)
        if (strcmp(runs->list[i].label, label) == 0)
            return cli_usage(
                cli, where, "set a knob of one of them: NAME:KNOB=VALUE",
                i < runs->num_references && strcmp(where, "--methods") == 0 ? "\"%s\" is the reference" : "\"%s\" is named twice", label);
    if (runs->count == MAX_RUNS)
        return cli_usage(cli, where, NULL, "more than %d methods and references", MAX_RUNS);
    memcpy(run->label, label, strlen(label) + 1);
    memcpy(text, label, strlen(label) + 1);
    next = strchr(text, ':');
    if (next)
        *next++ = '\0';
    if (strcmp(text, "none") == 0 && strcmp(where, "--reference") == 0)
        return cli_usage(cli, where, NULL, "none computes no scattering: it can't be the reference");
    if (strcmp(text, "none") != 0 && !(run->method = pell_method_find(cli->ctx, where, text)))
        return cli_failed(cli, PELL_ERR_INVALID);
    runs->count++;
    while ((name = next)) {
        enum exit_code code;
        if ((next = strchr(name, ':')))
            *next++ = '\0';
        if ((code = cli_add_pair(cli, &run->knobs, where, name)) != EXIT_OK)
            return code;
        if (!run->method)
            return cli_usage(cli, where, NULL, "method none has no knob \"%s\"", name);
    }
    name_file(runs, run);
    return EXIT_OK;
}

/* Adds every method, with the knobs after "all". */
static enum exit_code add_all(struct cli *cli, struct run_list *runs, const char *where, const char *knobs)
{
    enum exit_code code = EXIT_OK;

    for (size_t i = 0; i < pell_method_count() && code == EXIT_OK; i++) {
        char label[512];
        if (pell_method_at(i)->kind != PELL_KIND_METHOD)
            continue;
        snprintf(label, sizeof(label), "%s%s", pell_method_at(i)->name, knobs);
        if ((code = add_run(cli, runs, where, label)) == EXIT_OK)
            runs->list[runs->count - 1].optional = true;
    }
    return code;
}

/* "all", or names separated by commas. */
static enum exit_code add_list(struct cli *cli, struct run_list *runs, const char *where, const char *list)
{
    enum exit_code code = EXIT_OK;
    const char *rest = list;

    do {
        const size_t n = strcspn(rest, ",");
        char label[256];
        snprintf(label, sizeof(label), "%.*s", (int) (n < 255 ? n : 255), rest);
        if (n == 0)
            return cli_usage(cli, where, "`pellucid methods` lists them", "\"%s\", a name is missing", list);
        if (strcmp(where, "--methods") == 0 && strncmp(label, "all", 3) == 0 && (label[3] == '\0' || label[3] == ':'))
            code = add_all(cli, runs, where, label + 3);
        else
            code = add_run(cli, runs, where, label);
        rest += n;
    } while (code == EXIT_OK && *rest++ == ',');
    return code;
}

/* A knob of --set applies to the methods that have it; references get theirs in --reference. */
static enum exit_code check_set(struct cli *cli, const struct run_list *runs)
{
    for (size_t k = 0; k < runs->set.count; k++) {
        const char *name = runs->set.items[k].name, *names[256];
        struct pell_text hint = { .length = 0 };
        size_t n = 0;
        bool known = false;

        for (size_t i = runs->num_references; i < runs->count; i++) {
            const struct pell_method *m = runs->list[i].method;
            known = known || find_knob(m, name);
            for (const struct pell_knob *row = m ? m->knobs : NULL; row && row->name && n < PELL_COUNT(names); row++)
                names[n++] = row->name;
        }
        if (known)
            continue;
        for (size_t i = 0; i < runs->num_references && hint.length == 0; i++)
            if (find_knob(runs->list[i].method, name))
                pell_text_add(&hint, "for the reference: --reference %s:%s=%.60s", runs->list[i].label, name, runs->set.items[k].value);
        for (size_t i = 0; i < pell_method_count() && hint.length == 0; i++)
            if (find_knob(pell_method_at(i), name))
                pell_text_add(&hint, "it is a knob of %s: add it to --methods", pell_method_at(i)->name);
        if (!cli_option_hint(cli, name, &hint) && hint.length == 0)
            pell_text_suggest(&hint, "", name, names, n);
        return cli_usage(cli, "--set", hint.length > 0 ? hint.str : "`pellucid methods NAME` lists its knobs",
                         "no method that is compared has a knob \"%s\"", name);
    }
    return EXIT_OK;
}

/* Applies the scene file's knobs if they are for this method, then --set, then the label's, which override. `scene` may be NULL. */
static enum exit_code configure(struct cli *cli, const struct run_list *runs, const struct pell_scene *scene, struct run *run)
{
    const bool reference = run < runs->list + runs->num_references;
    const char *scene_method = CLI_DEFAULT_METHOD;
    struct settings_list list = { 0 };
    struct pell_plan plan = { 0 };
    enum pell_result res = PELL_OK;

    if (!run->method)
        return EXIT_OK;
    for (size_t i = 0; scene && i < scene->num_options; i++)
        if (strcmp(scene->options[i].name, "method") == 0)
            scene_method = scene->options[i].value;
    for (size_t i = 0; scene && res == PELL_OK && i < scene->num_options; i++)
        if (strncmp(scene->options[i].name, "knobs/", 6) == 0 && strcmp(scene_method, run->method->name) == 0)
            res = cli_add_setting(&list, scene->options[i].name + 6, scene->options[i].value, scene->options[i].where);
    for (size_t i = 0; !reference && res == PELL_OK && i < runs->set.count; i++)
        if (find_knob(run->method, runs->set.items[i].name))
            res = cli_add_setting(&list, runs->set.items[i].name, runs->set.items[i].value, runs->set.items[i].where);
    if (res == PELL_OK)
        res = cli_append_settings(&list, &run->knobs);
    if (!run->values && !(run->values = calloc(1, run->method->knobs_size)))
        res = PELL_ERR_NOMEM;
    if (res == PELL_OK)
        res = pell_method_configure(cli->ctx, run->method, list.items, list.count, run->values);
    cli_free_settings(&list);
    if (res != PELL_OK)
        return res == PELL_ERR_NOMEM ? EXIT_MEMORY : cli_failed(cli, res);
    run->method->plan(run->values, &plan);
    run->mixes = plan.quantity == PELL_QUANTITY_RADIANCE && !plan.excludes_surface_reflection && !(plan.outputs & PELL_OUTPUT_SURFACE);
    return EXIT_OK;
}

enum exit_code runs_choose(struct cli *cli, struct run_list *runs)
{
    enum exit_code code = add_list(cli, runs, "--reference",
                                   cli->compare.reference   ? cli->compare.reference
                                   : cli->compare.decompose ? TRUTH
                                                            : DEFAULT_REFERENCE);

    runs->set = cli->knobs; /* they belong to several methods: the session's own must not see them */
    cli->knobs = (struct settings_list) { 0 };
    runs->num_references = runs->count;
    if (code == EXIT_OK && runs->num_references > MAX_REFERENCES)
        return cli_usage(cli, "--reference", "methods are measured against the first, the first against the second",
                         "%zu names, must be one or two", runs->num_references);
    if (code == EXIT_OK && cli->compare.decompose && strcmp(runs->list[runs->num_references - 1].method->name, TRUTH) != 0)
        return cli_usage(cli, "--decompose", "--reference path-trace, or hierarchical,path-trace",
                         "the last reference is %s, must be " TRUTH, runs->list[runs->num_references - 1].label);
    if (code == EXIT_OK)
        code = add_list(cli, runs, "--methods", cli->compare.methods ? cli->compare.methods : "all");
    if (code == EXIT_OK)
        code = check_set(cli, runs);
    for (size_t i = 0; i < runs->count && code == EXIT_OK; i++)
        code = configure(cli, runs, NULL, &runs->list[i]);
    return code;
}

/* Removes runs of `all` that this session does not support. */
static void leave_out(struct run_list *runs, const struct session *s)
{
    size_t kept = 0;

    for (size_t i = 0; i < runs->count; i++)
        if (runs->list[i].optional && !session_runs(s, runs->list[i].method))
            free(runs->list[i].values);
        else
            runs->list[kept++] = runs->list[i];
    runs->count = kept;
}

enum exit_code runs_open(struct cli *cli, struct run_list *runs, const struct session *s)
{
    const char *engine = pell_engine_name(pell_device_engine(s->device));
    enum exit_code code = EXIT_OK;

    leave_out(runs, s);
    if (runs->count == runs->num_references)
        return cli_failed(cli, pell_error(cli->ctx, PELL_ERR_DEVICE, "--methods", "name one", "no method runs on engine %s", engine));
    for (size_t i = 0; i < runs->count && code == EXIT_OK; i++) {
        struct run *run = &runs->list[i];
        code = configure(cli, runs, s->scene, run);
        if (code == EXIT_OK)
            code = session_settings(cli, s->scene, run->method, run->values, &run->settings);
        run->settings.layers = true;
        run->settings.denoise = false; /* a scene file may enable it: measurements use the method's unfiltered image */
        if (code == EXIT_OK && run->method && !session_runs(s, run->method))
            code = cli_failed(cli, pell_error(cli->ctx, PELL_ERR_DEVICE, run->label, NULL, "has no engine %s", engine));
    }
    return code;
}

void runs_finish(struct run_list *runs)
{
    for (size_t i = 0; i < runs->count; i++) {
        cli_free_settings(&runs->list[i].knobs);
        free(runs->list[i].values);
        json_decref(runs->list[i].answer);
        json_decref(runs->list[i].shown);
    }
    cli_free_settings(&runs->set);
}
