/* SPDX-License-Identifier: MIT
 *
 * dump.h - `render --dump FOLDER`: the intermediate images of a frame, each an EXR file, with an index.
 *
 * Ownership  dump_close removes what was not committed; it accepts a half-built object.
 */
#ifndef PELL_CLI_DUMP_H
#define PELL_CLI_DUMP_H

#include "cli/folder.h"

struct dump {
    struct cli *cli;
    struct output_folder folder;
    json_t *index;
};

/* Whether the other options allow --dump; call before the scene is read. */
enum exit_code dump_check(struct cli *cli);
/* Observes the renderer of the session until dump_close. Does nothing without --dump. */
enum exit_code dump_open(struct cli *cli, struct session *s, struct dump *d);
/* Moves the finished folder to its final name. */
enum exit_code dump_commit(struct cli *cli, const struct session *s, struct dump *d);
void dump_close(struct session *s, struct dump *d);

#endif
