/* SPDX-License-Identifier: MIT
 * test_inversion.c - colours to coefficients: closed albedo maps and their distance from transport, the numeric inversion, radii. */
#include "oracle.h"
#include "slow.h"

#include "math/vec.h"

#include <pellucid/inversion.h>
#include <pellucid/phase.h>

/* The errors that the header states. */
#define HULST_ERROR 0.0025
#define HULST_ERROR_FORWARD 0.007
#define HULST_ERROR_BACKWARD 0.022
#define CHIANG_ERROR 0.006
#define BOUNDARY_ERROR 0.05
#define CHIANG_ERROR_WHITE 0.075

static const double etas[] = { 1.0, 1.1, 1.3, 1.5, 2.0 };

/* --- Closed maps -------------------------------------------------------------------------------------------------------------- */

static void maps_invert_themselves(void **state)
{
    (void) state;
    for (int map = 0; map < PELL_ALBEDO_MAPS; map++)
        for (size_t e = 0; e < PELL_COUNT(etas); e++) {
            const double white = map == PELL_ALBEDO_VAN_DE_HULST ? 2e-5 : 1e-12; /* its six digits */
            double last = -1.0;
            for (int k = 0; k <= 1000; k++) {
                const double A = k / 1000.0, albedo = pell_albedo_map_invert((enum pell_albedo_map) map, A, etas[e]);
                REQUIRE(albedo >= 0.0 && albedo <= 1.0 && albedo > last);
                REQUIRE_NEAR(pell_albedo_map_color((enum pell_albedo_map) map, albedo, etas[e]), A, k < 1000 ? 1e-9 : white);
                last = albedo;
            }
            REQUIRE(pell_albedo_map_invert((enum pell_albedo_map) map, 0.0, etas[e]) == 0.0);
            REQUIRE(pell_albedo_map_color((enum pell_albedo_map) map, 0.0, etas[e]) == 0.0);
            REQUIRE_NEAR(pell_albedo_map_color((enum pell_albedo_map) map, 1.0, etas[e]), 1.0, white);
        }
    REQUIRE(pell_albedo_map_invert(PELL_ALBEDO_VAN_DE_HULST, 1.0, 1.0) == 1.0 &&
            pell_albedo_map_invert(PELL_ALBEDO_DIPOLE, 1.0, 1.3) == 1.0);
    REQUIRE_NEAR(pell_albedo_map_invert(PELL_ALBEDO_CHIANG, 1.0, 1.0), 1.0 - exp(-6.80023), 1e-12);
}

/* The published form (Kulla and Conty 2017, the glTF draft, OpenPBR) has 6 digits of the inverse of van de Hulst's fraction. */
static void van_de_hulst_is_the_formula_in_print(void **state)
{
    (void) state;
    for (int k = 0; k <= 100; k++)
        for (double g = -0.9; g < 1.0; g += 0.3) {
            const double A = k / 100.0, s = 4.09712 + 4.20863 * A - sqrt(9.59217 + 41.6808 * A + 17.7126 * A * A);
            const double printed = (1.0 - s * s) / (1.0 - g * s * s);
            const double albedo = pell_albedo_map_invert(PELL_ALBEDO_VAN_DE_HULST, A, 1.0), t = sqrt(1.0 - albedo);
            REQUIRE_NEAR(pell_albedo_of_reduced(albedo, g), printed, k > 0 ? 1e-9 : 6e-5);
            REQUIRE_NEAR((1.0 - t) * (1.0 - 0.139 * t) / (1.0 + 1.17 * t), A, 2e-5);
        }
}

static void similarity_goes_both_ways(void **state)
{
    (void) state;
    for (double g = -0.999; g < 1.0; g += 0.111)
        for (int k = 0; k <= 50; k++) {
            const double reduced = k / 50.0, albedo = pell_albedo_of_reduced(reduced, g), s = albedo * (1.0 - g), a = 1.0 - albedo;
            REQUIRE(albedo >= 0.0 && albedo <= 1.0);
            REQUIRE_NEAR(s / (s + a), reduced, 1e-12); /* sigma_t = 1 */
            REQUIRE_NEAR(pell_albedo_reduced_of(albedo, g), reduced, 1e-12);
        }
}

