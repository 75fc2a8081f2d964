/* SPDX-License-Identifier: MIT
 *
 * simd.h - which build of a kernel file runs on this machine.
 *
 * A kernel file is compiled once per level (src/meson.build, `kernels`) with PELL_SIMD_NAME set to base, v2, v3 or v4, and
 * exports one constant table of functions named by PELL_SIMD(table). No intrinsics are needed; all levels give the same bits
 * (no contraction of multiply-adds). PELL_SIMD_BASE_ONLY (meson -Dsimd=base) leaves only the first.
 */
#ifndef PELL_SIMD_H
#define PELL_SIMD_H

#include <stdbool.h>

struct pell_context;

enum pell_simd_level {
    PELL_SIMD_BASE = 0, /* portable C, and the baseline of the architecture */
    PELL_SIMD_V2,       /* x86-64-v2: SSE4.2 */
    PELL_SIMD_V3,       /* x86-64-v3: AVX2, FMA */
    PELL_SIMD_V4,       /* x86-64-v4: AVX-512 F, BW, CD, DQ, VL */
    PELL_SIMD_LEVELS
};

/* The best level of this machine that was built. Thread-safe. The environment variable PELL_SIMD (base, v2, v3, v4) lowers it. */
enum pell_simd_level pell_simd_best(void);
const char *pell_simd_name(enum pell_simd_level level);
/* Warns if PELL_SIMD names no level; it is then ignored. */
void pell_simd_check(struct pell_context *ctx);

#define PELL_SIMD_JOIN_(a, b) a##_##b
#define PELL_SIMD_JOIN(a, b) PELL_SIMD_JOIN_(a, b)
#define PELL_SIMD(name) PELL_SIMD_JOIN(name, PELL_SIMD_NAME)

/* Prefetches the cache line of `p` for writing: the line becomes exclusive to this core, which a plain prefetch does not do. Functions that
 * use it are marked PELL_FETCHING; those that do nothing else PELL_FETCHING_INLINE, or their calls would be removed as having no effect.
 * All x86-64 processors know the instruction; some ignore it. */
#if defined(__x86_64__)
#define PELL_FETCHING __attribute__((target("prfchw")))
#else
#define PELL_FETCHING
#endif
#define PELL_FETCHING_INLINE static inline PELL_FETCHING __attribute__((always_inline))
#define pell_fetch_to_write(p) __builtin_prefetch((p), 1)

/* Declares the tables of all levels and an array of them: PELL_SIMD_TABLES(struct pell_blur_kernels, pell_blur_kernels). */
#if defined(__x86_64__) && !defined(PELL_SIMD_BASE_ONLY)
#define PELL_SIMD_TABLES(type, name)                                                                                                       \
    extern const type name##_base, name##_v2, name##_v3, name##_v4;                                                                        \
    static const type *const name##_tables[PELL_SIMD_LEVELS] = { &name##_base, &name##_v2, &name##_v3, &name##_v4 }
#else
#define PELL_SIMD_TABLES(type, name)                                                                                                       \
    extern const type name##_base;                                                                                                         \
    static const type *const name##_tables[PELL_SIMD_LEVELS] = { &name##_base, &name##_base, &name##_base, &name##_base }
#endif

#endif
