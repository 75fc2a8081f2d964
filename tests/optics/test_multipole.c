/* SPDX-License-Identifier: MIT
 *
 * test_multipole.c - one slab: closed forms, sums of poles, and their inverse transforms. */
#include "stacks.h"

#include "math/quadrature.h"
#include "math/vec.h"

/* The largest differences measured, for the table in src/optics/README.md. */
static double worst_total, worst_poles, worst_hankel;

static void note(double *worst, double a, double b, double scale)
{
    *worst = fmax(*worst, fabs(a - b) / scale);
}

static struct pell_stack oracle_slab(json_t *row)
{
    const double eta = oracle_number(row, "eta_top"), below = eta / oracle_number(row, "eta_bot");
    struct pell_stack s = slab_of(oracle_number(row, "sigma_a"), oracle_number(row, "sigma_sp"), eta, oracle_number(row, "d"));
    const char *const keys[2] = { "A_top", "A_bot" };
    for (int side = 0; side < 2; side++) { /* rows have 10 digits of A, too few far out */
        const double fdr = pell_fresnel_diffuse(side ? eta / below : eta, PELL_FRESNEL_POLY4);
        REQUIRE_REL((1.0 + fdr) / (1.0 - fdr), oracle_number(row, keys[side]), ROUNDED);
    }
    s.eta_below = below;
    return s;
}

struct finite {
    const struct pell_stack *stack;
    enum pell_stack_part part;
    int dipoles;
};

static double ring(double log_r, const void *arg)
{
    const struct finite *f = arg;
    const double r = exp(log_r);
    double value;
    REQUIRE(pell_slab_poles(f->stack, 0, f->part, r, 1e-14, f->dipoles, &value, NULL) == PELL_OK);
    return 2.0 * PELL_PI * r * r * value;
}

static void oracle_slabs(void **state)
{
    json_t *root = oracle_load("multipole.json"), *row;
    size_t i;
    (void) state;
    json_array_foreach(oracle_get(root, "single_slabs"), i, row)
    {
        const struct pell_stack s = oracle_slab(row);
        const bool lossless = s.layer[0].sigma_a[0] == 0.0;
        double total[PELL_STACK_PARTS], r[16], R[16], T[16];
        double *const out[PELL_STACK_PARTS] = { R, T };
        json_t *radius, *by_count;
        const char *count;
        unsigned flags;
        size_t k, n = 0;
        REQUIRE(pell_stack_totals(&s, 0, total, &flags) == PELL_OK);
        assert_int_equal(flags, 0);
        const char *const keys[PELL_STACK_PARTS] = { "total_R", "total_T", "total_R_minus", "total_T_minus" };
        for (int p = 0; p < PELL_STACK_PARTS; p++) {
            REQUIRE_REL(total[p], oracle_number(row, keys[p]), lossless ? 1e-7 : ROUNDED); /* the oracle's R + T is 1 + 6e-8 there */
            note(&worst_total, total[p], oracle_number(row, keys[p]), total[p]);
        }
        /* Radii have 10 digits, too: far out a profile falls by five times the relative change of its radius. */
        json_array_foreach(oracle_get(row, "r_mm"), k, radius) r[n++] = json_number_value(radius);
        REQUIRE(n > 3 && n < 16);
        REQUIRE(pell_stack_hankel(&s, 0, r, n, out, NULL) == PELL_OK);
        for (k = 0; k < n; k++) {
            double poles;
            const char *const names[2][2] = { { "R_poles", "R_inverse_hankel" }, { "T_poles", "T_inverse_hankel" } };
            for (int p = 0; p < 2; p++) {
                const double said = oracle_at(row, names[p][0], k), transformed = oracle_at(row, names[p][1], k);
                const double first = oracle_at(row, names[p][0], 0);
                REQUIRE(pell_slab_poles(&s, 0, p == 0 ? RP : TP, r[k], 1e-12, 100001, &poles, NULL) == PELL_OK);
                REQUIRE_NEAR(poles, transformed, 5.0 * ROUNDED * transformed + (lossless ? 1e-10 : 1e-14) * first); /* all the poles */
                REQUIRE_REL(poles, said, lossless ? 2e-6 : 5.0 * ROUNDED);                                          /* 801 of them */
                REQUIRE_NEAR(out[p][k], transformed, 1e-9 * first + 5.0 * ROUNDED * transformed);
                note(&worst_poles, poles, transformed, transformed);
                note(&worst_hankel, out[p][k], transformed, first);
            }
        }
        json_object_foreach(oracle_get(row, "total_by_number_of_dipoles_n"), count, by_count)
        {
            if (lossless || atoi(count) > 5)
                continue; /* without absorption the tail of a finite sum falls as 1/r: a quadrature over r does not converge */
            for (int p = 0; p < 2; p++) {
                const struct finite f = { &s, p == 0 ? RP : TP, 2 * atoi(count) + 1 };
                const double said = json_number_value(json_array_get(by_count, (size_t) p));
                REQUIRE_REL(pell_integrate(ring, &f, log(1e-6), log(1e3), 0.0, 1e-10, NULL), said, 1e-8);
            }
        }
    }
    assert_int_equal(i, 7);
    json_decref(root);
    print_message("# max relative difference: totals %.1e, poles %.1e; Hankel over f(0) %.1e\n", worst_total, worst_poles, worst_hankel);
}

