/* SPDX-License-Identifier: MIT
 *
 * spectrum.c - spectra to linear Rec.709. */
#include "optics/medium/spectra.h"

/* XYZ to linear Rec.709, from the primaries and the white point of ITU-R BT.709 in exact arithmetic, 12 digits. */
static const double xyz_to_rgb[3][3] = {
    { 3.240969941905, -1.53738317757, -0.498610760293 },
    { -0.969243636281, 1.875967501508, 0.041555057407 },
    { 0.055630079697, -0.203976958889, 1.056971514243 },
};

void pell_spectrum_weights(double weight[PELL_WAVELENGTHS][3])
{
    double sum[3] = { 0 };

    for (int i = 0; i < PELL_WAVELENGTHS; i++)
        for (int c = 0; c < 3; c++) {
            const double *m = xyz_to_rgb[c], *cmf = pell_cie1931[i];
            weight[i][c] = pell_d65[i][0] * (m[0] * cmf[0] + m[1] * cmf[1] + m[2] * cmf[2]);
            sum[c] += weight[i][c];
        }
    /* Dividing by each channel's own sum takes out what the tables' 5 nm leave of the white point (3e-4 in blue). */
    for (int i = 0; i < PELL_WAVELENGTHS; i++)
        for (int c = 0; c < 3; c++)
            weight[i][c] /= sum[c];
}

void pell_spectrum_to_rgb(const double reflectance[PELL_WAVELENGTHS], double rgb[3])
{
    double weight[PELL_WAVELENGTHS][3], sum[3] = { 0 };

    pell_spectrum_weights(weight);
    for (int i = 0; i < PELL_WAVELENGTHS; i++)
        for (int c = 0; c < 3; c++)
            sum[c] += weight[i][c] * reflectance[i];
    for (int c = 0; c < 3; c++)
        rgb[c] = sum[c];
}
