/* SPDX-License-Identifier: MIT
 *
 * radial.c - tables of a profile over the squared radius: its values, its integral along lines, its integral over squares, and the response
 * of the planes.
 */
#include "methods/convolution/convolution.h"

#include "math/quadrature.h"
#include "math/vec.h"

#include <stdint.h>
#include <string.h>

enum { NODES = 24 };

/* Rows are uniform within each octave, so that the row index consists of bits of the float. */
static double radius2_at(const struct conv_radial *r, int row, int octave)
{
    return (double) r->median2 * (1.0 + (double) (row % octave) / octave) * exp2(row / octave - CONV_OCTAVES / 2);
}

/* Linear interpolation; constant below the first row, 0 beyond the last. `bits`: log2 of the rows per octave. */
static inline float look_up(const float *table, int rows, int bits, float per_median2, float radius2)
{
    const float x = radius2 * per_median2;
    const int shift = 23 - bits;
    uint32_t word;
    int row;
    float f;

    memcpy(&word, &x, sizeof(word));
    row = (int) (word >> shift) - ((127 - CONV_OCTAVES / 2) << bits);
    if (row < 0)
        return table[0];
    if (row >= rows)
        return 0.0f;
    f = (float) (word & ((1u << shift) - 1)) * (1.0f / (float) (1u << shift));
    return table[row] + f * (table[row + 1] - table[row]);
}

float convolution_radial_value(const struct conv_radial *r, float radius2)
{
    return look_up(r->value, CONV_ROWS, 5, r->per_median2, radius2);
}

static float line_value(const struct conv_radial *r, float distance2)
{
    return look_up(r->line, CONV_LINE_ROWS, 3, r->per_median2, distance2);
}

/* Int R(sqrt(d^2 + y^2)) dy by the trapezoidal rule in log y. */
static double integrate_line(const struct conv_radial *r, double distance2)
{
    const double step = log(2.0) / 8.0, first = sqrt((double) r->median2) * exp2(-CONV_OCTAVES / 4);
    double sum = (double) convolution_radial_value(r, (float) distance2) * first;

    for (int i = 0; i < 4 * CONV_OCTAVES; i++) {
        const double y = first * exp(step * i);
        sum += (double) convolution_radial_value(r, (float) (distance2 + y * y)) * y * step * (i == 0 ? 0.5 : 1.0);
    }
    return 2.0 * sum;
}

static void make_channel(const struct pell_frame_material *m, double radius_scale, int c, float *memory, struct conv_radial *r)
{
    const double total = pell_profile_total(&m->profile[c]);
    const double median = total > 0.0 ? radius_scale * pell_profile_sample(&m->profile[c], 0.5) : 0.0;

    *r = (struct conv_radial) {
        .profile = &m->profile[c],
        .radius_scale = radius_scale,
        .scale = m->white && total > 0.0 ? (float) (1.0 / total) : 1.0f,
        .total = m->white ? 1.0f : (float) total,
        .point = !(median > 1e-12 && median < 1e12),
        .median2 = median > 1e-12 && median < 1e12 ? (float) (median * median) : 1.0f,
        .per_median2 = median > 1e-12 && median < 1e12 ? (float) (1.0 / (median * median)) : 1.0f,
        .value = memory,
        .line = memory + CONV_ROWS + 2,
    };
    memset(memory, 0, CONV_RADIAL_FLOATS * sizeof(*memory));
    if (r->point)
        return;
    for (int i = 0; i <= CONV_ROWS; i++) {
        const double at = sqrt(radius2_at(r, i, CONV_ROWS_OCTAVE)) / radius_scale;
        const double R = pell_profile_eval(r->profile, at) / (radius_scale * radius_scale) * (double) r->scale;
        r->value[i] = R < 1e37 ? (float) R : 1e37f;
    }
    for (int i = 0; i <= CONV_LINE_ROWS; i++)
        r->line[i] = (float) integrate_line(r, radius2_at(r, i, CONV_LINE_OCTAVE));
}

void convolution_radial_make(const struct pell_frame_material *m, double radius_scale, float *memory, struct conv_radial out[3])
{
    for (int c = 0; c < 3; c++)
        make_channel(m, radius_scale, c, memory + c * CONV_RADIAL_FLOATS, &out[c]);
}

double convolution_reach(const struct conv_radial r[3], double fraction)
{
    double reach = 0.0;

    for (int c = 0; c < 3; c++)
        if (!r[c].point)
            reach = fmax(reach, r[c].radius_scale * pell_profile_sample(r[c].profile, 1.0 - fraction));
    return reach;
}