static void oracle_outside_validity(void **state)
{
    json_t *root = oracle_load("multipole.json"), *row = oracle_get(root, "multipole_outside_validity_l_gt_d");
    struct pell_stack s = slab_of(oracle_number(row, "sigma_a"), oracle_number(row, "sigma_sp"), 1.4, oracle_number(row, "d"));
    double total[PELL_STACK_PARTS], value;
    unsigned flags;
    (void) state;
    s.eta_above = s.eta_below = 1.4;
    REQUIRE(pell_stack_totals(&s, 0, total, &flags) == PELL_OK);
    assert_int_equal(flags & PELL_STACK_THIN, PELL_STACK_THIN);
    REQUIRE_REL(total[TP], oracle_number(row, "closed_form_T"), ROUNDED);
    REQUIRE_REL(total[RP], oracle_number(row, "R"), ROUNDED);
    REQUIRE(pell_slab_poles(&s, 0, TP, 0.1, 1e-10, 1001, &value, NULL) == PELL_ERR_UNSUPPORTED);
    /* A thickness of exactly a mean free path: the pole on the far side is infinite at r = 0. */
    s = slab_of(0.5, 0.5, 1.4, 1.0);
    for (int p = 0; p < PELL_STACK_PARTS; p++)
        REQUIRE(pell_slab_poles(&s, 0, (enum pell_stack_part) p, 0.0, 1e-9, 201, &value, NULL) == PELL_ERR_UNSUPPORTED);
    json_decref(root);
}

static void oracle_rough(void **state)
{
    json_t *root = oracle_load("multipole.json"), *row;
    size_t i;
    (void) state;
    json_array_foreach(oracle_get(root, "rough_variant"), i, row)
    {
        struct pell_stack s = slab_of(0.0041, 2.62, 1.3, 5.0);
        double total[PELL_STACK_PARTS];
        s.A[0][0] = s.A[0][1] = oracle_number(row, "A");
        REQUIRE(pell_stack_totals(&s, 0, total, NULL) == PELL_OK);
        REQUIRE_REL(total[RP], oracle_number(row, "total_R"), ROUNDED);
        REQUIRE_REL(total[TP], oracle_number(row, "total_T"), ROUNDED);
    }
    assert_int_equal(i, 4);
    json_decref(root);
}

