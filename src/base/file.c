/* SPDX-License-Identifier: MIT
 * file.c - reads and writes whole files; the only code that decides which files a scene may refer to. */
#define _XOPEN_SOURCE 700 /* realpath */
#include "base/file.h"
#include "base/context.h"

#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <time.h>
#include <unistd.h>

enum { SHOWN = 256, CHUNK = 16 << 20, SYNC = 2 * CHUNK };
enum {
    STALE_SECONDS = 3600,
    STALE_MAX_ENTRIES = 65536,
    STALE_WRITES = 4
}; /* folder entries that are checked, by the first writes of a context */

/* strerror is not thread-safe, and depends on the locale. */
static const char *reason(int code)
{
    switch (code) {
    case ENOENT: return "there is no such file or folder";
    case EACCES:
    case EPERM: return "permission denied";
    case ENOTDIR: return "a part of the path is not a folder";
    case EISDIR: return "it is a folder";
    case ELOOP: return "too many links, or a link that leads to itself";
    case ENAMETOOLONG: return "the name is too long";
    case ENOSPC: return "no space is left on the disk";
    case EDQUOT: return "the disk quota is used up";
    case EROFS: return "the file system is read-only";
    case EMFILE:
    case ENFILE: return "too many files are open";
    case EFBIG: return "the file would be too large for the file system";
    case EIO: return "the device reports an error";
    case EPIPE: return "the reader has closed the pipe";
    case ENXIO: return "no device or reader is there";
    case ENOMEM: return "out of memory";
    case ETXTBSY: return "it is a program that runs";
    }
    return "the operating system refuses it";
}

static enum pell_result failed(struct pell_context *ctx, const char *path, const char *what, int code)
{
    char shown[SHOWN];
    return pell_error(ctx, PELL_ERR_IO, pell_printable(path, shown, sizeof(shown)), NULL, "%s: %s (errno %d)", what, reason(code), code);
}

static const char *kind(mode_t mode)
{
    return S_ISDIR(mode)                    ? "a folder"
           : S_ISFIFO(mode)                 ? "a pipe"
           : S_ISSOCK(mode)                 ? "a socket"
           : S_ISCHR(mode) || S_ISBLK(mode) ? "a device"
                                            : "of an unknown kind";
}

/* Reads up to `size` bytes; *got is the number read. Returns 0, or the errno; ECANCELED for a long file when the context was cancelled. */
static int read_all(const struct pell_context *ctx, int fd, uint8_t *data, size_t size, size_t *got)
{
    *got = 0;
    while (*got < size) {
        const size_t left = size - *got;
        const ssize_t n = read(fd, data + *got, left < CHUNK ? left : CHUNK);
        if (n == 0)
            break;
        if (n > 0)
            *got += (size_t) n;
        else if (errno != EINTR)
            return errno;
        if (n == CHUNK && pell_cancelled(ctx))
            return ECANCELED;
    }
    return 0;
}

static struct pell_file_id *slot_of(struct pell_file_id *files, size_t slots, struct pell_file_id id)
{
    size_t i = (size_t) ((id.device * 31 + id.inode) * 0x9e3779b97f4a7c15u >> 32) & (slots - 1);

    while ((files[i].device || files[i].inode) && (files[i].device != id.device || files[i].inode != id.inode))
        i = (i + 1) & (slots - 1);
    return &files[i];
}

/* Allocated directly: the table lives as long as the context and is not charged to the call that reads a file. */
static enum pell_result remember(struct pell_context *ctx, const struct stat *st)
{
    const struct pell_file_id id = { (uint64_t) st->st_dev, (uint64_t) st->st_ino };
    struct pell_file_id *slot;
    enum pell_result res = PELL_OK;

    pthread_mutex_lock(&ctx->log_lock);
    if (2 * (ctx->num_files + 1) > ctx->file_slots) {
        const size_t slots = ctx->file_slots ? 2 * ctx->file_slots : 64;
        struct pell_file_id *grown = ctx->allocator.alloc(ctx->allocator.user, slots * sizeof(*grown));
        res = grown ? PELL_OK : PELL_ERR_NOMEM;
        if (grown)
            memset(grown, 0, slots * sizeof(*grown));
        for (size_t i = 0; grown && i < ctx->file_slots; i++)
            *slot_of(grown, slots, ctx->files[i]) = ctx->files[i];
        if (grown && ctx->files)
            ctx->allocator.free(ctx->allocator.user, ctx->files);
        ctx->files = grown ? grown : ctx->files;
        ctx->file_slots = grown ? slots : ctx->file_slots;
    }
    if (res == PELL_OK) {
        slot = slot_of(ctx->files, ctx->file_slots, id);
        ctx->num_files += !(slot->device || slot->inode);
        *slot = id;
    }
    pthread_mutex_unlock(&ctx->log_lock);
    return res == PELL_OK ? PELL_OK : pell_error(ctx, res, NULL, NULL, "there is no memory for the list of files");
}