double convolution_radial_beyond(const struct conv_radial *r, double h)
{
    return r->point ? (h > 0.0 ? 0.0 : (double) r->total) : (double) r->total * (1.0 - pell_profile_cdf(r->profile, h / r->radius_scale));
}

/* --- Squares ------------------------------------------------------------------------------------------------------------------------- */

/* Light in the rectangle [0, x] x [0, y], from the light C(r) inside circles: 1/(2 pi) times the integral of C(edge) over the angle. */
static double in_corner(const struct conv_radial *r, double x, double y, const double *node, const double *weight)
{
    double sum = 0.0;

    for (int side = 0; side < 2; side++) {
        const double a = side ? y : x, b = side ? x : y, angle = atan2(b, a);
        for (int i = 0; i < NODES; i++)
            sum += weight[i] * angle * pell_profile_cdf(r->profile, a / (cos(angle * node[i]) * r->radius_scale));
    }
    return (double) r->total * sum / (2.0 * PELL_PI);
}

void convolution_radial_squares(const struct conv_radial *r, double pixel, int count, double *out)
{
    double corner[17][17], node[NODES], weight[NODES]; /* [i][j]: to (i - 1/2, j - 1/2), 0: to (-1/2, ..) */

    if (r->point) {
        for (int i = 0; i < count * count; i++)
            out[i] = i == 0 ? (double) r->total : 0.0;
        return;
    }
    pell_gauss_legendre(NODES, node, weight);
    for (int j = 1; j <= count; j++)
        for (int i = j; i <= count; i++)
            corner[i][j] = corner[j][i] = in_corner(r, (i - 0.5) * pixel, (j - 0.5) * pixel, node, weight);
    for (int i = 1; i <= count; i++)
        corner[0][i] = corner[i][0] = -corner[1][i];
    corner[0][0] = corner[1][1];
    for (int y = 0; y < count; y++)
        for (int x = 0; x < count; x++)
            out[y * count + x] = fmax(corner[x + 1][y + 1] - corner[x][y + 1] - corner[x + 1][y] + corner[x][y], 0.0);
}

/* --- The response -------------------------------------------------------------------------------------------------------------------- */

static double split_of(const struct convolution_knobs *k, double t, int side)
{
    return k->split == CONV_HALF ? 0.5 : side ? t : 1.0 - t;
}

/* Quadrature points of the integrals below: x = first exp(i STEP), each with the width x STEP; the first one covers everything from 0. */
enum { POINTS = 110 };
#define STEP 0.15

static double point_at(const struct conv_radial *r, int i, double *width)
{
    const double x = 1e-3 * sqrt((double) r->median2) * exp(STEP * i);

    *width = i == 0 ? x * (1.0 + 0.5 * STEP) : x * STEP;
    return x;
}

/* The median distance from a line source. */
static double half_distance(const struct conv_radial *r)
{
    double all = 0.0, sum = 0.0, width;
    int i;

    for (i = 0; i < POINTS && !r->point; i++) {
        const double x = point_at(r, i, &width);
        all += width * (double) line_value(r, (float) (x * x));
    }
    for (i = 0; i + 1 < POINTS && sum < 0.5 * all; i++) {
        const double x = point_at(r, i, &width);
        sum += width * (double) line_value(r, (float) (x * x));
    }
    return point_at(r, i, &width);
}

/* A uniformly lit surface with a slope that crosses all planes: the light that it receives at coordinate t between two of them, summed over
 * lines perpendicular to the slope. *far: the part from more than `half` away in the image; *true_far: its exact value. Spacing 0: there is
 * a single plane. */
