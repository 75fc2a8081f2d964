/* SPDX-License-Identifier: MIT
 * test_fit.c - sums of Gaussians fitted to dipoles: against the oracle's optima, energy conservation, symmetries, hostile input. */
#include "oracle.h"

#include "math/quadrature.h"
#include "math/vec.h"
#include "optics/fit/fit.h"

struct pair {
    const struct pell_dipole *dipole;
    const struct pell_gaussians *gaussians;
    int channel;
};

static double square_of_profile(double log_r, const void *arg)
{
    const struct pair *p = arg;
    const double r = exp(log_r), v = pell_dipole_rd(p->dipole, r);
    return r * r * v * v;
}

static double square_of_difference(double log_r, const void *arg)
{
    const struct pair *p = arg;
    const double r = exp(log_r), v = pell_dipole_rd(p->dipole, r) - pell_gaussians_eval(p->gaussians, p->channel, r);
    return r * r * v * v;
}

/* Error (10) by a quadrature that is independent of the fit. */
static double error_10(const struct pell_dipole *d, const struct pell_gaussians *g, int channel)
{
    const struct pair p = { d, g, channel };
    const double a = log(1e-5 * d->zr), b = log(1e5 * d->zr);
    const double norm = pell_integrate(square_of_profile, &p, a, b, 0.0, 1e-12, NULL);
    return sqrt(pell_integrate(square_of_difference, &p, a, b, 1e-20 * norm, 1e-7, NULL) / norm);
}

static void requires_fit(const struct pell_dipole *d, int count, bool free_energy, struct pell_gaussians *g, struct pell_fit_report *report)
{
    const struct pell_fit_params params = { .count = count, .free_energy = free_energy };
    assert_int_equal(pell_fit_dipole(d, &params, g, report), PELL_OK);
    assert_int_equal(g->count, count);
    for (int i = 0; i < count; i++) {
        REQUIRE(isfinite(g->variance[i]) && g->variance[i] > (i ? g->variance[i - 1] : 0.0));
        REQUIRE(isfinite(g->weight[i][0]) && g->weight[i][0] > 0.0);
        REQUIRE(g->weight[i][1] == 0.0 && g->weight[i][2] == 0.0);
    }
}

static struct pell_dipole dipole_of_row(json_t *row, double eta, enum pell_fresnel_model model)
{
    return pell_dipole_make(oracle_number(row, "sigma_a"), oracle_number(row, "sigma_sp"), eta, model);
}

/* 36 channels x 8 counts x with and without the energy constraint: within 1e-4 of the best known optimum, above or below, where the task
 * asks for 1e-3. */
static void every_optimum_of_the_oracle_is_reached(void **state)
{
    json_t *root = oracle_load("gaussians_fits.json"), *row;
    double worst = 0.0, seconds[9] = { 0 };
    size_t i;
    (void) state;
    json_array_foreach(oracle_get(root, "rows"), i, row)
    {
        const struct pell_dipole d = dipole_of_row(row, oracle_number(row, "eta"), PELL_FRESNEL_POLY3);
        for (int k = 1; k <= 8; k++)
            for (int free = 0; free < 2; free++) {
                struct pell_gaussians g;
                struct pell_fit_report report;
                char key[8];
                snprintf(key, sizeof(key), "%d", k);
                json_t *known = oracle_get(oracle_get(row, free ? "free" : "constrained"), key), *v = json_object_get(known, "v_mm2");
                const double start = pell_seconds(), best = 0.01 * oracle_number(known, "err_percent");
                requires_fit(&d, k, free, &g, &report);
                seconds[k] += pell_seconds() - start;
                REQUIRE_REL(report.error[0], best, 1e-4);
                worst = fmax(worst, fabs(report.error[0] / best - 1.0));
                if (!free)
                    REQUIRE_REL(pell_gaussians_total(&g, 0), pell_dipole_total(&d), 1e-14);
                else if (v)
                    REQUIRE_REL(pell_gaussians_total(&g, 0), oracle_number(known, "sum_w"), 1e-5);
                for (int j = 0; v && j < k; j++) {
                    REQUIRE_REL(g.variance[j], oracle_at(known, "v_mm2", (size_t) j), 1e-3);
                    REQUIRE_REL(g.weight[j][0], oracle_at(known, "w", (size_t) j), 1e-3);
                }
            }
    }
    assert_int_equal(i, 36);
    print_message("# worst difference from the oracle's optimum: %.1e\n", worst);
    for (int k = 1; k <= 8; k++)
        print_message("# one channel, k = %d: %.2f ms\n", k, seconds[k] / 72.0 * 1e3);
    json_decref(root);
}

