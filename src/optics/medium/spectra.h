/* SPDX-License-Identifier: MIT
 *
 * spectra.h - the tables that scripts/gen_spectra.py makes of data/spectra, over PELL_WAVELENGTH_MIN to PELL_WAVELENGTH_MAX. */
#ifndef PELL_OPTICS_SPECTRA_H
#define PELL_OPTICS_SPECTRA_H

#include <pellucid/spectrum.h>

enum { PELL_HAEMOGLOBIN_STEP = 2, PELL_HAEMOGLOBIN_ROWS = 201 };

extern const double pell_cie1931[PELL_WAVELENGTHS][3];          /* xbar, ybar, zbar */
extern const double pell_d65[PELL_WAVELENGTHS][1];              /* relative power */
extern const double pell_haemoglobin[PELL_HAEMOGLOBIN_ROWS][2]; /* HbO2, Hb: decadic molar extinction, 1/(cm M) */

/* Sensitivity of a channel of linear Rec.709 under D65 at a sample, scaled such that they sum to 1 over the samples; negative in places. */
void pell_spectrum_weights(double weight[PELL_WAVELENGTHS][3]);

#endif
