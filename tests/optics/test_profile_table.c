/* SPDX-License-Identifier: MIT
 * test_profile_table.c - a user's own table as a profile. */
#include "oracle.h"

#include "math/quadrature.h"
#include "math/vec.h"
#include "optics/profile/nodes.h"

#define MANY 100000

static double r[MANY], R[MANY];
static struct pell_profile p;
static struct pell_profile_fault fault;

static double random01(uint64_t *state)
{
    *state = *state * 6364136223846793005u + 1442695040888963407u;
    return (double) (*state >> 11) * 0x1p-53;
}

static double shell(double x, const void *profile)
{
    return 2.0 * PELL_PI * x * pell_profile_eval(profile, x);
}

/* Properties of any table: it interpolates the rows' values, without overshoot between neighbours, and flux and samples agree. */
static void requires_table(size_t count)
{
    double total = PELL_PI * r[0] * r[0] * R[0], last = 0.0;
    for (size_t i = 0; i < count; i++)
        REQUIRE_NEAR(pell_profile_eval(&p, r[i]), R[i], 1e-14 * fmax(R[i], i > 0 ? R[i - 1] : 0.0));
    for (size_t i = 0; i + 1 < count; i++) {
        const double low = fmin(R[i], R[i + 1]), high = fmax(R[i], R[i + 1]);
        double before = R[i];
        for (int k = 0; k <= 16; k++) {
            const double x = r[i] + (r[i + 1] - r[i]) * k / 16.0, v = pell_profile_eval(&p, x), slack = 1e-13 * high;
            REQUIRE(v >= 0.0 && v >= low - slack && v <= high + slack);
            REQUIRE(R[i + 1] >= R[i] ? v >= before - slack : v <= before + slack);
            before = v;
        }
        total += pell_integrate(shell, &p, r[i], r[i + 1], 1e-16, 1e-12, NULL);
    }
    REQUIRE_NEAR(p.total, total, 1e-10);
    REQUIRE(pell_profile_eval(&p, 0.5 * r[0]) == R[0] && pell_profile_eval(&p, r[count - 1] * 1.0000001) == 0.0);
    for (int k = 1; k < 50 && p.total > 0.0; k++) {
        const double x = pell_profile_sample(&p, k / 50.0);
        REQUIRE(x >= last && x <= r[count - 1]);
        REQUIRE_NEAR(pell_profile_cdf(&p, x), k / 50.0, 1e-12);
        last = x;
    }
}

static void accept(size_t count)
{
    if (pell_profile_from_table(r, R, count, &p, &fault) != PELL_OK)
        fail_msg("row %zu: %s = %g", fault.row, fault.field, fault.value);
    REQUIRE(fault.field == NULL && p.kind == PELL_PROFILE_KIND_NODES && p.total >= 0.0 && p.total <= 1.0);
}

static void falling_tables_fall(void **state)
{
    (void) state;
    for (size_t i = 0; i < 40; i++) {
        r[i] = 0.1 * (double) i;
        R[i] = 0.2 * exp(-3.0 * r[i]);
    }
    accept(40);
    requires_table(40);
    REQUIRE_REL(p.total, 2.0 * PELL_PI * 0.2 / 9.0, 2e-3); /* the error of a cubic for the exponential, and of the end at 3.9 mm */
}

static void rings_gaps_and_zeros_are_legal(void **state)
{
    static const double radii[] = { 0.3, 0.4, 0.41, 1.0, 1.5, 1.6, 2.0, 7.0, 7.5 }, values[] = { 0, 0.2, 0.1, 0, 0, 0.05, 0, 0, 0.001 };
    (void) state;
    memcpy(r, radii, sizeof(radii));
    memcpy(R, values, sizeof(values));
    accept(PELL_COUNT(radii));
    requires_table(PELL_COUNT(radii));
    REQUIRE(pell_profile_eval(&p, 1.2) == 0.0 && pell_profile_eval(&p, 0.1) == 0.0);
    memset(R, 0, sizeof(values));
    accept(PELL_COUNT(radii));
    REQUIRE(p.total == 0.0 && pell_profile_sample(&p, 0.5) == 0.0 && pell_profile_cdf(&p, 1.0) == 1.0);
}

static void two_rows_are_enough(void **state)
{
    (void) state;
    r[0] = 0.0, r[1] = 2.0, R[0] = 0.1, R[1] = 0.0; /* a cone: volume pi 4 0.1/3 */
    accept(2);
    requires_table(2);
    REQUIRE_REL(p.total, PELL_PI * 0.4 / 3.0, 1e-14);
    r[0] = 1.0, r[1] = 2.0, R[0] = R[1] = 0.05; /* a disc */
    accept(2);
    requires_table(2);
    REQUIRE_REL(p.total, PELL_PI * 4.0 * 0.05, 1e-14);
    REQUIRE_REL(pell_profile_cdf(&p, 0.5), 0.0625, 1e-14);
}

