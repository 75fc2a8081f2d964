/* SPDX-License-Identifier: MIT
 * equation_kernel.c - see equation_kernel.h; compiled once per SIMD level. */
#include "render/indirect/equation_kernel.h"

#include "shared/lobe.h"

#include <math.h>

#define LANES 8

#define EIGHTY 0x42a00000 /* the bits of 80 */

/* exp(-x) for x >= 0, as pell_exp_minus; exp(-80) beyond 80. The lesser of two integers takes no branch, so that loops become vectors. */
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

static void measure(const struct equation_patches *patches, uint32_t first, uint32_t count, const struct equation_from *from,
                    struct equation_block *restrict b)
{
    const float *x = patches->x + first, *y = patches->y + first, *z = patches->z + first, *area = patches->area + first;
    const float *nx = patches->nx + first, *ny = patches->ny + first, *nz = patches->nz + first;
    const float *wx = patches->wx + first, *wy = patches->wy + first, *wz = patches->wz + first;

    for (uint32_t i = 0; i < count; i++) {
        const float dx = x[i] - from->x, dy = y[i] - from->y, dz = z[i] - from->z;
        const float apart2 = dx * dx + dy * dy + dz * dz, along = dx * nx[i] + dy * ny[i] + dz * nz[i];
        const float wide2 = from->spread * area[i], least2 = wide2 > from->least2 ? wide2 : from->least2;
        const float r2 = apart2 > least2 ? apart2 : least2, r = sqrtf(r2), inverse_r = 1.0f / r;
        const float source = area[i] * (1.0f / (4.0f * PELL_PI_F));
        b->apart2[i] = apart2;
        b->r2[i] = r2;
        b->r[i] = r;
        b->inverse_r[i] = inverse_r;
        b->facing[i] = from->nx * nx[i] + from->ny * ny[i] + from->nz * nz[i];
        b->along[i] = along;
        b->toward[i] = dx * wx[i] + dy * wy[i] + dz * wz[i];
        b->way2[i] = wx[i] * wx[i] + wy[i] * wy[i] + wz[i] * wz[i];
        b->source[i] = source;
        b->even[i] = -source * along * inverse_r * inverse_r * inverse_r;
    }
}

static void entries(const struct equation_law *law, uint32_t first, uint32_t count, struct equation_block *restrict b, float *restrict left)
{
    const float kappa = law->kappa, inverse_s = law->inverse_s, *bend = law->bend + first;
    const float *deep0 = law->deep[0] + first, *deep1 = law->deep[1] + first, share0 = law->share[0], share1 = law->share[1];
    const float least0 = law->least2[0], least1 = law->least2[1];

    for (uint32_t i = 0; i < count; i++) {
        const float from0 = b->apart2[i] + deep0[i] * (deep0[i] * b->way2[i] + 2.0f * b->toward[i]);
        const float from1 = b->apart2[i] + deep1[i] * (deep1[i] * b->way2[i] + 2.0f * b->toward[i]);
        const float r0 = sqrtf(from0 > least0 ? from0 : least0), r1 = sqrtf(from1 > least1 ? from1 : least1);
        const float pull = b->source[i] * b->inverse_r[i] * exp_minus(kappa * b->r[i]);
        b->below[i] = b->source[i] * (share0 / r0 * exp_minus(kappa * r0) + share1 / r1 * exp_minus(kappa * r1));
        b->pull[i] = pull;
        left[i] = pull * (inverse_s - bend[i] * (kappa + b->inverse_r[i]) * b->along[i] * b->inverse_r[i]);
    }
}

static double product(const float *restrict left, const double *restrict values, uint32_t count)
{
    double lane[LANES] = { 0.0 }, sum = 0.0;
    uint32_t i = 0;

    for (; i + LANES <= count; i += LANES)
        for (int k = 0; k < LANES; k++)
            lane[k] += (double) left[i + (uint32_t) k] * values[i + (uint32_t) k];
    for (; i < count; i++)
        sum += (double) left[i] * values[i];
    for (int k = 0; k < LANES; k++)
        sum += lane[k];
    return sum;
}

const struct equation_kernels PELL_SIMD(equation_kernels) = { measure, entries, product };
