/* SPDX-License-Identifier: MIT
 * help.c - the texts of --help, and of `help NAME` for a command, a topic, an option, a method, a knob or a material. */
#include "cli/cli.h"

#include <pellucid/material.h>
#include <pellucid/method.h>

#include <string.h>

#define COLUMN 22 /* column where the texts next to names begin */

static void add_topics(struct pell_text *text)
{
    for (const struct topic *t = cli_topics; t->name; t++)
        pell_text_add(text, "%s, ", t->name);
    pell_text_add(text, "topics");
}

void cli_print_usage(const struct program *program, FILE *file)
{
    struct pell_text topics = { .length = 0 };
    char text[128];

    snprintf(text, sizeof(text), "%s - %s", program->name, program->about);
    cli_wrap(file, 0, 2, text);
    snprintf(text, sizeof(text), "usage: %s COMMAND [ARGUMENTS] [OPTIONS]", program->name);
    fputc('\n', file);
    cli_wrap(file, 0, 6, text);
    fputc('\n', file);
    for (size_t i = 0; i < program->num_commands; i++) {
        char head[64];
        snprintf(head, sizeof(head), "  %s%s%s", program->commands[i].name, program->commands[i].arguments[0] ? " " : "",
                 program->commands[i].arguments);
        cli_row(file, head, COLUMN, program->commands[i].summary);
    }
    fputc('\n', file);
    snprintf(text, sizeof(text), "this text; `%s COMMAND --help` lists its options", program->name);
    cli_row(file, "  -h, --help", COLUMN, text);
    pell_text_add(&topics, "about a command, an option, a method, a knob, a material, or ");
    add_topics(&topics);
    cli_row(file, "  help NAME", COLUMN, topics.str);
    cli_row(file, "  -V, --version", COLUMN, "the version");
    fputc('\n', file);
    cli_print_shell(file, program->start);
    if (program->start[0])
        fputc('\n', file);
    cli_wrap(
        file, 0, 0,
        "Exit codes: 0 ok, 1 failed, 2 wrong usage, 3 bad input, 4 engine or device not available, 5 out of memory, 75 ended by a time "
        "limit, SIGTERM or SIGHUP and resumable, 130 interrupted.");
}

const struct command *cli_find_command(const struct program *program, const char *name)
{
    for (size_t i = 0; i < program->num_commands; i++)
        if (strcmp(program->commands[i].name, name) == 0)
            return &program->commands[i];
    return NULL;
}

/* Finds a topic by its name, another name, or the name of one of its rows: "NO_COLOR", "relative error". */
static const struct topic *find_topic(const char *name)
{
    struct pell_text word = { .length = 0 };

    for (const struct topic *t = cli_topics; t->name; t++)
        if (strcmp(t->name, name) == 0)
            return t;
    pell_text_add(&word, "|%s|", name);
    for (const struct topic *t = cli_topics; t->name; t++)
        if (!strchr(name, '|') && strstr(t->aliases, word.str))
            return t;
    for (const struct topic *t = cli_topics; t->name; t++)
        for (const struct topic_row *r = t->rows; r && r->name; r++)
            if (strcmp(r->name, name) == 0)
                return t;
    return NULL;
}

static void print_topic(const struct program *program, const struct topic *topic)
{
    char title[128];

    snprintf(title, sizeof(title), "%s help %s - %s\n", program->name, topic->name, topic->summary);
    cli_wrap(stdout, 0, 2, title);
    putchar('\n');
    if (topic->text[0])
        cli_wrap(stdout, 0, 0, topic->text);
    for (const struct topic_row *r = topic->rows; r && r->name; r++) {
        char head[64];
        if (r == topic->rows && topic->text[0])
            putchar('\n');
        snprintf(head, sizeof(head), "  %s", r->name);
        cli_row(stdout, head, COLUMN, r->text);
    }
}

static void print_topics(const struct program *program)
{
    char text[128];

    printf("%s help topics - what it explains\n\n", program->name);
    for (const struct topic *t = cli_topics; t->name; t++) {
        char head[64];
        snprintf(head, sizeof(head), "  %s", t->name);
        cli_row(stdout, head, COLUMN, t->summary);
    }
    snprintf(text, sizeof(text), "\n`%s help` also takes a command, an option, a method, a knob or a material.", program->name);
    cli_wrap(stdout, 0, 0, text);
}

