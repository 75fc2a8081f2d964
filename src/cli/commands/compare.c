/* SPDX-License-Identifier: MIT
 * compare.c - `pellucid compare`: two pictures, or methods on one scene against a reference; which of the two is asked for. */
#include "cli/compare/compare.h"

#include "base/file.h"

#include <string.h>

/* Options that one kind of comparison takes and the other does not. */
static const char *const of_pictures[] = { "--layer", "--mask", "--half" };
static const char *const of_scenes[] = { "--methods", "--reference", "--set",    "--material", "--size",          "--unit",
                                         "--camera",  "--time",      "--engine", "--device",   "--allow-outside", "--decompose" };

static const char *first_given(const struct cli *cli, const char *const *options, size_t count)
{
    for (size_t i = 0; i < count; i++)
        if (cli_given(cli, options[i]))
            return options[i];
    return NULL;
}

static bool is_picture(const char *path)
{
    static const char *const endings[] = { "exr", "hdr", "pfm", "png", "jpg", "jpeg" };

    for (size_t i = 0; i < PELL_COUNT(endings); i++)
        if (pell_path_has_extension(path, endings[i]))
            return true;
    return false;
}

/* A knob of rendering that says nothing of two pictures that are there already. */
static const struct pell_setting *picture_setting(const struct cli *cli)
{
    for (size_t i = 0; i < cli->settings.count; i++) {
        const struct pell_knob *k = pell_compare_knobs();
        while (k->name && strcmp(k->name, cli->settings.items[i].name) != 0)
            k++;
        if (!k->name)
            return &cli->settings.items[i];
    }
    return NULL;
}

enum exit_code command_compare(struct cli *cli)
{
    const bool scene = cli->num_arguments == 1;
    const char *odd = scene ? first_given(cli, of_pictures, PELL_COUNT(of_pictures)) : first_given(cli, of_scenes, PELL_COUNT(of_scenes));
    const struct pell_setting *setting = scene ? NULL : picture_setting(cli);

    if (scene && is_picture(cli->arguments[0]))
        return cli_usage(cli, "compare", "pellucid compare A B", "a picture alone: its reference is missing");
    if (odd || setting)
        return cli_usage(cli, odd ? odd : setting->where,
                         scene ? "pellucid compare A B" : "pellucid compare INPUT --methods all --reference hierarchical",
                         scene ? "goes with two pictures" : "goes with a scene, and two pictures are given");
    return scene ? compare_scene(cli) : compare_pictures(cli);
}
