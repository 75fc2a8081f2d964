/* SPDX-License-Identifier: MIT
 *
 * radial.h - a profile tabulated by squared distance: the index is made of the upper bits of the float, 32 steps per octave.
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

/* Tabulates distances from `least`, mm, below which the profile is nearly constant, to `most`, beyond which it is 0. */
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
    uint32_t bits, cell;
    float f;

    memcpy(&bits, &r2, sizeof(bits));
    cell = bits >> RADIAL_BITS;
    f = (float) (bits & ((1u << RADIAL_BITS) - 1)) * (1.0f / (float) (1u << RADIAL_BITS));
    if (cell < t->first)
        return t->R[0];
    cell -= t->first;
    return cell + 1 < RADIAL_ROWS ? t->R[cell] + f * (t->R[cell + 1] - t->R[cell]) : 0.0f;
}

#endif
