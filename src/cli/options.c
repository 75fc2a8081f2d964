/* SPDX-License-Identifier: MIT
 * options.c - the command line: one table of options, of which a command takes some groups; knobs of the picture come from
 * pell_settings_knobs, so that each has one row. */
#include "cli/cli.h"

#include <popt.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

enum option_code {
    OPT_SET = 1,
    OPT_LIMIT,
    OPT_LOG_LEVEL,
    OPT_HELP,
    OPT_SETTING, /* + index of the row in pell_settings_knobs */
};

struct option_row {
    enum option_group group;
    struct poptOption option;
};

#define MAX_OPTIONS 64

static size_t fill_table(struct cli *cli, unsigned groups, struct poptOption table[MAX_OPTIONS])
{
    const struct option_row rows[] = {
        { OPTIONS_OUTPUT, { "help", 'h', POPT_ARG_NONE, NULL, OPT_HELP, "this text", NULL } },
        { OPTIONS_SCENE, { "material", 0, POPT_ARG_STRING, &cli->material, 0, "what everything is made of: a built-in name (`pellucid materials`) or a material file", "NAME|FILE" } },
        { OPTIONS_SCENE, { "size", 0, POPT_ARG_STRING, &cli->size, 0, "the largest extent of the thing, with its unit", "70mm" } },
        { OPTIONS_SCENE, { "unit", 0, POPT_ARG_STRING, &cli->unit, 0, "what one unit of the mesh file is", "1mm" } },
        { OPTIONS_SCENE, { "camera", 0, POPT_ARG_STRING, &cli->camera, 0, "a camera of the file; default its first, else framing", "NAME" } },
        { OPTIONS_SCENE, { "time", 0, POPT_ARG_STRING, &cli->time, 0, "time of the animation (only 0 yet)", "SECONDS" } },
        { OPTIONS_SCENE, { "allow-outside", 0, POPT_ARG_NONE, &cli->allow_outside, 0, "let files refer to files outside the scene's folder", NULL } },
        { OPTIONS_SCENE, { "limit", 0, POPT_ARG_STRING, NULL, OPT_LIMIT, "raise or lower a limit (`pellucid info` lists them)", "NAME=VALUE" } },
        { OPTIONS_METHOD, { "method", 'm', POPT_ARG_STRING, &cli->method, 0, "how light is scattered; none: not at all", "NAME" } },
        { OPTIONS_METHOD, { "set", 0, POPT_ARG_STRING, NULL, OPT_SET, "a knob of the method (`pellucid methods NAME`), repeatable", "KNOB=VALUE" } },
        { OPTIONS_PICTURE, { "output", 'o', POPT_ARG_STRING, &cli->output, 0, "png, exr, hdr or pfm by its ending; - writes to stdout (default: INPUT's name with .png)", "FILE" } },
        { OPTIONS_PICTURE, { "format", 0, POPT_ARG_STRING, &cli->format, 0, "png, exr, hdr or pfm, whatever the name ends in", "FORMAT" } },
        { OPTIONS_PICTURE, { "turntable", 0, POPT_ARG_INT, &cli->turntable, 0, "N pictures round the thing; numbers go into the output's name", "N" } },
        { OPTIONS_PICTURE, { "stats", 0, POPT_ARG_NONE, &cli->stats, 0, "a table of the stages' times", NULL } },
        { OPTIONS_BENCH, { "repeats", 0, POPT_ARG_INT, &cli->repeats, 0, "warm frames to take the median of (default 15)", "N" } },
        { OPTIONS_ENGINE, { "engine", 0, POPT_ARG_STRING, &cli->engine, 0, "auto, cpu or vulkan", "NAME" } },
        { OPTIONS_ENGINE, { "device", 0, POPT_ARG_STRING, &cli->device, 0, "which Vulkan device", "N|NAME" } },
        { OPTIONS_ENGINE, { "threads", 0, POPT_ARG_INT, &cli->threads, 0, "threads to work with; 0: one per core", "N" } },
        { OPTIONS_OUTPUT, { "json", 0, POPT_ARG_NONE, &cli->json, 0, "the answer as one JSON object on stdout", NULL } },
        { OPTIONS_OUTPUT, { "quiet", 'q', POPT_ARG_NONE, &cli->quiet, 0, "errors only", NULL } },
        { OPTIONS_OUTPUT, { "log-level", 0, POPT_ARG_STRING, NULL, OPT_LOG_LEVEL, "error, warning, info or debug", "LEVEL" } },
    };
    size_t n = 0;

    for (size_t i = 0; i < PELL_COUNT(rows); i++)
        if ((groups | OPTIONS_OUTPUT) & rows[i].group)
            table[n++] = rows[i].option;
    if (groups & OPTIONS_PICTURE)
        for (size_t i = 0; pell_settings_knobs[i].name && n + 1 < MAX_OPTIONS; i++) {
            const struct pell_knob *k = &pell_settings_knobs[i];
            if (strcmp(k->name, "layers") == 0)
                continue; /* follows from the format */
            table[n++] = (struct poptOption) { k->name, 0, POPT_ARG_STRING, NULL, OPT_SETTING + (int) i, k->help,
                                               k->type == PELL_KNOB_ENUM ? "NAME" : "N" };
        }
    table[n] = (struct poptOption) POPT_TABLEEND;
    return n;
}