static void errors_over_albedo(void **state)
{
    json_t *root = oracle_load("gaussians_claims.json"), *row;
    size_t i;
    (void) state;
    json_array_foreach(oracle_get(root, "error_versus_albedo_eta1.3"), i, row)
    {
        const double alpha = oracle_number(row, "alpha");
        const struct pell_dipole d = pell_dipole_make(1.0 - alpha, alpha, 1.3, PELL_FRESNEL_POLY3);
        for (int k = 2; k <= 8; k += 2)
            for (int free = 0; free < 2; free++) {
                struct pell_gaussians g;
                struct pell_fit_report report;
                char key[8];
                snprintf(key, sizeof(key), "%d", k);
                requires_fit(&d, k, free, &g, &report);
                REQUIRE_REL(report.error[0], 0.01 * oracle_number(oracle_get(row, free ? "free" : "constrained"), key), 1e-3);
            }
    }
    assert_int_equal(i, 19);
    json_decref(root);
}

static void errors_over_eta(void **state)
{
    static const struct {
        const char *key;
        double sigma_a, sigma_s;
        int count;
    } cases[] = {
        { "spectralon_B_k4", 0.0, 14.9, 4 }, { "chicken2_B_k4", 0.2, 0.32, 4 },  { "marble_G_k4", 0.0041, 2.62, 4 },
        { "marble_G_k8", 0.0041, 2.62, 8 },  { "marble_R_k4", 0.0021, 2.19, 4 }, { "marble_B_k8", 0.0071, 3.0, 8 },
    };
    json_t *root = oracle_load("gaussians_claims.json"), *row;
    size_t i;
    (void) state;
    json_array_foreach(oracle_get(root, "hypotheses"), i, row) for (size_t c = 0; c < PELL_COUNT(cases); c++)
    {
        const double eta = oracle_number(row, "eta");
        const bool free = !json_is_true(oracle_get(row, "constraint"));
        const struct pell_dipole d = pell_dipole_make(cases[c].sigma_a, cases[c].sigma_s, eta, PELL_FRESNEL_POLY3);
        struct pell_gaussians g;
        struct pell_fit_report report;
        requires_fit(&d, cases[c].count, free, &g, &report);
        REQUIRE_REL(report.error[0], 0.01 * oracle_number(row, cases[c].key), 1e-3);
    }
    REQUIRE(i > 0);
    json_decref(root);
}

static const double albedos[] = { 0.02, 0.3, 0.8, 0.99, 0.9999, 1.0 };

static void reported_error_is_error_10(void **state)
{
    (void) state;
    for (size_t i = 0; i < PELL_COUNT(albedos); i++)
        for (int k = 1; k <= 6; k++) {
            const struct pell_dipole d = pell_dipole_make(1.0 - albedos[i], albedos[i], 1.4, PELL_FRESNEL_EXACT);
            struct pell_gaussians g;
            struct pell_fit_report report;
            requires_fit(&d, k, k % 2, &g, &report);
            REQUIRE_REL(report.error[0], error_10(&d, &g, 0), 1e-4);
        }
}

static void each_gaussian_more_lowers_the_error(void **state)
{
    (void) state;
    for (size_t i = 0; i < PELL_COUNT(albedos); i++)
        for (int free = 0; free < 2; free++) {
            const struct pell_dipole d = pell_dipole_make(1.0 - albedos[i], albedos[i], 1.3, PELL_FRESNEL_EXACT);
            double last = 1.0;
            for (int k = 1; k <= PELL_GAUSSIANS_MAX; k++) {
                struct pell_gaussians g;
                struct pell_fit_report report;
                requires_fit(&d, k, free, &g, &report);
                REQUIRE(report.error[0] < (k == 1 ? 0.65 : 0.55) * last); /* spectralon converges slowest */
                last = report.error[0];
            }
        }
}

/* --- Three channels ------------------------------------------------------------------------------------------------------------ */

