/* SPDX-License-Identifier: MIT
 *
 * sampling.h - quasi-random numbers, and uniform points of discs. The bits are the same everywhere: integers, and floats of at most 24
 * digits.
 */
#ifndef PELL_SHARED_SAMPLING_H
#define PELL_SHARED_SAMPLING_H

#include "shared/hash.h"
#include "shared/language.h"

struct pell_point2 {
    float x, y;
};

/* Maps 32 bits to [0, 1). */
PELL_SHARED float pell_unit_float(uint32_t x)
{
    return PELL_TO_FLOAT(PELL_TO_INT(x >> 8)) * (1.0f / 16777216.0f);
}

/* Bit reversal: van der Corput's radical inverse in base 2, which is the first dimension of Sobol's sequence (Sobol 1967, "On the
 * Distribution of Points in a Cube and the Approximate Evaluation of Integrals"). */
PELL_SHARED uint32_t pell_sobol0(uint32_t i)
{
    i = i << 16 | i >> 16;
    i = (i & 0x00ff00ffu) << 8 | (i & 0xff00ff00u) >> 8;
    i = (i & 0x0f0f0f0fu) << 4 | (i & 0xf0f0f0f0u) >> 4;
    i = (i & 0x33333333u) << 2 | (i & 0xccccccccu) >> 2;
    return (i & 0x55555555u) << 1 | (i & 0xaaaaaaaau) >> 1;
}

/* The second dimension: its matrix is Pascal's triangle modulo 2, five butterflies. */
PELL_SHARED uint32_t pell_sobol1(uint32_t i)
{
    uint32_t y = pell_sobol0(i);

    y ^= (y & 0x55555555u) << 1;
    y ^= (y & 0x33333333u) << 2;
    y ^= (y & 0x0f0f0f0fu) << 4;
    y ^= (y & 0x00ff00ffu) << 8;
    return y ^ y << 16;
}

/* Uniform points of the unit disc (Shirley and Chiu 1997, "A Low Distortion Map Between Disk and Square"), without library calls:
 * |phi| <= pi/4. With z = sqrt(1 - x^2 - y^2) they are directions of a hemisphere with the density z/pi (Malley). */
PELL_SHARED PELL_STRUCT(pell_point2) pell_disc_at(float u, float v)
{
    const float a = 2.0f * u - 1.0f, b = 2.0f * v - 1.0f;
    const float aa = fabsf(a), ab = fabsf(b), big = aa > ab ? a : b, small = aa > ab ? b : a;
    const float t = 0.785398163f * small / (fabsf(big) > 1e-20f ? big : 1e-20f), t2 = t * t;
    const float s = t * (1.0f + t2 * (-1.66666667e-1f + t2 * (8.33333333e-3f + t2 * (-1.98412698e-4f + t2 * 2.75573192e-6f))));
    const float c = 1.0f + t2 * (-0.5f + t2 * (4.16666667e-2f + t2 * (-1.38888889e-3f + t2 * 2.48015873e-5f)));
    PELL_STRUCT(pell_point2) p;

    p.x = big * (aa > ab ? c : s);
    p.y = big * (aa > ab ? s : c);
    return p;
}

/* Index of pixel (x, y) of a block of 32 x 32 on a hierarchical Z curve (Morton 1966), with the order of each quadrant chosen by hash:
 * below 1024. Pixels that take consecutive runs of a (0, 2)-sequence along the curve stratify the square with their neighbours at every
 * scale, so that their remaining error has high frequencies (Ahmed and Wonka 2020, "Screen-Space Blue-Noise Diffusion of Monte Carlo
 * Sampling Error via Hierarchical Ordering of Pixels"). */
#define PELL_CURVE_LEVELS 5
PELL_SHARED uint32_t pell_pixel_curve(uint32_t x, uint32_t y, uint32_t seed)
{
    uint32_t index = 0u;

    for (int32_t level = PELL_CURVE_LEVELS - 1; level >= 0; level--) {
        const uint32_t right = x >> level & 1u, down = y >> level & 1u;
        const uint32_t hash = pell_hash(x >> (level + 1) ^ pell_hash(y >> (level + 1) ^ (seed + PELL_TO_UINT(level))));
        /* all 24 orders: digit -> A digit + b over two bits, A of two different columns */
        const uint32_t third = (hash >> 8) % 3u, other = third + 1u + (hash >> 2 & 1u);
        const uint32_t a = 1u + third, b = 1u + other - (other > 2u ? 3u : 0u);
        index = index << 2 | ((hash & 3u) ^ (a & (0u - right)) ^ (b & (0u - down)));
    }
    return index;
}

#endif
