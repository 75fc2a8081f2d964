/* SPDX-License-Identifier: MIT
 *
 * radial.h - a profile over the squared distance, as a table over the bits of the float: 32 steps an octave.
 */
#ifndef INDIRECT_RADIAL_H
#define INDIRECT_RADIAL_H

#include <pellucid/profile.h>

#include <math.h>
#include <stdint.h>
#include <string.h>

enum { RADIAL_BITS = 18, RADIAL_ROWS = 2048 };

struct radial {
    float R[RADIAL_ROWS]; /* 1/mm^2 */
    uint32_t first;
};

/* From the distance `least`, mm, below which it falls nearly as little, to `most`, beyond which it is 0. */
static inline void radial_make(struct radial *out, const struct pell_profile *profile, float least, float most)
{
    const float least2 = least * least;

    memcpy(&out->first, &least2, sizeof(out->first));
    out->first >>= RADIAL_BITS;
    for (uint32_t i = 0; i < RADIAL_ROWS; i++) {
        const uint32_t bits = (out->first + i) << RADIAL_BITS;
        float r2;
        memcpy(&r2, &bits, sizeof(r2));
        out->R[i] = r2 < most * most ? (float) pell_profile_eval(profile, sqrt((double) r2)) : 0.0f;
    }
}

static inline float radial_at(const struct radial *t, float r2)
{
    uint32_t bits, at;
    float f;

    memcpy(&bits, &r2, sizeof(bits));
    at = bits >> RADIAL_BITS;
    f = (float) (bits & ((1u << RADIAL_BITS) - 1)) * (1.0f / (float) (1u << RADIAL_BITS));
    if (at < t->first)
        return t->R[0];
    at -= t->first;
    return at + 1 < RADIAL_ROWS ? t->R[at] + f * (t->R[at + 1] - t->R[at]) : 0.0f;
}

#endif
