/* SPDX-License-Identifier: MIT
 * test_slab.c - slabs by transport: limits, closed forms and conservation. The oracle's photons are compared in oracle_table.c. */
#include "optics/medium/passing.h"
#include "oracle.h"

#include <pellucid/layers.h>
#include <pellucid/profile.h>

static struct pell_medium medium_of(double sigma_a, double sigma_s_reduced, double g, double eta)
{
    struct pell_medium m = { .eta = eta };

    for (int c = 0; c < 3; c++) {
        m.sigma_a[c] = sigma_a;
        m.sigma_s_reduced[c] = sigma_s_reduced;
        m.g[c] = g;
    }
    return m;
}

/* Unscattered light that the second boundary reflects. */
static double turned_back(const struct pell_slab *s, double d)
{
    return s->boundary * exp(-s->sigma_t * d) * pell_slab_at(s, d).straight;
}

static void nothing_is_lost_without_absorption(void **state)
{
    static const double indices[] = { 1.0, 1.3, 1.5, 2.5 };
    (void) state;

    for (size_t i = 0; i < PELL_COUNT(indices); i++)
        for (int forward = 0; forward < 2; forward++) {
            const struct pell_medium m = medium_of(0.0, 2.0, forward ? 0.9 : 0.0, indices[i]);
            struct pell_slab s;
            REQUIRE(pell_slab_make(&m, 1, &s));
            for (double d = 1e-4; d < 3000.0; d *= 1.7) {
                const struct pell_slab_light l = pell_slab_at(&s, d);
                REQUIRE_REL(l.reflected + l.transmitted + l.straight + turned_back(&s, d), 1.0, 1e-3);
                REQUIRE(l.reflected >= 0.0 && l.transmitted >= 0.0 && l.straight >= 0.0);
            }
        }
}

static void a_thick_slab_is_a_half_space(void **state)
{
    static const double albedos[] = { 0.05, 0.3, 0.7, 0.95, 0.999 }, indices[] = { 1.0, 1.3, 1.5, 2.0 };
    (void) state;

    for (size_t k = 0; k < PELL_COUNT(albedos); k++)
        for (size_t i = 0; i < PELL_COUNT(indices); i++) {
            const struct pell_medium m = medium_of(1.0 - albedos[k], albedos[k], 0.0, indices[i]);
            struct pell_slab s;
            REQUIRE(pell_slab_make(&m, 0, &s));
            REQUIRE_REL(pell_slab_at(&s, 2000.0).reflected, pell_half_space_albedo(albedos[k], indices[i]), 1e-3);
            REQUIRE_REL(pell_slab_at(&s, (double) INFINITY).reflected, pell_half_space_albedo(albedos[k], indices[i]), 1e-3);
            REQUIRE_NEAR(pell_slab_at(&s, 2000.0).transmitted, 0.0, 1e-12);
            REQUIRE(pell_slab_at(&s, (double) INFINITY).straight == 0.0);
        }
}

/* Where the albedo is small, hardly any light is scattered twice, and R and T are integrals over the exit direction. */
static void a_thin_slab_scatters_once(void **state)
{
    const struct pell_medium m = medium_of(0.999, 0.001, 0.0, 1.0);
    struct pell_slab s;
    (void) state;

    REQUIRE(pell_slab_make(&m, 0, &s));
    for (double t = 1e-3; t < 4.0; t *= 2.0) {
        double back = 0.0, on = 0.0;
        const int n = 20000;
        for (int i = 0; i < n; i++) {
            const double mu = (i + 0.5) / n;
            back += 0.5 * 0.001 / n * mu / (1.0 + mu) * -expm1(-t * (1.0 + 1.0 / mu));
            on += 0.5 * 0.001 / n * mu * (exp(-t) - exp(-t / mu)) / (1.0 - mu);
        }
        REQUIRE_REL(pell_slab_at(&s, t).reflected, back, 3e-3);
        REQUIRE_REL(pell_slab_at(&s, t).transmitted, on, 3e-3);
        REQUIRE_REL(pell_slab_at(&s, t).straight, exp(-t), 1e-12);
    }
    REQUIRE(pell_slab_at(&s, 0.0).reflected == 0.0 && pell_slab_at(&s, 0.0).transmitted == 0.0);
    REQUIRE(pell_slab_at(&s, 0.0).straight == 1.0);
}

