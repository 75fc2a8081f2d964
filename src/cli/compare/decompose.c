/* SPDX-License-Identifier: MIT
 * decompose.c - splits an error into two parts: the error for direct illumination, and the error for interreflection between surfaces.
 *
 *     A_n - B_n = (A_0 - B_0) + ((A_n - A_0) - (B_n - B_0))
 *
 * A is the method, B the reference, n the number of bounces, 0 none. Biases add up. Squares do not where both parts err at the same pixels.
 * All are relative to the same B_n.
 *
 * B_n and B_0 use one seed, with which the light of B_0 is contained in that of B_n, so that their difference has only its own noise: about
 * the variance of B_n less that of B_0 (a bunny of milk, of marble: 0.94, 1.01 of what six seeds show). References that are rendered as two
 * halves are so with and without bounces, and give their own noise estimate. */
#include "cli/compare/compare.h"

#include "compare/errors.h"

#include <math.h>

static const char *const names[DECOMPOSE_PARTS] = { "method", "interreflection", "total" };

static void subtract(const float *a, const float *b, size_t count, float *difference)
{
    for (size_t i = 0; i < count; i++)
        difference[i] = a[i] - b[i];
}

/* Computes the light that bounces add to both images, in nine planes. */
static void take_bounces(const struct decompose_input *in, float *planes, struct pell_compare_part *part)
{
    const size_t count = (size_t) in->whole.width * (size_t) in->whole.height;

    *part = (struct pell_compare_part) { .test = { NULL } };
    for (size_t c = 0; c < 3; c++) {
        float *test = planes + c * count, *reference = test + 3 * count, *other = reference + 3 * count;
        subtract(in->whole.test[c], in->direct.test[c], count, test);
        subtract(in->whole.reference[c], in->direct.reference[c], count, reference);
        part->test[c] = test;
        part->reference[c] = reference;
        if (in->direct.half[0]) {
            subtract(in->whole.half[c], in->direct.half[c], count, other);
            part->half[c] = other;
        } else if (in->direct.variance[0]) {
            subtract(in->whole.variance[c], in->direct.variance[c], count, other);
            for (size_t i = 0; i < count; i++)
                other[i] = fmaxf(other[i], 0.0f);
            part->variance[c] = other;
        }
    }
}

/* Computes the fraction of bounces in the reference's light over the masked pixels. */
static void fraction_of(const struct decompose_input *in, const struct pell_compare_part *bounces, double fraction[3])
{
    const size_t count = (size_t) in->whole.width * (size_t) in->whole.height;
    double sum[3] = { 0.0 }, all[3] = { 0.0 };

    for (size_t i = 0; i < count; i++) {
        struct pell_pixel p;
        pell_pixel_read(&in->whole, i, &p);
        for (int c = 0; pell_inside(&in->whole, i) && !p.bad_test && !p.bad_reference && c < 3; c++) {
            const double b1 = bounces->reference[c][i], b2 = bounces->half[0] ? bounces->half[c][i] : b1;
            sum[c] += 0.5 * (b1 + b2);
            all[c] += p.reference[c];
        }
    }
    for (int c = 0; c < 3; c++)
        fraction[c] = all[c] > 0.0 ? sum[c] / all[c] : 0.0;
}

enum pell_result decompose_error(struct cli *cli, int threads, const struct decompose_input *in, struct decomposition *out)
{
    const size_t count = (size_t) in->whole.width * (size_t) in->whole.height;
    struct pell_compare_part bounces;
    float *planes = pell_alloc_array(cli->ctx, count, 9 * sizeof(*planes));
    enum pell_result res = PELL_ERR_NOMEM;

    if (!planes)
        return res;
    take_bounces(in, planes, &bounces);
    fraction_of(in, &bounces, out->interreflection);
    for (int k = 0; k < DECOMPOSE_PARTS; k++)
        out->part[k] = in->total;
    PELL_TRY(pell_errors_of_part(cli->ctx, threads, &in->whole, &in->direct, &out->part[DECOMPOSE_METHOD]));
    PELL_TRY(pell_errors_of_part(cli->ctx, threads, &in->whole, &bounces, &out->part[DECOMPOSE_INTERREFLECTION]));
fail:
    pell_free(cli->ctx, planes);
    return res;
}

json_t *decompose_json(const struct decomposition *d)
{
    json_t *o = json_object();

    for (int k = 0; k < DECOMPOSE_PARTS; k++)
        json_object_set_new(o, names[k], compare_part(&d->part[k]));
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
        const json_t *error = json_object_get(part, "rel_mse");
        double sum = 0.0;
        for (size_t c = 0; c < 3; c++)
            sum += json_number_value(json_array_get(bias, c)) / 3.0;
        if (json_is_real(error))
            printf(" %*.2f %% %+6.2f %%", width[k], 100.0 * sqrt(json_real_value(error)), 100.0 * sum);
        else
            printf(" %*s %+6.2f %%", width[k] + 2, "-", 100.0 * sum);
    }
    putchar('\n');
}
