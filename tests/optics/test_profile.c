/* SPDX-License-Identifier: MIT
 * test_profile.c - the interface of radial profiles: the dipole against the oracle, sums of Gaussians, vector evaluation against single
 * values. */
#include "oracle.h"

#include "base/simd.h"
#include "math/quadrature.h"
#include "math/vec.h"
#include "optics/profile/kernels.h"
#include "optics/profile/lanes.h"

PELL_SIMD_TABLES(struct pell_profile_kernels, pell_profile_kernels);

static struct pell_medium medium_of(double sigma_a, double sigma_s, double eta)
{
    return (struct pell_medium) { { sigma_a, sigma_a, sigma_a }, { sigma_s, sigma_s, sigma_s }, { 0.0, 0.0, 0.0 }, eta };
}

static void dipole_is_the_oracles(void **state)
{
    const struct pell_profile_params params = { .fresnel = PELL_FRESNEL_POLY3 };
    json_t *root = oracle_load("dipole.json"), *row;
    size_t i;
    (void) state;
    json_array_foreach(oracle_get(root, "table"), i, row)
    {
        const struct pell_medium m = medium_of(oracle_number(row, "sigma_a"), oracle_number(row, "sigma_sp"), oracle_number(row, "eta"));
        struct pell_profile p;
        REQUIRE(pell_profile_make(PELL_PROFILE_DIPOLE, &m, (int) (i % 3), &params, &p) == PELL_OK);
        REQUIRE_REL(pell_profile_total(&p), oracle_number(row, "Rd_closed"), ROUNDED);
        for (size_t k = 0; k < json_array_size(oracle_get(row, "r_mm")); k++) {
            const double r = oracle_at(row, "r_mm", k);
            REQUIRE_REL(pell_profile_eval(&p, r), oracle_at(row, "R", k), ROUNDED);
            REQUIRE_REL(pell_profile_cdf(&p, r), oracle_at(row, "cdf", k), ROUNDED);
        }
    }
    assert_int_equal(i, 36);
    json_decref(root);
}

static void dipole_samples_are_the_oracles(void **state)
{
    const struct pell_profile_params params = { .fresnel = PELL_FRESNEL_POLY3 };
    json_t *root = oracle_load("sampling.json"), *row;
    size_t i;
    (void) state;
    json_array_foreach(oracle_get(root, "sampling"), i, row)
    {
        const struct pell_medium m = medium_of(oracle_number(row, "sigma_a"), oracle_number(row, "sigma_sp"), oracle_number(row, "eta"));
        struct pell_profile p;
        REQUIRE(pell_profile_make(PELL_PROFILE_DIPOLE, &m, 0, &params, &p) == PELL_OK);
        for (size_t k = 0; k < json_array_size(oracle_get(row, "xi")); k++)
            REQUIRE_REL(pell_profile_sample(&p, oracle_at(row, "xi", k)), oracle_at(row, "r_of_full_cdf", k), ROUNDED);
    }
    assert_int_equal(i, 7);
    json_decref(root);
}

/* Identity 1 of the oracle: alpha'/2 (exp(-k zr) + exp(-k zv)), k = sqrt(sigma_tr^2 + s^2). */
static void dipole_has_a_transform(void **state)
{
    const struct pell_medium m = medium_of(0.032, 0.74, 1.3);
    const struct pell_dipole d = pell_dipole_make(0.032, 0.74, 1.3, PELL_FRESNEL_EXACT);
    struct pell_profile p;
    (void) state;
    REQUIRE(pell_profile_make(PELL_PROFILE_DIPOLE, &m, 0, NULL, &p) == PELL_OK);
    for (double s = 0.0; s < 20.0; s += 0.37) {
        const double k = sqrt(d.sigma_tr * d.sigma_tr + s * s);
        REQUIRE_REL(pell_profile_transform(&p, s), 0.5 * d.albedo_reduced * (exp(-k * d.zr) + exp(-k * d.zv)), 1e-13);
    }
}

