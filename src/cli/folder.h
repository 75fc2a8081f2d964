/* SPDX-License-Identifier: MIT
 *
 * folder.h - a folder of results that appears whole or not at all.
 *
 * Ownership  folder_drop takes away what was not committed; it takes what is half-made.
 */
#ifndef PELL_CLI_FOLDER_H
#define PELL_CLI_FOLDER_H

#include "cli/cli.h"

struct output_folder {
    struct pell_context *ctx;
    const char *option; /* that named it */
    char path[4200];    /* as given, without slashes at its end */
    char partial[4300]; /* where files are written until all are there; "": not begun */
    char files[512][280];
    size_t count;
    bool there; /* it was before: files replace those of the same name */
};

/* `path` may be there; the folder around it must. */
PELL_NODISCARD enum pell_result folder_begin(struct pell_context *ctx, const char *option, const char *path, struct output_folder *f);
/* Where to write the file `name`; files appear in the order of these calls. Valid until the next call. NULL, logged, after too many. */
const char *folder_file(struct output_folder *f, const char *name);
PELL_NODISCARD enum pell_result folder_commit(struct output_folder *f);
/* Takes away what was not committed. */
void folder_drop(struct output_folder *f);

#endif
