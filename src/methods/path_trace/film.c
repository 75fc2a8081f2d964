/* SPDX-License-Identifier: MIT
 * film.c - sums of samples. Each pixel's are added in the order of their numbers, by one thread at a time, so that they hang neither on the
 * number of threads nor on where a run was cut. */
#include "methods/path_trace/path_trace.h"

static double luminance(const double rgb[3])
{
    return 0.2126 * rgb[0] + 0.7152 * rgb[1] + 0.0722 * rgb[2];
}

static void judged(const double *const parts[PT_PARTS], bool traced, double out[4])
{
    for (int c = 0; c < 3; c++)
        out[c] = parts[PT_MULTIPLE][c] + parts[PT_SINGLE][c] + (traced ? parts[PT_SURFACE][c] : 0.0);
    out[3] = luminance(out);
}

/* B. P. Welford, "Note on a Method for Calculating Corrected Sums of Squares and Products", Technometrics 4, 1962: no difference of large
 * sums, so that little noise is still told from rounding. */
bool pt_pixel_add(struct pt_pixel *p, const struct pt_light *light, bool traced)
{
    static const struct pt_light black;
    const double *const sums[PT_PARTS] = { p->sum[PT_MULTIPLE], p->sum[PT_SINGLE], p->sum[PT_SURFACE] };
    const double before = p->count, after = before + 1.0;
    bool finite = true;
    double sum[4], x[4];

    for (int c = 0; c < 3; c++)
        finite = finite && isfinite(light->multiple[c]) && isfinite(light->single[c]) && isfinite(light->surface[c]);
    if (!finite)
        light = &black;
    judged(sums, traced, sum);
    judged((const double *const[PT_PARTS]) { light->multiple, light->single, light->surface }, traced, x);
    for (int c = 0; c < 4; c++) {
        const double apart = before > 0.0 ? x[c] - sum[c] / before : 0.0;
        p->spread[c] += apart * apart * (before / after);
    }
    for (int c = 0; c < 3; c++) {
        p->sum[PT_MULTIPLE][c] += light->multiple[c];
        p->sum[PT_SINGLE][c] += light->single[c];
        p->sum[PT_SURFACE][c] += light->surface[c];
    }
    p->count++;
    return finite;
}

void pt_pixel_measure(const struct pt_pixel *p, bool traced, double mean[4], double error[4])
{
    const double n = p->count;

    judged((const double *const[PT_PARTS]) { p->sum[PT_MULTIPLE], p->sum[PT_SINGLE], p->sum[PT_SURFACE] }, traced, mean);
    for (int c = 0; c < 4; c++) {
        mean[c] = n > 0.0 ? mean[c] / n : 0.0;
        error[c] = n > 1.0 ? sqrt(p->spread[c] / (n * (n - 1.0))) : 0.0;
    }
}

double pt_film_error(const struct pt_film *film, bool traced)
{
    double mean[4], error[4], total = 0.0, square = 0.0;

    for (size_t i = 0; i < film->count; i++) {
        if (film->pixels[i].count < 2)
            return (double) INFINITY;
        pt_pixel_measure(&film->pixels[i], traced, mean, error);
        total += mean[3];
    }
    if (!(total > 0.0))
        return 0.0;
    total /= (double) film->count;
    for (size_t i = 0; i < film->count; i++) {
        double relative;
        pt_pixel_measure(&film->pixels[i], traced, mean, error);
        relative = error[3] / fmax(fmax(mean[3], 0.01 * total), 1e-300); /* 0.01 of the least number is 0 */
        square += relative * relative;
    }
    return sqrt(square / (double) film->count);
}
