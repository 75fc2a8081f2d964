/* SPDX-License-Identifier: MIT
 *
 * gaussian_sets.c - sums of any number of Gaussians as arrays: values, moments, products, convolution and reduction,
 * d'Eon, Luebke, Enderton 2007, section 4 and eqs. (10), (11). */
#include <pellucid/gaussians.h>

#include "math/vec.h"

#include <math.h>

double pell_gaussian_set_eval(const double *variance, const double *weight, size_t count, double r_mm)
{
    double sum = 0.0;
    for (size_t i = 0; i < count; i++)
        if (weight[i] != 0.0)
            sum += weight[i] * exp(-0.5 * r_mm * r_mm / variance[i]) / (2.0 * PELL_PI * variance[i]);
    return sum;
}

double pell_gaussian_set_total(const double *weight, size_t count)
{
    double sum = 0.0;
    for (size_t i = 0; i < count; i++)
        sum += weight[i];
    return sum;
}

double pell_gaussian_set_moment(const double *variance, const double *weight, size_t count)
{
    double sum = 0.0;
    for (size_t i = 0; i < count; i++)
        sum += weight[i] * variance[i];
    return 2.0 * sum;
}

double pell_gaussian_set_inner(const double *variance_a, const double *weight_a, size_t count_a, const double *variance_b,
                               const double *weight_b, size_t count_b)
{
    double sum = 0.0;
    for (size_t i = 0; i < count_a; i++)
        for (size_t j = 0; j < count_b; j++)
            if (weight_a[i] * weight_b[j] != 0.0)
                sum += weight_a[i] * weight_b[j] / (variance_a[i] + variance_b[j]);
    return sum / (4.0 * PELL_PI * PELL_PI);
}

double pell_gaussian_set_error(const double *variance_a, const double *weight_a, size_t count_a, const double *variance_b,
                               const double *weight_b, size_t count_b)
{
    const double aa = pell_gaussian_set_inner(variance_a, weight_a, count_a, variance_a, weight_a, count_a);
    const double ab = pell_gaussian_set_inner(variance_a, weight_a, count_a, variance_b, weight_b, count_b);
    const double bb = pell_gaussian_set_inner(variance_b, weight_b, count_b, variance_b, weight_b, count_b);

    return aa > 0.0 ? sqrt(fmax(0.0, aa - 2.0 * ab + bb) / aa) : NAN;
}

void pell_gaussian_set_convolve(const double *variance_a, const double *weight_a, size_t count_a, const double *variance_b,
                                const double *weight_b, size_t count_b, double *variance, double *weight)
{
    for (size_t i = 0; i < count_a; i++)
        for (size_t j = 0; j < count_b; j++) {
            variance[i * count_b + j] = variance_a[i] + variance_b[j];
            weight[i * count_b + j] = weight_a[i] * weight_b[j];
        }
}

enum pell_result pell_gaussian_set_targets(const double *variance, const double *weight, size_t count, double *target, size_t targets)
{
    if (((!variance || !weight) && count) || (!target && targets))
        return PELL_ERR_INVALID;

    double low = INFINITY, high = 0.0, sum = 0.0, moment = 0.0;

    for (size_t i = 0; i < count; i++) {
        if (!isfinite(weight[i]) || !isfinite(variance[i]) || variance[i] < 0.0)
            return PELL_ERR_INVALID;
        if (weight[i] == 0.0 || variance[i] == 0.0)
            continue;
        low = fmin(low, variance[i]);
        high = fmax(high, variance[i]);
        sum += fabs(weight[i]);
        moment += fabs(weight[i]) * variance[i];
    }
    if (targets < 1 || !(high > 0.0))
        return PELL_ERR_INVALID;
    if (targets == 1) {
        target[0] = moment / sum;
        return PELL_OK;
    }
    if (!(high > low)) /* one variance: keep them increasing, it is the first */
        high = 2.0 * low;
    for (size_t i = 0; i < targets; i++) {
        const double t = (double) i / (double) (targets - 1);
        target[i] = exp((1.0 - t) * log(low) + t * log(high));
    }
    target[0] = low; /* the exponential of a logarithm is not exact, and nothing may lie outside */
    target[targets - 1] = high;
    return PELL_OK;
}

void pell_gaussian_set_reduce(const double *variance, const double *weight, size_t count, const double *target, size_t targets, double *out)
{
    for (size_t i = 0; i < targets; i++)
        out[i] = 0.0;
    for (size_t i = 0; i < count && targets > 0; i++) {
        size_t low = 0, high = targets; /* target[low] <= variance < target[high], where such exist */
        while (high - low > 1) {
            const size_t middle = low + (high - low) / 2;
            if (target[middle] <= variance[i])
                low = middle;
            else
                high = middle;
        }
        if (high == targets || variance[i] <= target[low]) {
            out[low] += weight[i];
        } else {
            const double fraction = (variance[i] - target[low]) / (target[high] - target[low]);
            out[low] += (1.0 - fraction) * weight[i];
            out[high] += fraction * weight[i];
        }
    }
}
