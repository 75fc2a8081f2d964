/* SPDX-License-Identifier: MIT
 * test_layers.c - stacks by the Hankel solver: against the oracle, and conservation, symmetry and scaling laws. */
#include "stacks.h"

#include "math/vec.h"

static double worst_total, worst_profile;

static void note(double *worst, double a, double b, double scale)
{
    *worst = fmax(*worst, fabs(a - b) / scale);
}

static struct pell_stack generic(const char *name)
{
    struct pell_stack s = { .fresnel = PELL_FRESNEL_POLY4 };
    if (strcmp(name, "two_matched") == 0) {
        put_below(&s, layer_of(0.0041, 2.62, 1.3, 2.0));
        put_below(&s, layer_of(0.013, 1.09, 1.3, 4.0));
    } else if (strcmp(name, "two_n1.4_over_n1.5") == 0) {
        put_below(&s, layer_of(0.21, 4.8, 1.4, 0.4));
        put_below(&s, layer_of(0.016, 3.2, 1.5, 1.5));
    } else if (strcmp(name, "two_over_half_space") == 0) {
        put_below(&s, layer_of(0.0041, 2.62, 1.3, 1.0));
        put_below(&s, layer_of(0.032, 0.74, 1.3, INFINITY));
    } else if (strcmp(name, "three") == 0) {
        put_below(&s, layer_of(0.21, 4.8, 1.4, 0.5));
        put_below(&s, layer_of(0.016, 3.2, 1.4, 1.0));
        put_below(&s, layer_of(0.07, 1.09, 1.4, 3.0));
    } else if (strcmp(name, "three_over_half_space") == 0) {
        put_below(&s, layer_of(0.21, 4.8, 1.4, 0.5));
        put_below(&s, layer_of(0.016, 3.2, 1.3, 1.0));
        put_below(&s, layer_of(0.032, 0.74, 1.3, INFINITY));
    } else {
        fail_msg("a stack that this test does not know: %s", name);
    }
    return s;
}

static void oracle_stacks(void **state)
{
    json_t *root = oracle_load("multipole.json"), *row;
    size_t i;
    (void) state;
    json_array_foreach(oracle_get(root, "generic_stacks"), i, row)
    {
        const struct pell_stack s = generic(json_string_value(oracle_get(row, "name")));
        const bool half_space = isinf(s.layer[s.count - 1].thickness);
        const char *const keys[PELL_STACK_PARTS] = { "R_plus", "T_plus", "R_minus", "T_minus" };
        double total[PELL_STACK_PARTS], at[PELL_STACK_PARTS], r[16], R[16], T[16];
        double *const out[PELL_STACK_PARTS] = { R, T };
        json_t *value;
        size_t k, n = 0;
        REQUIRE(pell_stack_totals(&s, 0, total, NULL) == PELL_OK);
        for (int p = 0; p < PELL_STACK_PARTS; p++) {
            REQUIRE_REL(total[p], oracle_number(row, keys[p]), ROUNDED);
            note(&worst_total, total[p], oracle_number(row, keys[p]), fmax(total[p], 1e-300));
        }
        json_array_foreach(oracle_get(row, "hankel_s"), k, value)
        {
            REQUIRE(pell_stack_transforms(&s, 0, json_number_value(value), at) == PELL_OK);
            REQUIRE_REL(at[RP], oracle_at(row, "hankel_R_plus", k), ROUNDED);
            REQUIRE_REL(at[TP], oracle_at(row, "hankel_T_plus", k), ROUNDED);
        }
        json_array_foreach(oracle_get(row, "r_mm"), k, value) r[n++] = json_number_value(value);
        REQUIRE(n == 9);
        REQUIRE(pell_stack_hankel(&s, 0, r, n, out, NULL) == PELL_OK);
        for (int p = 0; p < (half_space ? 1 : 2); p++)
            for (k = 0; k < n; k++) {
                const char *key = p ? "T" : "R";
                REQUIRE_NEAR(out[p][k], oracle_at(row, key, k), 1e-8 * oracle_at(row, key, 0));
                note(&worst_profile, out[p][k], oracle_at(row, key, k), oracle_at(row, key, 0));
            }
        for (k = 0; half_space && k < n; k++)
            assert_true(T[k] == 0.0);
    }
    assert_int_equal(i, 5);
    json_decref(root);
    print_message("# max difference, stacks: totals %.1e relative, profiles %.1e of f(0)\n", worst_total, worst_profile);
}

