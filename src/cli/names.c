/* SPDX-License-Identifier: MIT
 * names.c - names that are none where they stand: knobs that are options, keys of scene files, images in place of meshes. */
#include "cli/cli.h"

#include "base/file.h"

#include <string.h>

bool cli_is_image(const char *path)
{
    static const char *const endings[] = { "exr", "hdr", "pfm", "png", "jpg", "jpeg" };

    for (size_t i = 0; i < PELL_COUNT(endings); i++)
        if (pell_path_has_extension(path, endings[i]))
            return true;
    return false;
}

bool cli_option_hint(const struct cli *cli, const char *name, struct pell_text *hint)
{
    const struct program own = { .commands = cli->command, .num_commands = 1 };
    const char *names[128];
    const size_t count = cli_option_names(&own, names, PELL_COUNT(names));

    for (size_t i = 0; i < count; i++)
        if (strcmp(names[i], name) == 0) {
            pell_text_add(hint, "%sdid you mean the option \"--%s\"?", hint->length ? "; " : "", name);
            return true;
        }
    return false;
}

/* Adds the methods that have a knob. */
static void add_owners(struct pell_text *hint, const char *name)
{
    for (size_t m = 0; m < pell_method_count(); m++)
        if (pell_knob_find(pell_method_at(m)->knobs, name))
            pell_text_add(hint, "%s%s", hint->length ? ", " : "it is a knob of ", pell_method_at(m)->name);
}

enum exit_code cli_check_render_key(struct cli *cli, const struct pell_setting *setting)
{
    const char *names[64] = { "method", "knobs", "samples", "time-limit", "target-error" };
    struct pell_text hint = { .length = 0 };
    size_t count = 5;

    if (pell_knob_find(pell_settings_knobs(), setting->name))
        return EXIT_OK;
    for (const struct pell_knob *k = pell_settings_knobs(); k->name && count < PELL_COUNT(names); k++)
        if (strcmp(k->name, "layers") != 0) /* follows from the format */
            names[count++] = k->name;
    add_owners(&hint, setting->name);
    if (hint.length)
        pell_text_add(&hint, ": write it into \"knobs\"");
    else if (!pell_text_suggest(&hint, "", setting->name, names, count))
        for (size_t i = 0; i < count; i++)
            pell_text_add(&hint, "%s%s", i ? ", " : "the keys are ", names[i]);
    pell_text_add(&hint, "%s `pellucid render --help` describes them", hint.str[hint.length - 1] == '?' ? "" : ";");
    return cli_failed(cli,
                      pell_error(cli->ctx, PELL_ERR_INVALID, setting->where, hint.str, "\"render\" has no key \"%.96s\"", setting->name));
}

enum exit_code cli_check_knob_names(struct cli *cli)
{
    const struct program own = { .commands = cli->command, .num_commands = 1 };

    for (size_t i = 0; i < cli->knobs.count; i++) {
        const struct pell_setting *s = &cli->knobs.items[i];
        const char *names[512];
        struct pell_text hint = { .length = 0 };
        size_t count = 0;
        bool known = false;
        for (size_t m = 0; m < pell_method_count(); m++)
            for (const struct pell_knob *k = pell_method_at(m)->knobs; k->name; k++) {
                known |= strcmp(k->name, s->name) == 0;
                if (count < PELL_COUNT(names))
                    names[count++] = k->name;
            }
        if (known)
            continue;
        if (!cli_option_hint(cli, s->name, &hint) && !pell_text_suggest(&hint, "", s->name, names, count)) {
            count = cli_option_names(&own, names, PELL_COUNT(names));
            if (!pell_text_suggest(&hint, "--", s->name, names, count))
                pell_text_add(&hint, "`pellucid methods NAME` lists those of a method");
        }
        return cli_usage(cli, s->where, hint.str, "no method has a knob \"%.96s\"", s->name);
    }
    return EXIT_OK;
}

enum exit_code cli_check_knobs_of(struct cli *cli, const struct pell_method *method, const struct settings_list *given)
{
    for (size_t i = 0; i < given->count; i++) {
        const struct pell_setting *s = &given->items[i];
        const bool file = s->where[0] != '-';
        struct pell_text hint = { .length = 0 };

        if (pell_knob_find(method->knobs, s->name))
            continue;
        add_owners(&hint, s->name);
        if (!pell_knob_find(pell_settings_knobs(), s->name) || (!file && !cli_option_hint(cli, s->name, &hint)))
            continue; /* the library reports it */
        if (file)
            pell_text_add(&hint, "%sdid you mean \"%s\" beside \"knobs\"?", hint.length ? "; " : "", s->name);
        return cli_failed(
            cli, pell_error(cli->ctx, PELL_ERR_INVALID, s->where, hint.str, "method %s has no knob \"%.96s\"", method->name, s->name));
    }
    return EXIT_OK;
}