static double response_at(const struct conv_radial *r, const struct convolution_knobs *k, double spacing, double slope, double t,
                          double half, double *far, double *true_far)
{
    const double between = sqrt(2.0 * t * (1.0 - t));
    double sum = 0.0, all = 0.0, near = 0.0, true_near = 0.0;

    for (int i = 0; i < POINTS; i++) {
        double width;
        const double x = point_at(r, i, &width), plain = r->point ? (double) (i == 0) : (double) line_value(r, (float) (x * x));
        all += 2.0 * width * plain;
        if (plain * x < 1e-7 * all && x * x > (double) r->median2)
            break;
        for (int dir = -1; dir <= 1 && spacing > 0.0; dir += 2) {
            const double coord = t + (r->point ? 0.0 : dir * x * slope / spacing), low = floor(coord), f = coord - low;
            for (int from = 0; from < 2; from++)
                for (int to = 0; to < 2; to++) {
                    const double h = fmin(fabs(low + from - to), 1e6) * spacing;
                    const double line = h > 0.0 ? (r->point ? 0.0 : (double) line_value(r, (float) (x * x + h * h))) : plain;
                    sum += width * (to ? t : 1.0 - t) * split_of(k, f, from) * line;
                }
            if (k->restore == CONV_BETWEEN && low == 0.0)
                sum += width * between * sqrt(2.0 * f * (1.0 - f)) *
                       (plain - (r->point ? 0.0 : (double) line_value(r, (float) (x * x + spacing * spacing))));
        }
        if (!(spacing > 0.0))
            sum = all;
        near = x <= half ? sum : near;
        true_near = x <= half * sqrt(1.0 + slope * slope) ? all : true_near;
    }
    *far = sum > 0.0 ? 1.0 - near / sum : 0.0;
    *true_far = all > 0.0 ? 1.0 - true_near / all : 0.0;
    return all > 0.0 ? sqrt(1.0 + slope * slope) * sum / all : 1.0;
}

static double between_rows(const double *table, double at)
{
    const int low = at < CONV_SLANTS - 2 ? (int) at : CONV_SLANTS - 2;

    return table[low] + (at - low) * (table[low + 1] - table[low]);
}

void convolution_response_make(const struct conv_radial *r, const struct convolution_knobs *k, double spacing, struct conv_response *out)
{
    const double half = half_distance(r);
    double coord[CONV_SLANTS][CONV_PHASES], mean[CONV_SLANTS], far[CONV_SLANTS], true_far[CONV_SLANTS];
    double near_row[CONV_FINE][2], far_row[CONV_FINE][2];

    for (int j = 0; j < CONV_SLANTS; j++) {
        mean[j] = far[j] = true_far[j] = 0.0;
        for (int i = 0; 2 * i < CONV_PHASES; i++) { /* symmetric */
            const double s = j * sqrt(1.0 - (double) CONV_COS_MIN) / (CONV_SLANTS - 1), c = 1.0 - s * s;
            double beyond = 0.0, response = 1.0;
            if (k->restore != CONV_LOST)
                response = response_at(r, k, spacing, sqrt(fmax(1.0 - c * c, 0.0)) / c, i / (double) (CONV_PHASES - 1), half, &beyond,
                                       &true_far[j]);
            coord[j][i] = coord[j][CONV_PHASES - 1 - i] = 1.0 / sqrt(fmin(fmax(response, 1e-3), 1e3));
            far[j] += beyond / (CONV_PHASES / 2 + 1);
        }
        for (int i = 0; i < CONV_PHASES; i++)
            mean[j] += coord[j][i];
    }
    for (int j = CONV_SLANTS - 1; j >= 0; j--) {
        mean[j] /= mean[0];
        for (int i = 0; i < CONV_PHASES; i++)
            coord[j][i] /= mean[j];
    }
    for (int j = 0; j + 1 < CONV_SLANTS; j++)
        for (int i = 0; i + 1 < CONV_PHASES; i++) {
            const double low = coord[j][i], along = coord[j][i + 1] - low, up = coord[j + 1][i] - low;
            const double row[4] = { low, along, up, coord[j + 1][i + 1] - low - along - up };
            for (int n = 0; n < 4; n++)
                out->coord[j * (CONV_PHASES - 1) + i][n] = (float) row[n];
        }
    for (int i = 0; i < CONV_FINE; i++) {
        const double at = i * (double) (CONV_SLANTS - 1) / (CONV_FINE - 1), all = 1.0 / pow(between_rows(mean, at), 2.0);
        near_row[i][0] = all * (1.0 - between_rows(far, at));
        near_row[i][1] = 1.0 - between_rows(true_far, at);
        far_row[i][0] = all * between_rows(far, at);
        far_row[i][1] = between_rows(true_far, at);
    }
    for (int i = 0; i + 1 < CONV_FINE; i++)
        for (int n = 0; n < 2; n++) {
            out->near[i][n] = (float) near_row[i][n];
            out->near[i][n + 2] = (float) (near_row[i + 1][n] - near_row[i][n]);
            out->far[i][n] = (float) far_row[i][n];
            out->far[i][n + 2] = (float) (far_row[i + 1][n] - far_row[i][n]);
        }
}
