/* SPDX-License-Identifier: MIT
 * test_layers_gaussians.c - stacks by the algebra of Gaussians, against the Hankel solver, the oracle and conservation laws. */
#include "stacks.h"

#include "math/vec.h"

static struct pell_stack_sets sets, other;
static _Alignas(16) unsigned char memory[1 << 20];

static void solve(const struct pell_stack *s, int c, const struct pell_stack_gaussians_params *params, struct pell_stack_sets *out)
{
    REQUIRE(pell_stack_workspace_size(params) <= sizeof(memory));
    REQUIRE(pell_stack_gaussians(s, c, params, memory, sizeof(memory), out) == PELL_OK);
}

/* Error (10) of a set against the Hankel solver, by a trapezoidal sum in log r. */
static double error_of(const struct pell_stack *s, int c, const struct pell_stack_sets *set, enum pell_stack_part part)
{
    enum { N = 240 };
    double r[N], f[N], above = 0.0, below = 0.0;
    double *out[PELL_STACK_PARTS] = { 0 };

    out[part] = f;
    for (int k = 0; k < N; k++)
        r[k] = 2e-3 * exp(0.045 * k);
    REQUIRE(pell_stack_hankel(s, c, r, N, out, NULL) == PELL_OK);
    for (int k = 0; k < N; k++) {
        const double g = pell_gaussian_set_eval(set->variance, set->weight[part], (size_t) set->count, r[k]);
        above += r[k] * r[k] * (g - f[k]) * (g - f[k]);
        below += r[k] * r[k] * f[k] * f[k];
    }
    return sqrt(above / below);
}

static double total_of(const struct pell_stack_sets *set, int part)
{
    return pell_gaussian_set_total(set->weight[part], (size_t) set->count);
}

/* --- The oracle ------------------------------------------------------------------------------------------------------------------- */

static bool named(json_t *row, const char *key, const char *text)
{
    return strcmp(json_string_value(oracle_get(row, key)), text) == 0;
}

static struct pell_stack case_of(const char *name, int *channel)
{
    struct pell_stack s;
    *channel = 0;
    if (strncmp(name, "skin2_", 6) == 0) {
        *channel = (int) (strchr("RGB", name[6]) - "RGB");
        return skin_of(2);
    }
    if (strcmp(name, "two_slabs_thick") == 0) {
        s = slab_of(0.0041, 2.62, 1.3, 2.0);
        put_below(&s, layer_of(0.013, 1.09, 1.3, 4.0));
        return s;
    }
    REQUIRE(strcmp(name, "two_slabs_thin_top") == 0);
    s = skin_of(2); /* the epidermis on 1 mm of the upper dermis */
    s.layer[1].thickness = 1.0;
    return s;
}

/* Totals; and with default settings an error below all errors of the oracle with the same mixture. */
static void oracle_polynomial(void **state)
{
    json_t *root = oracle_load("polynomial.json"), *row;
    double worst_total = 0.0, worst_error = 0.0;
    size_t i;
    int seen = 0;
    (void) state;
    json_array_foreach(oracle_get(root, "runs"), i, row)
    {
        const char *name = json_string_value(oracle_get(row, "case"));
        int c;
        const struct pell_stack s = case_of(name, &c);
        double total[PELL_STACK_PARTS];
        const bool slabs = json_object_get(row, "T12_total_hankel") != NULL;
        REQUIRE(pell_stack_totals(&s, c, total, NULL) == PELL_OK);
        REQUIRE_REL(total[RP], oracle_number(row, "R12_total_hankel"), ROUNDED);
        if (slabs)
            REQUIRE_REL(total[TP], oracle_number(row, "T12_total_hankel"), ROUNDED);
        if (!named(row, "method", "mixture"))
            continue;
        solve(&s, c, NULL, &sets);
        worst_total = fmax(worst_total, fabs(total_of(&sets, RP) - total[RP]));
        worst_error = fmax(worst_error, error_of(&s, c, &sets, RP));
        REQUIRE(error_of(&s, c, &sets, RP) < 1e-4 && 100.0 * error_of(&s, c, &sets, RP) < oracle_number(row, "R12_err_percent"));
        REQUIRE(!slabs || error_of(&s, c, &sets, TP) < 1e-3);
        seen++;
    }
    assert_int_equal(i, 60);
    assert_int_equal(seen, 20);
    json_decref(root);
    print_message("# by default: totals %.1e from Hankel, error (10) of R %.1e\n", worst_total, worst_error);
}