/* Spherical albedo of a half-space without a boundary, isotropic: 1 - 2 sqrt(1 - alpha) Int H mu dmu (Chandrasekhar 1960, III), H by
 * iteration of 1/H = sqrt(1 - alpha) + alpha/2 Int mu' H(mu')/(mu + mu') dmu' on a midpoint rule in sqrt(mu). */
static double uniform_light(double alpha)
{
    enum { N = 200 };
    double h[N], mu[N], w[N], sum = 0.0;
    for (int i = 0; i < N; i++) {
        const double x = (i + 0.5) / N;
        mu[i] = x * x;
        w[i] = 2.0 * x / N;
        h[i] = 1.0;
    }
    for (int pass = 0; pass < 300; pass++)
        for (int i = 0; i < N; i++) {
            double s = sqrt(1.0 - alpha);
            for (int j = 0; j < N; j++)
                s += 0.5 * alpha * w[j] * mu[j] * h[j] / (mu[i] + mu[j]);
            h[i] = 0.5 * (h[i] + 1.0 / s);
        }
    for (int i = 0; i < N; i++)
        sum += w[i] * mu[i] * h[i];
    return 1.0 - 2.0 * sqrt(1.0 - alpha) * sum;
}

static double rng(uint64_t *s)
{
    *s = *s * 6364136223846793005u + 1442695040888963407u;
    return ((double) (*s >> 11) + 0.5) / 9007199254740992.0;
}

enum { ALBEDOS = 6 };
static const double albedos[ALBEDOS] = { 0.3, 0.5, 0.7, 0.85, 0.95, 0.98 };

/* The same by photons, with the Henyey-Greenstein phase function: a photon that leaves after n collisions has weight alpha^n. */
static void walk(double g, int photons, double color[ALBEDOS])
{
    const struct pell_phase phase = { PELL_PHASE_HENYEY_GREENSTEIN, { g }, 0.0 };
    double alpha[ALBEDOS];
    uint64_t seed = 11;

    for (int k = 0; k < ALBEDOS; k++) {
        alpha[k] = pell_albedo_of_reduced(albedos[k], g);
        color[k] = 0.0;
    }
    for (int i = 0; i < photons; i++) {
        const double mu = sqrt(rng(&seed)), turn = 2.0 * PELL_PI * rng(&seed), s = sqrt(1.0 - mu * mu);
        double w[3] = { s * cos(turn), s * sin(turn), mu }, depth = 0.0, weight[ALBEDOS];
        for (int k = 0; k < ALBEDOS; k++)
            weight[k] = 1.0;
        while (weight[ALBEDOS - 1] > 1e-4) {
            double back[3] = { -w[0], -w[1], -w[2] };
            depth -= log(rng(&seed)) * w[2];
            if (depth < 0.0) {
                for (int k = 0; k < ALBEDOS; k++)
                    color[k] += weight[k] / photons;
                break;
            }
            for (int k = 0; k < ALBEDOS; k++)
                weight[k] *= alpha[k];
            const double xi2 = rng(&seed),
                         xi1 = rng(&seed); /* separate statements: compilers differ in the order in which they evaluate arguments */
            pell_phase_sample(&phase, xi1, xi2, back, w);
        }
    }
}

static void photons_find_the_exact_solution(void **state)
{
    double color[ALBEDOS];
    (void) state;
    walk(0.0, 20000, color);
    for (int k = 0; k < ALBEDOS; k++)
        REQUIRE_NEAR(color[k], uniform_light(albedos[k]), 0.01); /* 3 sigma */
}

