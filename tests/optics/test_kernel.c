/* SPDX-License-Identifier: MIT
 * test_kernel.c - taps, separable kernels and lookup tables of profiles. */
#include "pell_test.h"

#include "math/vec.h"

#include <pellucid/optics.h>

/* A profile from a sum of Gaussians, which the library tabulates like any R(r). */
static void tabulate(double (*f)(double r), double r_max, struct pell_profile *p)
{
    enum { N = 400 };
    double r[N], R[N];
    for (int i = 0; i < N; i++) {
        r[i] = r_max * i / (N - 1) * i / (N - 1);
        R[i] = f(r[i]);
    }
    assert_int_equal(pell_profile_from_table(r, R, N, p, NULL), PELL_OK);
}

static double gauss(double v, double r)
{
    return exp(-0.5 * r * r / v) / (2.0 * PELL_PI * v);
}

static double one_gaussian(double r)
{
    return 0.7 * gauss(2.0, r);
}

static double two_gaussians(double r)
{
    return 0.3 * gauss(0.5, r) + 0.4 * gauss(6.0, r);
}

static struct pell_profile dipole(double sigma_a, double sigma_s)
{
    const struct pell_medium m = { { sigma_a, sigma_a, sigma_a }, { sigma_s, sigma_s, sigma_s }, { 0 }, 1.3 };
    struct pell_profile p;
    assert_int_equal(pell_profile_make(PELL_PROFILE_DIPOLE, &m, 0, NULL, &p), PELL_OK);
    return p;
}

static void taps_have_their_sum_and_variance(void **state)
{
    double x[PELL_KERNEL_TAPS_MAX], w[PELL_KERNEL_TAPS_MAX];
    (void) state;
    for (int n = 3; n <= PELL_KERNEL_TAPS_MAX; n += 2)
        for (double variance = 1e-6; variance < 1e6; variance *= 97.0) {
            double sum = 0.0, moment = 0.0;
            assert_int_equal(pell_kernel_gaussian_taps(variance, n, x, w), PELL_OK);
            for (int i = 0; i < n; i++) {
                REQUIRE(w[i] > 0.0 && w[i] == w[n - 1 - i] && x[i] == -x[n - 1 - i] && (i == 0 || x[i] > x[i - 1]));
                sum += w[i];
                moment += w[i] * x[i] * x[i];
            }
            REQUIRE_NEAR(sum, 1.0, 1e-14);
            REQUIRE_REL(moment, variance, 1e-13);
        }
    /* the response to a wave is the Gaussian's, exp(-v k^2/2), to the accuracy of 13 taps */
    assert_int_equal(pell_kernel_gaussian_taps(4.0, 13, x, w), PELL_OK);
    for (double k = 0.0; k < 1.5; k += 0.1) {
        double sum = 0.0;
        for (int i = 0; i < 13; i++)
            sum += w[i] * cos(k * x[i]);
        REQUIRE_NEAR(sum, exp(-2.0 * k * k), 2e-3);
    }
    static const int bad[] = { -3, 0, 1, 2, 4, PELL_KERNEL_TAPS_MAX + 2 };
    for (size_t i = 0; i < PELL_COUNT(bad); i++)
        assert_int_equal(pell_kernel_gaussian_taps(1.0, bad[i], x, w), PELL_ERR_INVALID);
    assert_int_equal(pell_kernel_gaussian_taps(NAN, 7, x, w), PELL_ERR_INVALID);
    assert_int_equal(pell_kernel_gaussian_taps(0.0, 7, x, w), PELL_ERR_INVALID);
    assert_int_equal(pell_kernel_gaussian_taps(INFINITY, 7, x, w), PELL_ERR_INVALID);
}

static void a_chain_gives_back_the_weights(void **state)
{
    const struct pell_gaussians *g = &pell_material_find("skin-6gaussian")->gaussians;
    struct pell_kernel_chain chain;
    double v = 0.0;
    (void) state;
    assert_int_equal(pell_kernel_chain_make(g, &chain), PELL_OK);
    assert_int_equal(chain.count, g->count);
    for (int i = 0; i < g->count; i++) {
        v += chain.step_mm2[i];
        REQUIRE_REL(v, g->variance[i], 1e-14);
        for (int c = 0; c < 3; c++) { /* the fraction of blur i that the later blends keep */
            double fraction = chain.total[c] * chain.blend[i][c];
            for (int j = i + 1; j < g->count; j++)
                fraction *= 1.0 - chain.blend[j][c];
            REQUIRE_NEAR(fraction, g->weight[i][c], 1e-14);
        }
    }
    struct pell_gaussians bad = *g;
    bad.variance[2] = 0.5 * bad.variance[1];
    assert_int_equal(pell_kernel_chain_make(&bad, &chain), PELL_ERR_INVALID);
    assert_int_equal(chain.count, 0);
    bad = *g;
    bad.weight[1][1] = NAN;
    assert_int_equal(pell_kernel_chain_make(&bad, &chain), PELL_ERR_INVALID);
}

