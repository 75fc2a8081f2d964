/* SPDX-License-Identifier: MIT
 * folder.c - a folder of results that appears whole or not at all: files are written next to it, or in it under a name that starts with a
 * dot, and moved once the last one is complete. */
#include "cli/folder.h"

#include "base/file.h"

#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

enum pell_result folder_begin(struct pell_context *ctx, const char *option, const char *path, struct output_folder *f)
{
    static const char hint[] = "it must be a folder; it is created if its parent folder exists";
    struct stat st;
    size_t n = strlen(path);

    *f = (struct output_folder) { .ctx = ctx, .option = option };
    if (n > 4000)
        return pell_error(ctx, PELL_ERR_INVALID, option, NULL, "a name of %zu bytes is too long", n);
    while (n > 1 && path[n - 1] == '/')
        n--;
    memcpy(f->path, path, n);
    f->existed = stat(f->path, &st) == 0;
    if (f->existed && !S_ISDIR(st.st_mode))
        return pell_error(ctx, PELL_ERR_IO, path, hint, "exists and is not a folder");
    snprintf(f->partial, sizeof(f->partial), "%s%s.partial-XXXXXX", f->path, f->existed ? "/" : "");
    pell_file_in_flight(ctx, +1);
    if (mkdtemp(f->partial))
        return PELL_OK;
    pell_file_in_flight(ctx, -1);
    f->partial[0] = '\0';
    return pell_error(ctx, PELL_ERR_IO, path, f->existed ? "allow writing there, or name another folder" : hint,
                      f->existed ? "can't be written to" : "can't be made");
}

const char *folder_file(struct output_folder *f, const char *name)
{
    static const size_t most = PELL_COUNT(f->files);
    static _Thread_local char path[sizeof(f->partial) + sizeof(f->files[0])];

    if (f->count == most || strlen(name) >= sizeof(f->files[0])) {
        pell_error(f->ctx, PELL_ERR_INVALID, f->path, "ask for less at a time", "more than %zu files, or too long a name", most);
        return NULL;
    }
    snprintf(f->files[f->count++], sizeof(f->files[0]), "%s", name);
    snprintf(path, sizeof(path), "%s/%s", f->partial, name);
    return path;
}

void folder_replace(struct output_folder *f, const char *name)
{
    char path[sizeof(f->path) + sizeof(f->old[0].name)];
    struct stat st;

    if (!f->existed || f->num_old == PELL_COUNT(f->old) || strlen(name) >= sizeof(f->old[0].name) || strchr(name, '/'))
        return;
    snprintf(path, sizeof(path), "%s/%s", f->path, name);
    if (lstat(path, &st) != 0 || !S_ISREG(st.st_mode))
        return;
    snprintf(f->old[f->num_old].name, sizeof(f->old[0].name), "%s", name);
    f->old[f->num_old].device = (uint64_t) st.st_dev;
    f->old[f->num_old++].number = (uint64_t) st.st_ino;
}

/* Files that were moved here have another inode than those that they replaced. */
static void remove_old(struct output_folder *f)
{
    char path[sizeof(f->path) + sizeof(f->old[0].name)];
    struct stat st;

    for (size_t i = 0; i < f->num_old; i++) {
        snprintf(path, sizeof(path), "%s/%s", f->path, f->old[i].name);
        if (lstat(path, &st) != 0 || !S_ISREG(st.st_mode) || (uint64_t) st.st_dev != f->old[i].device ||
            (uint64_t) st.st_ino != f->old[i].number || pell_file_was_read(f->ctx, path))
            continue;
        if (unlink(path) != 0)
            pell_warn(f->ctx, path, NULL, "is of an earlier result and can't be removed");
    }
}

enum pell_result folder_commit(struct output_folder *f)
{
    char from[sizeof(f->partial) + sizeof(f->files[0])], to[sizeof(from)];
    const mode_t mask = umask(0);

    umask(mask);
    for (size_t i = 0; i < f->count; i++) {
        snprintf(to, sizeof(to), "%s/%s", f->path, f->files[i]);
        if (pell_file_was_read(f->ctx, to))
            return pell_error(f->ctx, PELL_ERR_INVALID, f->option, "name another folder", "\"%s\" is one of the files that were read", to);
    }
    if (!f->existed && chmod(f->partial, 0777 & ~mask) == 0 && rename(f->partial, f->path) == 0) {
        f->partial[0] = '\0';
        pell_file_in_flight(f->ctx, -1);
        return PELL_OK;
    }
    if (!f->existed && mkdir(f->path, 0777) != 0 && errno != EEXIST) /* another process created it meanwhile: equally good */
        return pell_error(f->ctx, PELL_ERR_IO, f->path, NULL, "can't be made");
    for (size_t i = 0; i < f->count; i++) {
        snprintf(from, sizeof(from), "%s/%s", f->partial, f->files[i]);
        snprintf(to, sizeof(to), "%s/%s", f->path, f->files[i]);
        if (rename(from, to) != 0)
            return pell_error(f->ctx, PELL_ERR_IO, to, NULL, "can't be replaced: %s",
                              errno == EISDIR ? "a folder has this name" : "the folder refuses it");
    }
    remove_old(f);
    folder_drop(f);
    return PELL_OK;
}

void folder_drop(struct output_folder *f)
{
    char path[sizeof(f->partial) + sizeof(f->files[0])];

    if (!f->partial[0])
        return;
    for (size_t i = 0; i < f->count; i++) {
        snprintf(path, sizeof(path), "%s/%s", f->partial, f->files[i]);
        unlink(path);
    }
    rmdir(f->partial);
    f->partial[0] = '\0';
    pell_file_in_flight(f->ctx, -1);
}