static struct pell_medium skin1(void)
{
    return (struct pell_medium) { { 0.032, 0.17, 0.48 }, { 0.74, 0.88, 1.01 }, { 0, 0, 0 }, 1.3 };
}

static void requires_medium_fit(const struct pell_medium *m, int count, struct pell_gaussians *g, struct pell_fit_report *report)
{
    const struct pell_fit_params params = { .count = count };
    assert_int_equal(pell_fit_medium(m, &params, g, report), PELL_OK);
    for (int i = 0; i < g->count; i++) {
        REQUIRE(isfinite(g->variance[i]) && g->variance[i] > (i ? g->variance[i - 1] : 0.0));
        for (int c = 0; c < 3; c++)
            REQUIRE(isfinite(g->weight[i][c]) && g->weight[i][c] >= 0.0);
    }
    for (int c = 0; c < 3; c++) {
        const struct pell_dipole d = pell_dipole_make(m->sigma_a[c], m->sigma_s_reduced[c], m->eta, PELL_FRESNEL_EXACT);
        REQUIRE_REL(pell_gaussians_total(g, c), pell_dipole_total(&d), 1e-13);
        REQUIRE(isfinite(report->error[c]) && report->error[c] >= 0.0);
    }
}

static void all_materials_share_variances_with_a_falling_error(void **state)
{
    double seconds = 0.0, worst = 0.0;
    int fits = 0;
    (void) state;
    for (size_t i = 0; i < pell_material_count(); i++) {
        const struct pell_material_entry *e = pell_material_at(i);
        double last = 3.0;
        if (strcmp(e->family, "Jensen et al. 2001") != 0)
            continue;
        for (int k = 1; k <= PELL_GAUSSIANS_MAX; k++) {
            struct pell_gaussians g;
            struct pell_fit_report report;
            double cost = 0.0;
            const double start = pell_seconds();
            requires_medium_fit(&e->medium, k, &g, &report);
            if (k == 4) {
                seconds += pell_seconds() - start;
                worst = fmax(worst, pell_seconds() - start);
                fits++;
            }
            for (int c = 0; c < 3; c++) {
                const struct pell_dipole d =
                    pell_dipole_make(e->medium.sigma_a[c], e->medium.sigma_s_reduced[c], e->medium.eta, PELL_FRESNEL_EXACT);
                struct pell_gaussians own_g;
                struct pell_fit_report own;
                cost += report.error[c] * report.error[c];
                if (k <= 6)
                    REQUIRE_REL(report.error[c], error_10(&d, &g, c), 1e-4);
                if (k == 4) { /* shared variances increase the error, never reduce it */
                    requires_fit(&d, k, false, &own_g, &own);
                    REQUIRE(report.error[c] >= own.error[0] * (1.0 - 1e-6));
                    REQUIRE(report.error[c] < 0.05);
                }
            }
            REQUIRE(cost < (k == 1 ? 0.65 : 0.45) * last);
            last = cost;
        }
    }
    assert_int_equal(fits, 12);
    print_message("# three channels, k = 4: %.2f ms on average, %.2f ms at most\n", seconds / fits * 1e3, worst * 1e3);
}

static void equal_channels_give_the_single_fit(void **state)
{
    struct pell_medium m = { { 0.01, 0.01, 0.01 }, { 1.0, 1.0, 1.0 }, { 0, 0, 0 }, 1.3 };
    const struct pell_dipole d = pell_dipole_make(0.01, 1.0, 1.3, PELL_FRESNEL_EXACT);
    (void) state;
    for (int k = 1; k <= 8; k++) {
        struct pell_gaussians one, three;
        struct pell_fit_report report;
        requires_fit(&d, k, false, &one, &report);
        requires_medium_fit(&m, k, &three, &report);
        for (int i = 0; i < k; i++) {
            REQUIRE_REL(three.variance[i], one.variance[i], 1e-5);
            for (int c = 0; c < 3; c++)
                REQUIRE_REL(three.weight[i][c], one.weight[i][0], 1e-5);
        }
    }
}

