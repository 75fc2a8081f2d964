/* SPDX-License-Identifier: MIT
 * test_alloc.c - the allocator: counting, limits, alignment and injected failures; contexts and their messages. */
#include "pell_test.h"

static void blocks_are_aligned_counted_and_zeroed(void **state)
{
    struct pell_context *ctx = test_context(NULL, NULL);
    void *blocks[64];
    size_t total = 0;
    (void) state;

    for (size_t i = 0; i < PELL_COUNT(blocks); i++) {
        blocks[i] = pell_zalloc(ctx, i * 13);
        assert_non_null(blocks[i]);
        assert_int_equal((uintptr_t) blocks[i] % 64, 0);
        for (size_t j = 0; j < i * 13; j++)
            assert_int_equal(((char *) blocks[i])[j], 0);
        total += i * 13;
        assert_int_equal(pell_memory_used(ctx), total);
    }
    assert_int_equal(pell_allocations(ctx), PELL_COUNT(blocks));
    for (size_t i = 0; i < PELL_COUNT(blocks); i++)
        pell_free(ctx, blocks[i]);
    pell_free(ctx, NULL);
    assert_int_equal(pell_memory_used(ctx), 0);
    pell_context_destroy(&ctx);
    pell_context_destroy(&ctx); /* &(NULL) */
}

static void products_that_overflow_are_refused(void **state)
{
    struct kept_messages kept = { 0 };
    struct pell_context *ctx = test_context(NULL, &kept);
    void *array = NULL;
    size_t capacity = SIZE_MAX / 2 + 1;
    (void) state;

    assert_null(pell_calloc(ctx, SIZE_MAX / 2 + 1, 2));
    assert_null(pell_alloc_array(ctx, SIZE_MAX / 4, 8));
    assert_null(pell_realloc_array(ctx, NULL, SIZE_MAX, SIZE_MAX));
    assert_null(pell_alloc(ctx, SIZE_MAX));
    assert_null(pell_alloc(ctx, SIZE_MAX - 63));
    assert_null(pell_alloc(ctx, SIZE_MAX - 64));
    assert_int_equal(kept.errors, 6);
    assert_int_equal(kept.code, PELL_ERR_NOMEM);
    assert_int_equal(pell_grow(ctx, &array, capacity, &capacity, 1), PELL_ERR_NOMEM);
    assert_null(array);
    assert_int_equal(pell_memory_used(ctx), 0);
    pell_context_destroy(&ctx);
}

static void memory_limit_is_exact_and_given_back(void **state)
{
    struct pell_limits limits;
    struct kept_messages kept = { 0 };
    struct pell_context_params params = { .log = keep_message, .log_user = &kept, .limits = &limits };
    struct pell_context *ctx;
    void *a, *b;
    (void) state;

    pell_knobs_default(pell_limit_knobs(), &limits);
    limits.memory_bytes = 1 << 20;
    assert_int_equal(pell_context_create(&params, &ctx), PELL_OK);
    a = pell_alloc(ctx, (1 << 20) - 10);
    assert_non_null(a);
    assert_null(pell_alloc(ctx, 11));
    assert_int_equal(kept.errors, 1);
    assert_non_null(strstr(kept.what, "1048576"));
    assert_non_null(strstr(kept.hint, "memory-bytes"));
    b = pell_alloc(ctx, 10);
    assert_non_null(b);
    pell_free(ctx, a);
    a = pell_alloc(ctx, (1 << 20) - 10);
    assert_non_null(a);
    pell_free(ctx, a);
    pell_free(ctx, b);
    pell_context_destroy(&ctx);
}

static void growing_arrays_keep_their_items(void **state)
{
    struct pell_context *ctx = test_context(NULL, NULL);
    size_t capacity = 0;
    void *array = NULL;
    int *shrunk;
    (void) state;

    for (int i = 0; i < 1000; i++) {
        assert_int_equal(pell_grow(ctx, &array, (size_t) i, &capacity, sizeof(int)), PELL_OK);
        ((int *) array)[i] = i;
    }
    assert_int_equal(capacity, 1024);
    assert_true(pell_allocations(ctx) <= 8); /* doubles from 8 elements */
    for (int i = 0; i < 1000; i++)
        assert_int_equal(((int *) array)[i], i);
    shrunk = pell_realloc_array(ctx, array, 10, sizeof(int));
    assert_non_null(shrunk);
    assert_int_equal(shrunk[9], 9);
    assert_int_equal(pell_memory_used(ctx), 10 * sizeof(int));
    pell_free(ctx, shrunk);
    pell_context_destroy(&ctx);
}

