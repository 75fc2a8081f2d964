/* SPDX-License-Identifier: MIT
 * table.c - rows of the table that `compare INPUT` prints, from the numbers of answer.c. */
#include "cli/compare/compare.h"

#include <math.h>
#include <stdio.h>

void table_head(const struct cli *cli, const char *title, bool times)
{
    printf("\n%s%s%s\n%-24s %9s %8s %8s %8s %8s %8s %8s%s\n", cli_style(cli, stdout, 1), title, cli_style(cli, stdout, 0), "", "error",
           "bias r", "bias g", "bias b", "ssim", "flip", "flip hdr", times ? "   seconds" : "");
}

void table_row(const char *name, const json_t *m, double seconds)
{
    static const char *const keys[] = { "ssim", "flip", "flip_hdr" };
    const json_t *bias = json_object_get(m, "rel_bias"), *error = json_object_get(m, "rel_mse");
    char shown[64];

    printf("%-24s", pell_printable(name, shown, 25));
    if (json_is_real(error))
        printf(" %7.2f %%", 100.0 * sqrt(json_real_value(error)));
    else
        printf(" %9s", "-");
    for (size_t c = 0; c < 3; c++)
        printf(" %+6.2f %%", 100.0 * json_number_value(json_array_get(bias, c)));
    for (size_t k = 0; k < PELL_COUNT(keys); k++)
        printf(" %8.4f", json_number_value(json_object_get(m, keys[k])));
    if (seconds >= 0.0)
        printf(" %9.3f", seconds);
    putchar('\n');
}

void table_noise_head(const struct cli *cli)
{
    printf("%s%-24s %9s %8s %8s %8s %8s %8s  %s%s\n", cli_style(cli, stdout, 1), "Noise of these: +-", "error", "bias r", "bias g",
           "bias b", "|z| > 3", "p", "within noise", cli_style(cli, stdout, 0));
}

void table_noise_row(const char *name, const json_t *m)
{
    const json_t *bias = json_object_get(m, "rel_bias_error"), *agreement = json_object_get(m, "agreement");
    const double mean = json_number_value(json_object_get(m, "rel_mse")), error = json_number_value(json_object_get(m, "rel_mse_error"));
    const json_t *beyond = json_object_get(agreement, "beyond_3");
    const double p = json_number_value(json_object_get(agreement, "p"));
    char shown[64];

    printf("%-24s", pell_printable(name, shown, 25));
    if (mean > 0.0)
        printf(" %7.2f %%", 100.0 * 0.5 * error / sqrt(mean)); /* half the relative error of the square: that of the root */
    else
        printf(" %9s", "-");
    for (size_t c = 0; c < 3; c++)
        printf(" %6.2f %%", 100.0 * json_number_value(json_array_get(bias, c)));
    if (json_is_real(beyond))
        printf(" %6.2f %%", 100.0 * json_real_value(beyond));
    else
        printf(" %8s", "-");
    if (p < 1e-4)
        puts("  < 1e-4  differs");
    else
        printf(" %8.4f  %s\n", p, p < COMPARE_LIKELY ? "differs" : "agrees");
}
