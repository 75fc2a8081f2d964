/* SPDX-License-Identifier: MIT
 *
 * sampling.h - quasi-random numbers, and uniform points of discs and triangles. Pure. The bits are the same at all levels of base/simd.h:
 * integers, and floats of at most 24 digits.
 */
#ifndef PELL_MATH_SAMPLING_H
#define PELL_MATH_SAMPLING_H

#include "base/hash.h"
#include "math/vec.h"
#include "shared/sampling.h"

/* --- 32-bit random numbers; those that shaders need are in shared/sampling.h -------------------------------------------------------- */

static inline double pell_unit_double(uint32_t x)
{
    return (double) x * (1.0 / 4294967296.0);
}

/* Owen's scrambling of the digits of x, most significant first, by hashing (Laine and Karras 2011, "Stratified Sampling for Stochastic
 * Transparency"; Burley 2020, "Practical Hash-based Owen Scrambling", JCGT 9(4); constants: Vegdahl 2021, "Building a Better LK Hash").
 * Scrambling by one XOR per pixel, which is cheaper, is Kollig and Keller's (2002, "Efficient Multidimensional Sampling"). */
static inline uint32_t pell_owen_scramble(uint32_t x, uint32_t seed)
{
    x = pell_sobol0(x);
    x ^= x * 0x3d20adeau;
    x += seed;
    x *= (seed >> 16) | 1u;
    x ^= x * 0x05526c56u;
    x ^= x * 0x53a22864u;
    return pell_sobol0(x);
}

/* Point `index` of a rank-1 lattice in dimension `d`, [0, 1): multiples of the powers of 1/1.2207440846 (the root of x^4 = x + 1: Roberts
 * 2018, "The Unreasonable Effectiveness of Quasirandom Sequences"), shifted at random by the seed (Cranley and Patterson 1976). */
static inline double pell_lattice(uint32_t seed, uint32_t d, uint32_t index)
{
    static const uint32_t step[3] = { 3518319155u, 2882110345u, 2360945575u };
    return pell_unit_double(pell_hash(seed + 0x9e3779b9u * (d + 1)) + index * step[d % 3]);
}

/* --- The golden section ----------------------------------------------------------------------------------------------------------- */

#define PELL_GOLDEN_SECTION 0.6180339887498949 /* (sqrt(5) - 1)/2, the number worst approximated by fractions */
#define PELL_GOLDEN_TURN 0.3819660112501051    /* one minus the golden section: the golden angle in turns */

/* Position of sample i of n in a pixel, [-1/2, 1/2]: one sample in each of n columns and n rows, the rows in the order of the golden
 * section's multiples (4 are the rotated grid). Their mean is the centre, so the image does not shift with their number. */
static inline void pell_golden_grid(int i, int n, float *x, float *y)
{
    const double golden = PELL_GOLDEN_SECTION, here = golden * (i + 1) - floor(golden * (i + 1));
    int rank = 0;

    for (int k = 1; k <= n; k++)
        rank += golden * k - floor(golden * k) < here;
    *x = ((float) i + 0.5f) / (float) n - 0.5f;
    *y = ((float) rank + 0.5f) / (float) n - 0.5f;
}

/* Point i of n in the unit disc: a sunflower pattern (Vogel 1979, "A Better Way to Construct the Sunflower Head"), relative to its mean.
 * The mean square of their radii is that of the disc, 1/2, less that of its n-th part. */
static inline void pell_sunflower_point(int i, int n, double point[2])
{
    const double golden = PELL_PI * (3.0 - sqrt(5.0));
    double mean[2] = { 0.0, 0.0 }, square = 0.0, scale;

    for (int k = 0; k < n; k++) {
        const double r = sqrt((k + 0.5) / n);
        mean[0] += r * cos(golden * k) / n;
        mean[1] += r * sin(golden * k) / n;
        square += r * r / n;
    }
    square -= mean[0] * mean[0] + mean[1] * mean[1];
    scale = sqrt(0.5 * (1.0 - 1.0 / n) / square);
    point[0] = scale * (sqrt((i + 0.5) / n) * cos(golden * i) - mean[0]);
    point[1] = scale * (sqrt((i + 0.5) / n) * sin(golden * i) - mean[1]);
}

/* --- From the unit square --------------------------------------------------------------------------------------------------------- */

/* pell_disc_at, by pointers. */
static inline void pell_disc_point(float u, float v, float *x, float *y)
{
    const struct pell_point2 p = pell_disc_at(u, v);

    *x = p.x;
    *y = p.y;
}

/* Uniform points of a triangle (Turk 1990, "Generating Random Points in Triangles"): u = barycentric of the second corner, v of the
 * third. */
static inline void pell_triangle_point(float f, float g, float *u, float *v)
{
    const float s = sqrtf(f);
    *u = s * (1.0f - g);
    *v = s * g;
}

#endif
