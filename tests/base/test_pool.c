/* SPDX-License-Identifier: MIT
 * test_pool.c - the thread pool runs every index exactly once with any number of threads, and sleeps when it is idle. */
#include "pell_test.h"

#include "base/pool.h"

#include <float.h>
#include <pthread.h>
#include <time.h>

enum { MANY = 10007 };

struct marks {
    _Atomic int hits[MANY];
    _Atomic int bad_workers;
    int threads;
};

static void mark(void *arg, int index, int worker)
{
    struct marks *m = arg;
    atomic_fetch_add(&m->hits[index], 1);
    if (worker < 0 || worker >= m->threads)
        atomic_fetch_add(&m->bad_workers, 1);
}

static void every_index_comes_exactly_once(void **state)
{
    static struct marks m;
    static const int counts[] = { 0, 1, 2, 3, 7, 64, MANY };
    struct pell_context *ctx = test_context(NULL, NULL);
    (void) state;

    for (int threads = 1; threads <= 8; threads++) {
        struct pell_pool *pool;

        assert_int_equal(pell_pool_create(ctx, threads, &pool), PELL_OK);
        assert_int_equal(pell_pool_threads(pool), threads);
        m.threads = threads;
        for (int run = 0; run < 5; run++) {
            for (size_t c = 0; c < PELL_COUNT(counts); c++) {
                memset(&m.hits, 0, sizeof(m.hits));
                pell_pool_run(pool, counts[c], mark, &m);
                for (int i = 0; i < MANY; i++)
                    if (m.hits[i] != (i < counts[c]))
                        fail_msg("%d threads, %d indices: index %d came %d times", threads, counts[c], i, m.hits[i]);
            }
        }
        assert_int_equal(m.bad_workers, 0);
        pell_pool_destroy(&pool);
        assert_null(pool);
    }
    assert_int_equal(pell_memory_used(ctx), 0);
    pell_context_destroy(&ctx);
}

struct rows {
    double value[MANY];
};

static void fill(void *arg, int index, int worker)
{
    struct rows *r = arg;
    double x = 1.0 + index;
    (void) worker;
    for (int i = 0; i < 20; i++)
        x = sqrt(x) + 1.0 / x;
    r->value[index] = x;
}

static void results_are_the_same_bits_for_any_number_of_threads(void **state)
{
    static struct rows one, many;
    struct pell_context *ctx = test_context(NULL, NULL);
    (void) state;

    for (int threads = 1; threads <= 8; threads++) {
        struct pell_pool *pool;
        assert_int_equal(pell_pool_create(ctx, threads, &pool), PELL_OK);
        pell_pool_run(pool, MANY, fill, threads == 1 ? &one : &many);
        if (threads > 1)
            assert_memory_equal(&one, &many, sizeof(one));
        pell_pool_destroy(&pool);
    }
    pell_context_destroy(&ctx);
}

/* Run n + 1 reads what run n wrote, whichever threads execute them: thousands of short runs in a row. */
struct chain {
    int64_t from[64], to[64];
};

static void link_one(void *arg, int index, int worker)
{
    struct chain *c = arg;
    (void) worker;
    c->to[index] = c->from[(index + 17) % 64] + 1;
}

static void each_run_sees_all_of_the_run_before(void **state)
{
    struct pell_context *ctx = test_context(NULL, NULL);
    struct chain c = { .from = { 0 } };
    struct pell_pool *pool;
    uint64_t allocations;
    (void) state;

    assert_int_equal(pell_pool_create(ctx, 4, &pool), PELL_OK);
    allocations = pell_allocations(ctx);
    for (int run = 0; run < 3000; run++) {
        pell_pool_run(pool, 64, link_one, &c);
        memcpy(c.from, c.to, sizeof(c.from));
    }
    for (int i = 0; i < 64; i++)
        assert_int_equal(c.from[i], 3000);
    assert_int_equal(pell_allocations(ctx), allocations); /* a run allocates nothing */
    pell_pool_destroy(&pool);
    pell_context_destroy(&ctx);
}

struct caller {
    struct pell_pool *pool;
    struct marks *marks;
    pthread_t thread;
};

static void *call(void *arg)
{
    struct caller *c = arg;
    for (int run = 0; run < 20; run++)
        pell_pool_run(c->pool, 500, mark, c->marks);
    return NULL;
}

static void several_callers_wait_for_each_other(void **state)
{
    static struct marks marks[3];
    struct pell_context *ctx = test_context(NULL, NULL);
    struct caller callers[3];
    struct pell_pool *pool;
    (void) state;

    assert_int_equal(pell_pool_create(ctx, 3, &pool), PELL_OK);
    for (int i = 0; i < 3; i++) {
        marks[i].threads = 3;
        callers[i] = (struct caller) { .pool = pool, .marks = &marks[i] };
        assert_int_equal(pthread_create(&callers[i].thread, NULL, call, &callers[i]), 0);
    }
    for (int i = 0; i < 3; i++)
        pthread_join(callers[i].thread, NULL);
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 500; j++)
            assert_int_equal(marks[i].hits[j], 20);
    pell_pool_destroy(&pool);
    pell_context_destroy(&ctx);
}

static double cpu_seconds(void)
{
    struct timespec t;
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
    return (double) t.tv_sec + 1e-9 * (double) t.tv_nsec;
}