/* The tail (zr + zv)/(2 r) of a dipole without absorption, far beyond the radius at which 1 - xi has significant digits in double
 * precision. */
static void lossless_tails_are_sampled(void **state)
{
    const struct pell_medium m = medium_of(0.0, 20.4, 1.3);
    const struct pell_dipole d = pell_dipole_make(0.0, 20.4, 1.3, PELL_FRESNEL_EXACT);
    struct pell_profile p;
    (void) state;
    REQUIRE(pell_profile_make(PELL_PROFILE_DIPOLE, &m, 0, NULL, &p) == PELL_OK);
    for (int i = 20; i <= 52; i += 4) {
        const double left = ldexp(1.0, -i), r = pell_profile_sample(&p, 1.0 - left);
        REQUIRE_REL(r, 0.5 * (d.zr + d.zv) / left, 1e-5);
    }
}

/* --- Vectors --------------------------------------------------------------------------------------------------------------------- */

static void exponentials_are_accurate(void **state)
{
    (void) state;
    REQUIRE(lanes_exp(0.0) == 1.0 && lanes_absorbed(0.0) == 0.0 && lanes_exp(1e300) == 0.0 && lanes_absorbed(1e300) == 1.0);
    REQUIRE(lanes_exp(INFINITY) == 0.0 && lanes_absorbed(INFINITY) == 1.0);
    for (double x = 1e-20; x < 708.0; x *= 1.0007) {
        REQUIRE_REL(lanes_exp(x), exp(-x), 4e-16);
        REQUIRE_REL(lanes_absorbed(x), -expm1(-x), 4e-16);
    }
}

/* One profile of each kind. */
static void every_kind(struct pell_profile out[4])
{
    const struct pell_medium m = medium_of(0.3, 1.1, 1.4);
    const struct pell_gaussians g = { .count = 3, .variance = { 0.01, 0.3, 2.0 }, .weight = { { 0.2 }, { 0.5 }, { 0.1 } } };
    REQUIRE(pell_profile_make(PELL_PROFILE_DIPOLE, &m, 0, NULL, &out[PELL_PROFILE_KIND_POLES]) == PELL_OK);
    REQUIRE(pell_profile_make(PELL_PROFILE_NORMALIZED_DIFFUSION, &m, 0, NULL, &out[PELL_PROFILE_KIND_BURLEY]) == PELL_OK);
    REQUIRE(pell_profile_make(PELL_PROFILE_PHOTON_BEAM, &m, 0, NULL, &out[PELL_PROFILE_KIND_NODES]) == PELL_OK);
    REQUIRE(pell_profile_from_gaussians(&g, 0, &out[PELL_PROFILE_KIND_GAUSSIANS]) == PELL_OK);
    for (int k = 0; k < 4; k++)
        REQUIRE(out[k].kind == k);
}

#define RADII 1003

static void all_levels_give_the_bits_of_single_values(void **state)
{
    static struct pell_profile p[4];
    static double r[RADII], R[RADII], same[RADII];
    (void) state;
    every_kind(p);
    for (int i = 0; i < RADII; i++)
        r[i] = 1e-8 * exp(0.03 * i);
    r[0] = 0.0;
    r[1] = INFINITY;
    r[2] = NAN;
    r[3] = -1.0;
    r[4] = 1e300;
    for (int k = 0; k < 4; k++) {
        for (int level = 0; level <= (int) pell_simd_best(); level++)
            for (size_t count = 0; count <= RADII; count = count < 70 ? count + 1 : count + 311) {
                pell_profile_kernels_tables[level]->of_kind[k](&p[k], r, R, count);
                for (size_t i = 0; i < count; i++) {
                    const double one = pell_profile_eval(&p[k], r[i]);
                    REQUIRE(isfinite(one) && one >= 0.0);
                    assert_memory_equal(&R[i], &one, sizeof(one));
                }
            }
        pell_profile_eval_many(&p[k], r, R, RADII);
        memcpy(same, r, sizeof(r));
        pell_profile_eval_many(&p[k], same, same, RADII); /* in place */
        assert_memory_equal(same, R, sizeof(R));
    }
}

