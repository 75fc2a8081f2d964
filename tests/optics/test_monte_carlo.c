/* SPDX-License-Identifier: MIT
 * test_monte_carlo.c - the monte-carlo model and its table: against exact totals, photons of others, our own photons between the nodes,
 * and properties of every profile. */
#include "math/quadrature.h"
#include "math/vec.h"
#include "optics/photon/table.h"
#include "optics/profile/shape.h"
#include "oracle.h"
#include "photons.h"

/* Relative error that interpolation adds to the errors of the nodes: for totals, which have a kink at eta = 1, and for the flux through
 * rings. Measured at the media below with twenty times the photons. */
#define BETWEEN_TOTAL(eta) ((eta) < 1.1 ? 1e-2 : 2e-3)
#define BETWEEN_R(g, eta) ((g) < 0.0 ? 3e-2 : (eta) < 1.1 ? 2e-2 : 1e-2)

static const struct pell_photon_table *const table = &pell_photon_table_data;

static struct pell_medium medium_of(double albedo_reduced, double g, double eta, double sigma_t_reduced)
{
    const double s = albedo_reduced * sigma_t_reduced, a = sigma_t_reduced - s;
    return (struct pell_medium) { { a, a, a }, { s, s, s }, { g, g, g }, eta };
}

static void make(const struct pell_medium *m, bool without_single, struct pell_profile *p)
{
    const struct pell_profile_params params = { .without_single = without_single };
    assert_int_equal(pell_profile_make(PELL_PROFILE_MONTE_CARLO, m, 1, &params, p), PELL_OK);
}

/* Index of the node below x. */
static int below(const double *axis, int count, double x)
{
    int i = 0;
    while (i < count - 2 && x >= axis[i + 1])
        i++;
    return i;
}

/* The largest standard errors of the nodes around a medium: of its total; of R at a radius in reduced mean free paths, relative. */
static void errors_near(double albedo_reduced, double g, double eta, double r, double *total, double *relative)
{
    const int v = below(table->v, PELL_TABLE_ALPHA, sqrt(1.0 - albedo_reduced)), ig = below(table->g, PELL_TABLE_G, g),
              ie = below(table->eta, PELL_TABLE_ETA, eta);
    const int k = (int) fmin(fmax((log(r) - pell_table_x(0)) / (pell_table_x(1) - pell_table_x(0)), 0.0), PELL_TABLE_R - 2.0);
    *total = *relative = 0.0;
    for (int i = 0; i < 16; i++) {
        const int a = ig + (i & 1), b = ie + (i >> 1 & 1), c = v + (i >> 2 & 1), code = table->error[a][b][c][k + (i >> 3)];
        *total = fmax(*total, table->total_error[a][b][c]);
        *relative = fmax(*relative, code == PELL_TABLE_NO_ERROR ? 1.0 : 1e-4 * exp2(code / 8.0));
    }
}

/* --- Components with a closed form -------------------------------------------------------------------------------------------- */

static double shell(double x, const void *arg)
{
    return 2.0 * PELL_PI * exp(2.0 * x) * pell_single_rd(arg, exp(x));
}

static double once_at_one(double t, const void *arg)
{
    (void) arg;
    return sin(t) * exp(-(1.0 + sin(t)) / cos(t)) / (4.0 * PELL_PI);
}

static void single_scattering_has_its_closed_form(void **state)
{
    static const double cases[][2] = {
        { 0.0, 1.0 }, { 0.0, 1.4 }, { 0.8, 1.3 }, { -0.7, 1.5 }, { 0.99, 1.1 }, { 0.3, 0.5 }, { -0.95, 4.0 },
    };
    (void) state;
    REQUIRE_NEAR(pell_single_total(0.0, 1.0), 0.5 * (1.0 - log(2.0)), 1e-9); /* Chandrasekhar 1960 */
    for (size_t i = 0; i < PELL_COUNT(cases); i++) {
        struct pell_single s;
        pell_single_make(cases[i][0], cases[i][1], &s);
        REQUIRE_REL(pell_integrate(shell, &s, log(1e-9), log(600.0), 0.0, 1e-9, NULL), s.total, 1e-6);
    }
    struct pell_single s;
    pell_single_make(0.0, 1.0, &s);
    REQUIRE(pell_single_rd(&s, 800.0) == 0.0);
    /* Toward the axis tau R = Int_0^(pi/2) sin t dt / (4 pi). */
    REQUIRE_REL(1e-7 * pell_single_rd(&s, 1e-7), 1.0 / (4.0 * PELL_PI), 1e-5);
    /* tau = 1 by another quadrature. */
    REQUIRE_REL(pell_single_rd(&s, 1.0), pell_integrate(once_at_one, NULL, 0.0, 0.5 * PELL_PI, 0.0, 1e-12, NULL), 1e-10);
}

