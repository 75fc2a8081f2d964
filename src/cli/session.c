/* SPDX-License-Identifier: MIT
 * session.c - what render, compare and bench share: a scene, its options, a renderer, image files. */
#include "cli/cli.h"

#include "base/file.h"
#include "render/pass.h"
#include "render/renderer.h"

#include <inttypes.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <time.h>

#define AHEAD (1 << 22) /* bytes of a scene file that is looked into before it is loaded */
#define EXR_ONLY 6      /* attributes written to EXR only, at the end of the list: units, hashes, device and times */

const char *const cli_subsurface_layers[3] = { "diffuse.single", "diffuse.multiple", "transmission" };

/* Options that methods share under one name, and the knobs that each may set, of which a method has at most one. */
static const struct {
    const char *option, *knobs[2], *what, *shorter;
} common_options[] = {
    { "target-error", { "error", NULL }, "estimate of its error", "a larger --target-error" },
    { "samples", { "samples", "most" }, "number of samples", "fewer --samples" },
    { "time-limit", { "time-limit", NULL }, "time limit", "a --time-limit" },
};

static bool is_common(const char *name)
{
    for (size_t i = 0; i < PELL_COUNT(common_options); i++)
        if (strcmp(common_options[i].option, name) == 0)
            return true;
    return false;
}

enum exit_code cli_parse_seconds(struct cli *cli, const char *where, const char *text, double *seconds)
{
    static const struct {
        const char *unit;
        double seconds;
    } units[] = { { "ms", 1e-3 }, { "s", 1.0 }, { "min", 60.0 }, { "h", 3600.0 } };
    const size_t length = strspn(text, "0123456789.");
    double number;

    for (size_t i = 0; i < PELL_COUNT(units); i++)
        if (strcmp(text + length, units[i].unit) == 0 && pell_parse_number(text, length, &number)) {
            *seconds = number * units[i].seconds;
            if (*seconds > 0.0 && *seconds <= 1e8)
                return EXIT_OK;
        }
    return cli_failed(
        cli, pell_error(cli->ctx, PELL_ERR_INVALID, where, "30s, 5min or 2h", "\"%s\", must be a time above 0 with its unit", text));
}

enum exit_code cli_parse_percent(struct cli *cli, const char *where, const char *text, double *fraction)
{
    const size_t length = strlen(text);

    if (length > 1 && text[length - 1] == '%' && pell_parse_number(text, length - 1, fraction)) {
        *fraction *= 0.01;
        if (*fraction > 0.0 && *fraction <= 1.0)
            return EXIT_OK;
    }
    return cli_failed(cli,
                      pell_error(cli->ctx, PELL_ERR_INVALID, where, "1% or 0.5%", "\"%s\" is no percentage above 0 and up to 100", text));
}

/* The knob of a method that common option `i` sets, or NULL. */
static const struct pell_knob *common_knob(const struct pell_method *method, size_t i)
{
    const struct pell_knob *knob = NULL;

    for (int n = 0; n < 2 && !knob && common_options[i].knobs[n]; n++)
        knob = pell_knob_find(method->knobs, common_options[i].knobs[n]);
    /* in these methods it bounds another kind of error */
    return knob && (strcmp(common_options[i].option, "target-error") != 0 || strcmp(knob->unit, "1") == 0) ? knob : NULL;
}

/* "a larger --target-error or fewer --samples": what makes a method take less time. */
static void list_shorter(const struct pell_method *method, struct pell_text *text)
{
    const char *found[PELL_COUNT(common_options)];
    size_t count = 0;

    for (size_t i = 0; i < PELL_COUNT(common_options); i++)
        if (common_knob(method, i))
            found[count++] = common_options[i].shorter;
    for (size_t i = 0; i < count; i++)
        pell_text_add(text, "%s%s", i == 0 ? "" : i + 1 < count ? ", " : " or ", found[i]);
}

