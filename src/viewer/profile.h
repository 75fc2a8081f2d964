/* SPDX-License-Identifier: MIT
 *
 * profile.h - the profile bench.
 */
#ifndef PELL_VIEWER_PROFILE_H
#define PELL_VIEWER_PROFILE_H

#include "viewer/message.h"

/* R(r) of a message's coefficients by every model, as JSON; NULL if out of memory, or, logged, for invalid coefficients. */
json_t *viewer_profile(struct pell_context *ctx, const struct viewer_message *message);
/* Their fit, kernel and table as code in message->export ("c", "glsl", "hlsl", "json"), as `pellucid profile --export` writes it: a file
 * allocated by malloc. Errors are logged. */
PELL_NODISCARD enum pell_result viewer_profile_code(struct pell_context *ctx, const struct viewer_message *message, uint8_t **file,
                                                    size_t *size);

#endif