bool pell_file_was_read(struct pell_context *ctx, const char *path)
{
    struct pell_file_id id;
    struct stat st;
    bool found = false;

    if (stat(path, &st) != 0)
        return false;
    id = (struct pell_file_id) { (uint64_t) st.st_dev, (uint64_t) st.st_ino };
    pthread_mutex_lock(&ctx->log_lock);
    if (ctx->files)
        found = slot_of(ctx->files, ctx->file_slots, id)->inode != 0;
    pthread_mutex_unlock(&ctx->log_lock);
    return found;
}

enum pell_result pell_file_open(struct pell_context *ctx, const char *path, struct pell_file *file)
{
    const int64_t limit = pell_context_limits(ctx)->file_bytes;
    enum pell_result res;
    char shown[SHOWN];
    struct stat st;

    *file = (struct pell_file) { .handle = -1 };
    pell_printable(path, shown, sizeof(shown));
    /* O_NONBLOCK: open would block on a pipe without a writer. It has no effect on regular files. */
    do
        file->handle = open(path, O_RDONLY | O_CLOEXEC | O_NONBLOCK | O_NOCTTY);
    while (file->handle < 0 && errno == EINTR);
    if (file->handle < 0)
        return failed(ctx, path, "can't be opened", errno);
    if (fstat(file->handle, &st) != 0)
        res = failed(ctx, path, "can't be examined", errno);
    else if (!S_ISREG(st.st_mode))
        res = pell_error(ctx, PELL_ERR_IO, shown, NULL, "is %s, must be a regular file", kind(st.st_mode));
    else if (st.st_size < 0 || (int64_t) st.st_size > limit || (uintmax_t) st.st_size >= SIZE_MAX)
        res = pell_error(ctx, PELL_ERR_INVALID, shown, PELL_RAISE_LIMIT("file-bytes") ", if this file is meant",
                         "has %lld bytes, allowed are %lld", (long long) st.st_size, (long long) limit);
    else
        res = remember(ctx, &st);
    if (res != PELL_OK)
        pell_file_close(file);
    else
        file->size = (size_t) st.st_size;
    return res;
}

void pell_file_close(struct pell_file *file)
{
    if (file->handle >= 0)
        close(file->handle);
    *file = (struct pell_file) { .handle = -1 };
}

size_t pell_file_read_at(const struct pell_file *file, uint64_t at, void *to, size_t size)
{
    size_t got = 0;

    if (at >= file->size)
        return 0;
    size = size < file->size - at ? size : file->size - at;
    while (got < size) {
        const size_t left = size - got;
        const ssize_t n = pread(file->handle, (uint8_t *) to + got, left < CHUNK ? left : CHUNK, (off_t) (at + got));
        if (n == 0 || (n < 0 && errno != EINTR))
            break;
        got += n > 0 ? (size_t) n : 0;
    }
    return got;
}

enum pell_result pell_file_read(struct pell_context *ctx, const char *path, uint8_t **data, size_t *size)
{
    enum pell_result res;
    struct pell_file file;
    uint8_t *bytes = NULL;
    char shown[SHOWN];
    size_t got = 0;
    int code;

    *data = NULL;
    *size = 0;
    PELL_TRY(pell_file_open(ctx, path, &file));
    bytes = pell_alloc(ctx, file.size + 1);
    if (!bytes) {
        res = PELL_ERR_NOMEM;
        goto fail;
    }
    /* Requests one byte too many, to detect a file that grew since fstat. */
    code = read_all(ctx, file.handle, bytes, file.size + 1, &got);
    if (code) {
        res = code == ECANCELED ? PELL_ERR_CANCELLED : failed(ctx, path, "can't be read", code);
        goto fail;
    }
    if (got != file.size) {
        res = pell_error(ctx, PELL_ERR_IO, pell_printable(path, shown, sizeof(shown)), "wait until it is written, then try again",
                         "changed its size while it was read: %zu bytes were announced, %s came", file.size,
                         got > file.size ? "more" : "fewer");
        goto fail;
    }
    bytes[file.size] = '\0';
    *data = bytes;
    *size = file.size;
    bytes = NULL;
fail:
    pell_file_close(&file);
    pell_free(ctx, bytes);
    return res;
}

