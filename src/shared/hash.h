/* SPDX-License-Identifier: MIT
 *
 * hash.h - a 32-bit hash for sample patterns.
 */
#ifndef PELL_SHARED_HASH_H
#define PELL_SHARED_HASH_H

#include "shared/language.h"

/* Every output bit depends on all input bits (C. Wellons 2018, "Prospecting for Hash Functions"). */
PELL_SHARED uint32_t pell_hash(uint32_t x)
{
    x ^= x >> 16;
    x *= 0x7feb352du;
    x ^= x >> 15;
    x *= 0x846ca68bu;
    return x ^ x >> 16;
}

#endif
