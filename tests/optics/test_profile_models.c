/* SPDX-License-Identifier: MIT
 * test_profile_models.c - every profile model against photons, against transport, and against properties of all profiles. */
#include "oracle.h"
#include "slow.h"

#include "math/quadrature.h"
#include "math/vec.h"
#include "optics/photon/photon.h"
#include "optics/photon/table.h"
#include "shared/single.h"

#define MODELS PELL_PROFILE_MODELS

static struct pell_medium medium_of(double sigma_a, double sigma_s, double g, double eta)
{
    return (struct pell_medium) { { sigma_a, sigma_a, sigma_a }, { sigma_s, sigma_s, sigma_s }, { g, g, g }, eta };
}

static void make(enum pell_profile_model model, const struct pell_medium *m, bool without_single, struct pell_profile *out)
{
    const struct pell_profile_params params = { .without_single = without_single };
    const enum pell_result res = pell_profile_make(model, m, 0, &params, out);
    if (res != PELL_OK)
        fail_msg("%s: %s", pell_profile_model_at(model)->name, pell_result_name(res));
}

/* --- Rows ------------------------------------------------------------------------------------------------------------------------ */

static void models_are_found_by_name(void **state)
{
    static const char *const names[MODELS] = { "dipole", "better-dipole", "normalized-diffusion", "photon-beam", "monte-carlo" };
    enum pell_profile_model found;
    (void) state;
    for (int i = 0; i < MODELS; i++) {
        const struct pell_profile_model_row *row = pell_profile_model_at((size_t) i);
        REQUIRE(row != NULL && row->title && row->cite && row->limits);
        assert_string_equal(row->name, names[i]);
        REQUIRE(pell_profile_model_find(names[i], &found) && (int) found == i);
    }
    REQUIRE(pell_profile_model_at((size_t) MODELS) == NULL && pell_profile_model_at((size_t) -1) == NULL);
    REQUIRE(!pell_profile_model_find("", &found) && !pell_profile_model_find("Dipole", &found));
}

/* --- Against photons ------------------------------------------------------------------------------------------------------------- */

/* Fraction of the photons' light that a model misplaces, or has in excess or too little: Sum over bins
 * |flux - photons'| / total. `single`: the model includes single scattering; otherwise it is compared with multiple scattering. */
static double misplaced(json_t *row, const struct pell_profile *p, bool single)
{
    json_t *edges = oracle_get(row, "bin_edges_mm");
    double off = 0.0, all = 0.0;
    for (size_t i = 0; i + 1 < json_array_size(edges); i++) {
        const double a = oracle_at(row, "bin_edges_mm", i), b = oracle_at(row, "bin_edges_mm", i + 1);
        const double photons = PELL_PI * (b * b - a * a) * (oracle_at(row, "mc_R", i) - (single ? 0.0 : oracle_at(row, "mc_R_single", i)));
        off += fabs(p->total * (pell_profile_cdf(p, b) - pell_profile_cdf(p, a)) - photons);
        all += photons;
    }
    return off / all;
}

/* Bounds a tenth above the measured values: marble G, skin1 R, skin1 B, chicken2 B, wholemilk R, ketchup R. */
static void radial_profiles_of_photons(void **state)
{
    static const struct {
        enum pell_profile_model model;
        bool all; /* light */
        double bound[6];
    } rows[] = {
        { PELL_PROFILE_DIPOLE, true, { 0.165, 0.31, 0.82, 0.9, 0.156, 0.72 } },
        { PELL_PROFILE_BETTER_DIPOLE, true, { 0.09, 0.118, 0.163, 0.163, 0.087, 0.16 } },
        { PELL_PROFILE_BETTER_DIPOLE, false, { 0.098, 0.142, 0.294, 0.324, 0.095, 0.26 } },
        { PELL_PROFILE_NORMALIZED_DIFFUSION, true, { 0.42, 0.195, 0.122, 0.124, 0.472, 0.128 } },
        { PELL_PROFILE_PHOTON_BEAM, true, { 0.048, 0.062, 0.1, 0.105, 0.045, 0.091 } },
        { PELL_PROFILE_PHOTON_BEAM, false, { 0.053, 0.074, 0.18, 0.21, 0.049, 0.148 } },
        { PELL_PROFILE_MONTE_CARLO, true, { 0.004, 0.004, 0.006, 0.006, 0.004, 0.006 } },
        { PELL_PROFILE_MONTE_CARLO, false, { 0.004, 0.004, 0.007, 0.008, 0.004, 0.007 } },
    };
    json_t *root = oracle_load("montecarlo.json"), *row;
    size_t i;
    (void) state;
    json_array_foreach(oracle_get(root, "radial_profiles"), i, row)
    {
        const struct pell_medium m =
            medium_of(oracle_number(row, "sigma_a"), oracle_number(row, "sigma_sp"), 0.0, oracle_number(row, "eta"));
        for (size_t k = 0; k < PELL_COUNT(rows); k++) {
            struct pell_profile p;
            make(rows[k].model, &m, !rows[k].all, &p);
            const double off = misplaced(row, &p, rows[k].all);
            print_message("# profile %zu, %s, %s: %.4f\n", i, pell_profile_model_at(rows[k].model)->name,
                          rows[k].all ? "all light" : "scattered more than once", off);
            REQUIRE_NEAR(off, 0.0, rows[k].bound[i]);
        }
    }
    assert_int_equal(i, 6);
    json_decref(root);
}

