/* SPDX-License-Identifier: MIT
 * colormap.c - colours of error maps. */
#include "base/base.h"
#include "math/vec.h"

#include <pellucid/compare.h>

#include <math.h>

/* --- magma -------------------------------------------------------------------------------------------------------------------- */

/* Every 15th of its 256 colours; cubic interpolation through four neighbours is accurate to 1.5/255. */
static const double magma[18][3] = {
    { 0.001462, 0.000466, 0.013866 }, { 0.035520, 0.028397, 0.125209 }, { 0.102815, 0.063010, 0.257854 }, { 0.191460, 0.064818, 0.396152 },
    { 0.291366, 0.064553, 0.475462 }, { 0.384299, 0.097855, 0.501002 }, { 0.475780, 0.134577, 0.507921 }, { 0.569172, 0.167454, 0.504105 },
    { 0.664915, 0.198075, 0.488836 }, { 0.761077, 0.231214, 0.460162 }, { 0.852126, 0.276106, 0.418573 }, { 0.925937, 0.346844, 0.374959 },
    { 0.969680, 0.446936, 0.360311 }, { 0.989363, 0.557873, 0.391671 }, { 0.996580, 0.668256, 0.456192 }, { 0.996727, 0.776795, 0.541039 },
    { 0.992440, 0.884330, 0.640099 }, { 0.987053, 0.991438, 0.749504 },
};

static double knot(int i, int c)
{
    const int last = (int) PELL_COUNT(magma) - 1;
    if (i < 0)
        return 2.0 * magma[0][c] - magma[1][c];
    return i <= last ? magma[i][c] : 2.0 * magma[last][c] - magma[last - 1][c];
}

static float clamp(double v)
{
    return (float) (v > 0.0 ? v < 1.0 ? v : 1.0 : 0.0);
}

void pell_color_magma(float value, float srgb[3])
{
    const double x = (double) clamp(value) * (PELL_COUNT(magma) - 1);
    const int i = x < (double) (PELL_COUNT(magma) - 1) ? (int) x : (int) PELL_COUNT(magma) - 2;
    const double t = x - i;

    for (int c = 0; c < 3; c++) {
        const double a = knot(i - 1, c), b = knot(i, c), d = knot(i + 1, c), e = knot(i + 2, c);
        srgb[c] = clamp(b + 0.5 * t * (d - a + t * (2.0 * a - 5.0 * b + 4.0 * d - e + t * (3.0 * (b - d) + e - a))));
    }
}

/* --- Blue, grey, red ---------------------------------------------------------------------------------------------------------- */

static const double white[3] = { 0.950456, 1.0, 1.089058 }; /* D65 */

static void to_msh(const double srgb[3], double msh[3])
{
    static const double m[3][3] = { { 0.412453, 0.357580, 0.180423 }, { 0.212671, 0.715160, 0.072169 }, { 0.019334, 0.119193, 0.950227 } };
    double linear[3], f[3], lab[3];

    for (int c = 0; c < 3; c++)
        linear[c] = srgb[c] > 0.04045 ? pow((srgb[c] + 0.055) / 1.055, 2.4) : srgb[c] / 12.92;
    for (int i = 0; i < 3; i++)
        f[i] = cbrt((m[i][0] * linear[0] + m[i][1] * linear[1] + m[i][2] * linear[2]) / white[i]); /* no colour is dark */
    lab[0] = 116.0 * f[1] - 16.0;
    lab[1] = 500.0 * (f[0] - f[1]);
    lab[2] = 200.0 * (f[1] - f[2]);
    msh[0] = sqrt(lab[0] * lab[0] + lab[1] * lab[1] + lab[2] * lab[2]);
    msh[1] = acos(lab[0] / msh[0]);
    msh[2] = atan2(lab[2], lab[1]);
}

static void from_msh(const double msh[3], float srgb[3])
{
    static const double m[3][3] = { { 3.240479, -1.537150, -0.498535 },
                                    { -0.969256, 1.875992, 0.041556 },
                                    { 0.055648, -0.204043, 1.057311 } };
    const double l = msh[0] * cos(msh[1]), a = msh[0] * sin(msh[1]) * cos(msh[2]), b = msh[0] * sin(msh[1]) * sin(msh[2]);
    const double fy = (l + 16.0) / 116.0, f[3] = { fy + a / 500.0, fy, fy - b / 200.0 };
    double xyz[3];

    for (int i = 0; i < 3; i++)
        xyz[i] = white[i] * f[i] * f[i] * f[i];
    for (int c = 0; c < 3; c++) {
        const double v = m[c][0] * xyz[0] + m[c][1] * xyz[1] + m[c][2] * xyz[2];
        srgb[c] = clamp(v > 0.0031308 ? 1.055 * pow(v, 1.0 / 2.4) - 0.055 : 12.92 * v);
    }
}

/* From the centre to one end, straight in polar L*a*b*, with the hue rotated towards grey so that steps look uniform. */
void pell_color_diverging(float value, float srgb[3])
{
    static const double ends[2][3] = { { 0.230, 0.299, 0.754 }, { 0.706, 0.016, 0.150 } };
    const double grey = 88.0, v = value > 0.0f ? (double) clamp(value) : value < 0.0f ? -(double) clamp(-value) : 0.0, t = fabs(v);
    double end[3], spin;

    to_msh(ends[v > 0.0], end);
    spin = end[0] < grey ? end[1] * sqrt(grey * grey - end[0] * end[0]) / (end[0] * sin(end[1])) : 0.0;
    const double at[3] = { grey + t * (end[0] - grey), t * end[1], end[2] + (1.0 - t) * (end[2] > -PELL_PI / 3.0 ? spin : -spin) };
    from_msh(at, srgb);
}
