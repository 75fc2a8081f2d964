/* SPDX-License-Identifier: MIT
 *
 * truth.h - a reference of a view that accumulates, and the errors of what the page looks at against it.
 *
 * A reference that can be cut short (path-trace) is drawn again and again with other seeds; the mean and its standard error follow from the
 * pictures. Others are drawn once.
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
/* Draws one more picture, and from time to time sends what is known to the page. The model shows the view. */
PELL_NODISCARD enum pell_result viewer_truth_step(struct viewer_truth *t, struct viewer_model *m);
/* Whether there are numbers; `t` may be NULL. */
bool viewer_truth_compared(const struct viewer_truth *t);
/* What is known by now as the page that `pellucid compare -o` writes: a file of malloc. What is wrong is logged. */
PELL_NODISCARD enum pell_result viewer_truth_report(struct viewer_truth *t, struct viewer_model *m, uint8_t **file, size_t *size);
bool viewer_truth_done(const struct viewer_truth *t);

#endif