static void a_gaussian_is_separable(void **state)
{
    struct pell_profile p[3];
    struct pell_separable s;
    const struct pell_separable_params params = { .taps = 33, .rank = 1, .extent_mm = 6.0 };
    double sum = 0.0;
    (void) state;
    tabulate(one_gaussian, 9.0, &p[0]);
    p[1] = p[2] = p[0];
    assert_int_equal(pell_separable_make(p, &params, &s), PELL_OK);
    for (int c = 0; c < 3; c++) {
        REQUIRE(s.error[c] < 2e-3 && s.outside[c] < 2e-3 && s.sign[0][c] == 1.0);
        REQUIRE_REL(s.total[c], 0.7, 1e-3);
    }
    for (int i = 0; i < s.taps; i++) { /* a tap is the integral of the one-dimensional Gaussian over its cell */
        const double low = i > 0 ? 0.5 * (s.offset_mm[i] + s.offset_mm[i - 1]) : -6.0;
        const double high = i < 32 ? 0.5 * (s.offset_mm[i] + s.offset_mm[i + 1]) : 6.0;
        REQUIRE(s.weight[0][i][1] == s.weight[0][32 - i][1]);
        REQUIRE_NEAR(s.weight[0][i][1], sqrt(0.7) * 0.5 * (erf(high / 2.0) - erf(low / 2.0)), 1e-3);
        sum += s.weight[0][i][1];
    }
    REQUIRE_REL(sum * sum, s.total[1], 1e-12);
}

/* A sum of two Gaussians is a kernel of rank two: the third term adds nothing, and the error of the first alone follows from the
 * eigenvalues of the Gram matrix of the two. */
static void ranks_of_two_gaussians(void **state)
{
    struct pell_profile p[3];
    struct pell_separable s;
    double error[4];
    (void) state;
    tabulate(two_gaussians, 16.0, &p[0]);
    p[1] = p[2] = p[0];
    for (int rank = 1; rank <= 3; rank++) {
        const struct pell_separable_params params = { .rank = rank, .extent_mm = 12.0 };
        double total = 0.0;
        assert_int_equal(pell_separable_make(p, &params, &s), PELL_OK);
        error[rank] = s.error[0];
        for (int k = 0; k < rank; k++) {
            double sum = 0.0;
            for (int i = 0; i < s.taps; i++)
                sum += s.weight[k][i][0];
            total += s.sign[k][0] * sum * sum;
        }
        REQUIRE_REL(total, s.total[0], 1e-12);
    }
    /* functions exp(-x^2/2v)/sqrt(2 pi v) with weights a, b: M has the matrix [a g11, a g12; b g12, b g22] */
    const double a = 0.3, b = 0.4, u = 0.5, v = 6.0;
    const double g11 = 1.0 / sqrt(4.0 * PELL_PI * u), g22 = 1.0 / sqrt(4.0 * PELL_PI * v), g12 = 1.0 / sqrt(2.0 * PELL_PI * (u + v));
    const double trace = a * g11 + b * g22, determinant = a * b * (g11 * g22 - g12 * g12);
    const double large = 0.5 * (trace + sqrt(trace * trace - 4.0 * determinant)), small = trace - large;
    REQUIRE_REL(error[1], small / sqrt(large * large + small * small), 1e-2);
    REQUIRE(error[2] < 5e-3 && error[3] <= error[2]);
}

static void dipoles_lose_less_with_each_rank(void **state)
{
    struct pell_profile p[3] = { dipole(0.03, 0.74), dipole(0.17, 0.88), dipole(0.0, 1.0) };
    double last[3] = { 1.0, 1.0, 1.0 };
    (void) state;
    for (int rank = 1; rank <= 3; rank++) {
        const struct pell_separable_params params = { .rank = rank };
        struct pell_separable s;
        assert_int_equal(pell_separable_make(p, &params, &s), PELL_OK);
        for (int c = 0; c < 3; c++) {
            print_message("# rank %d, channel %d: error %.2f %%, %.2f %% outside\n", rank, c, 100.0 * s.error[c], 100.0 * s.outside[c]);
            REQUIRE(s.error[c] < 0.5 * last[c] && s.outside[c] < 0.03);
            REQUIRE_REL(s.total[c], pell_profile_total(&p[c]), 1e-14);
            last[c] = s.error[c];
        }
    }
    memset(&p[1], 0, sizeof(p[1]));
    struct pell_separable s;
    assert_int_equal(pell_separable_make(p, NULL, &s), PELL_OK);
    REQUIRE(s.total[1] == 0.0 && s.sign[0][1] == 0.0 && s.weight[0][12][1] == 0.0);
    memset(p, 0, sizeof(p));
    assert_int_equal(pell_separable_make(p, NULL, &s), PELL_ERR_INVALID);
}

