/* SPDX-License-Identifier: MIT
 *
 * test_hankel.c - the discrete Hankel transform against closed forms. */
#include "pell_test.h"

#include "math/hankel.h"
#include "math/vec.h"

static struct pell_hankel plan;
static double f[PELL_HANKEL_MAX], out[PELL_HANKEL_FINE_MAX];

/* Int exp(-z s) J0(s r) s ds = z/(r^2 + z^2)^(3/2); the largest difference of r F times z, for radii up to 1e4 z. */
static double pole_error(int count, int oversample, double step, double z)
{
    const double s0 = 45.0 / z, r0 = 1e-2 * z;
    double worst = 0.0;

    pell_hankel_init(&plan, count, oversample, step, s0 * r0);
    for (int i = 0; i < count; i++) {
        const double s = s0 * exp(-step * i);
        f[i] = s * exp(-z * s);
    }
    pell_hankel_apply(&plan, f, out);
    for (int j = 0; j < count * oversample; j++) {
        const double r = r0 * exp(j * step / oversample), rho = sqrt(r * r + z * z);
        if (r < 1e4 * z)
            worst = fmax(worst, fabs(out[j] - r * z / (rho * rho * rho)) * z);
    }
    return worst;
}

static void pole(void **state)
{
    (void) state;
    for (int oversample = 1; oversample <= 4; oversample *= 2)
        for (double z = 1e-6; z < 1e7; z *= 1e3)
            REQUIRE_NEAR(pole_error(256, oversample, 0.2, z), 0.0, 1e-10);
    REQUIRE_NEAR(pole_error(512, 4, 0.1, 1.0), 0.0, 2e-12);
}

/* The error estimate exp(-pi^2/(2 step)) of the header. */
static void error_over_step(void **state)
{
    (void) state;
    for (double step = 0.8; step > 0.25; step -= 0.1) {
        const double error = pole_error(512, 1, step, 1.0), said = exp(-PELL_PI * PELL_PI / (2.0 * step));
        REQUIRE(error < 5.0 * said);
        REQUIRE(error > 1e-3 * said);
    }
}

static void gaussian(void **state)
{
    const double step = 0.08, s0 = 12.0, r0 = 1e-3;
    (void) state;
    pell_hankel_init(&plan, 512, 2, step, s0 * r0);
    for (int i = 0; i < 512; i++) {
        const double s = s0 * exp(-step * i);
        f[i] = s * exp(-0.5 * s * s);
    }
    pell_hankel_apply(&plan, f, out);
    for (int j = 0; j < 1024; j++) {
        const double r = r0 * exp(j * step / 2.0);
        if (r < 100.0)
            REQUIRE_NEAR(out[j], r * exp(-0.5 * r * r), 1e-11);
    }
}

static void linear(void **state)
{
    static double a[PELL_HANKEL_FINE_MAX], b[PELL_HANKEL_FINE_MAX];
    (void) state;
    pell_hankel_init(&plan, 64, 4, 0.3, 2.0);
    for (int i = 0; i < 64; i++)
        f[i] = exp(-0.02 * (i - 20) * (i - 20));
    pell_hankel_apply(&plan, f, a);
    for (int i = 0; i < 64; i++)
        f[i] = sin(0.7 * i) * exp(-0.03 * (i - 40) * (i - 40));
    pell_hankel_apply(&plan, f, b);
    for (int i = 0; i < 64; i++)
        f[i] = 3.0 * f[i] - 2.0 * exp(-0.02 * (i - 20) * (i - 20));
    pell_hankel_apply(&plan, f, out);
    for (int j = 0; j < 256; j++)
        REQUIRE_NEAR(out[j], 3.0 * b[j] - 2.0 * a[j], 1e-12);
}

/* Finer radii interpolate the coarser ones. */
static void oversampled(void **state)
{
    static double coarse[PELL_HANKEL_FINE_MAX];
    (void) state;
    pole_error(128, 1, 0.2, 0.5);
    memcpy(coarse, out, sizeof(coarse));
    pole_error(128, 4, 0.2, 0.5);
    for (int j = 0; j < 128; j++)
        REQUIRE_NEAR(out[4 * j], coarse[j], 1e-13);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(pole),   cmocka_unit_test(error_over_step), cmocka_unit_test(gaussian),
        cmocka_unit_test(linear), cmocka_unit_test(oversampled),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
