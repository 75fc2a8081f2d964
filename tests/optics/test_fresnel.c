/* SPDX-License-Identifier: MIT
 *
 * test_fresnel.c - Fresnel reflectance and its diffuse average. */
#include "oracle.h"

#include "math/quadrature.h"
#include "math/vec.h"

static void normal_incidence(void **state)
{
    (void) state;
    for (double eta = 0.3; eta < 4.0; eta += 0.1)
        REQUIRE_NEAR(pell_fresnel(eta, 1.0), pow((eta - 1.0) / (eta + 1.0), 2.0), 1e-15);
    REQUIRE_NEAR(pell_fresnel(1.4, 1.0), 0.028, 5e-4); /* F0 of skin in the literature */
}

static void brewster_angle_leaves_only_perpendicular_light(void **state)
{
    (void) state;
    for (double eta = 0.4; eta < 3.0; eta += 0.13) {
        const double c = 1.0 / sqrt(1.0 + eta * eta), rs = (1.0 - eta * eta) / (1.0 + eta * eta);
        REQUIRE_NEAR(pell_fresnel(eta, c), 0.5 * rs * rs, 1e-14);
    }
}

static void total_reflection_begins_at_the_critical_angle(void **state)
{
    (void) state;
    for (double n = 1.05; n < 4.0; n += 0.1) {
        const double critical = sqrt(1.0 - 1.0 / (n * n));
        REQUIRE(pell_fresnel(1.0 / n, critical - 1e-9) == 1.0);
        REQUIRE(pell_fresnel(1.0 / n, critical + 1e-6) < 1.0);
        REQUIRE(pell_fresnel(1.0 / n, 0.0) == 1.0 && pell_fresnel(n, 0.0) == 1.0);
    }
}

static void reflectance_is_the_same_along_the_reversed_path(void **state)
{
    (void) state;
    for (double n = 1.0; n < 4.0; n += 0.17)
        for (double c = 0.02; c <= 1.0; c += 0.07)
            REQUIRE_NEAR(pell_fresnel(n, c), pell_fresnel(1.0 / n, sqrt(1.0 - (1.0 - c * c) / (n * n))), 1e-12);
}

static void equal_indices_reflect_nothing(void **state)
{
    (void) state;
    for (double c = 0.01; c <= 1.0; c += 0.01)
        REQUIRE_NEAR(pell_fresnel(1.0, c), 0.0, 1e-24);
    REQUIRE(pell_fresnel_diffuse(1.0, PELL_FRESNEL_EXACT) == 0.0);
    REQUIRE(pell_fresnel_diffuse(1.0, PELL_FRESNEL_POLY4) == 0.0);
    REQUIRE(pell_fresnel_exit_norm(1.0) == 1.0);
}

static void cosines_out_of_range_are_clamped(void **state)
{
    (void) state;
    REQUIRE(pell_fresnel(1.3, 1.0 + 1e-7) == pell_fresnel(1.3, 1.0));
    REQUIRE(pell_fresnel(1.3, -0.1) == 1.0);
}

static double integrand(double mu, const void *eta)
{
    return 2.0 * mu * pell_fresnel(*(const double *) eta, mu);
}

/* Both directions by quadrature of the angle-dependent reflectance; the critical angle is a point of division. */
static void diffuse_average_is_the_integral_over_angles(void **state)
{
    (void) state;
    for (double n = 1.0005; n < 4.0; n *= 1.01) {
        const double inverse = 1.0 / n, critical = sqrt(1.0 - inverse * inverse);
        const double out = pell_integrate(integrand, &n, 0.0, 1.0, 1e-15, 1e-14, NULL);
        const double in = critical * critical + pell_integrate(integrand, &inverse, critical, 1.0, 1e-15, 1e-14, NULL);
        REQUIRE_NEAR(pell_fresnel_diffuse(inverse, PELL_FRESNEL_EXACT), out, 1e-12);
        REQUIRE_NEAR(pell_fresnel_diffuse(n, PELL_FRESNEL_EXACT), in, 1e-12);
        REQUIRE_NEAR(pell_fresnel_exit_norm(n), 1.0 - out, 1e-12);
    }
}

static void diffuse_average_rises_with_the_index(void **state)
{
    double in = 0.0, out = 0.0;
    (void) state;
    for (double n = 1.0 + 1e-6; n < 4.0; n += 1e-3) { /* switches from quadrature to closed form at 1.05 */
        REQUIRE(pell_fresnel_diffuse(n, PELL_FRESNEL_EXACT) > in);
        REQUIRE(pell_fresnel_diffuse(1.0 / n, PELL_FRESNEL_EXACT) > out);
        in = pell_fresnel_diffuse(n, PELL_FRESNEL_EXACT);
        out = pell_fresnel_diffuse(1.0 / n, PELL_FRESNEL_EXACT);
    }
    REQUIRE(in < 1.0 && out < in);
}

