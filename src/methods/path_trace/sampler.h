/* SPDX-License-Identifier: MIT
 *
 * sampler.h - the random numbers of one sample of one pixel: the first of them fill the unit square evenly over the samples, the others
 * are plain.
 *
 * Pairs of Sobol's first two dimensions, each pair shuffled and scrambled by itself (Owen's scrambling by hashing: L. Laine and T. Karras
 * 2011; B. Burley, "Practical Hash-based Owen Scrambling", JCGT 9(4), 2020).
 */
#ifndef PELL_PATH_TRACE_SAMPLER_H
#define PELL_PATH_TRACE_SAMPLER_H

#include "base/hash.h"

#define PT_EVEN_NUMBERS 16

struct pt_sampler {
    uint64_t state;
    uint32_t index, pattern; /* of the sample, of the pixel */
    uint32_t at;             /* numbers taken */
    float second;            /* of a pair */
};

static inline uint32_t pt_hash(uint32_t x)
{
    return pell_hash(x);
}

static inline uint32_t pt_reverse(uint32_t i)
{
    i = i << 16 | i >> 16;
    i = (i & 0x00ff00ffu) << 8 | (i & 0xff00ff00u) >> 8;
    i = (i & 0x0f0f0f0fu) << 4 | (i & 0xf0f0f0f0u) >> 4;
    i = (i & 0x33333333u) << 2 | (i & 0xccccccccu) >> 2;
    return (i & 0x55555555u) << 1 | (i & 0xaaaaaaaau) >> 1;
}

/* Owen's scrambling of the digits of x, most significant first (constants: Vegdahl 2021, "Building a Better LK Hash"). */
static inline uint32_t pt_scramble(uint32_t x, uint32_t seed)
{
    x = pt_reverse(x);
    x ^= x * 0x3d20adeau;
    x += seed;
    x *= (seed >> 16) | 1u;
    x ^= x * 0x05526c56u;
    x ^= x * 0x53a22864u;
    return pt_reverse(x);
}

static inline float pt_unit(uint32_t x)
{
    return (float) (int32_t) (x >> 8) * (1.0f / 16777216.0f);
}

static inline uint64_t pt_mix(uint64_t z)
{
    z = (z ^ z >> 30) * 0xbf58476d1ce4e5b9u;
    z = (z ^ z >> 27) * 0x94d049bb133111ebu;
    return z ^ z >> 31;
}

/* `stream`: samples of one pixel may have several, for the light's paths, say. */
static inline struct pt_sampler pt_sampler_start(uint32_t seed, uint32_t pixel, uint32_t sample, uint32_t stream)
{
    struct pt_sampler s = { .index = sample, .at = 0, .second = 0.0f };

    s.pattern = pt_hash(pixel ^ pt_hash(seed ^ pt_hash(stream)));
    s.state = pt_mix((uint64_t) s.pattern << 32 | sample) ^ pt_mix((uint64_t) pixel << 32 | (seed ^ stream * 0x9e3779b9u));
    return s;
}

/* Steele et al. 2014, "Fast Splittable Pseudorandom Number Generators". */
static inline uint32_t pt_bits(struct pt_sampler *s)
{
    return (uint32_t) (pt_mix(s->state += 0x9e3779b97f4a7c15u) >> 32);
}

static inline float pt_even(struct pt_sampler *s)
{
    uint32_t seed, i, y;

    if (s->at++ & 1)
        return s->second;
    seed = pt_hash(s->pattern + s->at);
    i = pt_scramble(s->index, seed);
    y = pt_reverse(i); /* the second dimension's matrix is Pascal's triangle modulo 2: five butterflies */
    y ^= (y & 0x55555555u) << 1;
    y ^= (y & 0x33333333u) << 2;
    y ^= (y & 0x0f0f0f0fu) << 4;
    y ^= (y & 0x00ff00ffu) << 8;
    y ^= y << 16;
    s->second = pt_unit(pt_scramble(y, pt_hash(seed ^ 0xb5297a4du)));
    return pt_unit(pt_scramble(pt_reverse(i), pt_hash(seed ^ 0x68e31da4u)));
}

/* In (0, 1), of 32 bits: where tails count. */
static inline double pt_fine(struct pt_sampler *s)
{
    return ((double) pt_bits(s) + 0.5) * 0x1p-32;
}

/* In (0, 1], of 31 bits: the argument of a logarithm. */
static inline float pt_chance_of(uint32_t bits)
{
    return ((float) (int32_t) (bits >> 1) + 0.5f) * 0x1p-31f;
}

static inline float pt_chance(struct pt_sampler *s)
{
    return s->at < PT_EVEN_NUMBERS ? 1.0f - pt_even(s) : pt_chance_of(pt_bits(s));
}

/* In [0, 1). */
static inline float pt_random(struct pt_sampler *s)
{
    return s->at < PT_EVEN_NUMBERS ? pt_even(s) : pt_unit(pt_bits(s));
}

/* A channel by what it carries, u in [0, 1). */
static inline int pt_choose(const float beta[3], float u)
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