static void separable_parameters_out_of_range_are_refused(void **state)
{
    static const struct pell_separable_params bad[] = {
        { .taps = 4 },         { .taps = -1 },       { .taps = 67 },
        { .taps = 1 },         { .rank = 4 },        { .rank = -1 },
        { .extent_mm = -1.0 }, { .extent_mm = NAN }, { .extent_mm = INFINITY },
        { .spread = 0.5 },     { .spread = 5.0 },    { .spread = NAN },
    };
    const struct pell_profile p[3] = { dipole(0.1, 1.0), dipole(0.1, 1.0), dipole(0.1, 1.0) };
    (void) state;
    for (size_t i = 0; i < PELL_COUNT(bad); i++) {
        struct pell_separable s;
        assert_int_equal(pell_separable_make(p, &bad[i], &s), PELL_ERR_INVALID);
        REQUIRE(s.taps == 0);
    }
}

static void tables_hold_the_light(void **state)
{
    const struct pell_profile p = dipole(0.05, 1.2);
    float value[512], light[512], radius[512];
    double sum = 0.0, area = 0.0;
    (void) state;
    assert_int_equal(pell_kernel_table_value(&p, 12.0, value, 512), PELL_OK);
    assert_int_equal(pell_kernel_table_ring(&p, 12.0, light, 512), PELL_OK);
    for (int i = 0; i < 512; i++) {
        const double inner = 12.0 * i / 512, outer = 12.0 * (i + 1) / 512;
        sum += (double) light[i];
        area += (double) value[i] * PELL_PI * (outer * outer - inner * inner);
        if (i > 20)
            REQUIRE_REL((double) value[i], pell_profile_eval(&p, 0.5 * (inner + outer)), 2e-3);
    }
    REQUIRE_REL(sum, pell_profile_total(&p) * pell_profile_cdf(&p, 12.0), 1e-6);
    REQUIRE_REL(area, sum, 1e-6);
    assert_int_equal(pell_kernel_table_radius(&p, radius, 512), PELL_OK);
    for (int i = 0; i < 512; i++)
        REQUIRE_NEAR(pell_profile_cdf(&p, (double) radius[i]), (i + 0.5) / 512, 1e-6);
    assert_int_equal(pell_kernel_table_value(&p, 0.0, value, 4), PELL_ERR_INVALID);
    assert_int_equal(pell_kernel_table_value(&p, NAN, value, 4), PELL_ERR_INVALID);
    assert_int_equal(pell_kernel_table_ring(&p, 1.0, value, 0), PELL_ERR_INVALID);
    assert_int_equal(pell_kernel_table_radius(&p, value, 0), PELL_ERR_INVALID);
}

static void a_sphere_that_is_large_is_lambert_and_a_small_one_is_uniform(void **state)
{
    const struct pell_profile p = dipole(0.05, 1.2);
    static float texel[64 * 64];
    const double total = pell_profile_total(&p);
    double last = 1.0;
    (void) state;
    assert_int_equal(pell_kernel_table_sphere(&p, 4.0, texel, 64, 64), PELL_OK);
    for (int j = 0; j < 64; j++)
        for (int i = 0; i < 64; i++) {
            REQUIRE((double) texel[j * 64 + i] >= 0.0 && (double) texel[j * 64 + i] <= total * (1.0 + 1e-6));
            if (i > 0)
                REQUIRE((double) texel[j * 64 + i] >= (double) texel[j * 64 + i - 1] - 1e-6);
        }
    assert_int_equal(pell_kernel_table_sphere(&p, 1e-4, texel, 64, 1), PELL_OK);
    for (int i = 0; i < 64; i++) {
        const double c = -1.0 + 2.0 * (i + 0.5) / 64;
        if (fabs(c) > 0.1)
            REQUIRE_NEAR((double) texel[i], total * fmax(c, 0.0), 2e-3);
    }
    /* curvature extends light beyond the terminator: the mean of max(cos, 0) around the circle is 1/pi */
    for (double curvature = 0.01; curvature < 2000.0; curvature *= 10.0) {
        assert_int_equal(pell_kernel_table_sphere(&p, curvature, texel, 64, 1), PELL_OK);
        const double range = (double) texel[63] - (double) texel[0];
        REQUIRE(range < last);
        last = range;
    }
    REQUIRE_NEAR((double) texel[32], total / PELL_PI, 0.02);
    assert_int_equal(pell_kernel_table_sphere(&p, NAN, texel, 4, 4), PELL_ERR_INVALID);
    assert_int_equal(pell_kernel_table_sphere(&p, 1.0, texel, 0, 4), PELL_ERR_INVALID);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(taps_have_their_sum_and_variance),
        cmocka_unit_test(a_chain_gives_back_the_weights),
        cmocka_unit_test(a_gaussian_is_separable),
        cmocka_unit_test(ranks_of_two_gaussians),
        cmocka_unit_test(dipoles_lose_less_with_each_rank),
        cmocka_unit_test(separable_parameters_out_of_range_are_refused),
        cmocka_unit_test(tables_hold_the_light),
        cmocka_unit_test(a_sphere_that_is_large_is_lambert_and_a_small_one_is_uniform),
    };
    return cmocka_run_group_tests_name("optics.kernel", tests, NULL, NULL);
}
