/* SPDX-License-Identifier: MIT
 * auto.h - the method that `render --max-error` chooses. */
#ifndef PELL_CLI_AUTO_H
#define PELL_CLI_AUTO_H

#include "cli/cli.h"

/* The bound of cli->max_error (NULL: 8 %) as a fraction; EXIT_USAGE if it is none, or the engine that was asked for can't measure it. */
enum exit_code auto_bound(struct cli *cli, double *bound);
/* Gives an open session the cheapest method whose error against path-trace, on a small image of its scene, is at most cli->max_error (NULL:
 * 8 %), and reports it in one line; path-trace if no method is within the bound. *answer: the methods tried, for the JSON answer. */
enum exit_code auto_choose(struct cli *cli, struct session *s, json_t **answer);

#endif
