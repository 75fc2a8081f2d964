/* SPDX-License-Identifier: MIT
 *
 * small.h - albedo of solids of a few mean free paths under uniform light, where diffusion does not apply.
 *
 * Scattered light is distributed uniformly over a small solid, and each free flight hits the boundary with the same probability p
 * (flights in reactors; Case, de Hoffmann and Placzek 1953). With q the probability of crossing the solid from boundary to boundary, and l
 * the mean chord of uniform light, reciprocity gives p = (1 - q)/(sigma_t l). A boundary reflects rho internally, so that a flight ends
 * outside with e = p (1 - rho)/(1 - rho q). Of the light that enters, the fraction c collides, and
 *
 *     c a e/(1 - a (1 - e))                                  a: albedo
 *
 * exits after scattering. In a sphere of diameter x in mean free paths, uniform unrefracted light crosses with
 * q = 2/x^2 (1 - (1 + x) exp(-x)); l = 2 x/3; refracted light travels along chords x cos, cos from its critical cosine m to 1, and
 * 1 - c = 2 eta^2/x^2 ((1 + x m) exp(-x m) - (1 + x) exp(-x)). Within 12 % of Monte Carlo up to 2 mean free paths, and up to 4 for albedos
 * of 0.8 and more (tests/optics/test_small.c).
 */
#ifndef PELL_SMALL_H
#define PELL_SMALL_H

#include <pellucid/medium.h>

#define PELL_SMALL_LOW 5.0f  /* diameter in mean free paths: up to it a sphere is small, */
#define PELL_SMALL_HIGH 9.0f /* and above this one diffusion applies */

/* Albedo of a sphere under uniform light, of the light that enters; reduced coefficients. */
double pell_small_ball(const struct pell_medium *medium, int channel, double diameter);
/* Weight of the small-solid model, [0, 1]: 0: diffusion applies. */
double pell_small_weight(const struct pell_medium *medium, int channel, double diameter);

#endif
