/* SPDX-License-Identifier: MIT
 * slow.h - SLOW is 1 under the address and thread sanitizers, which make everything some five times slower: tests with very many cases
 * try fewer there. Also the clock for time limits, which excludes other work of the machine. */
#ifndef PELL_TEST_SLOW_H
#define PELL_TEST_SLOW_H

#include <time.h>

#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
#define SLOW 1
#elif defined(__has_feature)
#if __has_feature(address_sanitizer) || __has_feature(thread_sanitizer)
#define SLOW 1
#endif
#endif
#ifndef SLOW
#define SLOW 0
#endif

/* How many standard errors a mean may be off. With few samples even the standard error is unreliable: there a bound on means detects
 * only gross errors, and the same test in a release build detects the others. */
#define SIGMAS (SLOW ? 20.0 : 3.5)

/* Skips a test under the sanitizers: a statistical test, by long renderings whose code other tests execute. */
#define RELEASE_ONLY()                                                                                                                     \
    do {                                                                                                                                   \
        if (SLOW)                                                                                                                          \
            skip();                                                                                                                        \
    } while (0)

/* Processor time of all threads of this test so far. */
static inline double busy_seconds(void)
{
    return (double) clock() / CLOCKS_PER_SEC;
}

#endif
