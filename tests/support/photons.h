/* SPDX-License-Identifier: MIT
 * photons.h - the layer that tests send photons into. */
#ifndef PELL_TEST_PHOTONS_H
#define PELL_TEST_PHOTONS_H

#include "optics/photon/photon.h"

/* A layer in air, INFINITY: a half-space, under light at right angles that has entered; walks of any length, by roulette. Any one unit. */
static inline struct pell_photon_stack photons_in_layer(double sigma_a, double sigma_s, double g, double eta, double thickness)
{
    return (struct pell_photon_stack) { .count = 1,
                                        .layer = { { sigma_a, sigma_s, g, eta, thickness } },
                                        .n_above = 1.0,
                                        .n_below = 1.0,
                                        .mu_min = 1.0,
                                        .mu_max = 1.0,
                                        .inside = true,
                                        .roulette = 64,
                                        .collisions_max = 100000 };
}

#endif