static void oracle_skin(void **state)
{
    json_t *root = oracle_load("multipole.json"), *row, *value;
    double worst = 0.0;
    size_t i, k;
    (void) state;
    json_array_foreach(oracle_get(root, "skin"), i, row)
    {
        const int layers = (int) oracle_number(row, "layers"),
                  c = (int) (strchr("RGB", json_string_value(oracle_get(row, "channel"))[0]) - "RGB");
        const struct pell_stack s = skin_of(layers);
        struct pell_stack top;
        double total[PELL_STACK_PARTS], r[64], R[64];
        double *const out[PELL_STACK_PARTS] = { R };
        unsigned flags;
        size_t n = 0;
        REQUIRE(pell_stack_totals(&s, c, total, &flags) == PELL_OK);
        assert_int_equal(flags, layers == 3 ? PELL_STACK_THIN : 0);
        REQUIRE_REL(total[RP], oracle_number(row, "total_R"), ROUNDED);
        REQUIRE(pell_stack_layer(&s, 0, &top) == PELL_OK);
        REQUIRE(pell_stack_totals(&top, c, total, NULL) == PELL_OK);
        REQUIRE_REL(total[RP], oracle_number(row, "R1_total"), ROUNDED);
        REQUIRE_REL(total[TP], oracle_number(row, "T1_total"), ROUNDED);
        json_array_foreach(oracle_get(row, "r_mm"), k, value) r[n++] = json_number_value(value);
        REQUIRE(n == 60);
        REQUIRE(pell_stack_hankel(&s, c, r, n, out, NULL) == PELL_OK);
        for (k = 0; k < n; k++) { /* radii have 6 digits, values 7 */
            const double said = oracle_at(row, "R", k);
            REQUIRE_NEAR(R[k], said, 5e-5 * said + 2e-7 * oracle_at(row, "R", 0));
            worst = fmax(worst, fabs(R[k] - said) / oracle_at(row, "R", 0));
        }
    }
    assert_int_equal(i, 6);
    json_decref(root);
    print_message("# max difference, skin: %.1e of R(0)\n", worst);
}

/* Light inside radii of 0.1, 0.3, 1 and 3 mm. */
static void oracle_gpu_gems(void **state)
{
    static const double radii[4] = { 0.1, 0.3, 1.0, 3.0 };
    json_t *root = oracle_load("multipole.json"), *row;
    size_t i;
    int seen = 0;
    double worst = 0.0;
    (void) state;
    json_array_foreach(oracle_get(root, "gpugems3_vs_hankel"), i, row)
    {
        const int c = (int) (strchr("RGB", json_string_value(oracle_get(row, "channel"))[0]) - "RGB");
        struct pell_stack s = skin_of(3);
        struct pell_profile p;
        const double unit = strcmp(json_string_value(oracle_get(row, "table_unit")), "1/mm") == 0 ? 10.0 : 1.0;
        for (int k = 0; k < 3; k++)
            for (int channel = 0; channel < 3; channel++) {
                s.layer[k].sigma_a[channel] *= unit;
                s.layer[k].sigma_s_reduced[channel] *= unit;
            }
        REQUIRE(pell_stack_profile(&s, c, RP, &p, NULL) == PELL_OK);
        REQUIRE_REL(pell_profile_total(&p), oracle_number(row, "hankel_total"), ROUNDED);
        for (size_t k = 0; k < 4; k++) { /* the oracle's own sums are accurate to 2e-3: they exceed 1 */
            const double said = oracle_at(row, "cumulative_power_r_0p1_0p3_1_3_hankel", k);
            REQUIRE_NEAR(pell_profile_cdf(&p, radii[k]), said, 2.5e-3);
            worst = fmax(worst, fabs(pell_profile_cdf(&p, radii[k]) - said));
        }
        seen++;
    }
    assert_int_equal(seen, 6);
    json_decref(root);
    print_message("# light within radii: %.1e\n", worst);
}

static void oracle_splitting(void **state)
{
    static const struct {
        double sa, ss, d;
    } of[2] = { { 0.0041, 2.62, 10.0 }, { 0.032, 0.74, 8.0 } };
    json_t *root = oracle_load("multipole.json"), *row;
    size_t i;
    (void) state;
    json_array_foreach(oracle_get(oracle_get(root, "splitting_test"), "rows"), i, row)
    {
        REQUIRE(i < 2);
        const struct pell_stack whole = slab_of(of[i].sa, of[i].ss, 1.3, of[i].d);
        struct pell_stack split = slab_of(of[i].sa, of[i].ss, 1.3, 0.5 * of[i].d);
        double a[PELL_STACK_PARTS], b[PELL_STACK_PARTS];
        put_below(&split, split.layer[0]);
        REQUIRE(pell_stack_totals(&whole, 0, a, NULL) == PELL_OK && pell_stack_totals(&split, 0, b, NULL) == PELL_OK);
        REQUIRE_REL(a[RP], oracle_number(row, "whole_R"), ROUNDED);
        REQUIRE_REL(a[TP], oracle_number(row, "whole_T"), ROUNDED);
        REQUIRE_REL(b[RP], oracle_number(row, "split_R"), ROUNDED);
        REQUIRE_REL(b[TP], oracle_number(row, "split_T"), ROUNDED);
    }
    assert_int_equal(i, 2);
    json_decref(root);
}