/* The errors stated in pellucid/inversion.h are upper bounds, and at most twice the measured errors. */
static void maps_err_by_what_the_header_says(void **state)
{
    static const double gs[] = { -0.8, -0.4, 0.4, 0.8 };
    double hulst = 0.0, hulst_relative = 0.0, chiang = 0.0, chiang_end = 0.0, any = 0.0, forward = 0.0;
    (void) state;

    RELEASE_ONLY();
    for (int k = 1; k < 60; k++) {
        const double alpha = k < 40 ? k / 40.0 : 1.0 - 0.025 * pow(0.8, k - 39), truth = uniform_light(alpha);
        hulst = fmax(hulst, fabs(pell_albedo_map_color(PELL_ALBEDO_VAN_DE_HULST, alpha, 1.0) - truth));
        hulst_relative = fmax(hulst_relative, fabs(pell_albedo_map_color(PELL_ALBEDO_VAN_DE_HULST, alpha, 1.0) / truth - 1.0));
        const double c = pell_albedo_map_color(PELL_ALBEDO_CHIANG, alpha, 1.0);
        chiang = fmax(chiang, c < 0.8 ? fabs(c - truth) : 0.0);
        chiang_end = fmax(chiang_end, fabs(c - truth));
    }
    for (size_t i = 0; i < PELL_COUNT(gs); i++) {
        double color[ALBEDOS];
        walk(gs[i], 30000, color);
        for (int k = 0; k < ALBEDOS; k++) {
            const double error = pell_albedo_map_color(PELL_ALBEDO_VAN_DE_HULST, albedos[k], 1.0) - color[k];
            any = fmax(any, fabs(error));
            forward = fmax(forward, gs[i] > -0.5 ? fabs(error) : 0.0);
            print_message("# g %4.1f, alpha' %.2f: %.4f by photons, van de Hulst off by %+.4f\n", gs[i], albedos[k], color[k], error);
        }
    }
    print_message("# van de Hulst: %.4f for g = 0 (%.1f %% of the colour), %.4f for g in [-0.4, 0.8], %.4f for g = -0.8\n", hulst,
                  100.0 * hulst_relative, forward, any);
    print_message("# Chiang: %.4f up to 0.8, %.4f above\n", chiang, chiang_end);
    REQUIRE(hulst < HULST_ERROR && hulst > 0.5 * HULST_ERROR);
    REQUIRE(forward < HULST_ERROR_FORWARD && any < HULST_ERROR_BACKWARD && any > 0.5 * HULST_ERROR_BACKWARD);
    REQUIRE(chiang < CHIANG_ERROR && chiang > 0.5 * CHIANG_ERROR);
    REQUIRE(chiang_end < CHIANG_ERROR_WHITE && chiang_end > 0.5 * CHIANG_ERROR_WHITE);
}

/* 33 media with a boundary, eta 1.3: the maps' albedos, which ignore the boundary, and the dipole's, which is the oracle's. */
static void maps_against_the_oracles_photons(void **state)
{
    json_t *root = oracle_load("montecarlo.json"), *row;
    double worst[PELL_ALBEDO_MAPS] = { 0.0 }, under = 0.0;
    size_t i;
    (void) state;
    json_array_foreach(oracle_get(oracle_get(root, "semi_infinite_eta1.3_total_albedo"), "table"), i, row)
    {
        const double alpha = oracle_number(row, "alpha"), mc = oracle_number(row, "mc_R");
        for (int map = 0; map < PELL_ALBEDO_MAPS; map++)
            worst[map] = fmax(worst[map], fabs(pell_albedo_map_color((enum pell_albedo_map) map, alpha, 1.3) - mc));
        under = fmax(under, fabs(pell_color_under_boundary(pell_albedo_map_color(PELL_ALBEDO_VAN_DE_HULST, alpha, 1.0), 1.3) - mc));
        REQUIRE_NEAR(pell_albedo_map_color(PELL_ALBEDO_DIPOLE, alpha, 1.3), oracle_number(row, "dipole_R"), 1e-3); /* 3-digit Fdr there */
    }
    json_decref(root);
    assert_int_equal(i, 33);
    print_message("# largest error at eta 1.3: van de Hulst %.3f, under a boundary %.3f, Chiang %.3f, dipole %.3f\n", worst[0], under,
                  worst[1], worst[2]);
    REQUIRE(worst[PELL_ALBEDO_DIPOLE] < 0.02 && under < BOUNDARY_ERROR && under > 0.5 * BOUNDARY_ERROR);
}