/* A boundary's A follows from the indices of its own side, its model and its roughness. */
static void boundaries(void **state)
{
    const double eta[3] = { 1.0, 1.4, 1.1 };
    (void) state;
    for (int model = 0; model < 3; model++)
        for (int rough = 0; rough < 2; rough++) {
            struct pell_stack s = slab_of(0.02, 1.5, eta[1], 3.0), given;
            double a[PELL_STACK_PARTS], b[PELL_STACK_PARTS];
            s.fresnel = (enum pell_fresnel_model) model;
            s.eta_below = eta[2];
            s.roughness[0] = s.roughness[1] = rough ? 0.6 : 0.0;
            given = slab_of(0.02, 1.5, eta[1], 3.0);
            for (int side = 0; side < 2; side++) {
                const double ratio = side ? eta[1] / eta[2] : eta[1] / eta[0];
                const double fdr = rough ? pell_fresnel_diffuse_rough(ratio, 0.6) : pell_fresnel_diffuse(ratio, s.fresnel);
                given.A[0][side] = (1.0 + fdr) / (1.0 - fdr);
            }
            REQUIRE(pell_stack_totals(&s, 0, a, NULL) == PELL_OK && pell_stack_totals(&given, 0, b, NULL) == PELL_OK);
            for (int p = 0; p < PELL_STACK_PARTS; p++)
                REQUIRE_REL(a[p], b[p], 1e-14);
        }
}

static void no_absorption_loses_nothing(void **state)
{
    (void) state;
    for (double d = 1e-4; d < 1e5; d *= 10.0)
        for (double eta = 1.0; eta < 2.0; eta += 0.25) {
            const struct pell_stack s = slab_of(0.0, 1.0, eta, d);
            double total[PELL_STACK_PARTS];
            REQUIRE(pell_stack_totals(&s, 0, total, NULL) == PELL_OK);
            REQUIRE_NEAR(total[RP] + total[TP], 1.0, 1e-14);
            REQUIRE_NEAR(total[RM] + total[TM], 1.0, 1e-14);
        }
}

/* d -> inf is the dipole, as a half-space is. */
static void thick_is_the_dipole(void **state)
{
    const double r[5] = { 0.0, 0.1, 0.7, 3.0, 11.0 };
    (void) state;
    for (int k = 0; k < 3; k++) {
        const double sa = (const double[]) { 0.03, 0.5, 0.0 }[k], ss = 1.7;
        const struct pell_dipole d = pell_dipole_make(sa, ss, 1.3, PELL_FRESNEL_POLY4);
        struct pell_stack half = slab_of(sa, ss, 1.3, INFINITY), thick = slab_of(sa, ss, 1.3, k == 2 ? 1e6 : 1e3);
        double total[PELL_STACK_PARTS], value, R[5];
        double *const out[PELL_STACK_PARTS] = { R };
        int dipoles;
        REQUIRE(pell_stack_totals(&half, 0, total, NULL) == PELL_OK);
        REQUIRE_REL(total[RP], pell_dipole_total(&d), 1e-14);
        assert_true(total[TP] == 0.0 && total[RM] == 0.0 && total[TM] == 0.0);
        REQUIRE(pell_stack_totals(&thick, 0, total, NULL) == PELL_OK);
        REQUIRE_REL(total[RP], pell_dipole_total(&d), k == 2 ? 1e-5 : 1e-14);
        REQUIRE(pell_stack_hankel(&half, 0, r, 5, out, NULL) == PELL_OK);
        for (int i = 0; i < 5; i++) {
            REQUIRE(pell_slab_poles(&half, 0, RP, r[i], 1e-12, 1, &value, &dipoles) == PELL_OK && dipoles == 1);
            REQUIRE_REL(value, pell_dipole_rd(&d, r[i]), 1e-13);
            REQUIRE(pell_slab_poles(&thick, 0, RP, r[i], 1e-12, 1001, &value, NULL) == PELL_OK);
            REQUIRE_NEAR(value, pell_dipole_rd(&d, r[i]), 1e-12 * pell_dipole_rd(&d, 0.0));
            REQUIRE_NEAR(R[i], pell_dipole_rd(&d, r[i]), 1e-9 * pell_dipole_rd(&d, 0.0));
        }
    }
}

/* 16 configurations in which the tolerance is met, against a sum with a hundredth of the tolerance. */
static void poles_keep_their_tolerance(void **state)
{
    const struct pell_stack slabs[2] = { slab_of(0.0, 1.0, 1.3, 4.0), slab_of(0.01, 3.0, 1.5, 1.0) };
    (void) state;
    for (int k = 0; k < 2; k++)
        for (double tolerance = 1e-3; tolerance > 1e-7; tolerance *= 0.1)
            for (int p = 0; p < 2; p++) {
                double rough, fine;
                int few, many;
                REQUIRE(pell_slab_poles(&slabs[k], 0, p ? TP : RP, 2.0, tolerance, 100001, &rough, &few) == PELL_OK);
                REQUIRE(pell_slab_poles(&slabs[k], 0, p ? TP : RP, 2.0, tolerance * 0.01, 100001, &fine, &many) == PELL_OK);
                REQUIRE(few <= many);
                REQUIRE_REL(rough, fine, tolerance);
            }
}

