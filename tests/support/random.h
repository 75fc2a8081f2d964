/* SPDX-License-Identifier: MIT
 * random.h - pseudo-random numbers for tests: SplitMix64 (Steele, Lea and Flood 2014). Accepts any seed. */
#ifndef PELL_TEST_RANDOM_H
#define PELL_TEST_RANDOM_H

#include <stdint.h>

static inline uint64_t random_bits(uint64_t *state)
{
    uint64_t z = *state += 0x9e3779b97f4a7c15u;

    z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9u;
    z = (z ^ (z >> 27)) * 0x94d049bb133111ebu;
    return z ^ (z >> 31);
}

/* In (0, 1). */
static inline double random_unit(uint64_t *state)
{
    return ((double) (random_bits(state) >> 11) + 0.5) * 0x1p-53;
}

#endif
