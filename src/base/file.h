/* SPDX-License-Identifier: MIT
 *
 * file.h - whole files in, whole files out: read with a limit, write to a temporary name and rename.
 *
 * Errors     logged with the path; PELL_ERR_IO, or PELL_ERR_INVALID over the limit.
 */
#ifndef PELL_FILE_H
#define PELL_FILE_H

#include "base/base.h"

/* Reads a regular file of at most `limits.file_bytes`. *data (owned by the caller, pell_free) has a NUL behind its last byte that
 * *size does not count. */
PELL_NODISCARD enum pell_result pell_file_read(struct pell_context *ctx, const char *path, uint8_t **data, size_t *size);

/* A file that is read in pieces, with the checks of pell_file_read; pell_file_close releases it. */
struct pell_file {
    int handle; /* of the system; -1: none */
    size_t size;
};
PELL_NODISCARD enum pell_result pell_file_open(struct pell_context *ctx, const char *path, struct pell_file *file);
void pell_file_close(struct pell_file *file);
/* Reads `size` bytes from `at`; returns how many there were: fewer at the end, after a file was cut, and where the device fails. */
size_t pell_file_at(const struct pell_file *file, uint64_t at, void *to, size_t size);

/* Whether the file that `path` names was opened by one of these, by whatever name: who writes there would destroy what was read. */
bool pell_file_was_read(struct pell_context *ctx, const char *path);

/* Replaces `path` by these bytes, or leaves it as it was: written under a temporary name in the same folder, to the disk, then renamed.
 * What a process that was killed left there is removed an hour later. "-" writes to standard output. */
PELL_NODISCARD enum pell_result pell_file_write(struct pell_context *ctx, const char *path, const void *data, size_t size);

/* +1 begins, -1 ends a stretch in which something lies on the disk that would stay behind if the process ended; pell_file_write has its
 * own. */
void pell_file_in_flight(struct pell_context *ctx, int change);
/* Whether such a stretch runs. May be called from a signal handler. */
bool pell_files_in_flight(const struct pell_context *ctx);

/* Resolves `reference` (as it stands in the file at `where`, percent-decoding already done) against folder `root`. Refused unless
 * `allow_outside`: absolute paths, ".." above `root`, links that lead out of it; and always what is no regular file.
 * *path is owned by the caller. */
PELL_NODISCARD enum pell_result pell_path_resolve(struct pell_context *ctx, const char *where, const char *root, const char *reference,
                                                  bool allow_outside, char **path);

/* `path` (from the working folder) as seen from the folder `root` if it lies below it; else its absolute path. The caller's. */
PELL_NODISCARD enum pell_result pell_path_relative(struct pell_context *ctx, const char *where, const char *root, const char *path,
                                                   bool *below, char **out);
/* The folder of `path` ("." if it has none), owned by the caller; NULL without memory. */
char *pell_path_folder(struct pell_context *ctx, const char *path);
/* Points behind the last '/'. */
const char *pell_path_name(const char *path);
/* True if `path` ends in '.' and `extension`, case ignored ("png"). */
bool pell_path_has_extension(const char *path, const char *extension);

#endif