static void a_boundary_keeps_black_and_white_and_inverts(void **state)
{
    (void) state;
    for (size_t e = 0; e < PELL_COUNT(etas); e++) {
        REQUIRE(pell_color_under_boundary(0.0, etas[e]) == 0.0 && pell_color_without_boundary(0.0, etas[e]) == 0.0);
        REQUIRE_NEAR(pell_color_under_boundary(1.0, etas[e]), 1.0, 1e-15);
        for (int k = 1; k < 50; k++) {
            const double c = k / 50.0, under = pell_color_under_boundary(c, etas[e]);
            REQUIRE(etas[e] > 1.0 ? under < c : under == c);
            REQUIRE_NEAR(pell_color_without_boundary(under, etas[e]), c, 1e-14);
        }
    }
    REQUIRE(isnan(pell_color_under_boundary(NAN, 1.3)) && isnan(pell_color_without_boundary(0.5, NAN)));
    REQUIRE(pell_color_under_boundary(INFINITY, 1.3) == pell_color_under_boundary(1.0, 1.3) &&
            pell_color_without_boundary(-1.0, 1.3) == 0.0);
}

/* --- Numeric inversion -------------------------------------------------------------------------------------------------------- */

static bool available(int model)
{
    return pell_profile_model_at((size_t) model) != NULL;
}

static double total_of(enum pell_profile_model model, const struct pell_medium *m, int channel)
{
    struct pell_profile profile;
    assert_int_equal(pell_profile_make(model, m, channel, NULL, &profile), PELL_OK);
    return pell_profile_total(&profile);
}

static void every_model_returns_its_colour(void **state)
{
    (void) state;
    for (int model = 0; model < PELL_PROFILE_MODELS; model++) {
        double worst = 0.0;
        if (!available(model))
            continue;
        for (size_t e = 0; e < PELL_COUNT(etas); e++)
            for (int k = 0; k < 10; k++) {
                struct pell_medium_fault fault;
                const double color = k < 9 ? 0.05 + 0.1 * k : 0.97, g = 0.09 * k - 0.4;
                double albedo;
                const enum pell_result res =
                    pell_albedo_of_color((enum pell_profile_model) model, NULL, color, g, etas[e], &albedo, &fault);
                if (res == PELL_ERR_INVALID) { /* brighter than the model allows */
                    assert_string_equal(fault.field, "color");
                    REQUIRE(fault.value == color && fault.max < color);
                    continue;
                }
                assert_int_equal(res, PELL_OK);
                const double a = 1.0 - albedo;
                const struct pell_medium m = { { a, a, a }, { albedo, albedo, albedo }, { g, g, g }, etas[e] };
                const double total = total_of((enum pell_profile_model) model, &m, 1);
                REQUIRE_NEAR(total, color, 1e-8);
                worst = fmax(worst, fabs(total - color));
            }
        print_message("# %s: largest error of a colour %.1g\n", pell_profile_model_at((size_t) model)->name, worst);
    }
}

static void the_dipoles_map_is_its_numeric_inversion(void **state)
{
    (void) state;
    for (double color = 0.0; color <= 1.0; color += 0.05)
        for (size_t e = 0; e < PELL_COUNT(etas); e++) {
            double albedo;
            assert_int_equal(pell_albedo_of_color(PELL_PROFILE_DIPOLE, NULL, color, 0.0, etas[e], &albedo, NULL), PELL_OK);
            REQUIRE_NEAR(albedo, pell_albedo_map_invert(PELL_ALBEDO_DIPOLE, color, etas[e]), 1e-9);
        }
}