static void swapping_channels_swaps_weights_bit_by_bit(void **state)
{
    static const int orders[5][3] = { { 0, 2, 1 }, { 1, 0, 2 }, { 1, 2, 0 }, { 2, 0, 1 }, { 2, 1, 0 } };
    const struct pell_medium m = skin1();
    struct pell_gaussians g, h;
    struct pell_fit_report report, other;
    (void) state;
    requires_medium_fit(&m, 5, &g, &report);
    for (int o = 0; o < 5; o++) {
        struct pell_medium n = m;
        for (int c = 0; c < 3; c++) {
            n.sigma_a[c] = m.sigma_a[orders[o][c]];
            n.sigma_s_reduced[c] = m.sigma_s_reduced[orders[o][c]];
        }
        requires_medium_fit(&n, 5, &h, &other);
        assert_memory_equal(h.variance, g.variance, sizeof(g.variance));
        for (int c = 0; c < 3; c++) {
            REQUIRE(other.error[c] == report.error[orders[o][c]]);
            for (int i = 0; i < 5; i++)
                REQUIRE(h.weight[i][c] == g.weight[i][orders[o][c]]);
        }
    }
}

static void units_cancel(void **state)
{
    static const double scales[] = { 1e-3, 0.1, 25.4, 1e4 };
    const struct pell_medium m = skin1();
    struct pell_gaussians g, h;
    struct pell_fit_report report, other;
    (void) state;
    requires_medium_fit(&m, 4, &g, &report);
    for (size_t s = 0; s < PELL_COUNT(scales); s++) {
        struct pell_medium n = m;
        for (int c = 0; c < 3; c++) {
            n.sigma_a[c] *= scales[s];
            n.sigma_s_reduced[c] *= scales[s];
        }
        requires_medium_fit(&n, 4, &h, &other);
        for (int i = 0; i < 4; i++) {
            REQUIRE_REL(h.variance[i] * scales[s] * scales[s], g.variance[i], 1e-12);
            for (int c = 0; c < 3; c++)
                REQUIRE_NEAR(h.weight[i][c], g.weight[i][c], 1e-12);
        }
    }
}

static void the_scale_of_the_albedo_does_not_matter_to_the_error(void **state)
{
    const struct pell_dipole d = pell_dipole_make(0.4, 0.6, 1.3, PELL_FRESNEL_EXACT);
    struct pell_dipole dim = d;
    struct pell_gaussians g, h;
    struct pell_fit_report report, other;
    (void) state;
    dim.albedo_reduced = d.albedo_reduced * 1e-290; /* its square would not be a finite double */
    requires_fit(&d, 4, false, &g, &report);
    requires_fit(&dim, 4, false, &h, &other);
    REQUIRE(other.error[0] == report.error[0]);
    for (int i = 0; i < 4; i++)
        REQUIRE_REL(h.weight[i][0], g.weight[i][0] * 1e-290, 1e-14);
}

static void channels_a_hundred_times_apart(void **state)
{
    const struct pell_medium m = { { 0.0, 0.02, 4.0 }, { 0.5, 6.0, 50.0 }, { 0, 0, 0 }, 1.4 };
    double last = 1.0;
    (void) state;
    for (int k = 1; k <= PELL_GAUSSIANS_MAX; k++) {
        struct pell_gaussians g;
        struct pell_fit_report report;
        double worst = 0.0;
        const double start = pell_seconds();
        requires_medium_fit(&m, k, &g, &report);
        print_message("# mean free paths 2, 0.17, 0.019 mm, k = %d: %.2f %% %.2f %% %.2f %% in %.1f ms\n", k, 100.0 * report.error[0],
                      100.0 * report.error[1], 100.0 * report.error[2], (pell_seconds() - start) * 1e3);
        for (int c = 0; c < 3; c++)
            worst = fmax(worst, report.error[c]);
        if (k > 3)
            REQUIRE(worst < last);
        last = worst;
    }
    REQUIRE(last < 0.03);
}

static void black_channels_get_nothing(void **state)
{
    struct pell_medium m = skin1();
    struct pell_gaussians g;
    struct pell_fit_report report;
    (void) state;
    m.sigma_s_reduced[1] = 0.0;
    const struct pell_fit_params params = { .count = 4 };
    assert_int_equal(pell_fit_medium(&m, &params, &g, &report), PELL_OK);
    assert_int_equal(g.count, 4);
    REQUIRE(pell_gaussians_total(&g, 1) == 0.0 && report.error[1] == 0.0);
    REQUIRE(pell_gaussians_total(&g, 0) > 0.0 && pell_gaussians_total(&g, 2) > 0.0);
    m.sigma_s_reduced[0] = m.sigma_s_reduced[2] = 0.0;
    assert_int_equal(pell_fit_medium(&m, &params, &g, &report), PELL_OK);
    assert_int_equal(g.count, 0);
}

