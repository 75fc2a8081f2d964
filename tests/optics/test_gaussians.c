/* SPDX-License-Identifier: MIT
 * test_gaussians.c - sums of Gaussians without a fit: appendix A, the exact mixture of a pole, sets and their reduction. */
#include "oracle.h"

#include "math/quadrature.h"
#include "math/special.h"
#include "math/vec.h"

/* --- Poles by quadrature ------------------------------------------------------------------------------------------------------- */

struct against {
    double z, s;
    const double *variance, *weight;
    size_t count;
};

static double pole(double z, double s, double r)
{
    const double d = sqrt(r * r + z * z);
    return z * (1.0 + s * d) * exp(-s * d) / (4.0 * PELL_PI * d * d * d);
}

static double square_of_difference(double log_r, const void *arg)
{
    const struct against *a = arg;
    const double r = exp(log_r), v = pole(a->z, a->s, r) - pell_gaussian_set_eval(a->variance, a->weight, a->count, r);
    return r * r * v * v;
}

/* Error (10) of a set against a pole. */
static double pole_error(double z, double s, const double *variance, const double *weight, size_t count)
{
    const struct against a = { z, s, variance, weight, count }, none = { z, s, variance, weight, 0 };
    const double low = log(1e-5 * fabs(z)), high = log(1e5 * fabs(z));
    const double norm = pell_integrate(square_of_difference, &none, low, high, 0.0, 1e-12, NULL);
    return sqrt(pell_integrate(square_of_difference, &a, low, high, 1e-20 * norm, 1e-8, NULL) / norm);
}

static void the_scaled_error_function_has_its_values(void **state)
{
    (void) state;
    REQUIRE_NEAR(pell_erfcx(0.0), 1.0, 0.0);
    REQUIRE_REL(pell_erfcx(1.0), 0.42758357615580700, 1e-14); /* Abramowitz and Stegun 7.1.5, exp(1) erfc(1) */
    REQUIRE_REL(pell_erfcx(25.0), pell_erfcx(24.999999), 1e-7);
    for (double x = 19.0; x < 26.0; x += 0.25) /* both evaluations, while the direct one does not overflow */
        REQUIRE_REL(pell_erfcx(x), exp(x * x) * erfc(x), 1e-12);
    REQUIRE_REL(pell_erfcx(1e8), 1e-8 / sqrt(PELL_PI), 1e-14);
}

static void appendix_a_is_the_oracles(void **state)
{
    json_t *root = oracle_load("appendix_a.json"), *row;
    size_t i;
    (void) state;
    json_array_foreach(oracle_get(root, "pole"), i, row)
    {
        const double x = oracle_number(row, "x");
        double v[4], w[4];
        static const struct {
            enum pell_appendix_a constants;
            const char *weights, *error;
        } kinds[] = {
            { PELL_APPENDIX_A_PRINTED, "C_printed", "err_percent_printed" },
            { PELL_APPENDIX_A_BEST, "C_best_free", "err_percent_best_free" },
            { PELL_APPENDIX_A_BEST_ENERGY, "C_best_constrained", "err_percent_best_constrained" },
        };
        for (size_t k = 0; k < PELL_COUNT(kinds); k++) {
            const double z = 0.37, s = x / z; /* any depth */
            assert_int_equal(pell_pole_appendix_a(z, s, kinds[k].constants, v, w), PELL_OK);
            for (size_t j = 0; j < 4; j++)
                REQUIRE_NEAR(w[j] * 4.0 * PELL_PI * exp(x), oracle_at(row, kinds[k].weights, j), 1e-6);
            REQUIRE_REL(pole_error(z, s, v, w, 4), 0.01 * oracle_number(row, kinds[k].error), 1e-5);
        }
        REQUIRE_REL(pell_gaussian_set_total(w, 4), 0.5 * exp(-x), 1e-12); /* of the last kind */
        assert_int_equal(pell_pole_appendix_a(1.0, x, PELL_APPENDIX_A_PRINTED, v, w), PELL_OK);
        REQUIRE_REL(pell_gaussian_set_total(w, 4), 0.5 * exp(-x) * oracle_number(row, "sum_over_2pi"), 1e-6);
    }
    assert_int_equal(i, 17);
    json_array_foreach(oracle_get(root, "dipole_eta1_3"), i, row)
    {
        /* the oracle's dipoles interpolate the best C from a table over x */
        static const char *const errors[] = { "err_percent_printed", "err_percent_best_C_free", "err_percent_best_C_constrained" };
        const double alpha = oracle_number(row, "alpha");
        const struct pell_dipole d = pell_dipole_make(1.0 - alpha, alpha, 1.3, PELL_FRESNEL_POLY3);
        for (int k = 0; k < 3; k++) {
            struct pell_gaussians g;
            struct pell_profile p;
            const struct pell_medium m = { { 1.0 - alpha, 1.0, 1.0 }, { alpha, 1.0, 1.0 }, { 0 }, 1.3 };
            const struct pell_profile_params params = { .fresnel = PELL_FRESNEL_POLY3 };
            assert_int_equal(pell_dipole_appendix_a(&d, (enum pell_appendix_a) k, &g), PELL_OK);
            assert_int_equal(pell_profile_make(PELL_PROFILE_DIPOLE, &m, 0, &params, &p), PELL_OK);
            assert_int_equal(g.count, 8);
            for (int j = 1; j < 8; j++)
                REQUIRE(g.variance[j] >= g.variance[j - 1]);
            REQUIRE_REL(pell_gaussians_error(&g, 0, &p, 0.0), 0.01 * oracle_number(row, errors[k]), k == 0 ? 1e-4 : 2e-3);
        }
    }
    assert_int_equal(i, 36);
    json_decref(root);
}

