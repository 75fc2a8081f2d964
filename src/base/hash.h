/* SPDX-License-Identifier: MIT
 *
 * hash.h - 64-bit hashes of content, for metadata and checkpoint files; 32-bit hashes for sample patterns. Not cryptographic.
 */
#ifndef PELL_HASH_H
#define PELL_HASH_H

#include "shared/hash.h"

#include <stddef.h>
#include <stdint.h>
#include <string.h>

/* Words are mixed by a multiplication with an odd constant and a shift. */
static inline uint64_t pell_hash_word(uint64_t hash, uint64_t word)
{
    hash = (hash ^ word) * 0x9e3779b97f4a7c15u;
    return hash ^ hash >> 32;
}

/* The size is hashed, too. */
static inline uint64_t pell_hash_bytes(uint64_t hash, const void *data, size_t size)
{
    const char *bytes = (const char *) data;
    uint64_t word;

    for (hash = pell_hash_word(hash, size); size >= sizeof(word); size -= sizeof(word), bytes += sizeof(word)) {
        memcpy(&word, bytes, sizeof(word));
        hash = pell_hash_word(hash, word);
    }
    word = 0;
    if (size > 0)
        memcpy(&word, bytes, size);
    return pell_hash_word(hash, word);
}

/* Hashes the value, so that -0 equals 0. */
static inline uint64_t pell_hash_number(uint64_t hash, double value)
{
    value += 0.0;
    return pell_hash_bytes(hash, &value, sizeof(value));
}

#endif
