/* SPDX-License-Identifier: MIT
 *
 * scalar.h - the larger and the smaller of two numbers, as one instruction: fmaxf and fminf are calls, since they mind NaN. Where one is no
 * number both give the second. LARGER and SMALLER take any type and evaluate what they give twice.
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

#endif