static void the_mixture_converges_and_keeps_the_energy(void **state)
{
    static const double xs[] = { 0.0, 1e-3, 0.05, 0.5, 2.0, 10.0, 80.0 };
    (void) state;
    for (size_t i = 0; i < PELL_COUNT(xs); i++) {
        double v[64], w[64];
        for (size_t k = 1; k <= 64; k++) {
            const double z = k % 2 ? 2.5 : -2.5, s = xs[i] / 2.5;
            assert_int_equal(pell_pole_gaussians(z, s, v, w, k), PELL_OK);
            REQUIRE_REL(pell_gaussian_set_total(w, k), copysign(0.5 * exp(-xs[i]), z), 1e-13);
            for (size_t j = 0; j < k; j++)
                REQUIRE(w[j] * z >= 0.0 && (j == 0 || v[j] > v[j - 1]));
            if (k >= 3 && (k <= 8 || k % 8 == 0))
                REQUIRE(pole_error(z, s, v, w, k) < 4.0 * exp(-2.0 * sqrt((double) k)) + 1e-8);
        }
    }
}

static double mixing_density(double log_v, const void *arg)
{
    const double x = *(const double *) arg, v = exp(log_v);
    return exp(-0.5 * x * x * v - 0.5 / v) / (2.0 * sqrt(2.0 * PELL_PI * v));
}

static double mixing_moment(double log_v, const void *arg)
{
    return exp(log_v) * mixing_density(log_v, arg);
}

static void the_mixture_on_given_variances_keeps_energy_and_moment(void **state)
{
    static const double xs[] = { 0.0, 1e-7, 1e-3, 0.3, 4.0 };
    enum { N = 200 };
    (void) state;
    for (size_t i = 0; i < PELL_COUNT(xs); i++) {
        double v[N], w[N];
        for (int j = 0; j < N; j++)
            v[j] = 0.02 * (j + 1);
        assert_int_equal(pell_pole_gaussians_at(1.0, xs[i], v, w, N), PELL_OK);
        const double low = log(v[0]), high = log(v[N - 1]);
        for (int j = 0; j < N; j++)
            REQUIRE(w[j] >= 0.0);
        REQUIRE_REL(pell_gaussian_set_total(w, N), 0.5 * exp(-xs[i]), 1e-12);
        /* Int w dv and Int v w dv: everything below the first and above the last counts at these variances */
        const double below = pell_integrate(mixing_density, &xs[i], low - 12.0, low, 0.0, 1e-12, NULL);
        const double inside = pell_integrate(mixing_density, &xs[i], low, high, 0.0, 1e-12, NULL);
        const double moment = pell_integrate(mixing_moment, &xs[i], low, high, 0.0, 1e-12, NULL) + below * v[0] +
                              (0.5 * exp(-xs[i]) - inside - below) * v[N - 1];
        REQUIRE_REL(pell_gaussian_set_moment(v, w, N), 2.0 * moment, 1e-9);
    }
    double v[4] = { 0.0, 0.5, 1.0, 4.0 }, w[4];
    assert_int_equal(pell_pole_gaussians_at(1.0, 0.1, v, w, 4), PELL_OK);
    assert_int_equal(pell_pole_gaussians_at(1.0, 0.1, v, w, 1), PELL_OK);
    REQUIRE_REL(w[0], 0.5 * exp(-0.1), 1e-12);
    v[2] = 0.5;
    assert_int_equal(pell_pole_gaussians_at(1.0, 0.1, v, w, 4), PELL_ERR_INVALID);
    v[2] = NAN;
    assert_int_equal(pell_pole_gaussians_at(1.0, 0.1, v, w, 4), PELL_ERR_INVALID);
}

