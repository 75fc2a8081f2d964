/* SPDX-License-Identifier: MIT
 * report.c - messages, progress, JSON and exit codes. */
#include "cli/cli.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

const char *cli_style(const struct cli *cli, int style)
{
    if (!cli->color)
        return "";
    switch (style) {
    case 1: return "\033[1m";
    case 2: return "\033[2m";
    case 31: return "\033[31;1m";
    case 33: return "\033[33;1m";
    case 36: return "\033[36m";
    default: return "\033[0m";
    }
}

static void print_message(struct cli *cli, enum pell_log_level level, const char *where, const char *what, const char *hint)
{
    static const char *const names[] = { "", "error", "warning", "", "debug" };
    static const int styles[] = { 0, 31, 33, 0, 2 };

    cli_progress_end(cli);
    if (names[level][0])
        fprintf(stderr, "%s%s:%s ", cli_style(cli, styles[level]), names[level], cli_style(cli, 0));
    if (where[0])
        fprintf(stderr, "%s%s:%s ", cli_style(cli, 1), where, cli_style(cli, 0));
    fprintf(stderr, "%s\n", what);
    if (hint[0])
        fprintf(stderr, "  %s%s%s\n", cli_style(cli, 36), hint, cli_style(cli, 0));
}

void cli_message(void *user, const struct pell_message *m)
{
    struct cli *cli = user;

    if (m->level == PELL_LOG_ERROR && !cli->error.there) {
        cli->error.there = true;
        cli->error.code = m->code;
        snprintf(cli->error.where, sizeof(cli->error.where), "%s", m->where);
        snprintf(cli->error.what, sizeof(cli->error.what), "%s", m->what);
        snprintf(cli->error.hint, sizeof(cli->error.hint), "%s", m->hint);
    }
    if (m->level == PELL_LOG_WARNING && cli->warnings) {
        char text[3072];
        snprintf(text, sizeof(text), "%s%s%s", m->where, m->where[0] ? ": " : "", m->what);
        json_array_append_new(cli->warnings, json_string(text));
    }
    if (m->level == PELL_LOG_INFO && (cli->quiet || cli->json))
        return;
    if (m->level == PELL_LOG_WARNING && cli->quiet)
        return;
    if (m->level == PELL_LOG_ERROR && cli->json)
        return; /* goes to stdout as JSON */
    print_message(cli, m->level, m->where, m->what, m->hint);
}

enum exit_code cli_usage(struct cli *cli, const char *where, const char *hint, const char *fmt, ...)
{
    char what[2048];
    struct pell_message m = { PELL_LOG_ERROR, PELL_ERR_INVALID, where ? where : "", what, hint ? hint : "" };
    va_list args;

    va_start(args, fmt);
    vsnprintf(what, sizeof(what), fmt, args);
    va_end(args);
    cli_message(cli, &m);
    return EXIT_USAGE;
}

/* A place inside a file ("scene.json:/camera", "bunny.obj:17"), not the name of an option or of a whole file. */
static bool inside_file(const char *where)
{
    const char *colon = strchr(where, ':');
    return where[0] != '-' && colon && (colon[1] == '/' || (colon[1] >= '0' && colon[1] <= '9'));
}

enum exit_code cli_failed(struct cli *cli, enum pell_result result)
{
    switch (result) {
    case PELL_OK: return EXIT_OK;
    case PELL_ERR_INVALID: return inside_file(cli->error.where) ? EXIT_INPUT : EXIT_USAGE;
    case PELL_ERR_IO:
    case PELL_ERR_FORMAT:
    case PELL_ERR_UNSUPPORTED: return EXIT_INPUT;
    case PELL_ERR_DEVICE: return EXIT_DEVICE;
    case PELL_ERR_NOMEM: return EXIT_MEMORY;
    case PELL_ERR_CANCELLED: return EXIT_INTERRUPTED;
    }
    return EXIT_FAILED;
}

void cli_progress(void *user, const char *task, double fraction)
{
    struct cli *cli = user;
    const double now = pell_seconds();
    const int width = 30, filled = (int) (fmin(fmax(fraction, 0.0), 1.0) * width);

    if (cli->quiet || cli->json || now - cli->progress_shown < (cli->tty ? 0.1 : 5.0))
        return;
    cli->progress_shown = now;
    if (!cli->tty) {
        fprintf(stderr, "%s %.0f %%\n", task, 100.0 * fraction);
        return;
    }
    fprintf(stderr, "\r%s [%.*s%*s] %3.0f %%", task, filled, "##############################", width - filled, "", 100.0 * fraction);
    fflush(stderr);
    cli->progress_open = true;
}

void cli_progress_end(struct cli *cli)
{
    if (cli->progress_open)
        fprintf(stderr, "\r%60s\r", "");
    cli->progress_open = false;
}

enum exit_code cli_print_json(struct cli *cli, json_t *object)
{
    char *text = object ? json_dumps(object, JSON_INDENT(2) | JSON_REAL_PRECISION(9)) : NULL;
    enum exit_code code = EXIT_OK;

    cli->answered = true;
    if (!text) {
        fputs("{\"error\": {\"code\": \"out of memory\", \"where\": \"\", \"what\": \"the answer can't be made\", \"hint\": \"\"}}\n", stdout);
        code = EXIT_MEMORY;
    } else if (puts(text) == EOF) {
        code = EXIT_FAILED;
    }
    free(text);
    json_decref(object);
    return code;
}

void cli_print_json_error(struct cli *cli)
{
    if (!cli->json || cli->answered)
        return;
    if (!cli->error.there) {
        cli->error.code = PELL_ERR_CANCELLED;
        snprintf(cli->error.what, sizeof(cli->error.what), "stopped before it was done");
    }
    cli_print_json(cli, json_pack("{s:{s:s,s:s,s:s,s:s}}", "error", "code", pell_result_name(cli->error.code), "where", cli->error.where,
                                  "what", cli->error.what, "hint", cli->error.hint));
}

json_t *cli_numbers(const double *values, size_t count)
{
    json_t *array = json_array();
    for (size_t i = 0; i < count; i++)
        json_array_append_new(array, isfinite(values[i]) ? json_real(values[i]) : json_null());
    return array;
}

size_t cli_warning_count(const struct cli *cli)
{
    return json_array_size(cli->warnings);
}

const char *cli_warning(const struct cli *cli, size_t index)
{
    return json_string_value(json_array_get(cli->warnings, index));
}
