/* SPDX-License-Identifier: MIT
 * test_specular.c - specular lobes, and the fraction of light that they leave for the medium below. */
#include "oracle.h"

#include "math/vec.h"
#include "optics/medium/specular.h"

static const float roughnesses[] = { 0.1f, 0.2f, 0.3f, 0.45f, 0.6f, 0.8f, 1.0f };
static const float cosines[] = { 0.02f, 0.1f, 0.3f, 0.6f, 0.9f, 1.0f };
static const double up[3] = { 0.0, 0.0, 1.0 };

static void spherical(double cosine, double azimuth, double w[3])
{
    const double s = sqrt(fmax(0.0, 1.0 - cosine * cosine));
    w[0] = s * cos(azimuth);
    w[1] = s * sin(azimuth);
    w[2] = cosine;
}

/* Int D cos dw = 1, D extracted from the lobe at l = v = h, where F is f0 = 1. */
static void beckmann_is_normalised(void **state)
{
    (void) state;
    for (size_t i = 0; i < PELL_COUNT(roughnesses); i++) {
        double sum = 0.0;
        for (int k = 0; k < 20000; k++) {
            const double a = (k + 0.5) / 20000 * 0.5 * PELL_PI, h[3] = { sin(a), 0.0, cos(a) };
            const double d = 4.0 * pell_specular_value(PELL_SPECULAR_KELEMEN, (double) roughnesses[i], 1.0, up, h, h); /* (2h).(2h) = 4 */
            sum += 2.0 * PELL_PI * d * cos(a) * sin(a) * 0.5 * PELL_PI / 20000;
        }
        REQUIRE_NEAR(sum, 1.0, 1e-7);
    }
}

static void ggx_is_normalised(void **state)
{
    (void) state;
    for (size_t i = 0; i < PELL_COUNT(roughnesses); i++) {
        const double r = (double) roughnesses[i], alpha = r * r;
        double sum = 0.0;
        for (int k = 0; k < 20000; k++) {
            const double a = (k + 0.5) / 20000 * 0.5 * PELL_PI, c = cos(a), h[3] = { sin(a), 0.0, c };
            const double g = c / sqrt(alpha * alpha + (1.0 - alpha * alpha) * c * c); /* correlated Smith at l = v */
            sum += 2.0 * PELL_PI * pell_specular_value(PELL_SPECULAR_GGX, r, 1.0, up, h, h) * 4.0 * c * c / g * c * sin(a) * 0.5 * PELL_PI /
                   20000;
        }
        REQUIRE_NEAR(sum, 1.0, 1e-5); /* error of midpoints for the narrowest lobe: h^2/24 2/alpha^2 = 5e-6 */
    }
}

/* Factors and exponents of Phong lobes against closed forms, by quadrature of the BRDF itself with F = 1. At normal incidence, Int f cos
 * dw = 1; along the middle of the highlight they fall off as Beckmann's distribution of m = alpha. */
static void phongs_lobes_are_normalised(void **state)
{
    static const enum pell_specular_model models[] = { PELL_SPECULAR_PHONG, PELL_SPECULAR_BLINN_PHONG };
    (void) state;
    for (size_t m = 0; m < PELL_COUNT(models); m++)
        for (size_t i = 0; i < PELL_COUNT(roughnesses); i++) {
            const double r = (double) roughnesses[i], alpha = r * r, peak = pell_specular_value(models[m], r, 1.0, up, up, up);
            const double n = models[m] == PELL_SPECULAR_PHONG ? 0.5 / (alpha * alpha) - 0.5 : 2.0 / (alpha * alpha) - 2.0;
            double sum = 0.0;
            for (int k = 0; k < 40000; k++) { /* denser toward the middle */
                const double s = (k + 0.5) / 40000, a = s * s * 0.5 * PELL_PI, l[3] = { sin(a), 0.0, cos(a) };
                sum += 2.0 * PELL_PI * pell_specular_value(models[m], r, 1.0, up, l, up) * cos(a) * sin(a) * s * PELL_PI / 40000;
            }
            REQUIRE_NEAR(sum, 1.0, 1e-6);
            REQUIRE_NEAR(peak,
                         models[m] == PELL_SPECULAR_PHONG ? (n + 2.0) / (2.0 * PELL_PI)
                                                          : (n + 2.0) * (n + 4.0) / (8.0 * PELL_PI * (pow(2.0, -0.5 * n) + n)),
                         1e-12 * peak);
            for (int k = 1; alpha < 0.05 && k <= 8; k++) {
                const double half = 0.25 * k * alpha, l[3] = { sin(2.0 * half), 0.0, cos(2.0 * half) };
                REQUIRE_NEAR(pell_specular_value(models[m], r, 1.0, up, l, up) / peak, exp(-pow(tan(half) / alpha, 2.0)), 2e-3);
            }
        }
}