/* --- Sets ---------------------------------------------------------------------------------------------------------------------- */

static void convolution_adds_variances(void **state)
{
    const double va[2] = { 0.3, 2.0 }, wa[2] = { 0.4, -0.1 }, vb[3] = { 0.1, 0.7, 5.0 }, wb[3] = { 0.2, 0.3, 0.5 };
    double v[6], w[6];
    (void) state;
    pell_gaussian_set_convolve(va, wa, 2, vb, wb, 3, v, w);
    REQUIRE_REL(pell_gaussian_set_total(w, 6), pell_gaussian_set_total(wa, 2) * pell_gaussian_set_total(wb, 3), 1e-14);
    /* the transform exp(-v s^2/2) of a convolution is the product of transforms */
    for (double s = 0.0; s < 4.0; s += 0.5) {
        double a = 0.0, b = 0.0, ab = 0.0;
        for (int i = 0; i < 2; i++)
            a += wa[i] * exp(-0.5 * va[i] * s * s);
        for (int i = 0; i < 3; i++)
            b += wb[i] * exp(-0.5 * vb[i] * s * s);
        for (int i = 0; i < 6; i++)
            ab += w[i] * exp(-0.5 * v[i] * s * s);
        REQUIRE_NEAR(ab, a * b, 1e-15);
    }
    REQUIRE_REL(pell_gaussian_set_inner(va, wa, 1, va, wa, 1), 0.16 / (4.0 * PELL_PI * PELL_PI * 0.6), 1e-15);
    REQUIRE_NEAR(pell_gaussian_set_error(va, wa, 2, va, wa, 2), 0.0, 1e-7);
    assert_true(isnan(pell_gaussian_set_error(va, wa, 0, vb, wb, 3)));
}

/* The published four-Gaussian skin against the six-Gaussian one. */
static void distance_of_published_sets_is_the_oracles(void **state)
{
    json_t *root = oracle_load("gaussians_claims.json"), *row;
    const struct pell_gaussians *six = &pell_material_find("skin-6gaussian")->gaussians;
    const struct pell_gaussians *four = &pell_material_find("skin-4gaussian")->gaussians;
    size_t i;
    (void) state;
    json_array_foreach(oracle_get(root, "jimenez_skin4_vs_gpugems_six"), i, row)
    {
        double a[10], b[10];
        for (int k = 0; k < 10; k++) {
            a[k] = six->weight[k][i];
            b[k] = four->weight[k][i];
        }
        /* the oracle takes the weights as printed, rounded to three digits; ours sum to 1 */
        REQUIRE_REL(pell_gaussian_set_error(six->variance, a, (size_t) six->count, four->variance, b, (size_t) four->count),
                    0.01 * oracle_number(row, "eq10_percent"), 0.02);
    }
    assert_int_equal(i, 3);
    json_decref(root);
}

static void reduction_keeps_energy_and_moment(void **state)
{
    enum { N = 60 };
    double v[N], w[N], target[40], out[60];
    (void) state;
    assert_int_equal(pell_pole_gaussians(1.0, 0.2, v, w, 60), PELL_OK);
    for (size_t n = 2; n <= 40; n++) {
        assert_int_equal(pell_gaussian_set_targets(v, w, 60, target, n), PELL_OK);
        REQUIRE(target[0] <= v[0] * (1.0 + 1e-15) && target[n - 1] >= v[59] * (1.0 - 1e-15));
        pell_gaussian_set_reduce(v, w, 60, target, n, out);
        REQUIRE_REL(pell_gaussian_set_total(out, n), pell_gaussian_set_total(w, 60), 1e-14);
        REQUIRE_REL(pell_gaussian_set_moment(target, out, n), pell_gaussian_set_moment(v, w, 60), 1e-13);
        for (size_t j = 0; j < n; j++)
            REQUIRE(out[j] >= 0.0);
    }
    const double error = pell_gaussian_set_error(v, w, 60, target, out, 40);
    REQUIRE(error < 0.03);
    pell_gaussian_set_reduce(v, w, 60, v, 40, out); /* given targets: the first 39 are unchanged, the rest is merged into the last */
    for (size_t j = 0; j < 39; j++)
        REQUIRE(out[j] == w[j]);
    REQUIRE_REL(pell_gaussian_set_total(out, 40), pell_gaussian_set_total(w, 60), 1e-14);
    const double one = 2.0, signs[2] = { 1.0, -1.0 }, equal[2] = { 2.0, 2.0 };
    pell_gaussian_set_reduce(equal, signs, 2, &one, 1, out);
    REQUIRE(out[0] == 0.0);
    assert_int_equal(pell_gaussian_set_targets(equal, signs, 2, target, 3), PELL_OK);
    REQUIRE(target[0] == 2.0 && target[1] > target[0] && target[2] > target[1]);
    assert_int_equal(pell_gaussian_set_targets(equal, signs, 2, target, 1), PELL_OK);
    REQUIRE_REL(target[0], 2.0, 1e-15);
}