static void print_range(const struct pell_knob *k, FILE *file)
{
    if (k->type == PELL_KNOB_ENUM)
        for (int i = 0; k->choices[i]; i++)
            fprintf(file, "%s%s%s", i ? ", " : "; ", k->choices[i], i == (int) k->def[0] ? " (default)" : "");
    else if (k->type != PELL_KNOB_BOOL)
        fprintf(file, "; %g to %g%s%s, default %g", k->min, k->max, strcmp(k->unit, "1") ? " " : "", strcmp(k->unit, "1") ? k->unit : "", k->def[0]);
}

void cli_print_help(const struct command *command, FILE *file)
{
    struct cli none = { 0 };
    struct poptOption table[MAX_OPTIONS];
    const size_t n = fill_table(&none, command->options, table);

    fprintf(file, "pellucid %s - %s\n\nusage: pellucid %s %s%s[OPTIONS]\n\n%s\nOptions\n", command->name, command->summary, command->name,
            command->arguments, command->arguments[0] ? " " : "", command->text);
    for (size_t i = 0; i < n; i++) {
        char head[64];
        snprintf(head, sizeof(head), "%s%c%s--%s%s%s", table[i].shortName ? "-" : "", table[i].shortName ? table[i].shortName : ' ',
                 table[i].shortName ? ", " : "   ", table[i].longName, table[i].argDescrip ? " " : "",
                 table[i].argDescrip ? table[i].argDescrip : "");
        fprintf(file, "  %-32s %s", head, table[i].descrip);
        if (table[i].val >= OPT_SETTING)
            print_range(&pell_settings_knobs[table[i].val - OPT_SETTING], file);
        fputc('\n', file);
    }
}

enum pell_result cli_add_setting(struct cli *cli, struct settings_list *list, const char *name, const char *value, const char *where)
{
    struct pell_setting *grown;
    (void) cli;

    if (list->count == list->capacity) {
        const size_t capacity = list->capacity ? 2 * list->capacity : 16;
        grown = realloc(list->items, capacity * sizeof(*grown));
        if (!grown)
            return PELL_ERR_NOMEM;
        list->items = grown;
        list->capacity = capacity;
    }
    name = strdup(name);
    value = strdup(value);
    where = strdup(where);
    list->items[list->count++] = (struct pell_setting) { name, value, where };
    return name && value && where ? PELL_OK : PELL_ERR_NOMEM;
}

void cli_free_settings(struct settings_list *list)
{
    for (size_t i = 0; i < list->count; i++) {
        free((char *) list->items[i].name);
        free((char *) list->items[i].value);
        free((char *) list->items[i].where);
    }
    free(list->items);
    *list = (struct settings_list) { 0 };
}

void cli_finish(struct cli *cli)
{
    const char **texts[] = { &cli->output, &cli->format, &cli->method, &cli->material, &cli->size, &cli->unit, &cli->camera, &cli->engine,
                             &cli->device, &cli->time, &cli->command_line };

    for (size_t i = 0; i < PELL_COUNT(texts); i++)
        free((char *) *texts[i]);
    for (int i = 0; i < cli->num_arguments; i++)
        free((char *) cli->arguments[i]);
    free(cli->arguments);
    cli_free_settings(&cli->knobs);
    cli_free_settings(&cli->settings);
}

/* "NAME=VALUE" of --set and --limit. */
static enum exit_code add_pair(struct cli *cli, struct settings_list *list, const char *option, const char *text)
{
    const char *equals = strchr(text, '=');
    char name[128];

    if (!equals || equals == text || (size_t) (equals - text) >= sizeof(name))
        return cli_usage(cli, option, "write it as NAME=VALUE", "\"%s\" names no value", text);
    memcpy(name, text, (size_t) (equals - text));
    name[equals - text] = '\0';
    return cli_add_setting(cli, list, name, equals + 1, option) == PELL_OK ? EXIT_OK : EXIT_MEMORY;
}

static enum exit_code set_log_level(struct cli *cli, const char *text)
{
    static const char *const names[] = { "none", "error", "warning", "info", "debug" };
    for (int i = 0; i < (int) PELL_COUNT(names); i++)
        if (strcmp(names[i], text) == 0) {
            cli->log_level = (enum pell_log_level) i;
            return EXIT_OK;
        }
    return cli_usage(cli, "--log-level", NULL, "\"%s\", must be error, warning, info or debug", text);
}

