/* SPDX-License-Identifier: MIT
 * decompose.c - an error in its parts: what a method does wrong with light that comes straight from lights, and what is missing or wrong of
 * the light that surfaces send each other.
 *
 *     A_n - B_n = (A_0 - B_0) + ((A_n - A_0) - (B_n - B_0))
 *
 * A is the method, B the truth, n the bounces that each has, 0 none. Biases add up. Squares do not where both parts are wrong at the same
 * places: all are given over the same B_n.
 *
 * B_n and B_0 are of one seed, in which the light of B_0 is a part of that of B_n, so that their difference has only its own noise: about
 * the variance of B_n less that of B_0 (a bunny in milk, in marble: 0.94, 1.01 of what six seeds show). */
#include "cli/compare/compare.h"

#include <math.h>

static const char *const names[DECOMPOSE_PARTS] = { "method", "interreflection", "total" };

static bool counts(const struct decompose_input *in, size_t i)
{
    double sum = 0.0;

    for (int n = 0; n < 2; n++)
        for (int c = 0; c < 3; c++)
            sum += (double) in->test[n][c][i] + (double) in->reference[n][c][i] + (double) in->variance[n][c][i];
    return in->mask[i] > 0.5f && isfinite(sum);
}

/* What noise of variance v in a part of the reference b adds to d^2/(b^2 + e^2), to first order in v where b has `little` noise, as in
 * pell_compare; `in_d`: that part is in d, too. */
static double noise_of(double d, double b, double below, double v, bool in_d, bool little)
{
    const double whole = d * d * (4.0 * b * b / below - 1.0) / below;

    return v / below * ((in_d ? 1.0 : 0.0) + (little ? whole + (in_d ? 4.0 * d * b / below : 0.0) : 0.0));
}

void decompose_error(const struct decompose_input *in, struct decomposition *out)
{
    static const double luminance[3] = { 0.2126, 0.7152, 0.0722 };
    double mean[3] = { 0.0 }, floor = 0.0;
    size_t pixels = 0;

    *out = (struct decomposition) { .rel_mse = { 0.0 } };
    for (size_t i = 0; i < in->count; i++) {
        if (!counts(in, i))
            continue;
        pixels++;
        for (int c = 0; c < 3; c++) {
            mean[c] += (double) in->reference[0][c][i];
            out->interreflection[c] += (double) in->reference[0][c][i] - (double) in->reference[1][c][i];
        }
    }
    if (pixels == 0)
        return;
    for (int c = 0; c < 3; c++)
        floor += in->floor * luminance[c] * mean[c] / (double) pixels;
    for (size_t i = 0; i < in->count; i++) {
        if (!counts(in, i))
            continue;
        for (int c = 0; c < 3; c++) {
            const double b = (double) in->reference[0][c][i], below = fmax(b * b + floor * floor, 1e-300);
            const double own = (double) in->test[1][c][i] - (double) in->reference[1][c][i], all = (double) in->test[0][c][i] - b;
            const double d[DECOMPOSE_PARTS] = { own, all - own, all };
            const double straight = (double) in->variance[1][c][i], rest = (double) in->variance[0][c][i] - straight;
            const bool little = (double) in->variance[0][c][i] < 0.1 * below;
            for (int k = 0; k < DECOMPOSE_PARTS; k++) {
                out->rel_mse[k] += d[k] * d[k] / below - noise_of(d[k], b, below, straight, k != DECOMPOSE_INTERREFLECTION, little) -
                                   noise_of(d[k], b, below, rest, k != DECOMPOSE_METHOD, little);
                out->rel_bias[k][c] += d[k];
            }
        }
    }
    for (int k = 0; k < DECOMPOSE_PARTS; k++) {
        out->rel_mse[k] = fmax(out->rel_mse[k], 0.0) / (3.0 * (double) pixels);
        for (int c = 0; c < 3; c++)
            out->rel_bias[k][c] = mean[c] > 0.0 ? out->rel_bias[k][c] / mean[c] : 0.0;
    }
    for (int c = 0; c < 3; c++)
        out->interreflection[c] = mean[c] > 0.0 ? out->interreflection[c] / mean[c] : 0.0;
}

json_t *decompose_json(const struct decomposition *d)
{
    json_t *o = json_object();

    for (int k = 0; k < DECOMPOSE_PARTS; k++)
        json_object_set_new(
            o, names[k],
            json_pack("{s:f,s:[f,f,f]}", "rel_mse", d->rel_mse[k], "rel_bias", d->rel_bias[k][0], d->rel_bias[k][1], d->rel_bias[k][2]));
    return o;
}

void decompose_print_head(const struct cli *cli, const char *truth, const double interreflection[3])
{
    printf("\n%sParts of the error of the subsurface light against %s%s, of which interreflection is %.2f, %.2f, %.2f %% (r, g, b)\n",
           cli_style(cli, stdout, 1), truth, cli_style(cli, stdout, 0), 100.0 * interreflection[0], 100.0 * interreflection[1],
           100.0 * interreflection[2]);
    printf("%-24s %9s %8s  %15s %8s  %9s %8s\n", "", "method", "bias", "interreflection", "bias", "total", "bias");
}

void decompose_print(const char *name, const json_t *parts)
{
    static const int width[DECOMPOSE_PARTS] = { 7, 14, 8 };
    char shown[64];

    printf("%-24s", pell_printable(name, shown, 25));
    for (int k = 0; k < DECOMPOSE_PARTS; k++) {
        const json_t *part = json_object_get(parts, names[k]), *bias = json_object_get(part, "rel_bias");
        double sum = 0.0;
        for (size_t c = 0; c < 3; c++)
            sum += json_number_value(json_array_get(bias, c)) / 3.0;
        printf(" %*.2f %% %+6.2f %%", width[k], 100.0 * sqrt(json_number_value(json_object_get(part, "rel_mse"))), 100.0 * sum);
    }
    putchar('\n');
}