static void the_far_field_decays_as_transport_says(void **state)
{
    (void) state;
    for (double alpha = 0.3; alpha < 0.9999; alpha += 0.07) { /* isotropic: alpha artanh(k)/k = 1 (Case and Zweifel 1967) */
        const double k = pell_transport_kappa(alpha, 0.0);
        REQUIRE_NEAR(alpha * atanh(k) / k, 1.0, 1e-4);
    }
    for (int i = 0; i < PELL_TABLE_G; i++) {
        const double g = table->g[i], alpha = 1.0 - 1e-7;
        REQUIRE_REL(pell_transport_kappa(alpha, g), sqrt(3.0 * (1.0 - alpha) * (1.0 - alpha * g)), 1e-5); /* diffusion */
        REQUIRE(pell_transport_kappa(1.0, g) == 0.0);
        REQUIRE_NEAR(pell_transport_kappa(0.0, g), 1.0, 1e-3);
        double last = 1.0;
        for (double a = 0.0; a <= 1.0; a += 0.01) {
            const double k = pell_transport_kappa(a, g);
            REQUIRE(k <= last + 1e-12 && k >= 0.0);
            last = k;
        }
    }
    REQUIRE_REL(pell_transport_kappa(0.9, 0.0), 0.525430, 1e-5); /* Case, de Hoffmann and Placzek 1953: 1/1.903205 */
}

/* --- Against exact totals and other photons ----------------------------------------------------------------------------------- */

/* Isotropic scattering behind a boundary has an exact total (half_space.c); also for indices between the nodes. */
static void totals_are_the_exact_ones(void **state)
{
    static const double indices[] = { 1.0, 1.05, 1.1, 1.25, 1.3, 1.33, 1.4, 1.45, 1.6, 1.9, 2.1 };
    static const double albedos[] = { 0.02, 0.2, 0.4, 0.55, 0.7, 0.8, 0.9, 0.95, 0.98, 0.99, 0.997, 0.9995, 1.0 };
    double worst = 0.0;
    (void) state;
    for (size_t i = 0; i < PELL_COUNT(indices); i++) {
        for (size_t k = 0; k < PELL_COUNT(albedos); k++) {
            const struct pell_medium m = medium_of(albedos[k], 0.0, indices[i], 1.0);
            const double exact = pell_half_space_albedo(albedos[k], indices[i]);
            struct pell_profile p;
            double error, unused;
            make(&m, false, &p);
            errors_near(albedos[k], 0.0, indices[i], 1.0, &error, &unused);
            REQUIRE_NEAR(p.total, exact, 3.0 * error + BETWEEN_TOTAL(indices[i]) * exact);
            worst = fmax(worst, fabs(p.total / exact - 1.0));
        }
    }
    print_message("# worst total %.3f %%\n", 100.0 * worst);
}

static void oracle_totals(void **state)
{
    json_t *root = oracle_load("montecarlo.json"), *list, *row;
    size_t i;
    (void) state;
    list = oracle_get(oracle_get(root, "semi_infinite_eta1.3_total_albedo"), "table");
    json_array_foreach(list, i, row)
    {
        const double alpha = oracle_number(row, "alpha"), cut = oracle_number(row, "truncation_bias_bound");
        const struct pell_medium m = medium_of(alpha, 0.0, 1.3, 1.0);
        struct pell_profile p, multiple;
        double error, unused;
        make(&m, false, &p);
        make(&m, true, &multiple);
        errors_near(alpha, 0.0, 1.3, 1.0, &error, &unused);
        REQUIRE_NEAR(p.total, oracle_number(row, "mc_R"), 3.0 * hypot(error, oracle_number(row, "mc_se")) + cut);
        REQUIRE_NEAR(p.total - multiple.total, oracle_number(row, "mc_R_single"), 3.0 * sqrt(0.07 / 1e7));
    }
    assert_int_equal(i, 33);
    json_decref(root);
}