/* Far inside a slab that does not absorb, diffusion is exact: 1/T is linear in the thickness. */
static void transmission_without_absorption_falls_as_one_over_the_thickness(void **state)
{
    const struct pell_medium m = medium_of(0.0, 1.0, 0.0, 1.0);
    struct pell_slab s;
    double at[3];
    (void) state;

    REQUIRE(pell_slab_make(&m, 2, &s));
    for (int i = 0; i < 3; i++)
        at[i] = 1.0 / pell_slab_at(&s, 100.0 * (i + 1)).transmitted;
    REQUIRE_REL(at[2] - at[1], at[1] - at[0], 0.01);
    /* Chandrasekhar 1960: H(1)/sqrt(3) over the thickness and twice Hopf's constant. */
    REQUIRE_REL(1.0 / at[1], 1.6788 / (200.0 + 2.0 * 0.7104), 3e-3);
}

/* Forward-scattered light is not counted as unscattered, and is not lost. */
static void forward_scattering_moves_light_from_straight_to_scattered(void **state)
{
    const struct pell_medium isotropic = medium_of(0.1, 1.0, 0.0, 1.4), forward = medium_of(0.1, 1.0, 0.8, 1.4);
    struct pell_slab a, b;
    (void) state;

    REQUIRE(pell_slab_make(&isotropic, 0, &a) && pell_slab_make(&forward, 0, &b));
    for (double d = 0.1; d < 10.0; d *= 2.0) {
        const struct pell_slab_light x = pell_slab_at(&a, d), y = pell_slab_at(&b, d);
        REQUIRE_REL(x.transmitted + x.straight, y.transmitted + y.straight, 1e-9);
        REQUIRE(y.straight < x.straight && y.transmitted > x.transmitted);
    }
}

static struct pell_stack stack_of(int count, const double (*layer)[4], double eta)
{
    struct pell_stack stack = { .count = count };

    for (int i = 0; i < count; i++) {
        struct pell_medium_layer *l = &stack.layer[i];
        l->eta = eta;
        l->thickness = layer[i][3];
        for (int c = 0; c < 3; c++) {
            l->sigma_a[c] = layer[i][0];
            l->sigma_s_reduced[c] = layer[i][1];
            l->g[c] = layer[i][2];
        }
    }
    return stack;
}

static void layers_of_one_medium_are_the_medium(void **state)
{
    static const double layers[2][3][4] = { { { 0.1, 1.0, 0.8, (double) INFINITY } },
                                            { { 0.1, 1.0, 0.8, 0.05 }, { 0.1, 1.0, 0.8, 1.5 }, { 0.1, 1.0, 0.8, 0.3 } } };
    const struct pell_medium m = medium_of(0.1, 1.0, 0.8, 1.4);
    struct pell_slab one;
    (void) state;

    REQUIRE(pell_slab_make(&m, 0, &one));
    for (int k = 0; k < 2; k++) {
        const struct pell_stack stack = stack_of(k ? 3 : 1, layers[k], 1.4);
        struct pell_slab s;
        REQUIRE(pell_slab_make_layers(&stack, 0, &s));
        for (double d = 1e-4; d < 60.0; d *= 1.6) { /* the last layer extends beyond its bottom */
            const struct pell_slab_light a = pell_slab_at(&one, d), b = pell_slab_at(&s, d);
            REQUIRE_REL(b.reflected, a.reflected, 5e-3);
            REQUIRE_REL(b.straight, a.straight, 3e-3);
            if (a.transmitted > 1e-9)
                REQUIRE_REL(b.transmitted, a.transmitted, 5e-3);
        }
    }
}

static void layers_without_absorption_lose_nothing(void **state)
{
    static const double layers[3][4] = { { 0.0, 20.0, 0.5, 0.1 }, { 0.0, 0.02, 0.0, 0.4 }, { 0.0, 2.0, 0.9, (double) INFINITY } };
    const struct pell_stack stack = stack_of(3, layers, 1.4);
    struct pell_slab s;
    (void) state;

    REQUIRE(pell_slab_make_layers(&stack, 2, &s));
    for (double d = 1e-4; d < 100.0; d *= 1.3) {
        const struct pell_slab_light l = pell_slab_at(&s, d);
        const double crossed =
            l.straight / (1.0 - s.boundary); /* e/(1 - b^2 e^2): e is the unscattered transmittance without a boundary, approximately */
        REQUIRE_NEAR(l.reflected + l.transmitted + l.straight, 1.0, 5e-3 + s.boundary * crossed);
    }
}

