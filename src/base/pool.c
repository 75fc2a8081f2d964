/* SPDX-License-Identifier: MIT
 * pool.c - workers sleep on a condition variable; task indices are handed out by an atomic counter. */
#define _GNU_SOURCE
#include "base/pool.h"

#include <pthread.h>
#include <sched.h>
#include <unistd.h>
#if defined(__x86_64__)
#include <xmmintrin.h>
#endif

struct worker {
    struct pell_pool *pool;
    int index;
    pthread_t thread;
};

struct pell_pool {
    struct pell_context *ctx;
    int threads, started;
    struct worker *workers; /* threads - 1 of them: the caller is worker 0 */
    pthread_mutex_t lock, run_lock;
    pthread_cond_t wake, done;
    unsigned generation; /* counts runs; guarded by lock */
    int busy;            /* workers that have not finished this run; guarded by lock */
    bool stop;
    void (*task)(void *arg, int index, int worker);
    void *arg;
    int count;
    atomic_int next;
};

/* Flushes denormals to zero: in the tails of exponentials each costs hundreds of cycles. Returns the previous state. */
static unsigned flush_denormals(void)
{
#if defined(__x86_64__)
    const unsigned before = _mm_getcsr();
    _mm_setcsr(before | 0x8040u); /* FTZ | DAZ */
    return before;
#else
    return 0;
#endif
}

static void restore_denormals(unsigned before)
{
#if defined(__x86_64__)
    _mm_setcsr(before);
#else
    (void) before;
#endif
}

static void work(struct pell_pool *pool, int worker)
{
    for (;;) {
        const int i = atomic_fetch_add_explicit(&pool->next, 1, memory_order_relaxed);
        if (i >= pool->count || pell_cancelled(pool->ctx))
            return;
        pool->task(pool->arg, i, worker);
    }
}

static void *worker_main(void *arg)
{
    struct worker *w = arg;
    struct pell_pool *pool = w->pool;
    unsigned seen = 0;

    flush_denormals();
    pthread_mutex_lock(&pool->lock);
    for (;;) {
        while (!pool->stop && pool->generation == seen)
            pthread_cond_wait(&pool->wake, &pool->lock);
        if (pool->stop)
            break;
        seen = pool->generation;
        pthread_mutex_unlock(&pool->lock);
        work(pool, w->index);
        pthread_mutex_lock(&pool->lock);
        if (--pool->busy == 0)
            pthread_cond_signal(&pool->done);
    }
    pthread_mutex_unlock(&pool->lock);
    return NULL;
}

static int cores(void)
{
#if defined(__linux__)
    cpu_set_t set;
    if (sched_getaffinity(0, sizeof(set), &set) == 0 && CPU_COUNT(&set) > 0)
        return CPU_COUNT(&set);
#endif
    const long n = sysconf(_SC_NPROCESSORS_ONLN);
    return n > 0 ? (int) n : 1;
}

enum pell_result pell_pool_create(struct pell_context *ctx, int threads, struct pell_pool **out)
{
    struct pell_pool *pool;

    *out = NULL;
    if (threads < 0 || threads > 256)
        return pell_error(ctx, PELL_ERR_INVALID, NULL, NULL, "threads = %d, must be in [0, 256]; 0 is one per core", threads);
    if (threads == 0)
        threads = cores() < 256 ? cores() : 256;
    pool = pell_zalloc(ctx, sizeof(*pool));
    if (!pool)
        return PELL_ERR_NOMEM;
    pool->ctx = ctx;
    pool->threads = threads;
    pthread_mutex_init(&pool->lock, NULL);
    pthread_mutex_init(&pool->run_lock, NULL);
    pthread_cond_init(&pool->wake, NULL);
    pthread_cond_init(&pool->done, NULL);
    pool->workers = pell_calloc(ctx, (size_t) threads, sizeof(*pool->workers));
    if (!pool->workers) {
        pell_pool_destroy(&pool);
        return PELL_ERR_NOMEM;
    }
    for (int i = 1; i < threads; i++) {
        struct worker *w = &pool->workers[i - 1];
        *w = (struct worker) { .pool = pool, .index = i };
        if (pthread_create(&w->thread, NULL, worker_main, w) != 0) {
            pell_error(ctx, PELL_ERR_NOMEM, NULL, "use fewer threads", "thread %d of %d can't be started", i + 1, threads);
            pell_pool_destroy(&pool);
            return PELL_ERR_NOMEM;
        }
        pool->started++;
    }
    *out = pool;
    return PELL_OK;
}

void pell_pool_destroy(struct pell_pool **pool)
{
    struct pell_pool *p = *pool;
    if (!p)
        return;
    *pool = NULL;
    pthread_mutex_lock(&p->lock);
    p->stop = true;
    pthread_cond_broadcast(&p->wake);
    pthread_mutex_unlock(&p->lock);
    for (int i = 0; i < p->started; i++)
        pthread_join(p->workers[i].thread, NULL);
    pthread_cond_destroy(&p->done);
    pthread_cond_destroy(&p->wake);
    pthread_mutex_destroy(&p->run_lock);
    pthread_mutex_destroy(&p->lock);
    pell_free(p->ctx, p->workers);
    pell_free(p->ctx, p);
}

int pell_pool_threads(const struct pell_pool *pool)
{
    return pool->threads;
}

void pell_pool_run(struct pell_pool *pool, int count, void (*task)(void *arg, int index, int worker), void *arg)
{
    unsigned before;

    pthread_mutex_lock(&pool->run_lock);
    before = flush_denormals();
    pool->task = task;
    pool->arg = arg;
    pool->count = count;
    atomic_store(&pool->next, 0);
    if (pool->started && count > 1) {
        pthread_mutex_lock(&pool->lock);
        pool->generation++;
        pool->busy = pool->started;
        pthread_cond_broadcast(&pool->wake);
        pthread_mutex_unlock(&pool->lock);
        work(pool, 0);
        pthread_mutex_lock(&pool->lock);
        while (pool->busy > 0)
            pthread_cond_wait(&pool->done, &pool->lock);
        pthread_mutex_unlock(&pool->lock);
    } else {
        work(pool, 0);
    }
    restore_denormals(before);
    pthread_mutex_unlock(&pool->run_lock);
}