/* 33 albedos: the half-space by transport within three standard errors (all use the same photons), and the errors of the models. */
static void totals_of_photons(void **state)
{
    json_t *root = oracle_load("montecarlo.json"), *row;
    size_t i;
    (void) state;
    json_array_foreach(oracle_get(oracle_get(root, "semi_infinite_eta1.3_total_albedo"), "table"), i, row)
    {
        const double alpha = oracle_number(row, "alpha"), photons = oracle_number(row, "mc_R"), se = oracle_number(row, "mc_se");
        const struct pell_medium m = medium_of(1.0 - alpha, alpha, 0.0, 1.3);
        struct pell_profile p, q;
        REQUIRE_NEAR(pell_half_space_albedo(alpha, 1.3), photons, 3.0 * se);
        make(PELL_PROFILE_NORMALIZED_DIFFUSION, &m, false, &p);
        REQUIRE_REL(p.total, pell_half_space_albedo(alpha, 1.3), 1e-13);
        make(PELL_PROFILE_DIPOLE, &m, false, &p);
        REQUIRE_REL(p.total, photons, 0.18);
        make(PELL_PROFILE_PHOTON_BEAM, &m, false, &p);
        REQUIRE_REL(p.total, photons, 0.10);
        make(PELL_PROFILE_PHOTON_BEAM, &m, true, &q);
        if (p.total < 1.0)
            REQUIRE_REL(p.total - q.total, oracle_number(row, "mc_R_single"), 2e-4);
        make(PELL_PROFILE_BETTER_DIPOLE, &m, false, &p);
        make(PELL_PROFILE_BETTER_DIPOLE, &m, true, &q);
        REQUIRE_REL(p.total, photons, 0.04);
        REQUIRE_REL(p.total - q.total, oracle_number(row, "mc_R_single"), 2e-4);
    }
    assert_int_equal(i, 33);
    json_array_foreach(oracle_get(root, "chandrasekhar_matched"), i, row)
        REQUIRE_REL(pell_half_space_albedo(oracle_number(row, "albedo"), 1.0), oracle_number(row, "exact"), 1e-8);
    row = oracle_get(root, "giovanelli");
    REQUIRE_NEAR(pell_half_space_albedo(0.9, 1.5), oracle_number(row, "Rd_per_transmitted_photon"), 3.0 * oracle_number(row, "se"));
    /* Single scattering in a medium without a boundary. */
    struct pell_medium m = medium_of(0.0, 1.0, 0.0, 1.0);
    struct pell_profile p, q;
    m.sigma_a[0] = 0.1; /* total below 1, where nothing is scaled */
    make(PELL_PROFILE_PHOTON_BEAM, &m, false, &p);
    make(PELL_PROFILE_PHOTON_BEAM, &m, true, &q);
    REQUIRE_REL((p.total - q.total) * 1.1, oracle_number(oracle_get(root, "single_scatter_matched_check"), "exact_R1_over_alpha"), 1e-5);
    json_decref(root);
}

static void a_half_space_without_absorption_returns_all(void **state)
{
    (void) state;
    for (double eta = 0.25; eta <= 4.0; eta *= 1.3)
        REQUIRE_NEAR(pell_half_space_albedo(1.0, eta), 1.0, 1e-12);
    double last = 0.0;
    for (int i = 1; i <= 1000; i++) {
        const double total = pell_half_space_albedo(i / 1000.0, 1.4);
        REQUIRE(total > last && total <= 1.0);
        last = total;
    }
    REQUIRE(pell_half_space_albedo(0.0, 1.3) == 0.0);
    REQUIRE(isnan(pell_half_space_albedo(-1e-9, 1.3)) && isnan(pell_half_space_albedo(NAN, 1.3)) &&
            isnan(pell_half_space_albedo(0.5, 0.2)) && isnan(pell_half_space_albedo(1.1, 1.3)) && isnan(pell_half_space_albedo(0.5, NAN)));
}