static void oracle_rows(void **state)
{
    json_t *root = oracle_load("dipole.json"), *row;
    size_t i;
    (void) state;
    json_array_foreach(oracle_get(root, "fresnel"), i, row)
    {
        double eta = oracle_number(row, "eta"); /* 0.7692307692 and 0.6666666667 are rounded 1/1.3 and 1/1.5 */
        eta = fabs(eta - 1.0 / 1.3) < 1e-9 ? 1.0 / 1.3 : fabs(eta - 1.0 / 1.5) < 1e-9 ? 1.0 / 1.5 : eta;
        const double exact = oracle_number(row, "Fdr_exact"), f = pell_fresnel_diffuse(eta, PELL_FRESNEL_EXACT);
        const double p3 = pell_fresnel_diffuse(eta, PELL_FRESNEL_POLY3);
        REQUIRE_NEAR(f, exact, 1e-9 * fabs(exact) + 1e-15);
        REQUIRE_REL((1.0 + f) / (1.0 - f), oracle_number(row, "A_exact"), ROUNDED);
        REQUIRE_NEAR(p3, oracle_number(row, "Fdr_poly"), 1e-9);
        REQUIRE_REL((1.0 + p3) / (1.0 - p3), oracle_number(row, "A_poly"), ROUNDED);
        REQUIRE_NEAR(pell_fresnel_diffuse(eta, PELL_FRESNEL_POLY4), oracle_number(row, "Fdr_poly_DJ4"), 1e-9);
    }
    assert_int_equal(i, 13);
    json_decref(root);
}

static void polynomials_are_within_a_thousandth_of_the_integral(void **state)
{
    (void) state;
    for (double n = 1.15; n <= 2.0; n += 0.01) {
        const double exact = pell_fresnel_diffuse(n, PELL_FRESNEL_EXACT);
        REQUIRE_NEAR(pell_fresnel_diffuse(n, PELL_FRESNEL_POLY3), exact, 1e-3);
        REQUIRE_NEAR(pell_fresnel_diffuse(n, PELL_FRESNEL_POLY4), exact, 1e-3);
        REQUIRE_NEAR(pell_fresnel_diffuse(1.0 / n, PELL_FRESNEL_POLY4), pell_fresnel_diffuse(1.0 / n, PELL_FRESNEL_EXACT), 5e-3);
    }
}

/* Over all indices that a medium may have; unclamped, the polynomials exceed 1 from 3.8 on, and the dipole's virtual source would lie
 * above. */
static void polynomials_never_reflect_more_than_all(void **state)
{
    (void) state;
    for (double n = PELL_ETA_MIN; n <= PELL_ETA_MAX; n += 0.01)
        for (enum pell_fresnel_model model = PELL_FRESNEL_POLY3; model <= PELL_FRESNEL_POLY4; model++) {
            const double fdr = pell_fresnel_diffuse(n, model);
            REQUIRE(fdr >= 0.0 && fdr < 0.95);
            REQUIRE_NEAR(fdr, pell_fresnel_diffuse(n, PELL_FRESNEL_EXACT), 0.15);
        }
    REQUIRE(pell_fresnel_diffuse(4.0, PELL_FRESNEL_POLY3) == pell_fresnel_diffuse(3.0, PELL_FRESNEL_POLY3));
    REQUIRE(isnan(pell_fresnel_diffuse((double) NAN, PELL_FRESNEL_POLY4)));
}

/* 2 Int albedo mu dmu of GGX facets with Fresnel's F by midpoints over two hemispheres of the BRDF itself, independent of the library's
 * rule: for roughnesses whose lobe is wide enough for that. */
static double brute_rough(double n, double roughness)
{
    const int cosines = 160, turns = 96;
    const double a2 = roughness * roughness * roughness * roughness;
    double sum = 0.0;
    for (int i = 0; i < cosines; i++)
        for (int j = 0; j <= i; j++) /* f is symmetric */
            for (int k = 0; k < turns; k++) {
                const double s = (i + 0.5) / cosines, t = (j + 0.5) / cosines, mu = s * s, nu = t * t, turn = PELL_PI * (k + 0.5) / turns;
                const double plane = sqrt((1.0 - mu * mu) * (1.0 - nu * nu)), dot = mu * nu + plane * cos(turn), hh = 2.0 + 2.0 * dot;
                const double nh2 = (mu + nu) * (mu + nu) / hh, d = a2 / (PELL_PI * pow(1.0 - nh2 + a2 * nh2, 2.0));
                const double g = nu * sqrt(a2 + (1.0 - a2) * mu * mu) + mu * sqrt(a2 + (1.0 - a2) * nu * nu);
                const double f = d * pell_fresnel(n, sqrt(0.25 * hh)) / (2.0 * g); /* h.v = |h|/2 */
                sum += (i == j ? 1.0 : 2.0) * f * mu * nu * 2.0 * 2.0 * PELL_PI * (2.0 * s) * (2.0 * t);
            }
    return sum / ((double) cosines * cosines * turns);
}

