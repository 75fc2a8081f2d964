/* SPDX-License-Identifier: MIT
 * compare.c - `pellucid compare`: compares two images, or methods on one scene with a reference; decides between the two. */
#include "cli/compare/compare.h"

#include "base/file.h"
#include "base/simd.h"

#include <errno.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

/* Options that only one kind of comparison takes. */
static const char *const of_images[] = { "--layer", "--mask", "--half" };
static const char *const of_scenes[] = { "--methods",
                                         "--reference",
                                         "--set",
                                         "--material",
                                         "--size",
                                         "--unit",
                                         "--camera",
                                         "--time",
                                         "--engine",
                                         "--device",
                                         "--allow-outside",
                                         "--decompose",
                                         "--up",
                                         "--from",
                                         "--studio",
                                         "--environment",
                                         "--environment-rotate",
                                         "--environment-scale",
                                         "--background" };

static const char *first_given(const struct cli *cli, const char *const *options, size_t count)
{
    for (size_t i = 0; i < count; i++)
        if (cli_given(cli, options[i]))
            return options[i];
    return NULL;
}

/* A rendering option that has no meaning for existing images. */
static const struct pell_setting *image_setting(const struct cli *cli)
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

/* Compares one scene of a list, into a folder of its name in the output folder. The knobs return to `cli`, for the next. */
static enum exit_code compare_listed(struct cli *cli, char *path, const char *folder)
{
    const char *name = pell_path_name(path), *dot = strrchr(name, '.');
    const size_t size = strlen(folder) + strlen(name) + 2;
    struct settings_list knobs = { 0 };
    char *const input = cli->arguments[0], *const output = cli->output;
    enum exit_code code = cli_failed(cli, cli_append_settings(&knobs, &cli->knobs));

    cli->output = malloc(size);
    if (!cli->output)
        code = EXIT_MEMORY;
    if (code == EXIT_OK) {
        snprintf(cli->output, size, "%s/%.*s", folder, (int) (dot && dot != name ? (size_t) (dot - name) : strlen(name)), name);
        cli->arguments[0] = path;
        if (!cli->quiet)
            printf("%s\n", path);
        code = compare_scene(cli);
        cli->arguments[0] = input;
    }
    free(cli->output);
    cli->output = output;
    cli_free_settings(&cli->knobs);
    cli->knobs = knobs;
    return code;
}

/* Compares the scenes that a text file names, one per line; --scene-range selects some of them, so that jobs share the list. */
static enum exit_code compare_list(struct cli *cli)
{
    const char *folder = cli->output;
    char *text, *line, *rest;
    uint8_t *data;
    int count = 0, first = 0, end, i = 0;
    size_t size;
    enum pell_result res;
    enum exit_code code = EXIT_OK;

    if (!folder || cli->json)
        return cli_usage(cli, cli->json ? "--json" : "--output", "-o reports/",
                         "a list of scenes gives a folder for each, with its metrics.json");
    res = pell_file_read(cli->ctx, cli->arguments[0], &data, &size);
    if (res != PELL_OK)
        return cli_failed(cli, res);
    text = pell_zalloc(cli->ctx, size + 1);
    if (text && size > 0)
        memcpy(text, data, size);
    pell_free(cli->ctx, data);
    if (!text)
        return EXIT_MEMORY;
    for (const char *c = text; (c += strspn(c, "\r\n")), *c; c += strcspn(c, "\r\n"))
        count++;
    end = count;
    if (count == 0)
        code = cli_failed(cli, pell_error(cli->ctx, PELL_ERR_FORMAT, cli->arguments[0], "a path in each line", "names no scene"));
    if (code == EXIT_OK && cli->part.scenes)
        code = cli_range(cli, "--scene-range", cli->part.scenes, count, 1, &first, &end);
    if (code == EXIT_OK && mkdir(folder, 0777) != 0 && errno != EEXIST)
        code = cli_failed(cli, pell_error(cli->ctx, PELL_ERR_IO, folder, NULL, "can't be made"));
    for (line = strtok_r(text, "\r\n", &rest); line && code == EXIT_OK; line = strtok_r(NULL, "\r\n", &rest), i++)
        if (i >= first && i < end)
            code = compare_listed(cli, line, folder);
    pell_free(cli->ctx, text);
    return code;
}

enum exit_code command_compare(struct cli *cli)
{
    const bool scene = cli->num_arguments == 1;
    const char *misplaced = scene ? first_given(cli, of_images, PELL_COUNT(of_images)) : first_given(cli, of_scenes, PELL_COUNT(of_scenes));
    const struct pell_setting *setting = scene ? NULL : image_setting(cli);

    if (scene && cli_is_image(cli->arguments[0]))
        return cli_usage(cli, "compare", "pellucid compare A B", "one image was given: its reference is missing");
    if (misplaced || setting)
        return cli_usage(cli, misplaced ? misplaced : setting->where,
                         scene ? "pellucid compare A B" : "pellucid compare INPUT --methods all --reference hierarchical",
                         scene ? "goes with two images" : "goes with a scene, and two images are given");
    if (scene && pell_path_has_extension(cli->arguments[0], "txt"))
        return compare_list(cli);
    if (cli->part.scenes)
        return cli_usage(cli, "--scene-range", NULL, "goes with a list of scenes (.txt)");
    if (!scene) /* comparing images needs no device */
        pell_simd_check(cli->ctx);
    return scene ? compare_scene(cli) : compare_images(cli);
}