void session_shorten(struct cli *cli, const struct session *s)
{
    struct pell_text text = { .length = 0 };

    if (s->method && cli->common.count == 0)
        list_shorter(s->method, &text);
    snprintf(cli->progress.shorter, sizeof(cli->progress.shorter), "%.127s", text.str);
}

/* "image-space, layered, path-trace have one". */
static void list_owners(size_t i, struct pell_text *text)
{
    int count = 0;

    for (size_t k = 0; k < pell_method_count(); k++)
        if (common_knob(pell_method_at(k), i))
            pell_text_add(text, "%s%s", count++ > 0 ? ", " : "", pell_method_at(k)->name);
    pell_text_add(text, count > 1 ? " have one" : " has one");
}

/* Whether --set has set a knob: a scene file's option that maps to it is overridden. */
static bool is_set(const struct cli *cli, const char *knob)
{
    for (size_t i = 0; i < cli->knobs.count; i++)
        if (strcmp(cli->knobs.items[i].name, knob) == 0)
            return true;
    return false;
}

/* Sets the knobs that common options map to. */
static enum exit_code apply_common(struct cli *cli, const struct pell_method *method, const struct settings_list *common, void *values)
{
    enum exit_code code = EXIT_OK;

    for (size_t k = 0; k < common->count && code == EXIT_OK; k++) {
        const struct pell_setting *s = &common->items[k];
        const struct pell_knob *knob;
        struct pell_knob named[2] = { 0 }; /* the knob, named as the option, for errors */
        struct pell_text owners = { .length = 0 };
        const char *text = s->value;
        char number[40], owner[80];
        double value = 0.0;
        size_t i = 0;

        while (strcmp(common_options[i].option, s->name) != 0)
            i++;
        knob = common_knob(method, i);
        if (!knob) {
            struct pell_text shorter = { .length = 0 };
            list_owners(i, &owners);
            if (strcmp(s->name, "time-limit") == 0)
                list_shorter(method, &shorter);
            if (shorter.length)
                pell_text_add(&owners, "; %s shortens %s", shorter.str, method->name);
            return cli_failed(cli, pell_error(cli->ctx, PELL_ERR_INVALID, s->where, owners.str, "method %s has no %s", method->name,
                                              common_options[i].what));
        }
        if (s->where[0] != '-' && is_set(cli, knob->name))
            continue;
        if (strcmp(s->name, "time-limit") == 0)
            code = cli_parse_seconds(cli, s->where, s->value, &value);
        else if (strcmp(s->name, "target-error") == 0)
            code = cli_parse_percent(cli, s->where, s->value, &value);
        if (value > 0.0)
            text = pell_format_number(value, true, number, sizeof(number));
        snprintf(owner, sizeof(owner), "method %s", method->name);
        named[0] = *knob;
        named[0].name = s->name;
        if (code == EXIT_OK)
            code = cli_failed(cli, pell_knob_set(cli->ctx, named, owner, s->where, values, s->name, text));
    }
    return code;
}

/* Options of the scene file are added first, so that those of the command line override them. */
static enum exit_code merge_scene_options(const struct pell_scene *scene, struct settings_list *settings, struct settings_list *knobs,
                                          struct settings_list *common, struct pell_setting *method)
{
    for (size_t i = 0; i < scene->num_options; i++) {
        const struct pell_scene_option *o = &scene->options[i];
        const bool knob = strncmp(o->name, "knobs/", 6) == 0;

        if (strcmp(o->name, "method") == 0)
            *method = (struct pell_setting) { o->name, o->value, o->where };
        else if (cli_add_setting(knob                 ? knobs
                                 : is_common(o->name) ? common
                                                      : settings,
                                 knob ? o->name + 6 : o->name, o->value, o->where) != PELL_OK)
            return EXIT_MEMORY;
    }
    return EXIT_OK;
}

