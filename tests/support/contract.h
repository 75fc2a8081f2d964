/* SPDX-License-Identifier: MIT
 * contract.h - a contract for every method of the registry on each of its engines: one test per property ("promise"), method and engine,
 * so that newly listed methods are tested automatically.
 *
 * Known violations are listed in a table of exceptions, with the reason, and reported as skipped. They are executed all the same: an
 * exception that no longer applies fails. */
#ifndef PELL_CONTRACT_H
#define PELL_CONTRACT_H

#include "pell_test.h"

#include <pellucid/device.h>
#include <pellucid/method.h>

#include <sys/wait.h>

enum { CONTRACT_MOST = 1024 };

struct promise {
    const char *name;
    void (*keep)(void **state); /* *state: the method under test, a struct party */
    bool anywhere;              /* also applies to methods that are unfit for the others */
    bool once;                  /* the same in all builds of the test: executed in one of them */
};

struct promise_exception {
    const char *method, *promise, *why;
};

struct contract {
    const struct promise *promises;             /* ends with {0} */
    const struct promise_exception *exceptions; /* ends with {0} */
    const char *(*unfit)(
        const struct pell_method *m); /* the reason why a method is tested only for `anywhere`; else NULL. NULL: all methods are fit */
    void (*refuse)(void **state);     /* how an unfit method reports that; may be NULL */
    bool again;                       /* another build tests the promises that are the same in all builds */
};

struct party {
    const struct pell_method *method;
    enum pell_engine engine;
    const struct promise *promise;
    const char *why; /* the reason of the exception; or why there is nothing to test, where `promise` is NULL */
    void (*refuse)(void **state);
    char name[160];
};

/* Executes a known failure in a child process, which may crash. */
static inline bool promise_is_kept(void **state)
{
    int status = 1;
    pid_t child;

    fflush(stdout);
    fflush(stderr);
    child = fork();
    REQUIRE(child >= 0);
    if (child == 0) {
        setenv("CMOCKA_TEST_ABORT", "1", 1);
        if (!freopen("/dev/null", "w", stdout) || !freopen("/dev/null", "w", stderr))
            _exit(2);
        ((const struct party *) *state)->promise->keep(state);
        _exit(0);
    }
    REQUIRE(waitpid(child, &status, 0) == child);
    return WIFEXITED(status) && WEXITSTATUS(status) == 0;
}

static inline void contract_test(void **state)
{
    const struct party *const p = *state;

    if (p->refuse)
        p->refuse(state);
    if (p->promise && !p->why) {
        p->promise->keep(state);
    } else if (p->promise && promise_is_kept(state)) {
        fail_msg("%s: drop it from the exceptions, it is kept", p->name);
    } else {
        print_message("# skipped: %s\n", p->why);
        skip();
    }
}

/* NULL: a device with this engine exists; else the reason why not. */
static inline const char *engine_lacks(enum pell_engine engine)
{
    static struct kept_messages kept;
    struct pell_context *ctx = test_context(NULL, &kept);
    struct pell_device *device;
    const enum pell_result res = pell_device_create(ctx, &(struct pell_device_params) { .threads = 1, .engine = engine }, &device);

    pell_device_destroy(&device);
    pell_context_destroy(&ctx);
    return res == PELL_OK ? NULL : kept.what;
}

static inline bool method_has(const struct pell_method *m, enum pell_engine engine)
{
    return engine == PELL_ENGINE_CPU ? m->cpu != NULL : engine == PELL_ENGINE_VULKAN && m->vulkan;
}

/* The tests of a run, in the order in which they are listed. */
struct contract_list {
    struct CMUnitTest tests[CONTRACT_MOST]; /* cmocka skips entries without a function */
    struct party parties[CONTRACT_MOST];
    size_t count;
};

static inline void contract_add(struct contract_list *list, struct party p, const char *what)
{
    struct party *kept = &list->parties[list->count];

    if (list->count == CONTRACT_MOST) {
        print_error("more than %d promises\n", CONTRACT_MOST);
        exit(1);
    }
    *kept = p;
    snprintf(kept->name, sizeof(kept->name), "%s%s%s %s", what, what[0] && p.method ? " " : "", p.method ? p.method->name : "",
             pell_engine_name(p.engine));
    list->tests[list->count++] = (struct CMUnitTest) { .name = kept->name, .test_func = contract_test, .initial_state = kept };
}

static inline const char *exception_to(const struct contract *c, const char *method, const char *promise)
{
    for (const struct promise_exception *e = c->exceptions; e && e->method; e++)
        if (strcmp(e->method, method) == 0 && strcmp(e->promise, promise) == 0)
            return e->why;
    return NULL;
}

static inline bool is_tested(const char *name, int count, char **names)
{
    for (int i = 1; i < count; i++)
        if (strcmp(names[i], name) == 0)
            return true;
    return count < 2;
}

static inline void contract_list_engine(const struct contract *c, enum pell_engine engine, int argc, char **argv,
                                        struct contract_list *list)
{
    for (size_t i = 0; i < pell_method_count(); i++) {
        struct party p = { .method = pell_method_at(i), .engine = engine };
        const char *unfit = c->unfit ? c->unfit(p.method) : NULL;

        p.why = method_has(p.method, engine) ? unfit : "it has no such engine";
        p.refuse = unfit && method_has(p.method, engine) ? c->refuse : NULL;
        if (p.why)
            contract_add(list, p, "");
        p.refuse = NULL;
        for (p.promise = c->promises; method_has(p.method, engine) && p.promise->name; p.promise++) {
            p.why = exception_to(c, p.method->name, p.promise->name);
            if (is_tested(p.promise->name, argc, argv) && (!unfit || p.promise->anywhere) && !(c->again && p.promise->once))
                contract_add(list, p, p.promise->name);
        }
    }
}

/* Exceptions and arguments must name existing promises and methods. */
static inline bool contract_is_whole(const struct contract *c, int argc, char **argv)
{
    bool whole = true;

    for (const struct promise_exception *e = c->exceptions; e && e->method; e++) {
        const struct promise *p = c->promises;
        while (p->name && strcmp(p->name, e->promise) != 0)
            p++;
        if (!p->name || !pell_method_find(NULL, "test", e->method)) {
            print_error("the exceptions name %s %s, which is not there\n", e->method, e->promise);
            whole = false;
        }
    }
    for (int i = 1; i < argc; i++) {
        const struct promise *p = c->promises;
        while (p->name && strcmp(p->name, argv[i]) != 0)
            p++;
        if (!p->name)
            print_error("there is no promise %s\n", argv[i]);
        whole = whole && p->name;
    }
    return whole;
}

/* main: every promise, or those named by the arguments. */
static inline int contract_run(const struct contract *c, int argc, char **argv)
{
    static struct contract_list list;

    if (!contract_is_whole(c, argc, argv))
        return 1;
    for (enum pell_engine e = PELL_ENGINE_CPU; strcmp(pell_engine_name(e), "unknown") != 0; e = (enum pell_engine)(e + 1)) {
        const char *lacks = engine_lacks(e);
        if (lacks)
            contract_add(&list, (struct party) { .engine = e, .why = lacks }, "engine");
        else
            contract_list_engine(c, e, argc, argv, &list);
    }
    return cmocka_run_group_tests(list.tests, NULL, NULL);
}

#endif
