/* SPDX-License-Identifier: MIT
 *
 * slow.h - SLOW is 1 under the address and thread sanitizers, which make everything some five times slower: tests that try very many
 * things try fewer there. */
#ifndef PELL_TEST_SLOW_H
#define PELL_TEST_SLOW_H

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

#endif