/* --- Solvers against each other ----------------------------------------------------------------------------------------------------- */

/* One slab: only the mixture and its quadrature. */
static void slab_is_its_mixture(void **state)
{
    const double of[4][3] = { { 0.0041, 2.62, 5.0 }, { 0.1, 1.0, 1.5 }, { 1.0, 1.0, 3.0 }, { 0.0, 2.0, 2.0 } };
    (void) state;
    for (int k = 0; k < 4; k++) {
        const struct pell_stack s = slab_of(of[k][0], of[k][1], 1.3, of[k][2]);
        solve(&s, 0, NULL, &sets);
        for (int part = 0; part < PELL_STACK_PARTS; part++)
            REQUIRE_NEAR(error_of(&s, 0, &sets, (enum pell_stack_part) part), 0.0, 2e-5);
        assert_true(sets.clipped < 1e-6);
    }
}

/* The error falls as block^-2: variances between two powers are distributed over both. */
static void error_over_block(void **state)
{
    const struct pell_stack s = skin_of(2);
    double before = 0.0;
    (void) state;
    for (int block = 8; block <= 64; block *= 2) {
        const struct pell_stack_gaussians_params params = { .block = block };
        solve(&s, 0, &params, &sets);
        const double error = error_of(&s, 0, &sets, RP);
        if (block > 8)
            REQUIRE(error < before / 3.0);
        before = error;
    }
    REQUIRE(before < 2e-5);
}

/* ... and with the narrow Gaussian's variance, until the quadrature error dominates. */
static void error_over_variance(void **state)
{
    const struct pell_stack s = skin_of(2);
    double before = 1.0;
    (void) state;
    for (double v = 0.04; v > 1e-4; v *= 0.25) {
        const struct pell_stack_gaussians_params params = { .block = 64, .variance = v };
        solve(&s, 1, &params, &sets);
        const double error = error_of(&s, 1, &sets, RP);
        REQUIRE(error < before * 0.5 || error < 3e-5);
        before = error;
    }
}

/* Three layers of skin in RGB and in reverse order: all components by all solvers. The upper dermis is thinner than its mean free path. */
static void skin_by_all_solvers(void **state)
{
    (void) state;
    for (int finite = 0; finite < 2; finite++) {
        struct pell_stack s = skin_of(3);
        const struct pell_stack_gaussians_params analytic = { .analytic = true };
        double total[PELL_STACK_PARTS], mixture = 0.0, closed = 0.0;
        if (finite)
            s.layer[2].thickness = 5.0;
        for (int c = 0; c < 3; c++) {
            REQUIRE(pell_stack_totals(&s, c, total, NULL) == PELL_OK);
            solve(&s, c, NULL, &sets);
            solve(&s, c, &analytic, &other);
            assert_int_equal(sets.flags & PELL_STACK_THIN, PELL_STACK_THIN);
            for (int part = 0; part < (finite ? PELL_STACK_PARTS : 1); part++) {
                REQUIRE_NEAR(total_of(&sets, part), total[part], 2e-6);
                REQUIRE_NEAR(total_of(&other, part), total[part], 2e-6);
            }
            mixture = fmax(mixture, error_of(&s, c, &sets, RP));
            closed = fmax(closed, error_of(&s, c, &other, RP));
        }
        print_message("# skin, R+: Gaussians %.2e, analytic %.2e from Hankel\n", mixture, closed);
        REQUIRE(mixture < 2e-3 && closed < 1e-2);
    }
}

/* A set as a profile equals the set, including signed weights; where these sum to less than 0, far out, scaling takes up to 1 %
 * elsewhere. */
