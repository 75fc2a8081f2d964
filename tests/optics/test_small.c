/* SPDX-License-Identifier: MIT
 * test_small.c - reflectance of balls of a few mean free paths under uniform illumination, against photons traced here. */
#include "pell_test.h"

#include "math/sampling.h"
#include "math/vec.h"
#include "optics/medium/small.h"

enum { PHOTONS = 40000, ALBEDOS = 4 };

static const double albedos[ALBEDOS] = { 0.3, 0.8, 0.95, 0.99 };

static uint32_t numbers;

static double uniform(void)
{
    return (double) pell_unit_float(pell_hash(++numbers));
}

/* Uniform illumination, reduced by symmetry to light at the pole of a ball; lengths in mean free paths. Returns the fraction of the
 * entering light that leaves after scattering. */
static void follow(double diameter, double eta, double left[ALBEDOS], double *entered)
{
    const double radius = 0.5 * diameter, c = sqrt(uniform()), sine = sqrt(1.0 - c * c) / eta, turn = 2.0 * PELL_PI * uniform();
    double weight[ALBEDOS], x[3] = { 0.0, 0.0, radius }, w[3] = { sine * cos(turn), sine * sin(turn), -sqrt(1.0 - sine * sine) };
    bool scattered = false;

    for (int k = 0; k < ALBEDOS; k++)
        weight[k] = 1.0 - pell_fresnel(eta, c);
    *entered += weight[0];
    while (weight[ALBEDOS - 1] > 1e-4) {
        const double b = x[0] * w[0] + x[1] * w[1] + x[2] * w[2], q = x[0] * x[0] + x[1] * x[1] + x[2] * x[2] - radius * radius;
        const double to_surface = fmax(sqrt(fmax(b * b - q, 0.0)) - b, 0.0), flight = -log(uniform() + 1e-12), d = fmin(to_surface, flight);
        for (int i = 0; i < 3; i++)
            x[i] += d * w[i];
        if (flight < to_surface) {
            const double z = 2.0 * uniform() - 1.0, around = 2.0 * PELL_PI * uniform(), r = sqrt(1.0 - z * z);
            w[0] = r * cos(around);
            w[1] = r * sin(around);
            w[2] = z;
            scattered = true;
            for (int k = 0; k < ALBEDOS; k++)
                weight[k] *= albedos[k];
            continue;
        }
        const double out = (x[0] * w[0] + x[1] * w[1] + x[2] * w[2]) / radius;
        if (uniform() >= pell_fresnel(1.0 / eta, fmax(out, 1e-9))) {
            for (int k = 0; k < ALBEDOS && scattered; k++)
                left[k] += weight[k];
            return;
        }
        for (int i = 0; i < 3; i++) {
            w[i] -= 2.0 * out * x[i] / radius;
            x[i] *= 1.0 - 1e-9;
        }
    }
}

static void balls_return_as_much_as_photons_say(void **state)
{
    static const double diameters[] = { 0.25, 0.5, 1.0, 2.0, 4.0, 7.0 }, etas[] = { 1.0, 1.3, 1.5 };
    (void) state;

    for (size_t e = 0; e < PELL_COUNT(etas); e++)
        for (size_t i = 0; i < PELL_COUNT(diameters); i++) {
            double left[ALBEDOS] = { 0.0 }, entered = 0.0;
            for (int n = 0; n < PHOTONS; n++)
                follow(diameters[i], etas[e], left, &entered);
            for (int k = 0; k < ALBEDOS; k++) {
                const struct pell_medium m = { .sigma_a = { 2.0 * (1.0 - albedos[k]) },
                                               .sigma_s_reduced = { 2.0 * albedos[k] },
                                               .eta = etas[e] };
                const double photons = left[k] / entered, formula = pell_small_ball(&m, 0, 0.5 * diameters[i]);
                print_message("# index %.1f, %.2f mean free paths, albedo %.2f: %.4f by photons, %.4f\n", etas[e], diameters[i], albedos[k],
                              photons, formula);
                REQUIRE_REL(formula, photons, diameters[i] > 5.0 ? 0.3 : diameters[i] > 3.0 ? 0.16 : 0.12);
            }
        }
}

static void large_balls_are_left_to_diffusion(void **state)
{
    const struct pell_medium m = { .sigma_a = { 0.1 }, .sigma_s_reduced = { 0.9 }, .eta = 1.4 };
    (void) state;

    REQUIRE(pell_small_weight(&m, 0, 20.0) == 0.0 && pell_small_weight(&m, 0, 2.0) == 1.0);
    REQUIRE(pell_small_ball(&m, 0, 0.0) == 0.0 && pell_small_ball(&m, 0, 1e-6) < 1e-6);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(balls_return_as_much_as_photons_say),
        cmocka_unit_test(large_balls_are_left_to_diffusion),
    };

    return cmocka_run_group_tests(tests, NULL, NULL);
}
