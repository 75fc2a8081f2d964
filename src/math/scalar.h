/* SPDX-License-Identifier: MIT
 *
 * scalar.h - ramps; and the larger and the smaller of two numbers, as one instruction: fmaxf and fminf are function calls, since they
 * handle NaN. If one is NaN both return the second. LARGER and SMALLER take any type and evaluate their result twice.
 */
#ifndef PELL_SCALAR_H
#define PELL_SCALAR_H

#define LARGER(a, b) ((a) > (b) ? (a) : (b))
#define SMALLER(a, b) ((a) < (b) ? (a) : (b))

static inline float larger(float a, float b)
{
    return LARGER(a, b);
}

static inline float smaller(float a, float b)
{
    return SMALLER(a, b);
}

/* Ramps from 0 at `low` to 1 at `high`, clamped: linear, and smooth at both ends. */
static inline float ramp(float low, float high, float x)
{
    return smaller(larger((x - low) / (high - low), 0.0f), 1.0f);
}

static inline float smooth_ramp(float low, float high, float x)
{
    const float t = ramp(low, high, x);

    return t * t * (3.0f - 2.0f * t);
}

#endif
