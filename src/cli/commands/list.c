/* SPDX-License-Identifier: MIT
 * list.c - `pellucid methods`, `info`: lists what is available. */
#include "cli/profile/profile.h"
#include "cli/profile/stack.h"

#include "base/simd.h"
#include "scene/scene.h"
#include "vulkan/devices.h"

#include <pellucid/compare.h>
#include <pellucid/profile.h>

#include <math.h>
#include <string.h>

static const char *const kinds[] = { "method", "reference" };

static json_t *engines_of(const struct pell_method *m)
{
    json_t *engines = json_array();
    if (m->cpu)
        json_array_append_new(engines, json_string("cpu"));
    if (m->vulkan)
        json_array_append_new(engines, json_string("vulkan"));
    return engines;
}

static const char *engine_names(const struct pell_method *m)
{
    return m->cpu && m->vulkan ? "cpu,vulkan" : m->cpu ? "cpu" : "vulkan";
}

/* What a method needs: the caller's planes, or a whole scene. `with`: the knob setting under which planes are enough. */
struct runs_on {
    const char *name; /* "planes", "scene" */
    char with[80];    /* "" if no setting is needed, or none exists */
};

/* Whether planes are enough with one knob set and all others at their defaults. */
static bool runs_on_planes_with(const struct cli *cli, const struct pell_method *m, const char *setting)
{
    void *knobs;
    bool runs;

    if (pell_method_knobs_create(cli->ctx, m, setting, &knobs) != PELL_OK)
        return false;
    runs = pell_method_runs_on_planes(m, knobs);
    pell_method_knobs_destroy(cli->ctx, &knobs);
    return runs;
}

static struct runs_on find_runs_on(const struct cli *cli, const struct pell_method *m)
{
    struct runs_on r = { .name = runs_on_planes_with(cli, m, NULL) ? "planes" : "scene" };

    for (const struct pell_knob *k = m->knobs; r.name[0] == 's' && k->name; k++) {
        for (int i = 0; k->type == PELL_KNOB_ENUM ? k->choices[i] != NULL : i < 1; i++) {
            if (k->type == PELL_KNOB_ENUM)
                snprintf(r.with, sizeof(r.with), "%s=%s", k->name, k->choices[i]);
            else
                snprintf(r.with, sizeof(r.with), "%s=%.9g", k->name, k->min);
            if (runs_on_planes_with(cli, m, r.with))
                return r;
        }
    }
    r.with[0] = '\0';
    return r;
}

static json_t *ignored_by(const struct pell_method *m)
{
    json_t *list = json_array();
    for (unsigned input = 1; pell_ignored_name(input); input <<= 1)
        if (m->ignores & input)
            json_array_append_new(list, json_string(pell_ignored_name(input)));
    return list;
}

/* A method's knobs by default and as in its paper; NULL if out of memory. */
struct forms {
    void *best, *paper;
};

static struct forms make_forms(const struct cli *cli, const struct pell_method *m)
{
    struct forms f = { NULL, NULL };

    if (pell_method_knobs_create(cli->ctx, m, "", &f.best) != PELL_OK ||
        pell_method_knobs_create(cli->ctx, m, "as=paper", &f.paper) != PELL_OK)
        pell_method_knobs_destroy(cli->ctx, &f.best);
    return f;
}

static void drop_forms(const struct cli *cli, struct forms *f)
{
    pell_method_knobs_destroy(cli->ctx, &f->best);
    pell_method_knobs_destroy(cli->ctx, &f->paper);
}

static void list_paper_settings(const struct pell_method *m, const void *knobs, char *text, size_t size)
{
    struct pell_settings own, usual;

    pell_settings_default(NULL, NULL, &usual);
    pell_settings_default(m, knobs, &own);
    cli_format_knobs(pell_settings_knobs(), &own, &usual, text, size);
}

static json_t *knob_default(const struct pell_knob *k)
{
    switch (k->type) {
    case PELL_KNOB_BOOL: return json_boolean(k->def[0] != 0.0);
    case PELL_KNOB_INT:
    case PELL_KNOB_INT64: return json_integer((json_int_t) k->def[0]);
    case PELL_KNOB_ENUM: return json_string(k->choices[(int) k->def[0]]);
    case PELL_KNOB_RGB: return cli_numbers(k->def, 3);
    default: return json_real(k->def[0]);
    }
}