/* For method none, knobs stays NULL. */
static enum exit_code choose_method(struct cli *cli, const struct pell_setting *method, const struct settings_list *given,
                                    const struct settings_list *common, const struct pell_method **out, void **knobs)
{
    enum exit_code code;

    *out = NULL;
    *knobs = NULL;
    if (strcmp(method->value, "none") == 0) {
        const struct settings_list *some = given->count ? given : common;
        struct pell_text hint = { .length = 0 };
        if (some->count == 0)
            return EXIT_OK;
        pell_text_add(&hint, "choose a method with -m");
        if (given->count && given->items[0].where[0] == '-')
            cli_option_hint(cli, given->items[0].name, &hint);
        return cli_failed(cli, pell_error(cli->ctx, PELL_ERR_INVALID, some->items[0].where, hint.str, "method none has no knobs"));
    }
    *out = pell_method_find(cli->ctx, method->where, method->value);
    if (!*out)
        return cli_failed(cli, PELL_ERR_INVALID);
    *knobs = calloc(1, (*out)->knobs_size);
    if (!*knobs)
        return EXIT_MEMORY;
    code = cli_check_knobs_of(cli, *out, given);
    if (code == EXIT_OK)
        code = cli_failed(cli, pell_method_configure(cli->ctx, *out, given->items, given->count, *knobs));
    return code == EXIT_OK ? apply_common(cli, *out, common, *knobs) : code;
}

/* Applies settings over a method's defaults. */
static enum exit_code apply_settings(struct cli *cli, const struct settings_list *given, const struct pell_method *method,
                                     const void *knobs, struct pell_settings *settings)
{
    enum exit_code code = EXIT_OK;

    pell_settings_default(method, knobs, settings);
    for (size_t i = 0; code == EXIT_OK && i < given->count; i++) {
        const struct pell_setting *s = &given->items[i];
        code = cli_check_render_key(cli, s);
        if (code == EXIT_OK)
            code = cli_failed(cli, pell_knob_set(cli->ctx, pell_settings_knobs(), "render", s->where, settings, s->name, s->value));
    }
    return code;
}

/* The method if no scene file can change it, else NULL. */
static const char *certain_method(const struct cli *cli)
{
    static const char *const meshes[] = { "gltf", "glb", "obj", "ply", "stl" };

    for (size_t i = 0; cli->num_arguments && !cli->method && i < PELL_COUNT(meshes); i++)
        if (pell_path_has_extension(cli->arguments[0], meshes[i]))
            return CLI_DEFAULT_METHOD;
    return cli->method;
}

/* A scene file of usual size, unchecked; NULL: it is none, or can't be read, which loading reports. */
static json_t *scene_file_ahead(const char *path)
{
    struct stat file;

    return pell_path_has_extension(path, "json") && stat(path, &file) == 0 && S_ISREG(file.st_mode) && file.st_size <= AHEAD
               ? json_load_file(path, 0, NULL)
               : NULL;
}

bool session_method_ahead(struct cli *cli, const struct pell_method **method)
{
    const char *name = certain_method(cli);
    json_t *file = name ? NULL : scene_file_ahead(cli->arguments[0]);
    bool known;

    *method = NULL;
    if (file && json_object_get(file, "pellucid") &&
        !(name = json_string_value(json_object_get(json_object_get(file, "render"), "method"))))
        name = CLI_DEFAULT_METHOD;
    known = name && strcmp(name, "none") == 0;
    for (size_t i = 0; name && !known && i < pell_method_count(); i++)
        if ((known = strcmp(pell_method_at(i)->name, name) == 0))
            *method = pell_method_at(i);
    json_decref(file);
    return known;
}

/* Reports all errors of the command line before a large scene is read. */
static enum exit_code check_command_line(struct cli *cli, enum pell_engine engine)
{
    const struct pell_setting method = { "method", certain_method(cli), "--method" };
    const struct pell_method *found = NULL;
    struct pell_settings settings;
    void *knobs = NULL;
    enum exit_code code = apply_settings(cli, &cli->settings, NULL, NULL, &settings);

    if (code == EXIT_OK)
        code = cli_check_knob_names(cli);
    if (code == EXIT_OK && method.value)
        code = choose_method(cli, &method, &cli->knobs, &cli->common, &found, &knobs);
    if (code == EXIT_OK && found && !found->vulkan && engine == PELL_ENGINE_VULKAN)
        code = cli_failed(cli, pell_engine_missing(cli->ctx, "vulkan", found));
    free(knobs);
    return code;
}