/* Light whose fractions are denormal counts as none; slightly more is accurate. */
static void hardly_any_light_is_none(void **state)
{
    static const double peaks[] = { 5e-324, 2.8e-313, 1e-300, 1e-280, 1e-200 };
    (void) state;
    for (size_t k = 0; k < PELL_COUNT(peaks); k++)
        for (size_t count = 2; count <= 2000; count = count == 2 ? 20 : count == 20 ? 2000 : 3000) { /* the last two are merged */
            for (size_t i = 0; i < count; i++) {
                r[i] = 1e-3 * pow(10.0, 3.0 * (double) i / (double) (count - 1));
                R[i] = peaks[k] / (1.0 + r[i]);
            }
            accept(count);
            REQUIRE(peaks[k] > 1e-289 ? p.total > 1e-290 : p.total == 0.0);
            for (int j = 1; j < 20; j++) {
                const double x = pell_profile_sample(&p, j / 20.0);
                REQUIRE(isfinite(x) && x >= 0.0);
                REQUIRE(p.total > 0.0 ? fabs(pell_profile_cdf(&p, x) - j / 20.0) < 1e-12 : pell_profile_eval(&p, x) == 0.0);
            }
        }
}

static void wild_tables_stay_in_bounds(void **state)
{
    uint64_t seed = 7;
    (void) state;
    for (int round = 0; round < 200; round++) {
        const size_t count = 2 + (size_t) (random01(&seed) * 40.0);
        double at = random01(&seed) < 0.5 ? 0.0 : 1e-6;
        for (size_t i = 0; i < count; i++) {
            r[i] = at;
            at += pow(10.0, -6.0 * random01(&seed)) / 10.0;
            R[i] = random01(&seed) < 0.2 ? 0.0 : pow(10.0, -9.0 * random01(&seed)) / 100.0;
        }
        accept(count);
        requires_table(count);
    }
}

static void wrong_rows_are_named(void **state)
{
    static const struct {
        size_t row;
        bool radius;
        double value;
        const char *what;
    } wrong[] = {
        { 3, true, NAN, "r_mm" },    { 3, true, INFINITY, "r_mm" }, { 3, true, 0.2, "r_mm" },    { 4, true, 0.1, "r_mm" },
        { 0, true, -1.0, "r_mm" },   { 9, true, 1e13, "r_mm" },     { 5, false, NAN, "R" },      { 5, false, -1e-9, "R" },
        { 0, false, INFINITY, "R" }, { 9, false, 1e25, "R" },       { 6, false, 10.0, "total" }, { 0, false, 1e24, "total" },
    };
    (void) state;
    for (size_t k = 0; k < PELL_COUNT(wrong); k++) {
        for (size_t i = 0; i < 10; i++) {
            r[i] = 0.1 * (double) i;
            R[i] = 0.1;
        }
        (wrong[k].radius ? r : R)[wrong[k].row] = wrong[k].value;
        REQUIRE(pell_profile_from_table(r, R, 10, &p, &fault) == PELL_ERR_INVALID && p.total == 0.0);
        assert_string_equal(fault.field, wrong[k].what);
        if (strcmp(fault.field, "total") == 0)
            REQUIRE((fault.row == wrong[k].row || fault.row == wrong[k].row + 1) && fault.value > 1.0 && fault.max == 1.0);
        else
            REQUIRE(fault.row == wrong[k].row && !(fault.value >= fault.min && fault.value <= fault.max));
        REQUIRE(pell_profile_from_table(r, R, 10, &p, NULL) == PELL_ERR_INVALID);
    }
    REQUIRE(pell_profile_from_table(r, R, 1, &p, &fault) == PELL_ERR_INVALID &&
            pell_profile_from_table(r, R, 0, &p, NULL) == PELL_ERR_INVALID);
    assert_string_equal(fault.field, "rows");
}

/* A table with a total of exactly one is valid, one with a thousandth more is not. */
static void all_light_is_the_limit(void **state)
{
    (void) state;
    r[0] = 0.0, r[1] = 1.0, R[0] = R[1] = 1.0 / PELL_PI;
    accept(2);
    REQUIRE_NEAR(p.total, 1.0, 1e-15);
    R[0] = R[1] = 1.001 / PELL_PI;
    REQUIRE(pell_profile_from_table(r, R, 2, &p, &fault) == PELL_ERR_INVALID && fault.row == 1);
}

/* 1e5 rows of a dipole are reduced to at most 512 nodes with the same light. */
static void long_tables_are_merged(void **state)
{
    const struct pell_dipole d = pell_dipole_make(0.032, 0.74, 1.3, PELL_FRESNEL_EXACT);
    (void) state;
    for (size_t i = 0; i < MANY; i++) {
        r[i] = 1e-3 * (double) i;
        R[i] = pell_dipole_rd(&d, r[i]);
    }
    accept(MANY);
    REQUIRE(p.count <= PELL_PROFILE_NODES && p.count > 400);
    REQUIRE_REL(p.total, pell_dipole_total(&d), 1e-9);
    for (double x = 0.01; x < 50.0; x *= 1.07) {
        REQUIRE_NEAR(pell_profile_cdf(&p, x), pell_dipole_cdf(&d, x), 2e-6);
        REQUIRE_REL(pell_profile_eval(&p, x), pell_dipole_rd(&d, x), 2e-3);
    }
}