/* White media, for which the unconstrained fit would return more light than enters. */
static void a_free_fit_makes_no_light(void **state)
{
    const struct pell_medium white = { { 0.0, 1e-5, 1e-3 }, { 1.0, 2.0, 3.0 }, { 0.0, 0.0, 0.0 }, 1.3 };
    int limited = 0;
    (void) state;
    for (int model = 0; model < PELL_PROFILE_MODELS; model++) {
        struct pell_profile R[3];
        for (int c = 0; c < 3; c++)
            assert_int_equal(pell_profile_make((enum pell_profile_model) model, &white, c, NULL, &R[c]), PELL_OK);
        for (int k = 1; k <= PELL_GAUSSIANS_MAX; k++) {
            const struct pell_fit_params params = { .count = k, .free_energy = true };
            struct pell_gaussians own, shared;
            struct pell_fit_report report;
            assert_int_equal(pell_fit_profiles(R, &params, &shared, &report), PELL_OK);
            for (int c = 0; c < 3; c++) {
                REQUIRE(pell_gaussians_total(&shared, c) <= 1.0 + 1e-12);
                limited += pell_gaussians_total(&shared, c) > 1.0 - 1e-9;
            }
            for (int c = 0; c < 3; c++) {
                assert_int_equal(pell_fit_profile(&R[c], &params, &own, &report), PELL_OK);
                REQUIRE(pell_gaussians_total(&own, 0) <= 1.0 + 1e-12);
                REQUIRE_REL(pell_gaussians_error(&own, 0, &R[c], 0.0), report.error[0], 1e-2); /* of the exiting light */
                limited += pell_gaussians_total(&own, 0) > 1.0 - 1e-9;
            }
        }
    }
    REQUIRE(limited > 0); /* or no search was run */
}

static void extremes_of_every_coefficient_stay_finite(void **state)
{
    static const double values[] = { 0.0, 1e-300, 1e-6, 1.0, 1e6 };
    const size_t n = PELL_COUNT(values);
    uint32_t pick = 1;
    int fits = 0;
    (void) state;
    for (int round = 0; round < 120; round++) {
        struct pell_medium m = { { 0 }, { 0 }, { 0 }, round % 3 == 0 ? 1.0 : round % 3 == 1 ? 1.4 : 4.0 };
        struct pell_gaussians g;
        struct pell_fit_report report;
        const struct pell_fit_params params = { .count = 1 + round % PELL_GAUSSIANS_MAX, .free_energy = round % 2 };
        for (int c = 0; c < 3; c++) {
            pick = pick * 1664525u + 1013904223u;
            m.sigma_a[c] = values[(pick >> 8) % n];
            pick = pick * 1664525u + 1013904223u;
            m.sigma_s_reduced[c] = values[(pick >> 8) % n];
        }
        if (!pell_medium_valid(&m, NULL)) {
            assert_int_equal(pell_fit_medium(&m, &params, &g, &report), PELL_ERR_INVALID);
            continue;
        }
        assert_int_equal(pell_fit_medium(&m, &params, &g, &report), PELL_OK);
        fits++;
        for (int c = 0; c < 3; c++) {
            const struct pell_dipole d = pell_dipole_make(m.sigma_a[c], m.sigma_s_reduced[c], m.eta, PELL_FRESNEL_EXACT);
            REQUIRE(report.error[c] >= 0.0 && report.error[c] <= 1.01 + 1e3 * !params.free_energy);
            for (int i = 0; i < g.count; i++)
                REQUIRE(isfinite(g.variance[i]) && g.variance[i] > 0.0 && isfinite(g.weight[i][c]) && g.weight[i][c] >= 0.0);
            if (!params.free_energy && g.count > 0)
                REQUIRE_NEAR(pell_gaussians_total(&g, c), pell_dipole_total(&d),
                             1e-12 * pell_dipole_total(&d) + PELL_PROFILE_TOTAL_MIN); /* less light than that counts as none */
        }
    }
    REQUIRE(fits > 40);
}

