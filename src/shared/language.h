/* SPDX-License-Identifier: MIT
 *
 * language.h - the common subset of C11 and GLSL 4.60 (Vulkan 1.3) in which the headers of src/shared are written.
 *
 * Rules    No pointers, array arguments, casts, doubles or loops over tables: the caller of a table fetches the entries, and a function
 *          here returns which entries and how they are weighted. C functions keep their C names (sqrtf). Words reserved in GLSL (half,
 *          smooth, sample, shared, flat, filter, input, output, in, out, buffer) are not used as names.
 * Vectors  In C the functions are made for loops over floats, which the compiler vectorizes: they select and never branch. Formulas
 *          that kernels also evaluate on explicit vectors (math/lanes.h) are macros, which take any arithmetic type.
 *          A value whose products must not be contracted is PELL_PRECISE: in C nothing is (-ffp-contract=off).
 * Bits     C gives the same bits at all levels of base/simd.h. GLSL rounds as Vulkan allows (division and root within 2.5 ulp).
 */
#ifndef PELL_SHARED_LANGUAGE_H
#define PELL_SHARED_LANGUAGE_H

#define PELL_PI_F 3.14159265f

#ifdef __STDC_VERSION__ /* C */

#include <math.h>
#include <stdint.h>
#include <string.h>

#define PELL_SHARED static inline
#define PELL_STRUCT(name) struct name
#define PELL_PRECISE
#define PELL_TO_INT(x) ((int32_t) (x))
#define PELL_TO_FLOAT(i) ((float) (i))
#define PELL_TO_UINT(i) ((uint32_t) (i))

/* A member of 16 bytes. */
struct pell_vec4 {
    float x, y, z, w;
};
#define PELL_VEC4 struct pell_vec4

PELL_SHARED int32_t pell_float_bits(float x)
{
    int32_t i;
    memcpy(&i, &x, sizeof(i));
    return i;
}

PELL_SHARED float pell_bits_float(int32_t i)
{
    float x;
    memcpy(&x, &i, sizeof(x));
    return x;
}

#else /* GLSL */

#define PELL_SHARED
#define PELL_STRUCT(name) name
#define PELL_PRECISE precise
#define PELL_TO_INT(x) int(x)
#define PELL_TO_FLOAT(i) float(i)
#define PELL_TO_UINT(i) uint(i)
#define PELL_VEC4 vec4

#define int32_t int
#define uint32_t uint
#define sqrtf(x) sqrt(x)
#define fabsf(x) abs(x)
#define fminf(x, y) min(x, y)
#define fmaxf(x, y) max(x, y)
#define powf(x, y) pow(x, y)
#define pell_float_bits(x) floatBitsToInt(x)
#define pell_bits_float(i) intBitsToFloat(i)

#endif

/* x in [0, 1]; NaN becomes 0. */
PELL_SHARED float pell_saturate(float x)
{
    return x > 0.0f ? x < 1.0f ? x : 1.0f : 0.0f;
}

#endif
