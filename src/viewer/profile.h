/* SPDX-License-Identifier: MIT
 *
 * profile.h - the profile bench.
 */
#ifndef PELL_VIEWER_PROFILE_H
#define PELL_VIEWER_PROFILE_H

#include "viewer/message.h"

/* R(r) of a message's coefficients by every model, as JSON; NULL without memory, or, logged, for coefficients that are no medium. */
json_t *viewer_profile(struct pell_context *ctx, const struct viewer_message *message);

#endif