/* Prints an option, with or without dashes, for each command that has it. `gap`: an empty line before it. */
static bool print_option(const struct program *program, const char *name, bool gap)
{
    bool found = false;

    for (size_t i = 0; i < program->num_commands; i++)
        if (cli_print_option(&program->commands[i], name, false, stdout)) {
            if (!found && gap)
                putchar('\n');
            if (!found)
                cli_print_option(&program->commands[i], name, true, stdout);
            printf("%s %s", found ? "," : "  of", program->commands[i].name);
            found = true;
        }
    if (found)
        putchar('\n');
    return found;
}

/* Prints the knobs of that name, each with its method. */
static bool print_knobs(const char *name, bool gap)
{
    const struct pell_method *m;
    bool found = false;

    for (size_t i = 0; (m = pell_method_at(i)); i++) {
        const struct pell_knob *k = pell_knob_find(m->knobs, name);
        char head[64];
        if (!k)
            continue;
        snprintf(head, sizeof(head), "  %s", m->name);
        if (!found)
            printf("%s--set %s=VALUE\n", gap ? "\n" : "", k->name);
        cli_row(stdout, head, COLUMN, k->help);
        found = true;
    }
    return found;
}

static bool is_method(const char *name)
{
    const struct pell_method *m;

    for (size_t i = 0; (m = pell_method_at(i)); i++)
        if (strcmp(m->name, name) == 0)
            return true;
    return false;
}

enum exit_code cli_unknown_command(struct cli *cli, const char *name, bool help)
{
    enum { MOST = 512 };
    const struct program *program = cli->program;
    const char *names[MOST];
    struct pell_text hint = { .length = 0 };
    const struct pell_method *m;
    size_t count = 0;
    char head[64];

    if (program->absent.name && strcmp(program->absent.name, name) == 0)
        return cli_usage(cli, name, program->absent.hint, "%s", program->absent.what);
    for (size_t i = 0; i < program->num_commands && count < MOST; i++)
        names[count++] = program->commands[i].name;
    for (const struct topic *t = cli_topics; help && t->name && count < MOST; t++)
        names[count++] = t->name;
    for (size_t i = 0; help && (m = pell_method_at(i)) && count < MOST; i++) {
        names[count++] = m->name;
        for (const struct pell_knob *k = m->knobs; k->name && count < MOST; k++)
            names[count++] = k->name;
    }
    for (size_t i = 0; help && i < pell_material_count() && count < MOST; i++)
        names[count++] = pell_material_at(i)->name;
    count += help ? cli_option_names(program, names + count, MOST - count) : 0;
    snprintf(head, sizeof(head), "%s %s", program->name, help ? "help " : "");
    if (!pell_text_suggest(&hint, head, name + (help ? strspn(name, "-") : 0), names, count))
        pell_text_add(&hint, "`%s --help` lists them", program->name);
    if (help) {
        pell_text_add(&hint, "%s topics: ", hint.str[hint.length - 1] == '?' ? "" : ";");
        add_topics(&hint);
    }
    return cli_usage(cli, program->name, hint.str, help ? "there is no help about \"%s\"" : "there is no command \"%s\"", name);
}

enum exit_code cli_help(struct cli *cli, const char **words, int count, bool *done)
{
    const struct program *program = cli->program;
    const struct command *command;
    const struct topic *topic;
    struct pell_text about = { .length = 0 };
    bool known, any = false;

    for (int i = 0; i < count; i++) /* "relative error" is one name, quoted or not */
        if (strcmp(words[i], "--json") != 0) {
            pell_text_add(&about, "%s%s", any ? " " : "", words[i]);
            any = true;
        }
    if (!any) {
        cli_print_usage(program, stdout);
        return EXIT_OK;
    }
    if (is_method(about.str) || pell_material_find(about.str)) {
        /* as `methods NAME`, `materials NAME`, where the program has them */
        const char *home = is_method(about.str) ? "methods" : "materials";
        struct pell_text hint = { .length = 0 };
        cli->command = cli_find_command(program, home);
        *done = !cli->command;
        pell_text_add(&hint, "`pellucid %s %s` explains it", home, about.str);
        return cli->command ? EXIT_OK : cli_usage(cli, program->name, hint.str, "there is no help about \"%s\" here", about.str);
    }
    if (strcmp(about.str, "topics") == 0 || strcmp(about.str, "topic") == 0) {
        print_topics(program);
        return EXIT_OK;
    }
    command = cli_find_command(program, about.str);
    topic = find_topic(about.str);
    if (command) {
        cli_print_help(program, command, stdout);
        return EXIT_OK;
    }
    if (topic)
        print_topic(program, topic);
    known = print_option(program, about.str, topic != NULL) || topic;
    known = print_knobs(about.str, known) || known;
    return known ? EXIT_OK : cli_unknown_command(cli, about.str, true);
}
