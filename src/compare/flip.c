/* SPDX-License-Identifier: MIT
 *
 * flip.c - the constants of FLIP (Andersson et al. 2020) and of SSIM (Wang et al. 2004) as filters, and the exposures of HDR-FLIP
 * (Andersson et al. 2021).
 *
 * Contrast sensitivity, as filters over degrees x: a1 sqrt(pi/b1) exp(-pi^2 x^2/b1) + a2 sqrt(pi/b2) exp(-pi^2 x^2/b2), with
 *     achromatic a1 = 1, b1 = 0.0047;  red-green a1 = 1, b1 = 0.0053;  blue-yellow 34.1, 0.04 and 13.5, 0.025,
 * sampled at pixels and divided by their sum. All have a radius of three standard deviations of the widest; the narrow two are truncated at
 * six of their own, which omits less than 1e-7 of their weight.
 */
#include "compare/tile.h"

#include "math/vec.h"

#include <math.h>
#include <string.h>

/* Of XYZ over the white, from the primaries of Rec.709 and D65 with x = 0.3127, y = 0.3290 as fractions: each row sums to 1. */
static const double rgb_to_xyz[9] = {
    10135552.0 / 23359437, 8788810.0 / 23359437, 4435075.0 / 23359437, /**/
    2613072.0 / 12288897,  8788810.0 / 12288897, 887015.0 / 12288897,  /**/
    1425312.0 / 80288307,  8788810.0 / 80288307, 70074185.0 / 80288307,
};

static void invert(const double m[9], double out[9])
{
    const double a = m[4] * m[8] - m[5] * m[7], b = m[5] * m[6] - m[3] * m[8], c = m[3] * m[7] - m[4] * m[6];
    const double scale = 1.0 / (m[0] * a + m[1] * b + m[2] * c);
    const double adjugate[9] = { a, m[2] * m[7] - m[1] * m[8], m[1] * m[5] - m[2] * m[4],
                                 b, m[0] * m[8] - m[2] * m[6], m[2] * m[3] - m[0] * m[5],
                                 c, m[1] * m[6] - m[0] * m[7], m[0] * m[4] - m[1] * m[3] };
    for (int i = 0; i < 9; i++)
        out[i] = scale * adjugate[i];
}

static double lightness(double x)
{
    return x > 216.0 / 24389.0 ? cbrt(x) : x * (841.0 / 108.0) + 4.0 / 29.0;
}

/* L*a*b* of a colour in [0, 1] after Hunt. */
static void hunt(const double rgb[3], double lab[3])
{
    double f[3];
    for (int i = 0; i < 3; i++)
        f[i] = lightness(rgb_to_xyz[3 * i] * rgb[0] + rgb_to_xyz[3 * i + 1] * rgb[1] + rgb_to_xyz[3 * i + 2] * rgb[2]);
    lab[0] = 116.0 * f[1] - 16.0;
    lab[1] = 0.01 * lab[0] * 500.0 * (f[0] - f[1]);
    lab[2] = 0.01 * lab[0] * 200.0 * (f[1] - f[2]);
}

/* exp(-x^2/(2 sd^2)) at pixels: half of the filter, divided by the sum of the whole, which is returned. */
static double gaussian(double sd, int radius, float *half)
{
    double sum = 1.0, v[PELL_FLIP_RADIUS_MAX + 1];

    for (int k = 0; k <= radius; k++) {
        v[k] = exp(-0.5 * k * k / (sd * sd));
        sum += k ? 2.0 * v[k] : 0.0;
    }
    for (int k = 0; k <= radius; k++)
        half[k] = (float) (v[k] / sum);
    return sum;
}

static int at_most(double radius, int limit)
{
    return radius < limit ? (int) radius : limit;
}

/* Derivatives of the Gaussian whose standard deviation is half of 0.082 degrees, from peak to trough: their positive weights sum to 1, and
 * their negative ones to -1. */
static void prepare_features(double ppd, struct pell_flip_filters *f)
{
    const double sd = 0.5 * 0.082 * ppd;
    double edge = 0.0, above = 0.0, below = 0.0;

    f->feature_radius = (int) ceil(3.0 * sd);
    gaussian(sd, f->feature_radius, f->smooth);
    for (int k = 0; k <= f->feature_radius; k++) {
        const double g = exp(-0.5 * k * k / (sd * sd)), second = (k * k / (sd * sd) - 1.0) * g;
        edge += k * g;
        *(second > 0.0 ? &above : &below) += (k ? 2.0 : 1.0) * second;
    }
    for (int k = 0; k <= f->feature_radius; k++) {
        const double g = exp(-0.5 * k * k / (sd * sd)), second = (k * k / (sd * sd) - 1.0) * g;
        f->edge[k] = (float) (k * g / edge);
        f->point[k] = (float) (second > 0.0 ? second / above : second / -below);
    }
}

