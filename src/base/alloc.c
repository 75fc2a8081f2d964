/* SPDX-License-Identifier: MIT
 * alloc.c - all memory of the library goes through here: counted, limited, aligned to 64 bytes. */
#if defined(__linux__)
#define _GNU_SOURCE
#endif
#include "base/context.h"

#include <stdlib.h>
#include <string.h>
#if defined(__linux__)
#include <sys/mman.h>
#endif

/* Header of every block. It is 64 bytes long, so that the block after it is aligned to 64. */
struct header {
    size_t size;
    size_t mapped; /* length of the mapping that begins at `pages` and holds this block; 0: the block is from the allocator */
    void *pages;
    char pad[64 - 2 * sizeof(size_t) - sizeof(void *)];
};

/* Large blocks are mapped directly, unless the caller provides an allocator. Mapped pages are zero already, so large planes need no memset,
 * and the threads that first use them share the page faults. Huge pages, where available, save TLB misses. Not with the address sanitizer,
 * which checks only blocks of its own allocator. */
#if defined(__SANITIZE_ADDRESS__)
#define ADDRESS_SANITIZER 1
#elif defined(__has_feature)
#if __has_feature(address_sanitizer)
#define ADDRESS_SANITIZER 1
#endif
#endif
#if defined(__linux__) && !defined(ADDRESS_SANITIZER)
#define LARGE ((size_t) 8 << 20)
#define HUGE_PAGE ((size_t) 2 << 20)

static struct header *map(const struct pell_context *ctx, size_t size)
{
    const size_t bytes = size + sizeof(struct header) + HUGE_PAGE;
    struct header *h;
    void *pages;