/* Flux through the oracle's rings. Of 250 rings one may be off by more than three standard errors of both. */
static void oracle_radial_profiles(void **state)
{
    json_t *root = oracle_load("montecarlo.json"), *row;
    size_t i, rings = 0, outside = 0;
    double squares = 0.0;
    (void) state;
    json_array_foreach(oracle_get(root, "radial_profiles"), i, row)
    {
        const double ss = oracle_number(row, "sigma_sp"), sa = oracle_number(row, "sigma_a"), eta = oracle_number(row, "eta");
        const struct pell_medium m = medium_of(ss / (sa + ss), 0.0, eta, sa + ss);
        struct pell_profile p;
        make(&m, false, &p);
        for (size_t k = 0; k + 1 < json_array_size(oracle_get(row, "bin_edges_mm")); k++) {
            const double a = oracle_at(row, "bin_edges_mm", k), b = oracle_at(row, "bin_edges_mm", k + 1);
            const double theirs = oracle_at(row, "mc_R", k), se = oracle_at(row, "mc_se", k);
            double unused, error;
            errors_near(ss / (sa + ss), 0.0, eta, 0.5 * (a + b) * (sa + ss), &unused, &error);
            if (!(theirs > 0.0) || se > 0.05 * theirs || error > 0.2) /* rare photons: the standard error cannot be estimated */
                continue;
            const double ours = p.total * (pell_profile_cdf(&p, b) - pell_profile_cdf(&p, a)) / (PELL_PI * (b * b - a * a));
            const double z = (ours - theirs) / hypot(se, error * ours);
            squares += z * z;
            rings++;
            outside += fabs(z) > 3.0;
            if (fabs(z) > 4.5)
                fail_msg("profile %zu, ring %g..%g mm: %g, expected %g +- %g", i, a, b, ours, theirs, se);
        }
    }
    print_message("# %zu rings, %zu outside of three errors, mean square %.2f\n", rings, outside, squares / (double) rings);
    assert_int_equal(i, 6);
    REQUIRE(rings > 200 && outside <= rings / 100 && squares < 2.0 * (double) rings);
    json_decref(root);
}

/* --- Our own photons, between the nodes --------------------------------------------------------------------------------------- */

enum { BATCHES = 16, RINGS = 10 };

struct count {
    double alpha, width; /* single-scattering albedo; rings' lower edges are 0.1 l' 10^(ring/5) */
    double total[BATCHES], ring[RINGS][BATCHES];
    int batch;
};

static void leave(void *user, const struct pell_photon_exit *e)
{
    struct count *c = user;
    const double w = e->weight * pow(c->alpha, e->collisions), at = 5.0 * log10(10.0 * fmax(e->radius, 1e-9) * c->width);
    c->total[c->batch] += w;
    if (at >= 0.0 && at < RINGS)
        c->ring[(int) at][c->batch] += w;
}

/* Photons that enter a half-space at right angles; their number in each batch. */
static double shoot(double albedo, double g, double eta, uint64_t seed, struct count *c)
{
    const double alpha = pell_albedo_of_reduced(albedo, g);
    const struct pell_photon_stack s = photons_in_layer(0.0, 1.0, g, eta, INFINITY);
    const int each = (int) (60000.0 * (1.0 - fmax(g, 0.0))) / BATCHES;
    struct pell_photon_sums sums = { 0 };

    *c = (struct count) { .alpha = alpha, .width = 1.0 - alpha * g };
    for (c->batch = 0; c->batch < BATCHES; c->batch++)
        pell_photon_walk(&s, seed, (uint64_t) (c->batch * each), (uint64_t) each, leave, NULL, c, &sums);
    return each;
}

