/* SPDX-License-Identifier: MIT
 *
 * address.h - who may talk to the viewer: names of hosts, origins, the token.
 */
#ifndef PELL_VIEWER_ADDRESS_H
#define PELL_VIEWER_ADDRESS_H

#include "base/base.h"

#include <stdbool.h>
#include <stddef.h>

#define VIEWER_TOKEN 32 /* hexadecimal digits */

/* Random; false where the system gives no random bytes. */
bool viewer_token_make(char token[VIEWER_TOKEN + 1]);
/* The token that a file keeps; where there is no file, a new token and a file of it, which its owner alone may read. */
PELL_NODISCARD enum pell_result viewer_token_keep(struct pell_context *ctx, const char *path, char token[VIEWER_TOKEN + 1]);
/* In a time that does not depend on where they differ. */
bool viewer_token_equal(const char *token, const char *given);

/* Whether a request's Host names this machine: loopback, or the address that is listened at, or, where that is all of them, an address in
 * numbers. Names that others may point here are refused. The port may be another one: of a tunnel. */
bool viewer_host_allowed(const char *host, const char *listening);
/* Whether a page of `origin` may connect: the one that this Host served. None ("") is a program, not a page. */
bool viewer_origin_allowed(const char *origin, const char *host);

/* Whether something can listen there: 0, or errno. *port 0 becomes one that is free. */
int viewer_probe(const char *address, int *port);
bool viewer_is_loopback(const char *address);

#endif
