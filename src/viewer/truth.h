/* SPDX-License-Identifier: MIT
 *
 * truth.h - an accumulating reference of a view, and the errors of the page's images against it.
 *
 * An interruptible reference (path-trace) is rendered repeatedly with different seeds; the images give the mean and its standard error.
 * Others are rendered once.
 */
#ifndef PELL_VIEWER_TRUTH_H
#define PELL_VIEWER_TRUTH_H

#include "viewer/model.h"
#include "viewer/viewer.h"

struct viewer_truth;

/* `view` must outlive it. */
PELL_NODISCARD enum pell_result viewer_truth_create(struct viewer *v, uint64_t page, const struct viewer_message *view,
                                                    struct viewer_truth **out);
void viewer_truth_destroy(struct viewer_truth **truth);
/* Renders one more image, and from time to time sends results to the page. The model must show the view. */
PELL_NODISCARD enum pell_result viewer_truth_step(struct viewer_truth *t, struct viewer_model *m);
/* Whether there are metrics; `t` may be NULL. */
bool viewer_truth_compared(const struct viewer_truth *t);
/* The current results as the page that `pellucid compare -o` writes: a file allocated by malloc. Errors are logged. */
PELL_NODISCARD enum pell_result viewer_truth_report(struct viewer_truth *t, struct viewer_model *m, uint8_t **file, size_t *size);
bool viewer_truth_done(const struct viewer_truth *t);

#endif
