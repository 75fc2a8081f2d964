/* SPDX-License-Identifier: MIT
 * gpu_test.h - tests on a Vulkan device under the validation layer. They are skipped, by name, where there is no driver or no layer:
 * checked before a test allocates anything, because cmocka's skip() does not return. */
#ifndef PELL_GPU_TEST_H
#define PELL_GPU_TEST_H

#include "pell_test.h"

#include "vulkan/gpu.h"

static const struct pell_gpu_params validated_gpu = { .validate = true };

/* Skips the running test where no device can be opened, with the reason. */
static inline void skip_without_gpu(void)
{
    struct kept_messages kept = { 0 };
    struct pell_context *ctx = test_context(NULL, &kept);
    struct pell_gpu *gpu;
    const bool opens = pell_gpu_open(ctx, &validated_gpu, &gpu) == PELL_OK;

    pell_gpu_close(&gpu);
    pell_context_destroy(&ctx);
    if (!opens) {
        print_message("# skipped: %s\n", kept.what);
        skip();
    }
}

/* test_context(), where a device can be opened. */
static inline struct pell_context *gpu_context(struct pell_alloc_fault *fault, struct kept_messages *kept)
{
    skip_without_gpu();
    return test_context(fault, kept);
}

/* A device on such a context. */
static inline struct pell_gpu *gpu_opened(struct pell_context *ctx)
{
    struct pell_gpu *gpu;

    assert_int_equal(pell_gpu_open(ctx, &validated_gpu, &gpu), PELL_OK);
    return gpu;
}

/* Closes both; nothing must remain, and no message may have been logged. */
static inline void gpu_finished(struct pell_context **ctx, struct pell_gpu **gpu, const struct kept_messages *kept)
{
    assert_true(pell_gpu_memory_used(*gpu) == 0);
    pell_gpu_close(gpu);
    if (kept->errors)
        fail_msg("%d messages, the last: %s", kept->errors, kept->what);
    assert_int_equal(pell_memory_used(*ctx), 0);
    pell_context_destroy(ctx);
}

#endif