static void black_and_the_brightest_have_limits(void **state)
{
    (void) state;
    for (int model = 0; model < PELL_PROFILE_MODELS; model++) {
        struct pell_medium m = { { 0.0, 0.0, 0.0 }, { 1.0, 1.0, 1.0 }, { 0.0, 0.0, 0.0 }, 1.3 };
        struct pell_medium_fault fault;
        double albedo;
        if (!available(model))
            continue;
        const double top = total_of((enum pell_profile_model) model, &m, 0);
        assert_int_equal(pell_albedo_of_color((enum pell_profile_model) model, NULL, 0.0, 0.0, 1.3, &albedo, NULL), PELL_OK);
        REQUIRE(albedo == 0.0);
        assert_int_equal(pell_albedo_of_color((enum pell_profile_model) model, NULL, fmin(top, 1.0), 0.0, 1.3, &albedo, NULL), PELL_OK);
        REQUIRE_NEAR(albedo, 1.0, 1e-9);
        if (top < 0.999) {
            assert_int_equal(pell_albedo_of_color((enum pell_profile_model) model, NULL, 1.0, 0.0, 1.3, &albedo, &fault), PELL_ERR_INVALID);
            assert_string_equal(fault.field, "color");
            REQUIRE(fault.value == 1.0 && fault.min == 0.0 && fault.max == top && albedo == 0.0);
        }
    }
}

/* --- Colour and radius -------------------------------------------------------------------------------------------------------- */

static void looks_come_back(void **state)
{
    static const double radii[] = { 1e-3, 0.1, 1.0, 25.0, 1e3 }, levels[] = { 1e-3, 0.02, 0.2, 0.5, 0.8, 0.95, 0.999 };
    const int models[] = { PELL_PROFILE_DIPOLE, PELL_PROFILE_NORMALIZED_DIFFUSION };
    (void) state;
    for (size_t model = 0; model < PELL_COUNT(models); model++)
        for (size_t r = 0; available(models[model]) && r < PELL_COUNT(radii); r++)
            for (size_t k = 0; k < PELL_COUNT(levels); k++)
                for (int kind = 0; kind < 2; kind++) {
                    const struct pell_color_and_radius look = {
                        .color = { levels[k], levels[(k + 2) % 7], levels[(k + 5) % 7] },
                        .radius = { radii[r], 3.0 * radii[r], 0.2 * radii[r] },
                        .g = { 0.8, 0.0, -0.5 },
                        .eta = etas[k % PELL_COUNT(etas)],
                        .kind = (enum pell_scatter_radius) kind,
                    };
                    struct pell_medium m;
                    struct pell_medium_fault fault;
                    const enum pell_result res =
                        pell_medium_from_color_and_radius(&look, (enum pell_profile_model) models[model], NULL, &m, &fault);
                    if (res == PELL_ERR_INVALID) { /* close to white a short diffuse mean free path requires more than PELL_SIGMA_MAX */
                        REQUIRE(kind == PELL_SCATTER_RADIUS_DIFFUSE && radii[r] < 0.01 && fault.value < fault.min && fault.min < 0.01);
                        continue;
                    }
                    assert_int_equal(res, PELL_OK);
                    REQUIRE(pell_medium_valid(&m, NULL));
                    for (int c = 0; c < 3; c++) {
                        REQUIRE_NEAR(total_of((enum pell_profile_model) models[model], &m, c), look.color[c], 1e-8);
                        REQUIRE_REL(kind == PELL_SCATTER_RADIUS_DIFFUSE ? pell_diffuse_mean_free_path(&m, c) : pell_mean_free_path(&m, c),
                                    look.radius[c], 1e-6);
                        REQUIRE(m.g[c] == look.g[c] && m.eta == look.eta);
                    }
                }
}

