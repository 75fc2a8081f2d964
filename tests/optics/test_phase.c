/* SPDX-License-Identifier: MIT
 * test_phase.c - phase functions: normalisation, mean cosine, sampling, sign convention of the cosine. */
#include "pell_test.h"

#include "math/quadrature.h"
#include "math/vec.h"

#include <pellucid/phase.h>

static const double gs[] = { -PELL_G_MAX, -0.9, -0.4,   -1e-3, -1e-9, -1e-300, 0.0, 1e-300, 1e-12,
                             1e-5,        0.05, 0.0999, 0.1,   0.25,  0.4,     0.8, 0.99,   PELL_G_MAX };

/* Every kind with every g, and mixtures of them. */
static size_t all(struct pell_phase out[64])
{
    size_t n = 0;
    for (size_t i = 0; i < PELL_COUNT(gs); i++) {
        out[n++] = (struct pell_phase) { PELL_PHASE_HENYEY_GREENSTEIN, { gs[i] }, 0.0 };
        out[n++] = (struct pell_phase) { PELL_PHASE_SCHLICK, { gs[i] }, 0.0 };
    }
    out[n++] = (struct pell_phase) { PELL_PHASE_RAYLEIGH, { NAN, NAN }, NAN };
    for (size_t i = 0; i < 5; i++)
        out[n++] = (struct pell_phase) { PELL_PHASE_TWO_LOBE, { 0.9 - 0.1 * (double) i, -0.5 }, 0.25 * (double) i };
    return n;
}

struct moment {
    const struct pell_phase *p;
    int power; /* of the forward cosine */
};

/* Substitutes 1 + cos_theta = 2 t^4 or 1 - cos_theta = 2 t^4 on each half, so that the narrowest peak is resolved. */
static double half(double t, const void *arg, double sign)
{
    const struct moment *m = arg;
    const double c = sign * (t * t * t * t - 1.0);
    return 2.0 * PELL_PI * pell_phase_value(m->p, c) * pow(-c, m->power) * 4.0 * t * t * t;
}

static double forward(double t, const void *arg)
{
    return half(t, arg, 1.0);
}

static double backward(double t, const void *arg)
{
    return half(t, arg, -1.0);
}

static double moment(const struct pell_phase *p, int power)
{
    const struct moment m = { p, power };
    return pell_integrate(forward, &m, 0.0, 1.0, 1e-15, 1e-13, NULL) + pell_integrate(backward, &m, 0.0, 1.0, 1e-15, 1e-13, NULL);
}

static void values_integrate_to_one(void **state)
{
    struct pell_phase p[64];
    const size_t n = all(p);
    (void) state;
    for (size_t i = 0; i < n; i++) {
        REQUIRE(pell_phase_valid(&p[i], NULL));
        REQUIRE_NEAR(moment(&p[i], 0), 1.0, 1e-9); /* 1 + c of a peak of width 1e-4 has 8 digits fewer than c */
    }
}

static void mean_cosine_is_the_first_moment(void **state)
{
    struct pell_phase p[64];
    const size_t n = all(p);
    (void) state;
    for (size_t i = 0; i < n; i++)
        REQUIRE_NEAR(pell_phase_mean_cosine(&p[i]), moment(&p[i], 1), 1e-9);
}

/* Reference values of the phase functions. */
static void schlicks_k_is_not_the_mean_cosine(void **state)
{
    static const double pairs[][2] = { { 0.25, 0.169 }, { 0.40, 0.276 }, { 0.80, 0.632 } };
    (void) state;
    for (size_t i = 0; i < PELL_COUNT(pairs); i++) {
        const struct pell_phase p = { PELL_PHASE_SCHLICK, { pairs[i][0] }, 0.0 }, q = { PELL_PHASE_SCHLICK, { -pairs[i][0] }, 0.0 };
        REQUIRE_NEAR(pell_phase_mean_cosine(&p), pairs[i][1], 5e-4);
        REQUIRE(pell_phase_mean_cosine(&q) == -pell_phase_mean_cosine(&p));
    }
    for (double g = -0.99; g < 0.99; g += 0.013) {
        const struct pell_phase p = { PELL_PHASE_SCHLICK, { pell_phase_schlick_k(g) }, 0.0 };
        REQUIRE_NEAR(pell_phase_mean_cosine(&p), g, 1e-13);
    }
    REQUIRE(pell_phase_schlick_k(0.0) == 0.0 && isnan(pell_phase_schlick_k(NAN)));
    REQUIRE(pell_phase_schlick_k(1.0) == PELL_G_MAX && pell_phase_schlick_k(-INFINITY) == -PELL_G_MAX);
}