const char *const cli_engine_names[] = { "auto", "cpu", "vulkan", NULL };

enum exit_code cli_engine(struct cli *cli, enum pell_engine *engine)
{
    bool known = !cli->engine;

    *engine = PELL_ENGINE_AUTO;
    for (size_t i = 0; !known && cli_engine_names[i]; i++)
        if ((known = strcmp(cli->engine, cli_engine_names[i]) == 0))
            *engine = (enum pell_engine) i;
    if (!known) {
        struct pell_text hint = { .length = 0 };
        const bool gpu = strcmp(cli->engine, "gpu") == 0;
        const bool near = pell_text_suggest(&hint, "", gpu ? "vulkan" : cli->engine, cli_engine_names, 3);
        return cli_usage(cli, "--engine", near ? hint.str : NULL, "\"%s\", must be auto, cpu or vulkan", cli->engine);
    }
    if (cli->device && *engine != PELL_ENGINE_VULKAN)
        return cli_usage(cli, "--device", NULL, "chooses a Vulkan device: it goes with --engine vulkan");
    return EXIT_OK;
}

void cli_device_name(char *name, size_t size)
{
    FILE *file = fopen("/proc/cpuinfo", "r");
    char line[256];

    snprintf(name, size, "processor");
    while (file && fgets(line, sizeof(line), file)) {
        const char *colon = strchr(line, ':');
        if (strncmp(line, "model name", 10) != 0 || !colon)
            continue;
        line[strcspn(line, "\n")] = '\0';
        pell_printable(colon + 1 + strspn(colon + 1, " "), name, size);
        break;
    }
    if (file)
        fclose(file);
}

/* The aspect ratio, which framing needs before the scene is read; 0: given by the scene file. */
static enum exit_code aspect_of(struct cli *cli, float *aspect)
{
    struct pell_settings shape;
    enum exit_code code = apply_settings(cli, &cli->settings, NULL, NULL, &shape);

    for (size_t i = 0; code == EXIT_OK && i < cli->settings.count; i++)
        if (strcmp(cli->settings.items[i].name, "width") == 0 || strcmp(cli->settings.items[i].name, "height") == 0)
            *aspect = (float) shape.width / (float) shape.height;
    return code;
}

enum exit_code cli_load_params(struct cli *cli, struct pell_load_params *params)
{
    enum pell_result res;

    *params = (struct pell_load_params) { .material = cli->material,
                                          .camera = cli->camera,
                                          .allow_outside = cli->allow_outside,
                                          .up = cli->up,
                                          .normals = cli->normals,
                                          .from = cli->from,
                                          .studio = cli->studio,
                                          .environment = cli->environment,
                                          .background = cli->background,
                                          .ground = cli->ground };
    if (cli->size && cli->unit)
        return cli_usage(cli, "--size", "give one of them", "--size and --unit both say how large the object is");
    if (cli->size && (res = pell_parse_length(cli->ctx, "--size", cli->size, &params->size_mm)) != PELL_OK)
        return cli_failed(cli, res);
    if (cli->thicken && (res = pell_parse_length(cli->ctx, "--thicken", cli->thicken, &params->thicken_mm)) != PELL_OK)
        return cli_failed(cli, res);
    if (cli->unit && (res = pell_parse_length(cli->ctx, "--unit", cli->unit, &params->mm_per_unit)) != PELL_OK)
        return cli_failed(cli, res);
    if (cli->environment_scale && (!pell_parse_number(cli->environment_scale, strlen(cli->environment_scale), &params->environment_scale) ||
                                   params->environment_scale == 0.0))
        return cli_usage(cli, "--environment-scale", NULL, "\"%s\" is not a number above 0", cli->environment_scale);
    if (cli->environment_rotate &&
        !pell_parse_number(cli->environment_rotate, strlen(cli->environment_rotate), &params->environment_rotate_deg))
        return cli_usage(cli, "--environment-rotate", NULL, "\"%s\" is not a number of degrees", cli->environment_rotate);
    if (cli->material && !cli->material[0])
        return cli_usage(cli, "--material", "`pellucid materials` lists what there is", "is empty, must be a name or a file");
    params->timed = cli->time != NULL;
    params->animation = cli->animation;
    if (cli->time && !pell_parse_number(cli->time, strlen(cli->time), &params->time))
        return cli_usage(cli, "--time", NULL, "\"%s\" is not a number of seconds", cli->time);
    return aspect_of(cli, &params->aspect);
}