static void profiles_of_signed_sets(void **state)
{
    static struct pell_profile p;
    const struct pell_stack s = skin_of(3);
    (void) state;
    for (int analytic = 0; analytic < 2; analytic++)
        for (int c = 0; c < 3; c++) {
            const struct pell_stack_gaussians_params params = { .analytic = analytic };
            bool negative = false;
            solve(&s, c, &params, &sets);
            REQUIRE(pell_stack_sets_profile(&sets, RP, &p) == PELL_OK);
            REQUIRE_REL(pell_profile_total(&p), total_of(&sets, RP), 1e-12);
            for (int i = 0; i < sets.count; i++)
                negative |= sets.weight[RP][i] < 0.0;
            REQUIRE(negative == (analytic != 0));
            for (double r = 1e-3; r < 10.0; r *= 1.3) {
                const double set = pell_gaussian_set_eval(sets.variance, sets.weight[RP], (size_t) sets.count, r);
                REQUIRE_NEAR(pell_profile_eval(&p, r), fmax(set, 0.0),
                             (analytic ? 1e-2 : 1e-4) * fabs(set) + 1e-6 * pell_profile_eval(&p, 0.0));
            }
        }
}

/* Figure 12 of d'Eon et al. 2007: the spectral skin at 500 nm; epidermis, dermis and both, by three solvers. */
static void figure_12(void **state)
{
    const struct pell_skin skin = pell_skin_default();
    struct pell_skin_coefficients upper, lower;
    struct pell_stack both = { .count = 2 }, alone;
    (void) state;
    REQUIRE(pell_skin_at(&skin, 500.0, &upper, &lower) == PELL_OK);
    both.layer[0] = layer_of(upper.sigma_a, upper.sigma_s_reduced, skin.eta, 0.25);
    both.layer[1] = layer_of(lower.sigma_a, lower.sigma_s_reduced, skin.eta, INFINITY);
    for (int k = 0; k < 3; k++) {
        const struct pell_stack_gaussians_params analytic = { .analytic = true };
        if (k < 2)
            REQUIRE(pell_stack_layer(&both, k, &alone) == PELL_OK);
        const struct pell_stack *s = k < 2 ? &alone : &both;
        solve(s, 0, NULL, &sets);
        solve(s, 0, &analytic, &other);
        print_message("# figure 12, %s: Gaussians %.2e, analytic %.2e from Hankel\n",
                      k == 0   ? "R1"
                      : k == 1 ? "R2"
                               : "R12",
                      error_of(s, 0, &sets, RP), error_of(s, 0, &other, RP));
        REQUIRE(error_of(s, 0, &sets, RP) < 5e-3);
        REQUIRE(error_of(s, 0, &other, RP) < 3e-2);
    }
}

/* --- Laws --------------------------------------------------------------------------------------------------------------------------- */

/* Any valid stack: weights finite and >= 0, their sum equals the closed total minus at most the series' tolerance; no energy is gained. */
static void any_stack(void **state)
{
    uint64_t seed = 5;
    (void) state;
    for (int n = 0; n < 120; n++) {
        const struct pell_stack s = random_stack(&seed, n % 4 == 0 ? 10.0 : 2.0);
        const struct pell_stack_gaussians_params params = { .analytic = n % 3 == 0, .block = 16 };
        double total[PELL_STACK_PARTS];
        unsigned flags;
        REQUIRE(pell_stack_totals(&s, 0, total, &flags) == PELL_OK);
        solve(&s, 0, &params, &sets);
        for (int part = 0; part < PELL_STACK_PARTS; part++) {
            for (int i = 0; i < sets.count; i++) {
                REQUIRE(isfinite(sets.weight[part][i]) && (params.analytic || sets.weight[part][i] >= 0.0));
                REQUIRE(sets.variance[i] > (i ? sets.variance[i - 1] : 0.0));
            }
            REQUIRE_NEAR(total_of(&sets, part), total[part], 2e-5);
        }
    }
}

