/* SPDX-License-Identifier: MIT
 *
 * sampler.h - random numbers of one sample of one pixel: the first dimensions are quasi-random over the samples, the others pseudo-random.
 *
 * Pairs of the first two Sobol dimensions, each pair independently shuffled and Owen-scrambled (pell_owen_scramble).
 */
#ifndef PELL_PATH_TRACE_SAMPLER_H
#define PELL_PATH_TRACE_SAMPLER_H

#include "math/sampling.h"

#define PT_QUASI_RANDOM_NUMBERS 16

struct pt_sampler {
    uint64_t state;
    uint32_t index, pattern; /* of the sample, of the pixel */
    uint32_t at;             /* dimensions used so far */
    float second;            /* second number of a pair */
};

static inline uint64_t pt_mix(uint64_t z)
{
    z = (z ^ z >> 30) * 0xbf58476d1ce4e5b9u;
    z = (z ^ z >> 27) * 0x94d049bb133111ebu;
    return z ^ z >> 31;
}

/* `stream`: independent sequences of one pixel, for instance for light paths. */
static inline struct pt_sampler pt_sampler_start(uint32_t seed, uint32_t pixel, uint32_t sample, uint32_t stream)
{
    struct pt_sampler s = { .index = sample, .at = 0, .second = 0.0f };

    s.pattern = pell_hash(pixel ^ pell_hash(seed ^ pell_hash(stream)));
    s.state = pt_mix((uint64_t) s.pattern << 32 | sample) ^ pt_mix((uint64_t) pixel << 32 | (seed ^ stream * 0x9e3779b9u));
    return s;
}

/* Steele et al. 2014, "Fast Splittable Pseudorandom Number Generators". */
static inline uint32_t pt_bits(struct pt_sampler *s)
{
    return (uint32_t) (pt_mix(s->state += 0x9e3779b97f4a7c15u) >> 32);
}

static inline float pt_quasi_random(struct pt_sampler *s)
{
    uint32_t seed, i;

    if (s->at++ & 1)
        return s->second;
    seed = pell_hash(s->pattern + s->at);
    i = pell_owen_scramble(s->index, seed);
    s->second = pell_unit_float(pell_owen_scramble(pell_sobol1(i), pell_hash(seed ^ 0xb5297a4du)));
    return pell_unit_float(pell_owen_scramble(pell_sobol0(i), pell_hash(seed ^ 0x68e31da4u)));
}

/* In (0, 1), with 32 bits, for tails of distributions. */
static inline double pt_fine(struct pt_sampler *s)
{
    return ((double) pt_bits(s) + 0.5) * 0x1p-32;
}

/* In (0, 1], with 31 bits: the argument of a logarithm. */
static inline float pt_chance_of(uint32_t bits)
{
    return ((float) (int32_t) (bits >> 1) + 0.5f) * 0x1p-31f;
}

static inline float pt_chance(struct pt_sampler *s)
{
    return s->at < PT_QUASI_RANDOM_NUMBERS ? 1.0f - pt_quasi_random(s) : pt_chance_of(pt_bits(s));
}

/* In [0, 1). */
static inline float pt_random(struct pt_sampler *s)
{
    return s->at < PT_QUASI_RANDOM_NUMBERS ? pt_quasi_random(s) : pell_unit_float(pt_bits(s));
}

/* Chooses a channel in proportion to its throughput, u in [0, 1). */
static inline int pt_sample_channel(const float beta[3], float u)
{
    int c = 0;

    u *= beta[0] + beta[1] + beta[2];
    while (c < 2 && u >= beta[c])
        u -= beta[c++];
    while (c > 0 && !(beta[c] > 0.0f))
        c--;
    return c;
}

#endif