/* `time` NULL: the time on the command line. */
static enum exit_code load(struct cli *cli, const char *path, const double *time, struct session *s)
{
    const double start = pell_seconds();
    struct pell_load_params params;
    enum exit_code code = cli_load_params(cli, &params);

    if (code != EXIT_OK)
        return code;
    if (time) {
        params.timed = true;
        params.time = *time;
    }
    code = cli_failed(cli, pell_scene_load(cli->ctx, path, &params, &s->scene));
    s->load_seconds = pell_seconds() - start;
    return code;
}

/* --bounces with a method that counts bounces by a knob of its own. */
static void warn_of_bounces(struct cli *cli, const struct pell_method *method)
{
    char hint[64];

    if (!method || !pell_knob_find(method->knobs, "bounces"))
        return;
    for (size_t i = 0; i < cli->knobs.count; i++)
        if (strcmp(cli->knobs.items[i].name, "bounces") == 0)
            return;
    for (size_t i = 0; i < cli->settings.count; i++) {
        if (strcmp(cli->settings.items[i].name, "bounces") != 0)
            continue;
        snprintf(hint, sizeof(hint), "--set bounces=%.40s", cli->settings.items[i].value);
        pell_warn(cli->ctx, "--bounces", hint, "has no effect on method %s, which has a knob of that name", method->name);
        return;
    }
}

/* Applies the scene file's options, then those of the command line, which override them. */
static enum exit_code configure(struct cli *cli, struct session *s)
{
    struct settings_list settings = { 0 }, knobs = { 0 }, common = { 0 };
    struct pell_setting method = { "method", CLI_DEFAULT_METHOD, "--method" };
    enum exit_code code = merge_scene_options(s->scene, &settings, &knobs, &common, &method);

    if (code == EXIT_OK && cli->method) {
        if (strcmp(cli->method, method.value) != 0) { /* the file's knobs are for its own method */
            cli_free_settings(&knobs);
            cli_free_settings(&common);
        }
        method = (struct pell_setting) { "method", cli->method, "--method" };
    }
    if (code == EXIT_OK)
        code = cli_failed(cli, cli_append_settings(&settings, &cli->settings));
    if (code == EXIT_OK)
        code = cli_failed(cli, cli_append_settings(&knobs, &cli->knobs));
    if (code == EXIT_OK)
        code = cli_failed(cli, cli_append_settings(&common, &cli->common));
    if (code == EXIT_OK)
        code = choose_method(cli, &method, &knobs, &common, &s->method, &s->knobs);
    if (code == EXIT_OK)
        code = apply_settings(cli, &settings, s->method, s->knobs, &s->settings);
    if (code == EXIT_OK)
        warn_of_bounces(cli, s->method);
    cli_free_settings(&settings);
    cli_free_settings(&knobs);
    cli_free_settings(&common);
    return code;
}

bool session_runs(const struct session *s, const struct pell_method *method)
{
    return pell_device_engine(s->device) == PELL_ENGINE_VULKAN ? method->vulkan != NULL : method->cpu != NULL;
}

enum exit_code session_settings(struct cli *cli, const struct pell_scene *scene, const struct pell_method *method, const void *knobs,
                                struct pell_settings *settings)
{
    struct settings_list given = { 0 }, others = { 0 };
    struct pell_setting name;
    enum exit_code code = merge_scene_options(scene, &given, &others, &others, &name);

