/* SPDX-License-Identifier: MIT
 * test_photon.c - photon tracing against published values and closed forms. Errors are from 20 batches; seeds are fixed. */
#include "photons.h"
#include "slow.h"

#include "base/pool.h"
#include "math/vec.h"
#include "optics/photon/table.h"
#include "optics/profile/shape.h"
#include "oracle.h"

#include <pellucid/medium.h>

enum { BATCHES = 20, ALBEDOS = 8 };

/* --- Tallies ------------------------------------------------------------------------------------------------------------------ */

struct count {
    double albedo[ALBEDOS]; /* 0: end of list; weights are multiplied by albedo^n */
    double face[2][ALBEDOS], once, straight[2], band;
    double mu_min, mu_max; /* of `band`: light that leaves the upper face between these cosines */
    double ring[12], ring_width;
    struct pell_photon_sums sums;
};

static void leave(void *user, const struct pell_photon_exit *e)
{
    struct count *c = user;
    assert_true(e->weight > 0.0 && isfinite(e->weight) && e->radius >= 0.0 && isfinite(e->radius) && e->mu >= 0.0 && e->mu <= 1.0 + 1e-12);
    if (e->collisions == 0) {
        c->straight[e->face] += e->weight;
        return;
    }
    if (e->collisions == 1 && e->face == 0)
        c->once += e->weight;
    for (int i = 0; i < ALBEDOS && c->albedo[i] > 0.0; i++)
        c->face[e->face][i] += e->weight * pow(c->albedo[i], e->collisions);
    if (e->face == 0 && e->mu >= c->mu_min && e->mu < c->mu_max)
        c->band += e->weight;
    const double ring = e->radius / c->ring_width;
    if (e->face == 0 && c->ring_width > 0.0 && ring < 12.0)
        c->ring[(int) ring] += e->weight;
}

struct estimate {
    double mean, error;
};

static struct estimate statistics(const double *x)
{
    struct estimate r = { 0 };
    double squares = 0.0;
    for (int i = 0; i < BATCHES; i++)
        r.mean += x[i] / BATCHES;
    for (int i = 0; i < BATCHES; i++)
        squares += (x[i] - r.mean) * (x[i] - r.mean);
    r.error = sqrt(squares / (BATCHES * (BATCHES - 1)));
    return r;
}

/* Runs `photons` of them; *all is the sum over batches, per photon, and `get` selects a value with its error. */
static struct count batches[BATCHES];

static void run(const struct pell_photon_stack *stack, const struct count *setup, uint64_t seed, uint64_t photons)
{
    const uint64_t each = photons / BATCHES;
    if (pell_photon_fault(stack))
        fail_msg("%s is out of range", pell_photon_fault(stack));
    for (int b = 0; b < BATCHES; b++) {
        struct count *c = &batches[b];
        *c = *setup;
        pell_photon_walk(stack, seed, (uint64_t) b * each, each, leave, NULL, c, &c->sums);
        double *numbers[] = { c->face[0], c->face[1], &c->once, c->straight, &c->band, c->ring, c->sums.absorbed, &c->sums.lost };
        const int lengths[] = { ALBEDOS, ALBEDOS, 1, 2, 1, 12, PELL_PHOTON_LAYERS, 1 };
        for (size_t i = 0; i < PELL_COUNT(numbers); i++)
            for (int k = 0; k < lengths[i]; k++)
                numbers[i][k] /= (double) each;
    }
}

#define RESULT(name, field)                                                                                                                \
    struct estimate name;                                                                                                                  \
    do {                                                                                                                                   \
        double x_[BATCHES];                                                                                                                \
        for (int b_ = 0; b_ < BATCHES; b_++)                                                                                               \
            x_[b_] = batches[b_].field;                                                                                                    \
        name = statistics(x_);                                                                                                             \
    } while (0)

