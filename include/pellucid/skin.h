/* SPDX-License-Identifier: MIT
 *
 * pellucid/skin.h - the spectral two-layer skin of Donner and Jensen 2006: from what is in skin to coefficients and colour.
 *
 * Units      mm, 1/mm, wavelengths nm; colours linear Rec.709 under D65.
 * Ownership  numbers and arrays are the caller's; what is returned by pointer is constant data.
 * Errors     enum pell_result; nothing is logged here: the caller knows the names.
 * Threads    all functions are pure and safe; nothing is allocated.
 */
#ifndef PELLUCID_SKIN_H
#define PELLUCID_SKIN_H

#include <pellucid/material.h>
#include <pellucid/spectrum.h>

#ifdef __cplusplus
extern "C" {
#endif

/* What a piece of skin is made of: an epidermis with melanin on a dermis with blood that has no bottom. In people melanin goes from 0.01
 * to 0.45 and haemoglobin from 0.005 to 0.1. */
struct pell_skin {
    double melanin;       /* C_m: volume fraction of melanosomes in the epidermis, [0, 1] */
    double melanin_blend; /* beta_m: share of brown eumelanin, the rest is red pheomelanin, [0, 1] */
    double haemoglobin;   /* C_h: volume fraction of blood in the dermis, [0, 1] */
    double oxygenation;   /* gamma: share of the haemoglobin that carries oxygen, [0, 1] */
    double epidermis_mm;  /* thickness of the epidermis, [0.01, 1] */
    double eta;           /* of both layers, [1, 2] */
};

/* Light skin: melanin 0.025, blend 0.2, haemoglobin 0.012, epidermis 0.1 mm (people have 0.05 to 0.15; the paper 0.25, which gives greyer
 * skin than theirs), and the paper's oxygenation 0.75 and eta 1.4. */
PELL_API struct pell_skin pell_skin_default(void);

/* The first field out of range (NaN included) with its value and range, or true. `fault` may be NULL. */
PELL_API bool pell_skin_valid(const struct pell_skin *skin, struct pell_medium_fault *fault);

struct pell_skin_coefficients {
    double sigma_a, sigma_s_reduced; /* 1/mm */
};

/* Both layers at a wavelength in [PELL_WAVELENGTH_MIN, PELL_WAVELENGTH_MAX] (Donner and Jensen 2006, sections 4.1 and 4.2; haemoglobin
 * by Prahl's tables, linear between their wavelengths). PELL_ERR_INVALID: skin or wavelength out of range, nothing is written. */
PELL_API PELL_NODISCARD enum pell_result pell_skin_at(const struct pell_skin *skin, double wavelength_nm,
                                                      struct pell_skin_coefficients *epidermis, struct pell_skin_coefficients *dermis);

/* Share of the light that entered which leaves again, at the wavelengths of pell_spectrum_to_rgb: the multipole of the epidermis on the
 * dipole of the dermis (Donner and Jensen 2005), without what the surface itself mirrors. PELL_ERR_INVALID as above. */
PELL_API PELL_NODISCARD enum pell_result pell_skin_reflectance(const struct pell_skin *skin, double reflectance[PELL_WAVELENGTHS]);

/* The colour of that reflectance; a channel that leaves Rec.709 is clamped to 0. */
PELL_API PELL_NODISCARD enum pell_result pell_skin_color(const struct pell_skin *skin, double rgb[3]);

/* Both layers with coefficients per channel, "epidermis" and "dermis", such that they reflect pell_skin_color: means of the spectral
 * coefficients, weighted with D65 and the positive part of the channel's sensitivity; then the absorption of both layers times a factor
 * of the channel, as a mean of absorptions would be too dark (0.4 to 0.9 where skin is light). PELL_ERR_INVALID as above. */
PELL_API PELL_NODISCARD enum pell_result pell_skin_layers(const struct pell_skin *skin, struct pell_material_layers *out);

#ifdef __cplusplus
}
#endif
#endif
