/* SPDX-License-Identifier: MIT
 *
 * compare.h - pell_compare on a pool that the caller has.
 */
#ifndef PELL_COMPARE_COMPARE_H
#define PELL_COMPARE_COMPARE_H

#include "base/pool.h"

#include <pellucid/compare.h>

/* `params->threads` is not looked at. */
PELL_NODISCARD enum pell_result pell_compare_run(struct pell_context *ctx, struct pell_pool *pool, const struct pell_compare_input *input,
                                                 const struct pell_compare_params *params, struct pell_comparison *out);

#endif
