/* SPDX-License-Identifier: MIT
 * test_sampling.c - importance sampling of the dipole, and tables over the albedo. */
#include "oracle.h"

#include "math/quadrature.h"
#include "math/vec.h"

#include <pellucid/sampling.h>

/* --- Dipole ---------------------------------------------------------------------------------------------------------------------- */

static void poles_are_sampled_as_the_oracle(void **state)
{
    json_t *root = oracle_load("sampling.json"), *row;
    size_t i;
    (void) state;
    json_array_foreach(oracle_get(root, "sampling"), i, row)
    {
        const struct pell_dipole d =
            pell_dipole_make(oracle_number(row, "sigma_a"), oracle_number(row, "sigma_sp"), oracle_number(row, "eta"), PELL_FRESNEL_POLY3);
        const double t = oracle_number(row, "threshold_real");
        REQUIRE_REL(pell_dipole_real_share(&d), t, ROUNDED);
        for (size_t k = 0; k < json_array_size(oracle_get(row, "xi")); k++) {
            const double xi = oracle_at(row, "xi", k), real = oracle_at(row, "r_real", k), virtual = oracle_at(row, "r_virtual", k);
            REQUIRE_REL(pell_pole_sample(d.zr, d.sigma_tr, xi), real, ROUNDED);
            REQUIRE_REL(pell_pole_sample(d.zv, d.sigma_tr, xi), virtual, ROUNDED);
            REQUIRE_REL(pell_dipole_sample(&d, 0.5 * t, xi), real, ROUNDED);
            REQUIRE_REL(pell_dipole_sample(&d, 0.5 * (t + 1.0), xi), virtual, ROUNDED);
            REQUIRE_REL(pell_dipole_sample_one(&d, xi * pell_dipole_real_share(&d)), real, ROUNDED);
        }
    }
    assert_int_equal(i, 7);
    json_decref(root);
}

static void the_root_is_a_root(void **state)
{
    (void) state;
    for (double x = 1e-12; x < 1e7; x *= 3.0)
        for (double xi = 1e-15; xi < 1.0; xi = xi < 0.01 ? xi * 3.0 : xi + 0.0099) {
            const double r = pell_pole_sample(1.0, x, xi), more = r * r / (sqrt(1.0 + r * r) + 1.0); /* u - 1 */
            REQUIRE_REL(x * more + log1p(more), -log1p(-xi), 1e-12);
        }
    REQUIRE_REL(pell_pole_sample(2.0, 0.0, 0.75), 2.0 * sqrt(15.0), 1e-15); /* no absorption: u = 1/(1 - xi) */
}

static int by_size(const void *a, const void *b)
{
    const double x = *(const double *) a, y = *(const double *) b;
    return (x > y) - (x < y);
}

#define POINTS 22500

/* Kolmogorov's distance between the distribution and radii of equidistant numbers. */
static double distance(const struct pell_dipole *d, double *radius)
{
    double most = 0.0;
    qsort(radius, POINTS, sizeof(*radius), by_size);
    for (int i = 0; i < POINTS; i++)
        most = fmax(most, fabs(pell_dipole_cdf(d, radius[i]) - (i + 0.5) / POINTS));
    return most;
}

static void radii_are_distributed_as_the_dipole(void **state)
{
    static const double media[][2] = { { 0.0041, 2.62 }, { 0.48, 1.01 }, { 0.0, 1.0 }, { 3.0, 0.1 } };
    static double radius[POINTS];
    (void) state;
    for (size_t m = 0; m < PELL_COUNT(media); m++) {
        const struct pell_dipole d = pell_dipole_make(media[m][0], media[m][1], 1.4, PELL_FRESNEL_EXACT);
        for (int i = 0; i < POINTS; i++)
            radius[i] = pell_dipole_sample_one(&d, (i + 0.5) / POINTS);
        REQUIRE(distance(&d, radius) < 1.01 / POINTS);
        for (int i = 0; i < POINTS; i++)
            radius[i] = pell_dipole_sample(&d, (i / 150 + 0.5) / 150.0, (i % 150 + 0.5) / 150.0);
        REQUIRE(distance(&d, radius) < 1.1 / 150.0);
    }
}

