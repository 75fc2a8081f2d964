/* SPDX-License-Identifier: MIT
 * context.c - contexts, results and limits. */
#include "base/context.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define AT(field) offsetof(struct pell_limits, field)
#define GIB (1024.0 * 1024.0 * 1024.0)
/* clang-format off */
static const struct pell_knob limit_knobs[] = {
    { "file-bytes", PELL_KNOB_INT64, "B", AT(file_bytes), { 2 * GIB }, 1, 64 * GIB, NULL, "bytes of one file that is read" },
    { "memory-bytes", PELL_KNOB_INT64, "B", AT(memory_bytes), { 16 * GIB }, 1024 * 1024, 1024 * GIB, NULL,
      "bytes of memory in use at one time" },
    { "image-pixels", PELL_KNOB_INT64, "px", AT(image_pixels), { 16384.0 * 16384.0 }, 1, 65536.0 * 65536.0, NULL, "pixels of one image" },
    { "vertices", PELL_KNOB_INT64, "1", AT(vertices), { 1e8 }, 3, 2147483647, NULL, "vertices of a scene, counted after instancing" },
    { "triangles", PELL_KNOB_INT64, "1", AT(triangles), { 1e8 }, 1, 715827882, NULL, "triangles of a scene, counted after instancing" },
    { "nodes", PELL_KNOB_INT, "1", AT(nodes), { 1e6 }, 1, 1e8, NULL, "nodes of one file, and visits of nodes in its hierarchy" },
    { "depth", PELL_KNOB_INT, "1", AT(depth), { 256 }, 1, 1500, NULL, "levels of a node hierarchy" },
    { "items", PELL_KNOB_INT, "1", AT(items), { 1e6 }, 1, 1e8, NULL, "meshes, materials, textures, accessors or lights of one file, each" },
    { "warnings", PELL_KNOB_INT, "1", AT(warnings), { 20 }, 1, 1e6, NULL,
      "warnings of one kind that are printed before the rest is counted" },
    {0},
};
/* clang-format on */
#undef AT

const struct pell_knob *pell_limit_knobs(void)
{
    return limit_knobs;
}

const char *pell_result_name(enum pell_result result)
{
    switch (result) {
    case PELL_OK: return "ok";
    case PELL_ERR_INVALID: return "invalid value";
    case PELL_ERR_NOMEM: return "out of memory";
    case PELL_ERR_IO: return "input or output failed";
    case PELL_ERR_FORMAT: return "damaged file";
    case PELL_ERR_UNSUPPORTED: return "not supported";
    case PELL_ERR_DEVICE: return "engine or device not available";
    case PELL_ERR_CANCELLED: return "cancelled";
    }
    return "unknown result";
}

static void *libc_alloc(void *user, size_t size)
{
    void *ptr = NULL;
    (void) user;
    return posix_memalign(&ptr, 64, size) == 0 ? ptr : NULL;
}

static void libc_free(void *user, void *ptr)
{
    (void) user;
    free(ptr);
}

/* A program built against another version has another layout of the parameters: only the first members are read. */
static enum pell_result other_version(int headers, const struct pell_context_params *params)
{
    char what[160];
    const struct pell_message m = { PELL_LOG_ERROR, PELL_ERR_UNSUPPORTED, "pellucid", what,
                                    "recompile the program with the headers of the library that it runs with" };

    if (headers < 0)
        snprintf(what, sizeof(what), "%d is no version of headers, the library is %s", headers, pell_version_string());
    else
        snprintf(what, sizeof(what), "the program was built with headers of version %d.%d.%d, the library is %s", headers / 1000000,
                 headers / 1000 % 1000, headers % 1000, pell_version_string());
    if (params && params->log)
        params->log(params->log_user, &m);
    return PELL_ERR_UNSUPPORTED;
}

enum pell_result pell_context_create_for(int headers, const struct pell_context_params *params, struct pell_context **out)
{
    if (!out)
        return PELL_ERR_INVALID;

    static const struct pell_context_params none;
    struct pell_allocator allocator = { libc_alloc, libc_free, NULL };
    struct pell_context *ctx;

    *out = NULL;
    if (!pell_version_compatible(headers))
        return other_version(headers, params);
    if (!params)
        params = &none;
    if (!params->allocator.alloc != !params->allocator.free)
        return PELL_ERR_INVALID;
    if (params->allocator.alloc)
        allocator = params->allocator;
    ctx = allocator.alloc(allocator.user, sizeof(*ctx));
    if (!ctx)
        return PELL_ERR_NOMEM;
    memset(ctx, 0, sizeof(*ctx));
    if (pthread_mutex_init(&ctx->log_lock, NULL) != 0) {
        allocator.free(allocator.user, ctx);
        return PELL_ERR_NOMEM;
    }
    ctx->allocator = allocator;
    ctx->plain = !params->allocator.alloc;
    ctx->log = params->log;
    ctx->log_user = params->log_user;
    ctx->log_level = params->log_level ? params->log_level : PELL_LOG_INFO;
    ctx->progress = params->progress;
    ctx->progress_user = params->progress_user;
    pell_knobs_default(pell_limit_knobs(), &ctx->limits);
    if (params->limits) {
        if (pell_knobs_check(ctx, pell_limit_knobs(), "limits", params->limits) != PELL_OK) {
            pell_context_destroy(&ctx);
            return PELL_ERR_INVALID;
        }
        ctx->limits = *params->limits;
    }
    *out = ctx;
    return PELL_OK;
}

void pell_context_destroy(struct pell_context **ctx)
{
    struct pell_context *c = *ctx;
    if (!c)
        return;
    *ctx = NULL;
    pthread_mutex_destroy(&c->log_lock);
    if (c->files)
        c->allocator.free(c->allocator.user, c->files);
    c->allocator.free(c->allocator.user, c);
}

void pell_context_cancel(struct pell_context *ctx)
{
    atomic_store(&ctx->cancelled, true);
}

void pell_context_resume(struct pell_context *ctx)
{
    atomic_store(&ctx->cancelled, false);
}

void pell_context_interrupt(struct pell_context *ctx)
{
    unsigned interruptible = atomic_load(&ctx->interruptible);

    while (interruptible >= 2)
        if (atomic_compare_exchange_weak(&ctx->interruptible, &interruptible, interruptible | 1))
            return;
    atomic_store(&ctx->cancelled, true);
}

bool pell_context_interrupted(const struct pell_context *ctx)
{
    return atomic_load_explicit(&ctx->interruptible, memory_order_relaxed) & 1;
}

void pell_interruptible(struct pell_context *ctx, int change)
{
    unsigned interruptible = atomic_load(&ctx->interruptible), next;

    do /* the first of several sections clears an earlier request to end */
        next = (change > 0 && interruptible < 2 ? 0 : interruptible) + 2 * (unsigned) change;
    while (!atomic_compare_exchange_weak(&ctx->interruptible, &interruptible, next));
}

const struct pell_limits *pell_context_limits(const struct pell_context *ctx)
{
    return &ctx->limits;
}
