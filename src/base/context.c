/* SPDX-License-Identifier: MIT
 * context.c - contexts, results, limits and log messages. */
#include "base/context.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define AT(field) offsetof(struct pell_limits, field)
#define GIB (1024.0 * 1024.0 * 1024.0)
const struct pell_knob pell_limit_knobs[] = {
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
    {0}
};
#undef AT

const char *pell_version(void)
{
#define STR_(x) #x
#define STR(x) STR_(x)
    return STR(PELL_VERSION_MAJOR) "." STR(PELL_VERSION_MINOR) "." STR(PELL_VERSION_PATCH);
#undef STR
#undef STR_
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

enum pell_result pell_context_create(const struct pell_context_params *params, struct pell_context **out)
{
    static const struct pell_context_params none;
    struct pell_allocator allocator = { libc_alloc, libc_free, NULL };
    struct pell_context *ctx;

    *out = NULL;
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
    pell_knobs_default(pell_limit_knobs, &ctx->limits);
    if (params->limits) {
        if (pell_knobs_check(ctx, pell_limit_knobs, "limits", params->limits) != PELL_OK) {
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

void pell_context_interrupt(struct pell_context *ctx)
{
    unsigned partial = atomic_load(&ctx->partial);

    while (partial >= 2)
        if (atomic_compare_exchange_weak(&ctx->partial, &partial, partial | 1))
            return;
    atomic_store(&ctx->cancelled, true);
}

bool pell_context_interrupted(const struct pell_context *ctx)
{
    return atomic_load_explicit(&ctx->partial, memory_order_relaxed) & 1;
}

void pell_partial(struct pell_context *ctx, int change)
{
    unsigned partial = atomic_load(&ctx->partial), next;

    do /* the first of several forgets what those before were asked */
        next = (change > 0 && partial < 2 ? 0 : partial) + 2 * (unsigned) change;
    while (!atomic_compare_exchange_weak(&ctx->partial, &partial, next));
}

bool pell_cancelled(const struct pell_context *ctx)
{
    return atomic_load_explicit(&ctx->cancelled, memory_order_relaxed);
}

const struct pell_limits *pell_context_limits(const struct pell_context *ctx)
{
    return &ctx->limits;
}

/* True if this kind of warning has been given as often as the limit allows. *first: for the first time. */
static bool enough(struct pell_context *ctx, const char *format, bool *first)
{
    for (int i = 0; i < PELL_WARNING_KINDS; i++) {
        if (ctx->warned[i].format && ctx->warned[i].format != format)
            continue;
        ctx->warned[i].format = format;
        if (ctx->warned[i].count <= ctx->limits.warnings)
            ctx->warned[i].count++;
        else
            return true;
        *first = ctx->warned[i].count > ctx->limits.warnings;
        return *first;
    }
    return false;
}

static void report(struct pell_context *ctx, enum pell_log_level level, enum pell_result code, const char *where, const char *hint,
                   const char *fmt, va_list args)
{
    char what[2048];
    bool first = false;
    struct pell_message m = { level, code, where ? where : "", what, hint ? hint : "" };

    if (ctx && level == PELL_LOG_ERROR && code != PELL_ERR_NOMEM && code != PELL_ERR_CANCELLED && atomic_load(&ctx->softened) > 0) {
        m.level = level = PELL_LOG_WARNING;
        m.code = PELL_OK;
    }
    if (!ctx || !ctx->log || level > ctx->log_level)
        return;
    vsnprintf(what, sizeof(what), fmt, args);
    pthread_mutex_lock(&ctx->log_lock);
    if (level != PELL_LOG_WARNING || !enough(ctx, fmt, &first))
        ctx->log(ctx->log_user, &m);
    if (first)
        ctx->log(ctx->log_user, &(struct pell_message) { PELL_LOG_WARNING, PELL_OK, "", "further warnings of this kind are not shown",
                                                         "the limit \"warnings\" says how many are" });
    pthread_mutex_unlock(&ctx->log_lock);
}

enum pell_result pell_error(struct pell_context *ctx, enum pell_result code, const char *where, const char *hint, const char *fmt, ...)
{
    va_list args;
    va_start(args, fmt);
    report(ctx, PELL_LOG_ERROR, code, where, hint, fmt, args);
    va_end(args);
    return code;
}

void pell_warn(struct pell_context *ctx, const char *where, const char *hint, const char *fmt, ...)
{
    va_list args;
    va_start(args, fmt);
    report(ctx, PELL_LOG_WARNING, PELL_OK, where, hint, fmt, args);
    va_end(args);
}

void pell_info(struct pell_context *ctx, const char *where, const char *fmt, ...)
{
    va_list args;
    va_start(args, fmt);
    report(ctx, PELL_LOG_INFO, PELL_OK, where, NULL, fmt, args);
    va_end(args);
}

void pell_debug(struct pell_context *ctx, const char *where, const char *fmt, ...)
{
    va_list args;
    va_start(args, fmt);
    report(ctx, PELL_LOG_DEBUG, PELL_OK, where, NULL, fmt, args);
    va_end(args);
}

void pell_soften(struct pell_context *ctx, int change)
{
    atomic_fetch_add(&ctx->softened, change);
}

void pell_progress(struct pell_context *ctx, const char *task, double fraction)
{
    if (ctx->progress)
        ctx->progress(ctx->progress_user, task, fraction);
}
