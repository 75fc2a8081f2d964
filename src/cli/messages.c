/* SPDX-License-Identifier: MIT
 * messages.c - messages, progress, JSON and exit codes. */
#include "cli/cli.h"

#include "base/file.h"
#include "render/communicator.h"

#include <math.h>
#include <poll.h>
#include <signal.h>
#include <stdlib.h>
#include <string.h>
#include <sys/ioctl.h>
#include <unistd.h>

#define LONG_ELAPSED 20.0 /* seconds after which the time left is an estimate */
#define LONG_LEFT 120.0   /* seconds left that are long */
#define MOST_COLUMNS 96
#define LEAST_COLUMNS 40
#define LEAST_TEXT 36 /* columns; if fewer are left next to a head, the text begins below it */
#define BELOW 8

const char *cli_style(const struct cli *cli, const FILE *file, int style)
{
    if (!(file == stdout ? cli->color_out : cli->color_err))
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

/* Columns that `length` bytes of UTF-8 take; wide characters count as one. */
static int columns(const char *text, size_t length)
{
    int n = 0;
    for (size_t i = 0; i < length; i++)
        n += ((unsigned char) text[i] & 0xc0) != 0x80;
    return n;
}

/* Width of the terminal; 0: the file is no terminal. */
static int terminal_columns(FILE *file)
{
    struct winsize size;

    if (!isatty(fileno(file)) || ioctl(fileno(file), TIOCGWINSZ, &size) != 0 || size.ws_col == 0)
        return 0;
    return size.ws_col < LEAST_COLUMNS ? LEAST_COLUMNS : size.ws_col;
}

int cli_columns(FILE *file)
{
    const int width = terminal_columns(file);
    return width == 0 || width > MOST_COLUMNS ? MOST_COLUMNS : width;
}

void cli_row(FILE *file, const char *head, int column, const char *text)
{
    const int width = columns(head, strlen(head)), indent = cli_columns(file) - column < LEAST_TEXT ? BELOW : column;

    if (indent < column || width >= column)
        fprintf(file, "%s\n%*s", head, indent, "");
    else
        fprintf(file, "%s%*s", head, column - width, "");
    cli_wrap(file, indent, indent, text);
}

void cli_wrap(FILE *file, int column, int indent, const char *text)
{
    const int most = cli_columns(file);
    bool fresh = column <= indent; /* nothing has been printed on the line yet */

    for (;;) {
        const size_t length = strcspn(text, " \n");
        const int width = columns(text, length);

        if (fresh && strncmp(text, "  ", 2) == 0) {
            const size_t line = strcspn(text, "\n");
            fwrite(text, 1, line, file);
            text += line;
        } else if (length > 0) {
            if (!fresh && column + 1 + width > most) {
                fprintf(file, "\n%*s", indent, "");
                column = indent;
            } else if (!fresh) {
                fputc(' ', file);
                column++;
            }
            fwrite(text, 1, length, file);
            column += width;
            fresh = false;
            text += length;
        }
        if (*text == '\n') {
            text++;
            if (!*text)
                break;
            fprintf(file, "\n%*s", *text == '\n' ? 0 : indent, "");
            column = indent;
            fresh = true;
        } else if (*text == ' ') {
            text++;
        } else if (!*text) {
            break;
        }
    }
    fputc('\n', file);
}

/* Breaks a command that is too long for its line: it continues after a backslash, a comment after another #. */
static void break_shell_line(FILE *file, const char *line, size_t length, int most)
{
    const char *const end = line + length;
    bool comment = false;
    int column = 0;

    while (line < end) {
        const size_t blanks = strspn(line, " ");
        const char *word = line + blanks;
        const size_t bytes = strcspn(word, " \n");
        const bool begins = !comment && word[0] == '#'; /* a comment stays in one piece if it can */
        const int width = begins ? columns(word, (size_t) (end - word)) : columns(word, bytes);
        const int tail = comment || begins || word + bytes >= end ? 0 : 2;
        if (bytes == 0)
            break;
        if (column == 0) {
            column = fprintf(file, "%*s", (int) blanks, "");
        } else if (column + 1 + width + tail > most && column > 8) {
            fputs(comment ? "\n      # " : " \\\n      ", file);
            column = comment ? 8 : 6;
        } else {
            fputc(' ', file);
            column++;
        }
        comment |= begins;
        fwrite(word, 1, bytes, file);
        column += columns(word, bytes);
        line = word + bytes;
    }
    fputc('\n', file);
}

void cli_print_shell(FILE *file, const char *lines)
{
    const int most = terminal_columns(file);

    while (*lines) {
        const size_t length = strcspn(lines, "\n");
        if (most == 0 || columns(lines, length) <= most)
            fprintf(file, "%.*s\n", (int) length, lines);
        else
            break_shell_line(file, lines, length, most);
        lines += length + (lines[length] == '\n');
    }
}

/* --- Messages ----------------------------------------------------------------------------------------------------------------- */

bool cli_reader_left(void)
{
    struct pollfd out = { .fd = STDOUT_FILENO };
    return poll(&out, 1, 0) > 0 && (out.revents & POLLERR);
}

static void print_message(struct cli *cli, enum pell_log_level level, const char *where, const char *what, const char *hint)
{
    static const char *const names[] = { "", "error", "warning", "", "debug" };
    static const int styles[] = { 0, 31, 33, 0, 2 };
    int column = 0;

    if (level > cli->log_level || (cli->quiet && level != PELL_LOG_ERROR))
        return;
    if (cli->json && (level == PELL_LOG_INFO || (level == PELL_LOG_ERROR && !cli->answered)))
        return; /* the error becomes the JSON object on stdout, unless one has been written */
    cli_progress_end(cli);
    if (names[level][0]) {
        fprintf(stderr, "%s%s:%s", cli_style(cli, stderr, styles[level]), names[level], cli_style(cli, stderr, 0));
        column += columns(names[level], strlen(names[level])) + 1;
    }
    if (cli->program->communicator && cli->program->communicator->rank > 0)
        column +=
            fprintf(stderr, "%srank %d of %d:", column ? " " : "", cli->program->communicator->rank, cli->program->communicator->ranks);
    if (where[0]) {
        fprintf(stderr, "%s%s%s:%s", column ? " " : "", cli_style(cli, stderr, 1), where, cli_style(cli, stderr, 0));
        column += columns(where, strlen(where)) + 1 + (column > 0);
    }
    if (!cli->tty) { /* one line for each, so that the output can be searched */
        fprintf(stderr, "%s%s\n", column ? " " : "", what);
        if (hint[0])
            fprintf(stderr, "  %s\n", hint);
        return;
    }
    cli_wrap(stderr, column, 2, what);
    if (!hint[0])
        return;
    fprintf(stderr, "  %s", cli_style(cli, stderr, 36));
    cli_wrap(stderr, 2, 2, hint);
    fputs(cli_style(cli, stderr, 0), stderr);
}

void cli_collect(struct cli *cli)
{
    cli->collected = json_array();
}

/* Prints the collected warnings if no answer will hold them. */
static void print_collected(struct cli *cli)
{
    json_t *collected = cli->collected, *m;
    size_t i;

    cli->collected = NULL;
    json_array_foreach(collected, i, m)
        print_message(cli, PELL_LOG_WARNING, json_string_value(json_object_get(m, "where")), json_string_value(json_object_get(m, "what")),
                      json_string_value(json_object_get(m, "hint")));
    json_decref(collected);
}

void cli_message(void *user, const struct pell_message *m)
{
    struct cli *cli = user;
    char where[sizeof(cli->error.where)], what[sizeof(cli->error.what)], hint[sizeof(cli->error.hint)];

    /* Names in files and arguments may hold anything, including escape sequences for the terminal. */
    pell_printable(m->where, where, sizeof(where));
    pell_printable(m->what, what, sizeof(what));
    pell_printable(m->hint, hint, sizeof(hint));
    if (cli->logs == CLI_LOGS_NOTHING || (cli->logs == CLI_LOGS_ERRORS && m->level != PELL_LOG_ERROR))
        return;
    if (m->level == PELL_LOG_ERROR && !cli->error.present) {
        cli->error.present = true;
        cli->error.code = m->code;
        memcpy(cli->error.where, where, sizeof(where));
        memcpy(cli->error.what, what, sizeof(what));
        memcpy(cli->error.hint, hint, sizeof(hint));
    } else if (m->level == PELL_LOG_ERROR && m->code == PELL_ERR_NOMEM && cli->error.code == PELL_ERR_NOMEM) {
        return; /* several arrays are allocated before the first missing one is noticed */
    }
    if (m->level == PELL_LOG_WARNING && cli->warnings) {
        char text[sizeof(where) + sizeof(what) + 2];
        snprintf(text, sizeof(text), "%s%s%s", where, where[0] ? ": " : "", what);
        json_array_append_new(cli->warnings, json_string(text));
    }
    if (m->level == PELL_LOG_WARNING && cli->collected) {
        json_array_append_new(cli->collected,
                              json_pack("{s:s,s:s,s:s,s:s}", "severity", "warning", "where", where, "what", what, "hint", hint));
        return;
    }
    if (strcmp(where, STDOUT_NAME) == 0 && cli_reader_left())
        return; /* `| head` has closed the pipe */
    if (m->level == PELL_LOG_ERROR)
        print_collected(cli);
    print_message(cli, m->level, where, what, hint);
}

enum exit_code cli_usage(struct cli *cli, const char *where, const char *hint, const char *fmt, ...)
{
    char what[sizeof(cli->error.what)];
    struct pell_message m = { PELL_LOG_ERROR, PELL_ERR_INVALID, where, what, hint ? hint : "" };
    va_list args;

    va_start(args, fmt);
    vsnprintf(what, sizeof(what), fmt, args);
    va_end(args);
    cli_message(cli, &m);
    return EXIT_USAGE;
}

enum exit_code cli_check_limit(struct cli *cli, const char *name)
{
    struct pell_text hint = { .length = 0 };
    const char *names[32];
    char shown[96];
    size_t count = 0;

    for (const struct pell_knob *k = pell_limit_knobs(); k->name && count < PELL_COUNT(names); k++)
        names[count++] = k->name;
    if (pell_knob_find(pell_limit_knobs(), name))
        return EXIT_OK;
    if (pell_text_suggest(&hint, "", name, names, count))
        pell_text_add(&hint, " ");
    for (size_t i = 0; i < count; i++)
        pell_text_add(&hint, "%s%s", i ? ", " : "The limits are ", names[i]);
    return cli_usage(cli, "--limit", hint.str, "there is no limit \"%s\"", pell_printable(name, shown, sizeof(shown)));
}

enum exit_code cli_spare_input(struct cli *cli, const char *option, const char *path)
{
    if (strcmp(path, "-") == 0 || !pell_file_was_read(cli->ctx, path))
        return EXIT_OK;
    return cli_usage(cli, option, "give it another name", "\"%s\" is one of the files that were read", path);
}

/* Whether an invalid value is the command line's fault: it came from an option, or the hint names a missing option; otherwise it is in a
 * file. */
static bool users_fault(const struct cli *cli)
{
    return cli->error.where[0] == '-' || strncmp(cli->error.hint, "--", 2) == 0;
}

enum exit_code cli_failed(struct cli *cli, enum pell_result result)
{
    switch (result) {
    case PELL_OK: return EXIT_OK;
    case PELL_ERR_INVALID: return users_fault(cli) ? EXIT_USAGE : EXIT_INPUT;
    case PELL_ERR_IO: return strcmp(cli->error.where, STDOUT_NAME) == 0 ? EXIT_FAILED : EXIT_INPUT;
    case PELL_ERR_FORMAT:
    case PELL_ERR_UNSUPPORTED: return EXIT_INPUT;
    case PELL_ERR_DEVICE: return EXIT_DEVICE;
    case PELL_ERR_NOMEM: return EXIT_MEMORY;
    case PELL_ERR_CANCELLED: return EXIT_INTERRUPTED;
    }
    return EXIT_FAILED;
}

/* --- Progress ----------------------------------------------------------------------------------------------------------------- */

/* Says once of a long task what makes it shorter. */
static void say_shorter(struct cli *cli, const char *task, double left)
{
    char line[256];

    snprintf(line, sizeof(line), "about %.0f minutes are left: %s shortens it", left / 60.0, cli->progress.shorter);
    cli->progress.shorter[0] = '\0';
    if (left > LONG_LEFT)
        print_message(cli, PELL_LOG_INFO, task, line, "");
}

void cli_progress(void *user, const char *task, double fraction)
{
    struct cli *cli = user;
    const double now = pell_seconds(), whole = cli->progress.parts ? (cli->progress.part + fraction) / cli->progress.parts : fraction;
    const int bar = 24, filled = (int) (fmin(fmax(whole, 0.0), 1.0) * bar);
    const bool form_json = cli->progress_form && strcmp(cli->progress_form, "json") == 0;
    char text[160];
    double elapsed;
    int width;

    if ((cli->quiet || cli->json) && !form_json)
        return;
    if (whole < cli->progress.fraction) { /* another task, part of which an earlier run may have done */
        cli->progress.begin = now;
        cli->progress.from = whole;
    }
    cli->progress.fraction = whole;
    elapsed = now - cli->progress.begin;
    if (now - fmax(cli->progress.shown, cli->progress.begin) < (form_json  ? 1.0
                                                                : cli->tty ? 0.1
                                                                           : 5.0) ||
        whole >= 1.0 || !(whole > cli->progress.from) || !(elapsed > 0.0))
        return;
    cli->progress.shown = now;
    if (cli->progress.shorter[0] && !form_json && elapsed > LONG_ELAPSED)
        say_shorter(cli, task, elapsed * (1.0 - whole) / (whole - cli->progress.from));
    if (form_json) {
        fprintf(stderr, "{\"progress\": {\"task\": \"%s\", \"fraction\": %.6f, \"seconds\": %.1f, \"seconds_left\": %.1f}}\n", task, whole,
                elapsed, elapsed * (1.0 - whole) / (whole - cli->progress.from));
        return;
    }
    width = snprintf(text, sizeof(text), "%3.0f %%, %.3g %%/s, %.0f s left", 100.0 * whole, 100.0 * (whole - cli->progress.from) / elapsed,
                     elapsed * (1.0 - whole) / (whole - cli->progress.from));
    if (!cli->tty) {
        fprintf(stderr, "%s: %s\n", task, text);
        return;
    }
    width += fprintf(stderr, "\r%s [%.*s%*s] ", task, filled, "########################", bar - filled, "") - 1;
    fprintf(stderr, "%s%*s", text, cli->progress.width > width ? cli->progress.width - width : 0, "");
    fflush(stderr);
    cli->progress.width = width;
}

void cli_progress_end(struct cli *cli)
{
    if (cli->progress.width > 0)
        fprintf(stderr, "\r%*s\r", cli->progress.width, "");
    cli->progress.width = 0;
}

/* --- JSON --------------------------------------------------------------------------------------------------------------------- */

void cli_answer_begins(void)
{
    struct sigaction action;

    if (sigaction(SIGINT, NULL, &action) == 0 && action.sa_handler != SIG_DFL && action.sa_handler != SIG_IGN) {
        action.sa_flags |= SA_RESTART;
        sigaction(SIGINT, &action, NULL);
    }
}

enum exit_code cli_print_json(struct cli *cli, json_t *object)
{
    char *text = object ? json_dumps(object, JSON_INDENT(2) | JSON_REAL_PRECISION(9)) : NULL;
    enum exit_code code = text ? EXIT_OK : EXIT_MEMORY;

    cli->answered = true;
    cli_answer_begins();
    puts(text ? text
              : "{\"error\": {\"code\": \"out of memory\", \"where\": \"\", \"what\": \"the result can't be written\", \"hint\": \"\"}}");
    free(text);
    json_decref(object);
    return code;
}

enum exit_code cli_print_version(struct cli *cli)
{
    if (cli->json)
        return cli_print_json(cli, json_pack("{s:s}", "version", pell_version_string()));
    printf("%s %s\n", cli->program->name, pell_version_string());
    cli->answered = true;
    return EXIT_OK;
}

void cli_print_json_error(struct cli *cli, enum exit_code code)
{
    if (!cli->json || cli->answered)
        return;
    if (!cli->error.present) {
        cli->error.code = code == EXIT_MEMORY ? PELL_ERR_NOMEM : PELL_ERR_CANCELLED;
        snprintf(cli->error.what, sizeof(cli->error.what),
                 code == EXIT_MEMORY ? "there is not enough memory" : "stopped before it was done");
    }
    cli_print_json(cli, json_pack("{s:{s:s,s:s,s:s,s:s}}", "error", "code", pell_result_name(cli->error.code), "where", cli->error.where,
                                  "what", cli->error.what, "hint", cli->error.hint));
}

json_t *cli_number(double value)
{
    return isfinite(value) ? json_real(value) : json_null();
}

json_t *cli_numbers(const double *values, size_t count)
{
    json_t *array = json_array();
    for (size_t i = 0; i < count; i++)
        json_array_append_new(array, cli_number(values[i]));
    return array;
}

json_t *cli_text(const char *text)
{
    char shown[8192];
    return json_string(pell_printable(text, shown, sizeof(shown)));
}