/* --- Angles ------------------------------------------------------------------------------------------------------------------------- */

struct left {
    double sum, square;
};

static void count_left(void *user, const struct pell_photon_exit *e)
{
    struct left *l = user;

    if (e->collisions > 0) {
        l->sum += e->weight;
        l->square += e->weight * e->weight;
    }
}

/* A half-space under an oblique beam, and photons in it. */
static void slanted_light_returns_what_photons_say(void **state)
{
    static const double albedos[] = { 0.5, 0.95, 0.999 }, cosines[] = { 0.05, 0.3, 0.7, 1.0 };
    enum { PHOTONS = SLOW ? 4000 : 60000 };
    (void) state;

    for (size_t i = 0; i < PELL_COUNT(albedos); i++)
        for (size_t j = 0; j < PELL_COUNT(cosines); j++) {
            const struct pell_photon_stack s = {
                .count = 1,
                .layer = { { 1.0 - albedos[i], albedos[i], 0.0, 1.4, INFINITY } },
                .n_above = 1.0,
                .n_below = 1.0,
                .mu_min = cosines[j],
                .mu_max = cosines[j],
                .inside = true,
                .roulette = 200,
                .collisions_max = 1 << 18,
            };
            struct pell_photon_sums sums = { .lost = 0.0 };
            struct left left = { 0.0, 0.0 };
            double mean, error;

            assert_null(pell_photon_fault(&s));
            pell_photon_walk(&s, 5 + i, 0, PHOTONS, count_left, NULL, &left, &sums);
            mean = left.sum / PHOTONS;
            error = sqrt(fmax(left.square / PHOTONS - mean * mean, 0.0) / PHOTONS);
            REQUIRE_NEAR(pell_half_space_albedo_at(albedos[i], 1.4, cosines[j]), mean, 3.5 * error);
        }
    REQUIRE_REL(pell_half_space_albedo_at(0.8, 1.33, 1.0), pell_half_space_albedo(0.8, 1.33), 1e-14);
    REQUIRE_NEAR(pell_half_space_albedo_at(1.0, 1.5, 0.2), 1.0, 1e-12);
    REQUIRE(isnan(pell_half_space_albedo_at(0.5, 1.3, 0.0)) && isnan(pell_half_space_albedo_at(0.5, 1.3, 1.1)) &&
            isnan(pell_half_space_albedo_at(2.0, 1.3, 1.0)));
}

/* One number per medium: the deviation of R(mu) from the line, and the mean by an integral over directions. */
static void a_slope_says_what_all_angles_return(void **state)
{
    static const double etas[] = { 1.2, 1.33, 1.5, 2.0 };
    (void) state;

    for (double albedo = 0.3; albedo < 0.9999; albedo += (1.0 - albedo) * 0.35)
        for (size_t i = 0; i < PELL_COUNT(etas); i++) {
            const double eta = etas[i], total = pell_half_space_albedo(albedo, eta);
            const struct pell_half_space_angle a = pell_half_space_angle_of(total, eta);
            double entered = 0.0, returned = 0.0;

            for (int k = 0; k < 50; k++) {
                const double mu = (k + 0.5) / 50.0, inside = sqrt(1.0 - (1.0 - mu * mu) / (eta * eta));
                const double exact = pell_half_space_albedo_at(albedo, eta, mu) / total, w = mu * (1.0 - pell_fresnel(eta, mu));
                REQUIRE_REL(1.0 + a.slope * (1.0 - inside), exact, eta < 1.3 ? 0.03 : 0.015);
                entered += w;
                returned += w * exact;
            }
            REQUIRE(a.slope > 0.0);
            REQUIRE_REL(a.mean, returned / entered, 4e-3);
        }
    const struct pell_half_space_angle none[] = { pell_half_space_angle_of(1.0, 1.4), pell_half_space_angle_of(0.0, 1.4),
                                                  pell_half_space_angle_of(NAN, 1.4), pell_half_space_angle_of(0.5, 1e9) };
    for (size_t i = 0; i < PELL_COUNT(none); i++)
        REQUIRE(none[i].slope == 0.0 && none[i].mean == 1.0);
}

/* --- Single scattering ------------------------------------------------------------------------------------------------------------- */