/* From the sum of poles to thin to clear: continuous, within [0, 1], and a slab of zero thickness transmits everything. */
static void thin_slabs(void **state)
{
    (void) state;
    for (double albedo = 0.0; albedo <= 1.0; albedo += 0.125) {
        double before[PELL_STACK_PARTS] = { 0 };
        for (double d = 4.0; d > 1e-5; d *= 0.999) {
            struct pell_stack s = slab_of(1.0 - albedo, albedo, 1.4, d);
            double total[PELL_STACK_PARTS];
            unsigned flags;
            s.eta_below = 1.4;
            REQUIRE(pell_stack_totals(&s, 0, total, &flags) == PELL_OK);
            assert_int_equal(flags & PELL_STACK_THIN, d < 1.0 ? PELL_STACK_THIN : 0);
            for (int p = 0; p < PELL_STACK_PARTS; p++) {
                REQUIRE(total[p] >= 0.0 && total[p] <= 1.0 + 1e-12);
                if (d < 3.99)
                    REQUIRE_NEAR(total[p], before[p], 0.005);
                before[p] = total[p];
            }
            REQUIRE(total[RP] + total[TP] <= 1.0 + 1e-12 && total[RM] + total[TM] <= 1.0 + 1e-12);
        }
        REQUIRE_NEAR(before[TP], 1.0, 1e-4);
        REQUIRE_NEAR(before[RP], 0.0, 1e-4);
    }
}