static void densities_belong_to_samples(void **state)
{
    (void) state;
    for (double sa = 1e-6; sa < 10.0; sa *= 9.0) {
        const struct pell_dipole d = pell_dipole_make(sa, 1.0, 1.4, PELL_FRESNEL_EXACT);
        for (double r = 0.0; r < 30.0; r += 0.71)
            REQUIRE_REL(pell_dipole_pdf(&d, r), pell_dipole_rd(&d, r) / pell_dipole_total(&d), 1e-12);
    }
    const struct pell_dipole dark = pell_dipole_make(1e6, 1e-9, 4.0, PELL_FRESNEL_EXACT); /* its total is 1e-15 e^-1.7 at best */
    REQUIRE(isfinite(pell_dipole_pdf(&dark, 1e-7)) && pell_dipole_pdf(&dark, 1e-7) > 0.0);
}

static void odd_numbers_give_radii(void **state)
{
    static const double xis[] = { NAN, -1.0, 0.0, 5e-324, 1.0, 2.0, INFINITY, -INFINITY, 1.0 - 0x1p-53 };
    const struct pell_dipole dipoles[] = { pell_dipole_make(0.0, 1.0, 1.3, PELL_FRESNEL_EXACT),
                                           pell_dipole_make(1e6, 1e6, 1.3, PELL_FRESNEL_EXACT),
                                           pell_dipole_make(0.0, 0.0, 1.3, PELL_FRESNEL_EXACT),
                                           pell_dipole_make(1.0, 0.0, 1.3, PELL_FRESNEL_EXACT) };
    (void) state;
    for (size_t k = 0; k < PELL_COUNT(dipoles); k++)
        for (size_t i = 0; i < PELL_COUNT(xis); i++)
            for (size_t j = 0; j < PELL_COUNT(xis); j++) {
                const double r = pell_dipole_sample(&dipoles[k], xis[i], xis[j]), one = pell_dipole_sample_one(&dipoles[k], xis[i]);
                REQUIRE(isfinite(r) && r >= 0.0 && isfinite(one) && one >= 0.0);
                REQUIRE(isfinite(pell_dipole_pdf(&dipoles[k], xis[i])) && pell_dipole_pdf(&dipoles[k], xis[i]) >= 0.0);
            }
    REQUIRE(pell_dipole_sample(&dipoles[0], 0.3, 0.0) == 0.0);
}

/* --- Tables ---------------------------------------------------------------------------------------------------------------------- */

static struct pell_sampling_table table;

static double mass(double log_r, const void *albedo)
{
    const double r = exp(log_r);
    return 2.0 * PELL_PI * r * r * pell_sampling_table_pdf(&table, *(const double *) albedo, r);
}

/* At any albedo the distribution is within 6e-4 of the model's, radii within 3 %, the density within 2 %. */
static void tables_are_close_to_their_models(void **state)
{
    (void) state;
    for (int k = 0; k < PELL_PROFILE_MODELS; k++) {
        double worst = 0.0, worst_r = 0.0, worst_pdf = 0.0;
        REQUIRE(pell_sampling_table_make((enum pell_profile_model) k, 1.4, 0.0, NULL, &table) == PELL_OK);
        for (int i = 0; i <= 60; i++) {
            const double absorbed = pow(i / 60.0, 3.3), albedo = fmax(1e-6, 1.0 - absorbed);
            const struct pell_medium m = { { 1.0 - albedo, 1.0, 1.0 }, { albedo, 1.0, 1.0 }, { 0.0, 0.0, 0.0 }, 1.4 };
            struct pell_profile p;
            REQUIRE(pell_profile_make((enum pell_profile_model) k, &m, 0, NULL, &p) == PELL_OK);
            for (double xi = 0.001; xi < 0.9995; xi += 0.0111) {
                const double r = pell_sampling_table_sample(&table, albedo, xi);
                worst = fmax(worst, fabs(pell_profile_cdf(&p, r) - xi));
                worst_r = fmax(worst_r, fabs(r / pell_profile_sample(&p, xi) - 1.0));
                worst_pdf = fmax(worst_pdf, fabs(pell_sampling_table_pdf(&table, albedo, r) / pell_profile_pdf(&p, r) - 1.0));
            }
        }
        print_message("# %s: distribution %.1e, radius %.1e, density %.1e\n", pell_profile_model_at((size_t) k)->name, worst, worst_r,
                      worst_pdf);
        REQUIRE(worst < 6e-4 && worst_r < 0.03 && worst_pdf < 0.02);
    }
}

