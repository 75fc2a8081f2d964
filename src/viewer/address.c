/* SPDX-License-Identifier: MIT
 * address.c - who may talk to the viewer. */
#include "viewer/address.h"

#include <arpa/inet.h>
#include <errno.h>
#include <netinet/in.h>
#include <stdio.h>
#include <string.h>
#include <strings.h>
#include <sys/random.h>
#include <sys/socket.h>
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

bool viewer_token_equal(const char *token, const char *given)
{
    const size_t length = strlen(given);
    unsigned differ = length != VIEWER_TOKEN;

    for (size_t i = 0; i < VIEWER_TOKEN; i++)
        differ |= (unsigned char) (token[i] ^ (i < length ? given[i] : '\0'));
    return differ == 0;
}

/* "[::1]:80" -> "::1"; false: it is too long, or no host. */
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