/* Cases with a known integral: Blinn's at n = 0 is a constant 1/pi; narrow lobes depend on one or two cosines; at normal incidence all
 * light is reflected. */
static void phongs_albedos_meet_their_limits(void **state)
{
    struct pell_specular_table phong, blinn;
    (void) state;
    pell_specular_table_make(PELL_SPECULAR_PHONG, &phong);
    pell_specular_table_make(PELL_SPECULAR_BLINN_PHONG, &blinn);
    for (size_t i = 0; i < PELL_COUNT(cosines); i++) {
        const double mu = (double) cosines[i];
        REQUIRE_NEAR(pell_specular_albedo(&blinn, 1.0f, cosines[i], 1.0f), 1.0, 5e-3);
        if (mu < 0.1)
            continue; /* the lobe is cut off at the horizon */
        REQUIRE_NEAR(pell_specular_albedo(&phong, 1.0f, cosines[i], PELL_ROUGHNESS_MIN), mu, 1e-3);
        REQUIRE_NEAR(pell_specular_albedo(&blinn, 1.0f, cosines[i], PELL_ROUGHNESS_MIN), mu * mu, 1e-3);
    }
    for (size_t i = 0; i < PELL_COUNT(roughnesses); i++) {
        REQUIRE_NEAR(pell_specular_albedo(&phong, 1.0f, 1.0f, roughnesses[i]), 1.0, 2e-3);
        REQUIRE_NEAR(pell_specular_albedo(&blinn, 1.0f, 1.0f, roughnesses[i]), 1.0, 2e-3);
    }
}

/* The approximations that kernels use instead of the math library, over their whole range. */
static void logarithm_of_kernels_is_exact(void **state)
{
    (void) state;
    for (int k = 0; k < 60000; k++) {
        const float x = k < 30000 ? expf(-80.0f + 80.0f * (float) k / 30000.0f) : (float) (k - 30000) / 30000.0f;
        const double truth = -log1p(-(double) x);
        if (x < 1.0f)
            REQUIRE_NEAR(pell_log_minus(x), truth, 3e-7 * truth);
    }
    for (int k = 0; k < 2000; k++) {
        const float x = (float) k * 0.05f;
        REQUIRE_NEAR(pell_exp_minus(x), x < 80.0f ? exp(-(double) x) : 0.0, (3e-7 + 1e-7 * (double) x) * exp(-(double) x));
    }
}

static void lobes_are_reciprocal(void **state)
{
    const double length = sqrt(0.98), n[3] = { 0.3 / length, -0.5 / length, 0.8 / length };
    uint32_t seed = 1;
    int lit = 0;
    (void) state;
    for (int i = 0; i < 4000; i++) {
        double w[2][3];
        for (int k = 0; k < 2; k++) {
            seed = seed * 1664525u + 1013904223u;
            spherical(2.0 * (seed >> 8) / 16777216.0 - 1.0, (double) (seed & 0xffu), w[k]);
        }
        for (int model = 0; model < PELL_SPECULAR_MODELS; model++) {
            const double f = pell_specular_value((enum pell_specular_model) model, 0.4, 0.04, n, w[0], w[1]);
            REQUIRE(isfinite(f) && f >= 0.0);
            REQUIRE_NEAR(pell_specular_value((enum pell_specular_model) model, 0.4, 0.04, n, w[1], w[0]), f, 1e-12 * f);
            lit += f > 0.0;
        }
    }
    REQUIRE(lit > 1000);
}