static void many_radii_of_nothing_are_nothing(void **state)
{
    const struct pell_medium m = medium_of(1.0, 0.0, 1.3);
    double r[20] = { 0 }, R[20];
    struct pell_profile p;
    (void) state;
    REQUIRE(pell_profile_make(PELL_PROFILE_PHOTON_BEAM, &m, 0, NULL, &p) == PELL_OK && p.total == 0.0);
    pell_profile_eval_many(&p, r, R, 20);
    for (int i = 0; i < 20; i++)
        REQUIRE(R[i] == 0.0);
    REQUIRE(pell_profile_sample(&p, 0.5) == 0.0 && pell_profile_pdf(&p, 1.0) == 0.0 && pell_profile_transform(&p, 1.0) == 0.0);
    REQUIRE(pell_profile_cdf(&p, 0.1) == 1.0);
}

/* --- Sums of Gaussians ----------------------------------------------------------------------------------------------------------- */

static const struct pell_gaussians skin = {
    /* d'Eon and Luebke 2007, red */
    .count = 6,
    .variance = { 0.0064, 0.0484, 0.187, 0.567, 1.99, 7.41 },
    .weight = { { 0.233, 0.455, 0.649 },
                { 0.1, 0.336, 0.344 },
                { 0.118, 0.198, 0.0 },
                { 0.113, 0.007, 0.007 },
                { 0.358, 0.004, 0.0 },
                { 0.078, 0.0, 0.0 } },
};

static void gaussians_are_profiles(void **state)
{
    (void) state;
    for (int c = 0; c < 3; c++) {
        struct pell_profile p;
        REQUIRE(pell_profile_from_gaussians(&skin, c, &p) == PELL_OK);
        REQUIRE_REL(p.total, pell_gaussians_total(&skin, c), 1e-15);
        for (double r = 0.0; r < 10.0; r += 0.13)
            REQUIRE_REL(pell_profile_eval(&p, r), pell_gaussians_eval(&skin, c, r), 2e-14); /* the exponent's rounding */
        for (double s = 0.0; s < 10.0; s += 0.3) {
            double transform = 0.0, inside = 0.0;
            for (int i = 0; i < skin.count; i++) {
                transform += skin.weight[i][c] * exp(-0.5 * skin.variance[i] * s * s);
                inside += skin.weight[i][c] * (1.0 - exp(-0.5 * s * s / skin.variance[i]));
            }
            REQUIRE_REL(pell_profile_transform(&p, s), transform, 1e-13);
            REQUIRE_NEAR(pell_profile_cdf(&p, s) * p.total, inside, 1e-14);
        }
        for (double xi = 1e-12; xi < 1.0; xi += xi < 0.01 ? xi : 0.01) {
            const double r = pell_profile_sample(&p, xi);
            REQUIRE_REL(pell_profile_cdf(&p, r), xi, 1e-13);
        }
    }
    const struct pell_gaussians one = { .count = 1, .variance = { 0.7 }, .weight = { { 0.5 } } };
    struct pell_profile p;
    REQUIRE(pell_profile_from_gaussians(&one, 0, &p) == PELL_OK);
    for (double xi = 0.05; xi < 1.0; xi += 0.1)
        REQUIRE_REL(pell_profile_sample(&p, xi), sqrt(-2.0 * 0.7 * log1p(-xi)), 1e-13);
}