static void failed_growth_leaves_the_array_alone(void **state)
{
    struct pell_alloc_fault fault = { .fail_at = 3 }; /* the context, the array, its growth */
    struct kept_messages kept = { 0 };
    struct pell_context *ctx = test_context(&fault, &kept);
    size_t capacity = 0;
    void *array = NULL;
    (void) state;

    assert_int_equal(pell_grow(ctx, &array, 0, &capacity, 4), PELL_OK);
    ((int *) array)[7] = 7;
    assert_int_equal(pell_grow(ctx, &array, 8, &capacity, 4), PELL_ERR_NOMEM);
    assert_int_equal(kept.errors, 1);
    assert_int_equal(capacity, 8);
    assert_int_equal(((int *) array)[7], 7);
    assert_int_equal(pell_grow(ctx, &array, 8, &capacity, 4), PELL_OK); /* only the third call failed */
    assert_int_equal(((int *) array)[7], 7);
    pell_free(ctx, array);
    pell_context_destroy(&ctx);
    assert_int_equal(fault.live, 0);
}

/* The pattern of every module's allocation test: fail the n-th allocation, for n = 1, 2, ..., until the whole operation succeeds. */
static enum pell_result some_work(struct pell_context *ctx)
{
    enum pell_result res = PELL_ERR_NOMEM;
    char *a = pell_strdup(ctx, "text"), *b = NULL;
    void *c = NULL;

    if (!a)
        goto fail;
    b = pell_strndup(ctx, "text", 2);
    if (!b)
        goto fail;
    c = pell_calloc(ctx, 10, 10);
    if (!c)
        goto fail;
    res = strcmp(a, "text") == 0 && strcmp(b, "te") == 0 ? PELL_OK : PELL_ERR_INVALID;
fail:
    pell_free(ctx, c);
    pell_free(ctx, b);
    pell_free(ctx, a);
    return res;
}

static void every_failing_allocation_is_survived(void **state)
{
    (void) state;
    for (int sticky = 0; sticky < 2; sticky++) {
        uint64_t n = 1;
        for (;; n++) {
            struct pell_alloc_fault fault = { .fail_at = n, .sticky = sticky };
            struct kept_messages kept = { 0 };
            struct pell_context *ctx = test_context(&fault, &kept);
            enum pell_result res;

            if (!ctx) {
                assert_int_equal(n, 1);
                assert_int_equal(fault.live, 0);
                continue;
            }
            res = some_work(ctx);
            assert_int_equal(pell_memory_used(ctx), 0);
            pell_context_destroy(&ctx);
            assert_int_equal(fault.live, 0);
            if (res == PELL_OK)
                break;
            assert_int_equal(res, PELL_ERR_NOMEM);
            assert_int_equal(kept.errors, 1);
        }
        assert_int_equal(n, 5);
    }
}

static void context_refuses_bad_limits_and_half_an_allocator(void **state)
{
    struct pell_limits limits;
    struct kept_messages kept = { 0 };
    struct pell_alloc_fault fault = { .fail_at = 0 };
    struct pell_context_params params = { .log = keep_message, .log_user = &kept, .limits = &limits };
    struct pell_context *ctx = (struct pell_context *) &fault;
    (void) state;

    pell_knobs_default(pell_limit_knobs(), &limits);
    limits.depth = 0;
    params.allocator = pell_failing_allocator(&fault);
    assert_int_equal(pell_context_create(&params, &ctx), PELL_ERR_INVALID);
    assert_null(ctx);
    assert_int_equal(fault.live, 0);
    assert_int_equal(kept.errors, 1);
    assert_non_null(strstr(kept.what, "depth = 0, must be in [1, "));
    limits.depth = 5;
    params.allocator.free = NULL;
    assert_int_equal(pell_context_create(&params, &ctx), PELL_ERR_INVALID);
    params.allocator = pell_failing_allocator(&fault);
    assert_int_equal(pell_context_create(&params, &ctx), PELL_OK);
    assert_int_equal(pell_context_limits(ctx)->depth, 5);
    pell_context_destroy(&ctx);
    assert_int_equal(fault.live, 0);
    assert_int_equal(pell_context_create(NULL, &ctx), PELL_OK);
    pell_context_destroy(&ctx);
}

