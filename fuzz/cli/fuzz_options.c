/* SPDX-License-Identifier: MIT
 * fuzz_options.c - the command line on arbitrary words: every option of every command is accepted or refused with one error, whatever
 * its value. The first byte selects the command, the rest are its arguments, one per line. */
#include "cli/cli.h"

#include <stdlib.h>
#include <string.h>

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

enum { WORDS = 64 };

static void require(bool holds)
{
    if (!holds)
        abort();
}

/* Commands with the groups of options that the program's own accept. */
static const struct command commands[] = {
    { "render", "INPUT", "", "", "", OPTIONS_SCENE | OPTIONS_METHOD | OPTIONS_PICTURE | OPTIONS_FILE | OPTIONS_PARTS | OPTIONS_ENGINE, 1, 1,
      NULL },
    { "merge", "PART...", "", "", "", OPTIONS_MERGE | OPTIONS_ENGINE, 1, 100000, NULL },
    { "check", "INPUT", "", "", "", OPTIONS_SCENE | OPTIONS_CHECK, 1, 1, NULL },
    { "methods", "[NAME]", "", "", "", 0, 0, 1, NULL },
    { "profile", "[MATERIAL|FILE]", "", "", "", OPTIONS_PROFILE, 0, 1, NULL },
    { "compare", "A [B]", "", "", "", OPTIONS_SCENE | OPTIONS_PICTURE | OPTIONS_ENGINE | OPTIONS_COMPARE, 1, 2, NULL },
    { "view", "INPUT", "", "", "", OPTIONS_SCENE | OPTIONS_METHOD | OPTIONS_PICTURE | OPTIONS_ENGINE | OPTIONS_VIEW, 1, 1, NULL },
    { "bench", "NAME", "", "", "", OPTIONS_BENCH | OPTIONS_REPEATS, 0, 1, NULL },
};

/* The checks that a command makes before it opens a file. */
static void read_values(struct cli *cli)
{
    struct pell_load_params params;
    enum pell_engine engine;
    double seconds;

    require(pell_context_create(&(struct pell_context_params) { .log = cli_message, .log_user = cli, .limits = &cli->limits }, &cli->ctx) ==
            PELL_OK);
    if (cli_load_params(cli, &params) == EXIT_OK)
        require(params.size_mm >= 0.0 && params.mm_per_unit >= 0.0);
    (void) cli_engine(cli, &engine);
    for (size_t i = 0; i < cli->common.count; i++)
        if (cli_parse_seconds(cli, cli->common.items[i].where, cli->common.items[i].value, &seconds) == EXIT_OK)
            require(seconds >= 0.0);
    require(pell_memory_used(cli->ctx) == 0);
    pell_context_destroy(&cli->ctx);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    static const struct program program = {
        .name = "fuzz", .about = "", .start = "", .commands = commands, .num_commands = PELL_COUNT(commands)
    };
    /* Messages are collected as for JSON output; a text of --help is not printed. */
    struct cli cli = { .program = &program, .json = true, .of_a_file = true, .progress = { .fraction = 2.0 } };
    const char *words[WORDS + 1];
    char *text = size ? malloc(size) : NULL;
    int count = 1;
    bool done = false;
    enum exit_code code;

    if (!text)
        return 0;
    cli.command = &commands[data[0] % PELL_COUNT(commands)];
    memcpy(text, data + 1, size - 1);
    text[size - 1] = '\0';
    words[0] = cli.command->name;
    for (char *word = text, *end; word && count < WORDS; word = end) {
        end = strchr(word, '\n');
        if (end)
            *end++ = '\0';
        words[count++] = word;
    }
    words[count] = NULL;
    cli.warnings = json_array();
    pell_knobs_default(pell_limit_knobs(), &cli.limits);
    code = cli_parse(&cli, count, words, &done);
    require(code == EXIT_OK || code == EXIT_USAGE);
    require(code == EXIT_OK || cli.error.present);
    if (code == EXIT_OK && !done) {
        require(cli.num_arguments >= cli.command->min_arguments && cli.num_arguments <= cli.command->max_arguments);
        read_values(&cli);
    }
    cli_finish(&cli);
    free(text);
    return 0;
}