/* The kernels' evaluation equals the formula in double precision. */
static void kernels_draw_the_same_lobe(void **state)
{
    (void) state;
    for (size_t i = 0; i < PELL_COUNT(roughnesses); i++)
        for (size_t j = 0; j < PELL_COUNT(cosines); j++)
            for (int k = 0; k < 40; k++) {
                const float f0 = 0.04f;
                double l[3], v[3];
                spherical((double) cosines[j], 0.0, v);
                spherical(0.02 + 0.97 * (k / 39.0), 0.4 + k, l);
                const struct pell_vec3 n = vec3(0, 0, 1), lf = vec3((float) l[0], (float) l[1], (float) l[2]);
                const struct pell_vec3 vf = vec3((float) v[0], (float) v[1], (float) v[2]), h = vec3_add(lf, vf), cross = vec3_cross(n, h);
                const float hh = vec3_dot(h, h), sin2 = vec3_dot(cross, cross), nh = lf.z + vf.z;
                const float f = pell_schlick(f0, vec3_dot(h, vf) / sqrtf(hh));
                double value[PELL_SPECULAR_MODELS];
                float width2[PELL_SPECULAR_MODELS];
                for (int m = 0; m < PELL_SPECULAR_MODELS; m++) {
                    const float width = pell_lobe_width((enum pell_specular_model) m, roughnesses[i]);
                    width2[m] = width * width;
                    value[m] = pell_specular_value((enum pell_specular_model) m, (double) roughnesses[i], (double) f0, up, l, v);
                }
                REQUIRE_NEAR(f * pell_lobe_ggx(width2[0], lf.z, vf.z, sin2, nh, hh), value[0], 2e-5 * value[0]);
                REQUIRE_NEAR(f * pell_lobe_kelemen(width2[1], sin2, nh, hh), value[1], 5e-5 * value[1] + 1e-12);
                /* narrow: h of 0.05 is accurate to 2e-6 in float, and twenty e-folds down the value is forty times less accurate */
                REQUIRE_NEAR(f * pell_lobe_phong(width2[2], lf.z, vf.z, sin2), value[2], 3e-4 * value[2] + 1e-12);
                REQUIRE_NEAR(f * pell_lobe_blinn_phong(width2[3], sin2, hh), value[3], 3e-4 * value[3] + 1e-12);
            }
}

/* Int f n.l dl by midpoints over a polar grid around the mirror direction, denser toward it, over half a turn: independent of the rule
 * of the tables. */
static double brute_albedo(enum pell_specular_model model, double roughness, double f0, double mu)
{
    const int rings = 700, turns = 120;
    double v[3], sum = 0.0;

    spherical(mu, 0.0, v);
    const double r[3] = { -v[0], 0.0, v[2] }, t[3] = { v[2], 0.0, v[0] }; /* t and y are perpendicular to r */
    for (int i = 0; i < rings; i++) {
        const double s = (i + 0.5) / rings, a = PELL_PI * s * s * s, da = PELL_PI * 3.0 * s * s / rings;
        for (int j = 0; j < turns; j++) {
            const double phi = PELL_PI * (j + 0.5) / turns, x = sin(a) * cos(phi), y = sin(a) * sin(phi);
            const double l[3] = { r[0] * cos(a) + t[0] * x, y, r[2] * cos(a) + t[2] * x };
            sum += pell_specular_value(model, roughness, f0, up, l, v) * l[2] * sin(a) * da * 2.0 * PELL_PI / turns;
        }
    }
    return sum;
}

static void check_albedo(enum pell_specular_model model, double eta)
{
    const float f0 = (float) (((eta - 1.0) / (eta + 1.0)) * ((eta - 1.0) / (eta + 1.0)));
    struct pell_specular_table table;
    double worst = 0.0;

    pell_specular_table_make(model, &table);
    for (size_t i = 0; i < PELL_COUNT(roughnesses); i++)
        for (size_t j = 0; j < PELL_COUNT(cosines); j++) {
            const double truth = brute_albedo(model, (double) roughnesses[i], (double) f0, (double) cosines[j]);
            const double rho_dt = 1.0 - (double) pell_specular_albedo(&table, f0, cosines[j], roughnesses[i]);
            /* the lobe with rho_s = 1 plus the light that enters is all light */
            REQUIRE_NEAR(truth + rho_dt, 1.0, 5e-3);
            worst = fmax(worst, fabs(truth + rho_dt - 1.0));
        }
    print_message("# %s, eta %.2f: largest error of the albedo %.2g\n", pell_specular_name(model), eta, worst);
}

