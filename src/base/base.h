/* SPDX-License-Identifier: MIT
 *
 * base.h - what every room uses: logging, memory, strings, time.
 *
 * Ownership  pell_free takes what pell_alloc and its kin gave, with the same context.
 * Threads    all safe, but for struct pell_text, which belongs to its owner.
 */
#ifndef PELL_BASE_H
#define PELL_BASE_H

#include <pellucid/common.h>
#include <pellucid/context.h>

#include <stdarg.h>
#include <stdatomic.h>

/* Evaluates `expr`; on failure keeps it in `res` (which the function declares) and jumps to its label `fail`. The only macro that
 * hides control flow. */
#define PELL_TRY(expr)                                                                                                                     \
    do {                                                                                                                                   \
        if ((res = (expr)) != PELL_OK)                                                                                                     \
            goto fail;                                                                                                                     \
    } while (0)

#define PELL_COUNT(array) (sizeof(array) / sizeof((array)[0]))

/* --- log.c ------------------------------------------------------------------------------------------------------------------ */

/* Logs an error and returns `code`. `where` and `hint` may be NULL. */
enum pell_result pell_error(struct pell_context *ctx, enum pell_result code, const char *where, const char *hint, const char *fmt, ...)
    PELL_PRINTF(5, 6);
void pell_warn(struct pell_context *ctx, const char *where, const char *hint, const char *fmt, ...) PELL_PRINTF(4, 5);
void pell_info(struct pell_context *ctx, const char *where, const char *fmt, ...) PELL_PRINTF(3, 4);
void pell_debug(struct pell_context *ctx, const char *where, const char *fmt, ...) PELL_PRINTF(3, 4);
/* +1 begins, -1 ends a stretch in which errors but lack of memory are reported as warnings: the caller goes on without what failed. */
void pell_log_downgrade(struct pell_context *ctx, int change);
void pell_progress(struct pell_context *ctx, const char *task, double fraction);
bool pell_cancelled(const struct pell_context *ctx);
/* The same for loops of many millions of steps, which ask it at each of them: it looks at every 2^17th, which is some ms later. */
#define PELL_STEPS_A_LOOK (1u << 17)
static inline bool pell_cancelled_at(const struct pell_context *ctx, uint64_t step)
{
    return step % PELL_STEPS_A_LOOK == 0 && pell_cancelled(ctx);
}

/* --- context.c --------------------------------------------------------------------------------------------------------------- */

/* +1 begins, -1 ends a stretch of work that can end early with a whole result: it asks pell_context_interrupted from time to time. */
void pell_interruptible(struct pell_context *ctx, int change);

/* --- alloc.c: NULL and one logged message where there is no memory or the context's limit is reached ------------------------ */

void *pell_alloc(struct pell_context *ctx, size_t size);                     /* uninitialised, 64-byte aligned; size 0 gives a pointer */
void *pell_zalloc(struct pell_context *ctx, size_t size);                    /* zeroed */
void *pell_calloc(struct pell_context *ctx, size_t count, size_t size);      /* zeroed, checked against overflow */
void *pell_alloc_array(struct pell_context *ctx, size_t count, size_t size); /* uninitialised, checked against overflow */
/* Grows (or shrinks) an array; `ptr` may be NULL. On failure NULL, and `ptr` is still valid. */
void *pell_realloc_array(struct pell_context *ctx, void *ptr, size_t count, size_t size);
void pell_free(struct pell_context *ctx, void *ptr); /* ptr may be NULL */
char *pell_strdup(struct pell_context *ctx, const char *text);
char *pell_strndup(struct pell_context *ctx, const char *text, size_t length);
size_t pell_memory_used(const struct pell_context *ctx); /* bytes allocated now */
/* Whether the system would give so many bytes more, for libraries that do not come back from a failed allocation. No context's limit is
 * asked. True where the system can't be asked. */
bool pell_memory_available(size_t bytes);
uint64_t pell_allocations(const struct pell_context *ctx); /* calls so far: tests that a frame makes none */

/* Makes room for one more in a growing array: doubles *capacity from 8. The element is at array[count]. */
PELL_NODISCARD enum pell_result pell_grow(struct pell_context *ctx, void **array, size_t count, size_t *capacity, size_t size);

/* For tests: an allocator that counts what is live and fails the n-th allocation (counted from 1; 0 never), and every later one
 * too if `sticky`. Zero it, set `fail_at`, hand `pell_failing_allocator(&f)` to a context. */
struct pell_alloc_fault {
    uint64_t fail_at;
    bool sticky;
    _Atomic uint64_t calls;
    _Atomic int64_t live;
};
struct pell_allocator pell_failing_allocator(struct pell_alloc_fault *fault);

/* --- text.c ------------------------------------------------------------------------------------------------------------------ */

/* A fixed-size text that truncates instead of overflowing; for messages and paths of JSON places. */
struct pell_text {
    char str[512];
    size_t length;
};
void pell_text_add(struct pell_text *text, const char *fmt, ...) PELL_PRINTF(2, 3);

/* Adds what of `candidates` (NULL: none at that place) `name` may have meant: the nearest (edit distance with transpositions, case
 * ignored), `did you mean "marble"?`, or those that it is a piece of, `did you mean "skimmilk" or "wholemilk"?`; `before` ("--") stands
 * in front of each. False, and nothing added, where none is near enough. */
bool pell_text_suggest(struct pell_text *text, const char *before, const char *name, const char *const *candidates, size_t count);
/* As pell_text_suggest; all candidates behind `known` ("known keys: ") where none is near enough. */
void pell_text_suggest_or_list(struct pell_text *text, const char *known, const char *name, const char *const *candidates, size_t count);

/* A count and its noun, or noun and verb: pell_counted(1, "edge has", "edges have").str is "1 edge has". It is for every message that may
 * have to say 1. */
struct pell_counted {
    char str[96];
};
struct pell_counted pell_counted(long long count, const char *one, const char *many);

/* ASCII letters become lower case; other bytes stay. */
char pell_lower(char c);

/* Turns user bytes into something safe to print: control and non-UTF-8 bytes become '?', long texts are cut with "...". Returns
 * `buffer`. */
const char *pell_printable(const char *text, char *buffer, size_t size);

/* Locale-independent number parser over exactly `length` bytes (no leading or trailing space, no hex, no nan or inf): false if the
 * text is not wholly a finite number. */
bool pell_parse_number(const char *text, size_t length, double *value);
bool pell_parse_int(const char *text, size_t length, int64_t *value);

/* The shortest text that pell_parse_number reads back as this value (as this float, if `single`), in any locale; 40 bytes always do.
 * Returns `buffer`. */
const char *pell_format_number(double value, bool single, char *buffer, size_t size);

/* "70mm", "7 cm", "0.07m", "1e3um", "2in" -> mm. PELL_ERR_INVALID (logged against `where`) for a bare number, an unknown unit or a
 * value that is not finite and positive. The only parser of lengths. */
PELL_NODISCARD enum pell_result pell_parse_length(struct pell_context *ctx, const char *where, const char *text, double *mm);

/* --- time.c ------------------------------------------------------------------------------------------------------------------ */

double pell_seconds(void); /* monotonic */

#endif
