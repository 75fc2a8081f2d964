/* SPDX-License-Identifier: MIT
 *
 * pellucid/skin.h - computes coefficients and colour of skin from its composition, by the spectral two-layer model of Donner and Jensen
 * 2006.
 *
 * Units      mm, 1/mm, wavelengths nm; colours linear Rec.709 under D65.
 * Ownership  numbers and arrays are the caller's; what is returned by pointer is constant data.
 * Errors     enum pell_result; nothing is logged, because only the caller knows the names.
 * Threads    all functions are pure and safe; nothing is allocated.
 */
#ifndef PELLUCID_SKIN_H
#define PELLUCID_SKIN_H

#include <pellucid/material.h>
#include <pellucid/spectrum.h>

#ifdef __cplusplus
extern "C" {
#endif

/* Composition of skin: an epidermis with melanin on an infinitely deep dermis with blood. Human skin has melanin from 0.01 to 0.45 and
 * haemoglobin from 0.005 to 0.1. */
struct pell_skin {
    double melanin;       /* C_m: volume fraction of melanosomes in the epidermis, [0, 1] */
    double melanin_blend; /* beta_m: fraction of brown eumelanin, the rest is red pheomelanin, [0, 1] */
    double haemoglobin;   /* C_h: volume fraction of blood in the dermis, [0, 1] */
    double oxygenation;   /* gamma: fraction of the haemoglobin that carries oxygen, [0, 1] */
    double epidermis_mm;  /* thickness of the epidermis, [0.01, 1] */
    double eta;           /* index of refraction of both layers, [1, 2] */
};

/* Light skin: melanin 0.025, blend 0.2, haemoglobin 0.012, epidermis 0.1 mm (human skin has 0.05 to 0.15; the paper uses 0.25, which gives
 * greyer skin), and the paper's oxygenation 0.75 and eta 1.4. */
PELL_API struct pell_skin pell_skin_default(void);

/* Whether all fields are in range. If not, *fault (may be NULL) holds the first that is out of range (NaN included), with its value and
 * range. */
PELL_API bool pell_skin_valid(const struct pell_skin *skin, struct pell_medium_fault *fault);

struct pell_skin_coefficients {
    double sigma_a, sigma_s_reduced; /* 1/mm */
};

/* Both layers at a wavelength in [PELL_WAVELENGTH_MIN, PELL_WAVELENGTH_MAX] (Donner and Jensen 2006, sections 4.1 and 4.2; haemoglobin
 * by Prahl's tables, linear between their wavelengths). PELL_ERR_INVALID: skin or wavelength out of range, nothing is written. */
PELL_API PELL_NODISCARD enum pell_result pell_skin_at(const struct pell_skin *skin, double wavelength_nm,
                                                      struct pell_skin_coefficients *epidermis, struct pell_skin_coefficients *dermis);

/* Reflectance, as a fraction of the light that enters, at the wavelengths of pell_spectrum_to_rgb: the multipole of the epidermis on the
 * dipole of the dermis (Donner and Jensen 2005), without surface reflection. PELL_ERR_INVALID as above. */
PELL_API PELL_NODISCARD enum pell_result pell_skin_reflectance(const struct pell_skin *skin, double reflectance[PELL_WAVELENGTHS]);

/* The colour of that reflectance; a channel outside Rec.709 is clamped to 0. */
PELL_API PELL_NODISCARD enum pell_result pell_skin_color(const struct pell_skin *skin, double rgb[3]);

/* Both layers with coefficients per channel, "epidermis" and "dermis", such that their colour is pell_skin_color: means of the spectral
 * coefficients, weighted with D65 and the positive part of the channel's sensitivity; then the absorption of both layers is multiplied
 * by a factor per channel (0.4 to 0.9 for light skin), because a mean of absorptions is too dark. PELL_ERR_INVALID as above. */
PELL_API PELL_NODISCARD enum pell_result pell_skin_layers(const struct pell_skin *skin, struct pell_material_layers *out);

#ifdef __cplusplus
}
#endif
#endif
