/* SPDX-License-Identifier: MIT
 *
 * rqmc.h - randomised quasi-Monte Carlo for references that sample a pixel in batches: each batch is a rank-1 lattice (pell_lattice) with a
 * shift by a hash of the position and the seed; batches are independent, so their spread gives an unbiased standard error.
 */
#ifndef PELL_RQMC_H
#define PELL_RQMC_H

#include "math/sampling.h"

#include <math.h>
#include <string.h>

static inline uint32_t pell_point_seed(struct pell_vec3 at, uint32_t seed)
{
    uint32_t b[3];

    memcpy(b, &at, sizeof(b));
    return pell_hash(b[0] ^ pell_hash(b[1] ^ pell_hash(b[2] ^ pell_hash(seed))));
}

/* Sums over batches. */
struct pell_batches {
    double sum[3], square[3];
    int64_t count;
};

static inline void pell_batches_add(struct pell_batches *s, const double batch[3])
{
    for (int c = 0; c < 3; c++) {
        s->sum[c] += batch[c];
        s->square[c] += batch[c] * batch[c];
    }
    s->count++;
}

/* The channels' means and their standard errors. */
static inline void pell_batches_measure(const struct pell_batches *s, double mean[3], double standard_error[3])
{
    const double n = (double) s->count;

    for (int c = 0; c < 3; c++) {
        mean[c] = n > 0.0 ? s->sum[c] / n : 0.0;
        standard_error[c] = n > 1.0 ? sqrt(fmax(s->square[c] / n - mean[c] * mean[c], 0.0) / (n - 1.0)) : 0.0;
    }
}

/* Number of batches for the target relative error, estimated from a pilot: at least `least`, and `dark` if the pilot found no light. */
static inline double pell_batches_needed(const struct pell_batches *pilot, double error, double least, double dark)
{
    double mean[3], standard_error[3], largest, n = least;

    pell_batches_measure(pilot, mean, standard_error);
    largest = fmax(mean[0], fmax(mean[1], mean[2]));
    for (int c = 0; largest > 0.0 && c < 3; c++) {
        const double ratio = standard_error[c] / (error * fmax(mean[c], 1e-3 * largest));
        n = fmax(n, (double) pilot->count * ratio * ratio);
    }
    return largest > 0.0 ? n : dark;
}

#endif
