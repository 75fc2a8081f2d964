/* SPDX-License-Identifier: MIT
 *
 * log.c - log messages, progress and cancellation of a context.
 */
#include "base/context.h"

#include <stdio.h>

bool pell_cancelled(const struct pell_context *ctx)
{
    return atomic_load_explicit(&ctx->cancelled, memory_order_relaxed);
}

/* True if the limit of this kind of warning is reached. *first: when it is reached for the first time. */
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

    if (ctx && level == PELL_LOG_ERROR && code != PELL_ERR_NOMEM && code != PELL_ERR_CANCELLED && atomic_load(&ctx->downgrades) > 0) {
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
                                                         "show more with --limit warnings=N" });
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

enum pell_result pell_null(struct pell_context *ctx, const char *function)
{
    return pell_error(ctx, PELL_ERR_INVALID, function, NULL, "an argument is NULL, but must not be");
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

void pell_log_downgrade(struct pell_context *ctx, int change)
{
    atomic_fetch_add(&ctx->downgrades, change);
}

void pell_progress(struct pell_context *ctx, const char *task, double fraction)
{
    if (ctx->progress)
        ctx->progress(ctx->progress_user, task, fraction);
}