static void rough_boundary_is_the_integral_over_its_facets(void **state)
{
    static const double ns[] = { 1.01, 1.1, 1.3, 1.5, 2.2, 4.0 }, rs[] = { 0.5, 0.63, 0.8, 1.0 };
    double worst = 0.0;
    (void) state;
    for (size_t i = 0; i < PELL_COUNT(ns); i++)
        for (size_t j = 0; j < PELL_COUNT(rs); j++) {
            const double truth = brute_rough(ns[i], rs[j]), ours = pell_fresnel_diffuse_rough(1.0 / ns[i], rs[j]);
            REQUIRE_NEAR(ours, truth, 1e-4);
            worst = fmax(worst, fabs(ours - truth));
        }
    print_message("# largest error of a rough boundary %.2g\n", worst);
}

/* The table that specular lobes use, whose F is Schlick's, has the same mean up to the error of Schlick's approximation. */
static void rough_boundary_agrees_with_the_drawn_lobe(void **state)
{
    struct pell_specular_table table;
    (void) state;
    pell_specular_table_make(PELL_SPECULAR_GGX, &table);
    for (double n = 1.2; n < 2.2; n += 0.1)
        for (double r = 0.1; r <= 1.0; r += 0.1) {
            const double f0 = pow((n - 1.0) / (n + 1.0), 2.0);
            REQUIRE_NEAR(pell_fresnel_diffuse_rough(1.0 / n, r), pell_specular_mean(&table, (float) f0, (float) r), 0.012);
        }
}

static void rough_boundary_has_the_right_limits(void **state)
{
    (void) state;
    for (double n = 0.25; n <= 4.0; n += 0.05) {
        const double smooth = pell_fresnel_diffuse(n, PELL_FRESNEL_EXACT);
        double last = 1.0;
        REQUIRE(pell_fresnel_diffuse_rough(n, 0.0) == smooth && pell_fresnel_diffuse_rough(n, -1.0) == smooth);
        REQUIRE_NEAR(pell_fresnel_diffuse_rough(n, 1e-3), smooth, 1e-6);
        REQUIRE(pell_fresnel_diffuse_rough(n, 1.0) == pell_fresnel_diffuse_rough(n, INFINITY));
        for (int k = 0; k <= 50; k++) {
            const double rho = pell_fresnel_diffuse_rough(n, k / 50.0);
            REQUIRE(rho >= 0.0 && rho <= smooth && rho <= last + 4e-5); /* facets that face the light reflect less */
            if (n >= 1.0)                                               /* diffuse entry and exit are in balance (reciprocity) */
                REQUIRE_NEAR((1.0 - rho) * n * n, 1.0 - pell_fresnel_diffuse_rough(1.0 / n, k / 50.0), 1e-12);
            last = rho;
        }
    }
    REQUIRE(pell_fresnel_diffuse_rough(1.0, 0.7) == 0.0);
    REQUIRE(isnan(pell_fresnel_diffuse_rough(NAN, 0.5)) && isnan(pell_fresnel_diffuse_rough(0.0, 0.5)));
    REQUIRE(isnan(pell_fresnel_diffuse_rough(-1.5, 0.5)) && isnan(pell_fresnel_diffuse_rough(INFINITY, 0.0)));
    REQUIRE(pell_fresnel_diffuse_rough(1.5, NAN) == pell_fresnel_diffuse(1.5, PELL_FRESNEL_EXACT));
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(normal_incidence),
        cmocka_unit_test(brewster_angle_leaves_only_perpendicular_light),
        cmocka_unit_test(total_reflection_begins_at_the_critical_angle),
        cmocka_unit_test(reflectance_is_the_same_along_the_reversed_path),
        cmocka_unit_test(equal_indices_reflect_nothing),
        cmocka_unit_test(cosines_out_of_range_are_clamped),
        cmocka_unit_test(diffuse_average_is_the_integral_over_angles),
        cmocka_unit_test(diffuse_average_rises_with_the_index),
        cmocka_unit_test(oracle_rows),
        cmocka_unit_test(polynomials_are_within_a_thousandth_of_the_integral),
        cmocka_unit_test(polynomials_never_reflect_more_than_all),
        cmocka_unit_test(rough_boundary_is_the_integral_over_its_facets),
        cmocka_unit_test(rough_boundary_agrees_with_the_drawn_lobe),
        cmocka_unit_test(rough_boundary_has_the_right_limits),
    };
    return cmocka_run_group_tests_name("optics.fresnel", tests, NULL, NULL);
}
