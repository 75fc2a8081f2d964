/* SPDX-License-Identifier: MIT
 * test_fit_search.c - the fit's search finds the global optimum: an independent descent from random variances must not find a better
 * one. */
#include "pell_test.h"
#include "slow.h"

#include "optics/fit/fit.h"

#include <pellucid/optics.h>

#define MEDIA 30
#define RANDOM_STARTS 10
#define COUNT_TESTED 6

static double uniform(uint64_t *seed)
{
    *seed = *seed * 6364136223846793005u + 1442695040888963407u;
    return (double) (*seed >> 11) * 0x1p-53;
}

/* Mean free paths up to 200 times apart, albedos from 0.5 to 0.99999. */
static struct pell_medium random_medium(uint64_t *seed)
{
    struct pell_medium m = { .eta = 1.0 + uniform(seed) };
    for (int c = 0; c < 3; c++) {
        m.sigma_s_reduced[c] = pow(10.0, -1.0 + 2.3 * uniform(seed));
        m.sigma_a[c] = m.sigma_s_reduced[c] * pow(10.0, -5.0 + 5.0 * uniform(seed));
    }
    return m;
}

static double best_of_random_starts(const struct pell_medium *m, int count, uint64_t *seed)
{
    const struct pell_fit_params params = { .count = count };
    struct pell_dipole dipoles[3];
    struct pell_fit_target t;
    struct pell_fit_work w;
    double best = INFINITY;

    for (int c = 0; c < 3; c++)
        dipoles[c] = pell_dipole_make(m->sigma_a[c], m->sigma_s_reduced[c], m->eta, PELL_FRESNEL_EXACT);
    pell_fit_target_dipoles(dipoles, 3, &params, &t);
    pell_fit_begin(&w, &t);
    w.count = count;
    for (int s = 0; s < RANDOM_STARTS; s++) {
        struct pell_fit_point p;
        const double low = t.low + 2.0 * uniform(seed), high = t.high - 0.5 * (t.high - t.low) * uniform(seed);
        for (int i = 0; i < count; i++)
            p.x[i] = low + (high - low) * uniform(seed);
        pell_fit_descend(&w, &p, 1e-12, 200);
        best = fmin(best, p.cost);
    }
    return best;
}

static void not_beaten(const char *name, const struct pell_medium *m, uint64_t *seed)
{
    for (int k = 1; k <= COUNT_TESTED; k++) {
        const struct pell_fit_params params = { .count = k };
        struct pell_gaussians g;
        struct pell_fit_report report;
        double cost = 0.0;
        assert_int_equal(pell_fit_medium(m, &params, &g, &report), PELL_OK);
        for (int c = 0; c < 3; c++)
            cost += report.error[c] * report.error[c];
        const double best = best_of_random_starts(m, k, seed);
        if (!(cost <= best * (1.0 + 1e-6)))
            fail_msg("%s, k = %d: cost %.9g, a random start reached %.9g", name, k, cost, best);
    }
}

/* The 12 media of Jensen et al. 2001. */
static const char *const measured[] = { "apple",  "chicken1", "chicken2", "cream", "ketchup",    "marble",
                                        "potato", "skimmilk", "skin1",    "skin2", "spectralon", "wholemilk" };

static void random_starts_do_not_beat_measured_media(void **state)
{
    uint64_t seed = 1;
    (void) state;
    for (size_t i = 0; i < PELL_COUNT(measured); i++)
        not_beaten(measured[i], &pell_material_find(measured[i])->medium, &seed);
}

static void random_starts_do_not_beat_random_media(void **state)
{
    RELEASE_ONLY();
    uint64_t seed = 2;
    (void) state;
    for (int i = 0; i < MEDIA; i++) {
        char name[32];
        const struct pell_medium m = random_medium(&seed);
        snprintf(name, sizeof(name), "random medium %d", i);
        not_beaten(name, &m, &seed);
    }
}

/* The derivative of the projected residuals against central differences, weights held at 0 included. */
static void jacobian_is_the_derivative_of_the_residuals(void **state)
{
    uint64_t seed = 3;
    int held = 0;
    (void) state;
    for (int round = 0; round < 60; round++) {
        static double f[3][3 * FIT_NODES], jac[FIT_COUNT_MAX * 3 * FIT_NODES];
        const struct pell_medium m = random_medium(&seed);
        const int count = 1 + round % 6;
        const struct pell_fit_params params = { .count = count, .free_energy = round % 2 };
        struct pell_dipole dipoles[3];
        struct pell_fit_target t;
        struct pell_fit_work w;
        double x[FIT_COUNT_MAX];
        for (int c = 0; c < 3; c++)
            dipoles[c] = pell_dipole_make(m.sigma_a[c], m.sigma_s_reduced[c], m.eta, PELL_FRESNEL_EXACT);
        pell_fit_target_dipoles(dipoles, 3, &params, &t);
        pell_fit_begin(&w, &t);
        w.count = count;
        const int rows = 3 * t.nodes;
        for (int i = 0; i < count; i++)
            x[i] = -1.0 + 12.0 * (i + 0.3 + 0.6 * uniform(&seed)) / count;
        pell_fit_residuals(&w, rows, count, x, f[0], NULL, 0, 1);
        int ranks[3];
        for (int c = 0; c < 3; c++) {
            ranks[c] = w.best[c].rank;
            held += ranks[c] + (w.best[c].pivot >= 0) < count;
        }
        pell_fit_residuals(&w, rows, count, x, f[0], jac, rows, 2);
        for (int i = 0; i < count; i++) {
            const double at = x[i], h = 1e-5;
            bool same = true; /* a weight that becomes or ceases to be 0 between the two points makes the derivative discontinuous */
            for (int s = 0; s < 2; s++) {
                x[i] = at + (s ? h : -h);
                pell_fit_residuals(&w, rows, count, x, f[1 + s], NULL, 0, 1);
                for (int c = 0; c < 3; c++)
                    same = same && w.best[c].rank == ranks[c];
            }
            x[i] = at;
            double off = 0.0, size = 0.0;
            for (int j = 0; j < rows; j++) {
                const double numeric = (f[2][j] - f[1][j]) / (2.0 * h), exact = jac[i * rows + j];
                off += (numeric - exact) * (numeric - exact);
                size += exact * exact;
            }
            if (same)
                REQUIRE(sqrt(off) <= 1e-6 * sqrt(size) + 1e-8);
        }
    }
    REQUIRE(held > 10);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(jacobian_is_the_derivative_of_the_residuals),
        cmocka_unit_test(random_starts_do_not_beat_measured_media),
        cmocka_unit_test(random_starts_do_not_beat_random_media),
    };
    return cmocka_run_group_tests_name("optics.fit_search", tests, NULL, NULL);
}
