/* SPDX-License-Identifier: MIT
 * test_simd.c - selection of the SIMD level; all levels give bit-identical results. */
#define _XOPEN_SOURCE 700 /* setenv */
#include "pell_test.h"

#include "simd_kernel.h"

PELL_SIMD_TABLES(struct test_kernels, test_kernels);

static void environment_lowers_the_level_but_never_raises_it(void **state)
{
    enum pell_simd_level best;
    (void) state;

    unsetenv("PELL_SIMD");
    best = pell_simd_best();
    assert_true(best < PELL_SIMD_LEVELS);
    for (int i = 0; i < PELL_SIMD_LEVELS; i++) {
        setenv("PELL_SIMD", pell_simd_name((enum pell_simd_level) i), 1);
        assert_int_equal(pell_simd_best(), i < (int) best ? i : (int) best);
    }
    setenv("PELL_SIMD", "sse9", 1);
    assert_int_equal(pell_simd_best(), best);
    setenv("PELL_SIMD", "", 1);
    assert_int_equal(pell_simd_best(), best);
    unsetenv("PELL_SIMD");
}

static void names_differ(void **state)
{
    (void) state;
    for (int a = 0; a < PELL_SIMD_LEVELS; a++)
        for (int b = 0; b < a; b++)
            assert_string_not_equal(pell_simd_name((enum pell_simd_level) a), pell_simd_name((enum pell_simd_level) b));
}

static void all_levels_of_this_machine_give_the_same_bits(void **state)
{
    enum { N = 1003 };
    static float in[N], base[N], out[N];
    uint32_t seed = 1;
    (void) state;

    for (int i = 0; i < N; i++) {
        seed = seed * 1664525u + 1013904223u;
        in[i] = (float) (seed >> 8) * 0x1p-24f * (i % 7 ? 1.0f : 1e6f);
    }
    test_kernels_tables[PELL_SIMD_BASE]->smooth(in, base, N);
    assert_true(base[N / 2] > 0);
    for (int level = 0; level <= (int) pell_simd_best(); level++) {
        memset(out, 0, sizeof(out));
        test_kernels_tables[level]->smooth(in, out, N);
        if (memcmp(base, out, sizeof(out)) != 0)
            fail_msg("level %s differs from base", pell_simd_name((enum pell_simd_level) level));
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(environment_lowers_the_level_but_never_raises_it),
        cmocka_unit_test(names_differ),
        cmocka_unit_test(all_levels_of_this_machine_give_the_same_bits),
    };
    return cmocka_run_group_tests_name("simd", tests, NULL, NULL);
}
