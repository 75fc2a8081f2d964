/* SPDX-License-Identifier: MIT
 *
 * small.h - what solids of a few mean free paths return of even light, where diffusion says nothing.
 *
 * Light that was scattered is spread evenly over a small solid, and each free flight of it meets the boundary with the same probability p
 * (flights in reactors; Case, de Hoffmann and Placzek 1953). With q = that of crossing the solid from one boundary to the other, and l the
 * mean chord of light from everywhere, reciprocity says p = (1 - q)/(sigma_t l). A boundary keeps rho inside, so that a flight ends outside
 * with e = p (1 - rho)/(1 - rho q). Of what enters, the share c collides, and
 *
 *     c a e/(1 - a (1 - e))                                  a: albedo
 *
 * leaves after it was scattered. Of a ball of the diameter x in mean free paths, light from everywhere that is not refracted crosses with
 * q = 2/x^2 (1 - (1 + x) exp(-x)); l = 2 x/3; what is refracted goes along chords x cos, cos from its critical cosine m to 1, and
 * 1 - c = 2 eta^2/x^2 ((1 + x m) exp(-x m) - (1 + x) exp(-x)). Within 12 % of photons up to 2 mean free paths, and up to 4 for albedos of
 * 0.8 and more (tests/optics/test_small.c).
 */
#ifndef PELL_SMALL_H
#define PELL_SMALL_H

#include <pellucid/medium.h>

#define PELL_SMALL_LOW 5.0f  /* diameter in mean free paths: up to it a ball is small, */
#define PELL_SMALL_HIGH 9.0f /* and from there on diffusion's */

/* Of even light that enters a ball, the share that leaves scattered; reduced coefficients. */
double pell_small_ball(const struct pell_medium *medium, int channel, double diameter);
/* How small that is, [0, 1]: 0 is diffusion's. */
double pell_small_share(const struct pell_medium *medium, int channel, double diameter);

#endif