struct counted {
    int per_level[PELL_LOG_DEBUG + 1];
    struct pell_message last;
};

static void count_message(void *user, const struct pell_message *m)
{
    struct counted *c = user;
    c->per_level[m->level]++;
    c->last = *m;
    assert_non_null(m->where);
    assert_non_null(m->hint);
}

static void messages_pass_the_threshold_and_never_hold_null(void **state)
{
    struct counted c = { .per_level = { 0 } };
    struct pell_context_params params = { .log = count_message, .log_user = &c };
    struct pell_context *ctx;
    (void) state;

    assert_int_equal(pell_context_create(&params, &ctx), PELL_OK);
    assert_int_equal(pell_error(ctx, PELL_ERR_FORMAT, NULL, NULL, "number %d", 3), PELL_ERR_FORMAT);
    assert_int_equal(c.last.code, PELL_ERR_FORMAT);
    pell_warn(ctx, NULL, NULL, "w");
    assert_int_equal(c.last.code, PELL_OK);
    pell_info(ctx, NULL, "i");
    pell_debug(ctx, NULL, "d");
    assert_int_equal(c.per_level[PELL_LOG_ERROR], 1);
    assert_int_equal(c.per_level[PELL_LOG_WARNING], 1);
    assert_int_equal(c.per_level[PELL_LOG_INFO], 1);
    assert_int_equal(c.per_level[PELL_LOG_DEBUG], 0); /* above the default */
    pell_context_destroy(&ctx);

    params.log = NULL;
    assert_int_equal(pell_context_create(&params, &ctx), PELL_OK);
    assert_int_equal(pell_error(ctx, PELL_ERR_IO, "x", "y", "nobody listens"), PELL_ERR_IO);
    pell_progress(ctx, "task", 0.5);
    pell_context_destroy(&ctx);
}

static void every_result_has_a_name_of_its_own(void **state)
{
    (void) state;
    for (int a = PELL_ERR_CANCELLED; a <= PELL_OK; a++) {
        assert_string_not_equal(pell_result_name((enum pell_result) a), "unknown result");
        for (int b = PELL_ERR_CANCELLED; b < a; b++)
            assert_string_not_equal(pell_result_name((enum pell_result) a), pell_result_name((enum pell_result) b));
    }
    assert_string_equal(pell_result_name((enum pell_result) 99), "unknown result");
    assert_string_equal(pell_version_string(), PELL_TEST_VERSION); /* the build's version equals the header's */
    assert_string_equal(PELL_VERSION_STRING, PELL_TEST_VERSION);
    assert_int_equal(pell_version_number(), PELL_VERSION_NUMBER);
}

/* 0.x: another minor version has other structs. The parameters of such a program are not read, except for its log callback. */
static void a_program_of_another_version_is_refused_with_one_message(void **state)
{
    const int same = PELL_VERSION_NUMBER, minor = PELL_VERSION_NUMBER + 1000, major = PELL_VERSION_NUMBER + 1000000;
    const int older = PELL_VERSION_MINOR > 0 ? PELL_VERSION_NUMBER - 1000 : PELL_VERSION_NUMBER - 1000000;
    const int others[] = { minor, major, older, -1, INT32_MIN, INT32_MAX };
    struct kept_messages kept = { 0 };
    struct pell_alloc_fault fault = { 0 };
    struct pell_context_params params = { .log = keep_message, .log_user = &kept, .allocator = pell_failing_allocator(&fault) };
    struct pell_context *ctx;
    (void) state;

    for (size_t i = 0; i < PELL_COUNT(others); i++) {
        ctx = (struct pell_context *) &fault;
        assert_false(pell_version_compatible(others[i]));
        assert_int_equal(pell_context_create_for(others[i], &params, &ctx), PELL_ERR_UNSUPPORTED);
        assert_null(ctx);
        assert_int_equal(kept.errors, (int) i + 1);
        assert_int_equal(kept.code, PELL_ERR_UNSUPPORTED);
        assert_non_null(strstr(kept.what, "the library is " PELL_VERSION_STRING));
        assert_non_null(strstr(kept.hint, "recompile"));
        assert_int_equal(pell_context_create_for(others[i], NULL, &ctx), PELL_ERR_UNSUPPORTED);
    }
    assert_int_equal(fault.calls, 0);
    assert_true(pell_version_compatible(same) && pell_version_compatible(same - PELL_VERSION_PATCH + 999));
    assert_int_equal(pell_context_create_for(same, &params, &ctx), PELL_OK);
    pell_context_destroy(&ctx);
}