/* The product of profiles exceeds 1 although the series converges: the condition applies to the transforms. */
static void oracle_condition(void **state)
{
    json_t *root = oracle_load("multipole.json"), *row = oracle_get(root, "condition_R2R1_lt_1");
    struct pell_stack s = slab_of(0.0002, 7.38, 1.3, 1.0), top;
    struct pell_stack bottom = slab_of(0.0002, 7.38, 1.3, INFINITY); /* the oracle's lower side is in air, with three digits */
    double R1[1], R2[1], a[PELL_STACK_PARTS], b[PELL_STACK_PARTS], most = 0.0;
    const double zero = 0.0;
    double *const out1[PELL_STACK_PARTS] = { [PELL_STACK_R_MINUS] = R1 }, *const out2[PELL_STACK_PARTS] = { R2 };
    (void) state;
    put_below(&s, bottom.layer[0]);
    bottom.fresnel = PELL_FRESNEL_POLY3;
    REQUIRE(pell_stack_layer(&s, 2, &top) == PELL_ERR_INVALID);
    REQUIRE(pell_stack_layer(&s, 0, &top) == PELL_OK);
    REQUIRE(pell_stack_hankel(&top, 0, &zero, 1, out1, NULL) == PELL_OK);
    REQUIRE(pell_stack_hankel(&bottom, 0, &zero, 1, out2, NULL) == PELL_OK);
    for (int k = 0; k < 4000; k++) {
        const double at = k ? 1e-2 * exp(0.001 * k) : 0.0;
        REQUIRE(pell_stack_transforms(&top, 0, at, a) == PELL_OK && pell_stack_transforms(&bottom, 0, at, b) == PELL_OK);
        most = fmax(most, a[RM] * b[RP]);
    }
    REQUIRE_REL(most, oracle_number(row, "max_over_s_of_hankel_product"), 2.0 * ROUNDED);
    REQUIRE_REL(R1[0], oracle_number(row, "slab_R_minus_at_0_per_mm2"), 2.0 * ROUNDED);
    REQUIRE_REL(R2[0], oracle_number(row, "cream_R_at_0_per_mm2"), 2.0 * ROUNDED);
    json_decref(root);
}

/* --- Laws ----------------------------------------------------------------------------------------------------------------------- */

static void no_absorption_loses_nothing(void **state)
{
    uint64_t seed = 7;
    (void) state;
    for (int n = 0; n < 500; n++) {
        struct pell_stack s = random_stack(&seed, 3.0);
        double total[PELL_STACK_PARTS];
        for (int i = 0; i < s.count; i++)
            s.layer[i].sigma_a[0] = 0.0;
        if (isinf(s.layer[s.count - 1].thickness))
            s.layer[s.count - 1].thickness = 2.0;
        REQUIRE(pell_stack_totals(&s, 0, total, NULL) == PELL_OK);
        REQUIRE_NEAR(total[RP] + total[TP], 1.0, 1e-12);
        REQUIRE_NEAR(total[RM] + total[TM], 1.0, 1e-12);
    }
}

static void mirrored_swaps_sides(void **state)
{
    uint64_t seed = 11;
    const double r[3] = { 0.0, 0.3, 2.0 };
    (void) state;
    for (int n = 0; n < 100; n++) {
        struct pell_stack s = random_stack(&seed, 2.0);
        double a[PELL_STACK_PARTS], b[PELL_STACK_PARTS], f[4][3], g[4][3];
        double *const out_f[4] = { f[0], f[1], f[2], f[3] }, *const out_g[4] = { g[0], g[1], g[2], g[3] };
        if (isinf(s.layer[s.count - 1].thickness))
            s.layer[s.count - 1].thickness = 2.0;
        const struct pell_stack m = mirrored(&s);
        REQUIRE(pell_stack_totals(&s, 0, a, NULL) == PELL_OK && pell_stack_totals(&m, 0, b, NULL) == PELL_OK);
        for (int p = 0; p < 4; p++)
            REQUIRE_NEAR(a[p], b[p ^ 2], 1e-13);
        unsigned flags;
        REQUIRE(pell_stack_hankel(&s, 0, r, 3, out_f, &flags) == PELL_OK && pell_stack_hankel(&m, 0, r, 3, out_g, NULL) == PELL_OK);
        for (int p = 0; p < 4 && !(flags & PELL_STACK_WIDENED); p++)
            for (int k = 0; k < 3; k++)
                REQUIRE_NEAR(f[p][k], g[p ^ 2][k], 1e-8 * fabs(f[p][0]));
    }
}