static void mirrored_swaps_sides(void **state)
{
    struct pell_stack s = skin_of(3);
    (void) state;
    s.layer[2].thickness = 3.0;
    s.eta_below = 1.2;
    const struct pell_stack m = mirrored(&s);
    solve(&s, 1, NULL, &sets);
    solve(&m, 1, NULL, &other);
    assert_int_equal(sets.count, other.count);
    for (int part = 0; part < PELL_STACK_PARTS; part++)
        for (double r = 0.0; r < 4.0; r += 0.4) {
            const double a = pell_gaussian_set_eval(sets.variance, sets.weight[part], (size_t) sets.count, r);
            const double b = pell_gaussian_set_eval(other.variance, other.weight[part ^ 2], (size_t) other.count, r);
            REQUIRE_NEAR(a, b, 3e-4 * pell_gaussian_set_eval(sets.variance, sets.weight[part], (size_t) sets.count, 0.0));
        }
}

/* The series loses no more than its tolerance. */
static void energy_loss_is_kept(void **state)
{
    struct pell_stack s = slab_of(0.0, 5.0, 1.5, 4.0);
    int before = 0;
    (void) state;
    put_below(&s, layer_of(0.0, 3.0, 1.5, 6.0));
    for (double loss = 1e-1; loss > 1e-11; loss *= 1e-2) {
        const struct pell_stack_gaussians_params params = { .energy_loss = loss, .block = 16 };
        double total[PELL_STACK_PARTS];
        REQUIRE(pell_stack_totals(&s, 0, total, NULL) == PELL_OK);
        solve(&s, 0, &params, &sets);
        for (int part = 0; part < PELL_STACK_PARTS; part++) {
            REQUIRE(total_of(&sets, part) <= total[part] + 1e-12);
            REQUIRE(total_of(&sets, part) >= total[part] - 1.01 * loss - 1e-12);
        }
        REQUIRE(sets.terms >= before);
        before = sets.terms;
    }
    REQUIRE(before > 4);
}

/* R+ alone equals the R+ of the full solution. */
static void reflectance_alone(void **state)
{
    struct pell_stack s = skin_of(3);
    const struct pell_stack_gaussians_params only = { .reflectance_only = true };
    (void) state;
    s.layer[2].thickness = 1.0;
    solve(&s, 2, NULL, &sets);
    solve(&s, 2, &only, &other);
    assert_int_equal(sets.count, other.count);
    REQUIRE(pell_gaussian_set_error(sets.variance, sets.weight[RP], (size_t) sets.count, other.variance, other.weight[RP],
                                    (size_t) other.count) < 1e-5);
    assert_true(total_of(&other, TP) == 0.0 && total_of(&other, RM) == 0.0 && total_of(&other, TM) == 0.0);
}

static void reduced(void **state)
{
    static struct pell_stack_sets channel[3];
    static struct pell_profile p;
    const struct pell_stack_sets *const all[3] = { &channel[0], &channel[1], &channel[2] };
    const struct pell_stack s = skin_of(3);
    double before[3] = { 1.0, 1.0, 1.0 };
    (void) state;
    for (int c = 0; c < 3; c++)
        solve(&s, c, NULL, &channel[c]);
    for (int count = 2; count <= PELL_GAUSSIANS_MAX; count += 4) {
        struct pell_gaussians g;
        REQUIRE(pell_stack_reduce(all, RP, count, &g) == PELL_OK);
        assert_int_equal(g.count, count);
        for (int c = 0; c < 3; c++) {
            for (int i = 0; i < count; i++)
                REQUIRE(g.weight[i][c] >= 0.0 && g.variance[i] > (i ? g.variance[i - 1] : 0.0));
            REQUIRE_REL(pell_gaussians_total(&g, c), total_of(all[c], RP), 1e-12);
            double moment = 0.0;
            for (int i = 0; i < count; i++)
                moment += 2.0 * g.weight[i][c] * g.variance[i];
            REQUIRE_REL(moment, pell_gaussian_set_moment(all[c]->variance, all[c]->weight[RP], (size_t) all[c]->count), 1e-12);
            REQUIRE(pell_stack_sets_profile(all[c], RP, &p) == PELL_OK);
            REQUIRE_REL(pell_profile_total(&p), total_of(all[c], RP), 1e-12);
            for (double r = 0.0; r < 3.0; r += 0.3)
                REQUIRE_NEAR(pell_profile_eval(&p, r),
                             pell_gaussian_set_eval(all[c]->variance, all[c]->weight[RP], (size_t) all[c]->count, r),
                             1e-4 * pell_profile_eval(&p, 0.0));
            const double error = pell_gaussians_error(&g, c, &p, 0.0);
            REQUIRE(error < before[c]);
            before[c] = error;
        }
    }
    print_message("# three-layer skin reduced to 10 Gaussians: error (10) %.2g %.2g %.2g %%\n", 100 * before[0], 100 * before[1],
                  100 * before[2]);
    REQUIRE(before[0] < 0.004 && before[1] < 0.004 && before[2] < 0.004);
}