/* Some file systems do not support it. */
static int to_disk(int fd)
{
    return fsync(fd) == 0 || errno == EINVAL || errno == ENOTSUP || errno == EINTR ? 0 : errno;
}

/* Returns 0, or the errno; ECANCELED if the context was cancelled meanwhile. `sync`: syncs to disk, in pieces, since nothing interrupts an
 * fsync. */
static int write_all(struct pell_context *ctx, int fd, const uint8_t *data, size_t size, bool sync)
{
    size_t waiting = 0;

    while (size) {
        const ssize_t n = write(fd, data, size < CHUNK ? size : CHUNK);
        if (n >= 0) {
            data += n;
            size -= (size_t) n;
            waiting += (size_t) n;
        } else if (errno != EINTR) {
            return errno;
        }
        if (size && pell_cancelled(ctx))
            return ECANCELED;
        if (sync && waiting >= SYNC) {
            const int code = to_disk(fd);
            if (code)
                return code;
            waiting = 0;
        }
    }
    return sync ? to_disk(fd) : 0;
}

static enum pell_result write_failed(struct pell_context *ctx, const char *path, int code)
{
    return code == ECANCELED ? PELL_ERR_CANCELLED : failed(ctx, path, "can't be written", code);
}

void pell_file_in_flight(struct pell_context *ctx, int change)
{
    atomic_fetch_add(&ctx->in_flight, change);
}

bool pell_files_in_flight(const struct pell_context *ctx)
{
    return atomic_load(&ctx->in_flight) > 0;
}

/* Opens a new file next to `path`; its name goes to `temporary`, which has room for path + 64 bytes. -1 and errno on failure. */
static int open_temporary(const char *path, char *temporary)
{
    const size_t folder = (size_t) (pell_path_name(path) - path);
    int fd = -1;

    for (unsigned attempt = 0; attempt < 100; attempt++) {
        struct timespec now;

        clock_gettime(CLOCK_REALTIME, &now);
        memcpy(temporary, path, folder);
        snprintf(temporary + folder, 64, ".pellucid-%lx-%lx-%x.tmp", (unsigned long) getpid(), (unsigned long) now.tv_nsec, attempt);
        fd = open(temporary, O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC | O_NOCTTY, 0666);
        if (fd >= 0 || (errno != EEXIST && errno != EINTR))
            break;
    }
    return fd;
}

/* The process id in a name made by open_temporary; 0: another name. */
static pid_t process_of(const char *name)
{
    static const char prefix[] = ".pellucid-", digits[] = "0123456789abcdef";
    const char *at = name + sizeof(prefix) - 1;
    long number = 0;

    if (strncmp(name, prefix, sizeof(prefix) - 1) != 0)
        return 0;
    for (; *at && strchr(digits, *at) && number < INT_MAX / 16; at++)
        number = 16 * number + (strchr(digits, *at) - digits);
    for (int part = 0; part < 2; part++)
        at += *at == '-' ? 1 + strspn(at + 1, digits) : 0;
    return strcmp(at, ".tmp") == 0 ? (pid_t) number : 0;
}

/* Removes temporary files left by processes that were killed: in this folder, the user's, an hour old, of no running process. */
static void remove_stale(const char *path)
{
    const size_t length = (size_t) (pell_path_name(path) - path);
    const time_t now = time(NULL);
    struct dirent *entry;
    char folder[PATH_MAX];
    DIR *dir;

    if (length >= sizeof(folder))
        return;
    memcpy(folder, path, length);
    folder[length] = '\0';
    dir = opendir(length ? folder : ".");
    for (int i = 0; dir && i < STALE_MAX_ENTRIES && (entry = readdir(dir)); i++) {
        const pid_t process = process_of(entry->d_name);
        struct stat st;
        if (process > 1 && fstatat(dirfd(dir), entry->d_name, &st, AT_SYMLINK_NOFOLLOW) == 0 && S_ISREG(st.st_mode) &&
            st.st_uid == geteuid() && now - st.st_mtime > STALE_SECONDS && kill(process, 0) != 0 && errno == ESRCH)
            unlinkat(dirfd(dir), entry->d_name, 0);
    }
    if (dir)
        closedir(dir);
}