/* Any valid stack: finite, within [0, 1], decreasing with frequency, and a profile whose integral is the total. */
static void any_stack(void **state)
{
    static struct pell_profile p;
    uint64_t seed = 3;
    int thin = 0, clear = 0, widened = 0;
    (void) state;
    for (int n = 0; n < 400; n++) {
        const struct pell_stack s = random_stack(&seed, n % 4 == 0 ? 10.0 : 3.0);
        double total[PELL_STACK_PARTS], at[PELL_STACK_PARTS], r[32], f[4][32];
        double *const out[4] = { f[0], f[1], f[2], f[3] };
        unsigned flags;
        REQUIRE(pell_stack_totals(&s, 0, total, &flags) == PELL_OK);
        thin += (flags & PELL_STACK_THIN) != 0;
        clear += (flags & PELL_STACK_CLEAR) != 0;
        widened += (flags & PELL_STACK_WIDENED) != 0;
        REQUIRE(total[RP] + total[TP] <= 1.0 + 1e-10 && total[RM] + total[TM] <= 1.0 + 1e-10);
        for (double w = 1e-3; w < 1e2; w *= 10.0) {
            REQUIRE(pell_stack_transforms(&s, 0, w, at) == PELL_OK);
            for (int part = 0; part < 4; part++)
                REQUIRE(isfinite(at[part]));
        }
        for (int k = 0; k < 32; k++)
            r[k] = k ? 1e-6 * exp(k) : 0.0;
        REQUIRE(pell_stack_hankel(&s, 0, r, 32, out, NULL) == PELL_OK);
        for (int part = 0; part < 4; part++) {
            REQUIRE(total[part] >= 0.0);
            for (int k = 0; k < 32; k++)
                REQUIRE(isfinite(f[part][k]) && f[part][k] > -0.05 * f[part][0] - 1e-300);
            REQUIRE(pell_stack_profile(&s, 0, (enum pell_stack_part) part, &p, NULL) == PELL_OK);
            REQUIRE_NEAR(p.total, p.count ? total[part] : 0.0, 1e-12);
            REQUIRE(isfinite(pell_profile_eval(&p, 0.1)) && pell_profile_eval(&p, 0.1) >= 0.0);
        }
    }
    print_message("# of 400 stacks %d thin, %d clear, %d widened\n", thin, clear, widened);
    REQUIRE(thin > 50 && clear > 20 && widened > 20);
}

/* The same material in other units: lengths times u, coefficients divided by u. */
static void units_cancel(void **state)
{
    const double unit[3] = { 0.1, 10.0, 1e-3 };
    (void) state;
    for (int k = 0; k < 3; k++) {
        const struct pell_stack s = skin_of(3);
        struct pell_stack scaled = s;
        double r[8], scaled_r[8], R[8], Q[8];
        double *const out_R[4] = { R }, *const out_Q[4] = { Q };
        for (int i = 0; i < 3; i++) {
            scaled.layer[i].sigma_a[0] /= unit[k];
            scaled.layer[i].sigma_s_reduced[0] /= unit[k];
            scaled.layer[i].thickness *= unit[k];
        }
        for (int i = 0; i < 8; i++) {
            r[i] = 0.03 * exp(0.6 * i);
            scaled_r[i] = r[i] * unit[k];
        }
        REQUIRE(pell_stack_hankel(&s, 0, r, 8, out_R, NULL) == PELL_OK);
        REQUIRE(pell_stack_hankel(&scaled, 0, scaled_r, 8, out_Q, NULL) == PELL_OK);
        for (int i = 0; i < 8; i++)
            REQUIRE_NEAR(Q[i] * unit[k] * unit[k], R[i], 1e-12 * R[0]);
    }
}