static void what_can_not_be_fitted_is_refused(void **state)
{
    const struct pell_dipole good = pell_dipole_make(0.1, 1.0, 1.3, PELL_FRESNEL_EXACT);
    const struct pell_fit_params four = { .count = 4 };
    struct pell_gaussians g;
    struct pell_fit_report report;
    (void) state;
    for (int count = -1; count <= 12; count++) {
        const struct pell_fit_params p = { .count = count };
        const struct pell_medium m = skin1();
        const enum pell_result wanted = count >= 1 && count <= PELL_GAUSSIANS_MAX ? PELL_OK : PELL_ERR_INVALID;
        assert_int_equal(pell_fit_dipole(&good, &p, &g, NULL), wanted);
        assert_int_equal(pell_fit_medium(&m, &p, &g, NULL), wanted);
    }
    static const double bad[] = { NAN, INFINITY, -1.0, -INFINITY };
    for (size_t i = 0; i < PELL_COUNT(bad); i++) {
        struct pell_dipole d = good;
        d.albedo_reduced = bad[i];
        assert_int_equal(pell_fit_dipole(&d, &four, &g, &report), PELL_ERR_INVALID);
        d = good;
        d.zr = bad[i];
        assert_int_equal(pell_fit_dipole(&d, &four, &g, &report), PELL_ERR_INVALID);
        d = good;
        d.zv = bad[i];
        assert_int_equal(pell_fit_dipole(&d, &four, &g, &report), PELL_ERR_INVALID);
        d = good;
        d.sigma_tr = bad[i];
        assert_int_equal(pell_fit_dipole(&d, &four, &g, &report), PELL_ERR_INVALID);
        struct pell_medium m = skin1();
        m.sigma_a[1] = bad[i];
        assert_int_equal(pell_fit_medium(&m, &four, &g, &report), PELL_ERR_INVALID);
        assert_int_equal(g.count, 0);
    }
}

static void a_sum_of_gaussians_has_its_total_and_value(void **state)
{
    const struct pell_gaussians g = { 2, { 0.5, 3.0 }, { { 0.2, 0.0, 1.0 }, { 0.3, 0.1, 0.0 } } };
    (void) state;
    REQUIRE_NEAR(pell_gaussians_total(&g, 0), 0.5, 1e-16);
    for (double r = 0.0; r < 5.0; r += 0.5)
        REQUIRE_NEAR(pell_gaussians_eval(&g, 0, r), 0.2 * exp(-r * r) / PELL_PI + 0.3 * exp(-r * r / 6.0) / (6.0 * PELL_PI), 1e-16);
    REQUIRE_NEAR(pell_gaussians_eval(&g, 2, 0.0), 1.0 / PELL_PI, 1e-16);
}

/* --- Finite ranges and any profile --------------------------------------------------------------------------------------------- */

/* Fits whose integrals end at r_max, with their errors up to there and over all radii; the paper's marble numbers are among them. */
static void fits_over_a_range_are_the_oracles(void **state)
{
    json_t *root = oracle_load("gaussians_ranges.json"), *row;
    size_t i;
    (void) state;
    json_array_foreach(oracle_get(root, "rows"), i, row)
    {
        const char *material = json_string_value(oracle_get(row, "material"));
        const int c = strcmp(material, "marble") == 0 ? 1 : 2;
        const struct pell_medium *m = &pell_material_find(material)->medium;
        const struct pell_dipole d = pell_dipole_make(m->sigma_a[c], m->sigma_s_reduced[c], oracle_number(row, "eta"), PELL_FRESNEL_POLY3);
        for (int k = 4; k <= 8; k += 4) {
            if (k == 8 && !json_object_get(row, "k8_own"))
                continue;
            const struct pell_fit_params params = { .count = k,
                                                    .r_max_mm = oracle_number(row, "r_max_mm"),
                                                    .free_energy = strcmp(json_string_value(oracle_get(row, "mode")), "free") == 0 };
            struct pell_gaussians g;
            struct pell_fit_report report;
            assert_int_equal(pell_fit_dipole(&d, &params, &g, &report), PELL_OK);
            REQUIRE_REL(report.error[0], 0.01 * oracle_number(row, k == 4 ? "k4_own" : "k8_own"), 1e-3);
            REQUIRE_REL(error_10(&d, &g, 0), 0.01 * oracle_number(row, k == 4 ? "k4_inf" : "k8_inf"), 1e-3);
        }
    }
    assert_int_equal(i, 72);
    json_decref(root);
}