/* Clear layers with a scattering sheet in the middle: its halves meet. Reflected light crosses an absorber above it twice. */
static void absorbing_skins_filter_what_is_between(void **state)
{
    static const double plain[1][4] = { { 0.05, 3.0, 0.0, (double) INFINITY } };
    static const double covered[2][4] = { { 1.0, 0.0, 0.0, 0.3 }, { 0.05, 3.0, 0.0, (double) INFINITY } };
    struct pell_slab inside, s;
    struct pell_stack stack = stack_of(1, plain, 1.0);
    (void) state;

    REQUIRE(pell_slab_make_layers(&stack, 0, &inside));
    stack = stack_of(2, covered, 1.0);
    REQUIRE(pell_slab_make_layers(&stack, 0, &s));
    for (double d = 1.0; d < 8.0; d *= 1.5) {
        const struct pell_slab_light a = pell_slab_at(&inside, d), b = pell_slab_at(&s, d + 0.6);
        /* direct attenuation exp(-0.3) along the normal, and in all directions on the way out: between exp(-0.3) of the normal and 2
         * E_3(0.3) of diffuse light */
        REQUIRE(b.transmitted < a.transmitted * exp(-0.6) && b.transmitted > 0.9 * a.transmitted * exp(-0.3) * 0.6007);
        REQUIRE(b.reflected < a.reflected * exp(-0.6) && b.reflected > 0.9 * a.reflected * exp(-0.3) * 0.6007);
        REQUIRE_REL(b.straight, a.straight * exp(-0.6), 0.02);
    }
}

static void media_out_of_range_are_slabs_of_nothing(void **state)
{
    struct pell_medium m = medium_of(0.1, 1.0, 0.0, 1.4);
    struct pell_slab s;
    (void) state;

    REQUIRE(!pell_slab_make(&m, 3, &s) && !pell_slab_make(&m, -1, &s));
    m.eta = 0.2;
    REQUIRE(!pell_slab_make(&m, 0, &s));
    REQUIRE(pell_slab_at(&s, 1.0).reflected < 1e-300 && pell_slab_at(&s, 1.0).transmitted < 1e-300);
    m = medium_of(1.0, 0.0, 0.0, 1.4);
    REQUIRE(pell_slab_make(&m, 0, &s));
    REQUIRE(pell_slab_at(&s, 1.0).reflected < 1e-300 && pell_slab_at(&s, 1.0).straight > 0.3);
    REQUIRE(pell_slab_at(&s, (double) NAN).reflected < 1e-300);
}

/* Pairs of poles (Donner and Jensen 2005): a pole at height z contributes exp(-s |z|), with a second
 * moment of 2 |z| exp(-s |z|)/s. */
static void light_spreads_in_a_slab_as_its_poles_say(void **state)
{
    static const double absorbed[] = { 0.002, 0.05, 1.0 }, thicknesses[] = { 1.0, 3.0, 12.0 };
    (void) state;

    for (size_t a = 0; a < PELL_COUNT(absorbed); a++)
        for (size_t k = 0; k < PELL_COUNT(thicknesses); k++) {
            const struct pell_medium m = medium_of(absorbed[a], 2.0, 0.0, 1.4);
            const double d = thicknesses[k], t = absorbed[a] + 2.0, s = sqrt(3.0 * absorbed[a] * t), l = 1.0 / t;
            const double fdr = pell_fresnel_diffuse(1.4, PELL_FRESNEL_EXACT), zb = 2.0 / (3.0 * t) * (1.0 + fdr) / (1.0 - fdr);
            double total = 0.0, moment = 0.0;
            for (int i = -400; i <= 400; i++)
                for (int sign = 1; sign >= -1; sign -= 2) {
                    const double z = d - (2.0 * i * (d + 2.0 * zb) + (sign > 0 ? l : -l - 2.0 * zb));
                    const double light = sign * copysign(exp(-s * fabs(z)), z);
                    total += light;
                    moment += 2.0 * light * fabs(z) / s;
                }
            REQUIRE_REL(pell_slab_spread(&m, 1, d), 0.5 * moment / total, 1e-6);
        }
}