static void light_goes_on_with_cosine_minus_one(void **state)
{
    const struct pell_phase hg = { PELL_PHASE_HENYEY_GREENSTEIN, { 0.7 }, 0.0 }, schlick = { PELL_PHASE_SCHLICK, { 0.7 }, 0.0 };
    const double w_i[3] = { 0.0, 0.6, -0.8 };
    double w_o[3];
    (void) state;
    REQUIRE_REL(pell_phase_value(&hg, -1.0), (1.0 - 0.49) / (4.0 * PELL_PI * 0.3 * 0.3 * 0.3), 1e-14);
    REQUIRE_REL(pell_phase_value(&hg, 1.0), (1.0 - 0.49) / (4.0 * PELL_PI * 1.7 * 1.7 * 1.7), 1e-14);
    REQUIRE_REL(pell_phase_value(&schlick, -1.0), 0.51 / (4.0 * PELL_PI * 0.09), 1e-14);
    REQUIRE(pell_phase_sample_cosine(&hg, 1.0) == -1.0 && pell_phase_sample_cosine(&hg, 0.0) == 1.0);
    pell_phase_sample(&hg, 1.0, 0.3, w_i, w_o);
    for (int i = 0; i < 3; i++)
        REQUIRE_NEAR(w_o[i], -w_i[i], 1e-15);
}

static void sampling_inverts_the_distribution(void **state)
{
    struct pell_phase p[64];
    const size_t n = all(p);
    (void) state;
    for (size_t i = 0; i < n; i++) {
        double last = -1.0;
        REQUIRE(pell_phase_cdf(&p[i], 1.0) == 0.0);
        REQUIRE_NEAR(pell_phase_cdf(&p[i], -1.0), 1.0, 1e-15);
        for (int k = 0; k <= 1000; k++) {
            const double c = 1.0 - k * 2e-3, cdf = pell_phase_cdf(&p[i], c);
            REQUIRE(cdf >= last && cdf <= 1.0 + 1e-15);
            last = cdf;
        }
        for (int k = 0; k <= 1000 && p[i].kind != PELL_PHASE_TWO_LOBE; k++) {
            const double xi = k / 1000.0, c = pell_phase_sample_cosine(&p[i], xi);
            REQUIRE(c >= -1.0 && c <= 1.0);
            REQUIRE_NEAR(pell_phase_cdf(&p[i], c), xi, fabs(p[i].g[0]) > 0.99 ? 1e-8 : 1e-12); /* c next to -1 rounds */
        }
    }
}

static double rng(uint64_t *s)
{
    *s = *s * 6364136223846793005u + 1442695040888963407u;
    return (double) (*s >> 11) / 9007199254740992.0;
}

/* Pearson's chi^2 of 64 bins of equal probability for the cosine, by 8 of the azimuth: 511 degrees of freedom, mean 511, sigma 32. */
static void samples_are_distributed_as_the_value(void **state)
{
    struct pell_phase p[64];
    const size_t n = all(p);
    uint64_t seed = 7;
    (void) state;
    for (size_t i = 0; i < n; i++) {
        const double length = sqrt(0.3 * 0.3 + 0.5 * 0.5 + 0.2 * 0.2),
                     w_i[3] = { 0.3 / length, -0.5 / length, (i % 2 ? 0.2 : -0.2) / length };
        const double side[3] = { w_i[1] / hypot(w_i[0], w_i[1]), -w_i[0] / hypot(w_i[0], w_i[1]), 0.0 };
        const double up[3] = { w_i[1] * side[2] - w_i[2] * side[1], w_i[2] * side[0] - w_i[0] * side[2],
                               w_i[0] * side[1] - w_i[1] * side[0] };
        const int count = 51200;
        int bin[64][8] = { { 0 } };
        double chi = 0.0;
        for (int k = 0; k < count; k++) {
            const double xi1 = rng(&seed), xi2 = rng(&seed);
            double w_o[3], c = 0.0, s = 0.0, t = 0.0, norm = 0.0;
            const double density = pell_phase_sample(&p[i], xi1, xi2, w_i, w_o);
            for (int a = 0; a < 3; a++) {
                c += w_o[a] * w_i[a];
                s += w_o[a] * side[a];
                t += w_o[a] * up[a];
                norm += w_o[a] * w_o[a];
            }
            REQUIRE_NEAR(norm, 1.0, 1e-12);
            if (fabs(p[i].g[0]) < 0.995 || p[i].kind == PELL_PHASE_RAYLEIGH)
                REQUIRE_REL(density, pell_phase_value(&p[i], c), 1e-9);
            const int row = (int) fmin(63.0, 64.0 * pell_phase_cdf(&p[i], c)),
                      column = (int) fmin(7.0, 8.0 * (atan2(t, s) / (2.0 * PELL_PI) + 0.5));
            bin[row][column]++;
        }
        for (int a = 0; a < 64; a++)
            for (int b = 0; b < 8; b++)
                chi += (bin[a][b] - count / 512.0) * (bin[a][b] - count / 512.0) / (count / 512.0);
        REQUIRE(chi > 511.0 - 5 * 32.0 && chi < 511.0 + 5 * 32.0);
    }
}