/* The value that as=paper sets, in the syntax of --set; NULL: unchanged. */
static const char *knob_paper(const struct pell_knob *k, const struct forms *f, char *text, size_t size)
{
    char usual[128];

    if (!f->best || !f->paper || strcmp(k->name, "as") == 0)
        return NULL;
    pell_knob_format(k, f->paper, text, size);
    return strcmp(text, pell_knob_format(k, f->best, usual, sizeof(usual))) == 0 ? NULL : text;
}

static json_t *knob_bound(const struct pell_knob *k, double bound)
{
    switch (k->type) {
    case PELL_KNOB_BOOL: return json_null();
    case PELL_KNOB_INT:
    case PELL_KNOB_INT64: return json_integer((json_int_t) bound);
    default: return json_real(bound);
    }
}

json_t *cli_knob_json(const struct pell_knob *k)
{
    static const char *const types[] = { "", "bool", "int", "int", "float", "enum", "rgb" };
    json_t *o = json_pack("{s:s,s:s,s:s,s:o,s:s}", "name", k->name, "unit", k->unit, "type", types[k->type], "default", knob_default(k),
                          "help", k->help);

    if (o && k->type == PELL_KNOB_ENUM) {
        json_t *choices = json_array();
        for (int i = 0; k->choices[i]; i++)
            json_array_append_new(choices, json_string(k->choices[i]));
        json_object_set_new(o, "choices", choices);
        json_object_set_new(o, "min", json_null());
        json_object_set_new(o, "max", json_null());
    } else if (o) {
        json_object_set_new(o, "min", knob_bound(k, k->min));
        json_object_set_new(o, "max", knob_bound(k, k->max));
    }
    return o;
}

json_t *cli_method_json(const struct cli *cli, const struct pell_method *m)
{
    const struct runs_on on = find_runs_on(cli, m);
    struct forms forms = make_forms(cli, m);
    json_t *knobs = json_array();
    char settings[1024];

    for (const struct pell_knob *k = m->knobs; k->name; k++) {
        json_t *o = cli_knob_json(k);
        char text[128];
        const char *value = knob_paper(k, &forms, text, sizeof(text));
        if (value)
            json_object_set_new(o, "paper", json_string(value));
        json_array_append_new(knobs, o);
    }
    list_paper_settings(m, forms.paper, settings, sizeof(settings));
    drop_forms(cli, &forms);
    return json_pack("{s:s,s:s,s:s,s:o,s:s,s:s*,s:o,s:s,s:s,s:o,s:s}", "name", m->name, "title", m->title, "kind", kinds[m->kind],
                     "engines", engines_of(m), "runs_on", on.name, "planes_with", on.with[0] ? on.with : NULL, "ignores", ignored_by(m),
                     "citation", m->cite, "limits", m->limits ? m->limits : "", "knobs", knobs, "paper_settings", settings);
}

static void print_knobs(const struct cli *cli, const struct pell_method *m)
{
    char low[40], high[40], def[40], text[128], settings[1024];
    struct forms forms = make_forms(cli, m);

    printf("\n%sKnobs%s (--set NAME=VALUE; * is the default)\n", cli_style(cli, stdout, 1), cli_style(cli, stdout, 0));
    for (const struct pell_knob *k = m->knobs; k->name; k++) {
        const bool unit = strcmp(k->unit, "1") != 0;
        printf("  %-18s ", k->name);
        if (k->type == PELL_KNOB_ENUM) {
            for (int i = 0; k->choices[i]; i++)
                printf("%s%s%s", i ? " | " : "", k->choices[i], i == (int) k->def[0] ? "*" : "");
        } else if (k->type == PELL_KNOB_BOOL) {
            printf("%s", k->def[0] != 0.0 ? "on* | off" : "on | off*");
        } else {
            printf("%s to %s%s%s, default %s", pell_format_number(k->min, false, low, sizeof(low)),
                   pell_format_number(k->max, false, high, sizeof(high)), unit ? " " : "", unit ? k->unit : "",
                   pell_format_number(k->def[0], false, def, sizeof(def)));
        }
        if (knob_paper(k, &forms, text, sizeof(text)))
            printf("; paper: %s", text);
        printf("\n%23s", "");
        cli_wrap(stdout, 23, 23, k->help);
    }
    list_paper_settings(m, forms.paper, settings, sizeof(settings));
    drop_forms(cli, &forms);
    if (!settings[0])
        return;
    fputs("\nas=paper also renders with ", stdout);
    cli_wrap(stdout, 27, 0, settings);
}

