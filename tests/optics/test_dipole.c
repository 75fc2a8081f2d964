/* SPDX-License-Identifier: MIT
 *
 * test_dipole.c - the dipole profile, its total and its cumulative distribution. */
#include "oracle.h"

#include "math/quadrature.h"
#include "math/vec.h"

static double shell(double log_r, const void *dipole)
{
    const double r = exp(log_r);
    return 2.0 * PELL_PI * r * r * pell_dipole_rd(dipole, r);
}

static const double samples[][3] = {
    /* sigma_a, sigma_s_reduced, eta */
    { 0.0041, 2.62, 1.5 }, { 0.0, 20.4, 1.3 }, { 1.45, 0.03, 1.3 }, { 0.48, 1.01, 1.0 }, { 1e-5, 7e3, 2.5 }, { 2e-6, 1e-6, 4.0 },
};

static void oracle_table(void **state)
{
    json_t *root = oracle_load("dipole.json"), *row;
    size_t i;
    (void) state;
    json_array_foreach(oracle_get(root, "table"), i, row)
    {
        const double sa = oracle_number(row, "sigma_a"), ss = oracle_number(row, "sigma_sp"), eta = oracle_number(row, "eta");
        const struct pell_dipole d = pell_dipole_make(sa, ss, eta, PELL_FRESNEL_POLY3);
        const struct pell_dipole x = pell_dipole_make(sa, ss, eta, PELL_FRESNEL_EXACT);
        json_t *radius;
        size_t k;
        REQUIRE_REL(d.sigma_t_reduced, oracle_number(row, "sigma_tp"), ROUNDED);
        REQUIRE_REL(d.albedo_reduced, oracle_number(row, "alpha"), ROUNDED);
        REQUIRE_NEAR(d.sigma_tr, oracle_number(row, "sigma_tr"), ROUNDED * d.sigma_tr);
        REQUIRE_REL(d.A, oracle_number(row, "A"), ROUNDED);
        REQUIRE_REL(d.zr, oracle_number(row, "zr"), ROUNDED);
        REQUIRE_REL(d.zv, oracle_number(row, "zv"), ROUNDED);
        REQUIRE_REL(x.zv, oracle_number(row, "zv_exact_fresnel"), ROUNDED);
        REQUIRE_REL(pell_dipole_total(&d), oracle_number(row, "Rd_closed"), ROUNDED);
        REQUIRE_REL(pell_dipole_total(&x), oracle_number(row, "Rd_closed_exact_fresnel"), ROUNDED);
        json_array_foreach(oracle_get(row, "r_mm"), k, radius)
        {
            const double r = json_number_value(radius);
            REQUIRE_REL(pell_dipole_rd(&d, r), oracle_at(row, "R", k), ROUNDED);
            REQUIRE_REL(pell_dipole_cdf(&d, r), oracle_at(row, "cdf", k), ROUNDED);
        }
        assert_int_equal(k, 7);
    }
    assert_int_equal(i, 36);
    json_decref(root);
}

static void oracle_quantiles(void **state)
{
    json_t *root = oracle_load("sampling.json"), *row;
    size_t i;
    (void) state;
    json_array_foreach(oracle_get(root, "sampling"), i, row)
    {
        const double sa = oracle_number(row, "sigma_a"), ss = oracle_number(row, "sigma_sp");
        const struct pell_dipole d = pell_dipole_make(sa, ss, oracle_number(row, "eta"), PELL_FRESNEL_POLY3);
        const double real = exp(-d.sigma_tr * d.zr), virtual = exp(-d.sigma_tr * d.zv);
        json_t *xi;
        size_t k;
        REQUIRE_REL(real / (real + virtual), oracle_number(row, "threshold_real"), ROUNDED);
        json_array_foreach(oracle_get(row, "xi"), k, xi)
        {
            const double p = json_number_value(xi);
            REQUIRE_NEAR(pell_dipole_cdf(&d, oracle_at(row, "r_of_full_cdf", k)), p, 2e-9);
        }
    }
    assert_int_equal(i, 7);
    json_decref(root);
}

static void total_is_the_integral_of_the_profile(void **state)
{
    (void) state;
    for (size_t i = 0; i < PELL_COUNT(samples); i++) {
        const struct pell_dipole d = pell_dipole_make(samples[i][0], samples[i][1], samples[i][2], PELL_FRESNEL_EXACT);
        const double a = log(1e-9 * d.zr), b = log(1e12 * d.zr); /* without absorption 1e-12 of the light lies outside */
        REQUIRE_REL(pell_integrate(shell, &d, a, b, 0.0, 1e-12, NULL), pell_dipole_total(&d), 1e-10);
    }
}

