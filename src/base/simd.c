/* SPDX-License-Identifier: MIT
 * simd.c - detects this machine's SIMD level from single features: clang 14 has no test for a whole level. */
#include "base/simd.h"

#include "base/base.h"

#include <stdlib.h>
#include <string.h>

static const char *const names[PELL_SIMD_LEVELS] = { "base", "v2", "v3", "v4" };

const char *pell_simd_name(enum pell_simd_level level)
{
    return names[level];
}

static enum pell_simd_level detect(void)
{
#if defined(__x86_64__) && !defined(PELL_SIMD_BASE_ONLY)
    __builtin_cpu_init();
    if (!__builtin_cpu_supports("sse4.2") || !__builtin_cpu_supports("popcnt"))
        return PELL_SIMD_BASE;
    if (!__builtin_cpu_supports("avx2") || !__builtin_cpu_supports("fma") || !__builtin_cpu_supports("bmi") ||
        !__builtin_cpu_supports("bmi2"))
        return PELL_SIMD_V2;
    if (!__builtin_cpu_supports("avx512f") || !__builtin_cpu_supports("avx512bw") || !__builtin_cpu_supports("avx512cd") ||
        !__builtin_cpu_supports("avx512dq") || !__builtin_cpu_supports("avx512vl"))
        return PELL_SIMD_V3;
    return PELL_SIMD_V4;
#else
    return PELL_SIMD_BASE;
#endif
}

void pell_simd_check(struct pell_context *ctx)
{
    const char *wanted = getenv("PELL_SIMD");
    struct pell_text known = { .length = 0 };
    char shown[96];

    if (!wanted || !wanted[0])
        return;
    for (int i = 0; i < PELL_SIMD_LEVELS; i++) {
        if (strcmp(wanted, names[i]) == 0)
            return;
        pell_text_add(&known, "%s%s", i == 0 ? "" : i + 1 < PELL_SIMD_LEVELS ? ", " : " or ", names[i]);
    }
    pell_warn(ctx, "PELL_SIMD", NULL, "\"%s\" is ignored, must be %s", pell_printable(wanted, shown, sizeof(shown)), known.str);
}

enum pell_simd_level pell_simd_best(void)
{
    const enum pell_simd_level best = detect();
    const char *wanted = getenv("PELL_SIMD");

    for (int i = 0; wanted && i < (int) best; i++)
        if (strcmp(wanted, names[i]) == 0)
            return (enum pell_simd_level) i;
    return best;
}