static void print_method(const struct cli *cli, const struct pell_method *m)
{
    const struct runs_on on = find_runs_on(cli, m);
    char line[256] = "";

    printf("%s%s%s", cli_style(cli, stdout, 1), m->name, cli_style(cli, stdout, 0));
    snprintf(line, sizeof(line), "- %s (%s; %s)", m->title, kinds[m->kind], engine_names(m));
    cli_wrap(stdout, (int) strlen(m->name), 2, line);
    line[0] = '\0';
    cli_wrap(stdout, 0, 0, m->cite);
    if (m->limits) {
        fputs("\nLimits: ", stdout);
        cli_wrap(stdout, 8, 8, m->limits);
    }
    printf("\nRuns on: %s%s%s\n", on.name[0] == 'p' ? "planes of a frame" : "a whole scene", on.with[0] ? "; on planes with " : "",
           on.with);
    for (unsigned input = 1; pell_ignored_name(input); input <<= 1)
        if (m->ignores & input)
            snprintf(line + strlen(line), sizeof(line) - strlen(line), "%s%s", line[0] ? ", " : "", pell_ignored_name(input));
    fputs("Ignores of a material: ", stdout);
    cli_wrap(stdout, 23, 23, line[0] ? line : "nothing");
    print_knobs(cli, m);
}

static bool runs_on_vulkan(void)
{
    for (size_t i = 0; i < pell_method_count(); i++)
        if (pell_method_at(i)->vulkan)
            return true;
    return false;
}

/* Text for -m none, which is not in the registry. */
static const char none_text[] = "no scattering: Lambertian of the same colour";

static void print_method_row(const char *name, const char *kind, int width, const char *engines, const char *on, const char *title)
{
    char head[128];
    const int column = 1 + snprintf(head, sizeof(head), "%-14s %-9s %-*s %-6s", name, kind, width, engines, on);

    if (column + strlen(title) <= 100 && cli_columns(stdout) == 96) /* one line for each, so that the output can be searched */
        printf("%s %s\n", head, title);
    else
        cli_row(stdout, head, column, title);
}

enum exit_code command_methods(struct cli *cli)
{
    const char *name = cli->num_arguments > 0 ? cli->arguments[0] : NULL;
    const struct pell_method *one = NULL;
    int width = 0;

    if (name && strcmp(name, "none") == 0 && !cli->json) {
        printf("none - %s\n", none_text);
        return EXIT_OK;
    }
    if (name && !(one = pell_method_find(cli->ctx, "methods", name)))
        return EXIT_USAGE;
    if (cli->json) {
        json_t *list = json_array();
        for (size_t i = 0; i < pell_method_count(); i++)
            if (!one || pell_method_at(i) == one)
                json_array_append_new(list, cli_method_json(cli, pell_method_at(i)));
        return cli_print_json(cli, json_pack("{s:o}", "methods", list));
    }
    if (one) {
        print_method(cli, one);
        return EXIT_OK;
    }
    for (size_t i = 0; i < pell_method_count(); i++)
        width = (int) strlen(engine_names(pell_method_at(i))) > width ? (int) strlen(engine_names(pell_method_at(i))) : width;
    for (size_t i = 0; i < pell_method_count(); i++) {
        const struct pell_method *m = pell_method_at(i);

        print_method_row(m->name, kinds[m->kind], width, engine_names(m), find_runs_on(cli, m).name, m->title);
    }
    print_method_row("none", "-", width, runs_on_vulkan() ? "cpu,vulkan" : "cpu", "-", none_text);
    return EXIT_OK;
}

#if defined(__clang__)
#define COMPILER "clang " __clang_version__
#else
#define COMPILER "gcc " __VERSION__
#endif
#if defined(__OPTIMIZE__)
#define OPTIMIZED true
#else
#define OPTIMIZED false
#endif
#if defined(NDEBUG)
#define ASSERTIONS false
#else
#define ASSERTIONS true
#endif
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
#define SANITIZED true
#else
#define SANITIZED false
#endif

static const char *const read_formats[] = { "png", "jpeg", "hdr", "exr", "pfm", NULL }; /* see pellucid/image.h */

enum { MAX_FORMATS = 16 };