/* Starting from the table must reach the same optimum as the full search: all counts, indices inside and outside the table, all albedos. */
static void starts_from_the_table_end_in_the_best_optimum(void **state)
{
    uint64_t seed = 5;
    (void) state;
    for (int round = 0; round < 60; round++) {
        double u[2];
        for (int i = 0; i < 2; i++) {
            seed = seed * 6364136223846793005u + 1442695040888963407u;
            u[i] = (double) (seed >> 11) * 0x1p-53;
        }
        const double lost = pow(10.0, -6.0 * u[0]);
        const struct pell_dipole d = pell_dipole_make(lost, 1.0 - 0.99 * lost, 0.9 + 1.3 * u[1], PELL_FRESNEL_EXACT);
        const struct pell_fit_params params = { .count = 1 + round % PELL_GAUSSIANS_MAX, .free_energy = round % 20 >= 10 };
        struct pell_gaussians g;
        struct pell_fit_report table, searched;
        assert_int_equal(pell_fit_dipole(&d, &params, &g, &table), PELL_OK);
        assert_int_equal(pell_fit_dipole_searched(&d, &params, &g, &searched), PELL_OK);
        REQUIRE_REL(table.error[0], searched.error[0], 1e-4 + 1e-10 / searched.error[0]);
    }
}

static void a_profile_is_fitted_as_its_dipole(void **state)
{
    (void) state;
    for (size_t i = 0; i < PELL_COUNT(albedos); i++)
        for (int k = 2; k <= 6; k += 2) {
            const struct pell_medium m = { { 1.0 - albedos[i], 1, 1 }, { albedos[i], 1, 1 }, { 0 }, 1.3 };
            const struct pell_dipole d = pell_dipole_make(1.0 - albedos[i], albedos[i], 1.3, PELL_FRESNEL_EXACT);
            const struct pell_fit_params params = { .count = k };
            struct pell_profile p;
            struct pell_gaussians g, h;
            struct pell_fit_report report, other;
            requires_fit(&d, k, false, &g, &report);
            assert_int_equal(pell_profile_make(PELL_PROFILE_DIPOLE, &m, 0, NULL, &p), PELL_OK);
            assert_int_equal(pell_fit_profile(&p, &params, &h, &other), PELL_OK);
            REQUIRE_REL(other.error[0], report.error[0], 1e-3);
            REQUIRE_REL(pell_gaussians_total(&h, 0), pell_dipole_total(&d), 1e-12);
            REQUIRE_REL(pell_gaussians_error(&g, 0, &p, 0.0), error_10(&d, &g, 0), 1e-3);
        }
}

static void every_model_is_fitted(void **state)
{
    const struct pell_medium *m = &pell_material_find("skin1")->medium;
    (void) state;
    for (int model = 0; model < PELL_PROFILE_MODELS; model++) {
        static struct pell_profile p[3], swapped[3];
        double last[3] = { 1.0, 1.0, 1.0 };
        for (int c = 0; c < 3; c++) {
            assert_int_equal(pell_profile_make((enum pell_profile_model) model, m, c, NULL, &p[c]), PELL_OK);
            swapped[(c + 1) % 3] = p[c];
        }
        for (int k = 1; k <= 6; k++) {
            const struct pell_fit_params params = { .count = k };
            struct pell_gaussians g, h, own;
            struct pell_fit_report report, other, alone;
            const double start = pell_seconds();
            assert_int_equal(pell_fit_profiles(p, &params, &g, &report), PELL_OK);
            const double seconds = pell_seconds() - start;
            assert_int_equal(pell_fit_profiles(swapped, &params, &h, &other), PELL_OK);
            assert_memory_equal(g.variance, h.variance, sizeof(g.variance));
            for (int c = 0; c < 3; c++) {
                REQUIRE(report.error[c] == other.error[(c + 1) % 3] && isfinite(report.error[c]));
                REQUIRE_REL(pell_gaussians_total(&g, c), pell_profile_total(&p[c]), 1e-12);
                for (int i = 0; i < k; i++)
                    REQUIRE(g.weight[i][c] == h.weight[i][(c + 1) % 3] && g.weight[i][c] >= 0.0 && g.variance[i] > 0.0);
                assert_int_equal(pell_fit_profile(&p[c], &params, &own, &alone), PELL_OK);
                REQUIRE_REL(alone.error[0], pell_gaussians_error(&own, 0, &p[c], 0.0), 0.02);
                REQUIRE(alone.error[0] < last[c]);
                last[c] = alone.error[0];
            }
            if (k == 6)
                print_message("# %s: 6 shared Gaussians %.3g %.3g %.3g %% in %.1f ms; own %.3g %.3g %.3g %%\n",
                              pell_profile_model_at((size_t) model)->name, 100.0 * report.error[0], 100.0 * report.error[1],
                              100.0 * report.error[2], seconds * 1e3, 100.0 * last[0], 100.0 * last[1], 100.0 * last[2]);
        }
    }
}