/* Replaces the regular file `path`, or creates it. `old` describes the existing file, or is NULL. */
static enum pell_result replace_file(struct pell_context *ctx, const char *path, const struct stat *old, const void *data, size_t size)
{
    char *temporary = pell_alloc(ctx, strlen(path) + 64);
    enum pell_result res = PELL_OK;
    int fd, code = 0;

    if (!temporary)
        return PELL_ERR_NOMEM;
    if (atomic_fetch_add(&ctx->writes, 1) < STALE_WRITES)
        remove_stale(path);
    pell_file_in_flight(ctx, +1);
    fd = open_temporary(path, temporary);
    if (fd < 0) {
        res = failed(ctx, path, "can't be written in its folder", errno);
        pell_file_in_flight(ctx, -1);
        pell_free(ctx, temporary);
        return res;
    }
    if (old && fchmod(fd, old->st_mode & 0777) != 0)
        code = errno;
    /* Sync to disk: then a power failure after the rename leaves the complete file. */
    if (!code)
        code = write_all(ctx, fd, data, size, true);
    if (close(fd) != 0 && !code && errno != EINTR)
        code = errno;
    if (!code && rename(temporary, path) != 0)
        code = errno;
    if (code) {
        unlink(temporary);
        res = write_failed(ctx, path, code);
    }
    pell_file_in_flight(ctx, -1);
    pell_free(ctx, temporary);
    return res;
}

/* A device or a pipe is written to, not replaced. */
static enum pell_result write_special(struct pell_context *ctx, const char *path, const void *data, size_t size)
{
    int fd, code;

    do
        fd = open(path, O_WRONLY | O_CLOEXEC | O_NOCTTY);
    while (fd < 0 && errno == EINTR && !pell_cancelled(ctx));
    if (fd < 0)
        return errno == EINTR ? PELL_ERR_CANCELLED : failed(ctx, path, "can't be opened for writing", errno);
    code = write_all(ctx, fd, data, size, false);
    if (close(fd) != 0 && !code && errno != EINTR)
        code = errno;
    return code ? write_failed(ctx, path, code) : PELL_OK;
}

enum pell_result pell_file_write(struct pell_context *ctx, const char *path, const void *data, size_t size)
{
    char real[PATH_MAX];
    struct stat st, link;

    if (strcmp(path, "-") == 0) {
        const int code = write_all(ctx, STDOUT_FILENO, data, size, false);
        return code ? write_failed(ctx, "standard output", code) : PELL_OK;
    }
    if (!*pell_path_name(path))
        return pell_error(ctx, PELL_ERR_IO, path, NULL, *path ? "names a folder, must name a file" : "an empty path names no file");
    if (lstat(path, &link) != 0)
        return errno == ENOENT ? replace_file(ctx, path, NULL, data, size) : failed(ctx, path, "can't be written", errno);
    if (stat(path, &st) != 0)
        return failed(ctx, path, "is a link whose end can't be written", errno);
    if (S_ISDIR(st.st_mode))
        return failed(ctx, path, "can't be written", EISDIR);
    if (!S_ISREG(st.st_mode))
        return write_special(ctx, path, data, size);
    /* A rename would replace even a file that its owner has made read-only. */
    if (access(path, W_OK) != 0)
        return failed(ctx, path, "can't be written", errno);
    /* Replace the target of a symbolic link, not the link. */
    if (S_ISLNK(link.st_mode)) {
        if (!realpath(path, real))
            return failed(ctx, path, "can't be written", errno);
        path = real;
    }
    return replace_file(ctx, path, &st, data, size);
}

/* Depth of a relative path's end below its start; -1 if the path leaves the start by '..' at any point. */
static int path_depth(const char *path)
{
    int depth = 0;

    while (*path) {
        const size_t n = strcspn(path, "/");
        if (n == 2 && path[0] == '.' && path[1] == '.') {
            if (--depth < 0)
                return -1;
        } else if (n && !(n == 1 && path[0] == '.')) {
            depth++;
        }
        path += n;
        path += strspn(path, "/");
    }
    return depth;
}

