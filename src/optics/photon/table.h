/* SPDX-License-Identifier: MIT
 *
 * table.h - the table of the monte-carlo model: multiple scattering (at least twice) in a half-space under a beam at normal incidence, over
 * reduced albedo alpha', mean cosine g and index eta; single scattering has a closed form (single.c).
 *
 * Radii are in reduced mean free paths, x = ln(r sigma_t'); the table holds y = ln(2 pi r^2 R / alpha^2) + kappa r, alpha the albedo of one
 * collision and kappa the decay of the far field: y is smooth in everything, finite at alpha' = 0 and follows diffusion far away.
 * All numbers per photon that has entered.
 *
 * Threads    pure and safe. */
#ifndef PELL_PHOTON_TABLE_H
#define PELL_PHOTON_TABLE_H

#include <pellucid/common.h>

#include <math.h>

#define PELL_TABLE_G 7
#define PELL_TABLE_ETA 8
#define PELL_TABLE_ALPHA 16
#define PELL_TABLE_R 33
#define PELL_TABLE_PER_DECADE 8
#define PELL_TABLE_R_MIN 0.01   /* the first radius; the last is 100 */
#define PELL_TABLE_Y_SCALE 1500 /* y is stored as a multiple of 1/1500 */
#define PELL_TABLE_NO_ERROR 255 /* not measured: the far field is extrapolated */

struct pell_photon_table {
    double g[PELL_TABLE_G], eta[PELL_TABLE_ETA];
    double v[PELL_TABLE_ALPHA]; /* sqrt(1 - alpha') */
    double photons[PELL_TABLE_G];
    int16_t y[PELL_TABLE_G][PELL_TABLE_ETA][PELL_TABLE_ALPHA][PELL_TABLE_R];
    uint8_t error[PELL_TABLE_G][PELL_TABLE_ETA][PELL_TABLE_ALPHA][PELL_TABLE_R]; /* one standard error relative to R is 1e-4 2^(this/8) */
    float total[PELL_TABLE_G][PELL_TABLE_ETA][PELL_TABLE_ALPHA];                 /* Int 2 pi r R dr / alpha^2 */
    float total_error[PELL_TABLE_G][PELL_TABLE_ETA][PELL_TABLE_ALPHA];           /* one standard error */
};

/* The built-in table: made from data/profiles by the build. */
extern const struct pell_photon_table pell_photon_table_data;

/* ln of the table's radius i. */
static inline double pell_table_x(int i)
{
    return log(PELL_TABLE_R_MIN) + log(10.0) / PELL_TABLE_PER_DECADE * i;
}

/* Decay of the far field exp(-kappa r) in an infinite medium of albedo alpha with a Henyey-Greenstein phase function, in units of sigma_t:
 * [0, 1]. The smallest root of the continued fraction of the spherical harmonics (Case and Zweifel, "Linear Transport Theory", 1967): h0 =
 * k^2/(h1 - 4 k^2/(h2 - 9 k^2/(h3 - ...))), h_l = (2 l + 1)(1 - alpha g^l). */
double pell_transport_kappa(double albedo, double g);

/* Single scattering, per photon that has entered, for a collision of albedo 1 under g and eta = n_inside/n_outside: a sum over angles,
 * prepared for many radii. */
#define PELL_SINGLE_ANGLES 96
struct pell_single {
    double weight[PELL_SINGLE_ANGLES], rate[PELL_SINGLE_ANGLES];
    double total; /* its integral over the plane */
};
void pell_single_make(double g, double eta, struct pell_single *out);
/* R in units of sigma_t^2 at a radius of tau = sigma_t r > 0. */
double pell_single_rd(const struct pell_single *s, double tau);
double pell_single_total(double g, double eta);

/* Multiple scattering: *total is its integral over the plane; y at the table's radii, interpolated. Outside of the table's range g and eta
 * are clamped. */
void pell_multiple(double albedo_reduced, double g, double eta, double y[PELL_TABLE_R], double *total);

#endif
