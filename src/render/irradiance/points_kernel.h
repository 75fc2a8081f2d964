/* SPDX-License-Identifier: MIT
 *
 * points_kernel.h - private to src/render/irradiance: 16 points of triangles; points_kernel.c is compiled once per SIMD level.
 */
#ifndef PELL_IRRADIANCE_POINTS_KERNEL_H
#define PELL_IRRADIANCE_POINTS_KERNEL_H

#include "base/simd.h"
#include "visibility/rays.h"

struct pell_triangles16 {
    _Alignas(64) float corner[3][3][16]; /* x, y, z of each corner, mm */
    float u[16], v[16];
    float side[16]; /* -1: the side from which the corners run clockwise; else 1 */
};

struct pell_points_kernels {
    /* Computes positions, and rays that arrive at them against their normals; tfar: the largest coordinate that a position was computed
     * from. */
    void (*position)(const struct pell_triangles16 *triangles, struct pell_ray_hit16 *packet, float (*position)[16]);
};

PELL_SIMD_TABLES(struct pell_points_kernels, pell_points_kernels);

#endif