    if (!ctx->plain || size < LARGE || bytes < size)
        return NULL;
    pages = mmap(NULL, bytes, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
    if (pages == MAP_FAILED)
        return NULL;
    h = (struct header *) (((uintptr_t) pages + HUGE_PAGE - 1) & ~(uintptr_t) (HUGE_PAGE - 1));
    madvise(h, bytes - (size_t) ((char *) h - (char *) pages), MADV_HUGEPAGE); /* may fail: huge pages are optional */
    h->mapped = bytes;
    h->pages = pages;
    return h;
}

static bool unmap(struct header *h)
{
    if (h->mapped == 0)
        return false;
    munmap(h->pages, h->mapped);
    return true;
}
#else
static struct header *map(const struct pell_context *ctx, size_t size)
{
    (void) ctx;
    (void) size;
    return NULL;
}

static bool unmap(struct header *h)
{
    (void) h;
    return false;
}
#endif

void *pell_alloc(struct pell_context *ctx, size_t size)
{
    const size_t limit = (size_t) ctx->limits.memory_bytes;
    struct header *h;
    size_t used;

    if (size > SIZE_MAX - sizeof(*h)) {
        pell_error(ctx, PELL_ERR_NOMEM, NULL, NULL, "%zu bytes can't be allocated", size);
        return NULL;
    }
    used = atomic_fetch_add(&ctx->used, size) + size;
    if (used > limit || used < size) {
        atomic_fetch_sub(&ctx->used, size);
        pell_error(ctx, PELL_ERR_NOMEM, NULL, PELL_RAISE_LIMIT("memory-bytes") ", if the machine has more",
                   "%zu bytes more would exceed the memory limit of %zu bytes", size, limit);
        return NULL;
    }
    h = map(ctx, size);
    if (!h) {
        h = ctx->allocator.alloc(ctx->allocator.user, sizeof(*h) + size);
        if (h)
            h->mapped = 0;
    }
    if (!h) {
        atomic_fetch_sub(&ctx->used, size);
        pell_error(ctx, PELL_ERR_NOMEM, NULL, NULL, "out of memory: %zu bytes were asked for", size);
        return NULL;
    }
    atomic_fetch_add(&ctx->allocations, 1);
    h->size = size;
    return h + 1;
}

void *pell_zalloc(struct pell_context *ctx, size_t size)
{
    void *ptr = pell_alloc(ctx, size);
    if (ptr && !((struct header *) ptr)[-1].mapped)
        memset(ptr, 0, size);
    return ptr;
}

static bool product(struct pell_context *ctx, size_t count, size_t size, size_t *bytes)
{
    if (!__builtin_mul_overflow(count, size, bytes))
        return true;
    pell_error(ctx, PELL_ERR_NOMEM, NULL, NULL, "%zu items of %zu bytes can't be allocated", count, size);
    return false;
}

void *pell_calloc(struct pell_context *ctx, size_t count, size_t size)
{
    size_t bytes;
    return product(ctx, count, size, &bytes) ? pell_zalloc(ctx, bytes) : NULL;
}

void *pell_alloc_array(struct pell_context *ctx, size_t count, size_t size)
{
    size_t bytes;
    return product(ctx, count, size, &bytes) ? pell_alloc(ctx, bytes) : NULL;
}

void *pell_realloc_array(struct pell_context *ctx, void *ptr, size_t count, size_t size)
{
    size_t old = ptr ? ((struct header *) ptr)[-1].size : 0, bytes;
    void *grown;

    if (!product(ctx, count, size, &bytes) || !(grown = pell_alloc(ctx, bytes)))
        return NULL;
    if (ptr) {
        memcpy(grown, ptr, old < bytes ? old : bytes);
        pell_free(ctx, ptr);
    }
    return grown;
}

void pell_free(struct pell_context *ctx, void *ptr)
{
    struct header *h;
    if (!ptr)
        return;
    h = (struct header *) ptr - 1;
    atomic_fetch_sub(&ctx->used, h->size);
    if (!unmap(h))
        ctx->allocator.free(ctx->allocator.user, h);
}

char *pell_strndup(struct pell_context *ctx, const char *text, size_t length)
{
    char *copy = pell_alloc(ctx, length + 1);
    if (copy) {
        memcpy(copy, text, length);
        copy[length] = '\0';
    }
    return copy;
}

char *pell_strdup(struct pell_context *ctx, const char *text)
{
    return pell_strndup(ctx, text, strlen(text));
}

size_t pell_memory_used(const struct pell_context *ctx)
{
    return atomic_load(&ctx->used);
}

bool pell_memory_available(size_t bytes)
{
#if defined(__linux__)
    void *pages = mmap(NULL, bytes, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);

    return pages != MAP_FAILED && munmap(pages, bytes) == 0;
#else
    (void) bytes;
    return true;
#endif
}

uint64_t pell_allocations(const struct pell_context *ctx)
{
    return atomic_load(&ctx->allocations);
}

enum pell_result pell_grow(struct pell_context *ctx, void **array, size_t count, size_t *capacity, size_t size)
{
    size_t wanted = *capacity ? *capacity : 4;
    void *grown;

    if (count < *capacity)
        return PELL_OK;
    if (__builtin_mul_overflow(wanted, 2, &wanted))
        return pell_error(ctx, PELL_ERR_NOMEM, NULL, NULL, "an array of %zu items can't grow", count);
    grown = pell_realloc_array(ctx, *array, wanted, size);
    if (!grown)
        return PELL_ERR_NOMEM;
    *array = grown;
    *capacity = wanted;
    return PELL_OK;
}

static void *fault_alloc(void *user, size_t size)
{
    struct pell_alloc_fault *f = user;
    const uint64_t call = atomic_fetch_add(&f->calls, 1) + 1;
    void *ptr = NULL;

    if (f->fail_at && (call == f->fail_at || (f->sticky && call > f->fail_at)))
        return NULL;
    if (posix_memalign(&ptr, 64, size) != 0)
        return NULL;
    atomic_fetch_add(&f->live, 1);
    return ptr;
}

static void fault_free(void *user, void *ptr)
{
    struct pell_alloc_fault *f = user;
    if (ptr)
        atomic_fetch_sub(&f->live, 1);
    free(ptr);
}

struct pell_allocator pell_failing_allocator(struct pell_alloc_fault *fault)
{
    return (struct pell_allocator) { fault_alloc, fault_free, fault };
}