/* Three computations of one number: over depth and angle in closed form up to one integral, at normal incidence; over directions, at any
 * angle; and the radiance at pixels, integrated over the hemisphere outside. */
static void single_scattering_is_the_same_share_of_light_everywhere(void **state)
{
    static const double gs[] = { 0.0, -0.3, 0.6, 0.85 }, etas[] = { 1.0, 1.3, 1.5 }, mus[] = { 1.0, 0.7, 0.25 };
    (void) state;

    for (size_t i = 0; i < PELL_COUNT(gs); i++)
        for (size_t j = 0; j < PELL_COUNT(etas); j++) {
            const double g = gs[i], eta = etas[j];
            REQUIRE_REL(pell_single_scattering_albedo_at(g, eta, 1.0), pell_single_total(g, eta), 2e-4);
            for (size_t k = 0; k < PELL_COUNT(mus); k++) {
                const double in = sqrt(1.0 - (1.0 - mus[k] * mus[k]) / (eta * eta));
                double sum = 0.0;
                for (int a = 0; a < 400; a++)
                    for (int b = 0; b < 64; b++) {
                        const double mu = (a + 0.5) / 400.0, turn = 2.0 * PELL_PI * (b + 0.5) / 64.0;
                        const double cosine = mu * mus[k] + sqrt((1.0 - mu * mu) * (1.0 - mus[k] * mus[k])) * cos(turn);
                        const float inverse = (float) (1.0 / (eta * eta)), out = pell_single_cosine(inverse, (float) mu);
                        const float c = pell_single_phase_cosine(inverse, (float) cosine, (float) mus[k], (float) mu, (float) in, out);
                        sum += mu * (1.0 - pell_fresnel(eta, mu)) / (eta * eta) *
                               (double) pell_single_radiance(1.0f, (float) g, c, (float) in, out) * 2.0 * PELL_PI / (400.0 * 64.0);
                    }
                REQUIRE_REL(sum, pell_single_scattering_albedo_at(g, eta, in), 2e-3);
            }
        }
    REQUIRE(isnan(pell_single_scattering_albedo_at(1.0, 1.3, 1.0)) && isnan(pell_single_scattering_albedo_at(0.0, 1.3, 0.0)) &&
            isnan(pell_single_scattering_albedo_at(0.0, 1e9, 0.5)));
}

/* Single scattering at an angle plus the linear model of the rest is all light at that angle; at normal incidence to the last digit. */
static void single_and_multiple_scattering_are_all_light_at_every_angle(void **state)
{
    static const double albedos[] = { 0.5, 0.8, 0.95, 0.99 }, etas[] = { 1.3, 1.5 };
    (void) state;

    for (size_t i = 0; i < PELL_COUNT(albedos); i++)
        for (size_t j = 0; j < PELL_COUNT(etas); j++) {
            const double albedo = albedos[i], eta = etas[j], total = pell_half_space_albedo(albedo, eta);
            const struct pell_half_space_angle all = pell_half_space_angle_of(total, eta),
                                               a = pell_half_space_angle_multiple(total, albedo, eta, all);
            const double once = albedo * pell_single_scattering_albedo_at(0.0, eta, 1.0);
            for (int k = 1; k <= 20; k++) {
                const double mu = k / 20.0, in = sqrt(1.0 - (1.0 - mu * mu) / (eta * eta));
                const double sum = albedo * pell_single_scattering_albedo_at(0.0, eta, in) + (total - once) * (1.0 + a.slope * (1.0 - in));
                REQUIRE_REL(sum, pell_half_space_albedo_at(albedo, eta, mu), k == 20 ? 1e-5 : 0.015);
            }
            REQUIRE(a.slope < all.slope); /* more light leaves after single scattering the more obliquely it enters */
        }
    const struct pell_half_space_angle none[] = {
        pell_half_space_angle_multiple(1.0, 1.0, 1.4, (struct pell_half_space_angle) { 0.3, 1.1 }),
        pell_half_space_angle_multiple(0.01, 1.0, 1.4, (struct pell_half_space_angle) { 0.3, 1.1 }),
        pell_half_space_angle_multiple(0.5, NAN, 1.4, (struct pell_half_space_angle) { 0.3, 1.1 })
    };
    for (size_t i = 0; i < PELL_COUNT(none); i++)
        REQUIRE(none[i].slope == 0.0 && none[i].mean == 1.0);
}

/* --- Better dipole --------------------------------------------------------------------------------------------------------------- */

