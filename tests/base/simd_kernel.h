/* SPDX-License-Identifier: MIT
 * simd_kernel.h - the table of the test kernel's functions, one entry per SIMD level. */
#ifndef TEST_SIMD_KERNEL_H
#define TEST_SIMD_KERNEL_H

#include "base/simd.h"

struct test_kernels {
    void (*smooth)(const float *restrict in, float *restrict out, int n);
};

#ifdef PELL_SIMD_NAME
extern const struct test_kernels PELL_SIMD(test_kernels);
#endif

#endif
