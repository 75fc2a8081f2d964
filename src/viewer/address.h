/* SPDX-License-Identifier: MIT
 *
 * address.h - access control of the viewer: host names, origins, the token.
 */
#ifndef PELL_VIEWER_ADDRESS_H
#define PELL_VIEWER_ADDRESS_H

#include "base/base.h"

#include <stdbool.h>
#include <stddef.h>

#define VIEWER_TOKEN 32 /* hexadecimal digits */

/* Makes a random token; false if the system gives no random bytes. */
bool viewer_token_make(char token[VIEWER_TOKEN + 1]);
/* Reads the token from a file; if the file does not exist, makes a new token and writes it, readable by the owner only. */
PELL_NODISCARD enum pell_result viewer_token_keep(struct pell_context *ctx, const char *path, char token[VIEWER_TOKEN + 1]);
/* Constant-time comparison. */
bool viewer_token_equal(const char *token, const char *given);

/* Whether a request's Host names this machine: loopback, or the listening address, or, when listening on all addresses, any numeric
 * address. Other names are refused, as others may point them here. The port may differ, as in a tunnel. */
bool viewer_host_allowed(const char *host, const char *listening);
/* Whether a page of `origin` may connect: only the one that this Host served. "": a program, not a page. */
bool viewer_origin_allowed(const char *origin, const char *host);

/* Checks that the server can listen there: 0, or errno. *port 0 is replaced by a free one. */
int viewer_probe(const char *address, int *port);
bool viewer_is_loopback(const char *address);

#endif
