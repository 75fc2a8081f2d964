/* SPDX-License-Identifier: MIT
 * program.c - finds and runs a command of a program: --help, signals, messages, exit codes. */
#include "cli/cli.h"

#include "render/communicator.h"

#include <signal.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

/* Handles --help, --version and the like. EXIT_OK and *done, or the command's row. */
static enum exit_code choose_command(struct cli *cli, int argc, const char **argv, bool *done)
{
    const char *first = argc > 1 ? argv[1] : "";

    *done = true;
    if (argc < 2) {
        cli_print_usage(cli->program, stderr);
        return EXIT_USAGE;
    }
    if (strcmp(first, "--version") == 0 || strcmp(first, "-V") == 0)
        return cli_print_version(cli);
    if (strcmp(first, "--help") == 0 || strcmp(first, "-h") == 0 || strcmp(first, "help") == 0)
        return cli_help(cli, argv + 2, argc - 2, done);
    *done = false;
    cli->command = cli_find_command(cli->program, first);
    return cli->command ? EXIT_OK : cli_unknown_command(cli, first, false);
}

static enum exit_code run(struct cli *cli, int argc, const char **argv)
{
    enum exit_code code;
    bool done = false;
    enum pell_result res;

    /* Errors of the command line itself are answered as JSON, too. */
    for (int i = 1; i < argc; i++)
        cli->json = cli->json || strcmp(argv[i], "--json") == 0;
    code = choose_command(cli, argc, argv, &done);
    if (code == EXIT_OK && !done)
        code = cli_parse(cli, argc - 1, argv + 1, &done);
    if (cli->program->communicator && cli->program->communicator->rank > 0) {
        cli->quiet = true; /* rank 0 prints for all ranks, except errors */
        cli->json = cli->stats = false;
        free(cli->progress_form);
        cli->progress_form = NULL;
    }
    if (code != EXIT_OK || done)
        return code;

    res = pell_context_create(
        &(struct pell_context_params) {
            .log = cli_message,
            .log_user = cli,
            .log_level = cli->log_level > PELL_LOG_WARNING ? cli->log_level : PELL_LOG_WARNING, /* for the JSON answer */
            .progress = cli_progress,
            .progress_user = cli,
            .limits = &cli->limits,
        },
        &cli->ctx);
    if (res != PELL_OK)
        return cli_failed(cli, res);
    cli_signals_begin(cli);
    code = cli->command->run(cli);
    cli_progress_end(cli);
    cli_signals_end();
    pell_context_destroy(&cli->ctx);
    return code;
}

/* The kernel maps stack pages when they are first touched, and kills the process if it has no memory for them. Touching them now makes sure
 * that they exist when memory is short: then an allocation fails, which is an ordinary error. */
static __attribute__((noinline)) void touch_stack(void)
{
    volatile char pages[1 << 20];

    for (size_t i = 0; i < sizeof(pages); i += 4096)
        pages[i] = 0;
}

int cli_main(const struct program *program, int argc, char **argv)
{
    struct cli cli = { .program = program, .log_level = PELL_LOG_INFO, .progress = { .fraction = 2.0 } };
    const char *term = getenv("TERM"), *no_color = getenv("NO_COLOR");
    const bool color = !(no_color && no_color[0]) && !(term && strcmp(term, "dumb") == 0);
    enum exit_code code;

    touch_stack();
    signal(SIGPIPE, SIG_IGN); /* a failing write reports the error */
    signal(SIGXFSZ, SIG_IGN);
    cli.tty = isatty(STDERR_FILENO) == 1;
    cli.color_err = color && cli.tty;
    cli.color_out = color && isatty(STDOUT_FILENO) == 1;
    cli.warnings = json_array();
    pell_knobs_default(pell_limit_knobs(), &cli.limits);
    code = run(&cli, argc, (const char **) argv);
    if (code == EXIT_INTERRUPTED)
        code = cli_interrupted(&cli);
    if (code == EXIT_MEMORY && !cli.error.present) /* no context existed that could have reported it */
        cli_message(&cli, &(struct pell_message) { PELL_LOG_ERROR, PELL_ERR_NOMEM, program->name, "there is not enough memory", "" });
    if (code != EXIT_OK)
        cli_print_json_error(&cli, code);
    if (code == EXIT_INTERRUPTED || code == EXIT_RESUMABLE)
        cli_say_interrupted(&cli, code);
    if ((fflush(stdout) != 0 || ferror(stdout)) && code == EXIT_OK) {
        cli.answered = true; /* nothing more can be written there */
        cli_message(&cli, &(struct pell_message) { PELL_LOG_ERROR, PELL_ERR_IO, STDOUT_NAME, "the answer can't be written", "" });
        code = EXIT_FAILED;
    }
    cli_finish(&cli);
    return (int) code;
}