    if (code == EXIT_OK)
        code = cli_failed(cli, cli_append_settings(&given, &cli->settings));
    if (code == EXIT_OK)
        code = apply_settings(cli, &given, method, knobs, settings);
    cli_free_settings(&given);
    cli_free_settings(&others);
    return code;
}

enum exit_code session_check(struct cli *cli, struct pell_scene *scene)
{
    struct session s = { .scene = scene };
    const enum exit_code code = configure(cli, &s);

    free(s.knobs);
    return code;
}

enum exit_code session_open(struct cli *cli, const char *path, struct session *s)
{
    return session_open_at(cli, path, NULL, s);
}

/* The program's folder in the user's cache: "$XDG_CACHE_HOME/pellucid" or "~/.cache/pellucid"; NULL: the environment names none. */
static const char *cache_folder(char *path, size_t size)
{
    const char *caches = getenv("XDG_CACHE_HOME"), *home = getenv("HOME");
    const bool given = caches && caches[0] == '/';
    const int length = snprintf(path, size, "%s%s/pellucid", given ? caches : home ? home : "", given ? "" : "/.cache");

    return (given || (home && home[0] == '/')) && length > 0 && (size_t) length < size ? path : NULL;
}

const char *cli_shaders(void)
{
    const char *folder = getenv("PELL_SHADERS");

    return folder && *folder ? folder : NULL;
}

/* Reads the scene and the settings; creates no renderer. */
static enum exit_code read_at(struct cli *cli, const char *path, const double *time, struct session *s)
{
    char cache[1024];
    struct pell_device_params params = { .threads = cli->numbers.threads,
                                         .vulkan_device = cli->device,
                                         .vulkan_cache = cache_folder(cache, sizeof(cache)),
                                         .vulkan_shaders = cli_shaders() };
    enum exit_code code;

    memset(s, 0, sizeof(*s));
    code = cli_engine(cli, &params.engine);
    if (code == EXIT_OK)
        code = check_command_line(cli, params.engine);
    if (code == EXIT_OK)
        code = cli_failed(cli, pell_device_create(cli->ctx, &params, &s->device));
    if (code == EXIT_OK)
        code = load(cli, path, time, s);
    return code == EXIT_OK ? configure(cli, s) : code;
}

enum exit_code session_read(struct cli *cli, const char *path, struct session *s)
{
    return read_at(cli, path, NULL, s);
}

enum exit_code session_open_at(struct cli *cli, const char *path, const double *time, struct session *s)
{
    enum exit_code code = read_at(cli, path, time, s);

    if (code == EXIT_OK)
        code = cli_failed(cli, pell_renderer_create(s->device, &s->renderer));
    if (code == EXIT_OK)
        pell_renderer_measure_bandwidth(s->renderer, cli->stats || cli->json);
    if (code == EXIT_OK)
        code = cli_failed(cli, pell_renderer_set_scene(s->renderer, s->scene));
    if (code == EXIT_OK)
        code = cli_failed(cli, pell_renderer_set_method(s->renderer, s->method, s->knobs));
    return code;
}

enum exit_code session_move(struct cli *cli, const char *path, double time, struct session *s)
{
    enum pell_result res;
    enum exit_code code;

    if (!s->scene->animated) /* a static scene */
        return EXIT_OK;
    res = pell_renderer_set_scene(s->renderer, NULL);
    pell_scene_destroy(&s->scene);
    code = cli_failed(cli, res);
    if (code == EXIT_OK)
        code = load(cli, path, &time, s);
    return code == EXIT_OK ? cli_failed(cli, pell_renderer_set_scene(s->renderer, s->scene)) : code;
}

void session_close(struct session *s)
{
    pell_renderer_destroy(&s->renderer);
    pell_device_destroy(&s->device);
    pell_scene_destroy(&s->scene);
    free(s->knobs);
    s->knobs = NULL;
}