static void profiles_that_can_not_be_fitted_are_refused(void **state)
{
    static const double bad[] = { NAN, -1.0, INFINITY };
    const struct pell_fit_params four = { .count = 4 };
    static struct pell_profile p[3];
    struct pell_gaussians g;
    struct pell_fit_report report;
    (void) state;
    memset(p, 0, sizeof(p));
    assert_int_equal(pell_fit_profiles(p, &four, &g, &report), PELL_OK); /* no light: nothing to fit */
    assert_int_equal(g.count, 0);
    assert_true(isnan(pell_gaussians_error(&g, 0, &p[0], 0.0)));
    const struct pell_medium m = skin1();
    assert_int_equal(pell_profile_make(PELL_PROFILE_DIPOLE, &m, 1, NULL, &p[1]), PELL_OK);
    assert_int_equal(pell_fit_profiles(p, &four, &g, &report), PELL_OK);
    REQUIRE(g.count == 4 && pell_gaussians_total(&g, 0) == 0.0 && report.error[2] == 0.0);
    assert_true(isnan(pell_gaussians_error(&g, 3, &p[1], 0.0)));
    for (size_t i = 0; i < PELL_COUNT(bad); i++) {
        const struct pell_fit_params range = { .count = 4, .r_max_mm = bad[i] };
        assert_int_equal(pell_fit_profile(&p[1], &range, &g, NULL), PELL_ERR_INVALID);
        assert_int_equal(pell_fit_medium(&m, &range, &g, NULL), PELL_ERR_INVALID);
        struct pell_profile damaged = p[1];
        damaged.total = bad[i];
        assert_int_equal(pell_fit_profile(&damaged, &four, &g, NULL), PELL_ERR_INVALID);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(every_optimum_of_the_oracle_is_reached),
        cmocka_unit_test(errors_over_albedo),
        cmocka_unit_test(errors_over_eta),
        cmocka_unit_test(reported_error_is_error_10),
        cmocka_unit_test(each_gaussian_more_lowers_the_error),
        cmocka_unit_test(all_materials_share_variances_with_a_falling_error),
        cmocka_unit_test(equal_channels_give_the_single_fit),
        cmocka_unit_test(swapping_channels_swaps_weights_bit_by_bit),
        cmocka_unit_test(units_cancel),
        cmocka_unit_test(the_scale_of_the_albedo_does_not_matter_to_the_error),
        cmocka_unit_test(channels_a_hundred_times_apart),
        cmocka_unit_test(black_channels_get_nothing),
        cmocka_unit_test(extremes_of_every_coefficient_stay_finite),
        cmocka_unit_test(what_can_not_be_fitted_is_refused),
        cmocka_unit_test(a_sum_of_gaussians_has_its_total_and_value),
        cmocka_unit_test(fits_over_a_range_are_the_oracles),
        cmocka_unit_test(starts_from_the_table_end_in_the_best_optimum),
        cmocka_unit_test(a_profile_is_fitted_as_its_dipole),
        cmocka_unit_test(every_model_is_fitted),
        cmocka_unit_test(a_free_fit_makes_no_light),
        cmocka_unit_test(profiles_that_can_not_be_fitted_are_refused),
    };
    return cmocka_run_group_tests_name("optics.fit", tests, NULL, NULL);
}
