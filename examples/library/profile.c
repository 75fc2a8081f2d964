/* SPDX-License-Identifier: MIT
 * profile.c - the smallest use: optical coefficients become a profile, a sum of Gaussians and the parameters of a blur. No scene, no
 * files.
 *
 *     profile [MATERIAL] */
#include <pellucid/optics.h>

#include <math.h>
#include <stdio.h>

enum { GAUSSIANS = 4 };

static const struct pell_medium wax = {
    .sigma_a = { 0.006, 0.03, 0.12 },      /* 1/mm */
    .sigma_s_reduced = { 1.4, 1.25, 1.1 }, /* 1/mm, already times (1 - g) */
    .eta = 1.44,
};

static void print_profile(const struct pell_medium *medium)
{
    static const char names[3] = { 'R', 'G', 'B' };

    printf("channel  mean free path  diffuse mfp   total  R(0.1 mm)  R(1 mm)  light within 1 mm\n");
    for (int c = 0; c < 3; c++) {
        const struct pell_dipole d = pell_dipole_make(medium->sigma_a[c], medium->sigma_s_reduced[c], medium->eta, PELL_FRESNEL_EXACT);

        printf("%-7c  %11.4f mm  %8.4f mm  %6.4f  %9.4f  %7.4f  %16.1f%%\n", names[c], pell_mean_free_path(medium, c),
               pell_diffuse_mean_free_path(medium, c), pell_dipole_total(&d), pell_dipole_rd(&d, 0.1), pell_dipole_rd(&d, 1.0),
               100.0 * pell_dipole_cdf(&d, 1.0));
    }
}

/* A chain of blurs, Gaussian after Gaussian, each applied to the previous result: the variance to add, and the weight of the new result. */
static void print_blur(const struct pell_gaussians *g)
{
    double sum[3] = { 0 }, last = 0.0;

    printf("pass  standard deviation of the step  share of the new result R G B\n");
    for (int i = 0; i < g->count; i++) {
        const double step = sqrt(g->variance[i] - last);

        printf("%4d  %27.4f mm ", i, step);
        for (int c = 0; c < 3; c++) {
            sum[c] += g->weight[i][c];
            printf(" %6.4f", sum[c] > 0.0 ? g->weight[i][c] / sum[c] : 0.0);
        }
        printf("\n");
        last = g->variance[i];
    }
    printf("then times the total reflectance: %.4f %.4f %.4f\n", sum[0], sum[1], sum[2]);
}

int main(int argc, char **argv)
{
    const struct pell_material_entry *entry = argc > 1 ? pell_material_find(argv[1]) : NULL;
    const struct pell_medium *medium = entry ? &entry->medium : &wax;
    struct pell_medium_fault fault;
    struct pell_gaussians fit;
    struct pell_fit_report report;

    if (argc > 1 && (!entry || entry->kind != PELL_MATERIAL_MEDIUM)) {
        fprintf(stderr, "%s: not a built-in material with coefficients\n", argv[1]);
        return 2;
    }
    if (!pell_medium_valid(medium, &fault)) {
        fprintf(stderr, "%s is %g, allowed: [%g, %g]\n", fault.field, fault.value, fault.min, fault.max);
        return 2;
    }
    print_profile(medium);
    if (pell_fit_medium(medium, &(struct pell_fit_params) { .count = GAUSSIANS }, &fit, &report) != PELL_OK)
        return 1;
    printf("\n%d Gaussians, error %.2f %.2f %.2f %%\n", fit.count, 100 * report.error[0], 100 * report.error[1], 100 * report.error[2]);
    for (int i = 0; i < fit.count; i++)
        printf("variance %9.5f mm^2, weights %7.4f %7.4f %7.4f\n", fit.variance[i], fit.weight[i][0], fit.weight[i][1], fit.weight[i][2]);
    printf("\n");
    print_blur(&fit);
    return 0;
}
