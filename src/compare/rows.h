/* SPDX-License-Identifier: MIT
 *
 * rows.h - pell_compare of images that are read while they are compared.
 */
#ifndef PELL_COMPARE_ROWS_H
#define PELL_COMPARE_ROWS_H

#include "base/base.h"

#include <pellucid/compare.h>

/* Bands of rows, each as high as memory for some million pixels allows. They are requested from top to bottom, each overlapping the
 * previous one by the radius of the filters, in several passes. */
struct pell_compare_rows {
    /* Makes rows `first` to `first + count - 1` available: sets the planes of `in` and their stride so that they begin with row `first`. */
    enum pell_result (*move)(void *user, int first, int count, struct pell_compare_input *in);
    void *user;
};

/* Rows of a band, and the most rows added above and below. */
int pell_compare_band(int width);
#define PELL_COMPARE_REACH 64

/* As pell_compare, with identical results. Non-NULL pointers of `input` select planes; `rows` provides their data. */
PELL_NODISCARD enum pell_result pell_compare_by_rows(struct pell_context *ctx, const struct pell_compare_input *input,
                                                     const struct pell_compare_rows *rows, const struct pell_compare_params *params,
                                                     struct pell_comparison *out);

#endif
