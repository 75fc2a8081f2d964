/* SPDX-License-Identifier: MIT
 *
 * special.h - special functions that the C library lacks.
 *
 * Threads    pure and safe.
 */
#ifndef PELL_SPECIAL_H
#define PELL_SPECIAL_H

#include "math/vec.h"

#include <math.h>

/* exp(x^2) erfc(x) for x >= 0, relative error below 1e-12: the asymptotic series is used where erfc underflows or exp overflows. */
static inline double pell_erfcx(double x)
{
    if (x < 25.0)
        return exp(x * x) * erfc(x);
    const double t = 0.5 / (x * x);
    return (1.0 - t * (1.0 - 3.0 * t * (1.0 - 5.0 * t * (1.0 - 7.0 * t * (1.0 - 9.0 * t))))) / (x * sqrt(PELL_PI));
}

#endif
