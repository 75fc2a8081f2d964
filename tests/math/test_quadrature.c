/* SPDX-License-Identifier: MIT
 * test_quadrature.c - numerical quadrature of integrals with known values. */
#include "pell_test.h"

#include "math/quadrature.h"
#include "math/vec.h"

static double power(double x, const void *degree)
{
    return pow(x, *(const double *) degree);
}

static double narrow(double x, const void *arg)
{
    const double a = *(const double *) arg;
    return a / (a * a + x * x);
}

static double logarithm(double x, const void *arg)
{
    (void) arg;
    return log(x);
}

static double wave(double x, const void *arg)
{
    return sin(x * *(const double *) arg);
}

static double constant_nan(double x, const void *arg)
{
    (void) arg;
    return x * NAN;
}

static double count_calls(double x, const void *arg)
{
    ++*(int *) (uintptr_t) arg;
    return x * x;
}

static void polynomials_up_to_degree_22_are_exact_in_one_interval(void **state)
{
    (void) state;
    for (double d = 0.0; d <= 22.0; d++) {
        const double exact = (pow(3.0, d + 1.0) - pow(-1.0, d + 1.0)) / (d + 1.0);
        REQUIRE_REL(pell_integrate(power, &d, -1.0, 3.0, INFINITY, 0.0, NULL), exact, 1e-13);
    }
}

static void smooth_function_takes_15_calls(void **state)
{
    int calls = 0;
    (void) state;
    REQUIRE_NEAR(pell_integrate(count_calls, &calls, 0.0, 1.0, 1e-12, 0.0, NULL), 1.0 / 3.0, 1e-15);
    assert_int_equal(calls, 15);
}

static void a_peak_of_width_1e_4_is_found(void **state)
{
    const double a = 1e-4;
    double error;
    (void) state;
    const double value = pell_integrate(narrow, &a, -1.0, 1.0, 0.0, 1e-12, &error);
    REQUIRE_REL(value, 2.0 * atan(1.0 / a), 1e-12);
    REQUIRE(error <= 1e-12 * value);
}

static void singular_ends_are_never_evaluated(void **state)
{
    const double half = -0.5;
    (void) state;
    REQUIRE_NEAR(pell_integrate(logarithm, NULL, 0.0, 1.0, 1e-10, 0.0, NULL), -1.0, 1e-10);
    REQUIRE_NEAR(pell_integrate(power, &half, 0.0, 1.0, 1e-8, 0.0, NULL), 2.0, 1e-7);
}

static void reversed_and_empty_ranges(void **state)
{
    const double two = 2.0;
    (void) state;
    REQUIRE_NEAR(pell_integrate(power, &two, 3.0, 0.0, 1e-12, 0.0, NULL), -9.0, 1e-12);
    REQUIRE_NEAR(pell_integrate(power, &two, 1.0, 1.0, 1e-12, 0.0, NULL), 0.0, 0.0);
}

static void a_hopeless_integral_ends_and_says_so(void **state)
{
    const double fast = 1e6;
    double error;
    (void) state;
    pell_integrate(wave, &fast, 0.0, 1.0, 1e-14, 0.0, &error);
    REQUIRE(error > 1e-14);
    REQUIRE(isnan(pell_integrate(constant_nan, NULL, 0.0, 1.0, 1e-14, 0.0, &error)));
}

static void legendre_nodes_are_exact_up_to_degree_2_n_minus_1(void **state)
{
    double x[64], w[64];

    (void) state;
    for (int n = 1; n <= 64; n++) {
        pell_gauss_legendre(n, x, w);
        for (int degree = 0; degree < 2 * n; degree++) {
            double sum = 0.0;
            for (int i = 0; i < n; i++)
                sum += w[i] * pow(x[i], degree);
            REQUIRE_NEAR(sum, 1.0 / (degree + 1.0), 1e-14);
        }
        for (int i = 0; i < n; i++)
            REQUIRE(x[i] > (i ? x[i - 1] : 0.0) && x[i] < 1.0 && w[i] > 0.0);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(polynomials_up_to_degree_22_are_exact_in_one_interval),
        cmocka_unit_test(smooth_function_takes_15_calls),
        cmocka_unit_test(a_peak_of_width_1e_4_is_found),
        cmocka_unit_test(singular_ends_are_never_evaluated),
        cmocka_unit_test(reversed_and_empty_ranges),
        cmocka_unit_test(legendre_nodes_are_exact_up_to_degree_2_n_minus_1),
        cmocka_unit_test(a_hopeless_integral_ends_and_says_so),
    };
    return cmocka_run_group_tests_name("math.quadrature", tests, NULL, NULL);
}