/* Without absorption the second moment of a thick slab is a third of the square of its thickness; weak absorption is close to none; and
 * a slab of zero thickness does not spread light. */
static void light_spreads_over_a_third_of_the_square_of_a_thickness(void **state)
{
    const struct pell_medium clear = medium_of(0.0, 1.0, 0.0, 1.0), nearly = medium_of(1e-9, 1.0, 0.0, 1.0);
    (void) state;

    REQUIRE_REL(pell_slab_spread(&clear, 0, 1e4), 1e8 / 3.0, 1e-3);
    REQUIRE_REL(pell_slab_spread(&nearly, 0, 3.0), pell_slab_spread(&clear, 0, 3.0), 1e-5);
    REQUIRE(pell_slab_spread(&clear, 0, 0.0) >= 0.0 && pell_slab_spread(&clear, 0, 0.0) < 2.0);
    for (double d = 0.0, before = 0.0; d < 20.0; d += 0.1) {
        const double now = pell_slab_spread(&clear, 0, d);
        REQUIRE(now >= before);
        before = now;
    }
}

/* The transmittance of light along m behind the boundary, relative to its mean, is 1 + slope (1 - m). */
static double passing(const struct pell_half_space_angle *a, double m)
{
    return (1.0 + a->slope * (1.0 - m)) / a->mean;
}

/* Milne's problem without absorption and refraction: H(m), whose flux-weighted mean is 4/sqrt(3) (Chandrasekhar 1960); with both,
 * photons that leave a slab of ten mean free paths of skin1 along twelve cosines, 2e7 of them. */
static void what_comes_from_the_depth_leaves_forward(void **state)
{
    static const double H[][2] = { { 0.3, 1.6425 }, { 0.5, 2.0128 }, { 0.7, 2.3740 }, { 1.0, 2.9078 } };
    static const double photons[][3] = { { 0.71, 0.926, 0.837 }, { 0.80, 0.978, 0.937 }, { 0.89, 1.037, 1.072 }, { 0.98, 1.095, 1.225 } };
    const struct pell_medium clear = medium_of(0.0, 1.0, 0.0, 1.0);
    struct pell_medium skin = medium_of(0.032, 0.74, 0.0, 1.3);
    struct pell_half_space_angle a = pell_passing_angle(&clear, 1);
    (void) state;

    for (size_t i = 0; i < PELL_COUNT(H); i++)
        REQUIRE_REL(passing(&a, H[i][0]), H[i][1] * sqrt(3.0) / 4.0, 0.02);
    skin.sigma_a[1] = 0.17;
    skin.sigma_s_reduced[1] = 0.88;
    for (int c = 0; c < 2; c++) {
        a = pell_passing_angle(&skin, c);
        for (size_t i = 0; i < PELL_COUNT(photons); i++)
            REQUIRE_REL(passing(&a, photons[i][0]), photons[i][1 + c], 0.035);
    }
    skin = medium_of(1.0, 0.0, 0.0, 1.3);
    a = pell_passing_angle(&skin, 0);
    REQUIRE(a.slope == 0.0 && a.mean == 1.0);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(nothing_is_lost_without_absorption),
        cmocka_unit_test(a_thick_slab_is_a_half_space),
        cmocka_unit_test(a_thin_slab_scatters_once),
        cmocka_unit_test(transmission_without_absorption_falls_as_one_over_the_thickness),
        cmocka_unit_test(forward_scattering_moves_light_from_straight_to_scattered),
        cmocka_unit_test(layers_of_one_medium_are_the_medium),
        cmocka_unit_test(layers_without_absorption_lose_nothing),
        cmocka_unit_test(absorbing_skins_filter_what_is_between),
        cmocka_unit_test(media_out_of_range_are_slabs_of_nothing),
        cmocka_unit_test(light_spreads_in_a_slab_as_its_poles_say),
        cmocka_unit_test(light_spreads_over_a_third_of_the_square_of_a_thickness),
        cmocka_unit_test(what_comes_from_the_depth_leaves_forward),
    };

    return cmocka_run_group_tests_name("optics.slab", tests, NULL, NULL);
}