static bool is_within(const char *path, const char *root)
{
    size_t n = strlen(root);

    while (n && root[n - 1] == '/')
        n--;
    return strncmp(path, root, n) == 0 && (path[n] == '/' || path[n] == '\0');
}

enum pell_result pell_path_resolve(struct pell_context *ctx, const char *where, const char *root, const char *reference, bool allow_outside,
                                   char **path)
{
    static const char *const move = "move the file into the scene's folder, or allow files elsewhere: --allow-outside";
    char real_root[PATH_MAX], real_path[PATH_MAX], shown[SHOWN];
    const bool absolute = reference[0] == '/';
    size_t root_length, size;
    struct stat st;

    *path = NULL;
    if (!*root)
        root = ".";
    pell_printable(reference, shown, sizeof(shown));
    if (!*reference)
        return pell_error(ctx, PELL_ERR_INVALID, where, NULL, "an empty path names no file");
    if (absolute && !allow_outside)
        return pell_error(ctx, PELL_ERR_INVALID, where, move, "\"%s\" is an absolute path, must be relative to the file that names it",
                          shown);
    if (!allow_outside && path_depth(reference) < 0)
        return pell_error(ctx, PELL_ERR_INVALID, where, move, "\"%s\" leads out of the scene's folder", shown);

    root_length = absolute ? 0 : strlen(root);
    if (__builtin_add_overflow(root_length + 2, strlen(reference), &size))
        return pell_error(ctx, PELL_ERR_INVALID, where, NULL, "\"%s\" is too long", shown);
    *path = pell_alloc(ctx, size);
    if (!*path)
        return PELL_ERR_NOMEM;
    if (absolute)
        memcpy(*path, reference, strlen(reference) + 1);
    else if (strcmp(root, ".") == 0)
        memcpy(*path, reference, strlen(reference) + 1);
    else
        snprintf(*path, size, "%s%s%s", root, root[root_length - 1] == '/' ? "" : "/", reference);

    if (!realpath(*path, real_path)) {
        const int code = errno;
        pell_free(ctx, *path);
        *path = NULL;
        return pell_error(ctx, PELL_ERR_IO, where, NULL, "\"%s\" can't be found: %s", shown, reason(code));
    }
    if (!allow_outside && (!realpath(root, real_root) || !is_within(real_path, real_root))) {
        pell_free(ctx, *path);
        *path = NULL;
        return pell_error(ctx, PELL_ERR_INVALID, where, move, "\"%s\" leads out of the scene's folder through a link", shown);
    }
    if (stat(real_path, &st) == 0 && !S_ISREG(st.st_mode)) {
        pell_free(ctx, *path);
        *path = NULL;
        return pell_error(ctx, PELL_ERR_IO, where, NULL, "\"%s\" is %s, must be a regular file", shown, kind(st.st_mode));
    }
    return PELL_OK;
}

enum pell_result pell_path_relative(struct pell_context *ctx, const char *where, const char *root, const char *path, bool *below,
                                    char **out)
{
    char real_root[PATH_MAX], real_path[PATH_MAX], shown[SHOWN];
    size_t n;

    *out = NULL;
    if (!realpath(*root ? root : ".", real_root) || !realpath(path, real_path))
        return pell_error(ctx, PELL_ERR_IO, where, NULL, "\"%s\" can't be found: %s", pell_printable(path, shown, sizeof(shown)),
                          reason(errno));
    *below = is_within(real_path, real_root);
    n = *below ? strlen(real_root) : 0;
    while (n && real_path[n] == '/')
        n++;
    *out = pell_strdup(ctx, real_path + n);
    return *out ? PELL_OK : PELL_ERR_NOMEM;
}

char *pell_path_folder(struct pell_context *ctx, const char *path)
{
    size_t n = (size_t) (pell_path_name(path) - path);

    if (n == 0)
        return pell_strdup(ctx, ".");
    while (n > 1 && path[n - 1] == '/')
        n--;
    return pell_strndup(ctx, path, n);
}

const char *pell_path_name(const char *path)
{
    const char *slash = strrchr(path, '/');
    return slash ? slash + 1 : path;
}

bool pell_path_has_extension(const char *path, const char *extension)
{
    const char *name = pell_path_name(path), *dot = strrchr(name, '.');

    if (!dot || dot == name)
        return false;
    for (dot++; *dot && *extension; dot++, extension++)
        if (pell_lower(*dot) != pell_lower(*extension))
            return false;
    return !*dot && !*extension;
}