static double mean_of(const double *x, double *error)
{
    double mean = 0.0, squares = 0.0;
    for (int i = 0; i < BATCHES; i++)
        mean += x[i] / BATCHES;
    for (int i = 0; i < BATCHES; i++)
        squares += (x[i] - mean) * (x[i] - mean);
    *error = sqrt(squares / (BATCHES * (BATCHES - 1)));
    return mean;
}

static void photons_between_the_nodes(void **state)
{
    static const double nodes_between[][3] = {
        { 0.95, 0.12, 1.36 }, { 0.6, 0.4, 1.05 }, { 0.99, 0.6, 1.45 }, { 0.85, 0.78, 1.33 }, { 0.8, -0.15, 1.6 },
    };
    double largest = 0.0;
    (void) state;
    for (size_t i = 0; i < PELL_COUNT(nodes_between); i++) {
        const double albedo = nodes_between[i][0], g = nodes_between[i][1], eta = nodes_between[i][2];
        const struct pell_medium m = medium_of(albedo, g, eta, 1.0);
        struct pell_profile p;
        struct count c;
        double se, table_error, unused;

        make(&m, false, &p);
        const double each = shoot(albedo, g, eta, 7 + i, &c), total = mean_of(c.total, &se) / each;
        errors_near(albedo, g, eta, 1.0, &table_error, &unused);
        REQUIRE_NEAR(p.total, total, 3.3 * hypot(se / each, table_error) + BETWEEN_TOTAL(eta) * total);
        for (int k = 0; k < RINGS; k++) {
            const double a = 0.1 * pow(10.0, k / 5.0), b = 0.1 * pow(10.0, (k + 1) / 5.0), flux = mean_of(c.ring[k], &se) / each;
            const double ours = p.total * (pell_profile_cdf(&p, b) - pell_profile_cdf(&p, a));
            errors_near(albedo, g, eta, sqrt(a * b), &unused, &table_error);
            REQUIRE_NEAR(ours, flux, 3.6 * hypot(se / each, table_error * flux) + BETWEEN_R(g, eta) * flux);
            if (se / each < 0.01 * flux)
                largest = fmax(largest, fabs(ours / flux - 1.0));
        }
    }
    print_message("# largest difference in a ring that is known to 1 %%: %.2f %%\n", 100.0 * largest);
}

/* Beyond the table's indices totals are exact, and rings are where photons leave within the error of a dipole's change. Below its g totals
 * are those of the last one. */
static void media_beyond_the_table_are_those_of_photons(void **state)
{
    static const double media[][3] = { { 0.99, 0.0, 2.5 }, { 0.9, 0.5, 3.5 }, { 0.98, 0.0, 0.6 }, { 0.7, 0.0, 4.0 }, { 0.99, -0.5, 1.3 } };
    double largest = 0.0;
    (void) state;

    for (size_t i = 0; i < PELL_COUNT(media); i++) {
        const struct pell_medium m = medium_of(media[i][0], media[i][1], media[i][2], 1.0);
        struct pell_profile p;
        struct count c;
        double se;

        make(&m, false, &p);
        const double each = shoot(media[i][0], media[i][1], media[i][2], 70 + i, &c), total = mean_of(c.total, &se) / each;
        REQUIRE_NEAR(p.total, total, 3.3 * se / each + (media[i][1] < table->g[0] ? 0.02 : 0.003) * total);
        for (int k = 0; k < RINGS && media[i][1] >= table->g[0]; k++) {
            const double a = 0.1 * pow(10.0, k / 5.0), b = 0.1 * pow(10.0, (k + 1) / 5.0), flux = mean_of(c.ring[k], &se) / each;
            const double ours = p.total * (pell_profile_cdf(&p, b) - pell_profile_cdf(&p, a));
            REQUIRE_NEAR(ours, flux, 3.6 * se / each + 0.25 * flux);
            if (se / each < 0.02 * flux)
                largest = fmax(largest, fabs(ours / flux - 1.0));
        }
    }
    print_message("# largest difference in a ring that is known to 2 %%: %.0f %%\n", 100.0 * largest);
}

