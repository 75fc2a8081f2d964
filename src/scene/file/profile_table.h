/* SPDX-License-Identifier: MIT
 *
 * profile_table.h - a user's radial profile from a text of comma-separated values.
 */
#ifndef PELL_PROFILE_TABLE_H
#define PELL_PROFILE_TABLE_H

#include "base/base.h"

#include <pellucid/context.h>
#include <pellucid/profile.h>

/* Reads rows `r_mm,R,G,B` (mm, 1/mm^2; or columns in the order of a first line of names) into profiles of the three channels; `path` is for
 * messages. PELL_ERR_FORMAT, logged with the line, for anything else, for radii that do not rise and for a total above 1. */
PELL_NODISCARD enum pell_result pell_profile_table_read(struct pell_context *ctx, const char *path, const uint8_t *data, size_t size,
                                                        struct pell_profile out[3]);

#endif