static void cdf_is_the_integral_up_to_r(void **state)
{
    (void) state;
    for (size_t i = 0; i < PELL_COUNT(samples); i++) {
        const struct pell_dipole d = pell_dipole_make(samples[i][0], samples[i][1], samples[i][2], PELL_FRESNEL_EXACT);
        double last = 0.0;
        for (double r = 1e-7 * d.zr; r < 1e5 * d.zr; r *= 7.0) {
            const double inside = pell_integrate(shell, &d, log(1e-12 * d.zr), log(r), 0.0, 1e-12, NULL);
            const double cdf = pell_dipole_cdf(&d, r);
            REQUIRE_REL(cdf, inside / pell_dipole_total(&d), 1e-9); /* relative, also at 1e-14 of the power: no cancellation */
            REQUIRE(cdf >= last * (1.0 - 1e-15) && cdf <= 1.0);
            last = cdf;
        }
    }
}

static void profile_is_positive_finite_and_falls(void **state)
{
    (void) state;
    for (size_t i = 0; i < PELL_COUNT(samples); i++) {
        const struct pell_dipole d = pell_dipole_make(samples[i][0], samples[i][1], samples[i][2], PELL_FRESNEL_EXACT);
        double last = pell_dipole_rd(&d, 0.0);
        REQUIRE(isfinite(last) && last > 0.0);
        for (double r = 0.001 * d.zr; r < 200.0 * d.zr; r *= 1.1) {
            const double v = pell_dipole_rd(&d, r);
            REQUIRE(isfinite(v) && v > 0.0 && v < last);
            last = v;
        }
    }
}

static void lossless_medium_returns_all_light(void **state)
{
    (void) state;
    const struct pell_dipole d = pell_dipole_make(0.0, 20.4, 1.3, PELL_FRESNEL_EXACT);
    REQUIRE(d.sigma_tr == 0.0);
    REQUIRE(pell_dipole_total(&d) == 1.0);
    const double r = 1e5 * d.zr; /* the tail is (zr + zv)/(2 r): 1 - cdf = mean of z/d */
    REQUIRE_REL(1.0 - pell_dipole_cdf(&d, r), 0.5 * (d.zr + d.zv) / r, 1e-8);
}

static void pure_absorption_returns_nothing(void **state)
{
    (void) state;
    const struct pell_dipole d = pell_dipole_make(3.0, 0.0, 1.3, PELL_FRESNEL_EXACT);
    REQUIRE(pell_dipole_total(&d) == 0.0);
    REQUIRE(pell_dipole_rd(&d, 0.0) == 0.0 && pell_dipole_rd(&d, 2.0) == 0.0);
    const struct pell_dipole nothing = pell_dipole_make(0.0, 0.0, 1.3, PELL_FRESNEL_EXACT);
    REQUIRE(pell_dipole_total(&nothing) == 0.0 && pell_dipole_rd(&nothing, 1.0) == 0.0 && pell_dipole_cdf(&nothing, 1.0) == 1.0);
}

static void radii_of_any_size_are_finite(void **state)
{
    static const double radii[] = { 0.0, 5e-324, 1e-200, 1e-8, 1e100, 1e200, INFINITY };
    (void) state;
    for (size_t i = 0; i < PELL_COUNT(samples); i++) {
        const struct pell_dipole d = pell_dipole_make(samples[i][0], samples[i][1], samples[i][2], PELL_FRESNEL_EXACT);
        for (size_t k = 0; k < PELL_COUNT(radii); k++) {
            const double rd = pell_dipole_rd(&d, radii[k]), cdf = pell_dipole_cdf(&d, radii[k]);
            REQUIRE(isfinite(rd) && rd >= 0.0 && isfinite(cdf) && cdf >= 0.0 && cdf <= 1.0);
        }
        REQUIRE(pell_dipole_cdf(&d, 0.0) == 0.0);
        REQUIRE_NEAR(pell_dipole_cdf(&d, INFINITY), 1.0, 1e-15);
    }
}

/* R scales as length^-2: metres instead of millimetres change no ratio. */
static void units_cancel(void **state)
{
    (void) state;
    const struct pell_dipole a = pell_dipole_make(0.032, 0.74, 1.3, PELL_FRESNEL_EXACT);
    const struct pell_dipole b = pell_dipole_make(32.0, 740.0, 1.3, PELL_FRESNEL_EXACT);
    for (double r = 0.0; r < 20.0; r += 0.7)
        REQUIRE_REL(pell_dipole_rd(&b, r * 1e-3) * 1e-6, pell_dipole_rd(&a, r), 1e-13);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(oracle_table),
        cmocka_unit_test(oracle_quantiles),
        cmocka_unit_test(total_is_the_integral_of_the_profile),
        cmocka_unit_test(cdf_is_the_integral_up_to_r),
        cmocka_unit_test(profile_is_positive_finite_and_falls),
        cmocka_unit_test(lossless_medium_returns_all_light),
        cmocka_unit_test(pure_absorption_returns_nothing),
        cmocka_unit_test(radii_of_any_size_are_finite),
        cmocka_unit_test(units_cancel),
    };
    return cmocka_run_group_tests_name("optics.dipole", tests, NULL, NULL);
}