/* --- Properties of every profile ---------------------------------------------------------------------------------------------- */

static void rises_with_albedo_and_falls_with_radius(void **state)
{
    static const double gs[] = { 0.0, 0.13, 0.6, 0.9 }, etas[] = { 1.0, 1.22, 1.4, 2.0 };
    (void) state;
    for (size_t i = 0; i < 16; i++) {
        struct pell_profile last = { 0 };
        for (int k = 0; k <= 100; k++) {
            const double v = 1.0 - k / 100.0;
            const struct pell_medium m = medium_of(1.0 - v * v, gs[i % 4], etas[i / 4], 1.0);
            struct pell_profile p;
            make(&m, false, &p);
            REQUIRE(p.total >= last.total && p.total <= 1.0);
            double previous = HUGE_VAL;
            for (double r = 1e-3; r < 300.0; r *= 1.3) {
                const double R = pell_profile_eval(&p, r);
                REQUIRE(isfinite(R) && R >= 0.0 && R <= previous);
                previous = R;
                /* The weight of a fixed path increases with alpha; for g = 0 its position stays the same in units of l'. */
                if (gs[i % 4] == 0.0 && k > 0 && r < 100.0)
                    REQUIRE(R >= pell_profile_eval(&last, r) * (1.0 - 1e-3));
            }
            last = p;
        }
        REQUIRE_NEAR(last.total, 1.0, 1e-9); /* alpha' = 1 */
    }
}

static void without_absorption_all_comes_back(void **state)
{
    (void) state;
    for (int ig = 0; ig < PELL_TABLE_G; ig++) {
        for (int ie = 0; ie < PELL_TABLE_ETA; ie++) {
            const struct pell_medium m = medium_of(1.0, table->g[ig], table->eta[ie], 3.0);
            struct pell_profile p;
            make(&m, false, &p);
            REQUIRE_NEAR(p.total, 1.0, 1e-9);
            REQUIRE_REL(pell_profile_eval(&p, 3000.0) / pell_profile_eval(&p, 1500.0), 0.125, 1e-9); /* r^-3 */
            REQUIRE_NEAR(pell_profile_cdf(&p, 1e9), 1.0, 1e-6);
        }
    }
    const struct pell_medium black = { { 1.0, 1.0, 1.0 }, { 0.0, 0.0, 0.0 }, { 0.0, 0.0, 0.0 }, 1.3 };
    struct pell_profile p;
    make(&black, false, &p);
    REQUIRE(pell_profile_total(&p) == 0.0 && pell_profile_eval(&p, 1.0) == 0.0);
}

static void single_scattering_comes_apart(void **state)
{
    static const double gs[] = { 0.0, 0.5, 0.8 };
    (void) state;
    for (size_t i = 0; i < PELL_COUNT(gs); i++) {
        const struct pell_medium m = medium_of(0.8, gs[i], 1.4, 2.0);
        const double alpha = pell_albedo_of_reduced(0.8, gs[i]), sigma_t = 2.0 / (1.0 - alpha * gs[i]);
        struct pell_profile all, multiple;
        struct pell_single s;
        pell_single_make(gs[i], 1.4, &s);
        make(&m, false, &all);
        make(&m, true, &multiple);
        REQUIRE_REL(all.total - multiple.total, alpha * pell_single_total(gs[i], 1.4), 1e-12);
        for (int k = 2; k < all.count && all.r[k] < 2.0; k++) { /* at the nodes, up to the effect of scaling to the total */
            const double once = alpha * sigma_t * sigma_t * pell_single_rd(&s, sigma_t * all.r[k]);
            REQUIRE_NEAR(all.value[k] - multiple.value[k], once, 2e-2 * all.value[k]);
        }
    }
}