/* Refused input, by name. */
static void faults(void **state)
{
    const double bad[5] = { NAN, -1.0, INFINITY, 1e300, -INFINITY };
    struct pell_stack good = skin_of(3), s;
    struct pell_stack_fault fault;
    double total[PELL_STACK_PARTS], value;
    (void) state;
    good.layer[2].thickness = 1.0;
    REQUIRE(pell_stack_valid(&good, &fault) && fault.field == NULL && fault.layer == -1);
#define REFUSED(assignment, name, at_layer, at_channel)                                                                                    \
    do {                                                                                                                                   \
        s = good;                                                                                                                          \
        assignment;                                                                                                                        \
        REQUIRE(!pell_stack_valid(&s, &fault));                                                                                            \
        assert_string_equal(fault.field, name);                                                                                            \
        assert_int_equal(fault.layer, at_layer);                                                                                           \
        assert_int_equal(fault.channel, at_channel);                                                                                       \
        REQUIRE(!(fault.value >= fault.min && fault.value <= fault.max));                                                                  \
        REQUIRE(pell_stack_totals(&s, 0, total, NULL) == PELL_ERR_INVALID && total[RP] == 0.0);                                            \
    } while (0)
    for (int i = 0; i < 5; i++) {
        REFUSED(s.layer[1].sigma_a[2] = bad[i], "sigma_a", 1, 2);
        REFUSED(s.layer[0].sigma_s_reduced[1] = bad[i], "sigma_s_reduced", 0, 1);
        REFUSED(s.layer[2].g[0] = i == 1 ? -0.99995 : bad[i], "g", 2, 0);
        REFUSED(s.layer[1].eta = bad[i], "eta", 1, -1);
        REFUSED(s.layer[0].thickness = bad[i], "thickness", 0, -1);
        REFUSED(s.roughness[3] = bad[i], "roughness", 3, -1);
        REFUSED(s.A[2][1] = i == 1 ? 0.99 : bad[i], "A[1]", 2, -1);
        REFUSED(s.A[0][0] = i == 1 ? 0.99 : bad[i], "A[0]", 0, -1);
        REFUSED(s.eta_above = bad[i], "eta_above", -1, -1);
        REFUSED(s.eta_below = bad[i], "eta_below", -1, -1);
    }
    REFUSED(s.layer[0].thickness = 0.0, "thickness", 0, -1);
    REFUSED(s.layer[0].sigma_a[0] = s.layer[0].sigma_s_reduced[0] = 0.0, "sigma_a + sigma_s_reduced", 0, 0);
    REFUSED(s.layer[1].eta = 4.1, "eta", 1, -1);
    REFUSED(s.layer[1].eta = 0.24, "eta", 1, -1);
    REFUSED((s.layer[1].eta = 0.3, s.layer[0].eta = 3.0, s.eta_above = 2.0), "eta / eta below it", 0, -1);
    REFUSED(s.count = 0, "count", -1, -1);
    REFUSED(s.count = PELL_LAYERS_MAX + 1, "count", -1, -1);
    REFUSED(s.fresnel = (enum pell_fresnel_model) 3, "fresnel", -1, -1);
    for (double eta = 0.25; eta <= 4.0; eta *= 2.0) { /* the bounds themselves */
        s = slab_of(0.1, 1.0, eta, 1.0);
        REQUIRE(pell_stack_totals(&s, 0, total, NULL) == PELL_OK);
    }
    s = slab_of(0.1, 1.0, 1.3, 1.0);
    REQUIRE(pell_stack_totals(&s, 3, total, NULL) == PELL_ERR_INVALID && pell_stack_totals(&s, -1, total, NULL) == PELL_ERR_INVALID);
    REQUIRE(pell_slab_poles(&s, 0, RP, NAN, 1e-6, 11, &value, NULL) == PELL_ERR_INVALID && value == 0.0);
    REQUIRE(pell_slab_poles(&s, 0, RP, 1.0, 0.0, 11, &value, NULL) == PELL_ERR_INVALID);
    REQUIRE(pell_slab_poles(&s, 0, RP, 1.0, 1e-6, 0, &value, NULL) == PELL_ERR_INVALID);
    REQUIRE(pell_slab_poles(&s, 0, PELL_STACK_PARTS, 1.0, 1e-6, 11, &value, NULL) == PELL_ERR_INVALID);
    REQUIRE(pell_stack_transforms(&s, 0, -1.0, total) == PELL_ERR_INVALID && pell_stack_transforms(&s, 0, NAN, total) == PELL_ERR_INVALID);
    put_below(&s, s.layer[0]);
    REQUIRE(pell_slab_poles(&s, 0, RP, 1.0, 1e-6, 11, &value, NULL) == PELL_ERR_INVALID);
}

/* alpha' = 0 and 1 are no special cases. */
static void bounds_of_albedo(void **state)
{
    double total[PELL_STACK_PARTS], r[3] = { 0.0, 0.5, 4.0 }, R[3], T[3];
    double *const out[PELL_STACK_PARTS] = { R, T };
    struct pell_stack s = slab_of(2.0, 0.0, 1.3, 3.0);
    (void) state;
    REQUIRE(pell_stack_totals(&s, 0, total, NULL) == PELL_OK && total[RP] == 0.0 && total[TP] == 0.0);
    REQUIRE(pell_stack_hankel(&s, 0, r, 3, out, NULL) == PELL_OK && R[0] == 0.0 && T[2] == 0.0);
    s = slab_of(0.0, 2.0, 1.3, 3.0);
    const struct pell_stack nearly = slab_of(1e-12, 2.0, 1.3, 3.0);
    double limit[PELL_STACK_PARTS];
    REQUIRE(pell_stack_totals(&s, 0, total, NULL) == PELL_OK && pell_stack_totals(&nearly, 0, limit, NULL) == PELL_OK);
    REQUIRE_NEAR(total[RP], limit[RP], 1e-10);
    REQUIRE_NEAR(total[TP], limit[TP], 1e-10);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(oracle_slabs),
        cmocka_unit_test(oracle_outside_validity),
        cmocka_unit_test(oracle_rough),
        cmocka_unit_test(boundaries),
        cmocka_unit_test(no_absorption_loses_nothing),
        cmocka_unit_test(thick_is_the_dipole),
        cmocka_unit_test(poles_keep_their_tolerance),
        cmocka_unit_test(thin_slabs),
        cmocka_unit_test(faults),
        cmocka_unit_test(bounds_of_albedo),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