/* All write formats, NULL-terminated. */
static void write_formats(const char *names[MAX_FORMATS + 1])
{
    const size_t count = pell_write_format_count();

    for (size_t i = 0; i <= MAX_FORMATS; i++)
        names[i] = i < MAX_FORMATS && i < count ? pell_write_format_at(i) : NULL;
}

static json_t *names_json(const char *const *names)
{
    json_t *list = json_array();
    for (; *names; names++)
        json_array_append_new(list, json_string(*names));
    return list;
}

static void print_names(const char *head, const char *const *names)
{
    printf("%-15s", head);
    for (; *names; names++)
        printf(" %s", *names);
    putchar('\n');
}

static json_t *devices_json(const struct pell_vulkan_devices *devices)
{
    json_t *list = json_array();

    for (size_t i = 0; i < devices->count; i++) {
        const struct pell_vulkan_device *d = &devices->list[i];
        const bool taken = (int) i == devices->taken;
        char version[48];

        snprintf(version, sizeof(version), "%u.%u.%u", d->version[0], d->version[1], d->version[2]);
        json_array_append_new(list, json_pack("{s:s,s:s,s:s,s:I,s:s,s:b,s:s}", "name", d->name, "kind", pell_vulkan_kind_name(d->kind),
                                              "vulkan", version, "memory", (json_int_t) d->memory, "missing", d->missing.str, "preferred",
                                              taken, "why", taken ? devices->why : ""));
    }
    return list;
}

static void print_devices(const struct pell_vulkan_devices *devices)
{
    char line[1024];

    printf("%-15s ", "engine vulkan");
    cli_wrap(
        stdout, 16, 16,
        runs_on_vulkan()
            ? "methods with a Vulkan engine, and if possible whole frames; unsupported stages run on the cpu, and a row of --stats gives "
              "the reason"
            : "this build has none");
    for (size_t i = 0; i < devices->count; i++) {
        const struct pell_vulkan_device *d = &devices->list[i];
        const bool taken = (int) i == devices->taken;

        snprintf(line, sizeof(line), "%s, %s, Vulkan %u.%u.%u, %.1f GiB%s%s%s%s", d->name, pell_vulkan_kind_name(d->kind), d->version[0],
                 d->version[1], d->version[2], (double) d->memory / (1 << 30), d->missing.length > 0 ? "; lacks " : "", d->missing.str,
                 taken ? "; preferred, since " : "", taken ? devices->why : "");
        printf("Vulkan device %zu ", i);
        cli_wrap(stdout, 16, 16, line);
    }
    if (devices->taken < 0) {
        printf("%-15s ", "Vulkan device");
        snprintf(line, sizeof(line), "none preferred: %s", devices->why);
        cli_wrap(stdout, 16, 16, line);
    }
    putchar('\n');
}

static const char *model_name(size_t i)
{
    const struct pell_profile_model_row *row = pell_profile_model_at(i);
    return row ? row->name : NULL;
}

/* The names that an option accepts, by the option, or "compare/OPTION" where `compare` accepts others: taken from tables, for shell
 * completion. */
static json_t *choices_json(const char *const *formats)
{
    static const struct {
        const char *option;
        const char *(*name)(size_t);
    } rows[] = { { "up", pell_axis_name },       { "normals", pell_normals_name },       { "from", pell_side_name },
                 { "studio", pell_studio_name }, { "background", pell_background_name }, { "model", model_name } };
    static const char *const switches[] = { "on", "off", NULL };
    const struct pell_knob *const tables[] = { pell_settings_knobs(), pell_compare_knobs() };
    char key[64];
    json_t *o = json_object();

    for (size_t i = 0; i < PELL_COUNT(rows); i++) {
        json_t *list = json_array();
        const char *name;
        for (size_t n = 0; (name = rows[i].name(n)); n++)
            json_array_append_new(list, json_string(name));
        json_object_set_new(o, rows[i].option, list);
    }
    json_object_set_new(o, "engine", names_json(cli_engine_names));
    json_object_set_new(o, "log-level", names_json(cli_log_levels));
    json_object_set_new(o, "progress", names_json(cli_progress_forms));
    json_object_set_new(o, "format", names_json(formats));
    json_object_set_new(o, "export", names_json(profile_language_names));
    json_object_set_new(o, "solver", names_json(stack_solver_names));
    json_array_append_new(json_object_get(o, "solver"), json_string("all"));
    for (size_t t = 0; t < PELL_COUNT(tables); t++)
        for (const struct pell_knob *k = tables[t]; k->name; k++)
            if (k->type == PELL_KNOB_ENUM || k->type == PELL_KNOB_BOOL) {
                snprintf(key, sizeof(key), "%s%s", json_object_get(o, k->name) ? "compare/" : "", k->name);
                json_object_set_new(o, key, names_json(k->type == PELL_KNOB_ENUM ? k->choices : switches));
            }
    return o;
}

