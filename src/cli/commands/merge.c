/* SPDX-License-Identifier: MIT
 * merge.c - `pellucid merge`: combines parts that other runs rendered into one image. The first part holds the scene and the options; then
 * `render` runs without taking samples. */
#include "cli/cli.h"

#include "base/file.h"
#include "methods/path_trace/path_trace.h"

#include <stdlib.h>
#include <string.h>

/* The command line of the render that made a part, from its note: an array that ends with NULL; the caller releases it (json_decref of
 * *note). */
static enum exit_code read_words(struct cli *cli, const char *path, json_t **note, const char ***words, int *count)
{
    uint8_t *data;
    char *text = NULL;
    size_t size;
    enum pell_result res = pell_file_read(cli->ctx, path, &data, &size);

    *note = NULL;
    if (res != PELL_OK)
        return cli_failed(cli, res);
    res = pt_checkpoint_note(cli->ctx, path, data, size, &text);
    pell_free(cli->ctx, data);
    if (res != PELL_OK)
        return cli_failed(cli, res);
    *note = json_loads(text, 0, NULL);
    pell_free(cli->ctx, text);
    *count = (int) json_array_size(*note) + 1;
    *words = calloc((size_t) *count + 1, sizeof(**words));
    if (!*words)
        return EXIT_MEMORY;
    (*words)[0] = "render";
    for (int i = 1; i < *count; i++)
        if (!((*words)[i] = json_string_value(json_array_get(*note, (size_t) i - 1))))
            *count = 1;
    if (*count < 2)
        return cli_failed(
            cli, pell_error(cli->ctx, PELL_ERR_FORMAT, path, "render the part with --checkpoint", "does not say which scene it is of"));
    return EXIT_OK;
}

static void move_list(struct settings_list *to, struct settings_list *from)
{
    cli_free_settings(to);
    *to = *from;
    *from = (struct settings_list) { 0 };
}

/* Moves the options that define the image. */
static void move_scene(struct cli *to, struct cli *from)
{
    char **const texts[][2] = { { &to->method, &from->method },
                                { &to->material, &from->material },
                                { &to->size, &from->size },
                                { &to->unit, &from->unit },
                                { &to->camera, &from->camera },
                                { &to->time, &from->time },
                                { &to->animation, &from->animation },
                                { &to->up, &from->up },
                                { &to->from, &from->from },
                                { &to->studio, &from->studio },
                                { &to->environment, &from->environment },
                                { &to->environment_scale, &from->environment_scale },
                                { &to->environment_rotate, &from->environment_rotate },
                                { &to->background, &from->background } };

    for (size_t i = 0; i < PELL_COUNT(texts); i++) {
        *texts[i][0] = *texts[i][1];
        *texts[i][1] = NULL;
    }
    to->ground = from->ground;
    move_list(&to->knobs, &from->knobs);
    move_list(&to->settings, &from->settings);
    move_list(&to->common, &from->common);
}

static const struct command *render_command(const struct program *program)
{
    for (size_t i = 0; i < program->num_commands; i++)
        if (strcmp(program->commands[i].name, "render") == 0)
            return &program->commands[i];
    return NULL;
}

enum exit_code command_merge(struct cli *cli)
{
    struct cli first = {
        .program = cli->program, .command = render_command(cli->program), .quiet = true, .of_a_file = true, .ctx = cli->ctx
    };
    char **parts = cli->arguments, *input[2] = { NULL };
    const int num_parts = cli->num_arguments;
    const char **words = NULL;
    json_t *note = NULL;
    int count = 0;
    bool help = false;
    enum exit_code code;

    if (!cli->output && !cli->checkpoint)
        return cli_usage(cli, "merge", "-o image.exr, or --checkpoint merged.ckpt", "--output is missing");
    code = read_words(cli, parts[0], &note, &words, &count);
    if (code == EXIT_OK)
        code = cli_parse(&first, count, words, &help);
    if ((code != EXIT_OK && first.error.present) || help) {
        code = cli_failed(cli, pell_error(cli->ctx, PELL_ERR_FORMAT, parts[0], NULL, "names options that are none: %s",
                                          first.error.present ? first.error.what : "--help"));
    } else if (code == EXIT_OK) {
        move_scene(cli, &first);
        input[0] = cli->part.input ? cli->part.input : first.arguments[0];
        cli->merge.parts = (const char *const *) parts;
        cli->merge.count = num_parts;
        cli->words = words;
        cli->num_words = count;
        cli->arguments = input;
        cli->num_arguments = 1;
        code = command_render(cli);
        cli->arguments = parts;
        cli->num_arguments = num_parts;
    }
    first.ctx = NULL;
    cli_finish(&first);
    json_decref(note);
    free(words);
    return code;
}