/* Eight workers that spin for 0.3 s would use at least 0.3 s of processor time on any number of cores. */
static void idle_workers_sleep(void **state)
{
    static struct marks m = { .threads = 8 };
    const struct timespec nap = { 0, 300000000 };
    struct pell_context *ctx = test_context(NULL, NULL);
    struct pell_pool *pool;
    double before;
    (void) state;

    assert_int_equal(pell_pool_create(ctx, 8, &pool), PELL_OK);
    pell_pool_run(pool, MANY, mark, &m);
    nanosleep(&(struct timespec) { 0, 20000000 }, NULL);
    before = cpu_seconds();
    nanosleep(&nap, NULL);
    REQUIRE(cpu_seconds() - before < 0.03);
    pell_pool_destroy(&pool);
    pell_context_destroy(&ctx);
}

struct cancelled_run {
    struct pell_context *ctx;
    _Atomic int done;
};

static void cancel_at_ten(void *arg, int index, int worker)
{
    struct cancelled_run *c = arg;
    (void) index;
    (void) worker;
    if (atomic_fetch_add(&c->done, 1) + 1 == 10)
        pell_context_cancel(c->ctx);
}

static void cancelling_stops_handing_out(void **state)
{
    (void) state;
    for (int threads = 1; threads <= 4; threads++) {
        struct pell_context *ctx = test_context(NULL, NULL);
        struct cancelled_run c = { .ctx = ctx };
        struct pell_pool *pool;

        assert_int_equal(pell_pool_create(ctx, threads, &pool), PELL_OK);
        pell_pool_run(pool, 100000000, cancel_at_ten, &c);
        assert_true(pell_cancelled(ctx));
        assert_true(c.done >= 10);
        assert_true(c.done < 10000000);
        c.done = 0;
        pell_pool_run(pool, 1000, cancel_at_ten, &c); /* a cancelled context stays cancelled */
        assert_int_equal(c.done, 0);
        pell_pool_destroy(&pool);
        pell_context_destroy(&ctx);
    }
}

#if defined(__x86_64__)
static void multiply_small(void *arg, int index, int worker)
{
    float *out = arg;
    volatile float tiny = FLT_MIN;
    (void) worker;
    out[index] = tiny * 0.5f;
}

static void denormals_are_zero_inside_a_run_only(void **state)
{
    struct pell_context *ctx = test_context(NULL, NULL);
    struct pell_pool *pool;
    volatile float tiny = FLT_MIN;
    float out[64];
    (void) state;

    assert_int_equal(pell_pool_create(ctx, 4, &pool), PELL_OK);
    memset(out, 0xff, sizeof(out));
    pell_pool_run(pool, 64, multiply_small, out);
    for (int i = 0; i < 64; i++)
        assert_true(out[i] == 0.0f);
    assert_true(tiny * 0.5f > 0.0f);
    pell_pool_destroy(&pool);
    pell_context_destroy(&ctx);
}
#endif

static void numbers_of_threads_out_of_range_are_refused(void **state)
{
    static const int bad[] = { -1, 257, INT32_MAX, INT32_MIN };
    struct kept_messages kept = { 0 };
    struct pell_context *ctx = test_context(NULL, &kept);
    struct pell_pool *pool;
    (void) state;

    for (size_t i = 0; i < PELL_COUNT(bad); i++) {
        pool = (struct pell_pool *) ctx;
        assert_int_equal(pell_pool_create(ctx, bad[i], &pool), PELL_ERR_INVALID);
        assert_null(pool);
    }
    assert_int_equal(kept.errors, PELL_COUNT(bad));
    assert_non_null(strstr(kept.what, "[0, 256]"));
    assert_int_equal(pell_pool_create(ctx, 0, &pool), PELL_OK); /* one per core */
    assert_true(pell_pool_threads(pool) >= 1);
    pell_pool_destroy(&pool);
    pell_pool_destroy(&pool);
    pell_context_destroy(&ctx);
}

static void a_pool_without_memory_leaves_nothing(void **state)
{
    (void) state;
    for (uint64_t n = 2;; n++) {
        struct pell_alloc_fault fault = { .fail_at = n };
        struct kept_messages kept = { 0 };
        struct pell_context *ctx = test_context(&fault, &kept);
        struct pell_pool *pool;
        const enum pell_result res = pell_pool_create(ctx, 4, &pool);

        pell_pool_destroy(&pool);
        pell_context_destroy(&ctx);
        assert_int_equal(fault.live, 0);
        if (res == PELL_OK) {
            assert_true(n > 2);
            break;
        }
        assert_int_equal(res, PELL_ERR_NOMEM);
        assert_int_equal(kept.errors, 1);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(every_index_comes_exactly_once),
        cmocka_unit_test(results_are_the_same_bits_for_any_number_of_threads),
        cmocka_unit_test(each_run_sees_all_of_the_run_before),
        cmocka_unit_test(several_callers_wait_for_each_other),
        cmocka_unit_test(idle_workers_sleep),
        cmocka_unit_test(cancelling_stops_handing_out),
#if defined(__x86_64__)
        cmocka_unit_test(denormals_are_zero_inside_a_run_only),
#endif
        cmocka_unit_test(numbers_of_threads_out_of_range_are_refused),
        cmocka_unit_test(a_pool_without_memory_leaves_nothing),
    };
    return cmocka_run_group_tests_name("pool", tests, NULL, NULL);
}