static void specular_and_entering_light_sum_to_one_kelemen(void **state)
{
    (void) state;
    check_albedo(PELL_SPECULAR_KELEMEN, 1.4);
    check_albedo(PELL_SPECULAR_KELEMEN, 2.0);
}

static void specular_and_entering_light_sum_to_one_ggx(void **state)
{
    (void) state;
    check_albedo(PELL_SPECULAR_GGX, 1.5);
    check_albedo(PELL_SPECULAR_GGX, 1.3);
}

static void specular_and_entering_light_sum_to_one_phong(void **state)
{
    (void) state;
    check_albedo(PELL_SPECULAR_PHONG, 1.5);
}

static void specular_and_entering_light_sum_to_one_blinn_phong(void **state)
{
    (void) state;
    check_albedo(PELL_SPECULAR_BLINN_PHONG, 1.5);
}

/* No lobe reflects more light than arrives, from the BRDF itself: F = 1, every direction, also between the tables' entries. */
static void white_furnace_makes_no_light(void **state)
{
    static const double widths[] = { 0.15, 0.5, 0.7, 0.85, 1.0 };
    (void) state;
    for (int model = 0; model < PELL_SPECULAR_MODELS; model++)
        for (size_t i = 0; i < PELL_COUNT(widths); i++)
            for (int j = 0; j <= 5; j++) {
                const double albedo = brute_albedo((enum pell_specular_model) model, widths[i], 1.0, 0.01 + 0.198 * j);
                REQUIRE(albedo > 0.0 && albedo <= 1.0 + 1e-3);
            }
}

/* Under uniform illumination the means of entering and reflected light sum to 1 at every roughness; a metal with F0 = 1 loses only
 * multiple scattering between facets. */
static void furnace_keeps_energy(void **state)
{
    struct pell_specular_table table;
    (void) state;
    for (int model = 0; model < PELL_SPECULAR_MODELS; model++) {
        pell_specular_table_make((enum pell_specular_model) model, &table);
        for (int k = 0; k <= 12; k++) {
            const float r = 0.1f + 0.075f * (float) k, f0 = 0.04f;
            double entered = 0.0, reflected = 0.0;
            for (int i = 0; i < 4000; i++) {
                const float mu = ((float) i + 0.5f) / 4000.0f;
                const double a = (double) pell_specular_albedo(&table, f0, mu, r);
                REQUIRE(a >= 0.0 && a <= 1.0);
                REQUIRE(pell_specular_albedo(&table, 1.0f, mu, r) <= 1.0f);
                entered += 2.0 * (double) mu * (1.0 - a) / 4000;
                reflected += 2.0 * (double) mu * a / 4000;
            }
            REQUIRE_NEAR(entered + reflected, 1.0, 1e-6);
            REQUIRE_NEAR(pell_specular_mean(&table, f0, r), reflected, 1e-5);
        }
    }
    pell_specular_table_make(PELL_SPECULAR_GGX, &table);
    REQUIRE(pell_specular_albedo(&table, 1.0f, 0.8f, 0.1f) > 0.99f);
}

static void smooth_boundary_is_fresnel(void **state)
{
    static const double etas[] = { 0.7, 1.0, 1.02, 1.3, 1.5, 2.0, 4.0 };
    (void) state;
    for (size_t i = 0; i < PELL_COUNT(etas); i++) {
        struct pell_boundary_table table;
        double mean = 0.0;
        pell_boundary_table_make(etas[i], &table);
        for (int k = 1; k <= 20000; k++) {
            const double mu = (k - 0.5) / 20000, t = (double) pell_boundary_lookup(table.transmittance, (float) mu);
            if (etas[i] >= 1.0) /* below, a kink at the critical angle lies between two entries */
                REQUIRE_NEAR(t, 1.0 - pell_fresnel(etas[i], mu), 1e-3);
            mean += 2.0 * mu * t / 20000;
        }
        REQUIRE_NEAR(table.mean, mean, etas[i] >= 1.0 ? 2e-5 : 1e-3);
    }
}