static const struct pell_color_and_radius skin = {
    .color = { 0.8, 0.5, 0.35 }, .radius = { 1.0, 0.2, 0.1 }, .g = { 0.0, 0.6, -0.3 }, .eta = 1.4, .kind = PELL_SCATTER_RADIUS_EXTINCTION
};

/* sigma_t of a channel. */
static double extinction(const struct pell_medium *m, int c)
{
    return m->sigma_a[c] + m->sigma_s_reduced[c] / (1.0 - m->g[c]);
}

/* The parameters of other programs, in their own terms and quantities. */
static void radii_of_other_programs_keep_their_meaning(void **state)
{
    (void) state;
    for (int kind = 0; kind < PELL_SCATTER_RADII; kind++) {
        struct pell_color_and_radius look = skin;
        struct pell_medium m;
        look.kind = (enum pell_scatter_radius) kind;
        assert_int_equal(pell_medium_from_map(&look, PELL_ALBEDO_VAN_DE_HULST, &m, NULL), PELL_OK);
        REQUIRE(pell_medium_valid(&m, NULL));
        for (int c = 0; c < 3; c++) {
            const double A = look.color[c], g = look.g[c], sigma_t = extinction(&m, c), alpha = 1.0 - m.sigma_a[c] / sigma_t,
                         r = look.radius[c];
            const double s = 4.09712 + 4.20863 * A - sqrt(9.59217 + 41.6808 * A + 17.7126 * A * A);
            REQUIRE_NEAR(alpha, (1.0 - s * s) / (1.0 - g * s * s), 6e-5);
            if (kind == PELL_SCATTER_RADIUS_MEAN_FREE_PATH)
                REQUIRE_REL(pell_mean_free_path(&m, c), r, 1e-12);
            if (kind == PELL_SCATTER_RADIUS_DIFFUSE)
                REQUIRE_REL(pell_diffuse_mean_free_path(&m, c), r, 1e-12);
            if (kind == PELL_SCATTER_RADIUS_EXTINCTION)
                REQUIRE_REL(sigma_t, 1.0 / r, 1e-12);
            if (kind == PELL_SCATTER_RADIUS_BURLEY)
                REQUIRE_REL(sigma_t, 1.0 / (r * (1.9 - A + 3.5 * (A - 0.8) * (A - 0.8))), 1e-12);
            if (kind == PELL_SCATTER_RADIUS_CYCLES)
                REQUIRE_REL(sigma_t * (1.0 - g), 4.0 * PELL_PI / r, 1e-12);
            if (kind == PELL_SCATTER_RADIUS_MEAN) {
                struct pell_profile profile;
                assert_int_equal(pell_profile_make(PELL_PROFILE_MONTE_CARLO, &m, c, NULL, &profile), PELL_OK);
                REQUIRE_REL(pell_profile_mean_radius(&profile), r, 1e-6);
            }
            if (kind == PELL_SCATTER_RADIUS_CYCLES_SKIN) { /* the dipole's total at a equals the colour */
                const double rest = pow(1.0 / (sigma_t * (1.0 - g) * r), 2.0), f = pell_fresnel_diffuse(look.eta, PELL_FRESNEL_POLY3);
                const double A43 = 4.0 / 3.0 * (1.0 + f) / (1.0 - f), root = sqrt(rest);
                REQUIRE_NEAR(0.5 * (1.0 - rest / 3.0) * (1.0 + exp(-A43 * root)) * exp(-root), A, 1e-9);
            }
        }
    }
}

