/* SPDX-License-Identifier: MIT
 * address.c - access control of the viewer. */
#include "viewer/address.h"

#include <arpa/inet.h>
#include <errno.h>
#include <fcntl.h>
#include <netinet/in.h>
#include <stdio.h>
#include <string.h>
#include <strings.h>
#include <sys/random.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <unistd.h>

bool viewer_token_make(char token[VIEWER_TOKEN + 1])
{
    unsigned char bytes[VIEWER_TOKEN / 2];

    if (getrandom(bytes, sizeof(bytes), 0) != (ssize_t) sizeof(bytes))
        return false;
    for (size_t i = 0; i < sizeof(bytes); i++)
        snprintf(token + 2 * i, 3, "%02x", bytes[i]);
    return true;
}

/* Writes the whole token, or leaves no file. Returns 0, or errno. */
static int write_token(const char *path, const char *token)
{
    char line[VIEWER_TOKEN + 2];
    const int fd = open(path, O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0600);
    int error = 0;

    if (fd < 0)
        return errno;
    snprintf(line, sizeof(line), "%s\n", token);
    if (write(fd, line, VIEWER_TOKEN + 1) != VIEWER_TOKEN + 1)
        error = errno ? errno : ENOSPC;
    if (close(fd) != 0 && !error)
        error = errno;
    if (error)
        unlink(path);
    return error;
}

enum pell_result viewer_token_keep(struct pell_context *ctx, const char *path, char token[VIEWER_TOKEN + 1])
{
    char line[VIEWER_TOKEN + 3] = "";
    struct stat about = { 0 };
    const int fd = open(path, O_RDONLY | O_CLOEXEC | O_NONBLOCK);
    const int missing = fd < 0 ? errno : 0;
    ssize_t size;
    int error;

    if (fd >= 0) {
        if (fstat(fd, &about) == 0 && (about.st_mode & (S_IRWXG | S_IRWXO)))
            pell_warn(ctx, path, "chmod 600 makes it private; a new token, if the file is removed, shuts out those who have read it",
                      "other users of this machine may read the token: its permissions are %04o", (unsigned) about.st_mode & 07777u);
        size = read(fd, line, sizeof(line) - 1);
        close(fd);
        if (size > 0 && line[size - 1] == '\n')
            line[--size] = '\0';
        if (size != VIEWER_TOKEN || strspn(line, "0123456789abcdef") != VIEWER_TOKEN)
            return pell_error(ctx, PELL_ERR_FORMAT, path, "remove it to create a new one", "is no token: must be %d digits of 0-9 and a-f",
                              VIEWER_TOKEN);
        memcpy(token, line, VIEWER_TOKEN + 1);
        return PELL_OK;
    }
    if (missing != ENOENT)
        return pell_error(ctx, PELL_ERR_IO, path, NULL, "can't be read: %s", strerror(missing));
    if (!viewer_token_make(token))
        return pell_error(ctx, PELL_ERR_IO, path, NULL, "the system gives no random bytes for a token");
    if ((error = write_token(path, token)) != 0)
        return pell_error(ctx, PELL_ERR_IO, path, NULL, "can't be written: %s", strerror(error));
    return PELL_OK;
}

bool viewer_token_equal(const char *token, const char *given)
{
    const size_t length = strlen(given);
    unsigned differ = length != VIEWER_TOKEN;

    for (size_t i = 0; i < VIEWER_TOKEN; i++)
        differ |= (unsigned char) (token[i] ^ (i < length ? given[i] : '\0'));
    return differ == 0;
}

/* "[::1]:80" -> "::1"; false if it is too long, or no host. */
static bool host_name(const char *host, char *name, size_t size)
{
    const char *end = host[0] == '[' ? strchr(host, ']') : host + strcspn(host, ":");
    const size_t skip = host[0] == '[';
    size_t length;

    if (!end)
        return false;
    length = (size_t) (end - host) - skip;
    end += skip;
    if (length == 0 || length >= size || (*end && *end != ':') || strspn(end + (*end == ':'), "0123456789") != strlen(end + (*end == ':')))
        return false;
    memcpy(name, host + skip, length);
    name[length] = '\0';
    return true;
}

bool viewer_is_loopback(const char *address)
{
    return strcasecmp(address, "localhost") == 0 || strncmp(address, "127.", 4) == 0 || strcmp(address, "::1") == 0;
}

static bool numeric(const char *name)
{
    unsigned char bytes[16];
    return inet_pton(AF_INET, name, bytes) == 1 || inet_pton(AF_INET6, name, bytes) == 1;
}

bool viewer_host_allowed(const char *host, const char *listening)
{
    char name[128];

    if (!host_name(host, name, sizeof(name)))
        return false;
    if (strcasecmp(name, "localhost") == 0 || (viewer_is_loopback(name) && numeric(name)) || strcasecmp(name, listening) == 0)
        return true;
    return strcmp(listening, "0.0.0.0") == 0 && numeric(name);
}

bool viewer_origin_allowed(const char *origin, const char *host)
{
    return origin[0] == '\0' || (strncmp(origin, "http://", 7) == 0 && strcasecmp(origin + 7, host) == 0);
}

int viewer_probe(const char *address, int *port)
{
    struct sockaddr_in at = { .sin_family = AF_INET, .sin_port = htons((uint16_t) *port) };
    socklen_t size = sizeof(at);
    int one = 1, error = 0, s;

    if (inet_pton(AF_INET, address, &at.sin_addr) != 1)
        return EINVAL;
    s = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
    if (s < 0)
        return errno;
    setsockopt(s, SOL_SOCKET, SO_REUSEADDR, &one, sizeof(one));
    if (bind(s, (const struct sockaddr *) &at, sizeof(at)) != 0 || listen(s, 1) != 0 || getsockname(s, (struct sockaddr *) &at, &size) != 0)
        error = errno;
    else
        *port = ntohs(at.sin_port);
    close(s);
    return error;
}
