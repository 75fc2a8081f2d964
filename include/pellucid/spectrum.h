/* SPDX-License-Identifier: MIT
 *
 * pellucid/spectrum.h - computes the colour of a spectral reflectance.
 *
 * Units      wavelengths nm; colours linear Rec.709 with (1, 1, 1) for a white that reflects everything.
 * Ownership  numbers and arrays are the caller's; what is returned by pointer is constant data.
 * Errors     none.
 * Threads    all functions are pure and safe; nothing is allocated.
 */
#ifndef PELLUCID_SPECTRUM_H
#define PELLUCID_SPECTRUM_H

#include <pellucid/common.h>

#ifdef __cplusplus
extern "C" {
#endif

#define PELL_WAVELENGTHS 81 /* samples: 380, 385, ... 780 nm */
#define PELL_WAVELENGTH_MIN 380.0
#define PELL_WAVELENGTH_MAX 780.0
#define PELL_WAVELENGTH_STEP 5.0

/* The colour of a surface of this reflectance under D65 for the CIE 1931 observer (sum over the samples; CIE 15:2004, section 7). White
 * is (1, 1, 1) to rounding and a grey is grey. A saturated reflectance may have a negative channel: it is outside Rec.709. */
PELL_API void pell_spectrum_to_rgb(const double reflectance[PELL_WAVELENGTHS], double rgb[3]);

#ifdef __cplusplus
}
#endif
#endif
