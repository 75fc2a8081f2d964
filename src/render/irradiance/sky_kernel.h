/* SPDX-License-Identifier: MIT
 *
 * sky_kernel.h - private to src/render/irradiance: ambient occlusion rays from 16 points; sky_kernel.c is compiled once per SIMD level.
 */
#ifndef PELL_IRRADIANCE_SKY_KERNEL_H
#define PELL_IRRADIANCE_SKY_KERNEL_H

#include "render/irradiance/kernel.h"

/* Cosine-distributed rays about a normal per lane. The j-th of a lane's 2^bits samples is the one in cell j of the unit square, in the
 * order of a quadtree: rays that the lanes trace together have similar directions. */
#define PELL_SKY_BITS 4 /* upper limit */
struct pell_sky {
    _Alignas(64) float origin[3][16], normal[3][16]; /* set by the caller */
    float right[3][16], up[3][16];
    uint32_t pattern[2][16], cell[16]; /* cell: of the pattern */
    int bits;                          /* set by the caller */
};

/* Returns the cell of the square that contains a sample or a pattern. */
static inline uint32_t pell_sky_cell(uint32_t u, uint32_t v, int bits)
{
    return (u >> 31 << 3 | v >> 31 << 2 | (u >> 30 & 1u) << 1 | (v >> 30 & 1u)) >> (PELL_SKY_BITS - bits);
}

struct pell_sky_kernels {
    /* Sets the members that the caller does not; `pattern_bits`, `salt`: for pell_lane_pattern. */
    void (*make)(const struct pell_lanes *lanes, int pattern_bits, uint32_t salt, struct pell_sky *sky);
    /* Makes the j-th rays; sequence[k][cell]: the elements of the sequence in each cell of the square. */
    void (*rays)(const struct pell_sky *sky, const uint32_t sequence[2][1 << PELL_SKY_BITS], uint32_t j, struct pell_ray16 *rays);
};

PELL_SIMD_TABLES(struct pell_sky_kernels, pell_sky_kernels);

#endif
