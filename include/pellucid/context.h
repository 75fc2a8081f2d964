/* SPDX-License-Identifier: MIT
 *
 * pellucid/context.h - the log, the allocator and the limits. The library has no global state besides it.
 *
 * Units      bytes, pixels and counts, as each limit says.
 * Ownership  `pell_context_create` transfers the context to the caller, `pell_context_destroy` releases it. Everything that was
 *            created with a context must be destroyed before it. Callbacks and their user pointers are borrowed for the context's life.
 * Errors     enum pell_result; logged once by the function that detects them.
 * Threads    a context may be used by many threads at once; the log callback is called under a lock, one message at a time.
 */
#ifndef PELLUCID_CONTEXT_H
#define PELLUCID_CONTEXT_H

#include <pellucid/common.h>
#include <pellucid/knob.h>
#include <pellucid/version.h>

#ifdef __cplusplus
extern "C" {
#endif

enum pell_log_level {
    PELL_LOG_NONE = 0, /* as a threshold: nothing is reported */
    PELL_LOG_ERROR,    /* the call fails */
    PELL_LOG_WARNING,  /* the call continues, the result may not be as intended */
    PELL_LOG_INFO,     /* progress or a decision that a user may want to know */
    PELL_LOG_DEBUG,
};

/* One message. All strings are valid during the callback only and never NULL. */
struct pell_message {
    enum pell_log_level level;
    enum pell_result code; /* PELL_OK unless level is PELL_LOG_ERROR */
    const char *where;     /* "head.gltf:/meshes/0/primitives/1", "bunny.obj:17", "--set"; may be "" */
    const char *what;      /* one sentence with the value found and what is allowed */
    const char *hint;      /* a remedy; may be "" */
};

typedef void (*pell_log_fn)(void *user, const struct pell_message *message);

/* `fraction` in [0, 1] of the work called `task`. Called from the thread that called the library, at most some tens of times a second. */
typedef void (*pell_progress_fn)(void *user, const char *task, double fraction);

/* Either both functions or neither (then the C library's). `alloc` returns memory aligned to 64 bytes, or NULL. Must be thread-safe. */
struct pell_allocator {
    void *(*alloc)(void *user, size_t size);
    void (*free)(void *user, void *ptr);
    void *user;
};

/* Limits on the resources that files may make the library use. Defaults, ranges and help: pell_limit_knobs(). */
struct pell_limits {
    int64_t file_bytes;   /* of one file */
    int64_t memory_bytes; /* total that a context has allocated at one time */
    int64_t image_pixels; /* of one image */
    int64_t vertices;     /* of a scene, after instancing */
    int64_t triangles;    /* of a scene, after instancing */
    int nodes;            /* of one file, and after instancing */
    int depth;            /* of hierarchies and of nested JSON */
    int items;            /* meshes, materials, textures, accessors, lights: of each kind */
    int warnings;         /* logged messages of one kind; the rest is counted */
};

/* The rows of struct pell_limits, ending with {0}. Constant data; thread-safe. */
PELL_API const struct pell_knob *pell_limit_knobs(void);

struct pell_context_params {
    pell_log_fn log; /* may be NULL; it and its user pointer stay first in every version */
    void *log_user;
    enum pell_log_level log_level; /* messages above it are not reported; 0: PELL_LOG_INFO if there is a log */
    pell_progress_fn progress;     /* may be NULL */
    void *progress_user;
    struct pell_allocator allocator;  /* {0}: the C library's */
    const struct pell_limits *limits; /* copied; NULL: the defaults */
};

struct pell_context;

/* The same as pell_context_create, for a program built with headers of version `headers` (a PELL_VERSION_NUMBER). Bindings to other
 * languages call it with the version that they were written for; C and C++ programs call pell_context_create. */
PELL_API PELL_NODISCARD enum pell_result pell_context_create_for(int headers, const struct pell_context_params *params,
                                                                 struct pell_context **out);

/* Creates a context in *out, NULL on failure; `params` may be NULL. PELL_ERR_UNSUPPORTED, logged, if the running library does not
 * accept programs built with these headers (pellucid/version.h); PELL_ERR_INVALID: one function of the allocator without the other, or
 * limits out of range; PELL_ERR_NOMEM. Thread-safe. */
static inline PELL_NODISCARD enum pell_result pell_context_create(const struct pell_context_params *params, struct pell_context **out)
{
    return pell_context_create_for(PELL_VERSION_NUMBER, params, out);
}

/* Sets *ctx to NULL; destroying &(NULL) does nothing. */
PELL_API void pell_context_destroy(struct pell_context **ctx);

/* Running and later calls with this context return PELL_ERR_CANCELLED at their next check of the flag. Async-signal-safe. */
PELL_API void pell_context_cancel(struct pell_context *ctx);
/* Clears a cancellation after the cancelled calls have returned, so that the context can be used again. Thread-safe. */
PELL_API void pell_context_resume(struct pell_context *ctx);

/* For Ctrl-C. A running render of an interruptible method (pell_method.partial) ends soon with a partial result
 * (pell_render_result.partial), and later calls are not affected; otherwise the same as pell_context_cancel. Async-signal-safe. */
PELL_API void pell_context_interrupt(struct pell_context *ctx);
/* Whether the running render was interrupted; without a running render, whether the last interruptible render was. Thread-safe. */
PELL_API bool pell_context_interrupted(const struct pell_context *ctx);

/* The limits that the context was created with, valid as long as the context. Thread-safe. */
PELL_API const struct pell_limits *pell_context_limits(const struct pell_context *ctx);

#ifdef __cplusplus
}
#endif
#endif