/* A scene of a million instances must not produce a million log lines. */
static void warnings_of_one_kind_are_limited(void **state)
{
    struct kept_messages kept = { 0 };
    struct pell_limits limits;
    struct pell_context *ctx;
    (void) state;

    pell_knobs_default(pell_limit_knobs(), &limits);
    limits.warnings = 3;
    assert_int_equal(pell_context_create(&(struct pell_context_params) { .log = keep_message, .log_user = &kept, .limits = &limits }, &ctx),
                     PELL_OK);
    for (int i = 0; i < 100; i++)
        pell_warn(ctx, "a.obj", NULL, "face %d is odd", i);
    assert_int_equal(kept.warnings, 3 + 1); /* and a note that there are more */
    REQUIRE(strstr(kept.last_warning, "further") != NULL);
    pell_warn(ctx, "a.obj", NULL, "another kind");
    assert_int_equal(kept.warnings, 5);
    pell_context_destroy(&ctx);
}

/* Blocks that are allocated as pages from the system, and smaller ones that are not. */
static void large_blocks_are_zero_aligned_and_counted(void **state)
{
    static const size_t sizes[] = { (8u << 20) - 1, 8u << 20, (9u << 20) + 13 };
    struct pell_context *ctx = test_context(NULL, NULL);

    (void) state;
    for (size_t i = 0; i < PELL_COUNT(sizes); i++)
        for (int round = 0; round < 2; round++) { /* data of a freed block is not visible again */
            unsigned char *p = pell_zalloc(ctx, sizes[i]), *q;

            assert_non_null(p);
            assert_int_equal((uintptr_t) p % 64, 0);
            assert_int_equal(pell_memory_used(ctx), sizes[i]);
            assert_int_equal(p[0] | memcmp(p, p + 1, sizes[i] - 1), 0);
            memset(p, 0x5a, sizes[i]);
            q = pell_realloc_array(ctx, p, 2, sizes[i]);
            assert_non_null(q);
            assert_int_equal(pell_memory_used(ctx), 2 * sizes[i]);
            assert_true(q[0] == 0x5a && memcmp(q, q + 1, sizes[i] - 1) == 0);
            pell_free(ctx, q);
            assert_int_equal(pell_memory_used(ctx), 0);
        }
    pell_context_destroy(&ctx);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(blocks_are_aligned_counted_and_zeroed),
        cmocka_unit_test(products_that_overflow_are_refused),
        cmocka_unit_test(memory_limit_is_exact_and_given_back),
        cmocka_unit_test(growing_arrays_keep_their_items),
        cmocka_unit_test(failed_growth_leaves_the_array_alone),
        cmocka_unit_test(every_failing_allocation_is_survived),
        cmocka_unit_test(context_refuses_bad_limits_and_half_an_allocator),
        cmocka_unit_test(messages_pass_the_threshold_and_never_hold_null),
        cmocka_unit_test(every_result_has_a_name_of_its_own),
        cmocka_unit_test(a_program_of_another_version_is_refused_with_one_message),
        cmocka_unit_test(warnings_of_one_kind_are_limited),
        cmocka_unit_test(large_blocks_are_zero_aligned_and_counted),
    };
    return cmocka_run_group_tests_name("alloc", tests, NULL, NULL);
}
