/* SPDX-License-Identifier: MIT
 * equation_kernel.c - see equation_kernel.h; compiled once per SIMD level. */
#include "render/indirect/equation_kernel.h"

#include "shared/lobe.h"

#include <math.h>

#define LANES 8

#define EIGHTY 0x42a00000 /* the bits of 80 */

/* exp(-x) for x >= 0, as in pell_exp_minus; exp(-80) beyond 80. The integer minimum compiles without a branch, so that loops vectorize. */
static inline float exp_minus(float x)
{
    const int32_t bits = pell_float_bits(x);
    const float y = pell_bits_float(bits < EIGHTY ? bits : EIGHTY) * -1.44269504f;
    const int32_t whole = (int32_t) (y - 0.5f);
    const float f = (y - (float) whole) * 0.693147181f;
    const float e =
        1.0f + f * (1.0f + f * (0.5f + f * (1.66666667e-1f + f * (4.16666667e-2f + f * (8.33333333e-3f + f * 1.38888889e-3f)))));
    return e * pell_bits_float((whole + 127) << 23);
}

static void measure(const struct equation_patches *patches, uint32_t first, uint32_t count, const struct equation_receiver *receiver,
                    struct equation_block *restrict b)
{
    const float *x = patches->x + first, *y = patches->y + first, *z = patches->z + first, *area = patches->area + first;
    const float *nx = patches->nx + first, *ny = patches->ny + first, *nz = patches->nz + first;
    const float *wx = patches->wx + first, *wy = patches->wy + first, *wz = patches->wz + first;

    for (uint32_t i = 0; i < count; i++) {
        const float dx = x[i] - receiver->x, dy = y[i] - receiver->y, dz = z[i] - receiver->z;
        const float distance2 = dx * dx + dy * dy + dz * dz, offset_normal = dx * nx[i] + dy * ny[i] + dz * nz[i];
        const float area2 = receiver->spread * area[i], min_distance2 = area2 > receiver->min_distance2 ? area2 : receiver->min_distance2;
        const float r2 = distance2 > min_distance2 ? distance2 : min_distance2, r = sqrtf(r2), inverse_r = 1.0f / r;
        const float source = area[i] * (1.0f / (4.0f * PELL_PI_F));
        b->distance2[i] = distance2;
        b->r2[i] = r2;
        b->r[i] = r;
        b->inverse_r[i] = inverse_r;
        b->facing[i] = receiver->nx * nx[i] + receiver->ny * ny[i] + receiver->nz * nz[i];
        b->offset_normal[i] = offset_normal;
        b->offset_direction[i] = dx * wx[i] + dy * wy[i] + dz * wz[i];
        b->direction2[i] = wx[i] * wx[i] + wy[i] * wy[i] + wz[i] * wz[i];
        b->source[i] = source;
        b->double_layer0[i] = -source * offset_normal * inverse_r * inverse_r * inverse_r;
    }
}

static void fill(const struct equation_kernel_params *params, uint32_t first, uint32_t count, struct equation_block *restrict b,
                 float *restrict matrix)
{
    const float kappa = params->kappa, inverse_s = params->inverse_s, *curvature_factor = params->curvature_factor + first;
    const float *depth0 = params->source_depth[0] + first, *depth1 = params->source_depth[1] + first, weight0 = params->weight[0],
                weight1 = params->weight[1];
    const float min0 = params->min_distance2[0], min1 = params->min_distance2[1];

    for (uint32_t i = 0; i < count; i++) {
        const float distance2_0 = b->distance2[i] + depth0[i] * (depth0[i] * b->direction2[i] + 2.0f * b->offset_direction[i]);
        const float distance2_1 = b->distance2[i] + depth1[i] * (depth1[i] * b->direction2[i] + 2.0f * b->offset_direction[i]);
        const float r0 = sqrtf(distance2_0 > min0 ? distance2_0 : min0), r1 = sqrtf(distance2_1 > min1 ? distance2_1 : min1);
        const float single_layer = b->source[i] * b->inverse_r[i] * exp_minus(kappa * b->r[i]);
        b->from_sources[i] = b->source[i] * (weight0 / r0 * exp_minus(kappa * r0) + weight1 / r1 * exp_minus(kappa * r1));
        b->single_layer[i] = single_layer;
        matrix[i] = single_layer * (inverse_s - curvature_factor[i] * (kappa + b->inverse_r[i]) * b->offset_normal[i] * b->inverse_r[i]);
    }
}

static double product(const float *restrict matrix, const double *restrict values, uint32_t count)
{
    double lane[LANES] = { 0.0 }, sum = 0.0;
    uint32_t i = 0;

    for (; i + LANES <= count; i += LANES)
        for (int k = 0; k < LANES; k++)
            lane[k] += (double) matrix[i + (uint32_t) k] * values[i + (uint32_t) k];
    for (; i < count; i++)
        sum += (double) matrix[i] * values[i];
    for (int k = 0; k < LANES; k++)
        sum += lane[k];
    return sum;
}

const struct equation_kernels PELL_SIMD(equation_kernels) = { measure, fill, product };