/* p(w_i, w_o) = p(w_o, w_i), and a sample's density is the value for the two directions, whichever is called the light's. */
static void exchanging_light_and_viewer_changes_nothing(void **state)
{
    struct pell_phase p[64];
    const size_t n = all(p);
    uint64_t seed = 3;
    (void) state;
    for (size_t i = 0; i < n; i++)
        for (int k = 0; k < 200; k++) {
            const double z = 2.0 * rng(&seed) - 1.0, turn = 6.3 * rng(&seed),
                         w_i[3] = { sqrt(1 - z * z) * cos(turn), sqrt(1 - z * z) * sin(turn), z };
            double w_o[3], there = 0.0, back = 0.0;
            const double xi2 = rng(&seed), xi1 = rng(&seed), density = pell_phase_sample(&p[i], xi1, xi2, w_i, w_o);
            for (int a = 0; a < 3; a++) {
                there += w_i[a] * w_o[a];
                back += w_o[a] * w_i[a];
            }
            REQUIRE(pell_phase_value(&p[i], there) == pell_phase_value(&p[i], back));
            if (fabs(p[i].g[0]) < 0.995)
                REQUIRE_REL(pell_phase_value(&p[i], there), density, 1e-9);
        }
}

static void a_mixture_of_one_lobe_is_that_lobe(void **state)
{
    const struct pell_phase one = { PELL_PHASE_HENYEY_GREENSTEIN, { 0.6 }, 0.0 };
    const struct pell_phase first = { PELL_PHASE_TWO_LOBE, { 0.6, -0.3 }, 1.0 }, second = { PELL_PHASE_TWO_LOBE, { -0.3, 0.6 }, 0.0 };
    (void) state;
    for (int k = 0; k <= 100; k++) {
        const double x = k / 100.0, c = 2.0 * x - 1.0;
        REQUIRE(pell_phase_value(&first, c) == pell_phase_value(&one, c) && pell_phase_value(&second, c) == pell_phase_value(&one, c));
        REQUIRE(pell_phase_sample_cosine(&first, x) == pell_phase_sample_cosine(&one, x));
        REQUIRE(pell_phase_sample_cosine(&second, x) == pell_phase_sample_cosine(&one, x));
    }
}

static void what_is_out_of_range_is_named(void **state)
{
    static const struct {
        struct pell_phase p;
        const char *field;
    } bad[] = {
        { { PELL_PHASE_HENYEY_GREENSTEIN, { 1.0 }, 0.0 }, "g[0]" },     { { PELL_PHASE_SCHLICK, { -1.0 }, 0.0 }, "g[0]" },
        { { PELL_PHASE_HENYEY_GREENSTEIN, { NAN }, 0.0 }, "g[0]" },     { { PELL_PHASE_SCHLICK, { INFINITY }, 0.0 }, "g[0]" },
        { { PELL_PHASE_TWO_LOBE, { 0.1, -1.5 }, 0.5 }, "g[1]" },        { { PELL_PHASE_TWO_LOBE, { 0.1, 0.1 }, 1.01 }, "weight" },
        { { PELL_PHASE_TWO_LOBE, { 0.1, 0.1 }, NAN }, "weight" },       { { (enum pell_phase_kind) 99, { 0.1, 0.1 }, 0.5 }, "kind" },
        { { PELL_PHASE_TWO_LOBE, { 0.1, 0.1 }, -INFINITY }, "weight" },
    };
    (void) state;
    for (size_t i = 0; i < PELL_COUNT(bad); i++) {
        struct pell_medium_fault fault;
        REQUIRE(!pell_phase_valid(&bad[i].p, &fault) && !pell_phase_valid(&bad[i].p, NULL));
        assert_string_equal(fault.field, bad[i].field);
        REQUIRE(!(fault.value >= fault.min && fault.value <= fault.max));
    }
}

static void numbers_out_of_range_are_clamped(void **state)
{
    static const double odd[] = { -INFINITY, -1.0, 2.0, INFINITY, NAN, 1.0 + 1e-15 };
    struct pell_phase p[64];
    const size_t n = all(p);
    (void) state;
    for (size_t i = 0; i < n; i++)
        for (size_t k = 0; k < PELL_COUNT(odd); k++) {
            const double w_i[3] = { 0.0, 0.0, -1.0 };
            double w_o[3];
            REQUIRE(isfinite(pell_phase_value(&p[i], odd[k])) && pell_phase_value(&p[i], odd[k]) > 0.0);
            REQUIRE(isfinite(pell_phase_cdf(&p[i], odd[k])));
            REQUIRE(isfinite(pell_phase_sample(&p[i], odd[k], odd[k], w_i, w_o)));
            REQUIRE_NEAR(w_o[0] * w_o[0] + w_o[1] * w_o[1] + w_o[2] * w_o[2], 1.0, 1e-14);
        }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(values_integrate_to_one),
        cmocka_unit_test(mean_cosine_is_the_first_moment),
        cmocka_unit_test(schlicks_k_is_not_the_mean_cosine),
        cmocka_unit_test(light_goes_on_with_cosine_minus_one),
        cmocka_unit_test(sampling_inverts_the_distribution),
        cmocka_unit_test(samples_are_distributed_as_the_value),
        cmocka_unit_test(exchanging_light_and_viewer_changes_nothing),
        cmocka_unit_test(a_mixture_of_one_lobe_is_that_lobe),
        cmocka_unit_test(what_is_out_of_range_is_named),
        cmocka_unit_test(numbers_out_of_range_are_clamped),
    };
    return cmocka_run_group_tests_name("optics.phase", tests, NULL, NULL);
}
