/* SPDX-License-Identifier: MIT
 *
 * points_kernel.h - private to src/render/irradiance: 16 points of triangles, built once per SIMD level (points_kernel.c).
 */
#ifndef PELL_IRRADIANCE_POINTS_KERNEL_H
#define PELL_IRRADIANCE_POINTS_KERNEL_H

#include "base/simd.h"
#include "visibility/rays.h"

struct pell_triangles16 {
    _Alignas(64) float corner[3][3][16]; /* of each: x, y, z, mm */
    float u[16], v[16];
    float side[16]; /* -1: that from which the corners run clockwise; else 1 */
};

struct pell_points_kernels {
    /* Where they are, and rays that look at them against their normals; tfar: the largest coordinate that a place was made of. */
    void (*place)(const struct pell_triangles16 *triangles, struct pell_ray_hit16 *packet, float (*place)[16]);
};

PELL_SIMD_TABLES(struct pell_points_kernels, pell_points_kernels);

#endif