static void names_and_rows(void **state)
{
    (void) state;
    for (int kind = 0; kind < PELL_SCATTER_RADII; kind++) {
        enum pell_scatter_radius found;
        const struct pell_scatter_radius_row *row = pell_scatter_radius_at((size_t) kind);
        REQUIRE(row && row->name && row->help);
        REQUIRE(pell_scatter_radius_find(row->name, &found) && (int) found == kind);
    }
    for (int map = 0; map < PELL_ALBEDO_MAPS; map++)
        REQUIRE(pell_albedo_map_at((size_t) map)->name && pell_albedo_map_at((size_t) map)->cite);
    enum pell_scatter_radius found = PELL_SCATTER_RADIUS_DIFFUSE;
    REQUIRE(!pell_scatter_radius_find("mile", &found) && !pell_scatter_radius_find(NULL, &found) && found == PELL_SCATTER_RADIUS_DIFFUSE);
    REQUIRE(!pell_scatter_radius_at(PELL_SCATTER_RADII) && !pell_scatter_radius_at((size_t) -1) && !pell_albedo_map_at(PELL_ALBEDO_MAPS));
}

static void a_scaled_radius_scales_the_coefficients(void **state)
{
    (void) state;
    for (int kind = 0; kind < PELL_SCATTER_RADII; kind++) {
        struct pell_color_and_radius look = skin;
        struct pell_medium mm, cm;
        look.kind = (enum pell_scatter_radius) kind;
        assert_int_equal(pell_medium_from_color_and_radius(&look, PELL_PROFILE_DIPOLE, NULL, &mm, NULL), PELL_OK);
        for (int c = 0; c < 3; c++)
            look.radius[c] *= 0.1;
        assert_int_equal(pell_medium_from_color_and_radius(&look, PELL_PROFILE_DIPOLE, NULL, &cm, NULL), PELL_OK);
        for (int c = 0; c < 3; c++) {
            REQUIRE_REL(cm.sigma_a[c], 10.0 * mm.sigma_a[c], 1e-12);
            REQUIRE_REL(cm.sigma_s_reduced[c], 10.0 * mm.sigma_s_reduced[c], 1e-12);
        }
    }
}