/* zv = zr + 4 A D, and the moments show in the transform of multiple scattering: R^(s) = (1 - single) alpha'^2/2 (C_phi/(D k) (e^-k zr -
 * e^-k zv) + C_E (e^-k zr + e^-k zv)). */
static void better_dipole_has_the_oracles_moments(void **state)
{
    json_t *root = oracle_load("dipole.json"), *row;
    size_t i;
    (void) state;
    json_array_foreach(oracle_get(root, "fresnel"), i, row)
    {
        const double eta = oracle_number(row, "eta"), c1 = oracle_number(row, "Fdr_exact");
        const double c2 = oracle_number(row, "second_moment_3intFmu2"), A = oracle_number(row, "A_better_dEon2012");
        const struct pell_medium m = medium_of(0.3, 1.2, 0.0, eta);
        const double st = 1.5, D = (2.0 * 0.3 + 1.2) / (3.0 * st * st), zr = 1.0 / st, zv = zr + 4.0 * A * D, alpha = 0.8;
        struct pell_profile p;
        make(PELL_PROFILE_BETTER_DIPOLE, &m, true, &p);
        for (double s = 0.0; s < 5.0; s += 0.7) {
            const double k = sqrt(0.3 / D + s * s);
            const double R =
                (1.0 - pell_single_total(0.0, eta)) * 0.5 * alpha * alpha *
                (0.25 * (1.0 - c1) / (D * k) * (exp(-k * zr) - exp(-k * zv)) + 0.5 * (1.0 - c2) * (exp(-k * zr) + exp(-k * zv)));
            REQUIRE_REL(pell_profile_transform(&p, s), R, 1e-9);
        }
    }
    assert_int_equal(i, 13);
    json_decref(root);
}

/* --- Normalised diffusion ------------------------------------------------------------------------------------------------------- */

static void normalized_diffusion_is_the_papers(void **state)
{
    (void) state;
    for (double eta = 1.0; eta < 1.6; eta += 0.25) {
        const struct pell_medium m = medium_of(0.1, 0.9, 0.0, eta);
        const double A = pell_half_space_albedo(0.9, 1.0), s = 1.85 - A + 7.0 * pow(fabs(A - 0.8), 3.0);
        const double total = pell_half_space_albedo(0.9, eta);
        struct pell_profile p;
        make(PELL_PROFILE_NORMALIZED_DIFFUSION, &m, false, &p);
        for (double r = 0.01; r < 20.0; r *= 1.3)
            REQUIRE_REL(pell_profile_eval(&p, r), total * s * (exp(-s * r) + exp(-s * r / 3.0)) / (8.0 * PELL_PI * r), 1e-13);
    }
}

/* Without a boundary, as for the paper's media, half of the light is inside the photons' median radius, within 6.5 %. */
static void normalized_diffusion_is_good_without_a_boundary(void **state)
{
    (void) state;
    for (double alpha = 0.3; alpha < 1.0; alpha += 0.069) {
        const struct pell_medium m = medium_of(1.0 - alpha, alpha, 0.0, 1.0);
        struct pell_profile p, q;
        make(PELL_PROFILE_NORMALIZED_DIFFUSION, &m, false, &p);
        make(PELL_PROFILE_MONTE_CARLO, &m, false, &q);
        REQUIRE_REL(pell_profile_sample(&p, 0.5), pell_profile_sample(&q, 0.5), 0.065);
    }
}

/* --- All models ------------------------------------------------------------------------------------------------------------------ */

static double shell(double log_r, const void *profile)
{
    const double r = exp(log_r);
    return 2.0 * PELL_PI * r * r * pell_profile_eval(profile, r);
}

static const double media[][4] = {
    /* sigma_a, sigma_s', g, eta */
    { 0.0041, 2.62, 0.0, 1.5 }, { 0.0, 20.4, 0.0, 1.3 },  { 1.45, 0.03, 0.3, 1.3 },   { 0.48, 1.01, 0.0, 1.0 },
    { 1e-5, 70.0, 0.9, 2.5 },   { 0.2, 0.32, -0.5, 1.4 }, { 0.061, 0.18, 0.8, 1.33 },
};

static void totals_are_integrals(void **state)
{
    (void) state;
    for (size_t i = 0; i < PELL_COUNT(media); i++)
        for (int k = 0; k < MODELS; k++) {
            const struct pell_medium m = medium_of(media[i][0], media[i][1], media[i][2], media[i][3]);
            const double l = 1.0 / (media[i][0] + media[i][1]);
            struct pell_profile p;
            make((enum pell_profile_model) k, &m, false, &p);
            REQUIRE(p.total > 0.0 && p.total <= 1.0);
            double sum = 0.0;
            for (double r = 1e-12 * l; r < 1e10 * l; r *= 10.0)
                sum += pell_integrate(shell, &p, log(r), log(10.0 * r), 1e-14, 1e-10, NULL);
            REQUIRE_REL(sum, p.total, 2e-6);
        }
}