/* Within three standard errors of a value that has an error (or rounding) itself. */
#define REQUIRE_WITHIN(measured, expected, other_error)                                                                                    \
    do {                                                                                                                                   \
        const struct estimate r_ = (measured);                                                                                             \
        const double o_ = (other_error), e_ = sqrt(r_.error * r_.error + o_ * o_);                                                         \
        if (!(fabs(r_.mean - (expected)) <= 3.0 * e_))                                                                                     \
            fail_msg("%s = %.6g +- %.2g, expected %.6g +- %.2g", #measured, r_.mean, r_.error, (double) (expected), o_);                   \
    } while (0)

static struct pell_photon_stack half_space(double sigma_a, double sigma_s, double g, double eta)
{
    struct pell_photon_stack s = photons_in_layer(sigma_a, sigma_s, g, eta, INFINITY);

    s.roulette = 0;
    s.collisions_max = 20000;
    return s;
}

static struct pell_photon_stack slab(double sigma_a, double sigma_s, double g, double n, double d)
{
    struct pell_photon_stack s = half_space(sigma_a, sigma_s, g, n);
    s.layer[0].thickness = d;
    return s;
}

/* --- Published numbers -------------------------------------------------------------------------------------------------------- */

/* van de Hulst 1980, "Multiple Light Scattering", table 35, as quoted by Wang, Jacques and Zheng 1995 (1/cm, cm). */
static void van_de_hulst_slab(void **state)
{
    const struct pell_photon_stack s = slab(10.0, 90.0, 0.75, 1.0, 0.02);
    const struct count setup = { .albedo = { 1.0 } };
    (void) state;
    run(&s, &setup, 1, 400000);
    RESULT(reflected, face[0][0]);
    RESULT(through, face[1][0]);
    RESULT(straight, straight[1]);
    const struct estimate total = { through.mean + straight.mean, hypot(through.error, straight.error) };
    REQUIRE_WITHIN(reflected, 0.09739, 5e-6);
    REQUIRE_WITHIN(total, 0.66096, 5e-6);
    REQUIRE_WITHIN(straight, exp(-2.0), 0.0);
    REQUIRE(reflected.error < 5e-4 && total.error < 1e-3);
}

/* Giovanelli 1955: 0.2600 of all light, including the specular 4 %. A run without absorption must give the same as runs with absorbing
 * layers. */
static void giovanelli_half_space(void **state)
{
    struct pell_photon_stack s = half_space(10.0, 90.0, 0.0, 1.5);
    struct count setup = { .albedo = { 1.0 } };
    (void) state;
    s.inside = false;
    run(&s, &setup, 2, 400000);
    RESULT(scattered, face[0][0]);
    RESULT(specular, straight[0]);
    const struct estimate total = { scattered.mean + specular.mean, hypot(scattered.error, specular.error) };
    REQUIRE_WITHIN(specular, 0.04, 0.0);
    REQUIRE_WITHIN(total, 0.2600, 5e-5);

    s = half_space(0.0, 100.0, 0.0, 1.5);
    s.roulette = 64;
    setup.albedo[0] = 0.9;
    run(&s, &setup, 33, 250000);
    RESULT(by_collisions, face[0][0]);
    REQUIRE_WITHIN(by_collisions, 0.228964517, 5.5e-5); /* tests/expect/oracle/montecarlo.json, giovanelli */
}

/* The example of the MCML manual (Wang and Jacques 1992; example.mco of its distribution, 10^6 photons, cm): three layers of index 1.37
 * in air. Its errors are assumed to equal ours at the same number of photons. */
static void mcml_layers(void **state)
{
    const struct pell_photon_stack s = {
        .count = 3,
        .layer = { { 1.0, 100.0, 0.9, 1.37, 0.1 }, { 1.0, 10.0, 0.0, 1.37, 0.1 }, { 2.0, 10.0, 0.7, 1.37, 0.2 } },
        .n_above = 1.0,
        .n_below = 1.0,
        .mu_min = 1.0,
        .mu_max = 1.0,
        .collisions_max = 100000
    };
    static const double absorbed[3] = { 0.2612, 0.1488, 0.2316 };
    static const double rings[5] = { 30.924, 10.071, 6.1187, 4.4015, 3.5138 }; /* 1/cm^2, 0.01 cm wide */
    const struct count setup = { .albedo = { 1.0 }, .ring_width = 0.01 };
    const double photons = 60000.0, scale = sqrt(photons / 1e6);
    (void) state;
    run(&s, &setup, 44, (uint64_t) photons);
    RESULT(specular, straight[0]);
    REQUIRE_WITHIN(specular, 0.0243729, 0.0);
    RESULT(reflected, face[0][0]);
    REQUIRE_WITHIN(reflected, 0.237544, scale * reflected.error);
    RESULT(through, face[1][0]);
    REQUIRE_WITHIN(through, 0.0964896, scale * through.error);
    for (int i = 0; i < 3; i++) {
        RESULT(layer, sums.absorbed[i]);
        REQUIRE_WITHIN(layer, absorbed[i], hypot(scale * layer.error, 5e-5));
    }
    for (int i = 0; i < 5; i++) {
        RESULT(ring, ring[i]);
        const double area = PELL_PI * 1e-4 * (2.0 * i + 1.0);
        const struct estimate density = { ring.mean / area, ring.error / area };
        REQUIRE_WITHIN(density, rings[i], scale * density.error);
    }
}

/* Chandrasekhar 1960 (H functions) and, behind a boundary, the integral equation of half_space.c: exact for isotropic scattering. */
static void exact_half_spaces(void **state)
{
    const double indices[] = { 1.0, 1.3, 1.5, 0.8 };
    const struct count setup = { .albedo = { 0.1, 0.3, 0.6, 0.9, 0.97, 0.99 } };
    (void) state;
    REQUIRE_NEAR(pell_half_space_albedo(0.9, 1.0), 0.4149474791, 1e-6);
    for (size_t i = 0; i < PELL_COUNT(indices); i++) {
        struct pell_photon_stack s = half_space(0.0, 1.0, 0.0, indices[i]);
        s.roulette = 64;
        run(&s, &setup, 10 + i, 40000);
        for (int k = 0; k < 6; k++) {
            RESULT(total, face[0][k]);
            REQUIRE_WITHIN(total, pell_half_space_albedo(setup.albedo[k], indices[i]), 1e-6);
        }
    }
}

static void oracle_slabs(void **state)
{
    json_t *root = oracle_load("montecarlo.json"), *row;
    size_t i;
    (void) state;
    json_array_foreach(oracle_get(root, "slab_totals"), i, row)
    {
        const struct pell_photon_stack s = slab(0.0, 1.0, 0.0, oracle_number(row, "n"), oracle_number(row, "optical_thickness"));
        const struct count setup = { .albedo = { oracle_number(row, "alpha") } };
        run(&s, &setup, 20 + i, 8000);
        RESULT(reflected, face[0][0]);
        RESULT(through, face[1][0]);
        RESULT(straight, straight[1]);
        const struct estimate total = { through.mean + straight.mean, hypot(through.error, straight.error) };
        REQUIRE_WITHIN(reflected, oracle_number(row, "mc_R"), oracle_number(row, "mc_R_se"));
        REQUIRE_WITHIN(total, oracle_number(row, "mc_T"), oracle_number(row, "mc_T_se"));
    }
    assert_int_equal(i, 10);
    json_decref(root);
}

/* --- Closed forms and laws ---------------------------------------------------------------------------------------------------- */

/* A glass plate: at normal incidence it transmits (1 - F)/(1 + F), into however many layers it is split. */
static void clear_plates_follow_fresnel(void **state)
{
    struct pell_photon_stack s = slab(0.0, 0.0, 0.0, 1.5, 1.0);
    const struct count setup = { .albedo = { 1.0 } };
    (void) state;
    for (int i = 0; i < 2; i++) {
        run(&s, &setup, 40, 100000);
        RESULT(through, straight[1]);
        RESULT(back, straight[0]);
        REQUIRE_WITHIN(through, (1.0 - 0.04) / (1.0 + 0.04) * (s.inside ? 1.0 / 0.96 : 1.0), 0.0);
        REQUIRE_NEAR(through.mean + back.mean, 1.0, 1e-12);
        s = (struct pell_photon_stack) { .count = 3,
                                         .layer = { { 0, 0, 0, 1.5, 0.2 }, { 0, 0, 0, 1.5, 0.3 }, { 0, 0, 0, 1.5, 0.5 } },
                                         .n_above = 1.0,
                                         .n_below = 1.0,
                                         .mu_min = 1.0,
                                         .mu_max = 1.0,
                                         .collisions_max = 10 };
    }
    /* Under uniform diffuse illumination the plate's face reflects pell_fresnel_diffuse; black behind it. */
    s = half_space(1.0, 0.0, 0.0, 1.5);
    s.inside = false;
    s.mu_min = 0.0;
    run(&s, &setup, 41, 100000);
    RESULT(reflected, straight[0]);
    REQUIRE_WITHIN(reflected, pell_fresnel_diffuse(1.0 / 1.5, PELL_FRESNEL_EXACT), 0.0);
}

/* Light that leaves after one collision has a closed form; this tests the phase function and the boundary for every g and eta. */
static void scattered_once(void **state)
{
    static const double cases[][2] = { { 0.0, 1.0 }, { 0.5, 1.3 }, { -0.6, 1.5 }, { 0.9, 1.4 }, { 0.0005, 1.33 }, { -0.2, 0.7 } };
    const struct count setup = { 0 };
    (void) state;
    for (size_t i = 0; i < PELL_COUNT(cases); i++) {
        struct pell_photon_stack s = half_space(0.0, 2.0, cases[i][0], cases[i][1]);
        s.collisions_max = 4;
        run(&s, &setup, 50 + i, 200000);
        RESULT(once, once);
        REQUIRE_WITHIN(once, pell_single_total(cases[i][0], cases[i][1]), 0.0);
    }
}

static void energy_is_conserved(void **state)
{
    const struct pell_photon_stack stacks[] = {
        { .count = 3,
          .layer = { { 0.3, 4.0, 0.8, 1.4, 0.5 }, { 0.0, 0.0, 0.0, 1.0, 0.1 }, { 2.0, 1.0, -0.5, 1.6, 1.0 } },
          .n_above = 1.0,
          .n_below = 1.3,
          .mu_min = 0.0,
          .mu_max = 1.0,
          .collisions_max = 50000 },
        { .count = 2,
          .layer = { { 0.0, 3.0, 0.0, 1.3, 1.0 }, { 0.01, 5.0, 0.3, 1.5, INFINITY } },
          .n_above = 1.0,
          .n_below = 1.0,
          .mu_min = 0.5,
          .mu_max = 0.5,
          .collisions_max = 1000 },
    };
    const struct count setup = { .albedo = { 1.0 } };
    (void) state;
    for (size_t i = 0; i < PELL_COUNT(stacks); i++) {
        run(&stacks[i], &setup, 60 + i, 4000);
        for (int b = 0; b < BATCHES; b++) {
            const struct count *c = &batches[b];
            double all = c->face[0][0] + c->face[1][0] + c->straight[0] + c->straight[1] + c->sums.lost;
            for (int k = 0; k < PELL_PHOTON_LAYERS; k++)
                all += c->sums.absorbed[k];
            REQUIRE_NEAR(all, 1.0, 1e-9); /* not on average: for every photon */
        }
    }
}

/* Helmholtz reciprocity: under uniform diffuse illumination the light that leaves between two cosines equals the cosine-weighted
 * reflectance of a beam incident between these cosines. */
static void reciprocity(void **state)
{
    struct pell_photon_stack s = slab(0.05, 1.0, 0.4, 1.4, 3.0);
    const double a = 0.3, b = 0.6;
    const struct count setup = { .albedo = { 1.0 }, .mu_min = a, .mu_max = b };
    (void) state;
    s.inside = false;
    s.mu_min = 0.0;
    run(&s, &setup, 70, 200000);
    RESULT(band, band);
    s.mu_min = a;
    s.mu_max = b;
    run(&s, &setup, 71, 200000);
    RESULT(back, face[0][0]);
    const struct estimate weighed = { back.mean * (b * b - a * a), back.error * (b * b - a * a) };
    REQUIRE_WITHIN(band, weighed.mean, weighed.error);
}

/* Russian roulette does not change the mean; a reversed stack, cut into layers of the same material, equals the stack. */
static void roulette_and_cuts_change_nothing(void **state)
{
    RELEASE_ONLY();
    struct pell_photon_stack s = half_space(0.0, 1.0, 0.6, 1.4), cut;
    const struct count setup = { .albedo = { 0.95, 0.995 } };
    struct estimate plain[2];
    (void) state;
    run(&s, &setup, 80, 20000);
    for (int i = 0; i < 2; i++) {
        RESULT(r, face[0][i]);
        plain[i] = r;
    }
    s.roulette = 4;
    run(&s, &setup, 81, 60000);
    for (int i = 0; i < 2; i++) {
        RESULT(r, face[0][i]);
        REQUIRE_WITHIN(r, plain[i].mean, plain[i].error);
    }
    s.roulette = 0;
    cut = s;
    cut.count = 3;
    cut.layer[0].thickness = 0.3;
    cut.layer[1] = cut.layer[0];
    cut.layer[1].thickness = 2.0;
    cut.layer[2] = s.layer[0];
    run(&cut, &setup, 82, 20000);
    for (int i = 0; i < 2; i++) {
        RESULT(r, face[0][i]);
        REQUIRE_WITHIN(r, plain[i].mean, plain[i].error);
    }
}

/* --- Photons are the same for any number of threads and SIMD level ------------------------------------------------------------ */

struct trace {
    double sum[8][3]; /* of a band of photons: weight, radius, cosine */
    struct pell_photon_stack stack;
};

static void trace_leave(void *user, const struct pell_photon_exit *e)
{
    double *sum = user;
    sum[0] += e->weight;
    sum[1] += e->radius * (double) (e->index + 1);
    sum[2] += e->mu * e->collisions;
}

static void trace_band(void *arg, int index, int worker)
{
    struct trace *t = arg;
    struct pell_photon_sums sums = { 0 };
    (void) worker;
    pell_photon_walk(&t->stack, 99, 50u * (unsigned) index, 50, trace_leave, NULL, t->sum[index], &sums);
}

static void any_number_of_threads_gives_the_same_bits(void **state)
{
    struct trace one = { .stack = half_space(0.1, 1.0, 0.3, 1.4) }, three = one;
    struct pell_photon_sums sums = { 0 };
    struct pell_context *ctx = test_context(NULL, NULL);
    struct pell_pool *pool;
    double straight[3] = { 0 }, again[3] = { 0 };
    (void) state;
    for (int i = 0; i < 8; i++)
        trace_band(&one, i, 0);
    assert_int_equal(pell_pool_create(ctx, 3, &pool), PELL_OK);
    pell_pool_run(pool, 8, trace_band, &three);
    pell_pool_destroy(&pool);
    pell_context_destroy(&ctx);
    assert_memory_equal(one.sum, three.sum, sizeof(one.sum));

    pell_photon_walk(&one.stack, 99, 0, 100, trace_leave, NULL, straight, &sums);
    pell_photon_walk(&one.stack, 99, 0, 37, trace_leave, NULL, again, &sums);
    pell_photon_walk(&one.stack, 99, 37, 63, trace_leave, NULL, again, &sums);
    assert_memory_equal(straight, again, sizeof(again));
    memset(again, 0, sizeof(again));
    pell_photon_walk(&one.stack, 98, 0, 100, trace_leave, NULL, again, &sums);
    REQUIRE(again[1] != straight[1]);
}

static void faults_are_named(void **state)
{
    const struct pell_photon_stack good = { .count = 2,
                                            .layer = { { 0.1, 1.0, 0.5, 1.4, 1.0 }, { 0.1, 1.0, 0.0, 1.3, INFINITY } },
                                            .n_above = 1.0,
                                            .n_below = 1.0,
                                            .mu_min = 0.0,
                                            .mu_max = 1.0,
                                            .collisions_max = 1 };
    const double bad[] = { NAN, INFINITY, -INFINITY, -1e9 };
    (void) state;
    assert_null(pell_photon_fault(&good));
    for (size_t i = 0; i < PELL_COUNT(bad); i++) {
        struct {
            const char *name;
            size_t offset;
        } fields[] = {
            { "layer[0].sigma_a", offsetof(struct pell_photon_stack, layer[0].sigma_a) },
            { "layer[0].sigma_s", offsetof(struct pell_photon_stack, layer[0].sigma_s) },
            { "layer[0].g", offsetof(struct pell_photon_stack, layer[0].g) },
            { "layer[1].n", offsetof(struct pell_photon_stack, layer[1].n) },
            { "layer[0].thickness", offsetof(struct pell_photon_stack, layer[0].thickness) },
            { "n_above", offsetof(struct pell_photon_stack, n_above) },
            { "n_below", offsetof(struct pell_photon_stack, n_below) },
            { "mu_min", offsetof(struct pell_photon_stack, mu_min) },
            { "mu_max", offsetof(struct pell_photon_stack, mu_max) },
        };
        for (size_t k = 0; k < PELL_COUNT(fields); k++) {
            struct pell_photon_stack s = good;
            memcpy((char *) &s + fields[k].offset, &bad[i], sizeof(double));
            const char *fault = pell_photon_fault(&s);
            if (!fault || strcmp(fault, fields[k].name) != 0)
                fail_msg("%g in %s is reported as %s", bad[i], fields[k].name, fault ? fault : "no fault");
        }
    }
    struct pell_photon_stack s = good;
    s.count = PELL_PHOTON_LAYERS + 1;
    assert_string_equal(pell_photon_fault(&s), "count");
    s = good;
    s.collisions_max = 0;
    assert_string_equal(pell_photon_fault(&s), "collisions_max");
    s = good;
    s.roulette = -1;
    assert_string_equal(pell_photon_fault(&s), "roulette");
    s = good;
    s.layer[1].sigma_a = s.layer[1].sigma_s = 0.0;
    assert_string_equal(pell_photon_fault(&s), "layer[1].sigma_s"); /* a photon would never collide */
}

/* The bounds of every range: exiting light is finite, and the energy of a photon is accounted for. */
static void extremes_stay_finite(void **state)
{
    const double sigma[] = { 0.0, 1e-6, 1.0, 1e6 }, gs[] = { -PELL_G_MAX, 0.0, PELL_G_MAX }, ns[] = { PELL_ETA_MIN, 1.0, PELL_ETA_MAX };
    const struct count setup = { .albedo = { 1.0 } };
    (void) state;
    for (size_t i = 0; i < 4 * 4 * 3 * 3; i++) {
        struct pell_photon_stack s = slab(sigma[i % 4], sigma[i / 4 % 4], gs[i / 16 % 3], ns[i / 48], 1e-3);
        s.mu_min = 0.0;
        s.inside = i % 2 == 0;
        s.collisions_max = 50;
        run(&s, &setup, 90, 40);
        for (int b = 0; b < BATCHES; b++) {
            const struct count *c = &batches[b];
            REQUIRE_NEAR(c->face[0][0] + c->face[1][0] + c->straight[0] + c->straight[1] + c->sums.lost + c->sums.absorbed[0], 1.0, 1e-9);
        }
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(van_de_hulst_slab),
        cmocka_unit_test(giovanelli_half_space),
        cmocka_unit_test(mcml_layers),
        cmocka_unit_test(exact_half_spaces),
        cmocka_unit_test(oracle_slabs),
        cmocka_unit_test(clear_plates_follow_fresnel),
        cmocka_unit_test(scattered_once),
        cmocka_unit_test(energy_is_conserved),
        cmocka_unit_test(reciprocity),
        cmocka_unit_test(roulette_and_cuts_change_nothing),
        cmocka_unit_test(any_number_of_threads_gives_the_same_bits),
        cmocka_unit_test(faults_are_named),
        cmocka_unit_test(extremes_stay_finite),
    };
    return cmocka_run_group_tests_name("photon", tests, NULL, NULL);
}