json_t *session_stages(const struct pell_render_result *image)
{
    json_t *stages = json_array();

    for (size_t i = 0; i < image->num_stages; i++) {
        const struct pell_stage_time *t = &image->stages[i];
        json_array_append_new(stages, json_pack("{s:s,s:f,s:I,s:I,s:I,s:f}", "name", t->name, "ms", t->ms, "pixels", (json_int_t) t->pixels,
                                                "rays", (json_int_t) t->rays, "bytes", (json_int_t) t->bytes, "copy_ms", t->bandwidth_ms));
    }
    return stages;
}

const struct pell_channel *cli_channel(const struct pell_render_result *image, const char *layer, const char *name)
{
    char full[64];

    snprintf(full, sizeof(full), "%s%s%s", layer, layer[0] ? "." : "", name);
    for (size_t i = 0; i < image->num_channels; i++)
        if (strcmp(image->channels[i].name, full) == 0)
            return &image->channels[i];
    return NULL;
}

double cli_cpu_seconds(void)
{
    struct timespec t;
    return clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t) == 0 ? (double) t.tv_sec + 1e-9 * (double) t.tv_nsec : 0.0;
}

enum pell_result session_write(struct cli *cli, const struct session *s, const struct pell_render_result *p, const char *path,
                               const char *format, uint64_t scene_hash, uint64_t materials_hash)
{
    const bool png = strcmp(format, "png") == 0, transparent = s->scene->background == PELL_BACKGROUND_TRANSPARENT;
    const struct pell_channel display[4] = {
        { "R", p->display[0], p->stride, false },
        { "G", p->display[1], p->stride, false },
        { "B", p->display[2], p->stride, false },
        { "A", p->alpha, p->stride, false },
    };
    char seed[32], exposure[40], seconds[32], loading[32], scene[24], materials[24], device[160], knobs[2048], settings[1024];
    /* The same command gives the same bytes of PNG: times and the machine are written to EXR alone. */
    const struct pell_attribute attributes[] = {
        { "pellucid.version", pell_version_string() },
        { "pellucid.command", cli->command_line },
        { "pellucid.method", s->method ? s->method->name : "none" },
        { "pellucid.knobs", knobs },
        { "pellucid.settings", settings },
        { "pellucid.engine", pell_engine_name(pell_device_engine(s->device)) },
        { "pellucid.seed", seed },
        { "pellucid.exposure", exposure },
        { "pellucid.units", "linear Rec.709; radiance W/(m^2 sr), irradiance W/m^2, depth mm" },
        { "pellucid.scene", scene },
        { "pellucid.materials", materials },
        { "pellucid.device", device },
        { "pellucid.seconds", seconds },
        { "pellucid.load_seconds", loading },
    };

    cli_format_knobs(pell_settings_knobs(), &s->settings, NULL, settings, sizeof(settings));
    snprintf(knobs, sizeof(knobs), "none"); /* PNG has no empty texts */
    if (s->method)
        cli_format_knobs(s->method->knobs, s->knobs, NULL, knobs, sizeof(knobs));
    cli_device_name(device, sizeof(device));
    pell_format_number((double) p->exposure * exp2((double) s->settings.stops), true, exposure, sizeof(exposure));
    snprintf(seed, sizeof(seed), "%lld", (long long) s->settings.seed);
    snprintf(scene, sizeof(scene), "%016" PRIx64, scene_hash);
    snprintf(materials, sizeof(materials), "%016" PRIx64, materials_hash);
    snprintf(seconds, sizeof(seconds), "%.4f", p->seconds);
    snprintf(loading, sizeof(loading), "%.4f", s->load_seconds);
    return pell_image_write(cli->ctx, path, format,
                            &(struct pell_write_params) {
                                .width = p->width,
                                .height = p->height,
                                .channels = png ? display : p->channels,
                                .num_channels = png ? (transparent ? 4 : 3) : p->num_channels,
                                .attributes = attributes,
                                .num_attributes = PELL_COUNT(attributes) - (png ? EXR_ONLY : 0),
                                .compression = PELL_EXR_PIZ,
                            });
}