/* The density is exactly that of the samples: it integrates to 1, and its integral up to a sample's radius is the sample's random
 * number. */
static void densities_belong_to_the_tables_samples(void **state)
{
    static const double albedos[] = { 0.0, 0.3, 0.77, 0.97, 0.999, 0.99999, 1.0 };
    (void) state;
    REQUIRE(pell_sampling_table_make(PELL_PROFILE_BETTER_DIPOLE, 1.3, 0.0, NULL, &table) == PELL_OK);
    for (size_t i = 0; i < PELL_COUNT(albedos); i++) {
        double inside = 0.0, last = log(pell_sampling_table_sample(&table, albedos[i], 1e-12));
        for (double xi = 1e-4; xi < 1.0; xi += 0.0123) {
            const double r = log(pell_sampling_table_sample(&table, albedos[i], xi));
            REQUIRE(r > last);
            inside += pell_integrate(mass, &albedos[i], last, r, 1e-13, 1e-10, NULL);
            REQUIRE_NEAR(inside, xi, 1e-8);
            last = r;
        }
    }
}

static void odd_arguments_of_tables(void **state)
{
    static const double odd[] = { NAN, -1.0, 0.0, 5e-324, 0.5, 1.0, 2.0, INFINITY, -INFINITY, 1e-300, 1e300 };
    const struct pell_profile_params rough = { .roughness = 2.0 };
    (void) state;
    REQUIRE(pell_sampling_table_make(PELL_PROFILE_DIPOLE, 1.3, 0.0, NULL, &table) == PELL_OK);
    for (size_t i = 0; i < PELL_COUNT(odd); i++)
        for (size_t j = 0; j < PELL_COUNT(odd); j++) {
            const double r = pell_sampling_table_sample(&table, odd[i], odd[j]), p = pell_sampling_table_pdf(&table, odd[i], odd[j]);
            REQUIRE(isfinite(r) && r >= 0.0 && !isnan(p) && p >= 0.0);
        }
    REQUIRE(pell_sampling_table_make(PELL_PROFILE_DIPOLE, 9.0, 0.0, NULL, &table) == PELL_ERR_INVALID && table.log_r[0][1] == 0.0);
    REQUIRE(pell_sampling_table_make(PELL_PROFILE_DIPOLE, NAN, 0.0, NULL, &table) == PELL_ERR_INVALID);
    REQUIRE(pell_sampling_table_make(PELL_PROFILE_DIPOLE, 1.3, 1.0, NULL, &table) == PELL_ERR_INVALID);
    REQUIRE(pell_sampling_table_make(PELL_PROFILE_DIPOLE, 1.3, 0.0, &rough, &table) == PELL_ERR_INVALID);
    REQUIRE(pell_sampling_table_make((enum pell_profile_model) 77, 1.3, 0.0, NULL, &table) == PELL_ERR_INVALID);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(poles_are_sampled_as_the_oracle),
        cmocka_unit_test(the_root_is_a_root),
        cmocka_unit_test(radii_are_distributed_as_the_dipole),
        cmocka_unit_test(densities_belong_to_samples),
        cmocka_unit_test(odd_numbers_give_radii),
        cmocka_unit_test(tables_are_close_to_their_models),
        cmocka_unit_test(densities_belong_to_the_tables_samples),
        cmocka_unit_test(odd_arguments_of_tables),
    };
    return cmocka_run_group_tests_name("optics.sampling", tests, NULL, NULL);
}
