/* SPDX-License-Identifier: MIT
 *
 * sky_kernel.h - private to src/render/irradiance: rays that look for the sky from 16 points, built once per SIMD level (sky_kernel.c).
 */
#ifndef PELL_IRRADIANCE_SKY_KERNEL_H
#define PELL_IRRADIANCE_SKY_KERNEL_H

#include "render/irradiance/kernel.h"

/* Cosine-distributed rays about a normal of each lane. Of a lane's 2^bits samples the j-th is one that lies in part j of the square, in
 * an order of quadrants of quadrants: then the rays that lanes send at the same time go much the same way. */
#define PELL_SKY_BITS 4 /* at most */
struct pell_sky {
    _Alignas(64) float origin[3][16], normal[3][16]; /* the caller's */
    float right[3][16], up[3][16];
    uint32_t pattern[2][16], part[16]; /* part: of the pattern */
    int bits;                          /* the caller's */
};

/* The part of the square that a sample, or a pattern, lies in. */
static inline uint32_t pell_sky_part(uint32_t u, uint32_t v, int bits)
{
    return (u >> 31 << 3 | v >> 31 << 2 | (u >> 30 & 1u) << 1 | (v >> 30 & 1u)) >> (PELL_SKY_BITS - bits);
}

struct pell_sky_kernels {
    /* Fills in what is not the caller's; `pattern_bits`, `salt`: of pell_lane_pattern. */
    void (*make)(const struct pell_lanes *lanes, int pattern_bits, uint32_t salt, struct pell_sky *sky);
    /* The j-th samples; number[k][part]: the sequence's numbers that lie in the parts of the square. */
    void (*rays)(const struct pell_sky *sky, const uint32_t number[2][1 << PELL_SKY_BITS], uint32_t j, struct pell_ray16 *rays);
};

PELL_SIMD_TABLES(struct pell_sky_kernels, pell_sky_kernels);

#endif
