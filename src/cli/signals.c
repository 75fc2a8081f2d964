/* SPDX-License-Identifier: MIT
 * signals.c - handling of Ctrl-C, SIGTERM and SIGHUP: cancel the work, and end the process if that takes long. */
#include "cli/cli.h"

#include "base/file.h"

#include <signal.h>
#include <stdatomic.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

/* Our own code checks for cancellation some hundred times a second. Libraries do not: building a ray tracing structure of 16 million
 * triangles takes seconds, in which Embree polls only a few times. */
#define LATE_NS 300000000L  /* after the signal */
#define AGAIN_NS 100000000L /* retry interval if files were being written then */

static struct cli *volatile interrupted; /* the command that is running; NULL: none */
static volatile sig_atomic_t interruptions, terminated;
static atomic_flag reported = ATOMIC_FLAG_INIT;
static timer_t timer;
static bool timer_there;

/* Signal handlers may only call the functions that POSIX lists as async-signal-safe (2.4.3). */
static void put(int to, const char *text)
{
    if (write(to, text, strlen(text)) < 0)
        return; /* there is no reader */
}

static void put_count(int to, unsigned count)
{
    char digits[16];
    size_t at = sizeof(digits) - 1;

    digits[at] = '\0';
    do
        digits[--at] = (char) ('0' + count % 10);
    while (count /= 10);
    put(to, digits + at);
}

enum exit_code cli_interrupted(const struct cli *cli)
{
    return terminated && cli->checkpoint && cli->merge.count == 0 ? EXIT_RESUMABLE : EXIT_INTERRUPTED;
}

void cli_say_interrupted(const struct cli *cli, enum exit_code code)
{
    if (cli->quiet || cli->json || atomic_flag_test_and_set(&reported))
        return;
    if (code == EXIT_RESUMABLE) {
        put(STDERR_FILENO, "not finished; the same command resumes it from the checkpoint\n");
    } else if (cli->partial) {
        put(STDERR_FILENO, "interrupted; the image was written with the samples that it had\n");
    } else if (cli->images) {
        put(STDERR_FILENO, "interrupted; written before: ");
        put_count(STDERR_FILENO, (unsigned) cli->images);
        put(STDERR_FILENO, cli->images == 1 ? " image\n" : " images\n");
    } else {
        put(STDERR_FILENO, "interrupted; nothing was written\n");
    }
}

/* The same text as cli_print_json_error writes. */
static const char cancelled_json[] = "{\n  \"error\": {\n    \"code\": \"cancelled\",\n    \"where\": \"\",\n"
                                     "    \"what\": \"stopped before it was done\",\n    \"hint\": \"\"\n  }\n}\n";

static void on_late(int signal)
{
    const struct cli *cli = interrupted;

    (void) signal;
    if (!cli || !pell_cancelled(cli->ctx) || pell_files_in_flight(cli->ctx) || cli->answered)
        return;
    if (cli->progress.width > 0)
        put(STDERR_FILENO, "\n");
    cli_say_interrupted(cli, cli_interrupted(cli));
    if (cli->json && !atomic_flag_test_and_set(&reported))
        put(STDOUT_FILENO, cancelled_json);
    _exit(cli_interrupted(cli));
}

static void on_signal(int signal)
{
    static const struct itimerspec late = { .it_value = { .tv_nsec = LATE_NS }, .it_interval = { .tv_nsec = AGAIN_NS } };

    if (signal != SIGINT)
        terminated = 1;
    if (interruptions && signal == SIGHUP)
        return; /* the system and the shell both send it when a terminal is closed */
    if (interruptions)
        _exit(EXIT_INTERRUPTED);
    interruptions = 1;
    if (!interrupted)
        return;
    pell_context_interrupt(interrupted->ctx);
    if (timer_there)
        timer_settime(timer, 0, &late, NULL);
}

bool cli_terminated(void)
{
    return terminated;
}

/* Signals that the caller ignores (nohup, a background job) stay ignored. */
static void catch_signal(int number)
{
    struct sigaction action = { .sa_handler = on_signal }, old;
    if (sigaction(number, NULL, &old) == 0 && old.sa_handler != SIG_IGN)
        sigaction(number, &action, NULL);
}

void cli_signals_begin(struct cli *cli)
{
    const struct sigaction late = { .sa_handler = on_late, .sa_flags = SA_RESTART };
    struct sigevent event = { .sigev_notify = SIGEV_SIGNAL, .sigev_signo = SIGALRM };

    interrupted = cli;
    /* A rank of several must not leave the others waiting: they end together. */
    if (!cli->program->communicator && sigaction(SIGALRM, &late, NULL) == 0)
        timer_there = timer_create(CLOCK_MONOTONIC, &event, &timer) == 0;
    catch_signal(SIGINT);
    catch_signal(SIGTERM);
    catch_signal(SIGHUP);
}

void cli_signals_end(void)
{
    interrupted = NULL;
    if (timer_there)
        timer_delete(timer);
    timer_there = false;
}
