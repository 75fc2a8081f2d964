/* SPDX-License-Identifier: MIT
 * simd_kernel.c - a kernel like those of the library, compiled once per SIMD level by this folder's meson.build. */
#include "simd_kernel.h"

static void smooth(const float *restrict in, float *restrict out, int n)
{
    for (int i = 2; i < n - 2; i++)
        out[i] = 0.0625f * in[i - 2] + 0.25f * in[i - 1] + 0.375f * in[i] + 0.25f * in[i + 1] + 0.0625f * in[i + 2];
}

const struct test_kernels PELL_SIMD(test_kernels) = { smooth };
