/* SPDX-License-Identifier: MIT
 * pell_test.h - cmocka, and helpers shared by all tests. One program per module; each prints TAP.
 *
 * Files of the project (tests/expect, data) are found through PELL_ROOT, which the build sets; a missing one is a failure. Meshes and
 * images of third parties are found through PELL_SHARED (set where ../shared exists); a test that needs an absent one skips by name. */
#ifndef PELL_TEST_H
#define PELL_TEST_H

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <math.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "base/base.h"

/* |a - b| <= tolerance, with both values printed. */
#define REQUIRE_NEAR(a, b, tolerance)                                                                                                      \
    do {                                                                                                                                   \
        const double a_ = (a), b_ = (b), t_ = (tolerance);                                                                                 \
        if (!(fabs(a_ - b_) <= t_))                                                                                                        \
            fail_msg("%s = %.12g, %s = %.12g: differ by %.3g, allowed %.3g", #a, a_, #b, b_, fabs(a_ - b_), t_);                           \
    } while (0)

/* |a - b| <= tolerance |b|. */
#define REQUIRE_REL(a, b, tolerance) REQUIRE_NEAR(a, b, (tolerance) *fabs(b))

#define REQUIRE(expr)                                                                                                                      \
    do {                                                                                                                                   \
        if (!(expr))                                                                                                                       \
            fail_msg("%s does not hold", #expr);                                                                                           \
    } while (0)

/* "ROOT/NAME" in one of a few static buffers; ROOT is the environment variable's value, or `otherwise` where it is not set. */
static inline const char *test_path(const char *variable, const char *otherwise, const char *name)
{
    static char buffers[8][1024];
    static int next;
    char *path = buffers[next++ % 8];
    const char *root = getenv(variable);

    snprintf(path, sizeof(buffers[0]), "%s/%s", root ? root : otherwise, name);
    return path;
}

/* The path of a file of the project, "tests/expect/...". A program that is started by hand finds it from the root of the repository. */
static inline const char *project_file(const char *name)
{
    return test_path("PELL_ROOT", ".", name);
}

/* The path of a file below ../shared; skips the running test, with the name, if it is not there. */
static inline const char *shared_file(const char *name)
{
    const char *path = test_path("PELL_SHARED", "../shared", name);

    if (access(path, R_OK) != 0) {
        print_message("# skipped: %s is not here\n", name);
        skip();
    }
    return path;
}

/* Keeps the last error and counts messages, for tests of refusals. Set `.log = keep_message, .log_user = &kept`. */
struct kept_messages {
    int errors, warnings;
    enum pell_result code;
    char where[512], what[1024], hint[512];      /* of the last error */
    char last_warning[1024], all_warnings[4096]; /* a line each */
};

static inline void keep_message(void *user, const struct pell_message *m)
{
    struct kept_messages *k = user;
    size_t n;

    if (m->level == PELL_LOG_ERROR) {
        k->errors++;
        k->code = m->code;
        snprintf(k->where, sizeof(k->where), "%s", m->where);
        snprintf(k->what, sizeof(k->what), "%s", m->what);
        snprintf(k->hint, sizeof(k->hint), "%s", m->hint);
    } else if (m->level == PELL_LOG_WARNING) {
        k->warnings++;
        snprintf(k->last_warning, sizeof(k->last_warning), "%s: %s", m->where, m->what);
        n = strlen(k->all_warnings);
        snprintf(k->all_warnings + n, sizeof(k->all_warnings) - n, "%s: %s\n", m->where, m->what);
    }
}

/* The next allocation to fail after the nth one: each of the first, then increasingly sparse, since later ones mostly come from the same
 * code. */
static inline uint64_t next_allocation(uint64_t n)
{
    return n + 1 + n / 6;
}

/* A context whose allocator counts and whose messages are kept; `fault` and `kept` may be NULL. */
static inline struct pell_context *test_context(struct pell_alloc_fault *fault, struct kept_messages *kept)
{
    struct pell_context_params params = { 0 };
    struct pell_context *ctx;
    if (fault)
        params.allocator = pell_failing_allocator(fault);
    if (kept) {
        params.log = keep_message;
        params.log_user = kept;
    }
    return pell_context_create(&params, &ctx) == PELL_OK ? ctx : NULL;
}

#endif
