/* SPDX-License-Identifier: MIT
 * session.c - what render and bench share: a scene, its options, a renderer. */
#include "cli/cli.h"

#include <stdlib.h>
#include <string.h>

#define DEFAULT_METHOD "screen-space"

/* Options of the scene file go first, so that the command line's win. */
static enum exit_code merge_scene_options(struct cli *cli, const struct pell_scene *scene, struct settings_list *settings,
                                          struct settings_list *knobs, const char **method)
{
    for (size_t i = 0; i < scene->num_options; i++) {
        const struct pell_scene_option *o = &scene->options[i];
        const bool knob = strncmp(o->name, "knobs/", 6) == 0;

        if (strcmp(o->name, "method") == 0)
            *method = o->value;
        else if (cli_add_setting(cli, knob ? knobs : settings, knob ? o->name + 6 : o->name, o->value, o->where) != PELL_OK)
            return EXIT_MEMORY;
    }
    return EXIT_OK;
}

static enum exit_code append(struct cli *cli, struct settings_list *to, const struct settings_list *from)
{
    for (size_t i = 0; i < from->count; i++)
        if (cli_add_setting(cli, to, from->items[i].name, from->items[i].value, from->items[i].where) != PELL_OK)
            return EXIT_MEMORY;
    return EXIT_OK;
}

static enum exit_code choose_method(struct cli *cli, struct session *s, const char *name, const char *where, const struct settings_list *knobs)
{
    enum pell_result res;

    if (strcmp(name, "none") == 0) {
        if (knobs->count > 0)
            return cli_usage(cli, knobs->items[0].where, "choose a method with -m", "method none has no knob \"%s\"", knobs->items[0].name);
        return EXIT_OK;
    }
    s->method = pell_method_find(cli->ctx, where, name);
    if (!s->method)
        return EXIT_USAGE;
    s->knobs = calloc(1, s->method->knobs_size);
    if (!s->knobs)
        return EXIT_MEMORY;
    res = pell_method_configure(cli->ctx, s->method, knobs->items, knobs->count, s->knobs);
    return res == PELL_OK ? EXIT_OK : cli_failed(cli, res);
}

static enum exit_code choose_engine(struct cli *cli, enum pell_engine *engine)
{
    static const char *const names[] = { "auto", "cpu", "vulkan" };

    *engine = PELL_ENGINE_AUTO;
    for (int i = 0; cli->engine && i < (int) PELL_COUNT(names); i++)
        if (strcmp(cli->engine, names[i]) == 0) {
            *engine = (enum pell_engine) i;
            break;
        } else if (i == 2) {
            return cli_usage(cli, "--engine", NULL, "\"%s\", must be auto, cpu or vulkan", cli->engine);
        }
    if (cli->device && *engine != PELL_ENGINE_VULKAN)
        return cli_usage(cli, "--device", NULL, "chooses a Vulkan device: it goes with --engine vulkan");
    return EXIT_OK;
}

/* Framing needs the picture's shape before the scene is read. A scene file's own size comes too late for it: it frames by its own. */
static enum exit_code aspect_of(struct cli *cli, float *aspect)
{
    struct pell_settings shape;
    bool given = false;

    pell_knobs_default(pell_settings_knobs, &shape);
    for (size_t i = 0; i < cli->settings.count; i++) {
        const struct pell_setting *o = &cli->settings.items[i];
        enum pell_result res;
        if (strcmp(o->name, "width") != 0 && strcmp(o->name, "height") != 0)
            continue;
        res = pell_knob_set(cli->ctx, pell_settings_knobs, "picture", o->where, &shape, o->name, o->value);
        if (res != PELL_OK)
            return cli_failed(cli, res);
        given = true;
    }
    if (given)
        *aspect = (float) shape.width / (float) shape.height;
    return EXIT_OK;
}

enum exit_code cli_load_params(struct cli *cli, struct pell_load_params *params)
{
    enum pell_result res;