static void cdf_sample_and_transform_agree(void **state)
{
    (void) state;
    for (size_t i = 0; i < PELL_COUNT(media); i++)
        for (int k = 0; k < MODELS; k++) {
            const struct pell_medium m = medium_of(media[i][0], media[i][1], media[i][2], media[i][3]);
            struct pell_profile p;
            double last = 0.0;
            make((enum pell_profile_model) k, &m, false, &p);
            for (int j = 1; j < 400; j++) {
                const double xi = j / 400.0, r = pell_profile_sample(&p, xi);
                REQUIRE(isfinite(r) && r > last);
                REQUIRE_NEAR(pell_profile_cdf(&p, r), xi, 1e-12);
                REQUIRE_REL(pell_profile_pdf(&p, r) * p.total, pell_profile_eval(&p, r), 1e-14);
                last = r;
            }
            REQUIRE_NEAR(pell_profile_transform(&p, 0.0), p.total, 1e-14);
            /* A low frequency reduces the transform by s^2 <r^2>/4 at most, a high one leaves almost nothing. */
            const double far = pell_profile_sample(&p, 0.9999), near = pell_profile_sample(&p, 1e-3);
            REQUIRE(pell_profile_transform(&p, 1e-3 / far) > 0.999 * p.total);
            REQUIRE(fabs(pell_profile_transform(&p, 1e3 / near)) < 2e-3 * p.total);
        }
}

static void units_cancel(void **state)
{
    static const double units[] = { 10.0, 1000.0, 1.0 / 3.0 };
    (void) state;
    for (size_t i = 0; i < PELL_COUNT(media); i++)
        for (int k = 0; k < MODELS; k++)
            for (size_t u = 0; u < PELL_COUNT(units); u++) {
                /* The photons' table is indexed by 1 - alpha', whose rounding matters where absorption is a ten-millionth. */
                const double f = units[u], same = k == PELL_PROFILE_MONTE_CARLO ? 1e-10 : 1e-12;
                const struct pell_medium a = medium_of(media[i][0], media[i][1], media[i][2], media[i][3]);
                const struct pell_medium b = medium_of(media[i][0] * f, media[i][1] * f, media[i][2], media[i][3]);
                struct pell_profile p, q;
                make((enum pell_profile_model) k, &a, false, &p);
                make((enum pell_profile_model) k, &b, false, &q);
                REQUIRE_REL(q.total, p.total, same);
                for (double r = pell_profile_sample(&p, 0.01), end = pell_profile_sample(&p, 0.9999); r < end; r *= 1.21) {
                    REQUIRE_REL(pell_profile_eval(&q, r / f) / (f * f), pell_profile_eval(&p, r), same);
                    REQUIRE_NEAR(pell_profile_cdf(&q, r / f), pell_profile_cdf(&p, r), same);
                }
            }
}

static void channels_do_not_know_each_other(void **state)
{
    const struct pell_medium m = { { 0.1, 0.02, 0.7 }, { 1.1, 2.0, 0.3 }, { 0.0, 0.5, -0.2 }, 1.4 };
    (void) state;
    for (int k = 0; k < MODELS; k++)
        for (int c = 0; c < 3; c++) {
            const struct pell_medium alone = medium_of(m.sigma_a[c], m.sigma_s_reduced[c], m.g[c], m.eta);
            struct pell_profile p, q;
            REQUIRE(pell_profile_make((enum pell_profile_model) k, &m, c, NULL, &p) == PELL_OK);
            make((enum pell_profile_model) k, &alone, false, &q);
            assert_memory_equal(&p, &q, sizeof(p));
        }
}

/* The same albedo with twice the mean free path: the median radius, and any other quantile, doubles. */
static void longer_mean_free_paths_spread_wider(void **state)
{
    (void) state;
    for (int k = 0; k < MODELS; k++)
        for (double xi = 0.1; xi < 1.0; xi += 0.2) {
            double last = 0.0;
            for (double sigma = 8.0; sigma > 0.1; sigma /= 2.0) {
                const struct pell_medium m = medium_of(0.1 * sigma, 0.9 * sigma, 0.0, 1.4);
                struct pell_profile p;
                make((enum pell_profile_model) k, &m, false, &p);
                const double r = pell_profile_sample(&p, xi);
                if (last > 0.0)
                    REQUIRE_REL(r, 2.0 * last, 1e-9);
                last = r;
            }
        }
}

