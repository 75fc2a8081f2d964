/* SPDX-License-Identifier: MIT
 *
 * base.h - utilities of every module: logging, memory, strings, time.
 *
 * Ownership  pell_free releases memory of pell_alloc and its variants, with the same context.
 * Threads    all safe, but for struct pell_text, which belongs to its owner.
 */
#ifndef PELL_BASE_H
#define PELL_BASE_H

#include <pellucid/common.h>
#include <pellucid/context.h>

#include <stdarg.h>
#include <stdatomic.h>

/* Evaluates `expr`; on failure stores it in `res` (which the function declares) and jumps to its label `fail`. The only macro that hides
 * control flow. */
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
/* Logs that a public function was given NULL where it must not be, and returns PELL_ERR_INVALID. `ctx` may be NULL, too: no message. */
enum pell_result pell_null(struct pell_context *ctx, const char *function);
/* The hint of an error over a limit of pell_limit_knobs, by its name (a string literal). */
#define PELL_RAISE_LIMIT(name) "raise the limit: --limit " name "=N"
void pell_warn(struct pell_context *ctx, const char *where, const char *hint, const char *fmt, ...) PELL_PRINTF(4, 5);
void pell_info(struct pell_context *ctx, const char *where, const char *fmt, ...) PELL_PRINTF(3, 4);
void pell_debug(struct pell_context *ctx, const char *where, const char *fmt, ...) PELL_PRINTF(3, 4);
/* +1 begins, -1 ends a section in which errors other than lack of memory are reported as warnings, as the caller continues without the
 * failed part. */
void pell_log_downgrade(struct pell_context *ctx, int change);
void pell_progress(struct pell_context *ctx, const char *task, double fraction);
bool pell_cancelled(const struct pell_context *ctx);
/* The same for loops of many millions of steps that call it at every step: it checks at every 2^17th, which is some ms later. */
#define PELL_CANCEL_INTERVAL (1u << 17)
static inline bool pell_cancelled_at(const struct pell_context *ctx, uint64_t step)
{
    return step % PELL_CANCEL_INTERVAL == 0 && pell_cancelled(ctx);
}

/* --- context.c --------------------------------------------------------------------------------------------------------------- */

/* +1 begins, -1 ends a section of work that can end early with a complete result: it polls pell_context_interrupted. */
void pell_interruptible(struct pell_context *ctx, int change);

/* --- alloc.c: NULL and one logged message if memory is out or the context's limit is reached ------------------------ */

void *pell_alloc(struct pell_context *ctx, size_t size);                     /* uninitialised, 64-byte aligned; size 0 gives a pointer */
void *pell_zalloc(struct pell_context *ctx, size_t size);                    /* zeroed */
void *pell_calloc(struct pell_context *ctx, size_t count, size_t size);      /* zeroed, checked against overflow */
void *pell_alloc_array(struct pell_context *ctx, size_t count, size_t size); /* uninitialised, checked against overflow */
/* Grows (or shrinks) an array; `ptr` may be NULL. On failure NULL, and `ptr` is still valid. */
void *pell_realloc_array(struct pell_context *ctx, void *ptr, size_t count, size_t size);
void pell_free(struct pell_context *ctx, void *ptr); /* ptr may be NULL */
char *pell_strdup(struct pell_context *ctx, const char *text);
char *pell_strndup(struct pell_context *ctx, const char *text, size_t length);
size_t pell_memory_used(const struct pell_context *ctx); /* bytes currently allocated */
/* Whether the system can provide so many more bytes, for libraries that do not survive a failed allocation. Ignores the context's limit.
 * True if the system can't be queried. */
bool pell_memory_available(size_t bytes);
uint64_t pell_allocations(const struct pell_context *ctx); /* number of calls so far: tests check that a frame makes none */

/* Makes room for one more element in a growing array: doubles *capacity from 8. The new element is at array[count]. */
PELL_NODISCARD enum pell_result pell_grow(struct pell_context *ctx, void **array, size_t count, size_t *capacity, size_t size);

/* For tests: an allocator that counts live blocks and fails the n-th allocation (counted from 1; 0 never), and every later one too if
 * `sticky`. Zero it, set `fail_at`, pass `pell_failing_allocator(&f)` to a context. */
struct pell_alloc_fault {
    uint64_t fail_at;
    bool sticky;
    _Atomic uint64_t calls;
    _Atomic int64_t live;
};
struct pell_allocator pell_failing_allocator(struct pell_alloc_fault *fault);

/* --- text.c ------------------------------------------------------------------------------------------------------------------ */

/* A fixed-size text that truncates instead of overflowing; for messages and JSON pointers. */
struct pell_text {
    char str[512];
    size_t length;
};
void pell_text_add(struct pell_text *text, const char *fmt, ...) PELL_PRINTF(2, 3);
/* Adds the path of a file and what follows it (`separator`, ": "); `instead` if the path is empty: what is in memory comes from no file. */
void pell_text_add_path(struct pell_text *text, const char *path, const char *separator, const char *instead);

/* Adds a suggestion for `name` from `candidates` (NULL entries are skipped): the nearest (edit distance with transpositions, case ignored),
 * `did you mean "marble"?`, or those that contain it, `did you mean "skimmilk" or "wholemilk"?`; each prefixed by `prefix` ("--"). False,
 * and nothing added, if none is close enough. */
bool pell_text_suggest(struct pell_text *text, const char *prefix, const char *name, const char *const *candidates, size_t count);
/* As pell_text_suggest; if none is close enough, lists all candidates after `known` ("known keys: "). */
void pell_text_suggest_or_list(struct pell_text *text, const char *known, const char *name, const char *const *candidates, size_t count);

/* A count and its noun, or noun and verb: pell_counted(1, "edge has", "edges have").str is "1 edge has". For every message whose count may
 * be 1. */
struct pell_counted {
    char str[96];
};
struct pell_counted pell_counted(long long count, const char *one, const char *many);

/* Converts ASCII letters to lower case; other bytes are unchanged. */
char pell_lower(char c);

/* Whether `text`, which is not empty, contains `part`; case ignored. */
bool pell_text_contains(const char *text, const char *part);

/* Makes user bytes safe to print: control and non-UTF-8 bytes become '?', long texts are cut with "...". Returns `buffer`. */
const char *pell_printable(const char *text, char *buffer, size_t size);

/* Locale-independent number parser over exactly `length` bytes (no leading or trailing space, no hex, no nan or inf): false unless the
 * whole text is a finite number. */
bool pell_parse_number(const char *text, size_t length, double *value);
bool pell_parse_int(const char *text, size_t length, int64_t *value);

/* The shortest text that pell_parse_number reads back as this value (as this float, if `single`), in any locale; 40 bytes are always
 * enough. Returns `buffer`. */
const char *pell_format_number(double value, bool single, char *buffer, size_t size);

/* "70mm", "7 cm", "0.07m", "1e3um", "2in" -> mm. PELL_ERR_INVALID (logged against `where`) for a bare number, an unknown unit or a
 * value that is not finite and positive. The only parser of lengths. */
PELL_NODISCARD enum pell_result pell_parse_length(struct pell_context *ctx, const char *where, const char *text, double *mm);

/* --- time.c ------------------------------------------------------------------------------------------------------------------ */

double pell_seconds(void); /* monotonic */

#endif