static void units_cancel(void **state)
{
    (void) state;
    for (double unit = 1e-3; unit < 1e4; unit *= 10.0) {
        const struct pell_medium one = medium_of(0.93, 0.3, 1.37, 1.0), other = medium_of(0.93, 0.3, 1.37, unit);
        struct pell_profile p, q;
        make(&one, false, &p);
        make(&other, false, &q);
        REQUIRE_REL(q.total, p.total, 1e-12);
        for (double r = 0.01; r < 50.0; r *= 2.0)
            REQUIRE_REL(pell_profile_eval(&q, r / unit), unit * unit * pell_profile_eval(&p, r), 1e-10);
    }
}

/* Beyond the table: clamped at its edges, never more light than enters. */
static void extremes_are_held(void **state)
{
    static const double gs[] = { -PELL_G_MAX, -0.3, 0.91, 0.97, PELL_G_MAX }, etas[] = { PELL_ETA_MIN, 0.8, 1.0, 2.1, PELL_ETA_MAX };
    static const double albedos[] = { 1e-12, 0.5, 1.0 - 1e-12, 1.0 }, units[] = { PELL_SIGMA_T_MIN * 2.0, 1.0, 1e6 };
    (void) state;
    for (size_t i = 0; i < 5 * 5 * 4 * 3; i++) {
        const struct pell_medium m = medium_of(albedos[i % 4], gs[i / 4 % 5], etas[i / 20 % 5], units[i / 100]);
        for (int w = 0; w < 2; w++) {
            struct pell_profile p;
            make(&m, w == 1, &p);
            REQUIRE(p.total >= 0.0 && p.total <= 1.0 + 1e-12);
            for (double r = 0.0; r < 1e9; r = r * 10.0 + 1e-9)
                REQUIRE(isfinite(pell_profile_eval(&p, r)) && pell_profile_eval(&p, r) >= 0.0);
            REQUIRE(isfinite(pell_profile_sample(&p, 0.999)) && isfinite(pell_profile_cdf(&p, 1.0)));
        }
    }
    const struct pell_medium edge = medium_of(0.9, 0.0, 2.1, 1.0), beyond = medium_of(0.9, 0.0, 2.1 * (1.0 + 1e-9), 1.0);
    struct pell_profile p, q;
    make(&edge, true, &p);
    make(&beyond, true, &q);
    REQUIRE_REL(p.total, q.total, 1e-6);
    REQUIRE_REL(pell_profile_eval(&p, 3.0), pell_profile_eval(&q, 3.0), 1e-6);
}

static void what_photons_have_not_seen_is_refused(void **state)
{
    const struct pell_medium m = medium_of(0.9, 0.0, 1.3, 1.0);
    const struct pell_profile_params params[] = { { .A = 2.0 }, { .roughness = 0.3 }, { .fresnel = PELL_FRESNEL_POLY3 } };
    (void) state;
    for (size_t i = 0; i < PELL_COUNT(params); i++) {
        struct pell_profile p;
        assert_int_equal(pell_profile_make(PELL_PROFILE_MONTE_CARLO, &m, 0, &params[i], &p), PELL_ERR_UNSUPPORTED);
        REQUIRE(p.total == 0.0);
    }
    enum pell_profile_model model;
    REQUIRE(pell_profile_model_find("monte-carlo", &model) && model == PELL_PROFILE_MONTE_CARLO);
    REQUIRE(pell_profile_model_at(model)->limits[0] != '\0');
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(single_scattering_has_its_closed_form),
        cmocka_unit_test(the_far_field_decays_as_transport_says),
        cmocka_unit_test(totals_are_the_exact_ones),
        cmocka_unit_test(oracle_totals),
        cmocka_unit_test(oracle_radial_profiles),
        cmocka_unit_test(photons_between_the_nodes),
        cmocka_unit_test(media_beyond_the_table_are_those_of_photons),
        cmocka_unit_test(rises_with_albedo_and_falls_with_radius),
        cmocka_unit_test(without_absorption_all_comes_back),
        cmocka_unit_test(single_scattering_comes_apart),
        cmocka_unit_test(units_cancel),
        cmocka_unit_test(extremes_are_held),
        cmocka_unit_test(what_photons_have_not_seen_is_refused),
    };
    return cmocka_run_group_tests_name("monte_carlo", tests, NULL, NULL);
}