/* Noise of 50 % per row, as from a Monte Carlo run: the total and the light inside every tenth node are preserved, within the noise of a
 * node. */
static void noisy_tables_keep_their_light(void **state)
{
    const struct pell_dipole d = pell_dipole_make(0.1, 1.0, 1.3, PELL_FRESNEL_EXACT);
    uint64_t seed = 3;
    double inside = 0.0;
    (void) state;
    for (size_t i = 0; i < MANY; i++) {
        r[i] = 2e-4 * (double) i;
        R[i] = pell_dipole_rd(&d, r[i]) * (0.5 + random01(&seed));
    }
    accept(MANY);
    for (size_t i = 1; i < MANY; i++) {
        const double middle = 0.5 * (r[i] + r[i - 1]), h = r[i] - r[i - 1];
        inside += PELL_PI * middle * h * (R[i] + R[i - 1]);
        if (i % 997 == 0)
            REQUIRE_NEAR(pell_profile_cdf(&p, r[i]) * p.total, inside, 1e-3 * p.total);
    }
    REQUIRE_REL(p.total, inside, 1e-5);
}

/* A table of a Gaussian has the Gaussian's transform. */
static void transforms_of_tables(void **state)
{
    (void) state;
    for (size_t i = 0; i < 400; i++) {
        r[i] = 0.02 * (double) i;
        R[i] = 0.9 * exp(-0.5 * r[i] * r[i]) / (2.0 * PELL_PI);
    }
    accept(400);
    for (double s = 0.0; s < 8.0; s += 0.21)
        REQUIRE_NEAR(pell_profile_transform(&p, s), 0.9 * exp(-0.5 * s * s), 2e-5);
    for (double s = 10.0; s < 1e9; s *= 7.0)
        REQUIRE_NEAR(pell_profile_transform(&p, s), 0.0, 1e-5);
    /* A disc of radius a: pi a^2 R 2 J1(s a)/(s a); at s a = 1, J1 = 0.4400505857449335 (Abramowitz and Stegun, table 9.1). */
    r[0] = 0.0, r[1] = 2.0, R[0] = R[1] = 0.07;
    accept(2);
    REQUIRE_REL(pell_profile_transform(&p, 0.5), PELL_PI * 4.0 * 0.07 * 2.0 * 0.4400505857449335, 1e-12);
}

/* Nodes of a dipole with its far field beyond them: the total and every transform include the light beyond the last node. */
static void tails_behind_nodes(void **state)
{
    static const double absorption[] = { 0.0, 1e-4, 0.05 };
    (void) state;
    for (size_t k = 0; k < PELL_COUNT(absorption); k++) {
        const struct pell_dipole d = pell_dipole_make(absorption[k], 1.0, 1.3, PELL_FRESNEL_EXACT);
        for (int i = 0; i < PELL_PROFILE_NODES; i++) {
            p.r[i] = 1e-4 * pow(10.0, 7.0 * i / (PELL_PROFILE_NODES - 1));
            p.value[i] = pell_dipole_rd(&d, p.r[i]);
        }
        pell_profile_nodes_make(&p, PELL_PROFILE_NODES, PELL_NODES_LOG, d.sigma_tr);
        REQUIRE_NEAR(p.total, pell_dipole_total(&d), 1e-6);
        for (double x = 1e-3; x < 1e5; x *= 1.5) {
            REQUIRE_NEAR(pell_profile_cdf(&p, x), pell_dipole_cdf(&d, x), 1e-6);
            if (pell_dipole_rd(&d, x) > 1e-12)
                REQUIRE_REL(pell_profile_eval(&p, x), pell_dipole_rd(&d, x), x < 20.0 ? 3e-5 : 3e-3);
        }
        for (double s = 1e-7; s < 100.0; s *= 1.9) {
            const double kappa = hypot(d.sigma_tr, s);
            REQUIRE_NEAR(pell_profile_transform(&p, s), 0.5 * d.albedo_reduced * (exp(-kappa * d.zr) + exp(-kappa * d.zv)), 2e-6);
        }
        if (absorption[k] == 0.0)
            REQUIRE_REL(pell_profile_sample(&p, 1.0 - 0x1p-30), 0.5 * (d.zr + d.zv) * 0x1p30, 1e-4);
    }
}

int main(void)
{
    /* clang-format off */
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(falling_tables_fall),    cmocka_unit_test(rings_gaps_and_zeros_are_legal),
        cmocka_unit_test(two_rows_are_enough),    cmocka_unit_test(wild_tables_stay_in_bounds),
        cmocka_unit_test(hardly_any_light_is_none),
        cmocka_unit_test(wrong_rows_are_named),   cmocka_unit_test(all_light_is_the_limit),
        cmocka_unit_test(long_tables_are_merged), cmocka_unit_test(noisy_tables_keep_their_light),
        cmocka_unit_test(transforms_of_tables),   cmocka_unit_test(tails_behind_nodes),
    };
    /* clang-format on */
    return cmocka_run_group_tests_name("optics.profile_table", tests, NULL, NULL);
}