static enum exit_code info_json(struct cli *cli, const char *device, int threads, const char *const *levels,
                                const struct pell_vulkan_devices *vulkan)
{
    const char *formats[MAX_FORMATS + 1];
    json_t *limits = json_object(), *info;

    write_formats(formats);
    for (const struct pell_knob *k = pell_limit_knobs(); k->name; k++) {
        const char *field = (const char *) &cli->limits + k->offset;
        json_object_set_new(limits, k->name, json_integer(k->type == PELL_KNOB_INT64 ? *(const int64_t *) field : *(const int *) field));
    }
    info =
        json_pack("{s:s,s:{s:s,s:b,s:b,s:b},s:[{s:s,s:s,s:i,s:s,s:o}],s:o,s:o,s:{s:o,s:o},s:i,s:o}", "version", pell_version_string(),
                  "build", "compiler", COMPILER, "optimized", OPTIMIZED, "assertions", ASSERTIONS, "sanitized", SANITIZED, "engines",
                  "name", "cpu", "device", device, "threads", threads, "simd", pell_simd_name(pell_simd_best()), "simd_levels",
                  names_json(levels), "devices", devices_json(vulkan), "limits", limits, "image_formats", "read", names_json(read_formats),
                  "write", names_json(formats), "materials", (int) pell_material_count(), "choices", choices_json(formats));
    if (info && runs_on_vulkan() && vulkan->taken >= 0)
        json_array_append_new(json_object_get(info, "engines"),
                              json_pack("{s:s,s:s}", "name", "vulkan", "device", vulkan->list[vulkan->taken].name));
    return cli_print_json(cli, info);
}

enum exit_code command_info(struct cli *cli)
{
    const char *levels[PELL_SIMD_LEVELS + 1] = { NULL }, *formats[MAX_FORMATS + 1];
    struct pell_device_params params = { .threads = cli->numbers.threads, .vulkan_device = cli->device };
    struct pell_vulkan_devices vulkan;
    struct pell_device *engine;
    char value[64], device[160];
    enum exit_code code = cli_engine(cli, &params.engine);
    int threads;

    if (code == EXIT_OK)
        code = cli_failed(cli, pell_device_create(cli->ctx, &params, &engine));
    if (code != EXIT_OK)
        return code;
    threads = pell_device_threads(engine);
    pell_device_destroy(&engine);
    code = cli_failed(cli, pell_vulkan_devices_find(cli->ctx, &vulkan));
    if (code != EXIT_OK)
        return code;
    cli_device_name(device, sizeof(device));
    for (int i = 0; i <= (int) pell_simd_best(); i++)
        levels[i] = pell_simd_name((enum pell_simd_level) i);
    if (cli->json) {
        code = info_json(cli, device, threads, levels, &vulkan);
        pell_vulkan_devices_release(cli->ctx, &vulkan);
        return code;
    }
    printf("pellucid %s\n%-15s %s%s%s%s\n\n%-15s %s\n%-15s %s, SIMD level %s\n", pell_version_string(), "built with", COMPILER,
           OPTIMIZED ? ", optimized" : ", not optimized", ASSERTIONS ? ", assertions" : "", SANITIZED ? ", sanitizers" : "", "engine cpu",
           device, "", pell_counted(threads, "thread", "threads").str, pell_simd_name(pell_simd_best()));
    print_names("SIMD levels", levels);
    print_devices(&vulkan);
    pell_vulkan_devices_release(cli->ctx, &vulkan);
    print_names("reads images", read_formats);
    write_formats(formats);
    print_names("writes images", formats);
    printf("\n%sLimits%s (--limit NAME=VALUE)\n", cli_style(cli, stdout, 1), cli_style(cli, stdout, 0));
    for (const struct pell_knob *k = pell_limit_knobs(); k->name; k++) {
        printf("  %-13s %12s  ", k->name, pell_knob_format(k, &cli->limits, value, sizeof(value)));
        cli_wrap(stdout, 29, 29, k->help);
    }
    return EXIT_OK;
}