static void limits_are_legal(void **state)
{
    static const double pairs[][2] = { { 0.0, 1.0 },  { 1.0, 0.0 },    { 1e6, 1e6 },   { 0.0, 1e-6 },
                                       { 1e-6, 0.0 }, { 1e6, 1e-300 }, { 1e-300, 1e6 } };
    static const double radii[] = { 0.0, 5e-324, 1e-200, 1e-8, 1.0, 1e100, 1e200, INFINITY, -1.0, NAN };
    static const double gs[] = { 0.0, PELL_G_MAX, -PELL_G_MAX }, etas[] = { 1.0, PELL_ETA_MIN, PELL_ETA_MAX, 1.0000001 };
    (void) state;
    for (int k = 0; k < MODELS; k++)
        for (size_t i = 0; i < PELL_COUNT(pairs); i++)
            for (size_t e = 0; e < PELL_COUNT(etas); e++)
                for (size_t j = 0; j < PELL_COUNT(gs); j++) {
                    const struct pell_medium m = medium_of(pairs[i][0], pairs[i][1], gs[j], etas[e]);
                    struct pell_profile p;
                    const enum pell_result res = pell_profile_make((enum pell_profile_model) k, &m, 0, NULL, &p);
                    if (res == PELL_ERR_UNSUPPORTED)
                        continue; /* a table's range may end before that of the index */
                    REQUIRE(res == PELL_OK && p.total >= 0.0 && p.total <= 1.0);
                    REQUIRE(pairs[i][1] > 0.0 || p.total == 0.0);
                    for (size_t r = 0; r < PELL_COUNT(radii); r++) {
                        const double R = pell_profile_eval(&p, radii[r]), cdf = pell_profile_cdf(&p, radii[r]);
                        REQUIRE(isfinite(R) && R >= 0.0 && cdf >= 0.0 && cdf <= 1.0);
                        REQUIRE(isfinite(pell_profile_transform(&p, radii[r])) && isfinite(pell_profile_sample(&p, radii[r])));
                        REQUIRE(!isnan(pell_profile_pdf(&p, radii[r])));
                    }
                    REQUIRE_NEAR(pell_profile_cdf(&p, INFINITY), 1.0, 1e-12);
                    REQUIRE(pell_profile_sample(&p, 0.0) == 0.0);
                }
}

/* Albedos down to the smallest double: light that can be normalised, or none. */
static void traces_of_light_are_none(void **state)
{
    struct pell_profile p;
    int none = 0;

    (void) state;
    for (int i = 0; i < MODELS; i++)
        for (int e = -280; e >= -324; e -= 4) {
            const struct pell_medium m = medium_of(1.0, pow(10.0, e), 0.0, 1.3);
            make((enum pell_profile_model) i, &m, false, &p);
            REQUIRE(p.total == 0.0 || p.total >= PELL_PROFILE_TOTAL_MIN);
            none += p.total == 0.0;
            if (p.total > 0.0)
                REQUIRE_REL(pell_profile_cdf(&p, pell_profile_sample(&p, 0.5)), 0.5, 1e-6);
        }
    REQUIRE(none > 0);
}

static void wrong_arguments_are_refused(void **state)
{
    const struct pell_medium good = medium_of(0.1, 1.0, 0.0, 1.3);
    const struct pell_medium bad[] = { medium_of(-1.0, 1.0, 0.0, 1.3), medium_of(NAN, 1.0, 0.0, 1.3), medium_of(0.1, INFINITY, 0.0, 1.3),
                                       medium_of(0.1, 1.0, 1.0, 1.3),  medium_of(0.1, 1.0, 0.0, 5.0), medium_of(0.0, 0.0, 0.0, 1.3) };
    const struct pell_profile_params wrong[] = { { .roughness = -0.1 },
                                                 { .roughness = NAN },
                                                 { .roughness = 1.1 },
                                                 { .A = -1.0 },
                                                 { .A = NAN },
                                                 { .A = 1e9 },
                                                 { .fresnel = (enum pell_fresnel_model) 7 } };
    const struct pell_profile_params alien[] = { { .without_single = true }, { .A = 2.0 } };
    struct pell_profile p;
    (void) state;
    for (int k = 0; k < MODELS; k++) {
        const enum pell_profile_model model = (enum pell_profile_model) k;
        for (size_t i = 0; i < PELL_COUNT(bad); i++)
            REQUIRE(pell_profile_make(model, &bad[i], 0, NULL, &p) == PELL_ERR_INVALID && p.total == 0.0);
        for (size_t i = 0; i < PELL_COUNT(wrong); i++)
            REQUIRE(pell_profile_make(model, &good, 0, &wrong[i], &p) == PELL_ERR_INVALID);
        REQUIRE(pell_profile_make(model, &good, 3, NULL, &p) == PELL_ERR_INVALID && pell_profile_make(model, &good, -1, NULL, &p) < 0);
        REQUIRE((pell_profile_make(model, &good, 0, &alien[0], &p) == PELL_OK) ==
                (model >= PELL_PROFILE_PHOTON_BEAM || model == PELL_PROFILE_BETTER_DIPOLE));
        REQUIRE((pell_profile_make(model, &good, 0, &alien[1], &p) == PELL_OK) == (model == PELL_PROFILE_DIPOLE));
    }
    REQUIRE(pell_profile_make((enum pell_profile_model) MODELS, &good, 0, NULL, &p) == PELL_ERR_INVALID);
}

