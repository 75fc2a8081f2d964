/* SPDX-License-Identifier: MIT
 * test_fit_threads.c - concurrent fits in several threads have no shared state. */
#include "pell_test.h"

#include <pellucid/optics.h>

#include <pthread.h>

static void *fit_in_a_thread(void *out)
{
    const struct pell_medium m = { { 0.032, 0.17, 0.48 }, { 0.74, 0.88, 1.01 }, { 0, 0, 0 }, 1.3 };
    const struct pell_fit_params params = { .count = 6 };
    return pell_fit_medium(&m, &params, out, NULL) == PELL_OK ? out : NULL;
}

static void threads_and_repetition_give_the_same_bits(void **state)
{
    struct pell_gaussians g[5];
    pthread_t threads[4];
    (void) state;
    for (int i = 0; i < 4; i++)
        assert_int_equal(pthread_create(&threads[i], NULL, fit_in_a_thread, &g[i]), 0);
    for (int i = 0; i < 4; i++) {
        void *result;
        pthread_join(threads[i], &result);
        assert_non_null(result);
    }
    assert_non_null(fit_in_a_thread(&g[4]));
    for (int i = 0; i < 4; i++)
        assert_memory_equal(&g[i], &g[4], sizeof(g[4]));
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(threads_and_repetition_give_the_same_bits),
    };
    return cmocka_run_group_tests_name("optics.fit_threads", tests, NULL, NULL);
}