/* 1 - Fdr(1/eta) = eta^2 (1 - Fdr(eta)), the latter from the oracle. */
static void mean_transmittance_is_the_oracles(void **state)
{
    json_t *root = oracle_load("dipole.json"), *row;
    size_t index, checked = 0;
    (void) state;
    json_array_foreach(oracle_get(root, "fresnel"), index, row)
    {
        const double eta = oracle_number(row, "eta"), fdr = oracle_number(row, "Fdr_exact");
        struct pell_boundary_table table;
        if (eta < 1.0 || eta > 4.0)
            continue;
        pell_boundary_table_make(eta, &table);
        REQUIRE_NEAR(table.mean, (1.0 - fdr) * eta * eta, 1e-6);
        checked++;
    }
    json_decref(root);
    REQUIRE(checked >= 8);
}

static void models_have_names_and_others_are_ggx(void **state)
{
    const double l[3] = { 0.6, 0.0, 0.8 };
    struct pell_specular_table odd, ggx;
    (void) state;
    for (int i = 0; i < PELL_SPECULAR_MODELS; i++)
        for (int j = 0; j < i; j++)
            assert_string_not_equal(pell_specular_name((enum pell_specular_model) i), pell_specular_name((enum pell_specular_model) j));
    assert_string_equal(pell_specular_name((enum pell_specular_model) 7), "ggx");
    assert_string_equal(pell_specular_name((enum pell_specular_model) - 1), "ggx");
    pell_specular_table_make((enum pell_specular_model) 7, &odd);
    pell_specular_table_make(PELL_SPECULAR_GGX, &ggx);
    assert_memory_equal(&odd, &ggx, sizeof(odd));
    REQUIRE(pell_specular_value((enum pell_specular_model) 7, 0.4, 0.04, up, l, up) ==
            pell_specular_value(PELL_SPECULAR_GGX, 0.4, 0.04, up, l, up));
}

static void hostile_arguments_stay_finite(void **state)
{
    static const float odd[] = { -1.0f, 0.0f, 1e-7f, 0.5f, 1.0f, 1.0000001f, 7.0f, INFINITY, -INFINITY, NAN };
    struct pell_specular_table table;
    (void) state;
    for (int model = 0; model < PELL_SPECULAR_MODELS; model++) {
        pell_specular_table_make((enum pell_specular_model) model, &table);
        for (size_t i = 0; i < PELL_COUNT(odd); i++)
            for (size_t j = 0; j < PELL_COUNT(odd); j++) {
                const float a = pell_specular_albedo(&table, 0.04f, odd[i], odd[j]), mean = pell_specular_mean(&table, 0.04f, odd[j]);
                const double z = fmin(fmax((double) odd[i], -1.0), 1.0);
                double l[3], v[3];
                REQUIRE(a >= 0.0f && a <= 1.0f && mean >= 0.0f && mean <= 1.0f);
                spherical(z, 0.0, l);
                spherical(fmin(fmax((double) odd[j], -1.0), 1.0), 2.0, v);
                REQUIRE(isfinite(pell_specular_value((enum pell_specular_model) model, (double) odd[j], 0.04, up, l, v)));
                REQUIRE(isfinite(pell_specular_value((enum pell_specular_model) model, (double) odd[j], 0.04, l, l, l)));
            }
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(beckmann_is_normalised),
        cmocka_unit_test(ggx_is_normalised),
        cmocka_unit_test(phongs_lobes_are_normalised),
        cmocka_unit_test(phongs_albedos_meet_their_limits),
        cmocka_unit_test(logarithm_of_kernels_is_exact),
        cmocka_unit_test(lobes_are_reciprocal),
        cmocka_unit_test(kernels_draw_the_same_lobe),
        cmocka_unit_test(specular_and_entering_light_sum_to_one_kelemen),
        cmocka_unit_test(specular_and_entering_light_sum_to_one_ggx),
        cmocka_unit_test(specular_and_entering_light_sum_to_one_phong),
        cmocka_unit_test(specular_and_entering_light_sum_to_one_blinn_phong),
        cmocka_unit_test(white_furnace_makes_no_light),
        cmocka_unit_test(furnace_keeps_energy),
        cmocka_unit_test(smooth_boundary_is_fresnel),
        cmocka_unit_test(mean_transmittance_is_the_oracles),
        cmocka_unit_test(models_have_names_and_others_are_ggx),
        cmocka_unit_test(hostile_arguments_stay_finite),
    };
    return cmocka_run_group_tests_name("optics.specular", tests, NULL, NULL);
}