/* For a Gaussian sqrt(pi v/2); for the models their integral. */
static void mean_radii_are_integrals(void **state)
{
    const struct pell_gaussians one = { .count = 1, .variance = { 0.7 }, .weight = { { 0.4, 0.4, 0.4 } } };
    const struct pell_medium m = { .sigma_a = { 0.1, 0.1, 0.1 }, .sigma_s_reduced = { 1.0, 1.0, 1.0 }, .eta = 1.3 };
    struct pell_profile p = { 0 };
    double mean = 0.0;

    (void) state;
    REQUIRE(pell_profile_mean_radius(&p) == 0.0);
    assert_int_equal(pell_profile_from_gaussians(&one, 1, &p), PELL_OK);
    REQUIRE_REL(pell_profile_mean_radius(&p), sqrt(0.5 * PELL_PI * 0.7), 1e-3);
    for (int model = 0; model < PELL_PROFILE_MODELS; model++) {
        const int steps = 20000;
        double sum = 0.0;
        assert_int_equal(pell_profile_make((enum pell_profile_model) model, &m, 0, NULL, &p), PELL_OK);
        mean = pell_profile_mean_radius(&p);
        for (int i = 0; i < steps; i++) { /* Int 2 pi r^2 R dr over r = t/(1 - t)^2 */
            const double t = (i + 0.5) / steps, r = t / ((1.0 - t) * (1.0 - t));
            sum += 2.0 * PELL_PI * r * r * pell_profile_eval(&p, r) * (1.0 + t) / pow(1.0 - t, 3.0) / steps;
        }
        REQUIRE_REL(mean, sum / pell_profile_total(&p), 5e-3);
    }
}

static void wrong_gaussians_are_refused(void **state)
{
    static const double wrong[][2] = { { 0.0, 0.5 },  { -1.0, 0.5 }, { NAN, 0.5 }, { INFINITY, 0.5 },
                                       { 1.0, -0.1 }, { 1.0, NAN },  { 1.0, 1.1 }, { 1e19, 0.1 } };
    struct pell_profile p;
    struct pell_gaussians g = skin;
    (void) state;
    REQUIRE(pell_profile_from_gaussians(&g, 3, &p) == PELL_ERR_INVALID && pell_profile_from_gaussians(&g, -1, &p) == PELL_ERR_INVALID);
    g.count = PELL_GAUSSIANS_MAX + 1;
    REQUIRE(pell_profile_from_gaussians(&g, 0, &p) == PELL_ERR_INVALID);
    g.count = -1;
    REQUIRE(pell_profile_from_gaussians(&g, 0, &p) == PELL_ERR_INVALID);
    for (size_t i = 0; i < PELL_COUNT(wrong); i++) {
        g = skin;
        g.variance[2] = wrong[i][0];
        g.weight[2][0] = wrong[i][1];
        REQUIRE(pell_profile_from_gaussians(&g, 0, &p) == PELL_ERR_INVALID && p.total == 0.0);
    }
    g = skin;
    g.weight[0][0] += 0.001; /* sums to 1.001 */
    REQUIRE(pell_profile_from_gaussians(&g, 0, &p) == PELL_ERR_INVALID);
    g = (struct pell_gaussians) { 0 };
    REQUIRE(pell_profile_from_gaussians(&g, 0, &p) == PELL_OK && p.total == 0.0 && pell_profile_eval(&p, 0.0) == 0.0);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(dipole_is_the_oracles),
        cmocka_unit_test(dipole_samples_are_the_oracles),
        cmocka_unit_test(dipole_has_a_transform),
        cmocka_unit_test(lossless_tails_are_sampled),
        cmocka_unit_test(exponentials_are_accurate),
        cmocka_unit_test(all_levels_give_the_bits_of_single_values),
        cmocka_unit_test(many_radii_of_nothing_are_nothing),
        cmocka_unit_test(gaussians_are_profiles),
        cmocka_unit_test(mean_radii_are_integrals),
        cmocka_unit_test(wrong_gaussians_are_refused),
    };
    return cmocka_run_group_tests_name("optics.profile", tests, NULL, NULL);
}
