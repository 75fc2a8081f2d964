/* SPDX-License-Identifier: MIT
 *
 * folder.h - a folder of results that appears whole or not at all.
 *
 * Ownership  folder_drop removes what was not committed; it accepts a half-built object.
 */
#ifndef PELL_CLI_FOLDER_H
#define PELL_CLI_FOLDER_H

#include "cli/cli.h"

struct output_folder {
    struct pell_context *ctx;
    const char *option; /* the option that named the folder */
    char path[4200];    /* as given, without trailing slashes */
    char partial[4300]; /* where files are written until all are complete; "": not begun */
    char files[512][280];
    size_t count;
    bool existed; /* the folder existed before: files replace those of the same name */
    struct {
        char name[96];
        uint64_t device, number; /* of the file when it was named */
    } old[512];                  /* see folder_replace */
    size_t num_old;
};

/* `path` may exist; its parent folder must. */
PELL_NODISCARD enum pell_result folder_begin(struct pell_context *ctx, const char *option, const char *path, struct output_folder *f);
/* Path to write the file `name` to; files are moved in the order of these calls. Valid until the next call. NULL, logged, after too
 * many. */
const char *folder_file(struct output_folder *f, const char *name);
/* Names a file of an earlier result, which folder_commit removes once all files are moved. It stays if it is not a regular file, or has
 * been read or written by then. Does nothing if there is no such file, or after too many calls. */
void folder_replace(struct output_folder *f, const char *name);
PELL_NODISCARD enum pell_result folder_commit(struct output_folder *f);
/* Removes what was not committed. */
void folder_drop(struct output_folder *f);

#endif
