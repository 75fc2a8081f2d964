/* SPDX-License-Identifier: MIT
 *
 * fit_table.c - prints the tables of fit errors of src/optics/README.md: error (10) of the built-in media in percent, with 4 Gaussians
 * per channel R G B, the root mean square over all channels for each count, and the exact mixture over the count. */
#include <pellucid/optics.h>

#include <math.h>
#include <stdio.h>
#include <string.h>

/* Errors with shared and with separate variances; false if a fit fails. */
static bool fits(const struct pell_medium *m, int count, double shared[3], double own[3])
{
    const struct pell_fit_params params = { .count = count };
    struct pell_gaussians g;
    struct pell_fit_report report;

    if (pell_fit_medium(m, &params, &g, &report) != PELL_OK)
        return false;
    for (int c = 0; c < 3; c++) {
        const struct pell_dipole d = pell_dipole_make(m->sigma_a[c], m->sigma_s_reduced[c], m->eta, PELL_FRESNEL_EXACT);
        struct pell_fit_report one;
        if (pell_fit_dipole(&d, &params, &g, &one) != PELL_OK)
            return false;
        shared[c] = 100.0 * report.error[c];
        own[c] = 100.0 * one.error[0];
    }
    return true;
}

static bool row_per_material(void)
{
    printf("| material | shared, R G B | own, R G B |\n|---|---|---|\n");
    for (size_t i = 0; i < pell_material_count(); i++) {
        const struct pell_material_entry *e = pell_material_at(i);
        double s[3], o[3];
        if (strcmp(e->family, "Jensen et al. 2001") != 0)
            continue;
        if (!fits(&e->medium, 4, s, o))
            return false;
        printf("| %s | %.3g %.3g %.3g | %.3g %.3g %.3g |\n", e->name, s[0], s[1], s[2], o[0], o[1], o[2]);
    }
    return true;
}

static bool row_per_count(void)
{
    printf("\n| Gaussians | shared | own |\n|---|---|---|\n");
    for (int k = 1; k <= PELL_GAUSSIANS_MAX; k++) {
        double shared = 0.0, own = 0.0;
        int channels = 0;
        for (size_t i = 0; i < pell_material_count(); i++) {
            const struct pell_material_entry *e = pell_material_at(i);
            double s[3], o[3];
            if (strcmp(e->family, "Jensen et al. 2001") != 0)
                continue;
            if (!fits(&e->medium, k, s, o))
                return false;
            for (int c = 0; c < 3; c++) {
                shared += s[c] * s[c];
                own += o[c] * o[c];
                channels++;
            }
        }
        printf("| %d | %.3g | %.3g |\n", k, sqrt(shared / channels), sqrt(own / channels));
    }
    return true;
}

/* Error (10) of the exact mixture reduced to k Gaussians, against 400 of them. */
static bool row_per_count_of_mixture(void)
{
    static const double xs[] = { 0.0, 0.01, 0.1, 1.0, 10.0 };
    static double dense_v[400], dense_w[400], v[64], w[64];

    printf("\n| Gaussians | x = 0 | 0.01 | 0.1 | 1 | 10 |\n|---|---|---|---|---|---|\n");
    for (size_t k = 2; k <= 32; k += k < 8 ? 2 : 8) {
        printf("| %zu", k);
        for (size_t i = 0; i < sizeof(xs) / sizeof(xs[0]); i++) {
            if (pell_pole_gaussians(1.0, xs[i], dense_v, dense_w, 400) != PELL_OK || pell_pole_gaussians(1.0, xs[i], v, w, k) != PELL_OK)
                return false;
            const double percent = 100.0 * pell_gaussian_set_error(dense_v, dense_w, 400, v, w, k);
            if (percent < 1e-5) /* the closed form has no significant digits */
                printf(" | < 1e-5");
            else
                printf(" | %.2g", percent);
        }
        printf(" |\n");
    }
    return true;
}

int main(void)
{
    return row_per_material() && row_per_count() && row_per_count_of_mixture() ? 0 : 1;
}