void pell_flip_prepare(double ppd, struct pell_flip_filters *f)
{
    static const double blue_yellow[2][2] = { { 34.1, 0.04 }, { 13.5, 0.025 } }, green[3] = { 0, 1, 0 }, blue[3] = { 0, 0, 1 };
    const double sd_a = sqrt(0.0047 / (2.0 * PELL_PI * PELL_PI)) * ppd, sd_rg = sqrt(0.0053 / (2.0 * PELL_PI * PELL_PI)) * ppd;
    double inverse[9], weight[2], a[3], b[3], end;

    memset(f, 0, sizeof(*f));
    f->blue_yellow_radius = (int) ceil(3.0 * sqrt(0.04 / (2.0 * PELL_PI * PELL_PI)) * ppd);
    f->achromatic_radius = at_most(ceil(6.0 * sd_a), f->blue_yellow_radius);
    f->red_green_radius = at_most(ceil(6.0 * sd_rg), f->blue_yellow_radius);
    gaussian(sd_a, f->achromatic_radius, f->achromatic);
    gaussian(sd_rg, f->red_green_radius, f->red_green);
    for (int i = 0; i < 2; i++) {
        const double sum = gaussian(sqrt(blue_yellow[i][1] / (2.0 * PELL_PI * PELL_PI)) * ppd, f->blue_yellow_radius, f->blue_yellow[i]);
        weight[i] = blue_yellow[i][0] * sqrt(PELL_PI / blue_yellow[i][1]) * sum * sum;
    }
    for (int i = 0; i < 2; i++)
        f->blue_yellow_weight[i] = (float) (weight[i] / (weight[0] + weight[1]));
    prepare_features(ppd, f);
    f->radius = f->blue_yellow_radius > f->feature_radius ? f->blue_yellow_radius : f->feature_radius;

    invert(rgb_to_xyz, inverse);
    for (int i = 0; i < 9; i++) {
        f->to_xyz[i] = (float) rgb_to_xyz[i];
        f->from_xyz[i] = (float) inverse[i];
    }
    /* The largest distance is that of green and blue; 0.4 of its power becomes 0.95. */
    hunt(green, a);
    hunt(blue, b);
    end = pow(fabs(a[0] - b[0]) + hypot(a[1] - b[1], a[2] - b[2]), 0.7);
    f->scale = (float) end;
    f->knee = (float) (0.4 * end);
    f->low_slope = (float) (0.95 / (0.4 * end));
    f->high_slope = (float) (0.05 / (0.6 * end));
}

double pell_aces(double x)
{
    const double at = x < 1e6 ? x : 1e6, v = at * (0.36 * 2.51 * at + 0.6 * 0.03) / (at * (0.36 * 2.43 * at + 0.6 * 0.59) + 0.14);
    return v < 1.0 ? v : 1.0;
}

void pell_flip_exposures(double largest, double median, double *start, double *stop, int *count)
{
    /* Where the curve is 0.85: a x^2 + b x + c = 0. */
    const double t = 0.85, a = 0.36 * (2.51 - t * 2.43), b = 0.6 * (0.03 - t * 0.59), c = -t * 0.14;
    const double x = (-b + sqrt(b * b - 4.0 * a * c)) / (2.0 * a), stops = log2(largest / median);

    *start = log2(x / largest);
    *stop = log2(x / median);
    *count = stops > 2.0 ? (int) ceil(stops) : 2;
}

void pell_ssim_window(float *window)
{
    gaussian(1.5, PELL_SSIM_RADIUS, window);
}

int pell_tile_row(int pad)
{
    return (PELL_TILE_WIDTH + 2 * pad + 15) / 16 * 16;
}

size_t pell_tile_scratch(int pad)
{
    const size_t rows = (size_t) (PELL_TILE_HEIGHT + 2 * pad), padded = (size_t) pell_tile_row(pad) * rows;
    const size_t flip = 10 * (size_t) PELL_TILE_WIDTH * PELL_TILE_HEIGHT + 3 * padded + 7 * rows * PELL_TILE_WIDTH;
    const size_t ssim = 11 * padded + 5 * rows * PELL_TILE_WIDTH;
    return flip > ssim ? flip : ssim;
}