/* The profile's nodes and the solver agree. */
static void profile_is_the_transform(void **state)
{
    static struct pell_profile p;
    struct pell_stack s = skin_of(3);
    (void) state;
    s.layer[2].thickness = 2.0;
    for (int c = 0; c < 3; c++)
        for (int part = 0; part < 4; part++) {
            double r[64], f[64];
            double *out[4] = { 0 };
            out[part] = f;
            for (int k = 0; k < 64; k++)
                r[k] = k ? 0.01 * exp(0.11 * k) : 0.0;
            REQUIRE(pell_stack_hankel(&s, c, r, 64, out, NULL) == PELL_OK);
            REQUIRE(pell_stack_profile(&s, c, (enum pell_stack_part) part, &p, NULL) == PELL_OK);
            for (int k = 0; k < 64; k++)
                REQUIRE_NEAR(pell_profile_eval(&p, r[k]), f[k], 2e-5 * f[0]);
            for (double w = 0.0; w < 5.0; w += 1.0) {
                double at[4];
                REQUIRE(pell_stack_transforms(&s, c, w, at) == PELL_OK);
                REQUIRE_NEAR(pell_profile_transform(&p, w), at[part], 2e-5);
            }
        }
}

/* Fits of slabs reach the errors that are known to be possible (d'Eon et al. 2007: "most single slab profiles extremely well"). */
static void oracle_slab_fits(void **state)
{
    static struct pell_profile p;
    json_t *root = oracle_load("errata_demos.json"), *row;
    size_t i;
    (void) state;
    json_array_foreach(oracle_get(root, "seed003_multipole_4_gaussians"), i, row)
    {
        const bool marble = strcmp(json_string_value(oracle_get(row, "material")), "marble G") == 0;
        const struct pell_stack s = slab_of(marble ? 0.0041 : 0.032, marble ? 2.62 : 0.74, 1.3, oracle_number(row, "d"));
        const bool through = strcmp(json_string_value(oracle_get(row, "profile")), "T") == 0;
        struct pell_gaussians g;
        struct pell_fit_report report;
        REQUIRE(pell_stack_profile(&s, 0, through ? TP : RP, &p, NULL) == PELL_OK);
        REQUIRE(pell_fit_profile(&p, &(struct pell_fit_params) { .count = 4 }, &g, &report) == PELL_OK);
        REQUIRE_NEAR(100.0 * report.error[0], oracle_number(row, "k4_constrained_percent"), 2e-3);
        REQUIRE(pell_fit_profile(&p, &(struct pell_fit_params) { .count = 4, .free_energy = true }, &g, &report) == PELL_OK);
        REQUIRE_NEAR(100.0 * report.error[0], oracle_number(row, "k4_free_percent"), 2e-3);
        REQUIRE(pell_fit_profile(&p, &(struct pell_fit_params) { .count = 2 }, &g, &report) == PELL_OK);
        REQUIRE_NEAR(100.0 * report.error[0], oracle_number(row, "k2_constrained_percent"), 2e-2);
    }
    assert_int_equal(i, 4);
    json_decref(root);
}

static void refused(void **state)
{
    struct pell_stack s = skin_of(2);
    struct pell_profile p;
    double r[2] = { 0.0, 1.0 }, R[2];
    double *const out[PELL_STACK_PARTS] = { R };
    (void) state;
    for (int k = 0; k < 3; k++) {
        r[1] = (const double[]) { NAN, -1.0, INFINITY }[k];
        R[0] = R[1] = 5.0;
        REQUIRE(pell_stack_hankel(&s, 0, r, 2, out, NULL) == PELL_ERR_INVALID && R[0] == 0.0 && R[1] == 0.0);
    }
    REQUIRE(pell_stack_profile(&s, 3, RP, &p, NULL) == PELL_ERR_INVALID && p.total == 0.0);
    REQUIRE(pell_stack_profile(&s, 0, PELL_STACK_PARTS, &p, NULL) == PELL_ERR_INVALID);
    REQUIRE(pell_stack_profile(&s, 0, TP, &p, NULL) == PELL_OK && p.total == 0.0); /* a half-space transmits nothing */
    s.layer[0].thickness = 0.0;
    REQUIRE(pell_stack_profile(&s, 0, RP, &p, NULL) == PELL_ERR_INVALID);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(oracle_stacks),        cmocka_unit_test(oracle_skin),
        cmocka_unit_test(oracle_gpu_gems),      cmocka_unit_test(oracle_splitting),
        cmocka_unit_test(oracle_condition),     cmocka_unit_test(no_absorption_loses_nothing),
        cmocka_unit_test(mirrored_swaps_sides), cmocka_unit_test(any_stack),
        cmocka_unit_test(units_cancel),         cmocka_unit_test(profile_is_the_transform),
        cmocka_unit_test(oracle_slab_fits),     cmocka_unit_test(refused),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