static void hostile_numbers_are_refused(void **state)
{
    static const double bad[] = { NAN, INFINITY, -INFINITY };
    double v[4], w[4], target[4];
    struct pell_gaussians g;
    (void) state;
    for (size_t i = 0; i < PELL_COUNT(bad); i++) {
        assert_int_equal(pell_pole_appendix_a(bad[i], 1.0, PELL_APPENDIX_A_BEST, v, w), PELL_ERR_INVALID);
        assert_int_equal(pell_pole_appendix_a(1.0, bad[i], PELL_APPENDIX_A_BEST, v, w), PELL_ERR_INVALID);
        assert_int_equal(pell_pole_gaussians(bad[i], 1.0, v, w, 4), PELL_ERR_INVALID);
        assert_int_equal(pell_pole_gaussians(1.0, bad[i], v, w, 4), PELL_ERR_INVALID);
        assert_int_equal(pell_pole_gaussians_at(1.0, bad[i], target, w, 4), PELL_ERR_INVALID);
        const double values[2] = { 1.0, bad[i] }, fine[2] = { 1.0, 2.0 };
        assert_int_equal(pell_gaussian_set_targets(values, fine, 2, target, 4), PELL_ERR_INVALID);
        assert_int_equal(pell_gaussian_set_targets(fine, values, 2, target, 4), PELL_ERR_INVALID);
        struct pell_dipole d = pell_dipole_make(0.1, 1.0, 1.3, PELL_FRESNEL_EXACT);
        d.zv = bad[i];
        assert_int_equal(pell_dipole_appendix_a(&d, PELL_APPENDIX_A_BEST, &g), PELL_ERR_INVALID);
        assert_int_equal(g.count, 0);
    }
    assert_int_equal(pell_pole_gaussians(0.0, 1.0, v, w, 4), PELL_ERR_INVALID);
    assert_int_equal(pell_pole_gaussians(1.0, -1.0, v, w, 4), PELL_ERR_INVALID);
    assert_int_equal(pell_pole_gaussians(1.0, 1.0, v, w, 0), PELL_ERR_INVALID);
    assert_int_equal(pell_pole_appendix_a(1.0, 1.0, (enum pell_appendix_a) 3, v, w), PELL_ERR_INVALID);
    assert_int_equal(pell_gaussian_set_targets(v, w, 0, target, 4), PELL_ERR_INVALID);
    for (double s = 1e-300; s < 1e6; s *= 1e4) { /* far beyond the light's reach, no result is NaN */
        assert_int_equal(pell_pole_gaussians(1.0, s, v, w, 4), PELL_OK);
        for (int k = 0; k < 4; k++)
            REQUIRE(isfinite(v[k]) && isfinite(w[k]) && v[k] > 0.0);
        for (int kind = 0; kind < 3; kind++) {
            assert_int_equal(pell_pole_appendix_a(1.0, s, (enum pell_appendix_a) kind, v, w), PELL_OK);
            for (int k = 0; k < 4; k++)
                REQUIRE(isfinite(v[k]) && isfinite(w[k]) && v[k] > 0.0);
        }
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_scaled_error_function_has_its_values),
        cmocka_unit_test(appendix_a_is_the_oracles),
        cmocka_unit_test(the_mixture_converges_and_keeps_the_energy),
        cmocka_unit_test(the_mixture_on_given_variances_keeps_energy_and_moment),
        cmocka_unit_test(convolution_adds_variances),
        cmocka_unit_test(distance_of_published_sets_is_the_oracles),
        cmocka_unit_test(reduction_keeps_energy_and_moment),
        cmocka_unit_test(hostile_numbers_are_refused),
    };
    return cmocka_run_group_tests_name("optics.gaussians", tests, NULL, NULL);
}