static void what_is_out_of_range_is_named(void **state)
{
    static const double odd[] = { NAN, INFINITY, -INFINITY, -1.0, -1e-300, 1.0 + 1e-15, 1e300 };
    (void) state;
    for (size_t i = 0; i < PELL_COUNT(odd); i++)
        for (int c = 0; c < 3; c++)
            for (int field = 0; field < 4; field++) {
                static const char *const names[4][3] = { { "color[0]", "color[1]", "color[2]" },
                                                         { "radius[0]", "radius[1]", "radius[2]" },
                                                         { "g[0]", "g[1]", "g[2]" },
                                                         { "eta", "eta", "eta" } };
                struct pell_color_and_radius look = skin;
                struct pell_medium m;
                struct pell_medium_fault fault;
                double *const at[4] = { &look.color[c], &look.radius[c], &look.g[c], &look.eta };
                const bool fine =
                    (field == 1 && odd[i] == 1.0 + 1e-15) || (field == 2 && odd[i] == -1e-300) || (field == 3 && odd[i] == 1.0 + 1e-15);
                *at[field] = odd[i];
                for (int from_map = 0; from_map < 2; from_map++) {
                    const enum pell_result res = from_map ? pell_medium_from_map(&look, PELL_ALBEDO_CHIANG, &m, &fault)
                                                          : pell_medium_from_color_and_radius(&look, PELL_PROFILE_DIPOLE, NULL, &m, &fault);
                    assert_int_equal(res, fine ? PELL_OK : PELL_ERR_INVALID);
                    if (fine)
                        continue;
                    assert_string_equal(fault.field, names[field][c]);
                    REQUIRE(!(fault.value >= fault.min && fault.value <= fault.max));
                    REQUIRE(m.eta == 0.0 && m.sigma_a[0] == 0.0 && m.sigma_s_reduced[2] == 0.0);
                }
            }
    struct pell_color_and_radius white = skin, wild = skin;
    struct pell_medium m;
    struct pell_medium_fault fault;
    white.color[1] = 1.0;
    white.kind = PELL_SCATTER_RADIUS_DIFFUSE;
    assert_int_equal(pell_medium_from_color_and_radius(&white, PELL_PROFILE_DIPOLE, NULL, &m, &fault), PELL_ERR_INVALID);
    assert_string_equal(fault.field, "radius[1]");
    white.kind = PELL_SCATTER_RADIUS_MEAN_FREE_PATH;
    assert_int_equal(pell_medium_from_color_and_radius(&white, PELL_PROFILE_DIPOLE, NULL, &m, NULL), PELL_OK);
    REQUIRE(m.sigma_a[1] == 0.0 && m.sigma_s_reduced[1] == 1.0 / white.radius[1]);
    wild.kind = (enum pell_scatter_radius) 77;
    assert_int_equal(pell_medium_from_color_and_radius(&wild, PELL_PROFILE_DIPOLE, NULL, &m, &fault), PELL_ERR_INVALID);
    assert_string_equal(fault.field, "kind");
    wild = skin;
    assert_int_equal(pell_medium_from_map(&wild, PELL_ALBEDO_MAPS, &m, &fault), PELL_ERR_INVALID);
    assert_string_equal(fault.field, "map");
    wild.radius[2] = 1e7; /* a mean free path of ten kilometres */
    assert_int_equal(pell_medium_from_color_and_radius(&wild, PELL_PROFILE_DIPOLE, NULL, &m, &fault), PELL_ERR_INVALID);
    assert_string_equal(fault.field, "radius[2]");
    REQUIRE(fault.max < 1e7 && fault.max > 1e5);
    wild.radius[2] = fault.max;
    assert_int_equal(pell_medium_from_color_and_radius(&wild, PELL_PROFILE_DIPOLE, NULL, &m, &fault), PELL_OK);
    REQUIRE(pell_medium_valid(&m, NULL));
    for (size_t i = 0; i < PELL_COUNT(odd); i++) {
        double albedo = 5.0;
        REQUIRE(isnan(pell_albedo_map_invert(PELL_ALBEDO_DIPOLE, odd[i], 1.3)) == isnan(odd[i]));
        REQUIRE(isnan(pell_albedo_map_color(PELL_ALBEDO_CHIANG, odd[i], 1.3)) == isnan(odd[i]));
        assert_int_equal(pell_albedo_of_color(PELL_PROFILE_DIPOLE, NULL, odd[i], 0.0, 1.3, &albedo, &fault), PELL_ERR_INVALID);
        REQUIRE(albedo == 0.0 && strcmp(fault.field, "color") == 0);
        if (odd[i] != -1e-300)
            assert_int_equal(pell_albedo_of_color(PELL_PROFILE_DIPOLE, NULL, 0.5, odd[i], 1.3, &albedo, &fault), PELL_ERR_INVALID);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(maps_invert_themselves),
        cmocka_unit_test(van_de_hulst_is_the_formula_in_print),
        cmocka_unit_test(similarity_goes_both_ways),
        cmocka_unit_test(photons_find_the_exact_solution),
        cmocka_unit_test(maps_err_by_what_the_header_says),
        cmocka_unit_test(maps_against_the_oracles_photons),
        cmocka_unit_test(a_boundary_keeps_black_and_white_and_inverts),
        cmocka_unit_test(every_model_returns_its_colour),
        cmocka_unit_test(the_dipoles_map_is_its_numeric_inversion),
        cmocka_unit_test(black_and_the_brightest_have_limits),
        cmocka_unit_test(looks_come_back),
        cmocka_unit_test(radii_of_other_programs_keep_their_meaning),
        cmocka_unit_test(names_and_rows),
        cmocka_unit_test(a_scaled_radius_scales_the_coefficients),
        cmocka_unit_test(what_is_out_of_range_is_named),
    };
    return cmocka_run_group_tests_name("optics.inversion", tests, NULL, NULL);
}