    *params = (struct pell_load_params) { .material = cli->material, .camera = cli->camera, .allow_outside = cli->allow_outside };
    if (cli->size && cli->unit)
        return cli_usage(cli, "--size", "give one of them", "--size and --unit both say how large the thing is");
    if (cli->size && (res = pell_parse_length(cli->ctx, "--size", cli->size, &params->size_mm)) != PELL_OK)
        return cli_failed(cli, res);
    if (cli->unit && (res = pell_parse_length(cli->ctx, "--unit", cli->unit, &params->mm_per_unit)) != PELL_OK)
        return cli_failed(cli, res);
    if (cli->time && !pell_parse_number(cli->time, strlen(cli->time), &params->time))
        return cli_usage(cli, "--time", NULL, "\"%s\" is not a number of seconds", cli->time);
    return aspect_of(cli, &params->aspect);
}

static enum exit_code load(struct cli *cli, const char *path, struct session *s)
{
    const double start = pell_seconds();
    struct pell_load_params params;
    enum exit_code code = cli_load_params(cli, &params);

    if (code != EXIT_OK)
        return code;
    code = cli_failed(cli, pell_scene_load(cli->ctx, path, &params, &s->scene));
    s->load_seconds = pell_seconds() - start;
    return code;
}

enum exit_code session_open(struct cli *cli, const char *path, struct session *s)
{
    struct settings_list settings = { 0 }, knobs = { 0 };
    const char *method = DEFAULT_METHOD, *method_where = "--method";
    struct pell_renderer_params params = { .threads = cli->threads };
    enum exit_code code;
    enum pell_result res;

    memset(s, 0, sizeof(*s));
    code = choose_engine(cli, &params.engine);
    if (code == EXIT_OK && (res = pell_renderer_create(cli->ctx, &params, &s->renderer)) != PELL_OK)
        code = cli_failed(cli, res);
    if (code == EXIT_OK)
        code = load(cli, path, s);
    if (code == EXIT_OK)
        code = merge_scene_options(cli, s->scene, &settings, &knobs, &method);
    if (code == EXIT_OK && cli->method) {
        /* Knobs of the scene file belong to its own method. */
        if (strcmp(cli->method, method) != 0)
            cli_free_settings(&knobs);
        method = cli->method;
    }
    if (code == EXIT_OK)
        code = append(cli, &settings, &cli->settings);
    if (code == EXIT_OK)
        code = append(cli, &knobs, &cli->knobs);
    pell_knobs_default(pell_settings_knobs, &s->settings);
    for (size_t i = 0; code == EXIT_OK && i < settings.count; i++)
        if ((res = pell_knob_set(cli->ctx, pell_settings_knobs, "picture", settings.items[i].where, &s->settings, settings.items[i].name,
                                 settings.items[i].value)) != PELL_OK)
            code = cli_failed(cli, res);
    if (code == EXIT_OK)
        code = choose_method(cli, s, method, method_where, &knobs);
    if (code == EXIT_OK && (res = pell_renderer_set_scene(s->renderer, s->scene)) != PELL_OK)
        code = cli_failed(cli, res);
    if (code == EXIT_OK && (res = pell_renderer_set_method(s->renderer, s->method, s->knobs)) != PELL_OK)
        code = cli_failed(cli, res);
    cli_free_settings(&settings);
    cli_free_settings(&knobs);
    return code;
}

void session_close(struct cli *cli, struct session *s)
{
    (void) cli;
    pell_renderer_destroy(&s->renderer);
    pell_scene_destroy(&s->scene);
    free(s->knobs);
    s->knobs = NULL;
}

json_t *session_stages(const struct pell_picture *picture)
{
    json_t *stages = json_array();

    for (size_t i = 0; i < picture->num_stages; i++) {
        const struct pell_stage_time *t = &picture->stages[i];
        json_array_append_new(stages, json_pack("{s:s,s:f,s:I,s:I,s:I,s:f}", "name", t->name, "ms", t->ms, "pixels", (json_int_t) t->pixels,
                                                "rays", (json_int_t) t->rays, "bytes", (json_int_t) t->bytes, "copy_ms", t->copy_ms));
    }
    return stages;
}
