/* SPDX-License-Identifier: MIT
 *
 * file.h - reads whole files with a limit; writes whole files to a temporary name and renames them.
 *
 * Errors     logged with the path; PELL_ERR_IO, or PELL_ERR_INVALID over the limit.
 */
#ifndef PELL_FILE_H
#define PELL_FILE_H

#include "base/base.h"

/* Reads a regular file of at most `limits.file_bytes`. *data (owned by the caller, pell_free) has a NUL after its last byte that *size does
 * not count. */
PELL_NODISCARD enum pell_result pell_file_read(struct pell_context *ctx, const char *path, uint8_t **data, size_t *size);

/* A file that is read in pieces, with the checks of pell_file_read; pell_file_close releases it. */
struct pell_file {
    int handle; /* file descriptor; -1: none */
    size_t size;
};
PELL_NODISCARD enum pell_result pell_file_open(struct pell_context *ctx, const char *path, struct pell_file *file);
void pell_file_close(struct pell_file *file);
/* Reads `size` bytes from `at`; returns the number read: fewer at the end, if the file was truncated, and on device errors. */
size_t pell_file_read_at(const struct pell_file *file, uint64_t at, void *to, size_t size);

/* Whether the file that `path` names was opened by one of these, under any name: writing to it would destroy the input. */
bool pell_file_was_read(struct pell_context *ctx, const char *path);

/* Replaces `path` by these bytes, or leaves it unchanged: writes to a temporary name in the same folder, syncs to disk, then renames.
 * Temporary files of killed processes are removed an hour later. "-" writes to standard output. */
PELL_NODISCARD enum pell_result pell_file_write(struct pell_context *ctx, const char *path, const void *data, size_t size);

/* +1 begins, -1 ends a section in which files exist that would be left behind if the process ended; pell_file_write has its own. */
void pell_file_in_flight(struct pell_context *ctx, int change);
/* Whether such a section is active. May be called from a signal handler. */
bool pell_files_in_flight(const struct pell_context *ctx);

/* Resolves `reference` (as written in the file at `where`, percent-decoding already done) against folder `root`. Refused unless
 * `allow_outside`: absolute paths, ".." above `root`, links that lead out of it; and always anything but a regular file. *path is owned by
 * the caller. */
PELL_NODISCARD enum pell_result pell_path_resolve(struct pell_context *ctx, const char *where, const char *root, const char *reference,
                                                  bool allow_outside, char **path);

/* `path` (from the working folder) relative to the folder `root` if it lies below it; else its absolute path. Owned by the caller. */
PELL_NODISCARD enum pell_result pell_path_relative(struct pell_context *ctx, const char *where, const char *root, const char *path,
                                                   bool *below, char **out);
/* The folder of `path` ("." if it has none), owned by the caller; NULL if out of memory. */
char *pell_path_folder(struct pell_context *ctx, const char *path);
/* Points after the last '/'. */
const char *pell_path_name(const char *path);
/* True if `path` ends in '.' and `extension`, case ignored ("png"). */
bool pell_path_has_extension(const char *path, const char *extension);

#endif