static enum exit_code handle(struct cli *cli, int code, const char *text)
{
    if (code == OPT_SET)
        return add_pair(cli, &cli->knobs, "--set", text);
    if (code == OPT_LIMIT) {
        struct settings_list one = { 0 };
        enum exit_code result = add_pair(cli, &one, "--limit", text);
        if (result == EXIT_OK) {
            /* No context yet: a small one, only to report. */
            struct pell_context *ctx;
            if (pell_context_create(&(struct pell_context_params) { .log = cli_message, .log_user = cli }, &ctx) != PELL_OK) {
                result = EXIT_MEMORY;
            } else {
                if (pell_knob_set(ctx, pell_limit_knobs, "limits", "--limit", &cli->limits, one.items[0].name, one.items[0].value) != PELL_OK)
                    result = EXIT_USAGE;
                pell_context_destroy(&ctx);
            }
        }
        cli_free_settings(&one);
        return result;
    }
    if (code == OPT_LOG_LEVEL)
        return set_log_level(cli, text);
    if (code >= OPT_SETTING) {
        const struct pell_knob *k = &pell_settings_knobs[code - OPT_SETTING];
        char where[64];
        snprintf(where, sizeof(where), "--%s", k->name);
        return cli_add_setting(cli, &cli->settings, k->name, text, where) == PELL_OK ? EXIT_OK : EXIT_MEMORY;
    }
    return EXIT_OK;
}

/* The nearest option to one that popt did not know, as a hint. */
static enum exit_code unknown_option(struct cli *cli, const char *bad, int error, const struct poptOption *table, size_t n)
{
    const char *names[MAX_OPTIONS], *nearest, *name = bad;
    char hint[200];

    for (size_t i = 0; i < n; i++)
        names[i] = table[i].longName;
    while (*name == '-')
        name++;
    nearest = error == POPT_ERROR_BADOPT ? pell_nearest(name, names, n) : NULL;
    if (nearest)
        snprintf(hint, sizeof(hint), "did you mean --%s?", nearest);
    else
        snprintf(hint, sizeof(hint), "`pellucid %s --help` lists the options", cli->command->name);
    return cli_usage(cli, bad, hint, "%s", poptStrerror(error));
}

static char *join_command(int argc, const char **argv)
{
    size_t size = 16;
    char *line;

    for (int i = 0; i < argc; i++)
        size += strlen(argv[i]) + 1;
    line = malloc(size);
    if (!line)
        return NULL;
    strcpy(line, "pellucid");
    for (int i = 0; i < argc; i++) {
        /* A path of this machine says nothing to others: its name alone is kept. */
        const char *name = argv[i][0] == '/' && strrchr(argv[i], '/')[1] ? strrchr(argv[i], '/') + 1 : argv[i];
        strcat(line, " ");
        strcat(line, name);
    }
    return line;
}

enum exit_code cli_parse(struct cli *cli, int argc, const char **argv, bool *done)
{
    struct poptOption table[MAX_OPTIONS];
    const size_t n = fill_table(cli, cli->command->options, table);
    poptContext popt = poptGetContext("pellucid", argc, argv, table, 0);
    enum exit_code code = popt ? EXIT_OK : EXIT_MEMORY;
    const char *argument;
    int got;

    cli->command_line = join_command(argc, argv);
    cli->arguments = calloc((size_t) argc + 1, sizeof(*cli->arguments));
    if (!cli->arguments || !cli->command_line)
        code = EXIT_MEMORY;
    /* --json must hold for errors of the command line, too. */
    for (int i = 1; i < argc; i++)
        cli->json = cli->json || strcmp(argv[i], "--json") == 0;
    while (code == EXIT_OK && (got = poptGetNextOpt(popt)) != -1) {
        char *text;
        if (got < -1) {
            code = unknown_option(cli, poptBadOption(popt, POPT_BADOPTION_NOALIAS), got, table, n);
            break;
        }
        if (got == OPT_HELP) {
            cli_print_help(cli->command, stdout);
            *done = true;
            break;
        }
        text = poptGetOptArg(popt);
        code = handle(cli, got, text ? text : "");
        free(text);
    }
    while (code == EXIT_OK && !*done && (argument = poptGetArg(popt)))
        cli->arguments[cli->num_arguments++] = strdup(argument);
    poptFreeContext(popt);
    if (code != EXIT_OK || *done)
        return code;
    if (cli->num_arguments < cli->command->min_arguments || cli->num_arguments > cli->command->max_arguments)
        return cli_usage(cli, cli->command->name, "`--help` shows examples", "takes %s%s, not %d arguments",
                         cli->command->arguments[0] ? cli->command->arguments : "no argument", "", cli->num_arguments);
    if (cli->quiet && cli->log_level > PELL_LOG_ERROR)
        cli->log_level = PELL_LOG_ERROR;
    if (cli->threads < 0 || cli->threads > 256)
        return cli_usage(cli, "--threads", NULL, "%d, must be in [0, 256]; 0 is one per core", cli->threads);
    if (cli->turntable < 0 || cli->turntable > 100000)
        return cli_usage(cli, "--turntable", NULL, "%d, must be in [1, 100000]", cli->turntable);
    if (cli->repeats < 0 || cli->repeats > 10000)
        return cli_usage(cli, "--repeats", NULL, "%d, must be in [1, 10000]", cli->repeats);
    return EXIT_OK;
}
