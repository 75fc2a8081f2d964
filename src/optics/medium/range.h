/* SPDX-License-Identifier: MIT
 *
 * range.h - one number and its range, for the _valid functions.
 *
 * Threads    pure and safe.
 */
#ifndef PELL_OPTICS_RANGE_H
#define PELL_OPTICS_RANGE_H

#include <pellucid/medium.h>

/* False, with the fault (may be NULL) filled in, unless min <= value <= max; NaN is always out of range. */
static inline bool pell_in_range(const char *field, double value, double min, double max, struct pell_medium_fault *fault)
{
    if (value >= min && value <= max)
        return true;
    if (fault)
        *fault = (struct pell_medium_fault) { field, value, min, max };
    return false;
}

#endif