static void refused(void **state)
{
    const struct pell_stack good = skin_of(2);
    const struct pell_stack_gaussians_params bad[] = {
        { .block = 7 },           { .block = 9 },           { .block = PELL_STACK_BLOCK_MAX + 2 },
        { .block = -2 },          { .variance = -1.0 },     { .variance = NAN },
        { .variance = INFINITY }, { .energy_loss = -1.0 },  { .energy_loss = NAN },
        { .energy_loss = 0.2 },   { .energy_loss = 1e-20 },
    };
    struct pell_gaussians g;
    const struct pell_stack_sets *const three[3] = { &sets, &sets, &sets };
    struct pell_stack s = good;
    struct pell_profile p;
    (void) state;
    for (size_t i = 0; i < PELL_COUNT(bad); i++)
        REQUIRE(pell_stack_gaussians(&good, 0, &bad[i], memory, sizeof(memory), &sets) == PELL_ERR_INVALID);
    REQUIRE(pell_stack_gaussians(&good, 0, NULL, memory, pell_stack_workspace_size(NULL) - 1, &sets) == PELL_ERR_INVALID);
    REQUIRE(pell_stack_gaussians(&good, 0, NULL, NULL, sizeof(memory), &sets) == PELL_ERR_INVALID);
    REQUIRE(pell_stack_gaussians(&good, 3, NULL, memory, sizeof(memory), &sets) == PELL_ERR_INVALID);
    s.layer[0].sigma_a[1] = NAN;
    REQUIRE(pell_stack_gaussians(&s, 1, NULL, memory, sizeof(memory), &sets) == PELL_ERR_INVALID);
    solve(&good, 0, NULL, &sets);
    REQUIRE(pell_stack_reduce(three, RP, 1, &g) == PELL_ERR_INVALID && g.count == 0);
    REQUIRE(pell_stack_reduce(three, RP, PELL_GAUSSIANS_MAX + 1, &g) == PELL_ERR_INVALID);
    REQUIRE(pell_stack_reduce(three, PELL_STACK_PARTS, 4, &g) == PELL_ERR_INVALID);
    REQUIRE(pell_stack_reduce(three, TP, 4, &g) == PELL_OK && g.count == 0);
    REQUIRE(pell_stack_sets_profile(&sets, PELL_STACK_PARTS, &p) == PELL_ERR_INVALID);
    REQUIRE(pell_stack_sets_profile(&sets, TP, &p) == PELL_OK && p.total == 0.0);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(oracle_polynomial),
        cmocka_unit_test(slab_is_its_mixture),
        cmocka_unit_test(error_over_block),
        cmocka_unit_test(error_over_variance),
        cmocka_unit_test(skin_by_all_solvers),
        cmocka_unit_test(profiles_of_signed_sets),
        cmocka_unit_test(figure_12),
        cmocka_unit_test(any_stack),
        cmocka_unit_test(mirrored_swaps_sides),
        cmocka_unit_test(energy_loss_is_kept),
        cmocka_unit_test(reflectance_alone),
        cmocka_unit_test(reduced),
        cmocka_unit_test(refused),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