/* A dipole with the same A is the same dipole; roughness changes A, and roughness 0 does not. */
static void roughness_changes_the_boundary(void **state)
{
    const struct pell_medium m = medium_of(0.05, 1.0, 0.0, 1.4);
    (void) state;
    for (double rough = 0.1; rough <= 1.0; rough += 0.3) {
        const double fdr = pell_fresnel_diffuse_rough(1.4, rough);
        const struct pell_profile_params a = { .roughness = rough }, b = { .A = (1.0 + fdr) / (1.0 - fdr) };
        struct pell_profile p, q;
        REQUIRE(pell_profile_make(PELL_PROFILE_DIPOLE, &m, 0, &a, &p) == PELL_OK);
        REQUIRE(pell_profile_make(PELL_PROFILE_DIPOLE, &m, 0, &b, &q) == PELL_OK);
        assert_memory_equal(&p, &q, sizeof(p));
        make(PELL_PROFILE_DIPOLE, &m, false, &q);
        REQUIRE(p.total != q.total);
        REQUIRE(pell_profile_make(PELL_PROFILE_BETTER_DIPOLE, &m, 0, &a, &p) == PELL_OK);
        make(PELL_PROFILE_BETTER_DIPOLE, &m, false, &q);
        REQUIRE(p.total != q.total && fabs(p.total - q.total) < 0.1);
    }
    for (int k = PELL_PROFILE_DIPOLE; k <= PELL_PROFILE_PHOTON_BEAM; k++) {
        const struct pell_medium white = medium_of(0.0, 1.0, 0.0, 1.4);
        const struct pell_profile_params rough = { .roughness = 0.5 };
        struct pell_profile p;
        const enum pell_result res = pell_profile_make((enum pell_profile_model) k, &white, 0, &rough, &p);
        REQUIRE(k == PELL_PROFILE_NORMALIZED_DIFFUSION ? res == PELL_ERR_UNSUPPORTED : res == PELL_OK);
        if (res == PELL_OK)
            REQUIRE_NEAR(p.total, 1.0, 1e-9);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(models_are_found_by_name),
        cmocka_unit_test(radial_profiles_of_photons),
        cmocka_unit_test(totals_of_photons),
        cmocka_unit_test(a_half_space_without_absorption_returns_all),
        cmocka_unit_test(slanted_light_returns_what_photons_say),
        cmocka_unit_test(a_slope_says_what_all_angles_return),
        cmocka_unit_test(single_scattering_is_the_same_share_of_light_everywhere),
        cmocka_unit_test(single_and_multiple_scattering_are_all_light_at_every_angle),
        cmocka_unit_test(better_dipole_has_the_oracles_moments),
        cmocka_unit_test(normalized_diffusion_is_the_papers),
        cmocka_unit_test(normalized_diffusion_is_good_without_a_boundary),
        cmocka_unit_test(totals_are_integrals),
        cmocka_unit_test(cdf_sample_and_transform_agree),
        cmocka_unit_test(units_cancel),
        cmocka_unit_test(channels_do_not_know_each_other),
        cmocka_unit_test(longer_mean_free_paths_spread_wider),
        cmocka_unit_test(limits_are_legal),
        cmocka_unit_test(traces_of_light_are_none),
        cmocka_unit_test(wrong_arguments_are_refused),
        cmocka_unit_test(roughness_changes_the_boundary),
    };
    return cmocka_run_group_tests_name("optics.profile_models", tests, NULL, NULL);
}
